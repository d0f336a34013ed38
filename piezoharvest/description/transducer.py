"""The lumped electromechanical transducer in its host structure.

Source: Goldfarb & Celanovic, ASME J. Dyn. Syst. Meas. Control 119(3), 478-485, 1997, brought into two-port form.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.parameters import Component, quantity

INERT = ("mass", "damping")  # of a mode; a quasi-static specimen has neither
# A quasi-static specimen follows its drive within this share of a sample: the error is far below the least noise that a
# channel is assumed to have, and matrix exponentials keep all significant digits.
SETTLED = 1e-6
OVERDAMPED = 8.0  # b^2/(k m) of a mode that settles without ringing; 4 is critical damping


@dataclass(frozen=True, kw_only=True)
class Mode(Component):
    """One vibration mode of the structure that the electrodes see: m x'' + b x' + k x = p F + T v_t."""

    mass: float = quantity("kg", "modal mass m", above=0)
    damping: float = quantity("N s/m", "viscous damping b", at_least=0)
    stiffness: float = quantity("N/m", "short-circuit stiffness k", above=0)
    coupling: float = quantity("N/V", "electromechanical coupling T, force a volt or charge a metre")
    force_participation: float = quantity("", "share of F and of the displacement read", default=1.0)
    effective_mass: float | None = quantity("kg", "mass that base acceleration drives", default=None)

    @property
    def base_mass(self) -> float:
        """Mass in kg by which base acceleration is converted to the mode's force."""
        return self.mass if self.effective_mass is None else self.effective_mass


@dataclass(frozen=True, kw_only=True)
class Transducer(Component):
    """Piezoelectric transducer: first mode, clamped capacitance, hysteresis, further modes, effects.

    Equations (docs/equations.md): m x'' + b x' + k x = F + T v_t, q_p = C v_t + sum T_i x_i, v_p = v_t + v_h(q_p).
    For a `quasi_static` specimen (a film, a stack far below its resonance) mass and damping are unknown and have no
    effect: k x = F + T v_t.
    """

    mass: float = quantity("kg", "mass m of the first mode", above=0)
    damping: float = quantity("N s/m", "viscous damping b", at_least=0)
    stiffness: float = quantity("N/m", "short-circuit stiffness k", above=0)
    coupling: float = quantity("N/V", "electromechanical coupling T, force a volt or charge a metre")
    capacitance: float = quantity("F", "clamped capacitance C", above=0)
    effective_mass: float | None = quantity("kg", "mass that base acceleration drives; default the mass", default=None)
    hysteresis: Hysteresis | None = None
    modes: tuple[Mode, ...] = ()
    effects: tuple[Effect, ...] = ()
    name: str = ""
    quasi_static: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "modes", tuple(self.modes))
        object.__setattr__(self, "effects", tuple(self.effects))

    @property
    def all_modes(self) -> tuple[Mode, ...]:
        """The first mode, whose participation is 1, and the further ones."""
        return self._all_modes

    @cached_property
    def _all_modes(self) -> tuple[Mode, ...]:
        first = Mode(**{f.name: getattr(self, f.name) for f in dataclasses.fields(Mode) if hasattr(self, f.name)})
        return (first, *self.modes)

    def settled(self, sample_time: float) -> Transducer:
        """Transducer whose modes follow their forces at once at this sample time in s, whatever their masses.

        Both poles are real, as a resonance would ring. The inertial force of a base acceleration is kept.
        """

        def swift(mode: Mode) -> Mode:
            time = SETTLED * sample_time
            damping = mode.stiffness * time
            mass = damping * time / OVERDAMPED
            return dataclasses.replace(mode, mass=mass, damping=damping, effective_mass=mode.base_mass)

        first, *further = (swift(mode) for mode in self.all_modes)
        return dataclasses.replace(
            self, mass=first.mass, damping=first.damping, effective_mass=first.effective_mass, modes=tuple(further)
        )

    @property
    def stick_capacitance(self) -> float:
        """Clamped capacitance in F for small signals, in series with the sticking hysteresis: 1/(1/C + sum w)."""
        slope = self.hysteresis.stiffness if self.hysteresis else 0.0
        return 1.0 / (1.0 / self.capacitance + slope)

    @property
    def coupling_squared(self) -> float:
        """k_e^2 = T^2/(k C) of the first mode, (w_oc^2 - w_sc^2)/w_sc^2 without hysteresis and further modes."""
        return self.coupling**2 / (self.stiffness * self.capacitance)

    @property
    def short_circuit_frequency(self) -> float:
        """Undamped short-circuit resonance of the first mode, Hz, without hysteresis."""
        return float(np.sqrt(self.stiffness / self.mass)) / (2 * np.pi)

    @property
    def open_circuit_frequency(self) -> float:
        """Undamped open-circuit resonance of the first mode, Hz, without hysteresis."""
        return self.short_circuit_frequency * float(np.sqrt(1 + self.coupling_squared))
