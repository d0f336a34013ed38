"""Runs netlists in ngspice, where it is installed, and reads what their .meas commands found."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest

NGSPICE = shutil.which("ngspice")
_SKIP = pytest.mark.skipif(NGSPICE is None, reason="ngspice is not on the PATH (Debian: apt install ngspice)")

_MEASUREMENT = re.compile(r"^(\w+)\s+=\s+([-+]?[\d.]+(?:e[-+]?\d+)?)\s+from=", re.MULTILINE | re.IGNORECASE)
# ngspice ends with status 0 after some of these, and goes on from others with numbers that mean nothing.
_FAILURES = re.compile(r"error|aborted|fatal|singular|too small|meas .* failed|unknown|unrecognized", re.IGNORECASE)


def needs_ngspice(test):
    """Mark a test or a class of tests as `spice`, and skip it where ngspice is absent."""
    return pytest.mark.spice(_SKIP(test))


class NgspiceError(RuntimeError):
    """The netlist did not run."""


def run_netlist(netlist: str, timeout: float = 120.0) -> dict[str, float]:
    """Run a netlist in batch mode.

    Parameters
    ----------
    netlist : str
    timeout : float
        s

    Returns
    -------
    dict
        Results of the .meas commands by name.

    Raises
    ------
    NgspiceError
        ngspice reported a failure, or measured nothing.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "netlist.cir"
        path.write_text(netlist)
        command = [str(NGSPICE), "-b", path.name]
        run = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=timeout, check=False)
    output = run.stdout + run.stderr
    # The first line that is printed repeats the title, which may hold any word.
    lines = [line for line in output.splitlines() if not line.startswith("Circuit:")]
    failures = [line for line in lines if _FAILURES.search(line)]
    measured = {name.lower(): float(value) for name, value in _MEASUREMENT.findall("\n".join(lines))}
    if run.returncode or failures or not measured:
        raise NgspiceError("\n".join(failures) or output[-2000:])
    return measured
