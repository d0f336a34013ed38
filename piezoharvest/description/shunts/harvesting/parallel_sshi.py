"""Synchronised switch harvesting on inductor, parallel: the inductor beside the bridge."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.shunts.bridge import diode_guards, sign_of
from piezoharvest.description.shunts.cold_start import StartedSwitch
from piezoharvest.description.shunts.real_coil import WoundSwitch


@dataclass(frozen=True, kw_only=True)
class ParallelSSHI(WoundSwitch, StartedSwitch):
    """Rectifier with a switched inductor across the electrodes, which inverts their voltage at every extremum.

    Bridge and inductor may conduct at the same time, as they do when the switch acts early or late.
    """

    kind: ClassVar[str] = "parallel_sshi"
    source: ClassVar[str] = "Guyomar, Badel, Lefeuvre & Richard, IEEE Trans. UFFC 52(4), 584-595, 2005"

    def states(self, capacitance: float) -> tuple[State, ...]:
        return (*self.real_coil(capacitance).states(), *self.bridge_states())

    def configurations(self) -> tuple[str, ...]:
        return ("open", "open+", "open-", "closed", "closed+", "closed-")

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        sign, rectified = self._bridge(configuration, port, z)
        if sign:
            port_equation = self.conduction(sign, rectified, port, z, dz)
        else:
            port_equation = self.forward(port, z) - self._loop(configuration, port, z)
        closed = configuration.startswith("closed")
        coil = self.real_coil(port.capacitance).equations(closed, port.v, port, z, dz)
        return [port_equation, *coil, *self.dc_equations(rectified, port, z, dz)]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        _, rectified = self._bridge(configuration, port, z)
        powers = self.bridge_powers(rectified, port, z)
        powers["shunt_loss"] += self.leads_loss(port, z)
        closed = configuration.startswith("closed")
        powers["shunt_loss"] += self.real_coil(port.capacitance).losses(closed, port.v, port, z)
        return powers

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        return diode_guards(self, configuration, self._bridge(configuration, port, z)[1], port, z)

    def closed(self, configuration: str, polarity: int) -> str:
        return configuration.replace("open", "closed")

    def opened(self, configuration: str) -> str:
        return configuration.replace("closed", "open")

    def _loop(self, configuration: str, port: Port, z: SimpleNamespace) -> Row:
        return self.real_coil(port.capacitance).current(configuration.startswith("closed"), port.v, port, z)

    def _bridge(self, configuration: str, port: Port, z: SimpleNamespace) -> tuple[int, Row]:
        """Sign of the conducting diodes, and the current through them towards the dc side."""
        sign = sign_of(configuration)
        return sign, sign * (self.forward(port, z) - self._loop(configuration, port, z))
