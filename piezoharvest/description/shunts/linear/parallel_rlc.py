"""Resonant shunt: inductance, resistance and capacitance in parallel."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.base import LinearShunt


@dataclass(frozen=True, kw_only=True)
class ParallelRLC(LinearShunt):
    """Inductor, resistor and capacitor in parallel across the electrodes.

    The capacitor's voltage is that of the electrodes. It is a state only for its energy, as its current C dv/dt follows
    from the derivative of that voltage.
    """

    kind: ClassVar[str] = "parallel_rlc"
    source: ClassVar[str] = "Moheimani & Fleming, Piezoelectric Transducers for Vibration Control and Damping, 2006"

    inductance: float = quantity("H", "inductance", above=0)
    resistance: float = quantity("ohm", "parallel resistance", above=0)
    capacitance: float = quantity("F", "parallel capacitance", above=0)

    def states(self, capacitance: float) -> tuple[State, ...]:
        return (State("current", self.inductance), State("voltage", self.capacitance))

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        return [
            port.i - z.current - port.v / self.resistance - self.capacitance * dz.voltage,
            self.inductance * dz.current - port.v,
            dz.voltage - port.dv,
        ]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        return {"harvested": [Product(1.0 / self.resistance, port.v, port.v)]}
