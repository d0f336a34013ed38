"""Enhanced synchronised switch harvesting: a second coil takes a part of the intermediate capacitor's energy."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.double_switch.dssh import DSSH
from piezoharvest.description.shunts.real_coil import RealCoil, check_winding, winding_capacitance

ASSUMED_QUALITY, ASSUMED_RESIDUAL = 30.0, 0.5
ASSUMED_SHARE = 1 / 400  # of the period, in which the second coil empties its capacitor: short beside the motion


@dataclass(frozen=True, kw_only=True)
class ESSH(DSSH):
    """DSSH whose second switch leaves a fraction `residual` of the intermediate capacitor's voltage.

    When the first switch opens, the second one connects the intermediate capacitor C_int to a second coil, with the
    quality `second_quality` = sqrt(L_2/C_int)/R_2. It stays closed for acos(residual) sqrt(L_2 C_int), in which a coil
    without losses would bring the voltage down to `residual` times its initial value. When it opens, a fraction
    `efficiency` of the coil's energy reaches the load. The remaining voltage raises the one at which the next charge is
    extracted. With `residual = 0`, the circuit is DSSH with a real second coil. The second coil may have a core loss
    and a self-resonance of its own.
    """

    kind: ClassVar[str] = "essh"
    source: ClassVar[str] = "Shen, Qiu, Ji, Zhu & Balsi, Smart Mater. Struct. 19(11), 115017, 2010"

    second_inductance: float = quantity("H", "inductance of the coil between intermediate capacitor and load", above=0)
    second_quality: float = quantity(
        "", "quality of the second coil with the intermediate capacitor, sqrt(L/C)/R", above=0.5
    )
    residual: float = quantity(
        "", "fraction of the intermediate voltage that is left after each transfer", at_least=0, below=1
    )

    second_switch_resistance: float | None = quantity(
        "ohm", "resistance of the second switch, in addition to second_quality; default: none", default=None, at_least=0
    )
    second_core_resistance: float | None = quantity(
        "ohm", "resistance in parallel with the second inductance, the loss of its core", default=None, above=0
    )
    second_self_resonance: float | None = quantity(
        "Hz", "frequency at which the winding of the second coil resonates with it", default=None, above=0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_winding(self.second_self_resonance, self.second_switch_resistance, "second_")

    @classmethod
    def assumed(cls, capacitance: float, frequency: float) -> tuple[dict[str, Any], str]:
        values, note = super().assumed(capacitance, frequency)
        inductance = (ASSUMED_SHARE / frequency * 2 / np.pi) ** 2 / values["intermediate_capacitance"]
        own = {"second_inductance": inductance, "second_quality": ASSUMED_QUALITY, "residual": ASSUMED_RESIDUAL}
        return values | own, f"{note}, a second coil of {inductance:.3g} H that leaves half of the voltage"

    def second_coil(self) -> RealCoil:
        """The second coil with its switch."""
        resistance = np.sqrt(self.second_inductance / self.intermediate_capacitance) / self.second_quality
        contact = 0.0 if self.second_switch_resistance is None else self.second_switch_resistance
        stray = None
        if self.second_self_resonance is not None:
            stray = winding_capacitance(self.second_self_resonance, self.second_inductance)
        own = resistance + (contact if stray is None else 0.0)
        names = ("second", "second_winding")
        return RealCoil(names, self.second_inductance, own, self.second_core_resistance, stray, contact)

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
        return (*coil, between._replace(recovered=None), *self.second_coil().states(self.efficiency, odd=False))

    def configurations(self) -> tuple[str, ...]:
        return (*super().configurations(), "transfer")

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        *before, charging = super().equations(configuration, port, z, dz)
        transfers, second = configuration == "transfer", self.second_coil()
        taken = second.current(transfers, z.intermediate, port, z)
        return [*before, charging + taken, *second.equations(transfers, z.intermediate, port, z, dz)]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        losses = super().powers(configuration, port, z)["shunt_loss"]
        second = self.second_coil().losses(configuration == "transfer", z.intermediate, port, z)
        return {"shunt_loss": [*losses, *second]}

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        return () if configuration == "transfer" else super().guards(configuration, port, z)

    def opened(self, configuration: str) -> str:
        return "transfer" if configuration.startswith("closed") else "open"
