"""Synchronised switch harvesting on inductor, series: the inductor in line with the bridge."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.shunts.bridge import Bridge, diode_guards, sign_of
from piezoharvest.description.shunts.switching import InductiveSwitch


@dataclass(frozen=True, kw_only=True)
class SeriesSSHI(InductiveSwitch, Bridge):
    """Switch, inductance and rectifier in one loop: charge flows to the dc side only while the switch is closed.

    The leads are open but while the switch is closed: what its diodes conduct backwards then is left out, as it is
    small beside what they take from the dc side all the time. If it is closed too long, the bridge blocks at zero
    current until |v| exceeds the dc voltage again.
    """

    kind: ClassVar[str] = "series_sshi"
    source: ClassVar[str] = "Taylor, Burns, Kammann, Powers & Welsh, IEEE J. Ocean. Eng. 26(4), 539-547, 2001"

    def states(self, capacitance: float) -> tuple[State, ...]:
        return (State("current", self.loop(capacitance)[0]), *self.bridge_states())

    def configurations(self) -> tuple[str, ...]:
        return ("open", "closed", "closed+", "closed-")

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        sign = sign_of(configuration)
        drive = sign * self.excess(sign, port, z) - self.resistance(sign) * z.current
        loop = self.loop_equation(bool(sign), drive, port, z, dz)
        return [port.i - self.loop_current(bool(sign), port, z), loop, *self.dc_equations(sign * z.current, z, dz)]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        powers = self.bridge_powers(sign_of(configuration) * z.current, port, z)
        powers["shunt_loss"].append(Product(self.loop(port.capacitance)[1], z.current, z.current))
        return powers

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        if configuration == "open":
            return []
        return diode_guards(self, configuration, sign_of(configuration) * z.current, port, z, cut="current")

    def closed(self, configuration: str, polarity: int) -> str:
        return "closed"

    def opened(self, configuration: str) -> str:
        return "open"
