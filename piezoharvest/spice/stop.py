"""A stop operator as netlist elements."""

from __future__ import annotations

from piezoharvest.spice.deck import Deck, number
from piezoharvest.spice.operating_point import OperatingPoint

# Saturation is smoothed over this fraction of the threshold; the relative error of the loop's area is about its square.
SATURATION_SHARE = 0.02


def write_stop(deck: Deck, point: OperatingPoint, name: str, rate: str, threshold: float) -> None:
    """Node of a stop operator divided by its threshold, from -1 to 1: a capacitor that integrates while it sticks."""
    deck.add(f"B{name}rate {name}rate 0 V=({rate})*{number(1 / (point.omega * threshold))}")
    deck.add(f"C{name} {name} 0", 1 / point.omega, "IC=0")
    up, down = (f"min(1, max(0, (1{sign}V({name}))*{number(1 / SATURATION_SHARE)}))" for sign in "-+")
    deck.add(f"B{name} 0 {name} I=max(V({name}rate), 0)*{up} + min(V({name}rate), 0)*{down}")
