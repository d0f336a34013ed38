"""Run of a model, and its waveforms at given instants."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from piezoharvest.bench.solver.drive import Drive
from piezoharvest.bench.solver.integrator import Integrator
from piezoharvest.bench.solver.model import Model
from piezoharvest.bench.solver.open_voltage import open_voltage
from piezoharvest.description.excitation import Excitation
from piezoharvest.progress import Stage

SIGNALS = (
    "displacement", "velocity", "reading", "voltage", "current", "acceleration", "dc_voltage", "dc_current",
)  # fmt: skip
OF_THE_RUN = ("steps", "events", "pulses")  # attributes of waves that are not waveforms


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
    acceleration : m/s^2, of the displacement
    dc_voltage, dc_current : V and A, behind a bridge and into its load; NaN without one
    states : (instants, states), those of the model
    steps, events : int
        Numbers of the solver's steps and events.
    pulses : tuple of (float, float), or None
        When a switch has closed and opened, s; at once where it discharges.
    """

    time: np.ndarray
    drive: np.ndarray
    displacement: np.ndarray
    velocity: np.ndarray
    reading: np.ndarray
    voltage: np.ndarray
    current: np.ndarray
    acceleration: np.ndarray
    dc_voltage: np.ndarray
    dc_current: np.ndarray
    states: np.ndarray
    steps: int
    events: int
    pulses: tuple[tuple[float, float], ...] | None = None

    @property
    def gate(self) -> np.ndarray:
        """1 where the switch has been closed since the instant before, at any time, 0 elsewhere; NaN without one.

        So latched by a logic input, no pulse is lost that is shorter than a sample: it was closed first within the
        sample that ends at the first 1.
        """
        if self.pulses is None:
            return np.full(len(self.time), np.nan)
        gate = np.zeros(len(self.time))
        for closed, opened in self.pulses:
            first, last = np.searchsorted(self.time, (closed, opened))
            gate[first : last + 1] = 1.0
        return gate

    def sensed(self, channel: str) -> np.ndarray:
        """Signal at the input of a channel, by the channel's name."""
        names = {"force": "drive", "base_acceleration": "drive", "displacement": "reading"}
        return getattr(self, names.get(channel, channel))

    def at(self, times: np.ndarray) -> Waves:
        """Waveforms at the instants nearest to the given ones."""
        index = np.searchsorted(0.5 * (self.time[:-1] + self.time[1:]), times)
        arrays = {f.name: getattr(self, f.name)[index] for f in fields(self) if f.name not in OF_THE_RUN}
        return replace(self, **arrays)


def integrate(model: Model, excitation: Excitation, times: np.ndarray, stage: Stage | None = None) -> Waves:
    """Run a model from rest under an excitation.

    Parameters
    ----------
    model : Model
        Modified: its branches are those at the end.
    excitation : Excitation
    times : (n,) array
        Instants in s, increasing, the first one 0.
    stage : Stage, optional
        Tells how far the run is.

    Raises
    ------
    SolverError
        The equations have no solution, or not within the limit of steps.
    """
    drive = Drive(excitation, times)
    if model.circuit.tracks:
        model.circuit.track(open_voltage(model, excitation))
    model.circuit.driven(excitation.period)
    run = Integrator(model, drive)
    run.run(stage)
    nodes, values = drive.nodes, drive.at(drive.nodes)
    columns = {name: np.empty(len(nodes)) for name in SIGNALS}
    ends = [start for start, _ in run.branches[1:]] + [len(nodes)]
    for (start, branches), end in zip(run.branches, ends, strict=True):
        if start < end:
            span = slice(start, end)
            model.branches = branches
            for name, part in model.signals(nodes[span], values[span], run.states[span].T).items():
                columns[name][span] = part
    switch = model.circuit.switch
    waves = Waves(
        nodes, values, **columns, states=run.states, steps=run.steps, events=run.events,
        pulses=tuple(switch.pulses) if switch else None,
    )  # fmt: skip
    return waves.at(times)
