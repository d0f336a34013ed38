"""Synchronised switch harvesting on inductor, series: the inductor in line with the bridge."""

from dataclasses import dataclass
from typing import ClassVar

from piezoharvest.description.circuit import Product, State
from piezoharvest.description.shunts.bridge import Bridge, diode_guards, sign_of
from piezoharvest.description.shunts.switching import InductiveSwitch


@dataclass(frozen=True, kw_only=True)
class SeriesSSHI(InductiveSwitch, Bridge):
    """Switch, inductance and rectifier in one loop: charge flows to the dc side only while the switch is closed.

    Closed too long, the bridge blocks at zero current until |v| exceeds the dc voltage again.
    """

    kind: ClassVar[str] = "series_sshi"
    source: ClassVar[str] = "Taylor, Burns, Kammann, Powers & Welsh, IEEE J. Ocean. Eng. 26(4), 539-547, 2001"

    def states(self, capacitance):
        return (State("current", self.loop(capacitance)[0]), *self.bridge_states())

    def configurations(self):
        return ("open", "closed", "closed+", "closed-")

    def equations(self, configuration, port, z, dz):
        sign = sign_of(configuration)
        loop = self.loop_equation(bool(sign), sign * self.excess(sign, port, z), port, z, dz)
        return [port.i - self.loop_current(bool(sign), port, z), loop, *self.dc_equations(sign * z.current, z, dz)]

    def powers(self, configuration, port, z):
        powers = self.bridge_powers(sign_of(configuration) * z.current, port, z)
        powers["shunt_loss"].append(Product(self.loop(port.capacitance)[1], z.current, z.current))
        return powers

    def guards(self, configuration, port, z):
        if configuration == "open":
            return []
        return diode_guards(self, configuration, sign_of(configuration) * z.current, port, z, cut="current")

    def closed(self, configuration, polarity):
        return "closed"

    def opened(self, configuration):
        return "open"
