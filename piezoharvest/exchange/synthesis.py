"""Networks of resistors, inductors and capacitors that have a given positive-real admittance.

What an admittance is a sum of lies in parallel: its poles on the imaginary axis (Foster), and all others by partial
fractions where each is passive by itself or with a share of the constant; else the least conductance, where that lies
at zero or infinite frequency. What remains is inverted, and the sum of the impedance lies in series (Cauer). Where the
least conductance and the least resistance lie at other frequencies, what remains is built twice (Bott and Duffin), as
there are no transformers.

Sources: Guillemin, Synthesis of Passive Networks, Wiley, 1957, chapters 3, 4, 9 and 10; Bott & Duffin, J. Appl. Phys.
20(8), 816, 1949.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from itertools import count
from typing import NamedTuple

import numpy as np

from piezoharvest.description.netlist import Element

_ROUNDING = 1e-9  # relative; coefficients, real parts and differences of poles this small are rounded zeros

_MOST_POLES = 12  # the ways to split an admittance may double with each
MOST_COPIED = 6  # poles, with about 40 elements: two more double them (Bott & Duffin)
_CANCELS = 1e-6  # relative distance of a zero from a pole; nearer ones move no admittance by more than is compared


class NotRealisableError(ValueError):
    """No network has the admittance, or none is found."""


class NetworkPart(NamedTuple):
    """An element (R, L, C; ohm, H, F), or several in "series" or in "parallel"."""

    kind: str
    value: float = 0.0
    parts: tuple[NetworkPart, ...] = ()

    def dual(self) -> NetworkPart:
        """The part whose impedance is this one's admittance, as a number."""
        swapped = {"R": "R", "L": "C", "C": "L", "series": "parallel", "parallel": "series"}[self.kind]
        value = 1.0 / self.value if self.kind == "R" else self.value
        return NetworkPart(swapped, value, tuple(part.dual() for part in self.parts))


class Ratio(NamedTuple):
    """Numerator and denominator: coefficients, highest power of s first."""

    above: np.ndarray
    below: np.ndarray

    def inverse(self) -> Ratio:
        """One over the ratio."""
        return Ratio(self.below, self.above)

    def corners(self) -> np.ndarray:
        """Sizes of poles and zeros, rad/s, without those at zero and infinity but for rounding; 1 if there are none."""
        roots = np.abs(np.concatenate([np.roots(part) for part in self]))
        if not np.any(roots):
            return np.ones(1)
        middle = np.median(roots[roots > 0])
        return roots[(roots > _ROUNDING * middle) & (roots < middle / _ROUNDING)]

    def size(self) -> float:
        """Largest magnitude at the corners."""
        s = 1j * self.corners()
        return float(np.max(np.abs(np.polyval(self.above, s) / np.polyval(self.below, s))))

    def cleaned(self) -> Ratio:
        """Without what rounding has left of coefficients that are zero, at the median of poles and zeros."""
        scale = np.median(self.corners())

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
        at_infinity = np.polydiv(self.above, self.below)[0][-1] if len(self.above) >= len(self.below) else 0.0
        zero, *points = [(float(np.polyval(real, x) / np.polyval(square, x)), float(np.sqrt(x))) for x in (0.0, *inner)]
        end = min(zero, (float(at_infinity), np.inf))
        least = min([end, *points])
        # Flat at an end, rounding may make it least beside it.
        size = max(abs(value) for value, _ in (end, zero, *points))
        return end if end[0] <= least[0] + _ROUNDING * size else least


