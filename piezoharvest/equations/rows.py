"""The transducer's equations as rows: the single definition of its physics, used by every view of it.

Rows (see `circuit`) have names: x1, u1, x2, ... displacements and velocities of the modes, q the charge q_p.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Pair, Transducer
from piezoharvest.equations.laws import charge_law, drive_gain, momentum, node_law, participating, spring
from piezoharvest.equations.terms import Rows, Terms


class Placing:
    """Terms in the columns of a view.

    Parameters
    ----------
    terms : Terms
    z, dz : mapping of str to Row
        States of transducer and effects with the effects' stops, by name, and their rates.
    drive, one : Row
    v_h, dv_h : Row
        Voltage of the hysteresis and its rate.

    Attributes
    ----------
    v_t, dv_t : Row
        Voltage across C and its rate: C v_t = q - sum T_i x_i - charges of effects.
    current : Row
        Load current: the transducer's current less that drawn by effects.
    """

    def __init__(self, terms: Terms, z: Rows, dz: Rows, drive: Row, one: Row, v_h: Row) -> None:
        self.terms = terms
        self._rows = {**z, **{name + "'": row for name, row in dz.items()}, "drive": drive, "one": one, "v_h": v_h}
        charges, share = _without(terms.charges, terms.columns["v_t"])
        capacitance = terms.transducer.capacitance + share
        inside = -charge_law(capacitance, 0.0, terms.strain_charge, charges, terms.q)
        self.v_t, self.dv_t = (terms.over(inside, rows, stops=True) / capacitance for rows in (z, dz))
        self._none = 0.0 * one
        drawn, share = _without(terms.drawn, terms.columns["i"])
        self._rows["v_t"] = self.v_t
        self.current = self._rows["i"] = -node_law(dz["q"], 0.0, self.row(drawn)) / (1.0 + share)

    def row(self, row: Row) -> Row:
        """A row of the terms as one of the view."""
        parts = (factor * self._rows[name] for name, factor in self.terms.used(row).items())
        return sum(parts, self._none)

    def rows(self, rows: Sequence[Row]) -> list[Row]:
        """Rows of the terms as those of the view."""
        return [self.row(row) for row in rows]

    def product(self, product: Product) -> Product:
        """A product of rows of the terms as one of the view."""
        return Product(product.coefficient, self.row(product.first), self.row(product.second))


def _without(row: Row, column: int) -> tuple[Row, np.ndarray | float]:
    """A row with a column set to zero, and the coefficient in it, a number unless the row has a batch."""
    share, rest = row[..., column : column + 1], row.copy()
    rest[..., column] = 0.0
    return rest, share if row.ndim > 1 else share[0]


@dataclass(frozen=True)
class Ports:
    """Ports of all electrodes, the transducer's own first.

    Attributes
    ----------
    all : tuple of Port
    charged : tuple of int
        Numbers of the electrodes whose charges are states. The others are open: a voltage that follows the motion.
    """

    all: tuple[Port, ...]
    charged: tuple[int, ...]

    def __getitem__(self, number: int) -> Port:
        return self.all[number]


def further_ports(transducer: Transducer, z: Rows, dz: Rows, one: Row) -> list[Port]:
    """Ports of the further electrodes: C v = q - sum T_i x_i; q is zero where z has no state "q1", ... of them."""
    found = []
    for number, electrode in enumerate(transducer.all_electrodes[1:], 1):
        name = f"q{number}"
        v, dv = (
            (rows.get(name, 0.0 * one) - _by_coupling(electrode, rows, "x", one)) / electrode.capacitance
            for rows in (z, dz)
        )
        strain_current = _by_coupling(electrode, z, "u", one)
        found.append(Port(v, dv, -dz.get(name, 0.0 * one), one, electrode.capacitance, strain_current))
    return found


def _by_coupling(electrode: Pair, rows: Rows, state: str, one: Row) -> Row:
    """Sum over the modes of a state by an electrode's coupling."""
    pairs = enumerate(electrode.couplings, 1)
    return sum((coupling * rows[f"{state}{n}"] for n, coupling in pairs), 0.0 * one)


