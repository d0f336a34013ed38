"""Checks of the averages of a run against energy conservation and the bounds of passive circuits, for any batch.

The checks do not depend on how the engine obtained a result: a diverged motion may be periodic and close its own energy
balance as well as any other.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.description.excitation import Excitation, Tones
from piezoharvest.description.transducer import Transducer
from piezoharvest.engine.lowering.lower import Lowered
from piezoharvest.equations.rows import gains

MAX_CLOSURE = 1e-8  # relative imbalance of energy beyond which a result is not trusted
# Of the energy stored at the beginning: the imbalance of a motion that exchanges less is relative to that.
MIN_FLOW_SHARE = 1e-3
MAX_DRIFT = 1e-4  # largest relative change of the stored energy over a period
ROUNDING_FLOW = 1e-14  # of the stored energy, some 45 units in the last place: a smaller flow of energy is rounding
LOSSES = ("damping", "hysteresis", "shunt_loss")
BOUND_TOLERANCE = 1e-6  # relative rounding of powers, by which a bound may be exceeded
HARVEST_TOLERANCE = 1e-6  # of the harvested power: a larger uncertainty is reported


class Bounds(NamedTuple):
    """Bounds of the energies of a period, J; arrays for a batch of designs.

    Attributes
    ----------
    supplied : float
        Largest work of the drive on a passive device in a period: sum F^2/(2 b) over its tones and the modes.
    rounding : float
        Rounding error of the work of the drive per squared displacement amplitude: J/m^2.
    """

    supplied: Any
    rounding: Any


NO_BOUNDS = Bounds(np.inf, 0.0)


def bounds(transducer: Transducer, excitation: Excitation, lowered: Lowered) -> Bounds:
    """Bounds on the energies of a period in the steady state under tones.

    Force and velocity are in quadrature far from resonance, and the work of the drive is a small difference of the
    energy that is exchanged, 2 pi k x^2 or 2 pi m u^2. A velocity far below resonance has the error of the
    displacement's rounding times the resonance frequency.
    """
    signal, period = lowered.signal, excitation.period
    if not isinstance(signal, Tones) or period is None:
        return NO_BOUNDS
    squared = np.sum(np.square(np.real(signal.amplitudes)), axis=-1)
    given: Any = 0.0
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        for mode, gain in zip(transducer.all_modes, gains(transducer, excitation.base), strict=True):
            force, damping = _flat(gain) ** 2 * squared, _flat(mode.damping)
            given = given + np.where(force > 0, force / (2.0 * damping), 0.0)
        stiffness = _flat(transducer.stiffness)
        ratio = 2.0 * np.pi / (_flat(period) * np.sqrt(stiffness / _flat(transducer.mass)))
        rounding = np.finfo(float).eps * 2.0 * np.pi * stiffness * np.maximum(ratio**2, 1.0 / ratio)
    return Bounds(given * _flat(period), rounding)


def _flat(value: Any) -> Any:
    """Quantity without the trailing axis of length one that batches have."""
    value = np.real(np.asarray(value))
    return value[..., 0] if value.ndim else value


def without_rounding(energy: Mapping[str, float], before: float) -> dict[str, float]:
    """Energies of a steady state with those set to zero that are rounding only.

    Parameters
    ----------
    energy : mapping of str to float
        As in `Response`, but for "stored" and "closure".
    before : float
        Stored energy at the beginning of the period, J.

    Returns
    -------
    dict of str to float
        All zero if the flows are only rounding of the stored energy, as in a device without losses; the harvest is zero
        if it is negative by rounding of the flows.
    """
    sizes = [abs(value) for value in energy.values()]
    if max(sizes) <= ROUNDING_FLOW * abs(before):
        return dict.fromkeys(energy, 0.0)
    return {**energy, "harvested": float(harvest(energy))}


def harvest(energy: Mapping[str, Any]) -> Any:
    """Harvested energy; zero where it is negative by rounding of the flows."""
    flows = np.max(np.abs(np.broadcast_arrays(*energy.values())), axis=0)
    harvested = energy["harvested"]
    return np.where((harvested < 0.0) & (harvested >= -BOUND_TOLERANCE * flows), 0.0, harvested)


@np.errstate(all="ignore")
def closure(energy: Mapping[str, Any], change: Any, before: Any = 0.0) -> tuple[Any, Any]:
    """Imbalance of energy relative to the energy that flows, and that energy (J).

    Parameters
    ----------
    energy : mapping of str to float or array
        As in `Response`, but for "stored" and "closure".
    change, before : float or array
        Change of the stored energy, J; and the stored energy at the beginning of a transient: the imbalance is relative
        to a thousandth of it if less flows. For a steady state zero, as only flows count.
    """
    supplied = energy["mechanical_in"] + energy.get("source", 0.0)
    spent = sum(value for name, value in energy.items() if name not in ("mechanical_in", "source"))
    sizes = np.abs([supplied, *np.broadcast_arrays(*energy.values()), MIN_FLOW_SHARE * np.abs(before) + 0.0 * supplied])
    largest = np.max(sizes, axis=0)
    gap = np.abs(supplied - spent - change)
    return np.divide(gap, largest, out=np.zeros_like(gap + largest), where=largest > 0), largest


@np.errstate(all="ignore")
def faults(energy: Mapping[str, Any], change: Any, before: Any, amplitude: Any, most: Bounds, periodic: bool) -> dict:
    """Faults of the energies of a run: messages, each with the designs it applies to.

    Parameters
    ----------
    energy, change, before
        As in `closure`.
    amplitude : float or array
        Displacement amplitude, m.
    most : Bounds
    periodic : bool
        The energies are those of a steady state, in which the stored energy does not change.

    Returns
    -------
    dict of str to bool or array
    """
    gap, largest = closure(energy, change, 0.0 if periodic else before)
    supplied, harvested = energy["mechanical_in"] + energy.get("source", 0.0), energy["harvested"]
    # The flow of energy, without the stored energy: a preload's energy does not make a power more certain.
    flows = np.max(np.abs([supplied, *np.broadcast_arrays(*energy.values())]), axis=0)
    rounding = np.minimum(most.rounding * np.square(amplitude), BOUND_TOLERANCE * flows)
    finite = np.isfinite(largest) & np.isfinite(gap) & np.isfinite(amplitude) & np.isfinite(change)
    # Energy that an effect supplies, such as a bias current, has a negative sign.
    takes = [value for name, value in energy.items() if name not in ("mechanical_in", "source", "harvested")]
    given = supplied - sum(np.minimum(value, 0.0) for value in takes)
    passive = given <= energy["mechanical_in"] + BOUND_TOLERANCE * flows
    own = [energy.get(name, 0.0) for name in LOSSES]
    return {
        "its energies are not finite": ~finite,
        "energy does not close": finite & (gap * largest > np.maximum(MAX_CLOSURE * largest, rounding)),
        "the stored energy changes from period to period": (
            finite & periodic & (np.abs(change) > MAX_DRIFT * np.abs(supplied) + rounding)
        ),
        "more power comes in than the excitation can supply, sum F^2/(2 b)": (
            finite & periodic & passive & (energy["mechanical_in"] > (1.0 + BOUND_TOLERANCE) * most.supplied + rounding)
        ),
        "a loss is negative": finite & np.any([value < -BOUND_TOLERANCE * flows for value in own], axis=0),
        "the harvested power is negative, or larger than the power that comes in": finite & (
            # What control takes is a loss as well, and may be more than the circuit gives.
            (harvested + np.maximum(energy["shunt_loss"], 0.0) < -BOUND_TOLERANCE * flows)
            | (harvested > given + (0.0 if periodic else before) + BOUND_TOLERANCE * flows)
        ),
    }  # fmt: skip


def uncertainty_message(harvested: float, off: float) -> str:
    """Message on the uncertainty of the harvested energy, empty if the imbalance of energy is far below it.

    Parameters
    ----------
    harvested, off : float
        Harvested energy as computed, and imbalance of energy, J.
    """
    if not off > HARVEST_TOLERANCE * abs(harvested) > 0.0:
        return ""
    digits = int(-np.log10(off / harvested)) if off < harvested else 0
    confirmed = f"only {digits} of its digits" if digits else "none of its digits"
    return f"the harvested power is too small a fraction of the mechanical one: the energy balance confirms {confirmed}"
