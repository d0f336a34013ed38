"""What is right: the integration by DOP853 that the tests trust, at a relative tolerance of 1e-12.

How far it is itself to be trusted is measured by a second run at 1e-13.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from reports.speed import events_ivp
from reports.speed.drives import Straight
from reports.speed.equations import Loaded
from reports.speed.studies import Case, distance, energy_coordinates
from tests.oracles import reference as oracle

RTOL, FINER = 1e-12, 1e-13


class Truth(NamedTuple):
    """States at the times asked for, and by how much a tighter tolerance moves them."""

    states: np.ndarray
    uncertainty: float


def sshi(case: Case, times: np.ndarray) -> Truth:
    """Run from rest to the last of ascending times."""

    def states(rtol):
        found = oracle.simulate(case.table, 0, duration=float(times[-1]), times=times, rtol=rtol)
        device = case.table["transducer"]
        v_t = (found.q - device["coupling"] * found.x) / device["capacitance"]
        return energy_coordinates(case, found.x, found.u, v_t, found.v - v_t, found.v_dc)

    coarse, fine = states(RTOL), states(FINER)
    return Truth(coarse, distance(fine, coarse))


def record(case: Case, force: np.ndarray, rate: float, times: np.ndarray) -> Truth:
    """Run through a record, which the oracle does not read: DOP853, started again at every sample and event."""
    model = Loaded(case.table, Straight(force, rate))
    coarse, fine = (model.readings(events_ivp.run(model, times, "DOP853", rtol)) for rtol in (RTOL, FINER))
    return Truth(coarse, distance(fine, coarse))
