"""Fronts of switched circuits with one or two tuned fields: a surface through simulations, then simulated points.

The figures at each frequency are smooth functions of load and lag, although the worst peak of a band, which jumps
between frequencies and has no gradient, is not. They are interpolated from a grid of simulations (one batch in compiled
code, a figure of which costs a hundredth of a gradient), the worst peak is taken of the interpolated ones, and the
designs that are found are simulated.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from piezoharvest.description.shunts import Shunt
from piezoharvest.design.drafts import ANGLES, Draft
from piezoharvest.design.front.point import TIE, nondominated
from piezoharvest.design.goal import MARGIN, SMALLEST_FIGURE, DesignFigures
from piezoharvest.design.operation import mean_nodes
from piezoharvest.design.trial import Trial
from piezoharvest.design.tuning.region import Region, coordinates, values_at

# Of the first grid: factors of the load that is best for harvest, lags over half a turn (the other half is the same),
# and frequencies of a band.
_FACTORS, _LAGS, _FEW = np.geomspace(1e-3, 1e3, 19), np.linspace(-np.pi / 2, np.pi / 2, 8, endpoint=False), 9
_GRID, _BAND_GRID = {1: (65,), 2: (25, 15)}, {1: (33,), 2: (13, 9)}  # of simulations, within the box of the front
# Of the lag across the front: moves in units of steps, rad; the last step leaves 1e-4 of the figures. Over a band,
# where a design is forty simulations, fewer.
_MOVES, _MOVE_STEPS, _BAND_MOVES, _BAND_MOVE_STEPS = 7, (0.1, 0.03, 0.01), 5, (0.08, 0.025, 0.008)
_DENSE = {1: (2001,), 2: (161, 81)}  # of the surface: within half a step of 161 figures change by 1e-4 of themselves
_NODES, _LEVEL_POINTS, _MEAN_ERROR = 41, 17, 1e-3  # of the mean over a band, and of its worst peak
_NEIGHBOURS, _BAND_NEIGHBOURS = 2, 1  # of a point, between which the slope of the front is taken
_POINTS, _BAND_POINTS = 25, 10  # even steps of the damping, and as many of the power


class Sampled(NamedTuple):
    """Power (n,) in W, and logarithms of displacement and voltage (n, f) in m and V at frequencies; trust (n,)."""

    power: np.ndarray
    displacement: np.ndarray
    voltage: np.ndarray
    converged: np.ndarray


@dataclass
class SurfaceFront:
    """Traces the front of a switched circuit under a sine.

    Attributes
    ----------
    trial : Trial
    draft : Draft
        One or two fields are free.
    region : Region
    best : Shunt
        The draft tuned for harvest.
    """

    trial: Trial
    draft: Draft
    region: Region
    best: Shunt

    def designs(self) -> list[tuple[Shunt, DesignFigures]]:
        """Designs with their simulated figures, the best for harvest first; some may be dominated by others."""
        points, values = self._through(self._box())
        fine = len(self.draft.free) == 1 or self.trial.view.operation.band is None
        chosen = points[_spread(values.power, self._peaks(values.displacement), _POINTS if fine else _BAND_POINTS)]
        if len(self.draft.free) == 2:
            # The best for harvest too: without it the slope next to this end is that further away.
            chosen = self._across(np.vstack((self._best_point, chosen)))
        return self._judged(np.vstack((self._best_point, chosen)))

    def _through(self, axes: list[np.ndarray]) -> tuple[np.ndarray, Sampled]:
        """Front (n, d) of the surface through simulations on a grid, with its figures."""
        values = self._simulate(_mesh(axes))
        table = np.hstack((values.power[:, None], values.displacement, values.voltage))
        surface = RegularGridInterpolator(axes, table.reshape(*map(len, axes), -1), method="cubic")
        points = _mesh([np.linspace(a[0], a[-1], n) for a, n in zip(axes, _DENSE[len(axes)], strict=True)])
        power, displacement, voltage = np.split(surface(points), [1, 1 + len(self._frequencies)], axis=1)
        found = Sampled(power[:, 0], displacement, voltage, np.ones(len(points)))
        kept = self._front(found)
        return points[kept], Sampled(*(each[kept] for each in found))

    def _across(self, points: np.ndarray) -> np.ndarray:
        """Front points (n, 2) with the second field tuned across the front by simulations.

        The surface has edges where a switch begins to act before the extremum. At each load the field is best where the
        weighted sum of both figures is, with the weights that the slope of the front has there.
        """
        values = self._simulate(points)
        points = points[self._front(values)]
        band = self.trial.view.operation.band
        reach = _BAND_NEIGHBOURS if band else _NEIGHBOURS
        moves = np.linspace(-3, 3, _BAND_MOVES if band else _MOVES)
        for step in _BAND_MOVE_STEPS if band else _MOVE_STEPS:
            values = self._simulate(points)
            power = np.log(np.maximum(values.power, SMALLEST_FIGURE))
            weights = _slopes(power, self._peaks(values.displacement), reach)
            tried = np.repeat(points[:, None], len(moves), axis=1)
            tried[..., 1] += step * moves
            tried = np.clip(tried, self.region.lower, self.region.upper)
            values = self._simulate(tried.reshape(-1, 2))
            power = np.log(np.maximum(values.power, SMALLEST_FIGURE)).reshape(tried.shape[:2])
            merit = self._peaks(values.displacement).reshape(power.shape) - weights[:, None] * power
            merit[~self._allowed(values).reshape(power.shape)] = np.inf
            points = tried[np.arange(len(points)), np.argmin(merit, axis=1)]
        return points

    @property
    def _grid(self) -> tuple[int, ...]:
        return (_BAND_GRID if self.trial.view.operation.band else _GRID)[len(self.draft.free)]

    @property
    def _best_point(self) -> np.ndarray:
        return coordinates(self.draft.values_of(self.best))

    def _box(self) -> list[np.ndarray]:
        """Axes of a grid about the front, by a first grid all over."""
        names, centre = self.draft.free, self._best_point
        wide = [_LAGS if name in ANGLES else c + np.log(_FACTORS) for name, c in zip(names, centre, strict=True)]
        points = np.vstack((centre, _mesh(wide)))
        points = points[np.all((points >= self.region.lower) & (points <= self.region.upper), axis=1)]
        inside = points[self._front(self._simulate(points, few=True), TIE)]
        steps = np.array([axis[1] - axis[0] for axis in wide])
        low, high = np.min(inside, axis=0) - steps, np.max(inside, axis=0) + steps
        low, high = np.maximum(low, self.region.lower), np.minimum(high, self.region.upper)
        return [np.linspace(a, b, n) for a, b, n in zip(low, high, self._grid, strict=True)]

    def _front(self, values: Sampled, tie: float = 0.0) -> np.ndarray:
        """Indices of designs that keep the limits and are not dominated; of all if none keeps them."""
        level, allowed = self._peaks(values.displacement), self._allowed(values)
        which = np.flatnonzero(allowed) if np.any(allowed) else np.arange(len(level))
        return which[nondominated(values.power[which], level[which], tie)]

    def _allowed(self, values: Sampled) -> np.ndarray:
        """True (n,) for designs within the limits on levels and power."""
        goal, level = self.trial.view.goal, self._peaks(values.displacement)
        found = level <= np.log(goal.largest_displacement(self.trial.shorted)) - MARGIN
        if goal.options.max_voltage is not None:
            found &= self._peaks(values.voltage) <= np.log(goal.options.max_voltage) - MARGIN
        return found & (values.power >= (goal.options.min_power or 0.0) * (1 + MARGIN))

    @cached_property
    def _nodes(self) -> tuple[np.ndarray, np.ndarray]:
        operation = self.trial.view.operation
        if operation.band is None:
            return self.trial.nodes
        return mean_nodes(operation.band, self.trial.view.transducer, _MEAN_ERROR, _NODES)

    @cached_property
    def _frequencies(self) -> np.ndarray:
        """Frequencies of the power's mean, then those at which only levels count, Hz."""
        band, (nodes, _) = self.trial.view.operation.band, self._nodes
        return nodes if band is None else np.append(nodes, np.linspace(*band, _LEVEL_POINTS))

    def _simulate(self, points: np.ndarray, *, few: bool = False) -> Sampled:
        """Figures of designs (n, d) in one batch, with `few` frequencies for a first look."""
        band, frequencies, weights = self.trial.view.operation.band, self._frequencies, self._nodes[1]
        if few and band is not None:
            frequencies, weights = np.linspace(*band, _FEW), np.full(_FEW, 1 / _FEW)
        shunt = self.draft.with_values(values_at(self.draft.free, np.repeat(points, len(frequencies), axis=0)))
        found = self.trial.many(shunt, np.tile(frequencies, len(points)))
        power, displacement, voltage, converged = (
            found[name].reshape(len(points), -1)
            for name in ("harvested_power", "displacement_amplitude", "voltage_amplitude", "converged")
        )
        levels, voltages = (np.log(np.maximum(x, SMALLEST_FIGURE)) for x in (displacement, voltage))
        return Sampled(power[:, : len(weights)] @ weights, levels, voltages, np.all(converged > 0, axis=1))

    def _peaks(self, logs: np.ndarray) -> np.ndarray:
        """Highest values (n,) over the band: the top of the parabola through the highest sample and its neighbours."""
        frequencies, order = np.unique(self._frequencies, return_index=True)
        if logs.shape[1] != len(self._frequencies) or len(order) < 3:
            return np.max(logs, axis=1)
        return _tops(frequencies, logs[:, order])

    def _judged(self, points: np.ndarray) -> list[tuple[Shunt, DesignFigures]]:
        """Designs (n, d) with their figures."""
        values, shorted, found = self._simulate(points), self.trial.shorted, []
        levels, voltages = np.exp(self._peaks(values.displacement)), np.exp(self._peaks(values.voltage))
        for p, power, level, voltage, converged in zip(points, values.power, levels, voltages, values.converged,
                                                       strict=True):  # fmt: skip
            attenuation = 20 * float(np.log10(level / shorted))
            figures = DesignFigures(float(power), float(level), float(voltage), attenuation, bool(converged))
            found.append((self.draft.with_values(self.region.values(p)), figures))
        return found


