"""Half-wave rectifier: one diode in series, and one across the leads for the other half wave."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from piezoharvest.description.circuit import Port, Product, Row
from piezoharvest.description.shunts.bridge import sign_of
from piezoharvest.description.shunts.harvesting.rectifier import Rectifier


@dataclass(frozen=True, kw_only=True)
class HalfWave(Rectifier):
    """A series diode charges the dc side while the voltage is positive; another one takes the negative half wave.

    Without the second one the capacitance of the electrodes would let no mean current pass. The source calls the
    circuit a voltage doubler: with both diodes the dc voltage reaches twice that behind a bridge, and the best load is
    four times as large.
    """

    kind: ClassVar[str] = "half_wave"
    source: ClassVar[str] = "Ramadass & Chandrakasan, IEEE J. Solid-State Circuits 45(1), 189-204, 2010, section III"
    mirrors: ClassVar[bool] = False
    resistive: ClassVar[bool] = False
    diodes: ClassVar[int] = 1
    gain: ClassVar[float] = 2.0

    @property
    def dc_conductance(self) -> Any:
        return self.dc_leakage if self.dc_voltage is None else 0.0

    def level(self, sign: int, port: Port, z: SimpleNamespace) -> Row:
        return self.dc_side(port, z) if sign > 0 else 0.0 * port.one

    def level_rate(self, sign: int, port: Port, dz: SimpleNamespace) -> Row:
        return dz.dc if sign > 0 and self.dc_voltage is None else 0.0 * port.one

    def leak(self, port: Port, z: SimpleNamespace) -> Row:
        return self.diode_leakage * (2.0 * port.v - self.dc_side(port, z))

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        sign = sign_of(configuration)
        through = sign * self.forward(port, z)
        port_equation = self.conduction(sign, through, port, z, dz) if sign else self.forward(port, z)
        return [port_equation, *self.dc_equations(self._charging(sign, port, z), z, dz)]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        sign = sign_of(configuration)
        powers = self.bridge_powers(self._charging(sign, port, z), port, z)
        lost = self.path_loss(sign * self.forward(port, z), port)
        powers["shunt_loss"] = [*self.dc_loss(self.dc_side(port, z)), *lost, *self.leads_loss(port, z)]
        return powers

    def leads_loss(self, port: Port, z: SimpleNamespace) -> list[Product]:
        if not np.any(self.diode_leakage):
            return []
        across = port.v - self.dc_side(port, z)
        return [Product(self.diode_leakage, row, row) for row in (port.v, across)]

    def _charging(self, sign: int, port: Port, z: SimpleNamespace) -> Row:
        """Current through the series diode, backwards, too."""
        backwards = self.diode_leakage * (port.v - self.dc_side(port, z))
        return backwards + self.forward(port, z) if sign > 0 else backwards
