"""Synchronised switches, bridges and negative capacitances as netlist elements."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from piezoharvest.description.circuit import Switch
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts.bridge import Bridge
from piezoharvest.description.shunts.switching import InductiveSwitch, SynchronisedShunt
from piezoharvest.spice.deck import Deck, number
from piezoharvest.spice.device import coupled_acceleration, coupled_velocity
from piezoharvest.spice.operating_point import NetlistCircuit, OperatingPoint

# Bridge: ratio of its resistance to 1/(w C), and of the smoothing of its corner to the expected voltage.
BRIDGE = 1e-4
CORNER = 1e-5
# Switched loop: ratio to sqrt(L/C) of the resistance that absorbs the current cut when the switch opens, inverse ratio
# of that of the closed switch, and conductance of the open switch relative to 1/sqrt(L/C).
IDEAL, OPEN = 1e4, 1e-8
# The pulse that closes a switch rises and falls over this fraction of its length to each side; logarithm of the
# switch's conductance per unit of the pulse.
EDGE = 0.1
STEEPNESS = 200.0
# Instantaneous discharges take this fraction of a period, and end at exp(-14) of the voltage.
DISCHARGE, DECAY = 1 / 200, 14.0


def write_timing(deck: Deck, switch: Switch, on_time: float, point: OperatingPoint) -> None:
    """Node `pulse`: +1 (after a maximum) or -1 (after a minimum of sum T_i x_i) while the switch is closed.

    Raises
    ------
    ParameterError
        The switch leaves out extrema at small voltages: the lines that delay the pulse cannot tell one from another.
    """
    if switch.threshold > 0:
        found = f"found {switch.threshold:g} V, of which a netlist has no element"
        raise ParameterError("detector_threshold", f"{found}, allowed is 0: a switch that acts at every extremum")
    deck.section("timing of the switch: V(pulse) is 1 after a maximum and -1 after a minimum of sum T_i x_i, else 0")
    deck.comment(
        f"V(extremum) is the sign of sum T_i x_i', rounded over {number(EDGE * on_time)} s to each side of a crossing, "
        "and delayed by ideal lines; both edges of the pulse are rounded alike, so that its length is exact. hold_off "
        "is left out: the switch acts at every extremum."
    )
    deck.add("Brate rate 0 V=(" + coupled_velocity(point) + f")/{number(point.current)}")
    width = number(EDGE * on_time / point.current)
    deck.add("Bwidth width 0 V=(" + coupled_acceleration(point) + f")*{width}")
    deck.add("Bextremum extremum 0 V=max(-1, min(1, V(rate)/sqrt(V(width)*V(width)+1e-12)))")
    begin = "extremum"
    if switch.lag > 1e-4 * on_time:
        begin = "begin"
        deck.add("Tlag extremum 0 begin 0 Z0=1 TD=" + number(switch.lag))
    deck.add(f"Ton {begin} 0 finish 0 Z0=1 TD={number(on_time)}")
    deck.add("Ron finish 0 1")
    # Timed from the previous extremum, of the other kind, the pulse has the other sign.
    deck.add(f"Bpulse pulse 0 V={'(-0.5)' if switch.early else '0.5'}*(V(finish)-V({begin}))")


def write_switch(deck: Deck, nodes: tuple[str, str], critical: float, closed: float, opened: float) -> str:
    """Write a conductance that follows the pulse, and return an expression of its power.

    Its logarithm changes steeply around the pulse's value 1/2, at which it is `critical` (S), the conductance at which
    the circuit responds, so that it closes and opens at the intended times.
    """
    low, high = number(math.log(opened / critical)), number(math.log(closed / critical))
    deck.add(f"Bswitch switch 0 V=min({high}, max({low}, {number(STEEPNESS)}*(abs(V(pulse))-0.5)))")
    across = f"V({nodes[0]})" if nodes[1] == "0" else f"(V({nodes[0]})-V({nodes[1]}))"
    conductance = f"{number(critical)}*exp(V(switch))"
    deck.add(f"Bcontact {nodes[0]} {nodes[1]} I={across}*{conductance}")
    return f"{across}*{across}*{conductance}"


class SwitchedLoop(NamedTuple):
    """Timing of an inductive switch, and the impedance sqrt(L/C) of its loop."""

    on_time: float
    impedance: float


def write_loop(deck: Deck, shunt: InductiveSwitch, point: OperatingPoint, end: str) -> SwitchedLoop:
    """Inductor, its resistance and switch from `p` to the node `end`."""
    capacitance = point.transducer.capacitance
    inductance, resistance = shunt.loop(capacitance)
    impedance = math.sqrt(inductance / capacitance)
    switch = shunt.switch(capacitance, point.excitation.period)
    write_timing(deck, switch, switch.on_time, point)
    deck.section("switched inductor")
    deck.comment(
        "Rsnubber takes up the current that still flows when the switch opens; what it takes while the switch is "
        "closed is left out of Rloop."
    )
    deck.add("Lloop p l", inductance, "IC=0")
    ideal = impedance * max(IDEAL, 100 * float(shunt.quality))
    deck.add("Rsnubber p l", ideal)
    deck.add("Rloop l k", resistance - 2 * impedance**2 / ideal)
    # The switch changes by a factor e in the time 2 EDGE on_time/STEEPNESS. A current cut by a resistance kappa L/time
    # * exp(t/time) carries the charge as if it ended at t = -(ln kappa + Euler's gamma) time, and one that begins
    # through it starts at the mirror image: with kappa = exp(-gamma) both happen at t = 0.
    change = math.exp(-np.euler_gamma) * inductance * STEEPNESS / (2 * EDGE * switch.on_time)
    write_switch(deck, ("k", end), 1 / change, ideal / impedance**2, OPEN / impedance)
    return SwitchedLoop(switch.on_time, impedance)


def write_bridge(deck: Deck, shunt: Bridge, point: OperatingPoint) -> NetlistCircuit:
    """Bridge across the electrodes, with currents that depend on the voltage."""
    conductance = number(0.5 * point.omega * point.transducer.capacitance / BRIDGE)
    corner = number((CORNER * point.voltage) ** 2)
    deck.section("bridge: V(dc) is the voltage behind it")
    deck.comment(
        "Each pair of diodes is a current through a small resistance above V(dc) and two drops, with a rounded corner; "
        "to try real diodes, put four of them in the place of Bin and Bout."
    )
    pairs = []
    for sign in ("", "-"):
        excess = f"({sign}V(p)-V(dc)-{number(2 * shunt.diode_drop)})"
        pairs.append(f"{conductance}*({excess} + sqrt({excess}*{excess}+{corner}))")
    deck.add(f"Bin p 0 I={pairs[0]} - {pairs[1]}")
    deck.add(f"Bout 0 dc I={pairs[0]} + {pairs[1]}")
    if shunt.diode_leakage:
        deck.comment("What all four diodes conduct backwards: Rback between the leads, and Rleak of the dc side.")
        deck.add("Rback p 0", 1 / shunt.diode_leakage)
    return _write_dc_side(deck, shunt, point)


def write_series_bridge(deck: Deck, shunt: Bridge, point: OperatingPoint, node: str, current: float) -> NetlistCircuit:
    """Bridge from `node` to ground, in series with an inductor, with a voltage that depends on the current.

    `current` (A) is its peak current.
    """
    deck.section("bridge in line with the inductor: V(dc) is the voltage behind it")
    deck.comment(
        "V(direction) is the sign of the current, rounded near zero; the bridge opposes it with V(dc) and two drops, "
        "and passes its magnitude on. To try real diodes, put four of them in the place of Vbridge, Bin and Bout."
    )
    deck.add(f"Vbridge {node} opposed 0")
    deck.add("Hbridge through 0 Vbridge", 1 / current)
    deck.add(f"Bdirection direction 0 V=V(through)/sqrt(V(through)*V(through)+{number(BRIDGE**2)})")
    deck.add(f"Bin opposed 0 V=V(direction)*(V(dc)+{number(2 * shunt.diode_drop)})")
    deck.add(f"Bout 0 dc I={number(current)}*V(through)*V(direction)")
    return _write_dc_side(deck, shunt, point)


def _write_dc_side(deck: Deck, shunt: Bridge, point: OperatingPoint) -> NetlistCircuit:
    """Smoothing capacitor and load, or constant voltage, at the node `dc`, and what leaks there."""
    if shunt.dc_conductance:
        deck.add("Rleak dc 0", 1 / shunt.dc_conductance)
    if shunt.dc_voltage is not None:
        deck.add("Vdc dc 0", float(shunt.dc_voltage))
        return NetlistCircuit("V(dc)*I(Vdc)", "V(dc)")
    assert shunt.smoothing_capacitance is not None and shunt.load_resistance is not None
    deck.add("Csmoothing dc 0", shunt.smoothing_capacitance, f"IC={number(point.dc_start)}")
    deck.add("Rload dc 0", shunt.load_resistance)
    slowest = shunt.smoothing_capacitance * shunt.load_resistance
    return NetlistCircuit(f"V(dc)*V(dc)/{number(shunt.load_resistance)}", "V(dc)", slowest=slowest)


def write_discharge(deck: Deck, shunt: SynchronisedShunt, point: OperatingPoint) -> NetlistCircuit:
    """Short pulse that takes the electrode voltage to zero through a resistance; part of the energy is harvested."""
    capacitance = point.transducer.capacitance
    switch = shunt.switch(capacitance, point.excitation.period)
    on_time = DISCHARGE * 2 * math.pi / point.omega
    write_timing(deck, switch, on_time, point)
    deck.section("discharge: takes V(p) to zero within the pulse; its energy is what is harvested or lost")
    closed = DECAY * capacitance / on_time
    power = write_switch(deck, ("p", "0"), closed, closed, 1e-7 * point.omega * capacitance)
    if switch.drop:  # right where this leaves something of the energy
        deck.comment("The diodes' drops are no elements here: their energy is left out of what is harvested.")
        power = f"{power}*(1-{number(switch.drop)}/(abs(V(p))+1e-9))"
    return NetlistCircuit(f"{number(switch.efficiency)}*{power}" if switch.efficiency else "0", fastest=on_time)
