"""Synchronised switch harvesting on inductor, series: the inductor in line with the bridge."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.shunts.bridge import Bridge, sign_of
from piezoharvest.description.shunts.real_coil import WoundSwitch


@dataclass(frozen=True, kw_only=True)
class SeriesSSHI(WoundSwitch, Bridge):
    """Switch, inductor and rectifier in series: charge flows to the dc side only while the switch is closed.

    While the switch is open, so are the electrodes. Reverse leakage of the diodes between the electrodes is neglected,
    as it is small compared with the leakage that discharges the dc side all the time. If the switch is closed too long,
    the bridge blocks at zero current until |v| exceeds the dc voltage again.
    """

    kind: ClassVar[str] = "series_sshi"
    source: ClassVar[str] = "Taylor, Burns, Kammann, Powers & Welsh, IEEE J. Ocean. Eng. 26(4), 539-547, 2001"

    def states(self, capacitance: float) -> tuple[State, ...]:
        return (*self.real_coil(capacitance).states(), *self.bridge_states())

    def configurations(self) -> tuple[str, ...]:
        return ("open", "closed", "closed+", "closed-")

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        sign, drive, line = self._drive(configuration, port, z)
        coil = self.real_coil(port.capacitance)
        current = coil.current(bool(sign), drive, port, z, line)
        own = coil.equations(bool(sign), drive, port, z, dz, line)
        return [port.i - current, *own, *self.dc_equations(sign * current, port, z, dz)]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        sign, drive, line = self._drive(configuration, port, z)
        coil = self.real_coil(port.capacitance)
        powers = self.bridge_powers(sign * coil.current(bool(sign), drive, port, z, line), port, z)
        powers["shunt_loss"] += coil.losses(bool(sign), drive, port, z, line)
        return powers

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        (sign, drive, line), coil = self._drive(configuration, port, z), self.real_coil(port.capacitance)
        if configuration == "open":
            return []
        if sign:
            return [Guard(-sign * coil.current(True, drive, port, z, line), "closed", coil.ended)]
        across = coil.blocked_voltage(z)
        return [Guard(self.excess(s, port, z) - s * across, f"closed{mark}") for s, mark in ((1, "+"), (-1, "-"))]

    def closed(self, configuration: str, polarity: int) -> str:
        return "closed"

    def opened(self, configuration: str) -> str:
        return "open"

    def _drive(self, configuration: str, port: Port, z: SimpleNamespace) -> tuple[int, Row, Any]:
        """Sign of the conducting diodes, voltage across the coil with what resists in line, and that resistance."""
        sign = sign_of(configuration)
        return sign, sign * self.excess(sign, port, z), self.resistance(sign)
