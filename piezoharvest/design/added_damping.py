"""Damping that a shunt adds to a mode, as vibration engineers give it."""

from __future__ import annotations

import math
from collections.abc import Iterator

from piezoharvest.description.excitation import Excitation
from piezoharvest.description.transducer import Transducer
from piezoharvest.engine.response import Response


def why_none(transducer: Transducer, excitation: Excitation) -> Iterator[str]:
    """Remark on why no added damping is given, where none can be."""
    what = "no added damping is given: it is a damping ratio of one mode"
    if transducer.modes:
        yield f"{what}, and what a shunt takes here is shared by {len(transducer.all_modes)} modes"
    elif excitation.size is None:
        yield f"{what} that a sine drives, and the excitation is {excitation.kind}"


def added_damping(response: Response | None, transducer: Transducer, excitation: Excitation) -> float | None:
    """Viscous damping ratio that takes as much energy a period as the shunt does, dE/(2 pi w sqrt(k m) x^2).

    A damper b takes pi b w x^2 of a sine of amplitude x (Den Hartog, Mechanical Vibrations, 4th ed. 1956, section 2.8);
    its ratio is b/(2 sqrt(k m)). None but for a sine on a single mode that moves.

    Parameters
    ----------
    response : Response or None
        Steady state.
    transducer : Transducer
    excitation : Excitation
    """
    if response is None or excitation.size is None or transducer.modes or not response.displacement_amplitude > 0:
        return None
    taken = response.energy["harvested"] + response.energy["shunt_loss"] - response.energy.get("source", 0.0)
    impedance = 2 * math.pi / response.period * math.sqrt(transducer.stiffness * transducer.mass)
    moved = response.displacement_amplitude / transducer.all_modes[0].seen  # of the mode, wherever it is read
    return float(taken / (2 * math.pi * impedance * moved**2))
