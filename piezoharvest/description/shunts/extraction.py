"""Extraction of the electrodes' charge through a bridge and a coil, whose energy goes on to the load when it is cut."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.bridge import sign_of


@dataclass(frozen=True, kw_only=True)
class Extraction(Shunt):
    """Parts of a flyback or buck-boost converter behind a bridge; a state "coil" holds the current of its coil.

    While it conducts, L i' + (R + 2 R_d) i = v - sigma 2 V_d, sigma being the sign of the voltage. When the switch
    opens the current of the coil goes on into the load, at once, with a share `efficiency` of its energy. The loss of
    its core is a resistance beside L, in which its current goes on where the diodes block before that.
    """

    efficiency: float = quantity(
        "", "fraction of the extracted energy that reaches the load", default=1.0, at_least=0, at_most=1
    )
    diode_drop: float = quantity("V", "forward drop of one diode", default=0.0, at_least=0)
    diode_resistance: float = quantity("ohm", "series resistance of one diode", default=0.0, at_least=0)

    core_resistance: float | None = quantity(
        "ohm", "resistance beside the inductance, the loss of the core; None: no loss", default=None, above=0
    )

    def coil(self, capacitance: float) -> tuple[Any, Any]:
        """Inductance (H) and resistance (ohm) of the coil."""
        raise NotImplementedError

    def coil_state(self, capacitance: float) -> State:
        """Current of the coil."""
        return State("coil", self.coil(capacitance)[0], recovered=self.efficiency)

    def coil_equation(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Row:
        """L i' = R_c (current through the bridge - i); without a core its voltage, or nothing while it is blocked."""
        inductance, core = self.coil(port.capacitance)[0], self.core_resistance
        if core is not None:
            return inductance * dz.coil - core * (self.coil_current(configuration, port, z) - z.coil)
        if not sign_of(configuration):
            return dz.coil
        return inductance * dz.coil + self._line(port) * z.coil - self._drive(configuration, port)

    def coil_current(self, configuration: str, port: Port, z: SimpleNamespace) -> Row:
        """Current through the bridge while it conducts: of the coil, and of its core."""
        if not sign_of(configuration):
            return 0.0 * port.one
        core, line = self.core_resistance, self._line(port)
        return z.coil if core is None else (self._drive(configuration, port) + core * z.coil) / (line + core)

    def coil_losses(self, configuration: str, port: Port, z: SimpleNamespace) -> list[Product]:
        """Power in the coil's resistance, in its core and in the diodes."""
        current = self.coil_current(configuration, port, z)
        losses: list[Product] = []
        if self.core_resistance is not None:
            losses.append(Product(self.core_resistance, current - z.coil, current - z.coil))
        sign = sign_of(configuration)
        if not sign:
            return losses
        losses.append(Product(self._line(port), current, current))
        if np.any(self.diode_drop):
            losses.append(Product(2.0 * self.diode_drop * sign, port.one, current))
        return losses

    def coil_guards(self, configuration: str, port: Port, z: SimpleNamespace) -> list[Guard]:
        """Guards: the diodes block where the current ends."""
        sign = sign_of(configuration)
        if not sign:
            return []
        ends = "coil" if self.core_resistance is None else None
        return [Guard(-sign * self.coil_current(configuration, port, z), configuration[:-1], ends)]

    def _drive(self, configuration: str, port: Port) -> Row:
        """Voltage across the coil and what resists in line."""
        return port.v - 2.0 * self.diode_drop * sign_of(configuration) * port.one

    def _line(self, port: Port) -> Any:
        """Resistance of the coil and of the diodes in line, ohm."""
        return self.coil(port.capacitance)[1] + 2.0 * self.diode_resistance
