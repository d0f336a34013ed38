"""Tuning of the switch's lag, and of the load with it: one lag for all of a band, and a schedule of lags over it.

Both begin at the best point of a coarse grid and go on by quadratic models through stencils of simulations. All of a
stencil, at all frequencies, is one batch in compiled code: a figure costs a tenth of what it costs alone, and a
gradient over a band more than the stencil does. At one frequency the gradient is cheap, and follows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.design.drafts import Draft
from piezoharvest.design.goal import DesignFigures, Goal
from piezoharvest.design.operation import mean_nodes
from piezoharvest.design.trial import Trial
from piezoharvest.design.tuning.minimax import Tuned
from piezoharvest.design.tuning.refine import refine
from piezoharvest.design.tuning.region import Region, values_at
from piezoharvest.design.tuning.starts import Start

# Factors of the load, and lags, of the coarse grid. A switch that acts at both extrema does the same with a lag of half
# a turn more, so that half a turn is all there is.
_LOADS, _LAGS = np.geomspace(1 / 16, 16, 9), np.linspace(-np.pi / 2, np.pi / 2, 8, endpoint=False)
_COARSE_ERROR, _COARSE_NODES = 0.03, 9  # of the mean over the band on the coarse grid, and frequencies at most
_LEVEL_POINTS = 17  # frequencies over the band at which displacement and voltage are looked at
# Of the stencils: rounds at most, and steps relative to the first. Within the last the merit is a parabola to 1e-5.
_ROUNDS, _SHRINK, _LAST_STEP = 16, 0.4, 0.05


class Schedule(NamedTuple):
    """Lag, and load, for each frequency of a band.

    Attributes
    ----------
    table : tuple of dict
        `frequency` in Hz, the fields tuned there, and `harvested_power` in W.
    power : float
        Mean over the band, W.
    """

    table: tuple[dict[str, float], ...]
    power: float


@dataclass(frozen=True, eq=False)
class PhaseTuning:
    """Tuning of a draft whose lag is free.

    Attributes
    ----------
    trial : Trial
    draft : Draft
    start : Start
        Values of the free fields about which the coarse grid lies.
    region : Region
    """

    trial: Trial
    draft: Draft
    start: Start
    region: Region

    def fixed(self) -> Tuned:
        """The draft with the one lag and load that are best over the band, or at the one frequency."""
        trial, before = self.trial, self.trial.simulations
        band = trial.view.operation.band
        points, values = self._coarse
        frequencies, weights = self._judged(*trial.nodes)
        first = points[np.argmin(self._merits(values, self._judged(*self._coarse_nodes)[1]))]

        def merits(p: np.ndarray, _: np.ndarray) -> np.ndarray:
            return self._merits(self._simulate(p, np.tile(frequencies, (len(p), 1))), weights)

        if band is None:
            found = refine(trial, self.draft, self._start_at(first), self.region)
            return found._replace(iterations=trial.simulations - before)
        p, merit = zoom(merits, first[None], self._widths, self.region)
        found = Tuned(self.draft.with_values(self.region.values(p[0])), float(merit[0]), self.start.formula,
                      "pattern search with the simulator", 0)  # fmt: skip
        if trial.view.goal.damping or trial.view.goal.limits_levels:
            # The worst peak lies between the frequencies of the batch: the last step sees it.
            last = replace(self.draft, shunt=found.shunt, free=self.draft.free[:1])
            found = refine(trial, last, Start(self.start.formula, last.first()), self._part(1))
        return found._replace(iterations=trial.simulations - before)

    def schedule(self) -> Schedule:
        """The best lag and load at each frequency of the mean over the band."""
        frequencies, weights = self.trial.nodes
        points, values = self._coarse
        nearest = np.argmin(np.abs(self._coarse_nodes[0] - frequencies[:, None]), axis=1)
        each = np.array([self._merits(values[:, [n]], np.ones(1)) for n in range(len(self._coarse_nodes[0]))])

        def merits(p: np.ndarray, which: np.ndarray) -> np.ndarray:
            return self._merits(self._simulate(p, frequencies[which, None]), np.ones(1))

        best, _ = zoom(merits, points[np.argmin(each[nearest], axis=1)], self._widths, self.region)
        power = self._simulate(best, frequencies[:, None])[:, 0, 0]
        table = tuple(
            {"frequency": float(f), **self.region.values(p), "harvested_power": float(w)}
            for f, p, w in zip(frequencies, best, power, strict=True)
        )
        return Schedule(table, float(power @ weights))

    @cached_property
    def _coarse_nodes(self) -> tuple[np.ndarray, np.ndarray]:
        operation = self.trial.view.operation
        if operation.band is None:
            return self.trial.nodes
        return mean_nodes(operation.band, self.trial.view.transducer, _COARSE_ERROR, _COARSE_NODES)

    @cached_property
    def _coarse(self) -> tuple[np.ndarray, np.ndarray]:
        """Points (n, d) of the coarse grid, and their figures at the judged frequencies (n, m, 4)."""
        points = coarse_points(self.draft, self.start)
        frequencies, _ = self._judged(*self._coarse_nodes)
        return points, self._simulate(points, np.tile(frequencies, (len(points), 1)))

    @property
    def _widths(self) -> np.ndarray:
        """Half the steps of the coarse grid."""
        return 0.5 * coarse_steps(self.draft)

    def _judged(self, nodes: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies and weights of the power's mean, then others with weight zero where levels count."""
        band, goal = self.trial.view.operation.band, self.trial.view.goal
        if band is None or not (goal.damping or goal.limits_levels):
            return nodes, weights
        return np.append(nodes, np.linspace(*band, _LEVEL_POINTS)), np.append(weights, np.zeros(_LEVEL_POINTS))

    def _simulate(self, points: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
        """Power, displacement, voltage and whether it converged (n, m, 4), of points (n, d) at frequencies (n, m)."""
        return simulated(self.trial, self.draft, points, frequencies)

    def _merits(self, values: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Merits (n,) of points from their figures (n, m, 4) and the weights (m,) of their powers."""
        largest = np.max(values[..., 1:3], axis=1)
        each = np.column_stack((values[..., 0] @ weights, largest, np.min(values[..., 3], axis=1)))
        return merits_of(self.trial.view.goal, each, self.trial.shorted)

    def _start_at(self, p: np.ndarray) -> Start:
        return Start(self.start.formula, self.region.values(p))

    def _part(self, count: int) -> Region:
        """The region of the first fields."""
        r = self.region
        return Region(r.names[:count], r.lower[:count], r.upper[:count], r.coil[:, :count], r.offset)


def coarse_points(draft: Draft, start: Start, loads: np.ndarray = _LOADS) -> np.ndarray:
    """Coordinates (n, d) of a coarse grid: loads by factors of that of a start, and all lags that differ."""
    axes = [_LAGS if name == "phase_lag" else np.log(start.values[name] * loads) for name in draft.free]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes)) if axes else np.empty((1, 0))


def coarse_steps(draft: Draft) -> np.ndarray:
    """Steps (d,) of the coarse grid."""
    lag, load = _LAGS[1] - _LAGS[0], np.log(_LOADS[1] / _LOADS[0])
    return np.array([lag if name == "phase_lag" else load for name in draft.free])


def simulated(
    trial: Trial, draft: Draft, points: np.ndarray, frequencies: np.ndarray, *, thorough: bool = True
) -> np.ndarray:
    """Power, displacement, voltage and whether it converged (n, m, 4), of points (n, d) at frequencies (n, m)."""
    shunt = draft.with_values(values_at(draft.free, np.repeat(points, frequencies.shape[1], axis=0)))
    found = trial.many(shunt, frequencies.ravel(), thorough=thorough)
    names = ("harvested_power", "displacement_amplitude", "voltage_amplitude", "converged")
    return np.stack([found[name].reshape(frequencies.shape) for name in names], axis=-1)


def merits_of(goal: Goal, values: np.ndarray, shorted: float | np.ndarray) -> np.ndarray:
    """Merits (n,) from figures (n, 4) as of `simulated`, and displacement with shorted electrodes in m."""
    power, displacement, voltage, converged = values.T
    with np.errstate(all="ignore"):
        attenuation = 20 * np.log10(displacement / shorted)
    rows = zip(power, displacement, voltage, attenuation, converged > 0, strict=True)
    return np.array([goal.merit(DesignFigures(*map(float, row[:4]), converged=bool(row[4]))) for row in rows])


def phase_start(draft: Draft, found: list[Start]) -> Start:
    """Start of the coarse grid: what a closed form gives for the load, and no lag."""
    start = found[0] if found else Start("a grid", draft.first())
    return Start(start.formula, {**draft.first(), **start.values, "phase_lag": 0.0})


def zoom(
    merits: Callable[[np.ndarray, np.ndarray], np.ndarray], centre: np.ndarray, width: np.ndarray, region: Region
) -> tuple[np.ndarray, np.ndarray]:
    """Minima near several starts at once, by quadratic models of a stencil about each.

    Parameters
    ----------
    merits : callable
        Merits (n,) of points (n, d), each of the search with a number (n,).
    centre : (g, d) array
    width : (d,) array
        First step of the stencil.
    region : Region

    Returns
    -------
    best : (g, d) array
    merit : (g,) array
    """
    groups, size = centre.shape
    stencil = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * size, indexing="ij"), axis=-1).reshape(-1, size)
    step, best, lowest = np.ones(groups), centre.copy(), np.full(groups, np.inf)

    def look(active: np.ndarray, moves: np.ndarray) -> np.ndarray:
        """Merits of points about the centres of some searches; the best are kept."""
        points = centre[active, None] + step[active, None, None] * width * moves
        points = np.clip(points, region.lower, region.upper)
        found = merits(points.reshape(-1, size), np.repeat(active, len(moves))).reshape(len(active), -1)
        first = np.argmin(found, axis=1)
        rows = np.arange(len(active))
        better = found[rows, first] < lowest[active]
        best[active[better]] = points[rows, first][better]
        lowest[active] = np.minimum(lowest[active], found[rows, first])
        return found

    for _ in range(_ROUNDS):
        active = np.flatnonzero(step > _LAST_STEP)
        if not len(active):
            break
        move = _model_minimum(stencil, look(active, stencil))
        centre[active] = np.clip(centre[active] + step[active, None] * width * move, region.lower, region.upper)
        inside = np.all(np.abs(move) < 1, axis=1)
        step[active[inside]] *= _SHRINK  # an optimum at the edge is followed with the same step
    look(np.arange(groups), np.zeros((1, size)))
    return best, lowest


def _model_minimum(stencil: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Minima (g, d) within the stencil (k, d) of quadratics fitted to values (g, k); the best point without one."""
    size = stencil.shape[1]
    rows, columns = np.triu_indices(size)
    basis = np.hstack((np.ones((len(stencil), 1)), stencil, stencil[:, rows] * stencil[:, columns]))
    terms = values @ np.linalg.pinv(basis).T
    slope = terms[:, 1 : size + 1]
    bend = np.zeros((len(values), size, size))
    bend[:, rows, columns] = terms[:, size + 1 :]
    bend = bend + np.swapaxes(bend, 1, 2)
    found: Any = stencil[np.argmin(values, axis=1)].copy()
    convex = np.min(np.linalg.eigvalsh(bend), axis=1) > 0
    if np.any(convex):
        found[convex] = np.clip(-np.linalg.solve(bend[convex], slope[convex][..., None])[..., 0], -1, 1)
    return found
