"""A transducer from its electrical impedance: resonance, antiresonance, low-frequency capacitance."""

from __future__ import annotations

from dataclasses import dataclass

from piezoharvest.description.figures.base import Condition, Figures, Lumped
from piezoharvest.description.figures.modal import Modal
from piezoharvest.description.parameters import ParameterError, described, quantity


@dataclass(frozen=True, kw_only=True)
class Impedance(Figures):
    """Figures of an impedance analyser: least impedance at f_r, greatest at f_a, capacitance far below.

    f_r is taken as the short-circuit and f_a as the open-circuit resonance, exact without loss (IEEE Std 176-1987,
    section 6.4). The impedance alone does not tell the mechanical scale: T^2/m, but neither T nor m. So the modal mass
    is asked for.
    """

    resonance_frequency: float = quantity("Hz", "frequency of minimum impedance", above=0)
    antiresonance_frequency: float = quantity("Hz", "frequency of maximum impedance", above=0)
    capacitance: float = quantity("F", "capacitance at low frequency (free), or clamped", above=0)
    capacitance_is: Condition = described("whether the capacitance is free or clamped", default="free")
    modal_mass: float = quantity("kg", "modal mass, which does not follow from the impedance", above=0)

    def lumped(self) -> Lumped:
        """Values of the transducer, see `Figures.lumped`."""
        if not self.antiresonance_frequency >= self.resonance_frequency:
            least = f"must be at least resonance_frequency, {self.resonance_frequency:g} Hz"
            raise ParameterError("antiresonance_frequency", f"found {self.antiresonance_frequency:g} Hz, {least}")
        found = Modal(
            quality=self.quality,
            damping_ratio=self.damping_ratio,
            short_circuit_frequency=self.resonance_frequency,
            open_circuit_frequency=self.antiresonance_frequency,
            modal_mass=self.modal_mass,
            capacitance=self.capacitance,
            capacitance_is=self.capacitance_is,
        ).lumped()
        same = "resonance and antiresonance are taken as those of shorted and open electrodes (no losses)"
        return found._replace(assumptions=(*found.assumptions, same))
