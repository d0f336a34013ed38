"""Stop operators as netlist elements: of mechanical rates as integrators, of the charge as a Maxwell-slip network."""

from __future__ import annotations

from piezoharvest.equations.terms import StopElement
from piezoharvest.spice.deck import Deck, number
from piezoharvest.spice.operating_point import OperatingPoint

# Saturation is smoothed over this fraction of the threshold; the relative error of the loop's area is about its square.
SATURATION_SHARE = 0.02
# A Maxwell-slip element goes beyond its limit by this share of it at the usual current, and its corner is as round.
# A discharge takes some hundred times that current: its loops miss as much more of their area.
OVERSHOOT = 1e-5


def write_stop(deck: Deck, point: OperatingPoint, stop: StopElement, rate: str) -> None:
    """Node of a stop operator divided by its threshold, from -1 to 1: a capacitor that integrates while it sticks."""
    name = stop.name
    deck.add(f"B{name}rate {name}rate 0 V=({rate})*{number(1 / (point.omega * stop.threshold))}")
    deck.add(f"C{name} {name} 0 {number(1 / point.omega)} IC={number(point.initial(name) / stop.threshold)}")
    up, down = (f"min(1, max(0, (1{sign}V({name}))*{number(1 / SATURATION_SHARE)}))" for sign in "-+")
    deck.add(f"B{name} 0 {name} I=max(V({name}rate), 0)*{up} + min(V({name}rate), 0)*{down}")


def write_slip(deck: Deck, point: OperatingPoint, n: int, nodes: tuple[str, str], threshold: float, weight: float):
    """Maxwell-slip element of the charge that passes it: a capacitor, and beside it what conducts at its limit.

    Its voltage is the stop operator times its weight (V/C): the capacitor sticks, and slips while the limit conducts.
    """
    capacitance, limit = deck.parameter(f"capacitance_slip{n}", 1 / weight), deck.parameter(
        f"limit_slip{n}", weight * threshold)  # fmt: skip
    deck.add(f"Cslip{n} {nodes[0]} {nodes[1]} {capacitance} IC={number(weight * point.initial(f'stop{n}'))}")
    # Overshoot in passing the current, and rounding of the corner, as shares of the limit.
    conductance = number(point.current / (OVERSHOOT * weight * threshold))
    corner = number((OVERSHOOT * weight * threshold) ** 2)
    across = f"V({nodes[0]},{nodes[1]})"
    passed = []
    for sign in ("", "-"):
        excess = f"({sign}{across}-{limit})"
        passed.append(f"({excess} + sqrt({excess}*{excess}+{corner}))")
    deck.add(f"Bslip{n} {nodes[0]} {nodes[1]} I={conductance}*({passed[0]} - {passed[1]})")
