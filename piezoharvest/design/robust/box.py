"""The box of all values within a tolerance, and a transducer, a shunt and an excitation anywhere in it.

A point of the box has one coordinate for each axis, in the units of the tolerance's keys: relative deviations from the
study's values, and the temperature's in K. Deviations of one quantity multiply: k (1 + d_k) (1 + a_k dT). The
confidence region of a specimen has the first axes: a ball in the cube from -1 to 1, to whose surface points outside of
it are moved.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from piezoharvest.description.excitation import Excitation
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import LinearShunt, Shunt
from piezoharvest.description.shunts.switching import InductiveSwitch
from piezoharvest.description.tolerance import HEATED, Tolerance
from piezoharvest.description.transducer import Transducer
from piezoharvest.design.operation import Operation, is_sine
from piezoharvest.design.robust.specimen import ConfidenceRegion

OF_TRANSDUCER = ("mass", "damping", "stiffness", "coupling", "capacitance")
_OF_MODES = OF_TRANSDUCER[:4]
_STEP = 1e-6  # of a half-width, for the derivative of a switched loop's fields, which are smooth


@dataclass(frozen=True, eq=False)
class Box:
    """Axes of a tolerance that a shunt and an operation have.

    Attributes
    ----------
    names : tuple of str
        Axes: keys of the tolerance.
    widths : (d,) array
        Half-widths, relative or in K.
    coefficients : mapping of str to float
        Temperature coefficients in 1/K by quantity.
    region : ConfidenceRegion
        That of a specimen; its axes come first.
    """

    names: tuple[str, ...]
    widths: np.ndarray
    coefficients: Mapping[str, float]
    region: ConfidenceRegion = field(default_factory=ConfidenceRegion)

    @classmethod
    def of(
        cls, tolerance: Tolerance, shunt: Shunt, operation: Operation, region: ConfidenceRegion | None = None
    ) -> Box:
        """Box of a tolerance and the region of its specimen; a load that the shunt has not is left out.

        Raises
        ------
        ParameterError
            A frequency varies that the excitation has not.
        """
        widths = dict(tolerance.widths)
        if "frequency" in widths and (operation.band is not None or not is_sine(operation.excitation)):
            given = "a band, which holds its frequencies already" if operation.band else operation.excitation.kind
            found = f"found {widths['frequency']:g} with {given}"
            raise ParameterError("design.tolerance.frequency", f"{found}, only a sine of one frequency may have it")
        if load_field(shunt) is None:
            widths.pop("load", None)
        region = region or ConfidenceRegion()
        axes = {f"region {n}": 1.0 for n in range(len(region.names))} | widths
        return cls(tuple(axes), np.array(list(axes.values())), tolerance.coefficients, region)

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Smallest and largest coordinate on each axis."""
        return [(-float(width), float(width)) for width in self.widths]

    def corner(self, point: np.ndarray) -> dict[str, float]:
        """Relative deviations (that of the temperature in K) at a point."""
        return {name: float(value) for name, value in self._along(point).items()}

    def _along(self, points: np.ndarray) -> dict[str, np.ndarray]:
        """Deviations at points (..., d) by quantity."""
        size = len(self.region.names)
        deviations = self.region.inside(points[..., :size]) @ self.region.spread.T
        found = dict(zip(self.region.names, np.moveaxis(deviations, -1, 0), strict=True))
        return found | dict(zip(self.names[size:], np.moveaxis(points[..., size:], -1, 0), strict=True))

    def random(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Points (count, d): uniform within half-widths, of the Gaussian within the region of a specimen."""
        size = len(self.region.names)
        points = rng.uniform(-1, 1, (count, len(self.names))) * self.widths
        points[:, :size] = self.region.drawn(rng, count)
        return points

    def beyond(self, centre: np.ndarray, radius: np.ndarray | float = 0.0) -> np.ndarray:
        """True (n,) for boxes with centres and half-widths (n, d) all of which is outside of the region."""
        size = len(self.region.names)
        nearest = np.maximum(np.abs(centre) - radius, 0.0)[:, :size]
        return np.sum(nearest**2, axis=1) > 1.0

    def factors(self, points: np.ndarray) -> dict[str, Any]:
        """Factor of each quantity at a point (d,), or at points (n, d) as columns (n, 1)."""
        along = self._along(points)
        heat = along.get("temperature", 0.0)
        found = {}
        for name in (*OF_TRANSDUCER, "load", "frequency"):
            change = self.coefficients.get(name, 0.0) if name in HEATED else 0.0
            factor = (1 + along.get(name, 0.0)) * (1 + change * heat)
            found[name] = np.asarray(factor)[:, None] if np.ndim(factor) else float(factor)
        return found

    def log_slopes(self, point: np.ndarray) -> dict[str, np.ndarray]:
        """Derivatives (d,) of the logarithm of each quantity's factor at a point."""
        size, found, along = len(self.region.names), {}, self._along(point)
        pull = dict(zip(self.region.names, self.region.pull(point[:size]), strict=True))
        for name in (*OF_TRANSDUCER, "load", "frequency"):
            slope = np.zeros(len(self.names))
            for n, axis in enumerate(self.names[size:], size):
                change = self.coefficients.get(name, 0.0) if axis == "temperature" else float(axis == name)
                slope[n] = change / (1 + change * point[n])
            if name in pull:
                slope[:size] = pull[name] / (1 + along[name])
            found[name] = slope
        return found

    def transducer(self, nominal: Transducer, points: np.ndarray) -> Transducer:
        """The transducer at a point, or a batch of them."""
        factors = self.factors(points)

        def changed(part: Any) -> dict[str, Any]:
            values = {name: getattr(part, name) * factors[name] for name in _OF_MODES}
            own = part.effective_mass
            return values | {"effective_mass": None if own is None else own * factors["mass"]}

        modes = tuple(dataclasses.replace(mode, **changed(mode)) for mode in nominal.modes)
        capacitance = nominal.capacitance * factors["capacitance"]
        return dataclasses.replace(nominal, **changed(nominal), capacitance=capacitance, modes=modes)

    def shunt(self, nominal: Shunt, points: np.ndarray, capacitance: float) -> Shunt:
        """The shunt at a point, or a batch of them: another load, and a switched loop made for the nominal capacitance.

        Coil, resistance and on time of the loop stay as they were chosen for `capacitance` (F).
        """
        factors, field, values = self.factors(points), load_field(nominal), {}
        if field is not None:
            values[field] = getattr(nominal, field) * factors["load"]
        if isinstance(nominal, InductiveSwitch) and np.any(factors["capacitance"] != 1):
            nominal = nominal.beside(capacitance, capacitance * factors["capacitance"])
        return dataclasses.replace(nominal, **values)

    def excitation(self, nominal: Excitation, points: np.ndarray) -> Excitation:
        """The excitation at a point, or a batch of them."""
        if "frequency" not in self.names:
            return nominal
        frequency: Any = nominal.frequency  # pyright: ignore[reportAttributeAccessIssue]
        return dataclasses.replace(nominal, frequency=frequency * self.factors(points)["frequency"])

    def moves(
        self, quantities: tuple[str, ...], values: np.ndarray, shunt: Shunt, point: np.ndarray, capacitance: float
    ):
        """Changes (d, q) of the quantities of a gradient, at their values there, along each axis.

        `shunt` and `capacitance` (F) are the nominal ones.
        """
        slopes, found = self.log_slopes(point), np.zeros((len(self.names), len(quantities)))
        loop = self._loop_slopes(shunt, point, capacitance)
        for n, path in enumerate(quantities):
            part, *inner = path.split(".")
            name = inner[-1].replace("effective_mass", "mass")
            if part == "transducer" and inner[0] not in ("effects", "hysteresis") and name in slopes:
                found[:, n] = values[n] * slopes[name]
            elif part == "shunt" and len(inner) == 1 and name == load_field(shunt):
                found[:, n] = values[n] * slopes["load"]
            elif part == "shunt" and name in loop:
                found[:, n] = loop[name]
            elif path == "excitation.frequency":
                found[:, n] = values[n] * slopes["frequency"]
        return found

    def _loop_slopes(self, shunt: Shunt, point: np.ndarray, capacitance: float) -> dict[str, np.ndarray]:
        """Derivatives (d,) of the fields of a switched loop along each axis."""
        if not isinstance(shunt, InductiveSwitch):
            return {}
        steps = _STEP * np.diag(self.widths)
        ahead, behind = (
            [self.shunt(shunt, point + sign * step, capacitance) for step in steps] for sign in (1.0, -1.0)
        )
        return {
            name: np.array([getattr(a, name) - getattr(b, name) for a, b in zip(ahead, behind, strict=True)])
            / (2 * _STEP * self.widths)
            for name in ("quality", "on_time_error")
        }


def load_field(shunt: Shunt) -> str | None:
    """Field of a shunt that is its load's resistance; None without one, and in a netlist."""
    if getattr(shunt, "load_resistance", None) is not None:
        return "load_resistance"
    return "resistance" if isinstance(shunt, LinearShunt) and hasattr(shunt, "resistance") else None
