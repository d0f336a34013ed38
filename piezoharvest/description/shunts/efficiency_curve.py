"""Efficiency of a converter as a table, over the power of its load or the voltage before it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.description.parameters import Component, ParameterError, quantity


@dataclass(frozen=True, kw_only=True)
class EfficiencyCurve(Component):
    """Efficiency between the points of a table, straight over the voltage, or over the logarithm of the power.

    That is how data sheets draw them. Beyond its ends the table is continued as a constant.

    Raises
    ------
    ParameterError
        Neither or both of `powers` and `voltages` are given, they do not increase, or they are not as many as the
        `efficiencies`.
    """

    efficiencies: tuple[float, ...] = quantity("", "fraction of the power that reaches the load", above=0, at_most=1)
    powers: tuple[float, ...] | None = quantity("W", "load powers for these efficiencies", default=None, above=0)
    voltages: tuple[float, ...] | None = quantity(
        "V", "or storage voltages for these efficiencies", default=None, above=0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.powers is None) == (self.voltages is None):
            found = "neither powers nor" if self.powers is None else "both powers and"
            raise ParameterError("powers", f"found {found} voltages, give one of the two")
        key = "powers" if self.voltages is None else "voltages"
        places = getattr(self, key)
        if not len(places) == len(self.efficiencies) > 0:
            allowed = f"must be as many as efficiencies ({len(self.efficiencies)}), and at least one"
            raise ParameterError(key, f"found {counted(len(places), 'number')}, {allowed}")
        if np.any(np.diff(places) <= 0):
            raise ParameterError(key, f"found {list(places)}, must increase")

    def at(self, power: Any, voltage: Any) -> Any:
        """Efficiency at a power (W) of the load and a voltage (V) of the store; either may have a complex step."""
        if self.voltages is not None:
            return _between(voltage, np.array(self.voltages), np.array(self.efficiencies))
        assert self.powers is not None  # or voltages
        least = np.where(np.real(power) > 0, power, self.powers[0])
        return _between(np.log(least), np.log(self.powers), np.array(self.efficiencies))


def _between(x: Any, places: np.ndarray, values: np.ndarray) -> Any:
    """Linear interpolation that keeps the derivative of a complex step; constant beyond the ends."""
    slopes = np.concatenate([[0.0], np.diff(values) / np.diff(places), [0.0]])
    real: Any = np.real(x)
    piece = sum(np.asarray(real > place, int) for place in places)
    begin = np.maximum(piece - 1, 0)
    return values[begin] + slopes[piece] * (x - places[begin])
