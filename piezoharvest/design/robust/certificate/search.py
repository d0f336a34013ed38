"""Branch and bound: a figure that no point of a box is worse than, as near to the worst one found as work allows.

The boxes with the worst bounds are halved along the coordinate with the largest influence, until every bound is as near
to the worst known value as asked, or the work is done. Bounds err by the square of a box, so that a worst case in a
corner takes few boxes, and one on a resonance inside takes more.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezoharvest.design.robust.certificate.enclosure import Enclosure

GAP = 1e-3  # e-folds (0.1 % of power, 0.009 dB): asked of the certificate; parts and models are not known better
_SYSTEMS = 120_000  # solved at most, one to two seconds
_AT_ONCE = 2048  # systems in a batch
_FIRST = 64  # boxes halved at once at the beginning


class Certificate(NamedTuple):
    """Certified value, in W or m, and the worst value met at the middle of a box with its point (d,)."""

    certified: float
    met: float
    point: np.ndarray


def certify(enclosure: Enclosure, known: float) -> Certificate | None:
    """Certificate for the objective, given the worst value known (W or m); None where there is none.

    `known` is the value at a point of the box, so that all boxes that are no worse than it can be left.
    """
    if not enclosure.possible:
        return None
    sign = 1.0 if enclosure.view.goal.damping else -1.0
    widths = enclosure.widths
    centre, radius = np.zeros((1, len(widths))), widths[None].copy()
    losses, middles, influence = _losses(enclosure, centre, radius, sign)
    met, point, done = _loss(known, sign), None, -np.inf
    left = _SYSTEMS // enclosure.systems - 1
    while True:
        if middles.size and middles.max() > met:
            met, point = float(middles.max()), centre[np.argmax(middles)].copy()
        settled = losses <= met + GAP
        done = max(done, np.max(losses[settled], initial=-np.inf))
        centre, radius, losses, influence = (x[~settled] for x in (centre, radius, losses, influence))
        if not len(losses) or left <= 0:
            break
        count = min(len(losses), max(1, min(left // 2, max(_FIRST, len(losses) // 4), _AT_ONCE // enclosure.systems)))
        order = np.argsort(-losses, kind="stable")
        worst, others = order[:count], order[count:]
        children = _halved(centre[worst], radius[worst], influence[worst])
        found = _losses(enclosure, *children, sign)
        left -= 2 * count
        centre, radius = (np.concatenate((a[others], b)) for a, b in zip((centre, radius), children, strict=True))
        losses, influence = np.concatenate((losses[others], found[0])), np.concatenate((influence[others], found[2]))
        middles = np.concatenate((np.full(len(others), -np.inf), found[1]))
    certified = max(done, met, np.max(losses, initial=-np.inf))
    place = np.full(len(widths), np.nan) if point is None else point
    return Certificate(_value(certified, sign), _value(met, sign), place[: len(enclosure.box.names)])


def _losses(enclosure: Enclosure, centre: np.ndarray, radius: np.ndarray, sign: float):
    """Logarithms, larger for worse, of bounds and of values at the middles; and the coordinates' influence."""
    worst, middle, influence = enclosure.bounds(centre, radius)
    return _loss(worst, sign), _loss(middle, sign), influence


def _loss(value, sign: float):
    with np.errstate(divide="ignore"):
        return sign * np.log(value)


def _value(loss: float, sign: float) -> float:
    return float(np.exp(sign * loss))


def _halved(centre: np.ndarray, radius: np.ndarray, influence: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both halves of boxes, along the coordinate with the largest influence."""
    rows, axis = np.arange(len(centre)), np.argmax(influence, axis=1)
    step = np.zeros_like(radius)
    step[rows, axis] = 0.5 * radius[rows, axis]
    return np.concatenate((centre - step, centre + step)), np.concatenate((radius - step, radius - step))
