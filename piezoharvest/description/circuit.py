"""The words in which shunts and effects write their equations.

A `Row` is a linear form over everything that moves: the states, their derivatives, the excitation and the constant 1.
A component receives rows for its port and its states, combines them with its own coefficients, and returns rows that
are zero (equations), that rise through zero (guards) or that multiply to a power. Evaluated once on unit vectors, they
are the matrices of a linear mode; no component fills an index by hand.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

from numpy.typing import NDArray

Row: TypeAlias = NDArray[Any]
Number: TypeAlias = float | NDArray[Any]  # an array in a batch of designs


class Port(NamedTuple):
    """The transducer's electrodes as a component sees them.

    Attributes
    ----------
    v, dv : Row
        Electrode voltage v_p (V) and its time derivative (V/s).
    i : Row
        Load current (A): what flows out of the transducer into the shunt.
    one : Row
        The constant 1.
    capacitance : float
        Clamped capacitance C of the transducer in F: what a controller is tuned to.
    """

    v: Row
    dv: Row
    i: Row
    one: Row
    capacitance: float


class State(NamedTuple):
    """A state that a component adds.

    Attributes
    ----------
    name : str
    storage : float
        Stored energy is storage * z^2 / 2: an inductance, a capacitance (negative for a negative one).
    odd : bool
        Whether the state changes sign when excitation and electrodes are mirrored (a rectified voltage does not).
    """

    name: str
    storage: float
    odd: bool = True


class Product(NamedTuple):
    """Power in W as coefficient * first * second."""

    coefficient: Number
    first: Row
    second: Row


class Guard(NamedTuple):
    """Leaves a configuration for `target` where `rises` goes up through zero; `cut` names a state zeroed then."""

    rises: Row
    target: str
    cut: str | None = None


class Switch(NamedTuple):
    """A switch that acts at the extremum of sum T_i x_i.

    Attributes
    ----------
    lag : float
        Seconds from the extremum to the action, >= 0 (an early action is timed from the extremum before).
    on_time : float
        Seconds that the switch stays closed; 0 for one that takes the electrode voltage to zero at once.
    hold_off : float
        No new action sooner than this after the last, s.
    early : bool
        Whether `lag` was counted from the extremum before, of the other kind.
    efficiency : float
        Share of the energy taken that is harvested when the voltage is taken to zero at once.
    """

    lag: float
    on_time: float
    hold_off: float
    early: bool = False
    efficiency: float = 0.0
