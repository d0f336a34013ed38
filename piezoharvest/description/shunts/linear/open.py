"""Open electrodes."""

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from piezoharvest.description.circuit import Port, Row
from piezoharvest.description.shunts.base import LinearShunt


@dataclass(frozen=True, kw_only=True)
class Open(LinearShunt):
    """No load: no current leaves the electrodes."""

    kind: ClassVar[str] = "open"
    source: ClassVar[str] = "IEEE Std 176-1987"
    loaded: ClassVar[bool] = False

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        return [port.i]
