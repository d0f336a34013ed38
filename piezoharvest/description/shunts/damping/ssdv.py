"""Synchronised switch damping with a voltage source."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.base import Leads
from piezoharvest.description.shunts.bridge import sign_of
from piezoharvest.description.shunts.real_coil import WoundSwitch

ASSUMED_SHARE = 0.5  # of the voltage that stops the motion: the drive may fall to half before the source drives instead


@dataclass(frozen=True, kw_only=True)
class SSDV(WoundSwitch):
    """SSDI with a voltage source in the loop, which increases the inverted voltage and delivers the energy for it.

    At a maximum of sum T_i x_i the voltage is at its minimum; the source then drives it upwards.

    The source acts as a friction force whatever the amplitude of the motion. It stops the motion at

        V_s = (pi/4) V_b (1 - q)/(1 + q),

    where V_b is the amplitude of the electrode voltage that would hold the motion against the drive, F/T of a single
    mode, and q the inversion. A higher one drives the structure, and there is no steady state any more. As V_b is
    proportional to the drive, so is the highest voltage.
    """

    kind: ClassVar[str] = "ssdv"
    source: ClassVar[str] = "Lefeuvre, Badel, Petit, Richard & Guyomar, J. Intell. Mater. Syst. Struct. 17, 2006"

    source_voltage: float = quantity("V", "voltage of the source in the loop", at_least=0)

    @classmethod
    def assumed_if_named(cls, leads: Leads, values: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
        limit = cls(**values, source_voltage=0.0).stopping_voltage(leads.capacitance, leads.blocking_voltage)
        own = {"source_voltage": float(ASSUMED_SHARE * limit)}
        return own, f"a source of {own['source_voltage']:.3g} V, half of what stops the motion, above which it drives"

    def stopping_voltage(self, capacitance: float, blocking_voltage: float) -> Any:
        """Voltage of the source in V that stops the motion; a steady electrode voltage would do by its amplitude."""
        inversion = self.inversion(capacitance)
        swing = inversion / self.charge_share(capacitance)  # the source acts once the winding is charged
        return 0.25 * np.pi * blocking_voltage * (1 - inversion) / (1 + swing)

    def states(self, capacitance: float) -> tuple[State, ...]:
        return self.real_coil(capacitance).states()

    def configurations(self) -> tuple[str, ...]:
        return ("open", "closed+", "closed-")

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        sign = sign_of(configuration)
        drive, coil = self._drive(sign, port), self.real_coil(port.capacitance)
        current = coil.current(bool(sign), drive, port, z)
        return [port.i - current, *coil.equations(bool(sign), drive, port, z, dz)]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        sign = sign_of(configuration)
        drive, coil = self._drive(sign, port), self.real_coil(port.capacitance)
        current = coil.current(bool(sign), drive, port, z)
        return {
            "shunt_loss": coil.losses(bool(sign), drive, port, z),
            "source": [Product(-sign * self.source_voltage, port.one, current)],
        }

    def _drive(self, sign: int, port: Port) -> Row:
        """Voltage across the coil with its resistance."""
        return port.v - sign * self.source_voltage * port.one

    def closed(self, configuration: str, polarity: int) -> str:
        return "closed+" if polarity > 0 else "closed-"

    def opened(self, configuration: str) -> str:
        return "open"
