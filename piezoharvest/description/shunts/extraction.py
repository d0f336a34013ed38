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
FREE = " free"  # of configurations in which the current of the coil goes round through all four diodes


@dataclass(frozen=True, kw_only=True)
class Extraction(WoundCoil):
    """Coil of a flyback or buck-boost converter behind a bridge.

    While the bridge conducts, L i' + (R + 2 R_d) i = v - sigma 2 V_d, where sigma is the sign of the voltage. It does
    not let the coil invert the voltage: once the electrodes are empty, the current goes round through all four diodes,
    L i' + (R + R_d) i = -sigma 2 V_d, and R_d shorts the electrodes, until the switch opens. Then a share `efficiency`
    of the coil's energy reaches the load, at once: the load's voltage is taken to be small. So is then that of the
    winding, whose capacitance gives its energy to the inductance first. If the bridge blocks before that, the current
    of the inductance goes on in core and winding.
    """

    efficiency: float = quantity(
        "", "fraction of the extracted energy that reaches the load", default=1.0, at_least=0, at_most=1
    )
    diode_drop: float = quantity("V", "forward drop of one diode", default=0.0, at_least=0)
    diode_resistance: float = quantity(
        "ohm", "series resistance of one diode", default=0.0, at_least=0, other_law_at_zero=True
    )

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
        """Configurations of an extraction: the bridge conducts with one of both signs, or all of it, or blocks.

        A winding rings while the bridge blocks, and may make it conduct again, as it did before.
        """
        conducting = tuple(f"{name}{free}{sign}" for free in ("", FREE) for sign in "+-")
        if self.self_resonance is None:
            return (name, *conducting)
        return (*conducting, *(each + BLOCKED for each in conducting))

    def electrodes_equation(
        self, configuration: str, beside: Row, port: Port, z: SimpleNamespace, dz: SimpleNamespace
    ) -> Row:
        """Port's equation, with the current `beside` the bridge."""
        if not self._free(configuration):
            return port.i - beside - self.coil_current(configuration, port, z)
        # Each half of the bridge carries half of the coil's current, and half of the electrodes'.
        resistive = np.real(self.diode_resistance) > 0
        if not np.any(resistive):
            return port.dv
        return np.where(resistive, port.v - self.diode_resistance * port.i, port.dv)

    def coil_equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> list[Row]:
        """Equations of the coil's states."""
        drive, connected = self._drive(configuration, port), self._connected(configuration)
        return self.coil(port.capacitance).equations(connected, drive, port, z, dz, self._line(configuration))

    def coil_current(self, configuration: str, port: Port, z: SimpleNamespace) -> Row:
        """Current from the bridge into the coil."""
        drive, connected = self._drive(configuration, port), self._connected(configuration)
        return self.coil(port.capacitance).current(connected, drive, port, z, self._line(configuration))

    def coil_losses(self, configuration: str, port: Port, z: SimpleNamespace) -> list[Product]:
        """Power in the coil and in the diodes."""
        drive, connected = self._drive(configuration, port), self._connected(configuration)
        line = self._line(configuration)
        losses = self.coil(port.capacitance).losses(connected, drive, port, z, line)
        current = self.coil_current(configuration, port, z)
        if connected and np.any(self.diode_resistance):
            losses.append(Product(line, current, current))
        if self._free(configuration):
            losses.append(Product(1.0, port.v, port.i))
        if connected and np.any(self.diode_drop):
            losses.append(Product(2.0 * self.diode_drop * sign_of(configuration), port.one, current))
        return losses

    def coil_guards(self, configuration: str, port: Port, z: SimpleNamespace) -> list[Guard]:
        """Guards: the bridge blocks where its current ends, and conducts again where a winding rings below it.

        All of it conducts where the electrodes are empty, until they give more than the coil takes.
        """
        sign, coil = sign_of(configuration), self.coil(port.capacitance)
        if sign:
            current, one_way = sign * self.coil_current(configuration, port, z), configuration.replace(FREE, "")
            after = one_way[:-1] if coil.stray is None else configuration + BLOCKED
            ended = Guard(-current, after, coil.ended, conducts=False)
            if self._free(configuration):
                return [ended, Guard(sign * port.i - current, one_way)]
            return [ended, Guard(-sign * port.v, one_way[:-1] + FREE + one_way[-1])]
        if configuration.endswith(BLOCKED):
            before = configuration.removesuffix(BLOCKED)
            excess = sign_of(before) * (self._drive(before, port) - coil.blocked_voltage(z))
            return [Guard(excess, before)]
        return []

    def _connected(self, configuration: str) -> bool:
        return sign_of(configuration) != 0

    def _drive(self, configuration: str, port: Port) -> Row:
        """Voltage across coil, switch and the resistance of the diodes."""
        electrodes = 0.0 * port.one if self._free(configuration) else port.v
        return electrodes - 2.0 * self.diode_drop * sign_of(configuration) * port.one

    def _free(self, configuration: str) -> bool:
        """Whether the current of the coil goes round through all diodes."""
        return FREE in configuration and self._connected(configuration)

    def _line(self, configuration: str) -> Any:
        """Resistance of the conducting diodes, two in line or two such pairs beside each other, ohm."""
        return self.diode_resistance if self._free(configuration) else 2.0 * self.diode_resistance
