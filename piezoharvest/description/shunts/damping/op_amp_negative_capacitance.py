"""Negative capacitance made of an operational amplifier, with the limits of that."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.base import Leads, Shunt
from piezoharvest.description.shunts.bridge import sign_of

ASSUMED_SHARE = 0.5  # of the clamped capacitance, at which the electrodes become unstable
GENERAL_PURPOSE, ASSUMED_SUPPLY = 1e6, 13.5  # gain-bandwidth product, Hz, and output at supplies of 15 V, of an LM358


@dataclass(frozen=True, kw_only=True)
class OpAmpNegativeCapacitance(Shunt):
    """Negative capacitance made with an operational amplifier, in parallel with a load resistance.

    An amplifier with a gain of 2 (set by two equal resistors, whose power is neglected) drives the far terminal of a
    `capacitance`, which then draws the current of -`capacitance`. With the gain-bandwidth product f_t, the output
    follows u' = 2 pi f_t (v - u/2). The current therefore lags, which is equivalent to a negative conductance of about
    4 omega^2 capacitance/(2 pi f_t). The output is limited to `saturation`; while it is saturated, the capacitance acts
    as a positive one. The power delivered by the amplifier is counted as that of a source; its supply current is not.
    """

    kind: ClassVar[str] = "op_amp_negative_capacitance"
    source: ClassVar[str] = "Forward, J. Spacecraft Rockets 16(1), 11-17, 1979; de Marneffe & Preumont, SMS 17, 2008"

    capacitance: float = quantity("F", "magnitude of the negative capacitance", above=0)
    resistance: float = quantity("ohm", "load resistance in parallel with it", above=0)
    gain_bandwidth: float = quantity("Hz", "gain-bandwidth product of the amplifier", above=0)
    saturation: float = quantity("V", "largest output voltage, of either sign", above=0)

    @classmethod
    def assumed_if_named(cls, leads: Leads, values: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
        own = {
            "capacitance": ASSUMED_SHARE * leads.capacitance,
            "resistance": 1 / (2 * np.pi * leads.frequency * leads.capacitance),
            "gain_bandwidth": GENERAL_PURPOSE, "saturation": ASSUMED_SUPPLY,
        }  # fmt: skip
        note = f"-{own['capacitance']:.3g} F, half the stability limit, of an amplifier of {GENERAL_PURPOSE:g} Hz"
        return own, f"{note} whose output reaches {ASSUMED_SUPPLY:g} V"

    @property
    def tuned(self) -> tuple[str, ...]:
        return ("resistance",)

    def states(self, capacitance: float) -> tuple[State, ...]:
        return (State("across", self.capacitance),)

    def possible_states(self, voltage: Any) -> Mapping[str, tuple[Any, Any]]:
        return {"across": (voltage - self.saturation, voltage + self.saturation)}

    def guessed_states(self, voltage: float, rate: float) -> Mapping[str, float]:
        """The amplifier at work, or at the limit of its output."""
        return {"across": float(np.clip(-voltage, voltage - self.saturation, voltage + self.saturation))}

    def begun(self, voltage: float, states: Mapping[str, float]) -> str:
        output = voltage - states["across"]
        return "linear" if abs(output) < self.saturation else "linear+" if output > 0.0 else "linear-"

    def configurations(self) -> tuple[str, ...]:
        return ("linear", "linear+", "linear-")

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        output_rate = port.dv - dz.across
        if not sign_of(configuration):
            output_rate = output_rate - 2 * np.pi * self.gain_bandwidth * self._error(port, z)
        return [self._current(port) - self.capacitance * dz.across, output_rate]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        delivered = Product(-1.0, port.v - z.across, self._current(port))
        return {"harvested": [Product(1.0 / self.resistance, port.v, port.v)], "source": [delivered]}

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        sign = sign_of(configuration)
        if sign:
            return [Guard(-sign * self._error(port, z), "linear", event="")]
        output, limit = port.v - z.across, self.saturation * port.one
        return [Guard(side * output - limit, f"linear{mark}", event="") for side, mark in ((1, "+"), (-1, "-"))]

    def _current(self, port: Port) -> Row:
        """Current into the capacitor."""
        return port.i - port.v / self.resistance

    def _error(self, port: Port, z: SimpleNamespace) -> Row:
        """Voltage between the inputs of the amplifier."""
        return port.v - 0.5 * (port.v - z.across)
