"""One Radau step of a model: a matrix product if its equations are linear, an iteration otherwise."""

from __future__ import annotations

import numpy as np

from piezoharvest.bench.solver.model import Model
from piezoharvest.bench.solver.radau import NODES, Line, Step, make_step, nonlinear_error

# Change at which the iteration of nonlinear equations ends, relative to the size of each state.
ITERATION_TOLERANCE = 1e-10
MAX_ITERATIONS = 12
# Iterations after which the linearisation is recomputed.
MANY_ITERATIONS = 4
MAX_TABLES = 256

_STAGES = np.append(0.0, NODES)
# Coefficients of the parabola through values at the stages.
_PARABOLA = np.linalg.inv(np.vander(NODES)).T
Trial = tuple[np.ndarray, np.ndarray, np.ndarray]


class Stepper:
    """Steps of a model on its present branches.

    Parameters
    ----------
    model : Model
    sizes : (states,) array
        Size of each state, below which errors do not count; may be changed in place.
    reach : (states,) array
        Changes of the states that tell linear equations: of the size of the motion, since beside a constant term a
        small one is lost in rounding.
    unit : float
        Tolerance in s within which two steps are equally long.
    """

    def __init__(self, model: Model, sizes: np.ndarray, reach: np.ndarray, unit: float) -> None:
        self.model, self.sizes, self.reach, self.unit = model, sizes, reach, unit
        self.scale, self.n = model.scale, len(sizes)
        self.tables: dict[tuple, Step] = {}
        self.lines: dict[tuple, Line] = {}
        self.stale = False
        # For nonlinear equations: excess and length of the last accepted and of the last tried step.
        self.behind = self.tried = None
        self.ratio = 0.1

    def enter(self, t: float, drive: float, y: np.ndarray) -> None:
        """Adopt new branches of the model, without slack on its guards."""
        switch = self.model.circuit.switch  # its guards depend on the direction of the motion
        sides = (branch if isinstance(branch, int) else branch[0] for branch in self.model.branches)
        self.key = (*sides, switch.side if switch else 0)
        self.slack = np.zeros(0)
        if self.key in self.lines:
            self._adopt(self.lines[self.key], t)
            return
        self.linearise(t, drive, y)
        if not self.model.smooth and not self.model.all_stops:  # stops turn at other places each time
            self.lines[self.key] = self.line

    def allow(self, slack: np.ndarray) -> None:
        """Count guards as crossed only above these values."""
        self.slack = slack
        self.known[2 * self.n + 4 :] = self.line.c[self.n :] - slack

    def linearise(self, t: float, drive: float, y: np.ndarray) -> None:
        """Compute the matrices of rates and guards: exact for linear equations, else a tangent."""
        n, smooth = self.n, self.model.smooth
        origin, level, steps = (y, drive, 1e-5 * self.sizes) if smooth else (0.0 * y, 0.0, self.reach)
        columns = np.tile(origin[:, None], n + 2)
        columns[:, :n] += np.diag(steps)
        drives = np.full(n + 2, level)
        drives[n] += 1.0
        values = self.model.values(np.full(n + 2, t), drives, columns)
        voltages = self.model.circuit.voltage + np.zeros(n + 2)
        slopes = values[:, : n + 1] - values[:, n + 1 :]
        J, b = slopes[:, :n] / steps, slopes[:, n]
        voltage = (voltages[:n] - voltages[n + 1]) / steps
        voltage = np.append(voltage, voltages[n + 1] - voltage @ origin)
        self._adopt(Line(J, b, values[:, n + 1] - J @ origin - b * level, voltage), t)
        if smooth:
            self.tables.clear()
        if len(self.slack):
            self.allow(self.slack)

    def _adopt(self, line: Line, t: float) -> None:
        self.line, self.known = line, np.concatenate([np.zeros(self.n + 4), line.c])
        self.linearised_at, self.stale, self.behind = t, False, None

    def guards(self, t: float, drive: float, y: np.ndarray) -> np.ndarray:
        """Guards at one instant, less the slack."""
        values = self.model.values(np.array([t]), np.array([drive]), y[:, None])
        return values[self.n :, 0] - self.slack

    def step(self, t: float, h: float, y: np.ndarray, drives: np.ndarray, *, keep: bool) -> Trial:
        """Try a step of length `h` from `y` at `t`.

        Parameters
        ----------
        drives : (4,) array
            Drive at the start and at the stages.
        keep : bool
            Steps of this length are likely to be repeated.

        Returns
        -------
        stages : (3, states) array
            The last one is the end of the step.
        error : (states,) array
            Estimated, in the unit of each state; not finite where the iteration failed.
        guards : (3, guards) array
            At the stages, less the slack.
        """
        n, table = self.n, self._table(h, keep)
        self.known[:n], self.known[n : n + 4] = y, drives
        out = table.advance @ self.known
        stages, error, guards = out[: 3 * n].reshape(3, n), out[3 * n : 4 * n], out[4 * n :].reshape(3, -1)
        if not self.model.smooth:
            return stages, error, guards
        return self._iterate(table, t, h, y, drives, stages)

    def _table(self, h: float, keep: bool) -> Step:
        key = (self.key, round(h / self.unit))
        table = self.tables.get(key)
        if table is None:
            table = make_step(self.line, h, self.scale)
            if keep:
                if len(self.tables) >= MAX_TABLES:
                    self.tables.clear()
                self.tables[key] = table
        return table

    def accept(self) -> None:
        """Accept the last step: the next one extrapolates its excess."""
        self.behind = self.tried

    def _iterate(self, table: Step, t: float, h: float, y: np.ndarray, drives: np.ndarray, linear: np.ndarray) -> Trial:
        """Iterate on the excess of the equations over their linearisation, predicted from the previous step."""
        n, (J, b, c, _) = self.n, self.line
        times, known = t + h * _STAGES, b[:n, None] * drives[1:] + c[:n, None]
        stages = linear.T + (table.correct @ self._foreseen(h).T.ravel()).reshape(3, n).T
        columns, size = np.empty((n, 4)), self.sizes[:, None]
        columns[:, 0] = y
        change = before = rest = np.inf
        count = 0
        while rest > ITERATION_TOLERANCE and count < MAX_ITERATIONS:
            columns[:, 1:] = stages
            values = self.model.values(times, drives, columns)
            excess = values[:n, 1:] - J[:n] @ stages - known
            stages = linear.T + (table.correct @ excess.T.ravel()).reshape(3, n).T
            before, change, count = change, float((np.abs(stages - columns[:, 1:]) / size).max()), count + 1
            # Changes shrink by a ratio that hardly differs between steps; the remainder is a geometric series.
            self.ratio = change / before if before < np.inf else self.ratio
            rest = change * self.ratio / (1.0 - self.ratio) if self.ratio < 1.0 else np.inf
        self.stale = count > MANY_ITERATIONS
        self.tried = excess, h
        error = nonlinear_error(table, h, values[:n, 0], y, stages.T)
        guards = values[n:, 1:] + J[n:] @ (stages - columns[:, 1:])
        return stages.T, error if rest <= ITERATION_TOLERANCE else error + np.inf, guards.T - self.slack

    def _foreseen(self, h: float) -> np.ndarray:
        """Excess at the stages of the next step, extrapolated by the parabola through those of the last one."""
        if self.behind is None:
            return np.zeros((self.n, 3))
        excess, length = self.behind
        s = 1.0 + h / length * NODES
        return excess @ (_PARABOLA @ np.array([s * s, s, np.ones(3)]))
