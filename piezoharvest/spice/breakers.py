"""Electronic breakers as netlist elements: envelope capacitors, and latches that their charge holds."""

from __future__ import annotations

import math

from piezoharvest.description.shunts.bridge import Bridge
from piezoharvest.description.shunts.self_powered.breaker import ElectronicBreaker
from piezoharvest.description.shunts.self_powered.sece import SelfPoweredSECE
from piezoharvest.description.shunts.self_powered.series_sshi import SelfPoweredSeriesSSHI
from piezoharvest.spice.bridges import BRIDGE, write_bridge, write_dc_side
from piezoharvest.spice.deck import Deck, number
from piezoharvest.spice.operating_point import NetlistCircuit, OperatingPoint
from piezoharvest.spice.stages import LoadedCoil, write_coil_to_load
from piezoharvest.spice.switching import CORE_STRAY, write_winding
from piezoharvest.spice.switching import STEEPNESS as PULSE_STEEPNESS

# Resistance of a closed breaker relative to sqrt(L/C), which is left out of the coil's, and that beside the coil, which
# takes what an edge leaves in it.
CLOSED, SNUBBER = 2e-3, 1e3
# Conductance of an open breaker relative to 1/sqrt(L/C), logarithm of the conductance per unit of a latch, and rounding
# of the corner of its diode as a share of the expected voltage.
OPEN, STEEPNESS, ROUNDING = 1e-8, 100.0, 2e-4
HELD = 3e-6  # rounding of the corner of an envelope's diode, as a share of that voltage
# Time constants as shares of a flip: with which a latch follows and a capacitor is emptied, and of what holds a latch.
FOLLOW, SPEND = 0.01, 0.5
# Shares of the expected voltage: within which a latch decides, at which what holds it counts as empty, and what keeps a
# latch set until it is, which is more than any voltage. At the second a junction may pull a capacitor down.
DECIDE, EMPTY, HOLD = 1e-4, 1e-3, 1e3
EMPTIED = 1e-3  # share of it within which the electrodes count as empty
# Share of a flip with which the path follows that: longer, it opens late (5e-3 cost 1 % of the displacement); at once,
# steps vanish in some circuits.
LEAVE = 1e-3


def write_breakers(deck: Deck, shunt: ElectronicBreaker, point: OperatingPoint) -> NetlistCircuit:
    """Coil and breakers from `p` to the ground or, of a series SSHI, to the dc side; and a bridge beside them."""
    if isinstance(shunt, SelfPoweredSECE):
        return _write_extraction(deck, shunt, point)
    in_line = isinstance(shunt, SelfPoweredSeriesSSHI)
    forward, backward = _write_coil(deck, shunt, point, in_line)
    if in_line:
        deck.section("dc side: V(dc) is the voltage behind the bridge")
        deck.add(f"Bout 0 dc I={forward} + {backward}")
        circuit = write_dc_side(deck, shunt, point)
    else:
        circuit = write_bridge(deck, shunt, point) if isinstance(shunt, Bridge) else NetlistCircuit()
    if shunt.consumption and isinstance(shunt, Bridge):
        circuit = circuit._replace(harvested=f"{circuit.harvested} - {number(shunt.consumption)}")
    return circuit._replace(fastest=shunt.nominal_flip_time(point.capacitance))


def _write_coil(deck: Deck, shunt: ElectronicBreaker, point: OperatingPoint, in_line: bool) -> tuple[str, str]:
    """Coil and both breakers; return the currents of these in the direction of their diodes."""
    impedance = math.sqrt(shunt.loop(point.capacitance)[0] / point.capacitance)
    least = CLOSED * impedance
    if shunt.self_resonance is not None:
        least = min(least, 0.1 * float(shunt.real_coil(point.capacitance).contact))
    low, high = number(math.log(OPEN)), number(math.log(impedance / least))
    latches = _write_latches(deck, shunt, point)
    deck.section("coil, and the paths of both breakers")
    extra = float(getattr(shunt, "path_resistance", 0.0)) if in_line else 0.0
    if shunt.self_resonance is None:
        _write_plain_coil(deck, shunt, point, extra - least)
    else:
        coil = shunt.real_coil(point.capacitance)
        write_winding(deck, coil, point)
        deck.add("Rclosed l k", coil.contact + extra - least)
    drop = _drop_of_path(deck, shunt) + ("+V(dc)" if in_line else "")
    corner = number((ROUNDING * point.voltage) ** 2)
    currents = []
    for latch, sign in zip(latches, ("", "-"), strict=True):
        excess = f"({sign}V(k)-({drop}))"
        conductance = f"{number(0.5 / impedance)}*exp(min({high}, max({low}, {number(STEEPNESS)}*(V({latch})-0.5))))"
        currents.append(f"{conductance}*({excess} + sqrt({excess}*{excess}+{corner}))")
    deck.add(f"Bpath k 0 I={currents[0]} - {currents[1]}")
    return currents[0], currents[1]