def _mesh(axes: list[np.ndarray]) -> np.ndarray:
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


def _spread(power: np.ndarray, level: np.ndarray, count: int) -> np.ndarray:
    """Indices of designs of a front at even steps of either figure."""
    places = [
        np.argmin(np.abs(values - wanted))
        for values in (power, level)
        for wanted in np.linspace(values[0], values[-1], count)
    ]
    return np.unique(places)


def _slopes(power: np.ndarray, level: np.ndarray, reach: int) -> np.ndarray:
    """Slopes (n,) of a front: logarithm of displacement over that of power, between neighbours so many places away."""
    n = np.arange(len(power))
    low, high = np.maximum(n - reach, 0), np.minimum(n + reach, len(n) - 1)
    with np.errstate(all="ignore"):
        slope = (level[high] - level[low]) / (power[high] - power[low])
    return np.where(np.isfinite(slope) & (slope > 0), slope, 1.0)


def _tops(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Tops (n,) of curves (n, m) over x (m,), by a parabola through the highest sample and its neighbours."""
    n = np.argmax(y, axis=1)
    rows, middle = np.arange(len(y)), np.clip(n, 1, len(x) - 2)
    left, right = x[middle] - x[middle - 1], x[middle + 1] - x[middle]
    rise = (y[rows, middle] - y[rows, middle - 1]) / left
    fall = (y[rows, middle + 1] - y[rows, middle]) / right
    bend = (fall - rise) / (left + right)
    slope = (rise * right + fall * left) / (left + right)
    with np.errstate(all="ignore"):
        top = y[rows, middle] - slope**2 / (4 * bend)
    return np.where((n == middle) & (bend < 0), top, y[rows, n])
