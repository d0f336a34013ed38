"""A stop operator as netlist elements."""

from __future__ import annotations

from piezoharvest.spice.deck import Deck, number
from piezoharvest.spice.operating_point import OperatingPoint

# It leaves its slope over this share of its threshold; the area of its loop is wrong by about the square of it.
KNEE = 0.02


def write_stop(deck: Deck, scene: OperatingPoint, name: str, rate: str, threshold: float) -> None:
    """Node of a stop operator over its threshold, within -1 and 1: a capacitor that integrates while it sticks."""
    deck.add(f"B{name}rate {name}rate 0 V=({rate})*{number(1 / (scene.omega * threshold))}")
    deck.add(f"C{name} {name} 0", 1 / scene.omega, "IC=0")
    up, down = (f"min(1, max(0, (1{sign}V({name}))*{number(1 / KNEE)}))" for sign in "-+")
    deck.add(f"B{name} 0 {name} I=max(V({name}rate), 0)*{up} + min(V({name}rate), 0)*{down}")
