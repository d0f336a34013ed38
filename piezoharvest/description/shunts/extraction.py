"""Extraction of charge through a bridge and a coil, whose energy goes to the load when it is cut off."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.base import too_low
from piezoharvest.description.shunts.bridge import sign_of
from piezoharvest.description.shunts.real_coil import RealCoil, WoundCoil

BLOCKED = " blocked"  # ending of configurations in which diodes block and the winding rings


@dataclass(frozen=True, kw_only=True)
class Extraction(WoundCoil):
    """Coil of a flyback or buck-boost converter behind a bridge.

    While the bridge conducts, L i' + (R + 2 R_d) i = v - sigma 2 V_d, where sigma is the sign of the voltage. When the
    switch opens, a share `efficiency` of the coil's energy reaches the load, at once: the load's voltage is taken to
    be small. So is then that of the winding, whose capacitance gives its energy to the inductance first. If the bridge
    blocks before that, the current of the inductance goes on in core and winding.
    """

    efficiency: float = quantity(
        "", "fraction of the extracted energy that reaches the load", default=1.0, at_least=0, at_most=1
    )
    diode_drop: float = quantity("V", "forward drop of one diode", default=0.0, at_least=0)
    diode_resistance: float = quantity("ohm", "series resistance of one diode", default=0.0, at_least=0)

    def coil(self, capacitance: float) -> RealCoil:
        """The coil, with states of its own."""
        return self.real_coil(capacitance)._replace(names=("coil", "coil_winding"), sections=())

    def extraction_states(self, capacitance: float) -> tuple[State, ...]:
        """States of the coil."""
        return self.coil(capacitance).states(self.efficiency)

    def why_nothing(self, events: Collection[str], voltage: float) -> str:
        drops = f"the drops of the diodes ({self.diode_drop:g} V each)"
        return too_low(voltage, drops) if self.diode_drop and self.efficiency else ""

    def extracting(self, name: str) -> tuple[str, ...]:
        """Configurations of an extraction: the bridge conducts with one of both signs, or blocks.

        A winding rings while the bridge blocks, and may make it conduct again, with the sign that it had.
        """
        conducting = (f"{name}+", f"{name}-")
        if self.self_resonance is None:
            return (name, *conducting)
        return (*conducting, *(each + BLOCKED for each in conducting))

    def coil_equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> list[Row]:
        """Equations of the coil's states."""
        drive, connected = self._drive(configuration, port), self._connected(configuration)
        return self.coil(port.capacitance).equations(connected, drive, port, z, dz, self._line)

    def coil_current(self, configuration: str, port: Port, z: SimpleNamespace) -> Row:
        """Current through the bridge."""
        drive, connected = self._drive(configuration, port), self._connected(configuration)
        return self.coil(port.capacitance).current(connected, drive, port, z, self._line)

    def coil_losses(self, configuration: str, port: Port, z: SimpleNamespace) -> list[Product]:
        """Power in the coil and in the diodes."""
        drive, connected = self._drive(configuration, port), self._connected(configuration)
        losses = self.coil(port.capacitance).losses(connected, drive, port, z, self._line)
        current = self.coil_current(configuration, port, z)
        if connected and np.any(self.diode_resistance):
            losses.append(Product(self._line, current, current))
        if connected and np.any(self.diode_drop):
            losses.append(Product(2.0 * self.diode_drop * sign_of(configuration), port.one, current))
        return losses

    def coil_guards(self, configuration: str, port: Port, z: SimpleNamespace) -> list[Guard]:
        """Guards: the bridge blocks where its current ends, and conducts again where a winding rings below it."""
        sign, coil = sign_of(configuration), self.coil(port.capacitance)
        if sign:
            after = configuration[:-1] if coil.stray is None else configuration + BLOCKED
            return [Guard(-sign * self.coil_current(configuration, port, z), after, coil.ended, conducts=False)]
        if configuration.endswith(BLOCKED):
            before = configuration.removesuffix(BLOCKED)
            excess = sign_of(before) * (self._drive(before, port) - coil.blocked_voltage(z))
            return [Guard(excess, before)]
        return []

    def _connected(self, configuration: str) -> bool:
        return sign_of(configuration) != 0

    def _drive(self, configuration: str, port: Port) -> Row:
        """Voltage across coil, switch and the resistance of the diodes."""
        return port.v - 2.0 * self.diode_drop * sign_of(configuration) * port.one

    @property
    def _line(self) -> Any:
        """Resistance of the conducting diodes, ohm."""
        return 2.0 * self.diode_resistance
