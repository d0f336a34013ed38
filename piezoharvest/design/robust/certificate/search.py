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


class _Boxes(NamedTuple):
    """Boxes by centre and half-widths (n, d), with logarithms (n,), larger for worse, of bounds and of middle values.

    `influence` (n, d) is that of the coordinates.
    """

    centre: np.ndarray
    radius: np.ndarray
    losses: np.ndarray
    middles: np.ndarray
    influence: np.ndarray

    @classmethod
    def of(cls, enclosure: Enclosure, centre: np.ndarray, radius: np.ndarray, sign: float) -> _Boxes:
        """Boxes with what the enclosure says of them."""
        worst, middle, influence = enclosure.bounds(centre, radius)
        # A box outside of a confidence region holds no specimen, and a middle outside is none.
        losses = np.where(enclosure.box.beyond(centre, radius), -np.inf, _loss(worst, sign))
        middles = np.where(enclosure.box.beyond(centre), -np.inf, _loss(middle, sign))
        return cls(centre, radius, losses, middles, influence)

    def part(self, which: np.ndarray) -> _Boxes:
        """Boxes of a mask, or of indices."""
        return _Boxes(*(values[which] for values in self))

    def joined(self, other: _Boxes) -> _Boxes:
        """Both sets of boxes."""
        return _Boxes(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))

    def halves(self) -> tuple[np.ndarray, np.ndarray]:
        """Centre and half-widths of both halves of each, along the coordinate with the largest influence."""
        rows, axis = np.arange(len(self.centre)), np.argmax(self.influence, axis=1)
        step = np.zeros_like(self.radius)
        step[rows, axis] = 0.5 * self.radius[rows, axis]
        centres = np.concatenate((self.centre - step, self.centre + step))
        return centres, np.concatenate((self.radius - step, self.radius - step))


def certify(enclosure: Enclosure, known: float) -> Certificate | None:
    """Certificate for the objective, given the worst value known (W or m); None where there is none.

    `known` is the value at a point of the box, so that all boxes that are no worse than it can be left.
    """
    if not enclosure.possible:
        return None
    sign, widths = 1.0 if enclosure.view.goal.damping else -1.0, enclosure.widths
    boxes = _Boxes.of(enclosure, np.zeros((1, len(widths))), widths[None].copy(), sign)
    met: float = float(_loss(known, sign))
    done: float = -np.inf
    place: np.ndarray = np.full(len(widths), np.nan)
    left: int = _SYSTEMS // enclosure.systems - 1
    while True:
        worst = int(np.argmax(boxes.middles))
        if boxes.middles[worst] > met:
            met, place = float(boxes.middles[worst]), boxes.centre[worst].copy()
        settled = boxes.losses <= met + GAP
        done = max(done, float(np.max(boxes.losses[settled], initial=-np.inf)))
        boxes = boxes.part(~settled)
        if not len(boxes.losses) or left <= 0:
            break
        several = max(_FIRST, len(boxes.losses) // 4)
        count = min(len(boxes.losses), max(1, min(left // 2, several, _AT_ONCE // enclosure.systems)))
        order = np.argsort(-boxes.losses, kind="stable")
        halved = _Boxes.of(enclosure, *boxes.part(order[:count]).halves(), sign)
        boxes = boxes.part(order[count:]).joined(halved)
        left -= 2 * count
    certified = max(done, met, float(np.max(boxes.losses, initial=-np.inf)))
    return Certificate(_value(certified, sign), _value(met, sign), place[: len(enclosure.box.names)])


def _loss(value: np.ndarray | float, sign: float) -> np.ndarray:
    with np.errstate(divide="ignore"):
        return sign * np.log(value)


def _value(loss: float, sign: float) -> float:
    return float(np.exp(sign * loss))
