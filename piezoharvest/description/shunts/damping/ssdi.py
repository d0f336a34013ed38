"""Synchronised switch damping on inductor."""

from dataclasses import dataclass
from typing import ClassVar

from piezoharvest.description.circuit import Product, State
from piezoharvest.description.shunts.switching import InductiveSwitch


@dataclass(frozen=True, kw_only=True)
class SSDI(InductiveSwitch):
    """Open electrodes whose voltage is inverted through an inductance at every extremum: dry-friction-like damping."""

    kind: ClassVar[str] = "ssdi"
    source: ClassVar[str] = "Richard, Guyomar, Audigier & Bassaler, Proc. SPIE 3989, 288-299, 2000"

    def states(self, capacitance):
        return (State("current", self.loop(capacitance)[0]),)

    def configurations(self):
        return ("open", "closed")

    def equations(self, configuration, port, z, dz):
        closed = configuration == "closed"
        return [port.i - self.loop_current(closed, port, z), self.loop_equation(closed, port.v, port, z, dz)]

    def powers(self, configuration, port, z):
        return {"shunt_loss": [Product(self.loop(port.capacitance)[1], z.current, z.current)]}

    def closed(self, configuration, polarity):
        return "closed"

    def opened(self, configuration):
        return "open"