def _write_plain_coil(deck: Deck, shunt: ElectronicBreaker, point: OperatingPoint, extra: float) -> None:
    """Coil without a winding's capacitance from `p` to `k`, with a further resistance in series."""
    inductance, resistance = shunt.loop(point.capacitance)
    impedance = math.sqrt(inductance / point.capacitance)
    deck.add("Lloop p l", inductance, point.condition("current"))
    deck.add("Rsnubber p l", SNUBBER * impedance)
    if shunt.core_resistance is not None:
        deck.add("Rcore p l", shunt.core_resistance)
        deck.comment("A stray capacitance beside the core: without, its current may change at once, and steps vanish.")
        deck.add("Cstray p l", CORE_STRAY * point.capacitance, "IC=0")
    # What the snubber takes while a breaker is closed is left out of the coil's resistance, as in `write_coil`.
    deck.add("Rloop l k", extra + resistance - 2 * impedance / SNUBBER)


def _write_extraction(deck: Deck, shunt: SelfPoweredSECE, point: OperatingPoint) -> NetlistCircuit:
    """Breakers in front of a coil that gives its energy to the load where the electrodes are empty."""
    coil = shunt.real_coil(point.capacitance)
    impedance = math.sqrt(coil.inductance / point.capacitance)
    high, low = _write_latches(deck, shunt, point)
    deck.comment("The path of a breaker is open again where the voltage that it found has fallen to zero.")
    width = number((EMPTIED * point.voltage) ** 2)
    deck.add(f"Bsign sign 0 V=V(p)/sqrt(V(p)*V(p)+{width})")
    deck.add(f"Bpath path 0 V=0.5*(V({high})*(1+V(sign))+V({low})*(1-V(sign)))")
    deck.add("Rpath path pulsex 1")
    deck.add(f"Cpath pulsex 0 {number(LEAVE * shunt.nominal_flip_time(point.capacitance))} IC=0")
    deck.add(f"Bside side 0 V=max(-1, min(1, 4*(V({high})-V({low}))))")
    loaded = LoadedCoil(coil, impedance, 2 * LEAVE * shunt.nominal_flip_time(point.capacitance) / PULSE_STEEPNESS)
    voltage = f"V(side)*V(p)-({_drop_of_path(deck, shunt)})"
    power = write_coil_to_load(deck, point, loaded, voltage, shunt.efficiency)
    deck.add("Bdraw p 0 I=V(side)*I(Vcoil)")
    if shunt.consumption:
        power = f"{power} - {number(shunt.consumption)}"
    return NetlistCircuit(power, fastest=0.5 * shunt.nominal_flip_time(point.capacitance))


def _drop_of_path(deck: Deck, shunt: ElectronicBreaker) -> str:
    """Expression of the forward voltage of a breaker's path."""
    diode = deck.parameter("diode_drop", shunt.diode_drop)
    if shunt.breaker_drop is None:
        return f"{shunt.path_diodes}*{diode}"
    return f"{deck.parameter('breaker_drop', shunt.breaker_drop)}+{shunt.path_diodes - 1}*{diode}"


def _write_latches(deck: Deck, shunt: ElectronicBreaker, point: OperatingPoint) -> list[str]:
    """Both breakers; return the nodes of their latches."""
    return [_write_breaker(deck, shunt, point, *side) for side in (("high", "V(p)"), ("low", "(-V(p))"))]


