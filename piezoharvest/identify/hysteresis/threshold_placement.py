"""Where the thresholds of a Prandtl-Ishlinskii operator stand, and how many: told by the record."""

from __future__ import annotations

import numpy as np

from piezoharvest.identify.hysteresis.loop_model import LIMIT, LoopData, Shape, convex_fit
from piezoharvest.identify.hysteresis.play_operators import half_excursions
from piezoharvest.identify.noise.coloured_noise import effective_samples

_NUMBERS = (1, 2, 3, 4, 5, 6, 8, 10, 12)
_SMALL = 1e-4  # of the total slope: a weight below is none
_NEAR = 1e-3  # of half the input range: thresholds are at least so far apart


def place(data: LoopData) -> Shape:
    """Thresholds that the record tells best: placed, refined, and as many as Schwarz' criterion allows.

    The criterion counts the effective samples of the richest model's residual, not the samples: a coloured residual
    would have as many operators as there are to try.
    """
    tried = [_worthy(data, search(data, at_quantiles(data, number), move=True)) for number in _NUMBERS]
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


def at_quantiles(data: LoopData, number: int) -> Shape:
    """Thresholds at equal shares of the half excursions of the input, demagnetised: as many samples between any two."""
    ways = half_excursions(data.signal)
    thresholds = np.quantile(ways[ways > 0], (np.arange(number) + 0.5) / number)
    return Shape(np.minimum(thresholds, LIMIT * data.excited), np.zeros(number))


def search(data: LoopData, start: Shape, *, move: bool) -> Shape:
    """Initial states, and thresholds where they may `move`, with the least residual.

    The unknowns are offset, slope, weights, gaps between thresholds in half input ranges, and turns.
    """
    from scipy.optimize import least_squares

    n, excited, scale = len(start.thresholds), data.excited, float(np.ptp(data.output)) or 1.0
    turns = 0 if data.virgin else n
    free = np.ones(2 + 2 * n + turns, bool)
    free[2 + n : 2 + 2 * n] = move
    if n == 0 or not (move or turns):
        return start
    gaps = np.maximum(np.diff(start.thresholds, prepend=0.0) / excited, 2 * _NEAR)
    origin = np.concatenate((convex_fit(start.design(data), data.output), gaps, start.turns[:turns]))
    low = np.concatenate(([-np.inf], np.zeros(1 + n), np.full(n, _NEAR), np.full(turns, -1.0)))
    high = np.concatenate((np.full(2 + n, np.inf), np.full(n, 1.0), np.full(turns, 1.0)))

    def parts(x: np.ndarray) -> tuple[np.ndarray, Shape]:
        full = origin.copy()
        full[free] = x
        thresholds = np.cumsum(full[2 + n : 2 + 2 * n]) * excited if move else start.thresholds
        return full[: 2 + n], Shape(thresholds, full[2 + 2 * n :])

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


def _worthy(data: LoopData, shape: Shape) -> Shape:
    """Without the operators that have no weight, or that the record cannot see."""
    linear = convex_fit(shape.design(data), data.output)
    kept = (linear[2:] > _SMALL * linear[1:].sum()) & (shape.thresholds <= LIMIT * data.excited)
    states = shape.states(data)[kept]
    thresholds = shape.thresholds[kept]
    if data.virgin:
        return Shape(thresholds, states)
    gaps = np.diff(thresholds, prepend=0.0)
    return Shape(thresholds, np.diff(states, prepend=data.signal[0]) / gaps)
