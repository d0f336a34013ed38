"""A transducer from a modal test: resonances with shorted and open electrodes, loss, modal mass, capacitance."""

from __future__ import annotations

import math
from dataclasses import dataclass

from piezoharvest.description.figures.base import POSITIVE_COUPLING, Condition, Figures, Lumped, clamped
from piezoharvest.description.parameters import ParameterError, described, quantity


@dataclass(frozen=True, kw_only=True)
class Modal(Figures):
    """Figures of a modal test.

    k = m w_sc^2, k_e^2 = T^2/(k C) = (w_oc/w_sc)^2 - 1 (Hagood & von Flotow, J. Sound Vib. 146(2), 243-268, 1991). The
    loss is that with shorted electrodes.
    """

    short_circuit_frequency: float = quantity("Hz", "resonance with shorted electrodes", above=0)
    open_circuit_frequency: float = quantity("Hz", "resonance with open electrodes", above=0)
    modal_mass: float = quantity("kg", "modal mass, which scales force and displacement", above=0)
    capacitance: float = quantity("F", "capacitance, free or clamped", above=0)
    capacitance_is: Condition = described("whether the capacitance is free or clamped")

    def lumped(self) -> Lumped:
        """Values of the transducer, see `Figures.lumped`."""
        ratio = self.open_circuit_frequency / self.short_circuit_frequency
        if ratio < 1:
            raise ParameterError(
                "open_circuit_frequency",
                f"found {self.open_circuit_frequency:g} Hz, must be at least short_circuit_frequency, "
                f"{self.short_circuit_frequency:g} Hz: open electrodes stiffen",
            )
        omega, squared = 2 * math.pi * self.short_circuit_frequency, (ratio - 1) * (ratio + 1)
        stiffness = self.modal_mass * omega**2
        capacitance, assumptions = clamped(self.capacitance, self.capacitance_is, squared)
        coupling = math.sqrt(squared * stiffness * capacitance)
        damping = self.loss * self.modal_mass * omega
        return Lumped(self.modal_mass, damping, stiffness, coupling, capacitance, (*assumptions, POSITIVE_COUPLING))
