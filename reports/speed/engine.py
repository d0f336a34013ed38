"""piezoharvest itself, by the interface below `simulate` where Python's share of a short run would be counted too."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.lowering.lower import lower
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.run import Machine
from piezoharvest.engine.work_limit import MAX_WORK
from reports.speed.studies import Case, energy_coordinates
from reports.speed.timing import Seconds, once, repeat


class Simulation:
    """A case lowered to the engine's tables, with a state that runs.

    Attributes
    ----------
    set_up : float
        Time for lowering and for the first period, in which the tables are made, s.
    """

    def __init__(self, case: Case, ledger: bool = False) -> None:
        self.case = case
        self.system, self.excitation = case.objects()
        self.machine, lowering = once(lambda: Machine(lower(self.system, self.excitation), ledger=ledger))
        self.lowered = self.machine.lowered
        self.restart()
        self.set_up = lowering + once(lambda: self.run(0.02))[1]
        self.restart()

    def restart(self) -> None:
        """Go back to rest, with all the work to spend that one simulation may take."""
        self.state = self.machine.state()
        self.lowered.budget.left = MAX_WORK

    def run(self, t_end: float) -> None:
        """Run on to t_end (s)."""
        status = self.machine.run(self.state, t_end)
        if status:
            raise RuntimeError(f"the engine ended with status {status}")

    def reading(self) -> np.ndarray:
        """What is compared of the present state: see `studies.energy_coordinates`."""
        device, lowered = self.case.table["transducer"], self.lowered
        n = len(lowered.states)
        state = dict(zip(lowered.states, self.state.z[:n] * lowered.program.scale, strict=True))
        v_t = (state["q"] - device["coupling"] * state["x1"]) / device["capacitance"]
        weights = device.get("hysteresis", {}).get("weights", ())
        v_h = sum(w * state[f"stop{j}"] for j, w in enumerate(weights, 1))
        return energy_coordinates(self.case, state["x1"], state["u1"], v_t, v_h, state.get("dc", 0.0))[0]

    def harvested(self) -> float:
        """Energy harvested so far, J, where a ledger is kept."""
        return float(self.state.energy[self.lowered.categories.index("harvested")])


def states(case: Case, times: np.ndarray) -> np.ndarray:
    """States at ascending times, from rest; a row for each."""
    simulation, rows = Simulation(case), []
    for time in times:
        simulation.run(time)
        rows.append(simulation.reading())
    return np.array(rows)


def events(case: Case, t_end: float) -> int:
    """Number of events in a run from rest."""
    simulation = Simulation(case)
    simulation.run(t_end)
    return int(simulation.state.D[st.LOGGED])


def time_run(case: Case, t_end: float, repeats: int, share: float) -> tuple[Seconds, float]:
    """Time of a run from rest, multiplied by `share`, and time to set it up, s."""
    simulation = Simulation(case)

    def work():
        simulation.restart()
        simulation.run(t_end)

    return repeat(work, repeats, share), simulation.set_up
