"""Double synchronised switch harvesting."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.base import too_low
from piezoharvest.description.shunts.bridge import sign_of
from piezoharvest.description.shunts.real_coil import WoundSwitch


@dataclass(frozen=True, kw_only=True)
class DSSH(WoundSwitch):
    """Double synchronised switch harvesting: series SSHI into an intermediate capacitor, then into the load.

    The first switch stays closed for half a damped period of the coil with C. This is longer than the swing with the
    intermediate capacitor in series, so the diodes block when the current ends. When the switch opens, a fraction
    `efficiency` of the intermediate capacitor's energy reaches the load instantly, whatever the load is.
    """

    kind: ClassVar[str] = "dssh"
    source: ClassVar[str] = "Lallart, Garbuio, Petit, Richard & Guyomar, IEEE Trans. UFFC 55(10), 2119-2130, 2008"

    intermediate_capacitance: float = quantity("F", "capacitor between the two converters", above=0)
    efficiency: float = quantity(
        "", "fraction of the intermediate capacitor's energy that reaches the load", default=1.0, at_least=0, at_most=1
    )
    diode_drop: float = quantity("V", "forward drop of one diode", default=0.0, at_least=0)
    diode_resistance: float = quantity("ohm", "series resistance of one diode", default=0.0, at_least=0)

    @classmethod
    def assumed(cls, capacitance: float, frequency: float) -> tuple[dict[str, Any], str]:
        return {"intermediate_capacitance": 3 * capacitance}, f"an intermediate capacitor of {3 * capacitance:.3g} F"

    def states(self, capacitance: float) -> tuple[State, ...]:
        between = State("intermediate", self.intermediate_capacitance, odd=False, recovered=self.efficiency)
        return (*self.real_coil(capacitance).states(), between)

    def configurations(self) -> tuple[str, ...]:
        return ("open", "closed", "closed+", "closed-")

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        sign, drive, line = self._drive(configuration, port, z)
        coil = self.real_coil(port.capacitance)
        current = coil.current(bool(sign), drive, port, z, line)
        own = coil.equations(bool(sign), drive, port, z, dz, line)
        return [port.i - current, *own, self.intermediate_capacitance * dz.intermediate - sign * current]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        sign, drive, line = self._drive(configuration, port, z)
        coil = self.real_coil(port.capacitance)
        current = coil.current(bool(sign), drive, port, z, line)
        drops = [Product(2.0 * self.diode_drop * sign, port.one, current), Product(line, current, current)]
        return {"shunt_loss": [*coil.losses(bool(sign), drive, port, z, line), *drops]}

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        (sign, drive, line), coil = self._drive(configuration, port, z), self.real_coil(port.capacitance)
        if configuration == "open":
            return []
        if sign:
            return [Guard(-sign * coil.current(True, drive, port, z, line), "closed", coil.ended)]
        across = coil.blocked_voltage(z)
        return [Guard(self._excess(s, port, z) - s * across, f"closed{mark}") for s, mark in ((1, "+"), (-1, "-"))]

    def closed(self, configuration: str, polarity: int) -> str:
        return "closed"

    def opened(self, configuration: str) -> str:
        return "open"

    def why_nothing(self, events: Collection[str], voltage: float) -> str:
        drops = f"the drops of the diodes ({self.diode_drop:g} V each)"
        return too_low(voltage, drops) if self.diode_drop and self.efficiency else ""

    def dc_side(self, port: Port, z: SimpleNamespace) -> Row:
        """Voltage of the intermediate capacitor."""
        return z.intermediate

    def _excess(self, sign: int, port: Port, z: SimpleNamespace) -> Row:
        """Voltage in excess of what the diodes conduct at."""
        return sign * port.v - z.intermediate - 2.0 * self.diode_drop * port.one

    def _drive(self, configuration: str, port: Port, z: SimpleNamespace) -> tuple[int, Row, Any]:
        """Sign of the conducting diodes, voltage across the coil with what resists in line, and that resistance."""
        sign = sign_of(configuration)
        return sign, sign * self._excess(sign, port, z), 2.0 * self.diode_resistance
