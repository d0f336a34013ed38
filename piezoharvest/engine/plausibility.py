"""Whether the averages of a run can be trusted: what energy and passive circuits must obey, for one design or many.

None of it asks how the engine came to a result. A motion that has blown up repeats itself as well as any other, and
closes its own account.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.description.excitation import Excitation, Tones
from piezoharvest.description.transducer import Transducer
from piezoharvest.engine.lowering.lower import Lowered
from piezoharvest.equations.rows import gains

CLOSURE = 1e-8  # energy that no entry accounts for, relative, beyond which a result is not trusted
FREE = 1e-3  # of the energy stored at the beginning: a motion that gets or loses less is measured against that
DRIFT = 1e-4  # change of the stored energy over a period, relative, by which no average may be off
LOSSLESS = 1e-14  # of the stored energy, some 45 units in the last place: where nothing more flows, it is rounding
LOSSES = ("damping", "hysteresis", "shunt_loss")
CERTAIN = 1e-6  # relative rounding of powers, by which a bound may be passed
DIGITS = 1e-6  # of the harvested power: what is less certain is said


class Bounds(NamedTuple):
    """What limits the energies of a period, J; arrays where a batch has several designs.

    Attributes
    ----------
    supplied : float
        The most that the drive can give to a passive device: sum F^2/(2 b) over its tones and the modes, for a period.
    rounding : float
        What double precision leaves of the work of the drive, given the squared displacement amplitude (m^2): J/m^2.
    """

    supplied: Any
    rounding: Any


NO_BOUNDS = Bounds(np.inf, 0.0)


def bounds(transducer: Transducer, excitation: Excitation, lowered: Lowered) -> Bounds:
    """Bounds on the energies of a period in the steady state under tones.

    Force and velocity are in quadrature far from resonance, and the work of the drive is a small difference of the
    energy that goes to and fro, 2 pi k x^2 or 2 pi m u^2. A velocity far below resonance is itself what rounding of the
    displacement, times the resonance frequency, leaves of it.
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
    """A quantity without the trailing axis that batches carry."""
    value = np.real(np.asarray(value))
    return value[..., 0] if value.ndim else value


def cleaned(energy: Mapping[str, float], before: float) -> dict[str, float]:
    """Energies of a steady state without what only rounding has made of nothing.

    Parameters
    ----------
    energy : mapping of str to float
        As in `Response`, but for "stored" and "closure".
    before : float
        Stored energy where the period began, J.

    Returns
    -------
    dict of str to float
        All zero where nothing flows but rounding of what is stored, as in a device without losses; no harvest where it
        is less than nothing by rounding of what flows.
    """
    sizes = [abs(value) for value in energy.values()]
    if max(sizes) <= LOSSLESS * abs(before):
        return dict.fromkeys(energy, 0.0)
    return {**energy, "harvested": float(harvest(energy))}


def harvest(energy: Mapping[str, Any]) -> Any:
    """Harvested energy; nothing where it is less than that by rounding of what flows."""
    flows = np.max(np.abs(np.broadcast_arrays(*energy.values())), axis=0)
    harvested = energy["harvested"]
    return np.where((harvested < 0.0) & (harvested >= -CERTAIN * flows), 0.0, harvested)


@np.errstate(all="ignore")
def closure(energy: Mapping[str, Any], change: Any, before: Any = 0.0) -> tuple[Any, Any]:
    """Share of the energy that flows which no entry accounts for, and what it is a share of (J).

    Parameters
    ----------
    energy : mapping of str to float or array
        As in `Response`, but for "stored" and "closure".
    change, before : float or array
        Change of the stored energy, J; and what is stored where a transient began, as a motion that gets or loses less
        than a thousandth of that is measured against it. In a steady state nothing but what flows counts.
    """
    supplied = energy["mechanical_in"] + energy.get("source", 0.0)
    spent = sum(value for name, value in energy.items() if name not in ("mechanical_in", "source"))
    sizes = np.abs([supplied, *np.broadcast_arrays(*energy.values()), FREE * np.abs(before) + 0.0 * supplied])
    largest = np.max(sizes, axis=0)
    gap = np.abs(supplied - spent - change)
    return np.divide(gap, largest, out=np.zeros_like(gap + largest), where=largest > 0), largest


@np.errstate(all="ignore")
def faults(energy: Mapping[str, Any], change: Any, before: Any, amplitude: Any, most: Bounds, periodic: bool) -> dict:
    """What is wrong with the energies of a run: a sentence, and for which designs it holds.

    Parameters
    ----------
    energy, change, before
        As in `closure`.
    amplitude : float or array
        Of the displacement, m.
    most : Bounds
    periodic : bool
        Whether they are those of a steady state, in which nothing is stored.

    Returns
    -------
    dict of str to bool or array
    """
    gap, largest = closure(energy, change, 0.0 if periodic else before)
    supplied, harvested = energy["mechanical_in"] + energy.get("source", 0.0), energy["harvested"]
    # What flows, however much is stored: a power is no more certain for the energy of a preload.
    flows = np.max(np.abs([supplied, *np.broadcast_arrays(*energy.values())]), axis=0)
    rounding = np.minimum(most.rounding * np.square(amplitude), CERTAIN * flows)
    finite = np.isfinite(largest) & np.isfinite(gap) & np.isfinite(amplitude) & np.isfinite(change)
    # What an effect gives, a bias current for one, has a negative sign.
    takes = [value for name, value in energy.items() if name not in ("mechanical_in", "source", "harvested")]
    given = supplied - sum(np.minimum(value, 0.0) for value in takes)
    passive = given <= energy["mechanical_in"] + CERTAIN * flows
    own = [energy.get(name, 0.0) for name in LOSSES]
    return {
        "its energies are not finite": ~finite,
        "energy does not close": finite & (gap * largest > np.maximum(CLOSURE * largest, rounding)),
        "the stored energy changes from period to period": (
            finite & periodic & (np.abs(change) > DRIFT * np.abs(supplied) + rounding)
        ),
        "more power comes in than the drive can give, sum F^2/(2 b)": (
            finite & periodic & passive & (energy["mechanical_in"] > (1.0 + CERTAIN) * most.supplied + rounding)
        ),
        "a loss is negative": finite & np.any([value < -CERTAIN * flows for value in own], axis=0),
        "less than nothing is harvested, or more than comes in": finite & (
            (harvested < -CERTAIN * flows) | (harvested > given + (0.0 if periodic else before) + CERTAIN * flows)
        ),
    }  # fmt: skip


def uncertain(harvested: float, off: float) -> str:
    """A sentence on the digits of the harvested energy, where energy closes to less than these.

    Parameters
    ----------
    harvested, off : float
        As it was computed, and what no entry accounts for, J.
    """
    if not off > DIGITS * abs(harvested) > 0.0:
        return ""
    digits = int(-np.log10(off / harvested)) if off < harvested else 0
    confirmed = f"no more than {digits} of its digits" if digits else "none of its digits"
    return f"the harvested power is so small a share of the mechanical one that the energy balance confirms {confirmed}"
