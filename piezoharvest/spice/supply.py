"""What a storage capacitor feeds, as netlist elements: lockout, converter, protection, load, control of a switch."""

from __future__ import annotations

import math

from piezoharvest.description.shunts.cold_start import StartedSwitch
from piezoharvest.description.shunts.storage import Storage
from piezoharvest.spice.deck import Deck, number
from piezoharvest.spice.operating_point import OperatingPoint

# Smoothing of the comparator, as a share of its hysteresis, and its time constant as one of the period.
COMPARATOR, DECISION = 1e-4, 1e-3
EDGE = 1e-3  # of a phase: its power rises and falls in this share of it
# Protection: its resistance over that of the expected current at its limit, and the smoothing of its corner.
PROTECTION, CORNER = 1e-4, 1e-5


def write_supply(
    deck: Deck, storage: Storage, point: OperatingPoint, nodes: tuple[str, str], store: tuple[str, str]
) -> str:
    """Supply between two nodes that a `store` between two nodes feeds; return the power into its load."""
    deck.section("supply: V(supply) is 1 while it is on, and lowers the voltage at which it would turn on")
    on, off, limit = (
        deck.parameter(name, value)
        for name, value in (
            ("turn_on", storage.turn_on), ("turn_off", storage.turn_off), ("max_voltage", storage.limit),
        )
    )  # fmt: skip
    _write_comparator(deck, "supply", (on, off), storage.turn_on - storage.turn_off, point, storage.turn_on)
    drawn, power = _write_load(deck, storage, DECISION * 2 * math.pi / point.omega)
    deck.add(f"Bload {' '.join(nodes)} I=V(supply)*({drawn})/max(V(dc),0.5*{off})")
    corner, least = number((CORNER * storage.limit) ** 2), number(PROTECTION * storage.limit / point.current)
    across = "-".join(f"V({node})" for node in store if node != "0") if store != nodes else "V(dc)"
    excess = f"({across}-{limit})"
    deck.add(f"Bprotection {' '.join(store)} I=0.5/{least}*({excess} + sqrt({excess}*{excess}+{corner}))")
    return f"V(supply)*({power})"


def write_control(deck: Deck, shunt: StartedSwitch, point: OperatingPoint) -> None:
    """Node `powered`: 1 while the dc side powers the control of the switch; without that no pulse is there."""
    assert shunt.start_voltage is not None  # asked for where there is one
    deck.section("control of the switch: V(powered) is 1 while the dc side powers it")
    # Where it never loses its power, a voltage that the dc side does not come to.
    lowest = -shunt.start_voltage if shunt.stop_voltage is None else shunt.stop_voltage
    ends = deck.parameter("start_voltage", shunt.start_voltage), deck.parameter("stop_voltage", lowest)
    _write_comparator(deck, "powered", ends, shunt.start_voltage - lowest, point, shunt.start_voltage)


def _write_comparator(
    deck: Deck, node: str, ends: tuple[str, str], band: float, point: OperatingPoint, upper: float
) -> None:
    """A node that is 1 from the upper one of two dc voltages on, until it falls to the lower one, `band` (V) below."""
    above = f"(V(dc)-{ends[0]}+({ends[0]}-{ends[1]})*V({node}))"
    deck.add(f"B{node} wanted_{node} 0 V={_above_zero(above, COMPARATOR * band)}")
    deck.add(f"R{node} wanted_{node} {node} 1")
    begins = int(point.initial("dc") >= upper)
    deck.add(f"C{node} {node} 0", DECISION * 2 * math.pi / point.omega, f"IC={begins}")


def _write_load(deck: Deck, storage: Storage, decision: float) -> tuple[str, str]:
    """Powers out of the store and into the load while the supply is on, as expressions."""
    if not storage.phases:
        power = deck.parameter("power_load", storage.power)
        return f"{power}/({_efficiency(storage, 0)})", power
    cycle = sum(float(phase.duration) for phase in storage.phases)
    deck.comment("V(timer) counts the cycles of the load since the supply turned on; a phase is a window of its angle.")
    deck.add(f"Btimer 0 timer I=V(supply)/{number(cycle)}-(1-V(supply))*V(timer)/{number(decision)}")
    deck.add("Ctimer timer 0 1 IC=0")
    begins, drawn, powers = 0.0, [], []
    for n, phase in enumerate(storage.phases):
        ends = begins + float(phase.duration) / cycle
        power = deck.parameter(f"power_phase{n}", storage.power_in(n))
        if len(storage.phases) == 1:
            deck.add(f"Bphase{n} phase{n} 0 V=1")
        else:
            deck.add(f"Bphase{n} phase{n} 0 V={_window(begins, ends)}")
        powers.append(f"V(phase{n})*{power}")
        drawn.append(f"{powers[-1]}/({_efficiency(storage, n)})")
        begins = ends
    return " + ".join(drawn), " + ".join(powers)


def _window(begins: float, ends: float) -> str:
    """1 while the share of the cycle lies between two values, else 0."""
    half, middle = math.pi * (ends - begins), math.pi * (ends + begins)
    cosine = f"(sin(6.28318530718*V(timer)-{number(middle - 0.5 * math.pi)})-({number(math.cos(half))}))"
    return _above_zero(cosine, abs(math.sin(half)) * EDGE * 2 * half)


def _above_zero(what: str, width: float) -> str:
    """1 where an expression is above zero, else 0, with an edge of this width."""
    return f"0.5+0.5*{what}/sqrt({what}*{what}+{number(width**2)})"


def _efficiency(storage: Storage, phase: int) -> str:
    """Efficiency of the converter in a phase, as a number or an expression of the store's voltage."""
    curve = storage.efficiency_curve
    if curve is None or curve.voltages is None:
        return number(storage.efficiency_at(storage.turn_on, phase))
    terms = [number(curve.efficiencies[0])]
    for n in range(len(curve.voltages) - 1):
        (low, high), (before, after) = curve.voltages[n : n + 2], curve.efficiencies[n : n + 2]
        slope = number((after - before) / (high - low))
        terms.append(f"({slope})*(max({number(low)},min({number(high)},V(dc)))-{number(low)})")
    return " + ".join(terms)
