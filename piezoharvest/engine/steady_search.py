"""Periodic steady state by shooting: Newton's method on the map from one section to the next.

The monodromy matrix comes from the propagated exponentials, with a saltation at every event, so that the cost does not
depend on how slowly the smoothing capacitor charges. A system that mirrors itself every half period is solved on the
half period: this halves the work, removes quantities that the period conserves (a floating charge, an operator that
never slips) and selects the symmetric, demagnetised solution. Source of the method: Aprille & Trick, Proc. IEEE 60(1),
108-114, 1972; saltation: Leine & Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, 2004.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory.state import QUEUE_LENGTH, EngineState
from piezoharvest.engine.propagation.advance import DONE
from piezoharvest.engine.run import Machine
from piezoharvest.engine.steady_state import section as sc
from piezoharvest.engine.steady_state import shooting as sh

# A motion from rest is compared with the orbit every PERIODS_BETWEEN_CHECKS, MAX_CHECKS times at most; coming closer
# MIN_APPROACHES times in a row is enough, each time by the share APPROACH: a motion that stays away from the orbit
# comes closer by chance, by rounding.
PERIODS_BETWEEN_CHECKS, MAX_CHECKS, MIN_APPROACHES, APPROACH = 100, 15, 5, 1e-9
LOG_LENGTH = 4096  # events of a span that are recorded


@dataclass
class Orbit:
    """Outcome of the search.

    Attributes
    ----------
    numbers, integers : (n + 6,) and (h + 8,) array
        The section at `time`, as in `shooting`.
    residual : float
        Change of the state over the span, relative, in the energy norm.
    radius : float
        Spectral radius of the monodromy matrix of the span: below 1 the orbit attracts.
    evaluations : float
        Periods simulated.
    """

    numbers: np.ndarray
    integers: np.ndarray
    time: float
    residual: float
    radius: float
    evaluations: float

    @property
    def converged(self) -> bool:
        """True if the state repeats and the orbit attracts."""
        return self.residual <= sh.ACCEPTED and self.radius <= sh.MAX_RADIUS


class Shooting:
    """The map of a machine over a span of time, mirrored or not.

    Parameters
    ----------
    machine : Machine
    period : float
        Period of the excitation, s.
    mirrored : bool
        Run half a period and mirror the result.
    """

    def __init__(self, machine: Machine, period: float, mirrored: bool):
        self.machine, self.period, self.mirrored = machine, period, mirrored
        self.n = int(machine.L[pg.N])

    def find(self, start: EngineState | None = None) -> Orbit:
        """Search from rest, or from a state: a few periods, then Newton's method, repeated if it fails.

        Raises
        ------
        EngineError
            The motion from there cannot be simulated.
        """
        machine, n = self.machine, self.n
        warm = machine.state(log=LOG_LENGTH)
        if start is not None:
            warm.follow(start)
        moved = machine.state(sensitivities=n + QUEUE_LENGTH + 1)
        numbers, integers = sc.room(machine.L)
        W, V = np.zeros(numbers), np.zeros(integers, np.int64)
        W[sc.PERIOD], W[sc.SPAN] = self.period, 0.5 * self.period if self.mirrored else self.period
        check(machine.search(moved, warm, (W, V), self.mirrored))
        x, y = n + QUEUE_LENGTH + 2, sc.Y_SLIP + int(machine.L[pg.H]) + QUEUE_LENGTH
        section = W[sc.HEAD + sc.BEST * x :][:x].copy(), V[sc.BEST * y :][:y].copy()
        return Orbit(*section, *(float(W[k]) for k in (sc.TIME, sc.RESIDUAL, sc.RADIUS, sc.EVALUATIONS)))

    def load(self, orbit: Orbit, **recorded) -> EngineState:
        """State on an orbit at its time; `recorded` as in `EngineState`."""
        state, n, h = self.machine.state(**recorded), self.n, int(self.machine.L[pg.H])
        x, y = orbit.numbers, orbit.integers
        waiting, closed = int(y[sc.Y_WAITING]), bool(y[sc.Y_CLOSED])
        state.z[:n] = x[:n]
        for place, value in (
            (st.CONFIGURATION, y[sc.Y_CONFIGURATION]), (st.DIRECTION, y[sc.Y_DIRECTION]),
            (st.WAITING, waiting), (st.CLOSED, closed),
        ):  # fmt: skip
            state.D[place] = value
        state[st.SLIP][:] = y[sc.Y_SLIP : sc.Y_SLIP + h]
        state[st.POLARITY][:waiting] = y[sc.Y_SLIP + h :][:waiting]
        state[st.QUEUE][:waiting] = orbit.time + x[n : n + waiting]
        opens = orbit.time + x[n + QUEUE_LENGTH] if closed else np.inf
        state.clock[:] = orbit.time, opens, orbit.time + x[n + QUEUE_LENGTH + 1]
        return state

    def from_rest(self, orbit: Orbit, charged: bool = True) -> tuple[bool, EngineState]:
        """Return True if a motion from rest converges to an orbit, and its state when that is decided.

        A `charged` smoothing capacitor begins with the orbit's voltage, so that its slow charging is not simulated. A
        motion that comes closer several times in a row is taken to converge; others may take long before they do.
        """
        state, there = self.machine.state(), orbit.numbers[: self.n]
        if charged:
            lowered = self.machine.lowered
            # Of an envelope the configuration tells whether it is charged, which is that of rest here.
            begins = (lowered.program.odd < 0) | [name.startswith("envelope_") for name in lowered.states]
            state.z[: self.n] = np.where(begins, state.z[: self.n], there)
        size, time, distances = np.linalg.norm(there), np.mod(orbit.time, self.period), [np.inf]
        for _ in range(MAX_CHECKS):
            time += PERIODS_BETWEEN_CHECKS * self.period
            check(self.machine.run(state, time))
            distances.append(float(np.linalg.norm(state.z[: self.n] - there)))
            last = np.array(distances[-MIN_APPROACHES:])
            closer = len(distances) > MIN_APPROACHES and np.all(last[1:] < (1 - APPROACH) * last[:-1])
            if distances[-1] <= 0.02 * size or closer:
                return True, state
        return False, state

    def repeats(self, orbit: Orbit, state: EngineState) -> bool:
        """True if a state after one period is the orbit's section again, which verifies the search."""
        there = orbit.numbers[: self.n]
        return bool(np.linalg.norm(state.z[: self.n] - there) <= sh.MAX_CHANGE * np.linalg.norm(there))

    def near(self, orbit: Orbit, state: EngineState) -> bool:
        """True if an orbit passes close by a state."""
        on_orbit = self.load(orbit)
        phase = np.mod(state.clock[st.NOW] - orbit.time, self.period)
        check(self.machine.run(on_orbit, orbit.time + phase))
        there = on_orbit.z[: self.n]
        return bool(np.linalg.norm(there - state.z[: self.n]) <= 0.05 * np.linalg.norm(there))


class EngineError(ArithmeticError):
    """The simulation cannot continue: chatter, overflow, no solution, or too much to compute or to remember."""


def check(status: int) -> None:
    """Raise an error unless the engine's status is that of a finished run.

    Raises
    ------
    EngineError
        The model chatters, its state overflows, its equations have no solution, there is too much to compute, or too
        many actions of the switch wait.
    """
    if status != DONE:
        reasons = {
            1: "events follow each other without time passing",
            2: "the state grows without bound, or has no solution",
            3: "stopped at the limit of units of work for a simulation: it has too many events or is too long",
            4: f"more than {QUEUE_LENGTH} actions of the switch are pending at the same time: its lag is too long for "
            "a displacement with so many extrema",
        }
        raise EngineError(reasons[status])


def solve_conserving(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve matrix x = right with c'x = 0 for every left null vector c, so that conserved quantities do not change."""
    left, size, _ = np.linalg.svd(matrix)
    null = left[:, size < 1e-10 * max(size[0], 1.0)]
    return np.linalg.solve(matrix + null @ null.T, right - null @ (null.T @ right))
