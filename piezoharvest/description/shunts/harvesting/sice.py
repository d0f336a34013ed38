"""Synchronous inversion and charge extraction."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.shunts.extraction import Extraction
from piezoharvest.description.shunts.real_coil import WoundSwitch


@dataclass(frozen=True, kw_only=True)
class SICE(WoundSwitch, Extraction):
    """The voltage is inverted at a minimum of sum T_i x_i, and at the maximum that follows its charge is extracted.

    Extracted are then 2 (1 + q) V_oc instead of twice 2 V_oc a period by SECE: up to twice the energy. Both use a coil
    of the same `inductance` and `quality`. The switch stays closed for half a damped period of the loop, or until it
    would have emptied the electrodes, longer or shorter by `on_time_error` (with a value below zero: short-duration
    switching; with a `phase_lag` phase-shifted switching).
    """

    kind: ClassVar[str] = "sice"
    source: ClassVar[str] = "Lallart, Wu, Hsieh & Yan, Smart Mater. Struct. 26(11), 115012, 2017"
    mirrors: ClassVar[bool] = False

    def stage(self, configuration: str, capacitance: float) -> Any:
        if not configuration.startswith("extract"):
            return 1.0
        return self.emptying_time(capacitance) / self.nominal_flip_time(capacitance)

    def states(self, capacitance: float) -> tuple[State, ...]:
        return (*self.real_coil(capacitance).states(), *self.extraction_states(capacitance))

    def configurations(self) -> tuple[str, ...]:
        extracting = (name for name in self.extracting("extract") if "+" not in name)
        return ("open", "invert", *extracting)

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        inverts, coil = configuration == "invert", self.real_coil(port.capacitance)
        current = coil.current(inverts, port.v, port, z) + self.coil_current(configuration, port, z)
        inverting = coil.equations(inverts, port.v, port, z, dz)
        return [port.i - current, *inverting, *self.coil_equations(configuration, port, z, dz)]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        inverting = self.real_coil(port.capacitance).losses(configuration == "invert", port.v, port, z)
        return {"shunt_loss": [*inverting, *self.coil_losses(configuration, port, z)]}

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        return self.coil_guards(configuration, port, z)

    def closed(self, configuration: str, polarity: int) -> str:
        # The voltage is lowest at a maximum.
        return "extract-" if polarity > 0 else "invert"

    def opened(self, configuration: str) -> str:
        return "open"
