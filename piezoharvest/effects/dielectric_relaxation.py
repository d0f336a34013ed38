"""Slow polarisation of the ceramic."""

from dataclasses import dataclass
from typing import ClassVar

from piezoharvest.circuit import Product, State
from piezoharvest.effects.base import Effect
from piezoharvest.parameters import quantity


@dataclass(frozen=True, kw_only=True)
class DielectricRelaxation(Effect):
    """A series R-C branch across the electrodes, R = time_constant / capacitance; absent at zero capacitance."""

    name: ClassVar[str] = "dielectric_relaxation"
    source: ClassVar[str] = "Debye, Polar Molecules, 1929; Jonscher, Dielectric Relaxation in Solids, 1983"
    looks: ClassVar[str] = "after a step the voltage first falls and then lingers; phase of the voltage turns at low frequency"
    told_by: ClassVar[str] = "an impedance sweep from 10 mHz up: a leakage is one slope, a relaxation a step"

    capacitance: float = quantity("F", "capacitance that follows slowly", above=0, null=0.0)
    time_constant: float = quantity("s", "time constant of the branch", above=0)

    def states(self):
        return (State("voltage", self.capacitance),)

    def current(self, port, z, dz):
        return (port.v - z.voltage) * (self.capacitance / self.time_constant)

    def equations(self, port, z, dz):
        return [self.time_constant * dz.voltage + z.voltage - port.v]

    def losses(self, port, z, dz):
        return [Product(self.capacitance / self.time_constant, port.v - z.voltage, port.v - z.voltage)]

    def act(self, specimen):
        charge, rate = specimen.state("relaxation", 1.0 / specimen.transducer.capacitance)
        specimen.equation(self.time_constant * rate + charge - self.capacitance * specimen.v_t)
        specimen.charge(charge)

    @classmethod
    def starts(cls, scene):
        for time_constant in scene.times:
            # Next to nothing: none at all is no branch.
            yield cls(capacitance=1e-6 * scene.capacitance, time_constant=time_constant)
