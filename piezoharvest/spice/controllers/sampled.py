"""A digital controller as netlist elements: samples are held by capacitors that a clock lets follow for a moment."""

from __future__ import annotations

from piezoharvest.spice.deck import Deck, number, total
from piezoharvest.spice.operating_point import NetlistCircuit, OperatingPoint

# A sample is taken during this share of the sample time, up to its instant; what is held comes as near to it as the
# exponential of minus the next number.
APERTURE, SETTLED = 0.002, 20.0
EDGE = 0.1  # share of the aperture in which the clock rises, and falls
FASTEST = 1.0  # of the sample time, in which a netlist takes so many steps as in a pulse; edges have steps of their own


def write_digital(deck: Deck, shunt, point: OperatingPoint) -> NetlistCircuit:
    """Write a digital shunt: its filter in the direct form that the engine has, from rest."""
    whole, rest = shunt.lateness()
    above, below = shunt.filter()
    first = 0.5 * (1.0 - rest) if rest <= 0.5 else 1.0 - 0.5 * rest
    deck.comment(
        f"The voltage is sampled every {number(shunt.sample_time)} s, first after {number(first * shunt.sample_time)} "
        "s. Half a sample time later each V(next...) takes over what V(memory...) or V(earlier...) has to be at the "
        f"next sample. V(command) and V(held) are currents over {number(point.current)} A."
    )
    time = shunt.sample_time
    _clock(deck, "sample", first, time)
    holds = _Holds(deck, time)
    holds.add("reading", "V(p)", "sample")
    order = len(above) - 1
    if order or whole:
        _clock(deck, "shift", first - 0.5, time)
    reading = "V(reading)"
    if shunt.resolution:
        step = deck.parameter("resolution", shunt.resolution)
        reading = f"{step}*floor(V(reading)/{step}+0.5)"
    fed_back = total((-value, f"V(memory{k})") for k, value in enumerate(below[1:], 1))
    deck.add(f"Bmemory0 memory0 0 V={reading} + {fed_back}")
    holds.line("memory", order)
    command = total((value / point.current, f"V(memory{k})") for k, value in enumerate(above))
    if shunt.saturation is not None:
        limit = number(shunt.saturation / point.current)
        command = f"max(-{limit}, min({limit}, {command}))"
    deck.add(f"Bcommand earlier0 0 V={command}")
    holds.line("earlier", whole)
    held = f"earlier{whole}"
    if rest:
        _clock(deck, "drive", first + rest, time)
        holds.add("held", f"V({held})", "drive")
        held = "held"
    deck.add(f"Gheld p 0 {held} 0", point.current)
    return NetlistCircuit(fastest=FASTEST * time)


class _Holds:
    """Sample-and-hold elements of a netlist."""

    def __init__(self, deck: Deck, time: float) -> None:
        self.deck, self.rate = deck, SETTLED / (APERTURE * time)

    def add(self, name: str, what: str, clock: str) -> None:
        """Node `name`, which follows `what` while the clock is high."""
        self.deck.add(f"Bhold_{name} 0 {name} I=V(clock_{clock})*({what}-V({name}))*{number(self.rate)}")
        self.deck.add(f"Chold_{name} {name} 0 1 IC=0")

    def line(self, name: str, count: int) -> None:
        """Nodes `name1` to `name<count>`, each of which has at a sample what the one before had until then."""
        for k in range(1, count + 1):
            self.add(f"next_{name}{k}", f"V({name}{k - 1})", "shift")
            self.add(f"{name}{k}", f"V(next_{name}{k})", "sample")


def _clock(deck: Deck, name: str, share: float, time: float) -> None:
    """Node clock_<name>, which is high for the aperture up to a share of the sample time, and at every one later."""
    width, edge = APERTURE * time, EDGE * APERTURE * time
    begins = (share % 1.0) * time - width
    if begins < 0.0:
        begins += time
    deck.add(f"Vclock_{name} clock_{name} 0 PULSE(0 1", begins, edge, edge, width - 2 * edge, time, ")")
