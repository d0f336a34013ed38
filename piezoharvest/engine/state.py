"""What moves while the engine runs: state, clocks, sensitivities, energies and the log, in preallocated arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from piezoharvest.engine import program as pg

QUEUE = 4  # actions of the switch that may be waiting at one time

# Places in `State.discrete`.
CONFIGURATION, DIRECTION, WAITING, CLOSED, LOGGED, SAMPLED, STEPS = range(7)
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
    phi: np.ndarray  # (a, s) derivative of z
    queue_phi: np.ndarray  # (q, s) derivative of the waiting actions' times
    opens_phi: np.ndarray  # (s,) derivative of the time at which the switch opens
    event_phi: np.ndarray  # (s,) derivative of the last event's time
    energy: np.ndarray  # (e,) J; without entries where no ledger is kept
    extremes: np.ndarray  # (2, 2): minimum and maximum of displacement and voltage; empty where not tracked
    log_time: np.ndarray
    log_code: np.ndarray
    sample_time: np.ndarray
    samples: np.ndarray  # (times, outputs)
    work: np.ndarray  # (8, a) scratch
    guard_now: np.ndarray  # (g, 3) scratch
    guard_next: np.ndarray  # (g, 3)


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
    n, a = program.mass.shape[-1], program.rate.shape[-1]
    guards = program.guard_target.shape[1] + 1 + 2 * len(program.stop_state)
    times = np.zeros(0) if sample_time is None else np.ascontiguousarray(sample_time, float)
    state = State(
        z=np.zeros(a),
        discrete=np.zeros(7, np.int64),
        clock=np.array([0.0, np.inf, -np.inf]),
        slip=np.zeros(len(program.stop_state), np.int64),
        queue=np.zeros(QUEUE),
        queue_polarity=np.zeros(QUEUE, np.int64),
        phi=np.zeros((a, sensitivities)),
        queue_phi=np.zeros((QUEUE, sensitivities)),
        opens_phi=np.zeros(sensitivities),
        event_phi=np.zeros(sensitivities),
        energy=np.zeros(program.categories if ledger else 0),
        extremes=np.array([[np.inf, -np.inf]] * 2) if track else np.zeros((0, 2)),
        log_time=np.empty(log),
        log_code=np.empty(log, np.int64),
        sample_time=times,
        samples=np.empty((len(times), len(pg.OUTPUTS))),
        work=np.empty((8, a)),
        guard_now=np.empty((guards, 3)),
        guard_next=np.empty((guards, 3)),
    )
    state.discrete[DIRECTION] = 1
    return state


@njit(cache=True)
def set_tones(P, S, t):
    """Exogenous states of a sum of tones, from the phase itself so that nothing drifts."""
    n = P.mass.shape[2]
    for k in range(len(P.omega)):
        angle = P.omega[k] * t + P.phase[k]
        S.z[n + 2 * k] = np.sin(angle) / P.exo_scale[2 * k]
        S.z[n + 2 * k + 1] = np.cos(angle) / P.exo_scale[2 * k + 1]
    S.z[-1] = 1.0 / P.exo_scale[-1]


@njit(cache=True)
def set_ramp(P, S, value, slope):
    """Exogenous states of a straight piece of signal."""
    n = P.mass.shape[2]
    S.z[n] = value / P.exo_scale[0]
    S.z[n + 1] = slope / P.exo_scale[1]
    S.z[-1] = 1.0 / P.exo_scale[-1]
