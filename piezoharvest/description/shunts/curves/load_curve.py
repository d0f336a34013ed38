"""Current of a dc load over its voltage as a broken line: LEDs, a Zener diode, a converter beside a resistance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from piezoharvest.description.parameters import ParameterError, quantity
from piezoharvest.description.shunts.curves.broken_line import BrokenLine, nominal


@dataclass(frozen=True, kw_only=True)
class LoadCurve(BrokenLine):
    """Current of a load over its voltage, as a table: linear between its points, and beyond the last one.

    It may fall, as that of a converter with constant power does.

    Raises
    ------
    ParameterError
        There are fewer than two points, the voltages do not increase from 0 V on, the currents are not as many, the
        first one is not 0, or the last piece falls, so that the load would give power at higher voltages.
    """

    over: ClassVar[str] = "voltages"
    of: ClassVar[str] = "currents"

    voltages: tuple[float, ...] = quantity("V", "voltages of the points, the first one 0", at_least=0)
    currents: tuple[float, ...] = quantity("A", "currents at these voltages, the first one 0", at_least=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        currents = [nominal(each) for each in self.currents]
        if currents[0] != 0:
            raise ParameterError("currents", f"found {currents[0]:g} A at 0 V, must be 0")
        if self.rises[-1] < 0:
            raise ParameterError("currents", f"found {currents}, must not fall in the last piece, which goes on")
