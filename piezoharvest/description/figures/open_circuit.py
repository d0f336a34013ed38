"""A transducer from the data sheet of a vibration harvester: open-circuit voltage at a base acceleration."""

from __future__ import annotations

import math
from dataclasses import dataclass

from piezoharvest.description.figures.base import POSITIVE_COUPLING, Condition, Figures, Lumped, one_of
from piezoharvest.description.parameters import ParameterError, described, quantity


@dataclass(frozen=True, kw_only=True)
class OpenCircuit(Figures):
    """Open-circuit voltage at a base acceleration, at the resonance with open electrodes; amplitudes are peak values.

    There x = a Q/w^2 and v = T x/C, so that T = v C w^2/(a Q) whatever the mass (Erturk & Inman, Piezoelectric Energy
    Harvesting, Wiley 2011, section 3). The mass is given, or follows from the power in a resistor at this frequency.
    """

    open_circuit_voltage: float = quantity("V", "peak voltage with open electrodes", above=0)
    acceleration: float = quantity("m/s^2", "peak acceleration of the base", above=0)
    open_circuit_frequency: float = quantity("Hz", "resonance with open electrodes", above=0)
    capacitance: float = quantity("F", "capacitance, free or clamped", above=0)
    capacitance_is: Condition = described("whether the capacitance is free or clamped")
    modal_mass: float | None = quantity("kg", "moving mass", default=None, above=0)
    power: float | None = quantity("W", "mean power in load_resistance", default=None, above=0)
    load_resistance: float | None = quantity(
        "ohm", "load resistance at which the power is given", default=None, above=0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of(self, "modal_mass", "power")
        if (self.power is None) != (self.load_resistance is None):
            raise ParameterError("load_resistance", "power and load_resistance belong together, found only one of them")
        if self.loss == 0:
            raise ParameterError("damping_ratio", "found 0, must be a number greater than 0: it limits the voltage")

    def lumped(self) -> Lumped:
        """Values of the transducer, see `Figures.lumped`."""
        mass = self.modal_mass if self.modal_mass is not None else self._mass_of_power()
        omega = 2 * math.pi * self.open_circuit_frequency
        capacitance, coupling, stiffness = self._of_mass(mass)
        if not stiffness > 0:
            least = self.open_circuit_voltage**2 * self.capacitance * (omega * self.loss / self.acceleration) ** 2
            raise ParameterError(
                "open_circuit_voltage",
                f"found {self.open_circuit_voltage:g}, too large for a mass of {mass:.3g} kg: the coupling that it "
                f"needs leaves no mechanical stiffness below {least:.3g} kg",
            )
        assumptions = ("all values are taken at the open-circuit resonance, amplitudes as peak values",
                       "the moving mass is the mass that base acceleration drives", POSITIVE_COUPLING)  # fmt: skip
        return Lumped(mass, self.loss * mass * omega, stiffness, coupling, capacitance, assumptions)

    def _of_mass(self, mass: float) -> tuple[float, float, float]:
        """Clamped capacitance (F), coupling (N/V) and short-circuit stiffness (N/m) at a mass in kg.

        With the free capacitance C_f = C + T^2/k and k_oc = k + T^2/C = m w^2, k_e^2 = v^2 C_f (w loss/a)^2/m.
        """
        omega = 2 * math.pi * self.open_circuit_frequency
        share = self.open_circuit_voltage**2 * (omega * self.loss / self.acceleration) ** 2 / mass
        capacitance = self.capacitance
        if self.capacitance_is == "free":
            capacitance = self.capacitance / (1 + share * self.capacitance)
        coupling = self.open_circuit_voltage * capacitance * omega**2 * self.loss / self.acceleration
        return capacitance, coupling, mass * omega**2 - coupling**2 / capacitance

    def _mass_of_power(self) -> float:
        """Mass in kg at which the resistor takes the power: the more mass, the stiffer a source is the transducer."""
        from scipy.optimize import root_scalar

        wanted = self.power or 0.0
        omega = 2 * math.pi * self.open_circuit_frequency
        typical = self.open_circuit_voltage**2 * self.capacitance * (omega * self.loss / self.acceleration) ** 2
        low, high = math.log(typical) - 40, math.log(typical) + 40
        if not self._power(math.exp(low)) < wanted < self._power(math.exp(high)):
            most = self._power(math.exp(high))
            raise ParameterError(
                "power",
                f"found {wanted:g}, must be less than {most:.3g} W with this voltage, capacitance and load (peak "
                "values are amplitudes, power is a mean)",
            )

        def excess(mass: float) -> float:
            return self._power(math.exp(mass)) - wanted

        return math.exp(root_scalar(excess, bracket=(low, high), xtol=1e-14, rtol=1e-14).root)

    def _power(self, mass: float) -> float:
        """Mean power in W in the load at a mass in kg: a voltage source behind the port's impedance, force removed."""
        omega = 2 * math.pi * self.open_circuit_frequency
        capacitance, coupling, _ = self._of_mass(mass)
        branch = -(coupling**2) / capacitance + 1j * omega**2 * mass * self.loss  # k - m w^2 + j w b
        impedance = 1 / (1j * omega * (capacitance + coupling**2 / branch))
        load = self.load_resistance or math.inf
        return 0.5 * self.open_circuit_voltage**2 * load / abs(impedance + load) ** 2