class Mechanics(NamedTuple):
    """Equations of motion and outputs of the mechanics.

    Attributes
    ----------
    equations : list of Row
        Two for each mode, zero along every motion.
    displacement, velocity, acceleration : Row
        Participation-weighted sums of the modes, m, m/s and m/s^2.
    drive_velocity : Row
        Conjugate of the drive, whose product with it is its power: W per N, or per m/s^2.
    drive : Row
        The drive; of an imposed motion the force that it takes, but for the inertia, N.
    """

    equations: list[Row]
    displacement: Row
    velocity: Row
    acceleration: Row
    drive_velocity: Row
    drive: Row


def gains(transducer: Transducer, base: bool) -> list[float]:
    """Factor from the drive to each mode's force: its share of a force, or a mass in kg."""
    return [drive_gain(mode, base) for mode in transducer.all_modes]


def mechanics(
    placing: Placing, further: Sequence[Port], z: Rows, dz: Rows, drive: Row, base: bool, imposed: bool = False
) -> Mechanics:
    """Equations of motion of all modes under a force or a base acceleration, or of one mode with this acceleration.

    The voltages of `further` electrodes act on the modes beside that of the transducer's own. An imposed motion is
    integrated from its acceleration, so that its extrema are where its velocity crosses zero.
    """
    transducer = placing.terms.transducer
    modes, by = transducer.all_modes, gains(transducer, base)
    places = (("x", z), ("u", z), ("u", dz), ("x", dz))
    x, u, du, dx = ([rows[f"{s}{n}"] for n in range(1, len(modes) + 1)] for s, rows in places)
    equations = []
    for n, (mode, push) in enumerate(zip(modes, placing.rows(placing.terms.pushes), strict=True)):
        for electrode, port in zip(transducer.electrodes, further, strict=True):
            push = push + electrode.couplings[n] * port.v
        moves = momentum(mode, x[n], u[n], du[n], placing.v_t, by[n] * drive + push)
        taken = spring(mode, x[n], u[n], placing.v_t, push) if imposed else drive
        equations += [dx[n] - u[n], du[n] - drive if imposed else moves]
    none = 0.0 * drive
    return Mechanics(
        equations,
        displacement=participating(modes, x, none),
        velocity=participating(modes, u, none),
        acceleration=participating(modes, du, none),
        drive_velocity=sum((gain * row for gain, row in zip(by, u, strict=True)), none),
        drive=taken,
    )


def own_rows(rows: Rows, prefix: str, states: Sequence[State]) -> SimpleNamespace:
    """Rows of a component's states under its own names for them."""
    return SimpleNamespace(**{state.name: rows[prefix + state.name] for state in states})


class Device(NamedTuple):
    """A transducer with its effects in the rows of a view.

    Attributes
    ----------
    placing : Placing
        The effects' terms in these rows.
    motion : Mechanics
    ports : Ports
        Of all electrodes; the current of the transducer's own is less that drawn by the effects.
    equations : list of Row
        Of the states that effects add.
    """

    placing: Placing
    motion: Mechanics
    ports: Ports
    equations: list[Row]


def device(
    terms: Terms, z: Rows, dz: Rows, drive: Row, one: Row, hysteresis: tuple[Row, Row], base: bool,
    imposed: bool = False,
) -> Device:  # fmt: skip
    """Write down the equations, given v_h and its rate as rows."""
    v_h, dv_h = hysteresis
    placing = Placing(terms, z, dz, drive, one, v_h)
    transducer = terms.transducer
    strain_current = _by_coupling(transducer.all_electrodes[0], z, "u", one)
    own = Port(placing.v_t + v_h, placing.dv_t + dv_h, placing.current, one, transducer.capacitance, strain_current)
    further = further_ports(transducer, z, dz, one)
    charged = (0, *(number for number in range(1, 1 + len(further)) if f"q{number}" in z))
    return Device(
        placing,
        mechanics(placing, further, z, dz, drive, base, imposed),
        Ports((own, *further), charged),
        placing.rows(terms.equations),
    )


def connected(system: System) -> System:
    """The system with the shunt as its effects modify it."""
    shunt = system.shunt
    for effect in system.transducer.effects:
        shunt = effect.connect(shunt)
    return System(system.transducer, shunt)
