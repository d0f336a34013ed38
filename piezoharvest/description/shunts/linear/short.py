"""Shorted electrodes."""

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from piezoharvest.description.circuit import Port, Row
from piezoharvest.description.shunts.base import LinearShunt


@dataclass(frozen=True, kw_only=True)
class Short(LinearShunt):
    """Short circuit: the electrode voltage is zero. With hysteresis, charge and strain still form a loop."""

    kind: ClassVar[str] = "short"
    shorts: ClassVar[bool] = True
    loaded: ClassVar[bool] = False
    source: ClassVar[str] = "IEEE Std 176-1987"

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        return [port.dv]
