"""What moves while the engine runs: state, clocks, sensitivities, energies and the log, in preallocated arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezoharvest.engine import program as pg
from piezoharvest.engine.compiled import compiled
from piezoharvest.engine.reference import reference

QUEUE = 4  # actions of the switch that may be waiting at one time

# Places in `State.discrete`. COLUMNS counts the sensitivities that are carried, BETWEEN marks an event half done.
CONFIGURATION, DIRECTION, WAITING, CLOSED, LOGGED, SAMPLED, COLUMNS, BETWEEN = range(8)
# Places in `State.clock`: now, when the switch opens, when it last acted.
NOW, OPENS, ACTED = range(3)


class State(NamedTuple):
    """The hybrid state and what is recorded of it; s sensitivities, q queued actions."""

    z: np.ndarray  # (a,) augmented state
    discrete: np.ndarray  # int64, see the places above
    clock: np.ndarray  # s, see the places above
    slip: np.ndarray  # (h,) int64: 0 sticks, +1 and -1 slip
    queue: np.ndarray  # (q,) times of waiting actions, s
    queue_polarity: np.ndarray  # (q,) int64
    phi: np.ndarray  # (s, a) derivative of z, a row for each parameter
    queue_phi: np.ndarray  # (q, s) derivative of the waiting actions' times
    opens_phi: np.ndarray  # (s,) derivative of the time at which the switch opens
    event_phi: np.ndarray  # (s,) derivative of the last event's time
    energy: np.ndarray  # (e,) J; without entries where no ledger is kept
    extremes: np.ndarray  # (2, 2): minimum and maximum of displacement and voltage; empty where not tracked
    log_time: np.ndarray
    log_code: np.ndarray
    sample_time: np.ndarray
    samples: np.ndarray  # (times, outputs)
    sign: np.ndarray  # (g,) sign with which each guard is read
    work: np.ndarray  # (9, a) scratch
    guard_now: np.ndarray  # (3 g,) scratch: value, rate, second rate of every guard
    guard_next: np.ndarray  # (3 g,)
    guard_floor: np.ndarray  # (g,) rounding of every guard


StateRef, StateType = reference(State)


@compiled
def point(state):
    """The state by pointer, for compiled code; its arrays are shared."""
    return StateRef(*state)


def rest(
    program: pg.Program,
    *,
    sensitivities: int = 0,
    ledger: bool = False,
    track: bool = False,
    log: int = 0,
    sample_time: np.ndarray | None = None,
) -> State:
    """State at rest at time zero, with room for what is to be recorded."""
    a = program.rate.shape[-1]
    guards = program.guard_target.shape[1] + 1 + 2 * len(program.stop_state) + pg.WATCHED
    times = np.zeros(0) if sample_time is None else np.ascontiguousarray(sample_time, float)
    state = State(
        z=np.zeros(a),
        discrete=np.zeros(8, np.int64),
        clock=np.array([0.0, np.inf, -np.inf]),
        slip=np.zeros(len(program.stop_state), np.int64),
        queue=np.zeros(QUEUE),
        queue_polarity=np.zeros(QUEUE, np.int64),
        phi=np.zeros((sensitivities, a)),
        queue_phi=np.zeros((QUEUE, sensitivities)),
        opens_phi=np.zeros(sensitivities),
        event_phi=np.zeros(sensitivities),
        energy=np.zeros(program.categories if ledger else 0),
        extremes=np.array([[np.inf, -np.inf]] * 2) if track else np.zeros((0, 2)),
        log_time=np.empty(log),
        log_code=np.empty(log, np.int64),
        sample_time=times,
        samples=np.empty((len(times), len(pg.OUTPUTS))),
        sign=np.ones(guards),
        work=np.empty((9, a)),
        guard_now=np.empty(3 * guards),
        guard_next=np.empty(3 * guards),
        guard_floor=np.empty(guards),
    )
    return state


@compiled
def orient(P, S):
    """Set the signs of the guards: the extremum's by the direction of motion, a slipping stop's by its side.

    The direction is 0 at rest, which is left without an extremum.
    """
    extremum = P.guard_target.shape[1]
    S.sign[extremum] = -S.discrete[DIRECTION]
    for j in range(len(S.slip)):
        S.sign[extremum + 1 + 2 * j] = 1.0 if S.slip[j] == 0 else S.slip[j]


@compiled
def set_tones(P, S, t):
    """Exogenous states of a sum of tones, from the phase itself so that nothing drifts."""
    n = P.rate.shape[1]
    for k in range(len(P.omega)):
        angle = P.omega[k] * t + P.phase[k]
        S.z[n + 2 * k] = np.sin(angle) / P.exo_scale[2 * k]
        S.z[n + 2 * k + 1] = np.cos(angle) / P.exo_scale[2 * k + 1]
    S.z[-1] = 1.0 / P.exo_scale[-1]


@compiled
def set_ramp(P, S, value, slope):
    """Exogenous states of a straight piece of signal."""
    n = P.rate.shape[1]
    S.z[n] = value / P.exo_scale[0]
    S.z[n + 1] = slope / P.exo_scale[1]
    S.z[-1] = 1.0 / P.exo_scale[-1]
