"""Curves of diodes and of closed switches in a netlist: sums of hinges, one for each corner."""

from __future__ import annotations

import numpy as np

from piezoharvest.description.shunts.bridge import Bridge
from piezoharvest.description.shunts.voltage_curve import VoltageCurve
from piezoharvest.spice.deck import number


def odd_voltage(curve: VoltageCurve, current: str) -> str:
    """Voltage of a curve that begins at zero over a current of either direction."""
    bends = [
        f"{number(change)}*(max({current}-{number(at)},0)-max(-({current})-{number(at)},0))"
        for at, change in zip(
            curve.currents[:-1], _changes([curve.piece(k)[1] for k in range(curve.pieces)]), strict=True
        )
        if change
    ]
    return " + ".join(bends) or "0"


def path_bends(shunt: Bridge, least: float) -> list[tuple[float, float]]:
    """Voltages (V) across a path of diodes at which its conductance rises, and by how much (S).

    `least` is a resistance (ohm) in line with the path.
    """
    own, curve = shunt.path_resistance + least, shunt.diode_curve
    if curve is None:
        return [(float(shunt.path_drop), 1.0 / own)]
    at = [shunt.path_drop + shunt.diodes * v + own * i for i, v in zip(curve.currents, curve.voltages, strict=True)]
    conductances = [1.0 / (own + shunt.diodes * curve.piece(k)[1]) for k in range(curve.pieces)]
    return list(zip(map(float, at[:-1]), _changes(conductances), strict=True))


def _changes(slopes: list[float]) -> list[float]:
    """Slope of the first piece, and by how much each of the others is steeper than the one before."""
    return np.diff(slopes, prepend=0.0).tolist()
