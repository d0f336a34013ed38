"""Networks of resistors, inductors and capacitors that have a given positive-real admittance.

What an admittance is a sum of lies in parallel: its poles on the imaginary axis (Foster), and all others by partial
fractions where each is passive by itself or with a share of the constant; else the least conductance, where that lies
at zero or infinite frequency. What remains is inverted, and the sum of the impedance lies in series (Cauer). There are
neither transformers nor the copies of Bott and Duffin: where the least conductance and the least resistance lie at
other frequencies there is no network here.

Source: Guillemin, Synthesis of Passive Networks, Wiley, 1957, chapters 3, 4 and 9.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import count
from typing import NamedTuple

import numpy as np

from piezoharvest.description.netlist import Element

_ROUNDING = 1e-9  # relative; coefficients, real parts and differences of poles this small are rounded zeros

_MOST_POLES = 12  # the ways to split an admittance may double with each
_CANCELS = 1e-6  # relative distance of a zero from a pole; nearer ones move no admittance by more than is compared


class NotRealisableError(ValueError):
    """No network of series and parallel parts has the admittance."""


class _StuckError(Exception):
    """Nothing more can be split off."""


class Part(NamedTuple):
    """An element (R, L, C; ohm, H, F), or several in "series" or in "parallel"."""

    kind: str
    value: float = 0.0
    parts: tuple[Part, ...] = ()

    def dual(self) -> Part:
        """The part whose impedance is this one's admittance, as a number."""
        swapped = {"R": "R", "L": "C", "C": "L", "series": "parallel", "parallel": "series"}[self.kind]
        value = 1.0 / self.value if self.kind == "R" else self.value
        return Part(swapped, value, tuple(part.dual() for part in self.parts))


class Ratio(NamedTuple):
    """Numerator and denominator: coefficients, highest power of s first."""

    above: np.ndarray
    below: np.ndarray

    def inverse(self) -> Ratio:
        """One over the ratio."""
        return Ratio(self.below, self.above)

    def corners(self) -> np.ndarray:
        """Sizes of poles and zeros, rad/s, without those at zero; 1 if there are none."""
        roots = np.abs(np.concatenate([np.roots(part) for part in self]))
        return roots[roots > _ROUNDING * np.max(roots)] if np.any(roots) else np.ones(1)

    def size(self) -> float:
        """Largest magnitude at the corners."""
        s = 1j * self.corners()
        return float(np.max(np.abs(np.polyval(self.above, s) / np.polyval(self.below, s))))

    def cleaned(self) -> Ratio:
        """Without what rounding has left of coefficients that are zero, at the mean size of poles and zeros."""
        scale = np.exp(np.mean(np.log(self.corners())))

        def clean(coefficients: np.ndarray) -> np.ndarray:
            size = np.abs(coefficients) * scale ** np.arange(len(coefficients) - 1, -1, -1.0)
            return np.trim_zeros(np.where(size > _ROUNDING * np.max(size, initial=0.0), coefficients, 0.0), "f")

        return Ratio(clean(self.above), clean(self.below))

    def reduced(self) -> Ratio:
        """Without zeros that lie on poles."""
        zeros, poles = (list(np.roots(part)) for part in self)
        for zero in list(zeros):
            nearest = min(poles, key=lambda pole: abs(pole - zero), default=np.inf)
            if abs(nearest - zero) <= _CANCELS * abs(zero):
                zeros.remove(zero)
                poles.remove(nearest)
        above, below = (np.atleast_1d(np.real(np.poly(roots))) for roots in (zeros, poles))
        return Ratio(self.above[0] * above, self.below[0] * below)

    def least_real_part(self) -> tuple[float, float]:
        """Least real part on the imaginary axis, at zero and infinity too, and its frequency in rad/s."""
        mirrored = self.below * (-1.0) ** np.arange(len(self.below) - 1, -1, -1.0)
        real, square = (_of_square(np.polymul(factor, mirrored)) for factor in self)
        slope = np.polysub(np.polymul(np.polyder(real), square), np.polymul(real, np.polyder(square)))
        roots = np.roots(slope)
        inner = roots[(np.abs(roots.imag) <= _ROUNDING * np.abs(roots)) & (roots.real > 0)].real
        at_infinity = self.above[0] / self.below[0] if len(self.above) == len(self.below) else 0.0
        zero, *points = [(float(np.polyval(real, x) / np.polyval(square, x)), float(np.sqrt(x))) for x in (0.0, *inner)]
        end = min(zero, (float(at_infinity), np.inf))
        least = min([end, *points])
        # Flat at an end, rounding may make it least beside it.
        size = max(abs(value) for value, _ in (end, zero, *points))
        return end if end[0] <= least[0] + _ROUNDING * size else least


