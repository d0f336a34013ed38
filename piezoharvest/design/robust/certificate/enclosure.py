"""Enclosure of a linear candidate's objective over boxes, from the equations of the transducer and of its circuit.

Unknown are the displacements of the modes, the electrode voltage, the load current and the circuit's states:
(k - m w^2 + j w b) x - T v = F, j w (C v + sum T x) + i = 0, and the circuit's own equations, which are linear in j w.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from operator import add
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.description.circuit import Port
from piezoharvest.description.shunts import Shunt
from piezoharvest.description.tolerance import HEATED
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.operation import mean_nodes
from piezoharvest.design.robust.box import OF_TRANSDUCER, Box, load_field
from piezoharvest.design.robust.certificate.forms import AffineForm, solve

_LINEAR = 1e-12  # relative: coefficients that are linear in the load, but for rounding errors
# Of the mean over a band, relative: that of the study's transducer, and what is taken off for any in the box, whose
# damping may be two thirds of it (the error's logarithm is in proportion to the damping).
_NODES_ERROR, _MEAN_ERROR, _MOST_NODES = 1e-6, 1e-4, 400


@dataclass(frozen=True, eq=False)
class Enclosure:
    """Bounds of one candidate's objective over boxes: coordinates of the tolerance, then the place in the band.

    Attributes
    ----------
    view : LinearView
        The study's transducer, without hysteresis and effects, under a sine.
    shunt : LinearShunt
    box : Box
    """

    view: LinearView
    shunt: Shunt
    box: Box

    @property
    def possible(self) -> bool:
        """True if the objective of this candidate can be enclosed."""
        transducer = self.view.transducer
        if transducer.hysteresis is not None or transducer.effects or not self.view.operation.apart:
            return False
        return self._circuit is not None

    @property
    def swept(self) -> bool:
        """True if the frequency in the band is a coordinate: of the worst peak, not of a mean."""
        return self.view.goal.damping and self.view.operation.band is not None

    @property
    def widths(self) -> np.ndarray:
        """Half-widths (d,) of the whole box; the place in the band is from -1 to 1."""
        return np.append(self.box.widths, [1.0] if self.swept else [])

    @property
    def systems(self) -> int:
        """Systems of equations solved for one box."""
        return len(self._lines[0])

    @cached_property
    def _lines(self) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies in Hz at which boxes are enclosed, and the squares of the drive by which powers add up."""
        operation = self.view.operation
        if self.swept or operation.band is None:
            return operation.frequencies[:1], operation.squares[:1]
        nodes, weights = mean_nodes(operation.band, self.view.transducer, _NODES_ERROR, _MOST_NODES)
        return nodes, weights * operation.amplitude**2

    @property
    def _mean_error(self) -> float:
        return 0.0 if self.view.operation.band is None else _MEAN_ERROR

    def bounds(self, centre: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Objective over boxes with centres and half-widths (b, d).

        Returns
        -------
        worst, middle : (b,) array
            What no point of the box is worse than, and the value at its middle: power in W, or displacement in m.
        influence : (b, d) array
            Share by which each coordinate may change the solution to first order.
        """
        count, boxes = self.systems, len(centre)
        centre, radius = np.repeat(centre, count, axis=0), np.repeat(radius, count, axis=0)
        factors = self._factors(centre, radius)
        found = self._solution(2 * np.pi * self._frequency(centre, radius, factors), factors)
        with np.errstate(all="ignore"):
            share = np.nan_to_num(np.abs(found.slope) / np.abs(found.value)[..., None], posinf=0.0)
        influence = share.max(0).reshape(boxes, count, -1).max(1)
        part = self._objective(found, factors)
        if self.view.goal.damping:
            return self._amplitude * part.largest(), self._amplitude * np.abs(part.value), influence
        total = _mean(part, self._lines[1], boxes)
        middle = part.value.reshape(boxes, count) @ self._lines[1]
        return np.maximum(total.least(), 0.0) * (1 - self._mean_error), middle, influence

    @property
    def _amplitude(self) -> float:
        return self.view.operation.amplitude

    def _factors(self, centre: np.ndarray, radius: np.ndarray) -> dict[str, AffineForm]:
        """Factor of each quantity, as `Box.factors`, and "deviation" of the load."""
        names = self.box.names
        axes = [AffineForm.coordinate(centre, radius, n) for n in range(len(names))]
        region, along = self.box.region, dict(zip(names, axes, strict=True))
        for name, row in zip(region.names, region.spread, strict=True):
            along[name] = reduce(add, (axis * share for axis, share in zip(axes, row.tolist(), strict=False)))
        one = AffineForm(np.ones(len(centre)), np.zeros_like(centre), np.zeros(len(centre)))
        found = {}
        for name in (*OF_TRANSDUCER, "load", "frequency"):
            found[name] = one + along[name] if name in along else one
            change = self.box.coefficients.get(name, 0.0) if name in HEATED else 0.0
            if change and "temperature" in along:
                found[name] = found[name] * (along["temperature"] * change + 1.0)
        found["deviation"] = along.get("load", one * 0.0)
        return found

    def _frequency(self, centre: np.ndarray, radius: np.ndarray, factors: dict[str, AffineForm]) -> AffineForm:
        band = self.view.operation.band
        if not self.swept or band is None:
            return factors["frequency"] * np.tile(self._lines[0], len(centre) // self.systems)
        place = AffineForm.coordinate(centre, radius, centre.shape[1] - 1)
        return place * (0.5 * (band[1] - band[0])) + 0.5 * (band[0] + band[1])

    def _solution(self, omega: AffineForm, factors: dict[str, AffineForm]) -> AffineForm:
        """Unknowns (n, b) for a unit drive."""
        transducer, circuit = self.view.transducer, self._circuit
        assert circuit is not None
        modes, base = transducer.all_modes, self.view.operation.base
        count, size = len(modes), len(modes) + 2 + circuit.states
        matrix: list[list[AffineForm | None]] = [[None] * size for _ in range(size)]
        right: list[AffineForm | None] = [None] * size
        rate, square = omega * 1j, omega * omega
        for n, mode in enumerate(modes):
            inertia = factors["mass"] * square * (-mode.mass)
            matrix[n][n] = factors["stiffness"] * mode.stiffness + inertia + factors["damping"] * rate * mode.damping
            coupling = factors["coupling"] * mode.coupling
            matrix[n][count], matrix[count][n] = coupling * (-1.0), rate * coupling
            one = omega * 0.0 + 1.0
            right[n] = factors["mass"] * (-mode.base_mass) if base else one * mode.force_participation
        matrix[count][count] = rate * factors["capacitance"] * transducer.capacitance
        matrix[count][count + 1] = omega * 0.0 + 1.0
        for row in range(circuit.states + 1):
            for column in range(circuit.states + 2):
                parts = [c[row, column] for c in (circuit.still, circuit.rate, circuit.still_load, circuit.rate_load)]
                if any(parts):
                    still, by_rate, load, rate_load = parts
                    form = omega * 0.0 + still + rate * by_rate + factors["deviation"] * load
                    matrix[count + 1 + row][count + column] = form + rate * factors["deviation"] * rate_load
        return solve(matrix, right)

    def _objective(self, found: AffineForm, factors: dict[str, AffineForm]) -> AffineForm:
        """Displacement of a unit drive, or the mean harvested power (half of the peak values' product)."""
        count = len(self.view.transducer.all_modes)
        if self.view.goal.damping:
            shares = [mode.seen for mode in self.view.transducer.all_modes]
            return _combined(found, np.array([*shares, *np.zeros(len(found.value) - count)]))
        assert self._circuit is not None
        total = None
        for coefficient, first, second in self._circuit.powers:
            rows = (np.concatenate((np.zeros(count), row)) for row in (first, second))
            power = _combined(found, next(rows)).real_product(_combined(found, next(rows)))
            scale, inverted = coefficient
            factor = factors["load"].inverse() if inverted else factors["load"] if inverted is not None else None
            power = power * (0.5 * scale)
            power = power if factor is None else power * factor
            total = power if total is None else total + power
        return total if total is not None else _combined(found, np.zeros(len(found.value))).real_product(
            _combined(found, np.zeros(len(found.value))))  # fmt: skip

    @cached_property
    def _circuit(self) -> _Circuit | None:
        return _circuit(self.shunt, self.view.transducer.capacitance, "load" in self.box.names)


@dataclass(frozen=True)
class _Circuit:
    """Equations (n + 1, n + 2) of a circuit in [v, i, states], and what of them comes with j w and a deviating load.

    `powers` holds ((coefficient, inverted), first, second): the coefficient grows with the load (False), falls with it
    (True) or does neither (None).
    """

    states: int
    still: np.ndarray
    rate: np.ndarray
    still_load: np.ndarray
    rate_load: np.ndarray
    powers: Sequence[tuple[tuple[float, bool | None], np.ndarray, np.ndarray]]


def _circuit(shunt: Shunt, capacitance: float, loaded: bool) -> _Circuit | None:
    """Equations of a circuit; None where they are not linear in the load."""
    field = load_field(shunt) if loaded else None
    at = [shunt] if field is None else [replace(shunt, **{field: f * getattr(shunt, field)}) for f in (1.0, 2.0, 3.0)]
    found = [_columns(one, capacitance) for one in at]
    first, slopes = found[0], (np.zeros_like(found[0].still), np.zeros_like(found[0].rate))
    if field is not None:
        a, b, c = found
        slopes = b.still - a.still, b.rate - a.rate
        for x, y, z in ((a.still, b.still, c.still), (a.rate, b.rate, c.rate)):
            if np.max(np.abs(z - 2 * y + x), initial=0.0) > _LINEAR * np.max(np.abs(x), initial=0.0):
                return None
    powers = []
    for products in zip(*(f.powers for f in found), strict=True):
        growth = _growth([p[0] for p in products])
        moved = any(not np.array_equal(p[k], products[0][k]) for p in products for k in (1, 2))
        if growth == "neither" or moved:
            return None
        powers.append(((products[0][0], growth), products[0][1], products[0][2]))
    return _Circuit(len(first.still) - 1, first.still, first.rate, *slopes, powers)


def _growth(coefficients: Sequence[float]) -> Any:
    """False where coefficients at one, two and three times a load are in proportion, True inversely, None if equal."""
    relative = np.array(coefficients) / coefficients[0]
    for shape, answer in ((np.ones(3), None), (np.arange(1.0, 4.0), False), (1 / np.arange(1.0, 4.0), True)):
        if np.allclose(relative, shape[: len(relative)], rtol=_LINEAR, atol=0):
            return answer
    return "neither"


class _Influences(NamedTuple):
    """Equations at rest and by the rate, and products of harvested power."""

    still: np.ndarray
    rate: np.ndarray
    powers: list[tuple[float, np.ndarray, np.ndarray]]


def _columns(shunt: Shunt, capacitance: float) -> _Influences:
    """Equations at rest and by the rate, and products of harvested power, over [v, i, states]."""
    names = tuple(state.name for state in shunt.states(capacitance))
    n = len(names)
    eye = np.eye(2 * n + 4)
    z = SimpleNamespace(**dict(zip(names, eye[:n], strict=True)))
    dz = SimpleNamespace(**dict(zip(names, eye[n : 2 * n], strict=True)))
    v, dv, i, one = eye[2 * n :]
    port = Port(v, dv, i, one, capacitance)
    rows = np.array(shunt.equations("linear", port, z, dz))
    columns = [2 * n, 2 * n + 2, *range(n)]
    still, rate = rows[:, columns], np.zeros((n + 1, n + 2))
    rate[:, 0], rate[:, 2:] = rows[:, 2 * n + 1], rows[:, n : 2 * n]
    harvested = shunt.powers("linear", port, z).get("harvested", ())
    return _Influences(still, rate, [(float(p.coefficient), p.first[columns], p.second[columns]) for p in harvested])  # pyright: ignore


def _mean(part: AffineForm, squares: np.ndarray, boxes: int) -> AffineForm:
    """Sum of powers at the lines of each box; one that may be anything is at least zero, and is taken to be so."""
    open_ = ~(part.rest < np.abs(part.value))
    value, rest = (np.where(open_, 0.0, x).reshape(boxes, -1) @ squares for x in (part.value, part.rest))
    slope = np.where(open_[:, None], 0.0, part.slope).reshape(boxes, len(squares), -1)
    return AffineForm(value, np.einsum("bfd,f->bd", slope, squares), rest)


def _combined(found: AffineForm, row: np.ndarray) -> AffineForm:
    """A row of the unknowns."""
    rest = np.zeros(found.rest.shape[1])
    for share, part in zip(np.abs(row), found.rest, strict=True):
        if share:  # zero times infinity is none
            rest = rest + share * part
    return AffineForm(row @ found.value, np.tensordot(row, found.slope, 1), rest)
