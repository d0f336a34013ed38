"""Runs netlists in ngspice, where it is installed, and reads what their .meas commands found."""

from __future__ import annotations

import pytest

from piezoharvest.spice.simulators.ngspice import ABSENT, NgspiceError, available, run_netlist

__all__ = ["NgspiceError", "needs_ngspice", "run_netlist"]

_SKIP = pytest.mark.skipif(not available(), reason=ABSENT)


def needs_ngspice(test):
    """Mark a test or a class of tests as `spice`, and skip it where ngspice is absent."""
    return pytest.mark.spice(_SKIP(test))
