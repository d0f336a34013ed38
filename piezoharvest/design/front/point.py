"""Fronts of designs: points, dominance, and the best front over all kinds of shunt."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import PchipInterpolator

from piezoharvest.description.shunts import Shunt

TIE = 5e-4  # relative: half of the 0.1 % within which a front is promised to be the best
CLOSE = 2e-3  # relative: points of a front that differ by less say the same
_BETWEEN = 64  # values of the interpolated front from point to point
_DECIBEL = np.log(10) / 20  # e-folds per dB


@dataclass(frozen=True)
class FrontPoint:
    """A design on a front.

    Attributes
    ----------
    shunt : Shunt
    harvested_power : float
        W; over a band its mean.
    attenuation_db : float
        Displacement against the short circuit; over a band worst peak against worst peak.
    """

    shunt: Shunt
    harvested_power: float
    attenuation_db: float


@dataclass(frozen=True)
class Front:
    """Front of one kind of shunt.

    Attributes
    ----------
    kind : str
    free : tuple of str
        Names of the parameters that vary along the front.
    points : tuple of FrontPoint
        From the best for harvest to the best for damping; none dominates another.
    """

    kind: str
    free: tuple[str, ...]
    points: tuple[FrontPoint, ...]

    @classmethod
    def of(cls, kind: str, free: tuple[str, ...], points: Iterable[FrontPoint]) -> Front:
        """Front from designs of a kind, without those that are dominated or hardly differ from another one."""
        points = list(points)
        order = nondominated([p.harvested_power for p in points], [p.attenuation_db for p in points])
        kept = [points[n] for n in order[:1]]
        for point in (points[n] for n in order[1:]):
            last = order and point is points[order[-1]]
            if _differ(kept[-1], point) or (last and len(kept) == 1):
                kept.append(point)
            elif last:
                kept[-1] = point
        return cls(kind, free, tuple(kept))

    def attenuation_at(self, power: float) -> float:
        """Least attenuation_db of the kind at a harvested power (W) of at least so much; infinite beyond the front."""
        powers, levels = self._curve
        return float(np.interp(power, powers, levels, right=np.inf))

    @cached_property
    def _curve(self) -> tuple[np.ndarray, np.ndarray]:
        """Rising powers and their attenuation_db: monotone cubics of both along the front.

        Along its chord, as at either end one figure is a parabola of the other one.
        """
        corners = np.array([(p.harvested_power, p.attenuation_db) for p in self.points[::-1]])
        steps = np.diff(corners, axis=0)
        if not len(steps):
            return corners[:, 0], corners[:, 1]
        chord = np.append(0.0, np.cumsum(np.hypot(*(steps / np.ptp(corners, axis=0)).T)))
        dense = np.linspace(chord, np.roll(chord, -1), _BETWEEN, endpoint=False)[:, :-1].T.ravel()
        found = PchipInterpolator(chord, corners)(np.append(dense, chord[-1]))
        return found[:, 0], found[:, 1]


def nondominated(
    power: Sequence[float] | np.ndarray, level: Sequence[float] | np.ndarray, tie: float = 0.0
) -> list[int]:
    """Indices of the designs that no other one equals or betters in both; largest power first.

    Parameters
    ----------
    power : (n,) array
        The more the better.
    level : (n,) array
        The less the better.
    tie : float
        By which a design has to be lower than those of more power.
    """
    kept, lowest = [], np.inf
    for n in np.lexsort((np.asarray(level), -np.asarray(power))):
        if level[n] < lowest - tie:
            kept.append(int(n))
            lowest = level[n]
    return kept


def overall(fronts: Sequence[Front]) -> tuple[FrontPoint, ...]:
    """The best front over several kinds, largest power first.

    Kinds are compared between their points, too, by monotone cubic interpolation. Where kinds come within `TIE` of each
    other the one with fewer free parameters stands on the front, of those the first.
    """
    order = sorted(fronts, key=lambda front: len(front.free))
    kept = [
        point
        for n, front in enumerate(order)
        for point in front.points
        if not any(
            _dominated(point, other, TIE if m < n else -TIE) for m, other in enumerate(order) if m != n
        )
    ]  # fmt: skip
    found = nondominated([p.harvested_power for p in kept], [p.attenuation_db for p in kept])
    return tuple(kept[n] for n in found)


def _differ(one: FrontPoint, other: FrontPoint) -> bool:
    """True if designs differ by more than `CLOSE` in one of the figures."""
    power = abs(one.harvested_power - other.harvested_power) > CLOSE * one.harvested_power
    return power or abs(one.attenuation_db - other.attenuation_db) > CLOSE / _DECIBEL


def _dominated(point: FrontPoint, front: Front, tie: float) -> bool:
    """True if a front is better than a point in both figures; a positive `tie` is what it may be worse by."""
    level = front.attenuation_at(point.harvested_power * (1 - tie))
    return level <= point.attenuation_db + tie / _DECIBEL
