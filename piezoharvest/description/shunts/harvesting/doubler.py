"""Full-wave voltage doubler: each half wave charges a capacitor of its own, and the load lies across both."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts.bridge import sign_of
from piezoharvest.description.shunts.harvesting.rectifier import Rectifier


@dataclass(frozen=True, kw_only=True)
class Doubler(Rectifier):
    """Full-wave voltage doubler: two diodes charge two capacitors in series, whose midpoint is one electrode.

    Each capacitor has the capacitance `smoothing_capacitance` and the `smoothing_resistance`. The dc voltage is that of
    both capacitors together, twice that of a bridge, and the best load resistance is four times as large. A constant
    `dc_voltage` is divided equally between both. The states are sum and difference of the two voltages.

    Raises
    ------
    ParameterError
        With a smoothing resistance, diodes leak or a supply is fed, for which the circuit has no equations.
    """

    kind: ClassVar[str] = "doubler"
    source: ClassVar[str] = "Greinacher, Z. Phys. 4(2), 195-205, 1921; Delon, L'Eclairage Electrique, 1908"
    diodes: ClassVar[int] = 1
    capacitors: ClassVar[int] = 2
    gain: ClassVar[float] = 2.0

    @property
    def dc_capacitance(self) -> Any:
        return None if self.smoothing_capacitance is None else 0.5 * self.smoothing_capacitance

    @property
    def dc_conductance(self) -> Any:
        return 0.5 * self.diode_leakage + self.dc_leakage if self.discharged else 0.0

    @property
    def dc_resistance(self) -> Any:
        return 2.0 * self.smoothing_resistance

    def _check_smoothing_resistance(self) -> None:
        super()._check_smoothing_resistance()
        if self.storage is not None:
            found = f"found {np.max(self.smoothing_resistance):g} ohm beside a table storage"
            raise ParameterError("smoothing_resistance", f"{found}, one of the two must be absent in a doubler")
        for key in ("diode_leakage", "diode_saturation"):
            beside: Any = np.real(getattr(self, key))
            if np.any(beside):
                found = f"found {np.max(self.smoothing_resistance):g} ohm together with a {key}"
                raise ParameterError("smoothing_resistance", f"{found}, one of the two must be 0 in a doubler")

    def states(self, capacitance: float) -> tuple[State, ...]:
        if self.smoothing_capacitance is None:
            return ()
        return (*self.bridge_states(), State("difference", self.dc_capacitance))

    def level(self, sign: int, port: Port, z: SimpleNamespace) -> Row:
        """Voltage across the capacitor that is charged at this sign, before it is: it gives the load its current."""
        inside = 0.5 * (self.dc_side(port, z) + sign * self._difference(port, z))
        if not np.any(self.smoothing_resistance):
            return inside
        return inside - self.smoothing_resistance * self._load_current(port, z)

    def _load_current(self, port: Port, z: SimpleNamespace) -> Row:
        """What leaves the dc side while the capacitors alone feed it."""
        across = self.divided(z.dc - self.dc_resistance * self._drawn * port.one)
        return self._all_conductance * across + self._drawn * port.one

    def resistance(self, sign: int) -> Any:
        if not np.any(self.smoothing_resistance):
            return self.path_resistance
        taken = self.divided(self.smoothing_resistance * self._all_conductance)  # of a current, by the load
        return self.path_resistance + self.smoothing_resistance * (1.0 - taken)

    def level_rate(self, sign: int, port: Port, dz: SimpleNamespace) -> Row:
        return 0.5 * (dz.dc + sign * dz.difference) if self.dc_voltage is None else 0.0 * port.one

    def leak(self, port: Port, z: SimpleNamespace) -> Row:
        return self.diode_leakage * (2.0 * port.v - self._difference(port, z))

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        sign = sign_of(configuration)
        rectified = sign * self.forward(port, z)
        port_equation = self.conduction(sign, rectified, port, z, dz) if sign else self.forward(port, z)
        rates = self.dc_equations(0.5 * rectified, port, z, dz)
        # All of the lead's current goes into the midpoint.
        return [port_equation, *rates, *([self.smoothing_capacitance * dz.difference - port.i] if rates else [])]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        rectified = sign_of(configuration) * self.forward(port, z)
        powers = self.bridge_powers(0.5 * rectified, port, z)
        leaks = [*self.dc_loss(self.terminal(0.5 * rectified, port, z), port), *self.leads_loss(port, z)]
        powers["shunt_loss"] = [
            *self.path_loss(rectified, port),
            *leaks,
            *self.capacitor_loss(0.5 * rectified, port, z),
        ]
        if np.any(self.smoothing_resistance):  # beside their mean current the capacitors have half of the lead's each
            powers["shunt_loss"].append(Product(0.25 * self.dc_resistance, port.i, port.i))
        return powers

    def leads_loss(self, port: Port, z: SimpleNamespace) -> list[Product]:
        across = 2.0 * port.v - self._difference(port, z)
        return [Product(0.5 * self.diode_leakage, across, across)] if np.any(self.diode_leakage) else []

    def _difference(self, port: Port, z: SimpleNamespace) -> Row:
        """Voltage of the capacitor that the positive half wave charges, less that of the other one."""
        return z.difference if self.dc_voltage is None else 0.0 * port.one
