"""Open electrodes."""

from dataclasses import dataclass
from typing import ClassVar

from piezoharvest.description.shunts.base import LinearShunt


@dataclass(frozen=True, kw_only=True)
class Open(LinearShunt):
    """No load: no current leaves the electrodes."""

    kind: ClassVar[str] = "open"
    source: ClassVar[str] = "IEEE Std 176-1987"

    def equations(self, configuration, port, z, dz):
        return [port.i]
