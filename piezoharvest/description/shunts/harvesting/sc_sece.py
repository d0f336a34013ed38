"""Synchronous electric charge extraction with a short circuit after it: tunes the resonance electrically."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.extraction import Extraction
from piezoharvest.description.shunts.switching import InductiveSwitch


@dataclass(frozen=True, kw_only=True)
class SCSECE(InductiveSwitch, Extraction):
    """SECE whose electrodes stay short-circuited for `short_time` after each extraction.

    The duration of the short circuit and `phase_lag` tune the circuit: the longer the short circuit, the lower the
    effective stiffness of the transducer, between its open-circuit and its short-circuit value. The current of the
    short circuit flows through the loop's resistance, without the coil. FTSECE is tuned in the same way by its phase.
    """

    kind: ClassVar[str] = "sc_sece"
    source: ClassVar[str] = (
        "Morel, Gasnier, Wanderoild, Pillonnet & Badel, Proc. IEEE ISCAS, 2018; "
        "Badel & Lefeuvre, J. Phys. Conf. Ser. 557, 012115, 2014 (FTSECE)"
    )

    short_time: float = quantity("s", "time for which the electrodes are shorted after the extraction", above=0)

    @classmethod
    def assumed(cls, capacitance: float, frequency: float) -> tuple[dict[str, Any], str]:
        values = {"short_time": 0.1 / frequency}
        return values, f"a short of {values['short_time']:.3g} s, a tenth of the period"

    def swing_time(self, capacitance: float) -> Any:
        return (1 + self.on_time_error) * self.emptying_time(capacitance)

    def on_time(self, capacitance: float) -> Any:
        return self.swing_time(capacitance) + self.short_time

    def stage(self, configuration: str, capacitance: float) -> Any:
        extraction = self.swing_time(capacitance) / self.on_time(capacitance)
        return extraction if configuration.startswith("extract") else 1.0 - extraction

    def states(self, capacitance: float) -> tuple[State, ...]:
        return self.extraction_states(capacitance)

    def configurations(self) -> tuple[str, ...]:
        return ("open", *self.extracting("extract"), "short")

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        electrodes = self.electrodes_equation(configuration, self._short(configuration, port), port, z, dz)
        return [electrodes, *self.coil_equations(configuration, port, z, dz)]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        short = Product(1.0, port.v, self._short(configuration, port))
        return {"shunt_loss": [short, *self.coil_losses(configuration, port, z)]}

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        return self.coil_guards(configuration, port, z)

    def closed(self, configuration: str, polarity: int) -> str:
        return f"extract{'-' if polarity > 0 else '+'}"

    def opened(self, configuration: str) -> str:
        return "short" if configuration.startswith("extract") else "open"

    def _short(self, configuration: str, port: Port) -> Row:
        return port.v / self.loop(port.capacitance)[1] if configuration == "short" else 0.0 * port.one
