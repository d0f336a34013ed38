"""The transducer's equations as rows: the one place where its physics is written, for every view of it.

Rows (see `circuit`) are given by name: x1, u1, x2, ... displacements and velocities of the modes, q the charge q_p.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import NamedTuple

from piezoharvest.circuit import Port, Row, State
from piezoharvest.effects.base import Effect
from piezoharvest.parameters import ParameterError
from piezoharvest.transducer import Transducer

Rows = Mapping[str, Row]


def state_names(transducer: Transducer) -> list[str]:
    """Names of the transducer's own states: x1, u1, ... in m and m/s, and q in C."""
    return [f"{s}{n}" for n in range(1, len(transducer.all_modes) + 1) for s in "xu"] + ["q"]


def capacitor_voltage(transducer: Transducer, z: Rows) -> Row:
    """Row of v_t = (q - sum T_i x_i)/C; of its derivative from the rows of the derivatives."""
    strain_charge = sum(mode.coupling * z[f"x{n}"] for n, mode in enumerate(transducer.all_modes, 1))
    return (z["q"] - strain_charge) / transducer.capacitance


class Mechanics(NamedTuple):
    """Equations of motion and what is read from them.

    Attributes
    ----------
    equations : list of Row
        Two for each mode, zero along every motion.
    displacement, velocity : Row
        Participation-weighted sums of the modes, m and m/s.
    drive_velocity : Row
        What the drive multiplies with to its power: W per N, or per m/s^2.
    strain_current : Row
        sum T_i u_i in A: the switches of synchronised shunts act where it crosses zero.
    """

    equations: list[Row]
    displacement: Row
    velocity: Row
    drive_velocity: Row
    strain_current: Row


def mechanics(transducer: Transducer, z: Rows, dz: Rows, drive: Row, base: bool) -> Mechanics:
    """Equations of motion of all modes under a force, or under base acceleration."""
    modes = list(enumerate(transducer.all_modes, 1))
    v_t = capacitor_voltage(transducer, z)
    gains = {n: -mode.base_mass if base else mode.force_participation for n, mode in modes}
    equations = []
    for n, mode in modes:
        x, u = z[f"x{n}"], z[f"u{n}"]
        inertia = mode.mass * dz[f"u{n}"] + mode.damping * u + mode.stiffness * x
        equations += [dz[f"x{n}"] - u, inertia - mode.coupling * v_t - gains[n] * drive]
    none = 0.0 * drive
    return Mechanics(
        equations,
        displacement=sum((mode.force_participation * z[f"x{n}"] for n, mode in modes), none),
        velocity=sum((mode.force_participation * z[f"u{n}"] for n, mode in modes), none),
        drive_velocity=sum((gains[n] * z[f"u{n}"] for n, _ in modes), none),
        strain_current=sum((mode.coupling * z[f"u{n}"] for n, mode in modes), none),
    )


def own_rows(rows: Rows, prefix: str, states: Sequence[State]) -> SimpleNamespace:
    """Rows of a component's states under the names that it gave them."""
    return SimpleNamespace(**{state.name: rows[prefix + state.name] for state in states})


def effect_prefixes(transducer: Transducer) -> list[tuple[Effect, str]]:
    """The effects with what stands before the names of their states, so that two of a kind stay apart.

    Raises
    ------
    ParameterError
        An effect acts elsewhere than at the electrodes.
    """
    for effect in transducer.effects:
        if not effect.at_the_electrodes:
            found = "found an effect that only predicted records can have"
            raise ParameterError(f"effects.{effect.name}", f"{found}, allowed are effects across the electrodes")
    return [(effect, f"effect{n}_{effect.name}_") for n, effect in enumerate(transducer.effects, 1)]


class Leads(NamedTuple):
    """The electrodes with the effects across them.

    Attributes
    ----------
    port : Port
        What a shunt sees: its current is what the transducer gives less what the effects draw.
    equations : list of Row
        Of the effects' own states.
    """

    port: Port
    equations: list[Row]


def leads(transducer: Transducer, port: Port, z: Rows, dz: Rows) -> Leads:
    """Connect the effects to the electrodes, whose load current is not known before."""
    current, equations = -dz["q"], []
    for effect, prefix in effect_prefixes(transducer):
        own_z, own_dz = own_rows(z, prefix, effect.states()), own_rows(dz, prefix, effect.states())
        current = current - effect.current(port, own_z, own_dz)
        equations += effect.equations(port, own_z, own_dz)
    return Leads(port._replace(i=current), equations)
