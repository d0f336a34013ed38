"""Estimation of the number and values of the thresholds of a Prandtl-Ishlinskii operator."""

from __future__ import annotations

import numpy as np

from piezoharvest.identify.hysteresis.loop_model import MAX_THRESHOLD, LoopData, LoopShape, convex_fit
from piezoharvest.identify.hysteresis.play_operators import half_excursions
from piezoharvest.identify.noise.coloured_noise import effective_samples

_NUMBERS = (1, 2, 3, 4, 5, 6, 8, 10, 12)
_MIN_WEIGHT = 1e-4  # of the total slope: smaller weights are dropped
_MIN_GAP = 1e-3  # of half the input range: least distance of thresholds


def place_thresholds(data: LoopData) -> LoopShape:
    """Thresholds placed by the record and refined, in a number selected by Schwarz' criterion.

    The criterion counts the effective samples of the best model's residual, not all samples: otherwise a coloured
    residual would select the largest number tried.
    """
    tried = [
        _effective_operators(data, refine_shape(data, at_quantiles(data, number), move=True)) for number in _NUMBERS
    ]
    squares = []
    for shape in tried:
        design = shape.design(data)
        squares.append(data.output - design @ convex_fit(design, data.output))
    best = min(squares, key=lambda residual: float(residual @ residual))
    count = effective_samples(best)
    floor = len(best) * (np.finfo(float).eps * float(np.ptp(data.output))) ** 2

    def criterion(n: int) -> float:
        unknowns = 2 + 2 * len(tried[n].thresholds)
        return float(count * np.log(squares[n] @ squares[n] + floor) + unknowns * np.log(count))

    return tried[min(range(len(tried)), key=criterion)]


def at_quantiles(data: LoopData, number: int) -> LoopShape:
    """Thresholds at quantiles of the half excursions of the input, with equally many samples between any two."""
    ways = half_excursions(data.signal)
    thresholds = np.quantile(ways[ways > 0], (np.arange(number) + 0.5) / number)
    return LoopShape(np.minimum(thresholds, MAX_THRESHOLD * data.excited), np.zeros(number))


def refine_shape(data: LoopData, start: LoopShape, *, move: bool) -> LoopShape:
    """Initial states, and thresholds if they may `move`, with the least residual.

    The unknowns are offset, slope, weights, gaps between thresholds in half input ranges, and turns.
    """
    from scipy.optimize import least_squares

    n, excited, scale = len(start.thresholds), data.excited, float(np.ptp(data.output)) or 1.0
    turns = 0 if data.virgin else n
    free = np.ones(2 + 2 * n + turns, bool)
    free[2 + n : 2 + 2 * n] = move
    if n == 0 or not (move or turns):
        return start
    gaps = np.maximum(np.diff(start.thresholds, prepend=0.0) / excited, 2 * _MIN_GAP)
    origin = np.concatenate((convex_fit(start.design(data), data.output), gaps, start.turns[:turns]))
    low = np.concatenate(([-np.inf], np.zeros(1 + n), np.full(n, _MIN_GAP), np.full(turns, -1.0)))
    high = np.concatenate((np.full(2 + n, np.inf), np.full(n, 1.0), np.full(turns, 1.0)))

    def parts(x: np.ndarray) -> tuple[np.ndarray, LoopShape]:
        full = origin.copy()
        full[free] = x
        thresholds = np.cumsum(full[2 + n : 2 + 2 * n]) * excited if move else start.thresholds
        return full[: 2 + n], LoopShape(thresholds, full[2 + 2 * n :])

    def residual(x: np.ndarray) -> np.ndarray:
        linear, shape = parts(x)
        return (shape.design(data) @ linear - data.output) / scale

    def jacobian(x: np.ndarray) -> np.ndarray:
        linear, shape = parts(x)
        derivatives = shape.derivatives(data, linear[2:])
        derivatives[:, :n] = derivatives[:, :n] @ np.tri(n) * excited
        return np.hstack((shape.design(data), derivatives))[:, free] / scale

    inner = np.clip(origin, low + 1e-9, high - 1e-9)[free]
    bounds = (low[free], high[free])
    found = least_squares(residual, inner, jac=jacobian, bounds=bounds, x_scale="jac", max_nfev=60)  # pyright: ignore[reportArgumentType]
    return parts(found.x)[1]


def _effective_operators(data: LoopData, shape: LoopShape) -> LoopShape:
    """Shape without operators that have no weight or no effect in the record."""
    linear = convex_fit(shape.design(data), data.output)
    kept = (linear[2:] > _MIN_WEIGHT * linear[1:].sum()) & (shape.thresholds <= MAX_THRESHOLD * data.excited)
    states = shape.states(data)[kept]
    thresholds = shape.thresholds[kept]
    if data.virgin:
        return LoopShape(thresholds, states)
    gaps = np.diff(thresholds, prepend=0.0)
    return LoopShape(thresholds, np.diff(states, prepend=data.signal[0]) / gaps)
