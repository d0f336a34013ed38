"""Voltage of a part over its current as a broken line: diodes or a closed switch beyond a drop and a resistance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from piezoharvest.description.parameters import ParameterError, quantity
from piezoharvest.description.shunts.curves.broken_line import BrokenLine, nominal


@dataclass(frozen=True, kw_only=True)
class VoltageCurve(BrokenLine):
    """Voltage across a part over its current, as a table: linear between its points, and beyond the last one.

    Raises
    ------
    ParameterError
        There are fewer than two points, the currents do not increase from 0 A on, the voltages are not as many, or one
        of them is below the one before.
    """

    over: ClassVar[str] = "currents"
    of: ClassVar[str] = "voltages"

    currents: tuple[float, ...] = quantity("A", "currents of the points, the first one 0", at_least=0)
    voltages: tuple[float, ...] = quantity("V", "voltages at these currents, none below the one before", at_least=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if np.any(self.rises < 0):
            raise ParameterError("voltages", f"found {[nominal(each) for each in self.voltages]}, must not fall")