def network_elements(ratio: Ratio, *, copies: bool) -> tuple[Element, ...]:
    """Elements between the port's nodes 1 and 0 with a positive-real admittance in S, s being in 1/s.

    Parameters
    ----------
    ratio : Ratio
        What it has is to be compared with this: rounding may have hidden parts.
    copies : bool
        Build twice what cannot be split into series and parallel parts; of at most `MOST_COPIED` poles.

    Raises
    ------
    NotRealisableError
        None is found.
    """
    tree = _admittance(ratio, copies=copies)
    numbers: Counter[str] = Counter()
    nodes = count(2)

    def elements(part: NetworkPart, start: int, end: int) -> Iterator[Element]:
        if not part.parts:
            numbers[part.kind] += 1
            yield Element(f"{part.kind}{numbers[part.kind]}", part.kind, (start, end), float(part.value))
        for n, inner in enumerate(part.parts):
            after = end if part.kind == "parallel" or n == len(part.parts) - 1 else next(nodes)
            yield from elements(inner, start, after)
            start = start if part.kind == "parallel" else after

    return tuple(elements(tree, 1, 0))


def check_passive(ratio: Ratio) -> None:
    """Raise `NotRealisableError` unless an admittance is positive real."""
    poles, corner = np.roots(ratio.below).astype(complex), ratio.corners().max()
    if np.any(np.real(poles) > _ROUNDING * np.abs(poles)):
        raise NotRealisableError("it is not stable")
    if len(ratio.above) > len(ratio.below) + 1:
        raise NotRealisableError("it grows faster than that of a capacitor")
    if len(poles) > _MOST_POLES:
        raise NotRealisableError(f"it has {len(poles)} poles, at most {_MOST_POLES} are tried")
    for n, pole in enumerate(poles):
        repeated = np.any(np.abs(np.delete(poles, n) - pole) <= _CANCELS * corner)
        if repeated or abs(np.real(pole)) > _ROUNDING * abs(pole):
            continue
        residue = np.polyval(ratio.above, pole) / np.polyval(np.polyder(ratio.below), pole)
        if not abs(np.imag(residue)) <= _CANCELS * np.real(residue):
            raise NotRealisableError(f"a resonance without losses generates power at {abs(pole) / (2 * np.pi):.4g} Hz")
    least, at = ratio.least_real_part()
    if least < -_ROUNDING * ratio.size():
        where = f"at {at / (2 * np.pi):.4g} Hz" if np.isfinite(at) else "towards high frequencies"
        raise NotRealisableError(f"its real part is negative {where}")


def _admittance(ratio: Ratio, *, copies: bool, inverted: bool = False) -> NetworkPart:
    """Part with an admittance, the sum of what lies in parallel: of the ways to split it the first that ends well.

    `copies`: where nothing can be split off, what remains is built twice, after Bott and Duffin.
    `inverted`: nothing was split off its inverse, so that inverting it again leads nowhere.
    """
    lossless, rest, constant = _without_axis_poles(ratio.cleaned())
    if len(rest.below) == 1 or not np.any(rest.above):
        return _parallel(lossless, constant, [])
    for terms, left in _splits(rest, constant):
        with suppress(NotRealisableError):
            return _parallel(lossless, left, [_admittance(term.inverse(), copies=copies).dual() for term in terms])
    whole = _raised(rest, constant)
    if not inverted or lossless:
        with suppress(NotRealisableError):
            return _parallel(lossless, 0.0, [_admittance(whole.inverse(), copies=False, inverted=True).dual()])
    if not copies:
        raise NotRealisableError
    least, at = whole.least_real_part()
    return _parallel(lossless, max(least, 0.0), [_twice(_raised(whole, -least), at)])


