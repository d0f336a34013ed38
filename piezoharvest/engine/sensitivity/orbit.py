"""A periodic orbit as a sequence of motions between events."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from piezoharvest.engine.lowering.lower import Lowered
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory.state import EngineState
from piezoharvest.engine.run import Machine
from piezoharvest.engine.steady_search import Orbit, Shooting, check

MAX_MOTIONS = 4096  # most motions of a span


@dataclass(frozen=True)
class Motion:
    """One motion within a mode.

    Attributes
    ----------
    start : (a,) array
        Initial augmented state.
    begins, ends : float
        s.
    configuration : int
    slip : (h,) int array
    what : int
        Reason for its end: a guard, or `trajectory.OPENS`, `ACTS` or `NOTHING`.
    scheduled : bool
        An action of the switch, or its opening, is due after it.
    """

    start: np.ndarray
    begins: float
    ends: float
    configuration: int
    slip: np.ndarray
    what: int
    scheduled: bool

    @property
    def length(self) -> float:
        """Duration, s."""
        return self.ends - self.begins


@dataclass(frozen=True)
class Tape:
    """Motions of a span (half a period if the orbit has half-wave symmetry) and the final state.

    The span begins when no action of the switch is scheduled and the switch is open.
    """

    motions: tuple[Motion, ...]
    end: np.ndarray
    mirrored: bool
    lowered: Lowered


def record_span(lowered: Lowered, orbit: Orbit, mirrored: bool) -> Tape:
    """Record one span of an orbit."""
    period = float(lowered.program.period)
    machine = Machine(lowered)
    shooting = Shooting(machine, period, mirrored)
    span = 0.5 * period if mirrored else period
    state, _ = unscheduled_state(shooting, orbit, span)
    recorder = machine.state(tape=MAX_MOTIONS)
    recorder.follow(state)
    motions, end = _record(machine, recorder, float(state.clock[st.NOW]) + span)
    return Tape(motions, end, mirrored, lowered)


def unscheduled_state(shooting: Shooting, orbit: Orbit, span: float) -> tuple[EngineState, bool]:
    """State on an orbit at which the switch is open and no action of it is scheduled, and True if there is one.

    Parameters
    ----------
    shooting : Shooting
    orbit : Orbit
    span : float
        Time (s) after its own in which it is looked for.
    """
    machine = shooting.machine
    motions, _ = record_motions(machine, shooting, orbit, span)
    state = shooting.load(orbit)
    check(machine.run(state, _unscheduled_time(orbit, motions)))
    return state, not all(motion.scheduled for motion in motions)


def record_motions(
    machine: Machine, shooting: Shooting, orbit: Orbit, span: float
) -> tuple[tuple[Motion, ...], np.ndarray]:
    """Motions of an orbit over a span (s) after its own time, and the state at its end."""
    return _record(machine, shooting.load(orbit, tape=MAX_MOTIONS), orbit.time + span)


def _unscheduled_time(orbit: Orbit, motions: tuple[Motion, ...]) -> float:
    """Middle of the longest motion that begins with nothing scheduled, s; the orbit's time if there is none."""
    idle = [motion for motion in motions if not motion.scheduled]
    if not idle:
        return orbit.time
    longest = max(idle, key=lambda motion: motion.length)
    return 0.5 * (longest.begins + longest.ends)


def _record(machine: Machine, state: EngineState, t_end: float) -> tuple[tuple[Motion, ...], np.ndarray]:
    check(machine.run(state, t_end))
    a, h = int(machine.L[pg.A]), int(machine.L[pg.H])
    count = int(state.D[st.TAPED])
    numbers, kinds = state[st.TAPE].reshape(-1, 2 + a)[:count], state[st.TAPE_KIND].reshape(-1, 3 + h)[:count]
    motions = tuple(
        Motion(row[2:].copy(), row[0], row[1], int(kind[0]), kind[3:].copy(), int(kind[1]), bool(kind[2]))
        for row, kind in zip(numbers, kinds, strict=True)
    )
    return motions, state.z.copy()
