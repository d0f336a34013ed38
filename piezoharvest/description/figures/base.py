"""What all figures lead to, and the figures that most have in common: loss, mass, and the two kinds of capacitance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

from piezoharvest.description.parameters import Component, ParameterError, check_choice, quantity

POSITIVE_COUPLING = "the coupling is taken as positive: its sign does not follow from the given values"

Condition = Literal["free", "clamped"]  # of a capacitance


class Lumped(NamedTuple):
    """Values of a transducer's first mode in SI units, and in words what was assumed to find them.

    Attributes
    ----------
    mass, damping, stiffness, coupling, capacitance : float
        kg, N s/m, N/m (short circuit), N/V, F (clamped).
    assumptions : tuple of str
        One sentence each, without a full stop.
    """

    mass: float
    damping: float
    stiffness: float
    coupling: float
    capacitance: float
    assumptions: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Figures(Component):
    """Base of all figures. The loss is given as a quality or as a damping ratio, which is 1/(2 quality)."""

    quality: float | None = quantity("", "mechanical quality factor of the resonance", default=None, above=0)
    damping_ratio: float | None = quantity("", "damping ratio of the resonance", default=None, at_least=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of(self, "quality", "damping_ratio")
        if (condition := getattr(self, "capacitance_is", None)) is not None:
            check_choice("capacitance_is", condition, get_args(Condition))

    @property
    def loss(self) -> float:
        """1/quality, twice the damping ratio."""
        return 1 / self.quality if self.quality is not None else 2 * (self.damping_ratio or 0.0)

    def lumped(self) -> Lumped:
        """Values of the transducer.

        Raises
        ------
        ParameterError
            The figures contradict each other.
        """
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class StaticFigures(Figures):
    """Figures far below the resonance, to which the mass is given by itself or by the resonance frequency."""

    modal_mass: float | None = quantity("kg", "moving mass of the mode", default=None, above=0)
    resonance_frequency: float | None = quantity("Hz", "resonance with shorted electrodes", default=None, above=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of(self, "modal_mass", "resonance_frequency")

    def with_mass(self, stiffness: float, coupling: float, capacitance: float, *assumptions: str) -> Lumped:
        """The whole, with the mass that resonates with the stiffness."""
        if self.modal_mass is not None:
            mass = self.modal_mass
        else:
            mass = stiffness / (2 * math.pi * (self.resonance_frequency or 1.0)) ** 2
            assumptions += (
                "the mass is that which resonates with this stiffness, with shorted electrodes and one end fixed",
            )
        damping = self.loss * math.sqrt(stiffness * mass)
        return Lumped(mass, damping, stiffness, coupling, capacitance, assumptions)


def one_of(figures: Component, first: str, second: str) -> None:
    """Raise `ParameterError` unless exactly one of two keys is given."""
    given = [key for key in (first, second) if getattr(figures, key) is not None]
    if len(given) == 2:
        raise ParameterError(second, f"found together with {first}, only one of the two may be given")
    if not given:
        raise ParameterError(first, f"missing key, {first} or {second} is needed")


def clamped(capacitance: float, condition: Condition, coupling_squared: float) -> tuple[float, tuple[str, ...]]:
    """Clamped capacitance in F from one that is free or clamped, and what is assumed.

    The free capacitance of a single mode is C (1 + k_e^2), k_e^2 = T^2/(k C) (IEEE Std 176-1987, in this project's
    signs).
    """
    if condition == "clamped":
        return capacitance, ()
    return capacitance / (1 + coupling_squared), (
        "the free capacitance is taken as C + T^2/k of this mode alone: contributions of further modes count as "
        "clamped",
    )
