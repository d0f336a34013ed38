"""Linear forms in which shunts and effects write their equations.

A `Row` is a linear form in all variables: the states, their derivatives, the excitation and the constant 1. A component
receives rows for its port and its states, combines them with its own coefficients, and returns rows that are zero
(equations), that rise through zero (guards) or whose products are powers. Evaluated on unit vectors, they give the
matrices of a linear mode, so that no component assigns indices itself.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import numpy as np
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
        Load current (A), out of the transducer into the shunt.
    one : Row
        The constant 1.
    capacitance : float
        Clamped capacitance C of the transducer in F, to which a controller is tuned.
    strain_current : Row or None
        sum T_i x_i' (A), as a sensor of the motion beside the electrodes shows it; None where only the port is known.
    """

    v: Row
    dv: Row
    i: Row
    one: Row
    capacitance: float
    strain_current: Row | None = None


class State(NamedTuple):
    """A state that a component adds.

    Attributes
    ----------
    name : str
    storage : float
        Stored energy is storage * z^2 / 2: an inductance, a capacitance (negative for a negative one).
    odd : bool
        True if the state changes sign when excitation and electrodes are mirrored (a rectified voltage does not).
    recovered : float, optional
        With a value, the state is set to zero when the switch opens or steps on, and this share of its energy is
        harvested; the rest is lost. A state named "current" is cut so without one, and all of it is lost.
    initial : float
        Value at which a transient begins.
    stores : bool
        False for a number that a controller remembers: `storage` then only tells of what size it is.
    like : float, optional
        Storage of a state of the same size, where its own may vanish.
    only_closed : bool
        True if it is zero while all switches are open, as the current of a coil in their loop.
    """

    name: str
    storage: float
    odd: bool = True
    recovered: Number | None = None
    initial: Number = 0.0
    stores: bool = True
    like: Number | None = None
    only_closed: bool = False

    @property
    def size(self) -> Any:
        """Value at which its storage, or that of a state like it, has an energy of 1/2 J."""
        return np.abs(self.storage if self.like is None else self.like) ** -0.5


class Product(NamedTuple):
    """Power in W as coefficient * first * second."""

    coefficient: Number
    first: Row
    second: Row


# Events of guards that are neither those of diodes and switches nor untold.
EVENTS = (
    "supply turns on", "supply turns off", "store is full", "packet is sent", "switch is powered",
    "switch loses its power",
)  # fmt: skip


class Guard(NamedTuple):
    """Transition to the configuration `target` when `rises` rises through zero; `cut` names a state set to zero.

    `conducts` tells if something begins to conduct then; by default the sign at the end of the target's name does.
    `event` names what happens instead, one of `EVENTS`, "switch closes" or "switch opens"; where it is empty nothing is
    told.
    """

    rises: Row
    target: str
    cut: str | None = None
    conducts: bool | None = None
    event: str | None = None

    @property
    def begins_to_conduct(self) -> bool:
        """Whether something begins to conduct."""
        return self.target[-1] in "+-" if self.conducts is None else self.conducts


class Assignment(NamedTuple):
    """A state that a controller sets to a value, rounded to a multiple of `resolution` and kept within `limit`."""

    state: str
    value: Row
    resolution: Number = 0.0
    limit: Number = float("inf")


class Switch(NamedTuple):
    """A switch that acts at the extrema of sum T_i x_i, or a clock.

    Attributes
    ----------
    lag : float
        Seconds from the extremum to the action, >= 0 (an early action is timed from the extremum before).
    on_time : float
        Seconds that the switch stays closed; 0 for one that sets the electrode voltage to zero at once.
    hold_off : float
        Least time between two actions, s.
    early : bool
        True if `lag` is counted from the previous extremum, of the other kind.
    efficiency : float
        Share of the extracted energy that is harvested when the voltage is set to zero at once.
    drop : float
        Voltage (V) that diodes take in the path of this charge; its energy is lost before that share is taken.
    threshold : float
        Electrode voltage (V, of either sign) at an extremum, below which nothing follows from it.
    gate_energy : float
        Energy (J) that each action takes from what is harvested.
    clocked : bool
        True for a controller's clock: from the beginning, where half of the first configuration's share of `on_time` is
        over, one configuration follows the other without end.
    """

    lag: float
    on_time: float
    hold_off: float
    early: bool = False
    efficiency: float = 0.0
    drop: float = 0.0
    threshold: float = 0.0
    gate_energy: float = 0.0
    clocked: bool = False
