"""Synchronous electric charge extraction."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.shunts.extraction import Extraction
from piezoharvest.description.shunts.switching import EmptyingSwitch


@dataclass(frozen=True, kw_only=True)
class SECE(EmptyingSwitch, Extraction):
    """Synchronous electric charge extraction: at every extremum the electrodes' charge is transferred to the load.

    Without an `inductance` this happens instantly. With `diode_drop` V_d, the charge passes two conducting diodes of
    the bridge before the flyback converter: of the energy C V^2/2 at a voltage V they dissipate 2 V_d C V, and a
    fraction `efficiency` of the rest is harvested. The switch opens when the electrodes are empty. Below V = 4 V_d,
    where the drops would dissipate more than there is, the charge is extracted all the same and nothing is harvested.

    With the `inductance` and `quality` of the coil with C, the switch stays closed until the loop alone would have
    emptied the electrodes, longer or shorter by `on_time_error`; the energy of the coil then goes to the load.
    `on_time_error` and `diode_resistance` have no effect without a coil. With a `phase_lag`, this is phase-shifted
    SECE.
    """

    kind: ClassVar[str] = "sece"
    source: ClassVar[str] = "Lefeuvre, Badel, Richard & Guyomar, J. Intell. Mater. Syst. Struct. 16(10), 865-876, 2005"

    def states(self, capacitance: float) -> tuple[State, ...]:
        return () if self.at_once else self.extraction_states(capacitance)

    def configurations(self) -> tuple[str, ...]:
        return ("linear",) if self.at_once else ("open", *self.extracting("closed"))

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        if self.at_once:
            return [port.i]
        electrodes = self.electrodes_equation(configuration, 0.0 * port.one, port, z, dz)
        return [electrodes, *self.coil_equations(configuration, port, z, dz)]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        return {} if self.at_once else {"shunt_loss": self.coil_losses(configuration, port, z)}

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        return [] if self.at_once else self.coil_guards(configuration, port, z)

    def closed(self, configuration: str, polarity: int) -> str:
        # The voltage is lowest at a maximum of sum T_i x_i.
        return configuration if self.at_once else f"closed{'-' if polarity > 0 else '+'}"

    def opened(self, configuration: str) -> str:
        return configuration if self.at_once else "open"

    def harvested_share(self) -> float:
        return self.efficiency

    def extraction_drop(self) -> float:
        return 2.0 * self.diode_drop
