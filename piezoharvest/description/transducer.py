"""The lumped electromechanical transducer in its host structure.

Source: Goldfarb & Celanovic, ASME J. Dyn. Syst. Meas. Control 119(3), 478-485, 1997, brought into two-port form.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.effects.nameless.kinds import in_a_path
from piezoharvest.description.figures import Figures, Modal, data_sheet
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.parameters import Component, ParameterError, described, quantity
from piezoharvest.notebook import Row, Shown

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
    coupling: float = quantity("N/V", "electromechanical coupling T, force per volt or charge per metre")
    force_participation: float = quantity("", "participation in F, and in the displacement measured there", default=1.0)
    effective_mass: float | None = quantity("kg", "mass that base acceleration drives", default=None)
    sensor_participation: float | None = quantity(
        "", "participation in the measured displacement; default: that in the force", default=None
    )

    @property
    def seen(self) -> float:
        """Share of the mode in the displacement that is read: where the force acts, unless a sensor is elsewhere."""
        return self.force_participation if self.sensor_participation is None else self.sensor_participation

    @property
    def base_mass(self) -> float:
        """Mass in kg by which base acceleration is converted to the mode's force."""
        return self.mass if self.effective_mass is None else self.effective_mass


class Pair(NamedTuple):
    """A pair of electrodes: clamped capacitance in F, and coupling with each mode in N/V."""

    capacitance: float
    couplings: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Electrode(Component):
    """A further pair of electrodes on the same structure: q = C v + sum T_i x_i, and a force T_i v on each mode.

    A `coupling` that is one number is that of a single mode.
    """

    capacitance: float = quantity("F", "clamped capacitance C", above=0)
    coupling: tuple[float, ...] | float = quantity("N/V", "coupling T with each mode, first mode first")

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.coupling, tuple):
            object.__setattr__(self, "coupling", (self.coupling,))

    @property
    def couplings(self) -> tuple[float, ...]:
        """Coupling with each mode, N/V."""
        assert isinstance(self.coupling, tuple)  # made one in __post_init__
        return self.coupling


