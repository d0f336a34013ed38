"""Periodic steady state by shooting: Newton's method on the map from one section to the next.

The monodromy matrix comes from the propagated exponentials, with a saltation at every event, so that the cost does not
depend on how slowly the smoothing capacitor charges. A system that mirrors itself every half period is solved on the
half period: this halves the work, removes what the period conserves (a floating charge, an operator that never slips)
and picks the symmetric, demagnetised solution. Source of the method: Aprille & Trick, Proc. IEEE 60(1), 108-114, 1972;
saltation: Leine & Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, 2004.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from piezoharvest.engine import state as st
from piezoharvest.engine.events import DONE
from piezoharvest.engine.program import Program
from piezoharvest.engine.transient import Machine

# Sections run through from rest before Newton's method is tried (again): it needs a state with the right events.
WARM_UP = (2, 6, 32, 160, 800)
ITERATIONS = 24
TOLERANCE = 1e-12  # aimed at
ACCEPTED = 1e-9  # good enough where rounding allows no more
STABLE = 1 + 1e-6
# A motion from rest is compared with the orbit every so many periods, so many times at most; coming closer so many
# times in a row is enough.
CHECKED, PATIENCE, CLOSER = 100, 15, 5
LOG = 4096  # events of a span that are kept


@dataclass(frozen=True)
class Section:
    """The hybrid state at a section; times relative to it."""

    z: np.ndarray
    slip: np.ndarray
    configuration: int
    direction: int
    opens: float | None
    waiting: tuple[float, ...]
    polarity: tuple[int, ...]
    acted: float

    @property
    def vector(self) -> np.ndarray:
        """What varies continuously: states, then the times of waiting actions and of the opening."""
        return np.concatenate([self.z, self.waiting, [] if self.opens is None else [self.opens]])

    def moved(self, vector: np.ndarray, program: Program) -> Section:
        """Same discrete state with other continuous values, as far as these allow.

        Slipping stops stay on their limits; the direction of motion follows the velocity, or an extremum that is none
        would be seen at the section.
        """
        n, w = len(self.z), len(self.waiting)
        z, stops, limits = vector[:n].copy(), program.stop_state, program.stop_limit
        z[stops] = np.where(self.slip != 0, self.slip * limits, np.clip(z[stops], -limits, limits))
        velocity = program.trigger_row[:n] @ z
        return replace(
            self,
            z=z,
            direction=self.direction if velocity == 0 else int(np.sign(velocity)),
            waiting=tuple(np.maximum(vector[n : n + w], 0.0)),
            opens=None if self.opens is None else max(vector[-1], 0.0),
        )

    def alike(self, other: Section) -> bool:
        """Whether two sections have the same continuous variables."""
        return len(self.waiting) == len(other.waiting) and (self.opens is None) == (other.opens is None)


@dataclass
class Orbit:
    """Outcome of the search.

    Attributes
    ----------
    section : Section
        State at `time`.
    residual : float
        Change of the state over the span, relative, in the energy norm.
    radius : float
        Spectral radius of the monodromy matrix of the span: below 1 the orbit attracts.
    evaluations : float
        Periods simulated.
    """

    section: Section
    time: float
    residual: float
    radius: float
    evaluations: float

    @property
    def converged(self) -> bool:
        """Whether the state repeats and the orbit attracts."""
        return self.residual <= ACCEPTED and self.radius <= STABLE


class Shooting:
    """The map of a machine over a span of time, mirrored or not.

    Parameters
    ----------
    machine : Machine
    period : float
        Period of the excitation, s.
    mirrored : bool
        Whether half a period is run and the result mirrored.
    rest : float
        Static value of the excitation.
    """

    def __init__(self, machine: Machine, period: float, mirrored: bool, rest: float):
        program = machine.lowered.program
        self.machine, self.period, self.rest = machine, period, rest
        self.mirrored = mirrored
        self.span = 0.5 * period if mirrored else period
        self.odd, self.mirror = program.odd, program.mirror
        self.n = len(machine.lowered.states)
        self.evaluations = 0.0

    def find(self, start: tuple[Section, float] | None = None) -> Orbit:
        """Search from rest, or from a section and its time: a few periods, then Newton's method, again if it fails."""
        state = self.machine.state(self.rest, log=LOG) if start is None else self.load(*start, sensitivities=0, log=LOG)
        begin, spans = state.clock[st.NOW], 0
        best = Orbit(self._save(state, begin)[0], begin, np.inf, np.inf, 0.0)
        for count in WARM_UP:
            self._run(state, begin + (spans + count - 1) * self.span)
            state.discrete[st.LOGGED] = 0
            spans += count
            self._run(state, begin + spans * self.span)
            time = begin + spans * self.span + self._quiet(state, begin)
            self._run(state, time)
            orbit = self._newton(self._save(state, time)[0], time)
            if (orbit.converged, -orbit.residual) > (best.converged, -best.residual):
                best = orbit
            if orbit.converged:
                break
            spans += 1
            self._run(state, begin + spans * self.span)
        best.evaluations = self.evaluations
        return best

    def _run(self, state: st.State, t_end: float) -> None:
        self.evaluations += (t_end - state.clock[st.NOW]) / self.period
        status = self.machine.run(state, t_end)
        if status != DONE:
            raise EngineError(status)

    def _quiet(self, state: st.State, begin: float) -> float:
        """Middle of the longest time without event in the last span, s after its beginning: where the map is smooth."""
        count = min(int(state.discrete[st.LOGGED]), len(state.log_time))
        if count == 0:
            return 0.0
        times = np.unique(np.mod(state.log_time[:count] - begin, self.span))
        gaps = np.diff(times, append=times[0] + self.span)
        k = int(np.argmax(gaps))
        return float(np.mod(times[k] + 0.5 * gaps[k], self.span))

    def from_rest(self, orbit: Orbit, charged: bool = True) -> tuple[bool, Section, float]:
        """Whether a motion from rest goes to an orbit, and where it is, at what time, when that is decided.

        A `charged` smoothing capacitor begins with the orbit's voltage: its slow charging is not waited for. A motion
        that comes closer time after time is taken to arrive; others may wander for long before they do.
        """
        state = self.machine.state(self.rest)
        if charged:
            state.z[: self.n] = np.where(self.odd < 0, state.z[: self.n], orbit.section.z)
        size, time = np.linalg.norm(orbit.section.z), np.mod(orbit.time, self.period)
        here, distances = orbit.section, [np.inf]
        for _ in range(PATIENCE):
            time += CHECKED * self.period
            self._run(state, time)
            here = self._save(state, time, plain=True)[0]
            distances.append(float(np.linalg.norm(here.z - orbit.section.z)))
            closer = len(distances) > CLOSER and np.all(np.diff(distances[-CLOSER:]) < 0)
            if distances[-1] <= 0.02 * size or closer:
                return True, here, time
        return False, here, time

    def repeats(self, orbit: Orbit, state: st.State) -> bool:
        """Whether a state that a period led to is the orbit's section again: the proof of the search."""
        change = np.linalg.norm(state.z[: self.n] - orbit.section.z)
        return bool(change <= 1e3 * ACCEPTED * np.linalg.norm(orbit.section.z))

    def near(self, orbit: Orbit, section: Section, time: float) -> bool:
        """Whether an orbit passes close by a section that belongs to `time`."""
        state = self.load(orbit.section, orbit.time, sensitivities=0)
        phase = np.mod(time - orbit.time, self.period)
        self._run(state, orbit.time + phase)
        there = state.z[: self.n]
        return bool(np.linalg.norm(there - section.z) <= 0.05 * np.linalg.norm(there))

    def _newton(self, start: Section, time: float) -> Orbit:
        """Newton's method with a line search; where it does not help, the map itself is followed."""
        end, jacobian = self._map(start, time)
        residual, program = self._distance(start, end), self.machine.lowered.program
        best = Orbit(start, time, residual, _radius(jacobian), 0.0)
        for _ in range(ITERATIONS):
            if not start.alike(end):
                start = end
                end, jacobian = self._map(start, time)
                residual = self._distance(start, end)
                continue
            step = _solve_conserving(np.eye(len(jacobian)) - jacobian, end.vector - start.vector)
            before = residual
            trials = (end.moved(start.vector + damping * step, program) for damping in (1.0, 0.5, 0.25))
            for trial in (*trials, end):
                try:
                    trial_end, trial_jacobian = self._map(trial, time)
                except EngineError:
                    # Newton's method may propose what no motion leads to, a negative dc voltage for one.
                    continue
                distance = self._distance(trial, trial_end)
                if distance < before or trial is end:
                    start, end, jacobian, residual = trial, trial_end, trial_jacobian, distance
                    break
            else:
                return best
            improved = residual < 0.5 * before
            if residual < best.residual:
                best = Orbit(start, time, residual, _radius(jacobian), 0.0)
            if best.residual <= TOLERANCE or (best.residual <= ACCEPTED and not improved):
                break
        return best

    def _distance(self, start: Section, end: Section) -> float:
        """Relative change over the span; infinite where the discrete state changed its kind."""
        if not start.alike(end):
            return np.inf
        with np.errstate(over="ignore", invalid="ignore"):
            change = self._change(start.z, end.z)
        if not np.isfinite(change):
            return np.inf
        timing = np.abs(end.vector[self.n :] - start.vector[self.n :]) / self.span
        # The last action counts for as long as it may hold the next one off.
        held = max(start.acted, end.acted) > -self.machine.lowered.program.hold_off
        blocked = abs(end.acted - start.acted) / self.span if held else 0.0
        return float(max(change, blocked, np.max(timing, initial=0.0)))

    def _change(self, start: np.ndarray, end: np.ndarray) -> float:
        """Relative change of the mechanical states and of the electrical ones, the larger of the two.

        Taken together, a weakly coupled circuit would hide behind the vibration.
        """
        whole = max(float(np.linalg.norm(start)), float(np.linalg.norm(end)), 1e-300)
        first = self.machine.lowered.program.charge
        parts = ((start[:first], end[:first]), (start[first:], end[first:]))
        sizes = (max(float(np.linalg.norm(a)), float(np.linalg.norm(b)), 1e-12 * whole) for a, b in parts)
        return max(float(np.linalg.norm(b - a)) / size for (a, b), size in zip(parts, sizes, strict=True))

    def _map(self, start: Section, time: float) -> tuple[Section, np.ndarray]:
        state = self.load(start, time)
        self._run(state, time + self.span)
        return self._save(state, time + self.span, len(start.vector))

    def load(self, section: Section, time: float, **recorded) -> st.State:
        """State that continues from a section at `time`, carrying its sensitivities to the section's variables."""
        recorded.setdefault("sensitivities", len(section.vector))
        state = self.machine.state(**recorded)
        columns, n, w = recorded["sensitivities"], self.n, len(section.waiting)
        state.z[:n] = section.z
        state.slip[:] = section.slip
        state.discrete[st.CONFIGURATION] = section.configuration
        state.discrete[st.DIRECTION] = section.direction
        state.discrete[st.WAITING] = w
        state.discrete[st.CLOSED] = section.opens is not None
        state.discrete[st.COLUMNS] = columns
        state.clock[:] = time, np.inf if section.opens is None else time + section.opens, time + section.acted
        state.queue[:w] = time + np.array(section.waiting)
        state.queue_polarity[:w] = section.polarity
        if columns:
            state.phi[:n, :n] = np.eye(n)
            state.queue_phi[:w, n : n + w] = np.eye(w)
            if section.opens is not None:
                state.opens_phi[-1] = 1.0
        return state

    def _save(self, state: st.State, time: float, columns: int = 0, plain: bool = False) -> tuple[Section, np.ndarray]:
        """Section reached at `time`, mirrored where the span is half a period unless `plain`, and its derivative."""
        n, w = self.n, int(state.discrete[st.WAITING])
        closed = bool(state.discrete[st.CLOSED])
        mirrored = self.mirrored and not plain
        sign = -1 if mirrored else 1
        parity = self.odd if mirrored else np.ones(n)
        configuration = int(state.discrete[st.CONFIGURATION])
        section = Section(
            z=parity * state.z[:n],
            slip=sign * state.slip,
            configuration=int(self.mirror[configuration]) if mirrored else configuration,
            direction=sign * int(state.discrete[st.DIRECTION]),
            opens=state.clock[st.OPENS] - time if closed else None,
            waiting=tuple(state.queue[:w] - time),
            polarity=tuple(sign * state.queue_polarity[:w]),
            acted=state.clock[st.ACTED] - time,
        )
        if columns == 0:
            return section, np.zeros((0, 0))
        rows = [parity[:, None] * state.phi[:columns, :n].T, state.queue_phi[:w, :columns]]
        if closed:
            rows.append(state.opens_phi[None, :columns])
        return section, np.concatenate(rows)


class EngineError(ArithmeticError):
    """The simulation cannot go on: the model chatters, or its state overflows."""

    def __init__(self, status: int):
        reasons = {2: "events follow each other without time passing", 3: "the state grows without bound"}
        super().__init__(reasons.get(status, f"status {status}"))


def _radius(jacobian: np.ndarray) -> float:
    """Spectral radius of a monodromy matrix."""
    if jacobian.shape[0] != jacobian.shape[1]:
        return np.inf
    return float(np.max(np.abs(np.linalg.eigvals(jacobian)), initial=0.0))


def _solve_conserving(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve matrix x = right with c'x = 0 for every left null vector c: what the map conserves, Newton leaves alone."""
    left, size, _ = np.linalg.svd(matrix)
    null = left[:, size < 1e-10 * max(size[0], 1.0)]
    return np.linalg.solve(matrix + null @ null.T, right)
