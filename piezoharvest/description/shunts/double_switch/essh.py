"""Enhanced synchronised switch harvesting: a second coil takes a part of the intermediate capacitor's energy."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.double_switch.dssh import DSSH

ASSUMED_QUALITY, ASSUMED_RESIDUAL = 30.0, 0.5
ASSUMED_SHARE = 1 / 400  # of the period, in which the second coil empties its capacitor: short beside the motion


@dataclass(frozen=True, kw_only=True)
class ESSH(DSSH):
    """DSSH whose second switch leaves a share `residual` of the intermediate capacitor's voltage.

    When the first switch opens, the second one connects that capacitor to a coil of `second_inductance`, with
    `second_quality` = sqrt(L_2/C_int)/R_2 beside it, for the time in which the voltage falls to `residual` of its value
    where the coil has no losses: acos(residual) sqrt(L_2 C_int). When it opens, a share `efficiency` of the coil's
    energy reaches the load. What is left raises the voltage at which the next charge is taken. With a residual of 0 it
    is DSSH with a real second coil.
    """

    kind: ClassVar[str] = "essh"
    source: ClassVar[str] = "Shen, Qiu, Ji, Zhu & Balsi, Smart Mater. Struct. 19(11), 115017, 2010"

    second_inductance: float = quantity("H", "inductance of the coil between intermediate capacitor and load", above=0)
    second_quality: float = quantity("", "quality of this coil with the intermediate capacitor, sqrt(L/C)/R", above=0.5)
    residual: float = quantity(
        "", "fraction of the intermediate voltage that is left after each transfer", at_least=0, below=1
    )

    @classmethod
    def assumed(cls, capacitance: float, frequency: float) -> tuple[dict[str, Any], str]:
        values, note = super().assumed(capacitance, frequency)
        inductance = (ASSUMED_SHARE / frequency * 2 / np.pi) ** 2 / values["intermediate_capacitance"]
        own = {"second_inductance": inductance, "second_quality": ASSUMED_QUALITY, "residual": ASSUMED_RESIDUAL}
        return values | own, f"{note}, a second coil of {inductance:.3g} H that leaves half of the voltage"

    def second_resistance(self) -> Any:
        """Resistance of the second coil, ohm."""
        return np.sqrt(self.second_inductance / self.intermediate_capacitance) / self.second_quality

    def transfer_time(self) -> Any:
        """Seconds for which the second switch is closed."""
        return np.arccos(self.residual) * np.sqrt(self.second_inductance * self.intermediate_capacitance)

    def on_time(self, capacitance: float) -> Any:
        return self.swing_time(capacitance) + self.transfer_time()

    def stage(self, configuration: str, capacitance: float) -> Any:
        swing = self.swing_time(capacitance) / self.on_time(capacitance)
        return 1.0 - swing if configuration == "transfer" else swing

    def states(self, capacitance: float) -> tuple[State, ...]:
        *coil, between = super().states(capacitance)
        second = State("second", self.second_inductance, odd=False, recovered=self.efficiency)
        return (*coil, between._replace(recovered=None), second)

    def configurations(self) -> tuple[str, ...]:
        return (*super().configurations(), "transfer")

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        *before, charging = super().equations(configuration, port, z, dz)
        if configuration != "transfer":
            return [*before, charging, dz.second]
        falls = self.second_inductance * dz.second + self.second_resistance() * z.second - z.intermediate
        return [*before, charging + z.second, falls]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        losses = [*super().powers(configuration, port, z)["shunt_loss"]]
        if configuration == "transfer":
            losses.append(Product(self.second_resistance(), z.second, z.second))
        return {"shunt_loss": losses}

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        return () if configuration == "transfer" else super().guards(configuration, port, z)

    def opened(self, configuration: str) -> str:
        return "transfer" if configuration.startswith("closed") else "open"
