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
    opens the current of the coil goes on into the load, at once, with a share `efficiency` of its energy.
    """

    efficiency: float = quantity(
        "", "fraction of the extracted energy that reaches the load", default=1.0, at_least=0, at_most=1
    )
    diode_drop: float = quantity("V", "forward drop of one diode", default=0.0, at_least=0)
    diode_resistance: float = quantity("ohm", "series resistance of one diode", default=0.0, at_least=0)

    def coil(self, capacitance: float) -> tuple[Any, Any]:
        """Inductance (H) and resistance (ohm) of the coil."""
        raise NotImplementedError

    def coil_state(self, capacitance: float) -> State:
        """Current of the coil."""
        return State("coil", self.coil(capacitance)[0], recovered=self.efficiency)

    def coil_equation(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Row:
        """The coil's current follows the voltage while it conducts, and stays zero else."""
        sign = sign_of(configuration)
        if not sign:
            return dz.coil
        inductance, resistance = self.coil(port.capacitance)
        lost = (resistance + 2.0 * self.diode_resistance) * z.coil + 2.0 * self.diode_drop * sign * port.one
        return inductance * dz.coil + lost - port.v

    def coil_current(self, configuration: str, port: Port, z: SimpleNamespace) -> Row:
        """Current of the coil: the state while it conducts."""
        return z.coil if sign_of(configuration) else 0.0 * port.one

    def coil_losses(self, configuration: str, port: Port, z: SimpleNamespace) -> list[Product]:
        """Power in the coil's resistance and in the diodes."""
        sign = sign_of(configuration)
        if not sign:
            return []
        resistance = self.coil(port.capacitance)[1] + 2.0 * self.diode_resistance
        losses = [Product(resistance, z.coil, z.coil)]
        if np.any(self.diode_drop):
            losses.append(Product(2.0 * self.diode_drop * sign, port.one, z.coil))
        return losses

    def coil_guards(self, configuration: str, z: SimpleNamespace) -> list[Guard]:
        """Guards: the diodes block where the current ends."""
        sign = sign_of(configuration)
        return [Guard(-sign * z.coil, configuration[:-1], "coil")] if sign else []
