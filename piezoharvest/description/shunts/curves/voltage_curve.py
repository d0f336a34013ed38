"""Voltage of a part over its current as a broken line: diodes or a closed switch beyond a drop and a resistance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from piezoharvest.description.parameters import Component, ParameterError, quantity


@dataclass(frozen=True, kw_only=True)
class VoltageCurve(Component):
    """Voltage across a part over its current, as a table: linear between its points, and beyond the last one.

    Raises
    ------
    ParameterError
        There are fewer than two points, the currents do not increase from 0 A on, the voltages are not as many, or one
        of them is below the one before.
    """

    currents: tuple[float, ...] = quantity("A", "currents of the points, the first one 0", at_least=0)
    voltages: tuple[float, ...] = quantity("V", "voltages at these currents, none below the one before", at_least=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        currents = [_nominal(each) for each in self.currents]
        if len(currents) < 2 or currents[0] != 0 or np.any(np.diff(currents) <= 0):
            allowed = "must be at least two numbers that increase from 0 on"
            raise ParameterError("currents", f"found {currents}, {allowed}")
        if len(self.voltages) != len(self.currents):
            allowed = f"must be as many as currents ({len(self.currents)})"
            raise ParameterError("voltages", f"found {len(self.voltages)} numbers, {allowed}")
        if np.any(self.rises < 0):
            raise ParameterError("voltages", f"found {[_nominal(each) for each in self.voltages]}, must not fall")

    @classmethod
    def stepped(cls, currents: tuple[Any, ...], voltages: tuple[Any, ...]) -> Self:
        """A curve whose numbers may have complex steps, one for each design of a batch; they are not checked."""
        curve = cls.__new__(cls)
        curve.__dict__.update(currents=currents, voltages=voltages)
        return curve

    @property
    def rises(self) -> np.ndarray:
        """Rise of the voltage in each piece, V, without complex steps."""
        return np.diff([_nominal(each) for each in self.voltages])

    @property
    def resistances(self) -> np.ndarray:
        """Resistance of each piece, ohm, without complex steps."""
        return self.rises / np.diff([_nominal(each) for each in self.currents])

    @property
    def pieces(self) -> int:
        """Number of straight pieces."""
        return len(self.currents) - 1

    def piece(self, k: int) -> tuple[Any, Any]:
        """Voltage (V) at no current and resistance (ohm) of the line that goes through the k-th piece."""
        (i, j), (v, w) = self.currents[k : k + 2], self.voltages[k : k + 2]
        resistance = (w - v) / (j - i)
        return v - resistance * i, resistance

    def plus(self, other: VoltageCurve) -> VoltageCurve:
        """Both in series: with the corners of both, one of two at the same current."""
        currents = {_nominal(each): each for each in (*self.currents, *other.currents)}
        corners = tuple(currents[key] for key in sorted(currents))
        return VoltageCurve.stepped(corners, tuple(self.at(each) + other.at(each) for each in corners))

    def at(self, current: Any) -> Any:
        """Voltage (V) at one current (A)."""
        k = sum(_nominal(current) >= _nominal(each) for each in self.currents[1:-1])
        voltage, resistance = self.piece(k)
        return voltage + resistance * current


def _nominal(value: Any) -> float:
    """A number without its complex steps."""
    return float(np.ravel(np.asarray(value, complex))[0].real)
