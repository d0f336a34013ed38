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
    """Synchronous inversion and charge extraction: inversion at a minimum of sum T_i x_i, extraction at a maximum.

    The charge is extracted at 2 (1 + q) V_oc once a period, by SECE at 2 V_oc twice: up to twice the energy. Inversion
    and extraction use coils of the same `inductance` and `quality`. The switch stays closed for half a damped period of
    the loop, or until it would have emptied the electrodes, longer or shorter by `on_time_error`. A value below zero
    gives short-duration switching, a `phase_lag` phase-shifted switching.
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
        inverted = coil.current(inverts, port.v, port, z)
        electrodes = self.electrodes_equation(configuration, inverted, port, z, dz)
        inverting = coil.equations(inverts, port.v, port, z, dz)
        return [electrodes, *inverting, *self.coil_equations(configuration, port, z, dz)]

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
