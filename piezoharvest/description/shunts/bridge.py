"""Full-wave diode bridge with a smoothing capacitor or a constant voltage behind it: base of rectifying shunts."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.parameters import ParameterError, quantity
from piezoharvest.description.shunts.base import Shunt


@dataclass(frozen=True, kw_only=True)
class Bridge(Shunt):
    """Diodes with a constant drop, two of them conducting, into a capacitor with a load or into a constant voltage.

    Each of its four diodes may conduct backwards, as a conductance `diode_leakage` beside it. The dc side lies halfway
    between the leads, by symmetry, so that these are one such conductance across the leads and one across the dc side;
    `dc_leakage` adds to the latter. A constant dc voltage holds against both, and what that takes is not counted.

    The name of a conducting configuration ends in the sign of the electrode voltage, as in "open+".

    Raises
    ------
    ParameterError
        Neither a smoothing capacitance with a load resistance nor a dc voltage is given, or both.
    """

    smoothing_capacitance: float | None = quantity("F", "smoothing capacitance", default=None, above=0)
    load_resistance: float | None = quantity("ohm", "load resistance behind the bridge", default=None, above=0)
    dc_voltage: float | None = quantity("V", "constant voltage instead of them", default=None, at_least=0)
    diode_drop: float = quantity("V", "forward drop of one diode", default=0.0, at_least=0)
    diode_leakage: float = quantity("S", "conductance of one diode, backwards", default=0.0, at_least=0)
    dc_leakage: float = quantity("S", "conductance across the dc side beside the load", default=0.0, at_least=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        keys = ("smoothing_capacitance", "load_resistance", "dc_voltage")
        given = [key for key in keys if getattr(self, key) is not None]
        if given not in (["smoothing_capacitance", "load_resistance"], ["dc_voltage"]):
            raise ParameterError(
                given[-1] if given else "smoothing_capacitance",
                f"found {' and '.join(given) or 'no dc side'}, "
                "allowed is smoothing_capacitance with load_resistance, or dc_voltage alone",
            )

    def bridge_states(self) -> tuple[State, ...]:
        """The smoothing capacitor's voltage, if there is one."""
        return () if self.smoothing_capacitance is None else (State("dc", self.smoothing_capacitance, odd=False),)

    def dc_side(self, port: Port, z: SimpleNamespace) -> Row:
        """Voltage behind the bridge."""
        return z.dc if self.dc_voltage is None else self.dc_voltage * port.one

    def dc_equations(self, rectified: Row, z: SimpleNamespace, dz: SimpleNamespace) -> list[Row]:
        """Current balance of the smoothing capacitor, charged by the `rectified` current."""
        if self.smoothing_capacitance is None or self.load_resistance is None:
            return []
        leaks = self.dc_conductance * z.dc
        return [self.smoothing_capacitance * dz.dc + z.dc / self.load_resistance + leaks - rectified]

    @property
    def dc_conductance(self) -> Any:
        """What discharges the smoothing capacitor beside the load, S."""
        return self.diode_leakage + self.dc_leakage if self.dc_voltage is None else 0.0

    def forward(self, port: Port) -> Row:
        """Current into a bridge across the leads, less what passes its diodes backwards."""
        return port.i - self.diode_leakage * port.v

    def clamp(self, sign: int, port: Port, dz: SimpleNamespace) -> Row:
        """Constraint of a conducting bridge: the derivative of v - sign (v_dc + 2 drops)."""
        return port.dv - sign * dz.dc if self.dc_voltage is None else port.dv

    def excess(self, sign: int, port: Port, z: SimpleNamespace) -> Row:
        """Electrode voltage in excess of the threshold at which the diodes of one sign conduct."""
        return sign * port.v - self.dc_side(port, z) - 2.0 * self.diode_drop * port.one

    def bridge_powers(self, rectified: Row, port: Port, z: SimpleNamespace) -> dict[str, list[Product]]:
        """Power into the load and into what lies behind the diodes and in them, from the `rectified` current."""
        lost = [Product(2.0 * self.diode_drop, port.one, rectified)]
        dc = self.dc_side(port, z)
        if self.load_resistance is not None:
            harvested = Product(1.0 / self.load_resistance, z.dc, z.dc)
        else:
            harvested = Product(1.0, dc, rectified)
        if np.any(self.dc_conductance):
            lost.append(Product(self.dc_conductance, dc, dc))
        return {"harvested": [harvested], "shunt_loss": lost}

    def leads_loss(self, port: Port) -> list[Product]:
        """Power of what passes the diodes backwards between the leads."""
        return [Product(self.diode_leakage, port.v, port.v)] if np.any(self.diode_leakage) else []


def sign_of(configuration: str) -> int:
    """+1 or -1 for a conducting configuration, 0 for a blocking one."""
    return {"+": 1, "-": -1}.get(configuration[-1], 0)


def diode_guards(
    shunt: Bridge, configuration: str, rectified: Row, port: Port, z: SimpleNamespace, cut: str | None = None
) -> list[Guard]:
    """Guards: conduction starts where the voltage exceeds the dc side's, and stops where the rectified current ends."""
    sign = sign_of(configuration)
    if sign:
        return [Guard(-rectified, configuration[:-1], cut)]
    return [Guard(shunt.excess(s, port, z), configuration + mark) for s, mark in ((1, "+"), (-1, "-"))]