@dataclass(frozen=True, kw_only=True)
class Transducer(Component, Shown):
    """Piezoelectric transducer: first mode, clamped capacitance, hysteresis, further modes and electrodes, effects.

    Equations (docs/equations.md): m x'' + b x' + k x = F + T v_t, q_p = C v_t + sum T_i x_i, v_p = v_t + v_h(q_p).
    `assumptions` are sentences on what was assumed where the values follow from other figures (`from_modal`,
    `from_datasheet`). For a `quasi_static` specimen (a film, a stack far below its resonance) mass and damping are
    unknown and have no effect: k x = F + T v_t. Further `electrodes` (patches elsewhere on the structure) act on the
    same modes; hysteresis and effects are those of the transducer's own. Those without a shunt are open.

    Raises
    ------
    ParameterError
        An electrode has not one coupling for each mode.
    """

    mass: float = quantity("kg", "mass m of the first mode", above=0)
    damping: float = quantity("N s/m", "viscous damping b", at_least=0)
    stiffness: float = quantity("N/m", "short-circuit stiffness k", above=0)
    coupling: float = quantity("N/V", "electromechanical coupling T, force per volt or charge per metre")
    capacitance: float = quantity("F", "clamped capacitance C", above=0)
    effective_mass: float | None = quantity("kg", "mass that base acceleration drives; default: the mass", default=None)
    sensor_participation: float | None = quantity(
        "", "participation of the first mode in the measured displacement; default: 1, as in the force", default=None
    )
    hysteresis: Hysteresis | None = None
    modes: tuple[Mode, ...] = ()
    electrodes: tuple[Electrode, ...] = ()
    effects: tuple[Effect, ...] = ()
    name: str = described("name for reports", default="")
    quasi_static: bool = described("whether inertia and damping are left out; only in a campaign", default=False)
    assumptions: tuple[str, ...] = dataclasses.field(
        default=(), compare=False, repr=False, metadata={"doc": "assumptions behind the values"}
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "modes", tuple(self.modes))
        object.__setattr__(self, "effects", tuple(self.effects))
        object.__setattr__(self, "electrodes", tuple(self.electrodes))
        wanted = 1 + len(self.modes)
        for n, electrode in enumerate(self.electrodes):
            if len(electrode.couplings) != wanted:
                found = f"found {len(electrode.couplings)} for {wanted} mode{'s' if wanted > 1 else ''}"
                raise ParameterError(f"electrodes.{n}.coupling", f"{found}, each mode needs one")

    @property
    def heading(self) -> str:
        """Its name, with the resonance and coupling of its first mode; those of a batch of designs are in the table."""
        name = self.name or "transducer"
        if np.size(self.stiffness * self.mass * self.coupling * self.capacitance) != 1:
            return f"{name}, a batch of designs"
        coupling = f"k_e^2 {float(self.coupling_squared):.4g}"
        resonance = "" if self.quasi_static else f"{float(self.short_circuit_frequency):.4g} Hz shorted, "
        return f"{name}, {resonance}{coupling}"

    @property
    def rows(self) -> list[Row]:
        """Every number of it and of its hysteresis, modes, electrodes and effects, by its path."""
        left = INERT if self.quasi_static else ()
        return [row for row in _rows(self, "") if row["parameter"] not in left]

    @property
    def all_electrodes(self) -> tuple[Pair, ...]:
        """The transducer's own electrodes, number 0, and the further ones."""
        own = Pair(self.capacitance, tuple(mode.coupling for mode in self.all_modes))
        return (own, *(Pair(electrode.capacitance, electrode.couplings) for electrode in self.electrodes))

    @property
    def reversed_leads(self) -> Transducer:
        """The same with exchanged leads: couplings of the own electrodes have the other sign."""
        modes = tuple(dataclasses.replace(mode, coupling=-mode.coupling) for mode in self.modes)
        return dataclasses.replace(self, coupling=-self.coupling, modes=modes)

    def swapped(self, number: int) -> Transducer:
        """The same structure, its own electrodes and those of a number having changed places.

        Raises
        ------
        ParameterError
            There is hysteresis, or an effect, which are those of the transducer's own electrodes.
        """
        if number == 0:
            return self
        if self.hysteresis or self.effects:
            what = "hysteresis" if self.hysteresis else f"effects.{self.effects[0].name}"
            raise ParameterError(what, f"found beside electrodes {number}, but it is that of electrodes 0")
        own, other = self.all_electrodes[0], self.all_electrodes[number]
        modes = (dataclasses.replace(m, coupling=t) for m, t in zip(self.modes, other.couplings[1:], strict=True))
        electrodes = list(self.electrodes)
        electrodes[number - 1] = Electrode(capacitance=own.capacitance, coupling=own.couplings)
        return dataclasses.replace(
            self, capacitance=other.capacitance, coupling=other.couplings[0], modes=tuple(modes),
            electrodes=tuple(electrodes),
        )  # fmt: skip

    @classmethod
    def from_modal(cls, **figures: Any) -> Transducer:
        """Transducer from a modal test.

        Parameters
        ----------
        **figures
            Those of `piezoharvest.description.figures.Modal`: short_circuit_frequency, open_circuit_frequency (Hz),
            quality or damping_ratio, modal_mass (kg), capacitance (F), capacitance_is ("free" or "clamped"). Further
            fields of the transducer, as effects or name.

        Raises
        ------
        ParameterError
            A figure is missing, not allowed, or contradicts the others.

        Examples
        --------
        >>> found = Transducer.from_modal(short_circuit_frequency=50.0, open_circuit_frequency=51.0, quality=50.0,
        ...                               modal_mass=0.01, capacitance=40e-9, capacitance_is="clamped")
        >>> round(found.stiffness, 2), round(found.coupling_squared, 4)
        (986.96, 0.0404)
        """
        return cls._from(Modal, figures)

    @classmethod
    def from_datasheet(cls, **figures: Any) -> Transducer:
        """Transducer from the figures of a data sheet.

        Parameters
        ----------
        **figures
            One of these sets, with quality or damping_ratio; where a modal_mass (kg) is named, a resonance_frequency
            (Hz, shorted electrodes) may stand for it, but for those of vibration harvesters and impedances:

            - free_stroke, blocking_force, voltage, capacitance; modal_mass
            - coupling_factor, stiffness, capacitance; modal_mass
            - material, or d33, s33 and relative_permittivity; area, thickness, layers (a stack); modal_mass
            - material, or d31, s11 and relative_permittivity; length, width, thickness (a plate); modal_mass
            - open_circuit_voltage, acceleration, open_circuit_frequency, capacitance, capacitance_is; modal_mass, or
              power and load_resistance
            - power, acceleration, resonance_frequency, capacitance, capacitance_is; modal_mass; load_resistance if it
              is not the best
            - resonance_frequency, antiresonance_frequency, capacitance (of the impedance); modal_mass

            All in SI units, see `piezoharvest.description.figures`. Further fields of the transducer.

        Raises
        ------
        ParameterError
            A figure is missing, not allowed, or contradicts the others.

        Examples
        --------
        >>> stack = Transducer.from_datasheet(free_stroke=15e-6, blocking_force=900.0, voltage=100.0, quality=30.0,
        ...                                   capacitance=1.5e-6, capacitance_is="clamped", modal_mass=2e-3)
        >>> stack.stiffness, stack.coupling
        (60000000.0, 9.0)
        """
        return cls._from(*data_sheet(figures))

    @classmethod
    def _from(cls, kind: type[Figures], figures: dict[str, Any]) -> Transducer:
        """Transducer from figures of one kind, which are taken out of the keywords."""
        own = {field.name for field in dataclasses.fields(kind)}
        missing = [
            field.name for field in dataclasses.fields(kind)
            if field.default is dataclasses.MISSING and field.name not in figures
        ]  # fmt: skip
        if missing:
            given = ", ".join(sorted(own & set(figures)))
            more = f"; also missing: {', '.join(missing[1:])}" if missing[1:] else ""
            needed = f"it is needed{f' together with {given}' if given else ''}"
            raise ParameterError(missing[0], f"missing key, {needed}{more}")
        found = kind(**{key: value for key, value in figures.items() if key in own}).lumped()
        return cls(**{**found._asdict(), **{key: value for key, value in figures.items() if key not in own}})

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


def _rows(part: Any, path: str, field: dataclasses.Field | None = None) -> Iterator[Row]:
    """Rows of a component, of several, or of one number, whose field gives its unit; a batch by its range."""
    if isinstance(part, tuple):
        for n, inner in enumerate(part):
            word = in_a_path(inner.name) if isinstance(inner, Effect) else n
            yield from _rows(inner, f"{path}.{word}", field)
    elif isinstance(part, Component):
        for each in dataclasses.fields(part):
            yield from _rows(getattr(part, each.name), f"{path}.{each.name}" if path else each.name, each)
    elif field is not None and "unit" in field.metadata and part is not None:
        numbers = np.ravel(part)
        batch = f"{len(numbers)} from {numbers.min():.4g} to {numbers.max():.4g}" if len(numbers) > 1 else ""
        value = batch or float(numbers[0])
        yield {"parameter": path, "value": value, "unit": field.metadata["unit"], "meaning": field.metadata["doc"]}
