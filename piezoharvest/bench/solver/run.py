"""Run of a model, and its waveforms at given instants."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from piezoharvest.bench.solver.drive import Drive
from piezoharvest.bench.solver.integrator import Integrator
from piezoharvest.bench.solver.model import Model
from piezoharvest.description.excitation import Excitation


@dataclass(frozen=True, eq=False)
class Waves:
    """Noise-free waveforms; arrays of shape (instants,).

    Attributes
    ----------
    time : s
    drive : N, or m/s^2 for base excitation; at a jump the value after it
    displacement, velocity : m and m/s, weighted by participation
    reading : m, of the displacement sensor
    voltage, current : V and A, of the load
    states : (instants, states), those of the model
    steps, events : int
        Numbers of the solver's steps and events.
    """

    time: np.ndarray
    drive: np.ndarray
    displacement: np.ndarray
    velocity: np.ndarray
    reading: np.ndarray
    voltage: np.ndarray
    current: np.ndarray
    states: np.ndarray
    steps: int
    events: int

    def sensed(self, channel: str) -> np.ndarray:
        """Signal at the input of a channel, by the channel's name."""
        names = {"force": "drive", "base_acceleration": "drive", "displacement": "reading"}
        return getattr(self, names.get(channel, channel))

    def at(self, times: np.ndarray) -> Waves:
        """Waveforms at the instants nearest to the given ones."""
        index = np.searchsorted(0.5 * (self.time[:-1] + self.time[1:]), times)
        arrays = {f.name: getattr(self, f.name)[index] for f in fields(self) if f.name not in ("steps", "events")}
        return replace(self, **arrays)


def integrate(model: Model, excitation: Excitation, times: np.ndarray) -> Waves:
    """Run a model from rest under an excitation.

    Parameters
    ----------
    model : Model
        Modified: its branches are those at the end.
    excitation : Excitation
    times : (n,) array
        Instants in s, increasing, the first one 0.

    Raises
    ------
    SolverError
        The equations have no solution, or not within the limit of steps.
    """
    drive = Drive(excitation, times)
    run = Integrator(model, drive)
    run.run()
    nodes, values = drive.nodes, drive.at(drive.nodes)
    columns = {name: np.empty(len(nodes)) for name in ("displacement", "velocity", "reading", "voltage", "current")}
    ends = [start for start, _ in run.branches[1:]] + [len(nodes)]
    for (start, branches), end in zip(run.branches, ends, strict=True):
        if start < end:
            span = slice(start, end)
            model.branches = branches
            for name, part in model.signals(nodes[span], values[span], run.states[span].T).items():
                columns[name][span] = part
    waves = Waves(nodes, values, **columns, states=run.states, steps=run.steps, events=run.events)
    return waves.at(times)