def network_elements(ratio: Ratio) -> tuple[Element, ...]:
    """Elements between the port's nodes 1 and 0 with an admittance in S, s being in 1/s.

    Raises
    ------
    NotRealisableError
        It is not passive, or needs transformers; the message says where.
    """
    _check_passive(ratio)
    try:
        tree = _admittance(ratio)
    except _StuckError:
        raise NotRealisableError("it needs transformers, or its parts differ by more than rounding leaves") from None
    numbers: Counter[str] = Counter()
    nodes = count(2)

    def elements(part: Part, start: int, end: int) -> Iterator[Element]:
        if not part.parts:
            numbers[part.kind] += 1
            yield Element(f"{part.kind}{numbers[part.kind]}", part.kind, (start, end), float(part.value))
        for n, inner in enumerate(part.parts):
            after = end if part.kind == "parallel" or n == len(part.parts) - 1 else next(nodes)
            yield from elements(inner, start, after)
            start = start if part.kind == "parallel" else after

    return tuple(elements(tree, 1, 0))


def _check_passive(ratio: Ratio) -> None:
    """Raise `NotRealisableError` unless an admittance is positive real, but for residues of poles on the axis."""
    poles = np.roots(ratio.below)
    if np.any(poles.real > _ROUNDING * np.abs(poles)):
        raise NotRealisableError("it is not stable")
    if len(ratio.above) > len(ratio.below) + 1:
        raise NotRealisableError("it grows faster than that of a capacitor")
    if len(poles) > _MOST_POLES:
        raise NotRealisableError(f"it has {len(poles)} poles, at most {_MOST_POLES} are tried")
    least, at = ratio.least_real_part()
    if least < -_ROUNDING * ratio.size():
        raise NotRealisableError(f"its real part is negative at {at / (2 * np.pi):.4g} Hz")


def _admittance(ratio: Ratio, inverted: bool = False) -> Part:
    """Part with an admittance, the sum of what lies in parallel: of the ways to split it the first that ends well.

    `inverted`: nothing was split off its inverse, so that inverting it again leads nowhere.
    """
    lossless, rest, constant = _without_axis_poles(ratio.cleaned())
    if len(rest.below) == 1 or not np.any(rest.above):
        return _parallel(lossless, constant, [])
    for terms, left in _splits(rest, constant):
        try:
            return _parallel(lossless, left, [_admittance(term.inverse()).dual() for term in terms])
        except _StuckError:
            continue
    if inverted and not lossless:
        raise _StuckError
    return _parallel(lossless, 0.0, [_admittance(_raised(rest, constant).inverse(), inverted=True).dual()])


def _parallel(lossless: list[Part], conductance: float, others: list[Part]) -> Part:
    """Parts and a resistor side by side."""
    parts = [*lossless, *([Part("R", 1.0 / conductance)] if conductance > 0 else []), *others]
    if not parts:
        raise _StuckError
    return parts[0] if len(parts) == 1 else Part("parallel", parts=tuple(parts))


