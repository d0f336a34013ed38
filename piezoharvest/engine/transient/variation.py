"""Sampled outputs of a run through a signal, with derivatives with respect to quantities and initial states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from piezoharvest.engine.lowering.lower import Lowered
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory.state import EngineState
from piezoharvest.engine.propagation.advance import DONE
from piezoharvest.engine.run import Machine
from piezoharvest.engine.sensitivity.dual_modes import dual, nominal
from piezoharvest.engine.steady_search import EngineError, check
from piezoharvest.engine.transient.along_tape import REMEMBERED, Motions, Moving, Switching, follow
from piezoharvest.engine.transient.mode_steps import mode_steps

MOTIONS_A_SAMPLE = 3  # room for motions, of which one ends at each sample, enlarged where it is too small


class Sampled(NamedTuple):
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
    lowered : Lowered
    times : (samples,) array
        s.
    start : EngineState
    outputs : sequence of str
        Wanted ones of `pg.OUTPUTS`.
    switch : TimedSwitch, optional
        In the place of that of the circuit.
    """

    def __init__(
        self, lowered: Lowered, times: np.ndarray, start: EngineState, outputs: Sequence[str],
        switch: TimedSwitch | None = None,
    ) -> None:  # fmt: skip
        self._machine, self._times, self._state, self._switch = _machine(lowered, switch), times, start, switch
        self._rows = [pg.OUTPUTS.index(name) for name in outputs]

    def through(self, begin: int, end: int) -> np.ndarray:
        """Outputs (samples, outputs) from one sample, at which the last block ended, to another one, both included.

        Raises
        ------
        EngineError
            The run cannot be simulated.
        """
        times = self._times[begin : end + 1]
        state = self._machine.state(sample_time=times)
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
    lowered : Lowered
        From complex steps of the quantities, under tones or a signal of straight pieces between the samples, without
        smooth elements.
    count : int
        Number of quantities.
    times : (samples,) array
        s, evenly spaced.
    start : EngineState
        State of the nominal system at the first sample.
    changes : (n, lanes) array
        Derivatives of its scaled states: with respect to the quantities, then to what it depends on.
    outputs : sequence of str
        Wanted ones of `pg.OUTPUTS`.
    switch : TimedSwitch, optional
        In the place of that of the circuit.
    """

    def __init__(
        self, lowered: Lowered, count: int, times: np.ndarray, start: EngineState, changes: np.ndarray,
        outputs: Sequence[str], switch: TimedSwitch | None = None,
    ) -> None:  # fmt: skip
        self._program, self._count, self._times = lowered.program, count, times
        self._rows = [pg.OUTPUTS.index(name) for name in outputs]
        self._machine = _machine(lowered._replace(program=nominal(lowered.program)), switch)
        self._state, self._switch = start, switch
        (n, lanes), a = changes.shape, lowered.program.rate.shape[-1]
        self._moving = _moving(n, a, lanes)
        self._moving.d[:] = changes
        self._switching = _switching(lowered.program, count)
        if switch is not None:
            self._switching = self._switching._replace(timed=1)
            self._moving = self._moving._replace(cause_time=switch.causes.copy(), cause=switch.changes.copy())

    @property
    def changes(self) -> np.ndarray:
        """Derivatives (n, lanes) of the scaled states at the end of the last block."""
        return self._moving.d

    def through(self, begin: int, end: int) -> Sampled:
        """Outputs from one sample, at which the last block ended, to another one, both included.

        Raises
        ------
        EngineError
            The run cannot be simulated.
        """
        times = self._times[begin : end + 1]
        motions, modes = self._motions(float(times[-1]), len(times))
        steps = mode_steps(self._program, self._count, modes, float(times[1] - times[0]), self._rows)
        values = np.empty((len(times), len(self._rows)))
        slopes = np.empty((*values.shape, len(self._moving.shift)))
        memory = np.empty_like(self._moving.z), np.empty_like(self._moving.d)
        written = follow(steps, self._switching, motions, self._moving, memory, times, values, slopes)
        if written < len(times) or not np.all(np.isfinite(values)):
            raise EngineError(f"no solution after {times[max(written - 1, 0)]:g} s")
        return Sampled(values, slopes)

    def _motions(self, t_end: float, samples: int) -> tuple[Motions, list[tuple[int, np.ndarray]]]:
        """Motions between the events up to a time, to which the run moves on, and their modes."""
        machine, room = self._machine, MOTIONS_A_SAMPLE * samples + 64
        while True:
            state = machine.state(tape=room)
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
        columns = (
            numbers[:, 0], numbers[:, 1], numbers[:, 2:], which.ravel().astype(np.int64), kinds[:, 0], kinds[:, 1],
            kinds[:, 3:],
        )  # fmt: skip
        return Motions(*map(np.ascontiguousarray, columns)), modes


def _machine(lowered: Lowered, switch: TimedSwitch | None) -> Machine:
    """Machine of a nominal system; with a timed switch no extremum lets it act."""
    if switch is not None:
        lowered = lowered._replace(program=lowered.program._replace(threshold=np.inf))
    return Machine(lowered)


def _run(machine: Machine, state: EngineState, t_end: float, switch: TimedSwitch | None) -> int:
    return machine.run(state, t_end) if switch is None else switch.run(machine, state, t_end)


def _moving(n: int, a: int, lanes: int) -> Moving:
    """Memory of a run, nothing having happened before."""
    return Moving(
        np.zeros(a), np.zeros((n, lanes)), np.zeros(a), np.zeros((n, lanes)), np.zeros(lanes), np.zeros(lanes),
        np.zeros(lanes), np.full(REMEMBERED, -np.inf), np.zeros((REMEMBERED, lanes)),
    )  # fmt: skip


def _switching(program: pg.Program, count: int) -> Switching:
    """Tables of the events."""

    def change(value: np.ndarray | float, rank: int) -> np.ndarray:
        """Derivatives with respect to the quantities, these as last axis."""
        found = dual(np.asarray(value), rank).change
        return np.ascontiguousarray(np.moveaxis(np.broadcast_to(found, (count, *found.shape[1:])), 0, -1))

    stops = np.asarray(program.stop_state, np.int64)
    return Switching(
        program.rate.shape[-2], program.guard_target.shape[1], int(program.switched), int(program.cut),
        int(program.charge), float(dual(np.asarray(program.lag), 0).value), 0,
        np.asarray(program.opened, np.int64),
        np.asarray(program.guard_cut, np.int64), stops, np.ascontiguousarray(dual(program.voltage_row, 1).value),
        change(program.lag, 0), change(program.on_time, 0), change(program.voltage_row, 1),
        change(program.stop_limit, 1),
    )  # fmt: skip