def _twice(ratio: Ratio, at: float) -> NetworkPart:
    """Part with an admittance whose real part is zero at a frequency in rad/s (Bott & Duffin).

    With F(jw) = jX, X > 0, and F(k)/k = X/w, R = (k F - s F(k))/(k F(k) - s F) is positive real and zero at jw, and
    F is the sum of 1/(1/(F(k) R) + s/(k F(k))) and 1/(k/(s F(k)) + R/F(k)).
    """
    if not 0 < at < np.inf:
        raise NotRealisableError
    slope = float(np.imag(np.polyval(ratio.above, 1j * at) / np.polyval(ratio.below, 1j * at))) / at
    if slope < 0:
        return _twice(ratio.inverse(), at).dual()
    above, below = ratio
    roots = np.roots(np.polysub(above, slope * np.polymul(below, [1.0, 0.0])))
    roots = roots[(np.abs(roots.imag) <= _ROUNDING * np.abs(roots)) & (roots.real > 0)].real
    if not slope > 0 or not len(roots):
        raise NotRealisableError
    k = float(roots[0])
    value, resonance = slope * k, np.array([1.0, 0.0, at**2])
    through = np.polysub(k * above, value * np.polymul(below, [1.0, 0.0]))
    zeros = np.polydiv(through, np.polymul([1.0, -k], resonance))[0]
    poles = np.polydiv(np.polysub(k * value * below, np.polymul(above, [1.0, 0.0])), [1.0, -k])[0]
    reactance = Ratio(value * np.polymul(zeros, resonance), poles)
    first = _admittance(reactance.inverse(), copies=True).dual()
    second = _admittance(Ratio(value * poles, np.polymul(zeros, resonance)), copies=True)
    return NetworkPart("parallel", parts=(
        NetworkPart("series", parts=(NetworkPart("L", 1.0 / (k * value)), first)),
        NetworkPart("series", parts=(NetworkPart("C", value / k), second)),
    ))  # fmt: skip


def _parallel(lossless: list[NetworkPart], conductance: float, others: list[NetworkPart]) -> NetworkPart:
    """Parts and a resistor side by side."""
    parts = [*lossless, *([NetworkPart("R", 1.0 / conductance)] if conductance > 0 else []), *others]
    if not parts:
        raise NotRealisableError
    return parts[0] if len(parts) == 1 else NetworkPart("parallel", parts=tuple(parts))


def _without_axis_poles(ratio: Ratio) -> tuple[list[NetworkPart], Ratio, float]:
    """Lossless parts of the poles on the imaginary axis and at infinity, the proper rest, and the constant."""
    quotient, remainder = np.polydiv(ratio.above, ratio.below)
    rising, constant = (quotient[0], quotient[1]) if len(quotient) == 2 else (0.0, quotient[0])
    if rising < 0:
        raise NotRealisableError
    poles = np.roots(ratio.below).astype(complex)
    on_axis = np.abs(np.real(poles)) <= _ROUNDING * np.abs(poles)
    poles = np.where(on_axis, 1j * np.imag(poles), poles)
    derivative = np.polyder(ratio.below)
    parts, removed = [NetworkPart("C", rising)] if rising else [], np.array([1.0])
    above = remainder
    for pole in poles[on_axis & (np.imag(poles) >= 0)]:
        residue = float(np.real(np.polyval(remainder, pole) / np.polyval(derivative, pole)))
        if not residue > 0:
            raise NotRealisableError
        factor = np.array([1.0, 0.0]) if pole == 0 else np.array([1.0, 0.0, pole.imag**2])
        own = np.array([residue]) if pole == 0 else np.array([2 * residue, 0.0])
        others = np.polydiv(ratio.below, factor)[0]
        above = np.polysub(above, np.polymul(own, others))
        removed = np.polymul(removed, factor)
        parts.append(_lossless(residue, pole.imag))
    rest = Ratio(np.polydiv(above, removed)[0], np.polydiv(ratio.below, removed)[0])
    return parts, rest, float(constant) if abs(constant) > _ROUNDING * rest.size() else 0.0


def _lossless(residue: float, frequency: float) -> NetworkPart:
    """An inductor, or a series resonance at a frequency in rad/s."""
    if not frequency:
        return NetworkPart("L", 1.0 / residue)
    return NetworkPart("series", parts=(NetworkPart("L", 0.5 / residue), NetworkPart("C", 2 * residue / frequency**2)))


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
