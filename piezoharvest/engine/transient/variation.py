"""Sampled outputs of a run through a signal, with derivatives with respect to quantities and initial states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory.state import EngineState
from piezoharvest.engine.propagation.advance import DONE
from piezoharvest.engine.run import Machine
from piezoharvest.engine.steady_search import EngineError, check
from piezoharvest.engine.transient.along_tape import REMEMBERED, Motions, Moving, follow
from piezoharvest.engine.transient.bending import bending_of
from piezoharvest.engine.transient.forcing import forcing_of
from piezoharvest.engine.transient.sampled_system import SampledSystem

# Of the outputs of smooth elements in a step; a whole record is then right to 6e-8 (measured, rms), what a
# converter of 24 bits resolves.
TOLERANCE = 1e-8
MOTIONS_A_SAMPLE = 3  # room for motions, of which one ends at each sample, enlarged where it is too small


class SampledOutputs(NamedTuple):
    """Outputs at samples.

    Attributes
    ----------
    values : (samples, outputs) array
    slopes : (samples, outputs, lanes) array
        Derivatives with respect to the quantities, then to what the initial state depends on.
    """

    values: np.ndarray
    slopes: np.ndarray


class TimedSwitch:
    """A switch that acts at given times and by its lag later, instead of at the extrema of sum T_i x_i.

    Parameters
    ----------
    causes : (k,) array
        Ascending, s.
    changes : (k, lanes) array
        Derivatives of these by the quantities, then by what the initial state depends on.
    program : Program
        Nominal system.
    """

    def __init__(self, causes: np.ndarray, changes: np.ndarray, program: pg.Program) -> None:
        self.causes, self.changes = causes, changes
        self._times, self._voltage = causes + float(program.lag), program.voltage_row

    def run(self, machine: Machine, state: EngineState, t_end: float) -> int:
        """Run to a time through the actions before it, and return the engine's status, as `Machine.run`.

        An action at the very end is left to the next run.
        """
        first, last = np.searchsorted(self._times, (state.clock[st.NOW], t_end))
        for time in self._times[first:last]:
            status = machine.run(state, float(time))
            if status != DONE:
                return status
            # The voltage is lowest where sum T_i x_i is highest: there it was left by the last action.
            state.D[st.WAITING], state[st.QUEUE][0] = 1, time
            state[st.POLARITY][0] = -1 if self._voltage @ state.z > 0.0 else 1
        return machine.run(state, t_end)


class PlainRun:
    """A run from a state, a block of samples at a time.

    Parameters
    ----------
    system : SampledSystem
    times : (samples,) array
        s.
    start : EngineState
    outputs : sequence of str
        Wanted ones of `pg.OUTPUTS`.
    switch : TimedSwitch, optional
        In the place of that of the circuit.
    """

    def __init__(
        self, system: SampledSystem, times: np.ndarray, start: EngineState, outputs: Sequence[str],
        switch: TimedSwitch | None = None,
    ) -> None:  # fmt: skip
        self._machine = system.machine(timed=switch is not None)
        self._times, self._state, self._switch = times, start, switch
        self._rows = [pg.OUTPUTS.index(name) for name in outputs]

    def through(self, begin: int, end: int) -> np.ndarray:
        """Outputs (samples, outputs) from one sample, at which the last block ended, to another one, both included.

        Raises
        ------
        EngineError
            The run cannot be simulated.
        """
        times = self._times[begin : end + 1]
        state = self._machine.state(sample_time=times, tolerance=TOLERANCE)
        state.follow(self._state)
        check(_run(self._machine, state, float(times[-1]), self._switch))
        self._state = state
        values = state.samples[:, self._rows]
        if state.D[st.SAMPLED] < len(times) or not np.all(np.isfinite(values)):
            raise EngineError(f"no solution after {times[0]:g} s")
        return values


class SampledRun:
    """A run from a state, followed once more with derivatives, a block of samples at a time.

    Parameters
    ----------
    system : SampledSystem
        Under tones or a signal of straight pieces between the samples.
    times : (samples,) array
        s, evenly spaced.
    start : EngineState
        State of the nominal system, without smooth elements, at the first sample.
    changes : (n, lanes) array
        Derivatives of its scaled states: with respect to the quantities, then to what it depends on.
    outputs : sequence of str
        Wanted ones of `pg.OUTPUTS`.
    switch : TimedSwitch, optional
        In the place of that of the circuit.
    """

    def __init__(
        self, system: SampledSystem, times: np.ndarray, start: EngineState, changes: np.ndarray,
        outputs: Sequence[str], switch: TimedSwitch | None = None,
    ) -> None:  # fmt: skip
        self._system, self._times = system, times
        self._rows = [pg.OUTPUTS.index(name) for name in outputs]
        self._machine = system.machine(timed=switch is not None)
        self._state, self._switch = start, switch
        (n, lanes), a = changes.shape, system.lowered.program.rate.shape[-1]
        elements = pg.DERIVATIVES * len(system.plain.program.element_power)
        self._moving, self._n = _moving(n + elements, a, lanes), n
        self._moving.d[:n] = changes
        self._switching = system.switching
        if switch is not None:
            self._switching = self._switching._replace(timed=1)
            self._moving = self._moving._replace(cause_time=switch.causes.copy(), cause=switch.changes.copy())

    @property
    def changes(self) -> np.ndarray:
        """Derivatives (n, lanes) of the scaled states at the end of the last block."""
        return self._moving.d[: self._n]

    def through(self, begin: int, end: int) -> SampledOutputs:
        """Outputs from one sample, at which the last block ended, to another one, both included.

        Raises
        ------
        EngineError
            The run cannot be simulated.
        """
        times = self._times[begin : end + 1]
        motions, modes = self._motions(float(times[-1]), len(times))
        steps = self._system.steps(modes, float(times[1] - times[0]), self._rows)
        values = np.empty((len(times), len(self._rows)))
        slopes = np.empty((*values.shape, len(self._moving.shift)))
        memory = np.empty_like(self._moving.z), np.empty_like(self._moving.d)
        program, bent = self._system.lowered.program, self._system.is_bent
        forcing = forcing_of(program, motions.starts, bent)
        bending = bending_of(program, self._system.count, steps, bent, len(self._moving.shift))
        written = follow(steps, self._switching, forcing, bending, motions, self._moving, memory, times, values, slopes)
        if written < len(times) or not np.all(np.isfinite(values)):
            raise EngineError(f"no solution after {times[max(written - 1, 0)]:g} s")
        return SampledOutputs(values, slopes)

    def _motions(self, t_end: float, samples: int) -> tuple[Motions, list[tuple[int, np.ndarray]]]:
        """Motions between the events up to a time, to which the run moves on, and their modes."""
        machine, room = self._machine, MOTIONS_A_SAMPLE * samples + 64
        while True:
            state = machine.state(tape=room, steps_taped=True, tolerance=TOLERANCE)
            state.follow(self._state)
            check(_run(machine, state, t_end, self._switch))
            count = int(state.D[st.TAPED])
            if count < room:
                break
            room *= 2
        self._state = state
        a, h = int(machine.L[pg.A]), int(machine.L[pg.H])
        numbers, kinds = state[st.TAPE].reshape(-1, 2 + a)[:count], state[st.TAPE_KIND].reshape(-1, 3 + h)[:count]
        keys = np.column_stack([kinds[:, 0], kinds[:, 3:] != 0])
        found, first, which = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        modes = [(int(key[0]), kinds[k, 3:].copy()) for key, k in zip(found, first, strict=True)]
        states = numbers[:, 2:]
        if a < len(self._moving.z):  # room for the outputs of elements
            place = self._system.lowered.program.rate.shape[-2]
            states = np.insert(states, [place] * (len(self._moving.z) - a), 0.0, axis=1)
        columns = (
            numbers[:, 0], numbers[:, 1], states, which.ravel().astype(np.int64), kinds[:, 0], kinds[:, 1],
            kinds[:, 3:],
        )  # fmt: skip
        return Motions(*map(np.ascontiguousarray, columns)), modes


def _run(machine: Machine, state: EngineState, t_end: float, switch: TimedSwitch | None) -> int:
    return machine.run(state, t_end) if switch is None else switch.run(machine, state, t_end)


def _moving(n: int, a: int, lanes: int) -> Moving:
    """Memory of a run, nothing having happened before."""
    return Moving(
        np.zeros(a), np.zeros((n, lanes)), np.zeros(a), np.zeros((n, lanes)), np.zeros(lanes), np.zeros(lanes),
        np.zeros(lanes), np.full(REMEMBERED, -np.inf), np.zeros((REMEMBERED, lanes)),
    )  # fmt: skip
