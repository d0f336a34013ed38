"""Half-wave rectifier: one diode in series, and one across the leads for the other half wave."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from piezoharvest.description.circuit import Guard, Port, Product, Row
from piezoharvest.description.shunts.bridge import diode_guards, sign_of
from piezoharvest.description.shunts.harvesting.rectifier import Rectifier


@dataclass(frozen=True, kw_only=True)
class HalfWave(Rectifier):
    """Half-wave rectifier: a series diode charges the dc side in one half period, another conducts in the other.

    Without the second diode, the capacitance of the electrodes would block any mean current. The source calls this
    circuit a voltage doubler: the dc voltage reaches twice that behind a bridge, and the best load resistance is four
    times as large.
    """

    kind: ClassVar[str] = "half_wave"
    source: ClassVar[str] = "Ramadass & Chandrakasan, IEEE J. Solid-State Circuits 45(1), 189-204, 2010, section III"
    mirrors: ClassVar[bool] = False
    diodes: ClassVar[int] = 1
    gain: ClassVar[float] = 2.0

    @property
    def dc_conductance(self) -> Any:
        return self.dc_leakage if self.discharged else 0.0

    def level(self, sign: int, port: Port, z: SimpleNamespace) -> Row:
        return self.terminal(self._backwards(port, z), port, z) if sign > 0 else 0.0 * port.one

    def resistance(self, sign: int) -> Any:
        if sign < 0:
            return self.path_resistance
        return self.path_resistance + self._share * self.divided(self.dc_resistance)

    def level_rate(self, sign: int, port: Port, dz: SimpleNamespace) -> Row:
        return dz.dc if sign > 0 and self.dc_voltage is None else 0.0 * port.one

    def leak(self, port: Port, z: SimpleNamespace) -> Row:
        return self.diode_leakage * port.v + self._backwards(port, z)

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        sign = sign_of(configuration)
        through = self._through(sign, port, z)
        port_equation = self.conduction(sign, through, port, z, dz) if sign else self.forward(port, z)
        return [port_equation, *self.dc_equations(self._charging(sign, port, z), port, z, dz)]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        sign = sign_of(configuration)
        charging = self._charging(sign, port, z)
        powers, dc = self.bridge_powers(charging, port, z), self.terminal(charging, port, z)
        lost = [*self.path_loss(self._through(sign, port, z), port), *self.capacitor_loss(charging, port, z)]
        if np.any(self.diode_leakage):
            lost += [Product(self.diode_leakage, row, row) for row in (port.v, port.v - dc)]
        powers["shunt_loss"] = [*self.dc_loss(dc, port), *lost]
        return powers

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        return diode_guards(self, configuration, self._through(sign_of(configuration), port, z), port, z)

    @property
    def _share(self) -> Any:
        """Of the current of the series diode's straight line that arrives at the capacitor, as it leaks the less."""
        return 1.0 / (1.0 + self.diode_leakage * self.divided(self.dc_resistance))

    def _backwards(self, port: Port, z: SimpleNamespace) -> Row:
        """Current through the series diode, towards the dc side, while it blocks."""
        return self._share * self.diode_leakage * (port.v - self.terminal(0.0 * port.one, port, z))

    def _through(self, sign: int, port: Port, z: SimpleNamespace) -> Row:
        """Current of the straight line of the diode that conducts."""
        return self.forward(port, z) / self._share if sign > 0 else sign * self.forward(port, z)

    def _charging(self, sign: int, port: Port, z: SimpleNamespace) -> Row:
        """Current through the series diode, backwards, too."""
        return self._backwards(port, z) + (self.forward(port, z) if sign > 0 else 0.0)
