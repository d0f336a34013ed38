"""A transducer from the data sheet of a vibration harvester that states its power alone."""

from __future__ import annotations

import math
from dataclasses import dataclass

from piezoharvest.description.figures.base import POSITIVE_COUPLING, Condition, Figures, Lumped, clamped
from piezoharvest.description.parameters import ParameterError, described, quantity


@dataclass(frozen=True, kw_only=True)
class HarvestedPower(Figures):
    """Mean power in a resistor at a base acceleration, at the resonance with shorted electrodes; no voltage is given.

    With K = T^2/(b w C) and r = R w C, P = F^2/(2 b) K r/((1 + K r)^2 + r^2), F = m a. The best resistor, r =
    1/sqrt(1 + K^2), takes P = F^2/(4 b) K/(K + sqrt(1 + K^2)), less than F^2/(8 b) (Renno, Daqaq & Inman, J. Sound
    Vib. 320, 386-405, 2009). Beside another resistor a stronger coupling can give the same power as a weaker one.
    """

    power: float = quantity("W", "mean power in the resistor", above=0)
    acceleration: float = quantity("m/s^2", "peak acceleration of the base", above=0)
    resonance_frequency: float = quantity("Hz", "resonance with shorted electrodes, where the power is given", above=0)
    modal_mass: float = quantity("kg", "moving mass", above=0)
    capacitance: float = quantity("F", "capacitance, free or clamped", above=0)
    capacitance_is: Condition = described("whether the capacitance is free or clamped")
    load_resistance: float | None = quantity(
        "ohm", "load resistance at which the power is given; default: the best", default=None, above=0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.loss == 0:
            raise ParameterError("damping_ratio", "found 0, must be a number greater than 0: it limits the power")

    def lumped(self) -> Lumped:
        """Values of the transducer, see `Figures.lumped`."""
        omega, mass = 2 * math.pi * self.resonance_frequency, self.modal_mass
        damping, stiffness = self.loss * mass * omega, mass * omega**2
        matched = (mass * self.acceleration) ** 2 / (8 * damping)
        if not self.power < matched:
            raise ParameterError(
                "power",
                f"found {self.power:g} W, must be less than (m a)^2/(8 c) = {matched:.3g} W, the most that this mass, "
                "acceleration and damping allow (acceleration is an amplitude, power a mean)",
            )
        share = self.power / (4 * matched)  # of F^2/(2 b)
        if self.load_resistance is None:
            strength = 2 * share / math.sqrt(1 - 4 * share)
            told = "the power is that of the best load resistance at the short-circuit resonance"
        else:
            strength, told = self._strength(share, self.load_resistance * omega * self.capacitance)
        squared = strength * self.loss
        capacitance, assumptions = clamped(self.capacitance, self.capacitance_is, squared)
        coupling = math.sqrt(squared * stiffness * capacitance)
        assumptions += (told, "the acceleration is a peak value, the power a mean",
                        "the moving mass is the mass that base acceleration drives", POSITIVE_COUPLING)  # fmt: skip
        return Lumped(mass, damping, stiffness, coupling, capacitance, assumptions)

    def _strength(self, share: float, load: float) -> tuple[float, str]:
        """Smallest K at which a load R w C takes a share of F^2/(2 b), and what is assumed.

        A free capacitance is C (1 + K loss), so that the share is N(K) = load K (1 + loss K) over D(K) = (1 + s K)^2 +
        load^2, s = load + loss (a clamped one: without loss). share D(K) = N(K) is a quadratic a K^2 + b K + c = 0.
        """
        loss = self.loss if self.capacitance_is == "free" else 0.0
        slope = load + loss
        a, b, c = share * slope**2 - loss * load, 2 * share * slope - load, share * (1 + load**2)
        discriminant = b**2 - 4 * a * c
        below = math.sqrt(max(discriminant, 0.0)) - b
        if discriminant < 0 or not below > 0:
            most = self.power / share * _largest_share(load, loss)
            raise ParameterError(
                "power",
                f"found {self.power:g} W, must be less than {most:.3g} W: with this capacitance no coupling gives more "
                f"in {self.load_resistance:g} ohm at the short-circuit resonance",
            )
        told = "the power is taken at the short-circuit resonance"
        if a > 0 and discriminant > 0:
            told += ", and the coupling as the weaker of the two that give this power in this load"
        return 2 * c / below, told


def _largest_share(load: float, loss: float) -> float:
    """Largest share of F^2/(2 b) that a load R w C takes, whatever the coupling; `loss` as in `_strength`."""
    slope, size = load + loss, 1 + load**2
    if load <= loss:
        return loss * load / slope**2  # of an unlimited coupling
    bend = slope * (load - loss)
    best = (loss * size + math.sqrt((loss * size) ** 2 + bend * size)) / bend
    return load * best * (1 + loss * best) / ((1 + slope * best) ** 2 + load**2)
