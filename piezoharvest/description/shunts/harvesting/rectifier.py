"""Diode bridge with a smoothing capacitor: the standard harvesting interface."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.shunts.bridge import Bridge, diode_guards, sign_of


@dataclass(frozen=True, kw_only=True)
class Rectifier(Bridge):
    """Full-wave bridge into a smoothing capacitor with a load resistance, or into a constant voltage."""

    kind: ClassVar[str] = "rectifier"
    source: ClassVar[str] = "Ottman, Hofmann, Bhatt & Lesieutre, IEEE Trans. Power Electron. 17(5), 669-676, 2002"

    def states(self, capacitance: float) -> tuple[State, ...]:
        return self.bridge_states()

    def configurations(self) -> tuple[str, ...]:
        return ("open", "open+", "open-")

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        sign = sign_of(configuration)
        rectified = sign * self.forward(port, z)
        port_equation = self.conduction(sign, rectified, port, z, dz) if sign else self.forward(port, z)
        return [port_equation, *self.dc_equations(rectified, port, z, dz)]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        powers = self.bridge_powers(sign_of(configuration) * self.forward(port, z), port, z)
        powers["shunt_loss"] += self.leads_loss(port, z)
        return powers

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        return diode_guards(self, configuration, sign_of(configuration) * self.forward(port, z), port, z)
