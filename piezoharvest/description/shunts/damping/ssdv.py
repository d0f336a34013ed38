"""Synchronised switch damping with a voltage source."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.bridge import sign_of
from piezoharvest.description.shunts.real_coil import WoundSwitch


@dataclass(frozen=True, kw_only=True)
class SSDV(WoundSwitch):
    """SSDI with a voltage source in the loop, which increases the inverted voltage and delivers the energy for it.

    At a maximum of sum T_i x_i the voltage is at its minimum; the source then drives it upwards.
    """

    kind: ClassVar[str] = "ssdv"
    source: ClassVar[str] = "Lefeuvre, Badel, Petit, Richard & Guyomar, J. Intell. Mater. Syst. Struct. 17, 2006"

    source_voltage: float = quantity("V", "voltage of the source in the loop", at_least=0)

    def states(self, capacitance: float) -> tuple[State, ...]:
        return self.real_coil(capacitance).states()

    def configurations(self) -> tuple[str, ...]:
        return ("open", "closed+", "closed-")

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        sign = sign_of(configuration)
        drive, coil = self._drive(sign, port), self.real_coil(port.capacitance)
        current = coil.current(bool(sign), drive, port, z)
        return [port.i - current, *coil.equations(bool(sign), drive, port, z, dz)]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        sign = sign_of(configuration)
        drive, coil = self._drive(sign, port), self.real_coil(port.capacitance)
        current = coil.current(bool(sign), drive, port, z)
        return {
            "shunt_loss": coil.losses(bool(sign), drive, port, z),
            "source": [Product(-sign * self.source_voltage, port.one, current)],
        }

    def _drive(self, sign: int, port: Port) -> Row:
        """Voltage across the coil with its resistance."""
        return port.v - sign * self.source_voltage * port.one

    def closed(self, configuration: str, polarity: int) -> str:
        return "closed+" if polarity > 0 else "closed-"

    def opened(self, configuration: str) -> str:
        return "open"