def _without_axis_poles(ratio: Ratio) -> tuple[list[Part], Ratio, float]:
    """Lossless parts of the poles on the imaginary axis and at infinity, the proper rest, and the constant."""
    quotient, remainder = np.polydiv(ratio.above, ratio.below)
    rising, constant = (quotient[0], quotient[1]) if len(quotient) == 2 else (0.0, quotient[0])
    if rising < 0:
        raise _StuckError
    poles = np.roots(ratio.below).astype(complex)
    on_axis = np.abs(np.real(poles)) <= _ROUNDING * np.abs(poles)
    poles = np.where(on_axis, 1j * np.imag(poles), poles)
    derivative = np.polyder(ratio.below)
    parts, removed = [Part("C", rising)] if rising else [], np.array([1.0])
    above = remainder
    for pole in poles[on_axis & (np.imag(poles) >= 0)]:
        residue = float(np.real(np.polyval(remainder, pole) / np.polyval(derivative, pole)))
        if not residue > 0:
            raise _StuckError
        factor = np.array([1.0, 0.0]) if pole == 0 else np.array([1.0, 0.0, pole.imag**2])
        own = np.array([residue]) if pole == 0 else np.array([2 * residue, 0.0])
        others = np.polydiv(ratio.below, factor)[0]
        above = np.polysub(above, np.polymul(own, others))
        removed = np.polymul(removed, factor)
        parts.append(_lossless(residue, pole.imag))
    rest = Ratio(np.polydiv(above, removed)[0], np.polydiv(ratio.below, removed)[0])
    return parts, rest, float(constant) if abs(constant) > _ROUNDING * rest.size() else 0.0


def _lossless(residue: float, frequency: float) -> Part:
    """An inductor, or a series resonance at a frequency in rad/s."""
    if not frequency:
        return Part("L", 1.0 / residue)
    return Part("series", parts=(Part("L", 0.5 / residue), Part("C", 2 * residue / frequency**2)))


def _splits(rest: Ratio, constant: float) -> Iterator[tuple[list[Ratio], float]]:
    """Terms of a proper admittance and a constant, each zero at 0 or infinity, and what is left of the constant."""
    terms = _partial_fractions(rest)
    found = [term.least_real_part() for term in terms]
    shares = [max(0.0, -least) for least, _ in found]
    placed = all(at in (0.0, np.inf) for (_, at), share in zip(found, shares, strict=True) if share)
    if terms and placed and sum(shares) <= constant * (1 + _ROUNDING):
        left = constant - sum(shares)
        raised = [_raised(term, share) for term, share in zip(terms, shares, strict=True)]
        yield raised, left if left > _ROUNDING * constant else 0.0
    whole = _raised(rest, constant)
    least, at = whole.least_real_part()
    if at in (0.0, np.inf):
        yield [_raised(whole, -least)], max(least, 0.0)


def _partial_fractions(rest: Ratio) -> list[Ratio]:
    """Terms of single real poles and of pairs; none where a pole is repeated."""
    poles = np.roots(rest.below).astype(complex)
    distances = np.abs(poles[:, None] - poles) + np.diag(np.abs(poles))
    if np.any(distances < np.sqrt(_ROUNDING) * np.abs(poles)):  # a double pole is split by the root of its rounding
        return []
    residues = np.polyval(rest.above, poles) / np.polyval(np.polyder(rest.below), poles)
    terms = []
    for pole, residue in zip(poles, residues, strict=True):
        if pole.imag == 0:
            terms.append(Ratio(np.array([residue.real]), np.array([1.0, -pole.real])))
        elif pole.imag > 0:
            above = np.array([2 * residue.real, -2 * (residue * pole.conjugate()).real])
            terms.append(Ratio(above, np.array([1.0, -2 * pole.real, abs(pole) ** 2])).cleaned())
    return terms


def _raised(ratio: Ratio, constant: float) -> Ratio:
    """A ratio plus a constant."""
    return Ratio(np.polyadd(ratio.above, constant * ratio.below), ratio.below).cleaned()


def _of_square(polynomial: np.ndarray) -> np.ndarray:
    """Even part of a polynomial in s at s = jw, as one in w^2."""
    even = polynomial[::-1][::2]
    return (even * (-1.0) ** np.arange(len(even)))[::-1]
