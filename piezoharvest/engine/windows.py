"""Averages over consecutive windows of a run from rest."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezoharvest.description.excitation import Excitation, Ramps
from piezoharvest.description.limits import check_length
from piezoharvest.description.system import System
from piezoharvest.engine.lowering.lower import lower
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.run import Machine
from piezoharvest.engine.steady_search import EngineError, check
from piezoharvest.engine.work_limit import Budget


class Windows(NamedTuple):
    """Averages over each window.

    Attributes
    ----------
    harvested_power : (n,) array
        W.
    displacement_square : (n,) array
        Mean square of the displacement, m^2, from samples at the knots of the excitation.
    complete : bool
        False if the run came to an end before its last window; the windows before are right.
    """

    harvested_power: np.ndarray
    displacement_square: np.ndarray
    complete: bool


def window_averages(system: System, excitation: Excitation, edges: np.ndarray, budget: Budget | None = None) -> Windows:
    """Averages of a run from rest over the windows between edges.

    Parameters
    ----------
    system : System
    excitation : Excitation
        A signal of straight pieces (noise, a record).
    edges : (n + 1,) array
        s, increasing; what lies before the first is left out.
    budget : Budget, optional
        Work limit, from which the work done is subtracted; default that of one simulation.
    """
    check_length(system.transducer, excitation, float(edges[-1]))
    lowered = lower(system, excitation, float(edges[-1]))
    lowered = lowered._replace(budget=budget or lowered.budget)
    signal = lowered.signal
    assert isinstance(signal, Ramps)
    times = signal.times[(signal.times >= edges[0]) & (signal.times < edges[-1])]
    machine = Machine(lowered, ledger=True)
    state = machine.state(sample_time=times)
    harvested, place = [], list(lowered.categories).index("harvested")
    complete = True
    try:
        for edge in edges:
            check(machine.run(state, float(edge)))
            harvested.append(float(state.energy[place]))
    except EngineError:
        complete = False
    power = np.diff(harvested) / np.diff(edges)[: max(len(harvested) - 1, 0)]
    drawn = state.samples[: int(state.D[st.SAMPLED]), pg.OUTPUTS.index("displacement")]
    which = np.searchsorted(edges, times[: len(drawn)], side="right") - 1
    squares = [float(np.mean(drawn[which == n] ** 2)) for n in range(len(power))]
    return Windows(power, np.array(squares), complete)
