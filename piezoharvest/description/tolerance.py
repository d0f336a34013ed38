"""Intervals in which the quantities of a study may lie: the table [design.tolerance]."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

from piezoharvest.description.parameters import Component, ParameterError, described, quantity

HEATED = ("stiffness", "coupling", "capacitance", "damping")  # what a temperature changes


def _width(doc: str):
    return quantity("", f"relative half-width of {doc}", default=None, at_least=0, below=1)


def _coefficient(doc: str):
    return quantity("1/K", f"relative change of {doc} per kelvin", default=None)


@dataclass(frozen=True, kw_only=True)
class Tolerance(Component):
    """Half-widths of the intervals about the values of a study; a quantity without one is exact.

    Stiffness, mass, damping and coupling are those of all modes together. `load` and `load_resistance` are two names of
    one key: the resistance that is harvested in. `from_` is a specimen file: the confidence region of its values at
    `level`, correlations included, without those that a key of this table says otherwise of.

    Raises
    ------
    ParameterError
        Nothing is given, the load twice, a temperature without a coefficient or the other way round, or a coefficient
        that takes its quantity to zero within the temperatures.
    """

    from_: str | None = described("specimen file, within whose confidence region the specimen may vary", default=None)
    level: float | None = quantity(
        "", "probability of the specimen's confidence region", default=None, at_least=0.5, at_most=0.9999
    )
    stiffness: float | None = _width("the stiffness of all modes")
    mass: float | None = _width("the mass of all modes")
    damping: float | None = _width("the damping of all modes")
    coupling: float | None = _width("the coupling of all modes")
    capacitance: float | None = _width("the clamped capacitance")
    load: float | None = _width("the load resistance")
    load_resistance: float | None = _width("the load resistance")
    frequency: float | None = _width("the frequency of a sine excitation")
    temperature: float | None = quantity("K", "half-width of the temperature", default=None, at_least=0)
    temperature_coefficient_stiffness: float | None = _coefficient("the stiffness of all modes")
    temperature_coefficient_coupling: float | None = _coefficient("the coupling of all modes")
    temperature_coefficient_capacitance: float | None = _coefficient("the clamped capacitance")
    temperature_coefficient_damping: float | None = _coefficient("the damping of all modes")

    def __post_init__(self) -> None:
        super().__post_init__()
        given = [f.name for f in dataclasses.fields(self) if getattr(self, f.name) is not None and f.name != "level"]
        if not given:
            raise ParameterError("stiffness", "missing key, a tolerance needs at least one half-width or from = a file")
        if self.level is not None and self.from_ is None:
            raise ParameterError("level", f"found {self.level:g} without from = a specimen file, which it needs")
        if self.load is not None and self.load_resistance is not None:
            raise ParameterError(
                "load_resistance", "found together with load, which means the same, but only one is allowed"
            )
        if self.temperature is None and self.coefficients:
            raise ParameterError("temperature", "missing key, a temperature coefficient needs this half-width (K)")
        if self.temperature is not None and not self.coefficients:
            needed = " or ".join(f"temperature_coefficient_{name}" for name in HEATED)
            raise ParameterError("temperature", f"found without a coefficient, it needs {needed} (1/K)")
        for name, change in self.coefficients.items():
            if abs(change) * (self.temperature or 0.0) >= 1:
                found = f"found {change:g} with temperature = {self.temperature:g}"
                allowed = "less than one over that temperature, so that the quantity keeps its sign"
                raise ParameterError(f"temperature_coefficient_{name}", f"{found}, must be {allowed}")

    @property
    def coefficients(self) -> Mapping[str, float]:
        """Temperature coefficients (1/K) by the quantity that they change."""
        found = {name: getattr(self, f"temperature_coefficient_{name}") for name in HEATED}
        return {name: float(value) for name, value in found.items() if value is not None}

    @property
    def widths(self) -> Mapping[str, float]:
        """Half-widths above zero by axis: relative, the temperature's in K."""
        named = {name: getattr(self, name) for name in ("stiffness", "mass", "damping", "coupling", "capacitance")}
        load = self.load if self.load is not None else self.load_resistance
        named |= {"load": load, "frequency": self.frequency, "temperature": self.temperature}
        return {name: float(value) for name, value in named.items() if value}
