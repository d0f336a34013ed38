"""Phases of a load that wakes, sends and sleeps, one after the other without end."""

from __future__ import annotations

from dataclasses import dataclass

from piezoharvest.description.parameters import Component, described, quantity


@dataclass(frozen=True, kw_only=True)
class LoadPhase(Component):
    """One phase of the load of a supply: its power, and for how long.

    The phases follow each other from the first one on when the supply turns on, and begin again after the last. Where
    the supply turns off, whatever phase there was ends without its packet.
    """

    power: float = quantity("W", "power of the load in this phase, in addition to that of the storage", at_least=0)
    duration: float = quantity("s", "duration of the phase", above=0)
    sends: bool = described("whether a packet has been sent at the end of the phase", default=False)