def _write_breaker(deck: Deck, shunt: ElectronicBreaker, point: OperatingPoint, name: str, across: str) -> str:
    """Envelope capacitor and latch of one breaker, `across` which this voltage lies; return the latch's node."""
    flip = shunt.nominal_flip_time(point.capacitance)
    deck.section(f"breaker of the {name} voltage: V({name}) is held, V(on{name}) is 1 while it is on")
    fallen = f"(V({name})-{across}-{deck.parameter('threshold', shunt.threshold)})"
    _write_envelope(deck, shunt, point, name, across, fallen)
    _write_charge_of_latch(deck, shunt, point, name)
    # Each turns over: what keeps a latch set comes before it spends anything, and it takes more to set than to keep it.
    filled = f"V(keep{name})-{number(EMPTY * point.voltage)}*(5-4*V(on{name}))"
    held = f"{fallen}+{number(HOLD * point.voltage)}*max(0, V(on{name})-0.1)"
    deck.add(f"Bdecide{name} decide{name} 0 V=min({filled}, {held})")
    width = number((DECIDE * point.voltage) ** 2)
    deck.add(f"Bwanted{name} wanted{name} 0 V=0.5+0.5*V(decide{name})/sqrt(V(decide{name})*V(decide{name})+{width})")
    deck.add(f"Rlatch{name} wanted{name} on{name} 1")
    deck.add(f"Clatch{name} on{name} 0 {number(FOLLOW * flip)} IC=0")
    return f"on{name}"


def _write_envelope(
    deck: Deck, shunt: ElectronicBreaker, point: OperatingPoint, name: str, across: str, fallen: str
) -> None:
    """Envelope capacitor with the diode that charges it, and the junction that pulls it below zero."""
    excess = f"({across}-V({name})-{deck.parameter('diode_drop', shunt.diode_drop)})"
    # Rounder, or of less resistance, the corner would let the capacitor creep up while the voltage rests.
    least, corner = BRIDGE / (point.omega * shunt.envelope_capacitance), number((HELD * point.voltage) ** 2)
    charging = f"max(0, 1-2*V(on{name}))*{number(0.5 / least)}*({excess} + sqrt({excess}*{excess}+{corner}))"
    behind = shunt.base_resistance > least
    resistance = deck.parameter("base_resistance", shunt.base_resistance) if behind else number(least)
    below = f"max(0, min(1, 2-V({name})*{number(1 / (EMPTY * point.voltage))}))"
    pulling = f"{below}*0.5/{resistance}*({fallen} + sqrt({fallen}*{fallen}+{corner}))"
    capacitance = deck.parameter("capacitance_envelope", shunt.envelope_capacitance)
    deck.add(f"C{name} {name} 0 {capacitance} {point.condition(f'envelope_{name}')}")
    leads = ("p 0", "0 p") if name == "high" else ("0 p", "p 0")
    deck.add(f"Bcharge{name} 0 {name} I={charging}")
    deck.add(f"Btake{name} {leads[0]} I={charging}")
    deck.add(f"Bpull{name} {name} 0 I={pulling}")
    deck.add(f"Bgive{name} {leads[1]} I={pulling}")


def _write_charge_of_latch(deck: Deck, shunt: ElectronicBreaker, point: OperatingPoint, name: str) -> None:
    """A latch uses up the envelope's charge; what holds it is as much at first, and is used more slowly."""
    flip, capacitance = shunt.nominal_flip_time(point.capacitance), number(shunt.envelope_capacitance)
    used = f"max(0, V(on{name})-0.3)*{capacitance}"
    deck.add(f"Bspend{name} {name} 0 I=max(0, V({name}))*{used}*{number(1 / (FOLLOW * flip))}")
    deck.add(f"Ckeep{name} keep{name} 0 {capacitance} IC={number(max(0.0, point.initial(f'envelope_{name}')))}")
    follows = f"max(0, 1-2*V(on{name}))*{capacitance}*{number(1 / (FOLLOW * flip))}*(max(0, V({name}))-V(keep{name}))"
    deck.add(f"Bkeep{name} 0 keep{name} I={follows} - V(keep{name})*{used}*{number(1 / (SPEND * flip))}")
