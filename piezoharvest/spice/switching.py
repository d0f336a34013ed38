"""Synchronised switches, bridges and negative capacitances as netlist elements."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from piezoharvest.circuit import Switch
from piezoharvest.shunts.bridge import Bridge
from piezoharvest.shunts.switching import InductiveSwitch, SynchronisedShunt
from piezoharvest.spice.deck import Deck, number
from piezoharvest.spice.device import coupled_displacement, coupled_velocity
from piezoharvest.spice.scene import Circuit, Scene

# Bridge: ratio of its resistance to 1/(w C), and of the rounding of its corner to the expected voltage.
BRIDGE = 1e-4
CORNER = 1e-4
# Switch: conductance while closed and open, relative to 1/sqrt(L/C); shares of the on-time in which it changes over.
CLOSED, OPEN = 1e4, 1e-8
EDGE = 0.1
STEEPNESS = 200.0
# Resistance across the inductor, over sqrt(L/C), that takes up the current cut when the switch opens.
SNUBBER = 1e4
# Instantaneous discharges take this share of a period, and end at exp(-14) of the voltage.
DISCHARGE, DECAY = 1 / 200, 14.0


def write_timing(deck: Deck, switch: Switch, on_time: float, scene: Scene) -> None:
    """Node `pulse`: +1 (after a maximum) or -1 (after a minimum of sum T_i x_i) while the switch is closed."""
    deck.section("timing of the switch: V(pulse) is 1 after a maximum and -1 after a minimum of sum T_i x_i, else 0")
    deck.comment(
        f"V(extremum) is the sign of sum T_i x_i', rounded over {number(EDGE * on_time)} s to each side of a crossing, "
        "and delayed by ideal lines; both edges of the pulse are rounded alike, so that its length is exact. hold_off "
        "is left out: the switch acts at every extremum."
    )
    deck.add("Brate rate 0 V=(" + coupled_velocity(scene) + f")/{number(scene.current)}")
    width = number(EDGE * on_time * scene.omega**2 / scene.current)
    deck.add("Bwidth width 0 V=(" + coupled_displacement(scene) + f")*{width}")
    deck.add("Bextremum extremum 0 V=V(rate)/sqrt(V(rate)*V(rate) + V(width)*V(width) + 1e-12)")
    begin = "extremum"
    if switch.lag > 1e-4 * on_time:
        begin = "begin"
        deck.add("Tlag extremum 0 begin 0 Z0=1 TD=" + number(switch.lag))
    deck.add(f"Ton {begin} 0 finish 0 Z0=1 TD={number(on_time)}")
    deck.add("Ron finish 0 1")
    # Timed from the extremum before, of the other kind, the pulse has the other sign.
    deck.add(f"Bpulse pulse 0 V={'(-0.5)' if switch.early else '0.5'}*(V(finish)-V({begin}))")


def write_switch(deck: Deck, nodes: tuple[str, str], critical: float, closed: float, opened: float) -> str:
    """Write a conductance that follows the pulse, and give its power as an expression.

    Its logarithm changes steeply where the pulse passes 1/2, being `critical` (S) just there: that is the conductance
    that matters to the circuit, so that it closes and opens at the times meant.
    """
    low, high = number(math.log(opened / critical)), number(math.log(closed / critical))
    deck.add(f"Bswitch switch 0 V=min({high}, max({low}, {number(STEEPNESS)}*(abs(V(pulse))-0.5)))")
    across = f"V({nodes[0]})" if nodes[1] == "0" else f"(V({nodes[0]})-V({nodes[1]}))"
    conductance = f"{number(critical)}*exp(V(switch))"
    deck.add(f"Bcontact {nodes[0]} {nodes[1]} I={across}*{conductance}")
    return f"{across}*{across}*{conductance}"


class Loop(NamedTuple):
    """Timing of an inductive switch, and the impedance sqrt(L/C) of its loop."""

    on_time: float
    impedance: float


def write_loop(deck: Deck, shunt: InductiveSwitch, scene: Scene, end: str) -> Loop:
    """Inductor, its resistance and switch from `p` to the node `end`."""
    capacitance = scene.transducer.capacitance
    inductance, resistance = shunt.loop(capacitance)
    impedance = math.sqrt(inductance / capacitance)
    switch = shunt.switch(capacitance, scene.excitation.period)
    write_timing(deck, switch, switch.on_time, scene)
    deck.section("switched inductor")
    deck.comment(
        "Rsnubber takes up the current that still flows when the switch opens; what it takes while the switch is "
        "closed is left out of Rloop."
    )
    deck.add("Lloop p l", inductance, "IC=0")
    deck.add("Rsnubber p l", SNUBBER * impedance)
    deck.add("Rloop l k", resistance - impedance / SNUBBER - impedance / CLOSED)
    # The switch changes by a factor e in the time 2 EDGE on_time/STEEPNESS. A current that a resistance kappa L/time *
    # exp(t/time) cuts loses the charge of having ended at t = -(ln kappa + Euler's gamma) time, and one that it lets
    # begin starts at the mirror image: with kappa = exp(-gamma) both happen at t = 0.
    change = math.exp(-np.euler_gamma) * inductance * STEEPNESS / (2 * EDGE * switch.on_time)
    write_switch(deck, ("k", end), 1 / change, CLOSED / impedance, OPEN / impedance)
    return Loop(switch.on_time, impedance)


def write_bridge(deck: Deck, shunt: Bridge, scene: Scene, node: str, omega: float) -> Circuit:
    """Bridge from `node` to the dc side, for currents that change at the angular frequency `omega`."""
    conductance = number(0.5 * omega * scene.transducer.capacitance / BRIDGE)
    corner = number((CORNER * scene.voltage) ** 2)
    deck.section("bridge: V(dc) is the voltage behind it")
    deck.comment(
        "Each pair of diodes is a current through a small resistance above V(dc) and two drops, with a rounded corner; "
        "to try real diodes, put four of them in the place of Bin and Bout."
    )
    pairs = []
    for sign in ("", "-"):
        excess = f"({sign}V({node})-V(dc)-{number(2 * shunt.diode_drop)})"
        pairs.append(f"{conductance}*({excess} + sqrt({excess}*{excess}+{corner}))")
    deck.add(f"Bin {node} 0 I={pairs[0]} - {pairs[1]}")
    deck.add(f"Bout 0 dc I={pairs[0]} + {pairs[1]}")
    if shunt.dc_voltage is not None:
        deck.add("Vdc dc 0", float(shunt.dc_voltage))
        return Circuit("V(dc)*I(Vdc)", "V(dc)")
    assert shunt.smoothing_capacitance is not None and shunt.load_resistance is not None
    deck.add("Csmoothing dc 0", shunt.smoothing_capacitance, f"IC={number(scene.dc_start)}")
    deck.add("Rload dc 0", shunt.load_resistance)
    slowest = shunt.smoothing_capacitance * shunt.load_resistance
    return Circuit(f"V(dc)*V(dc)/{number(shunt.load_resistance)}", "V(dc)", slowest=slowest)


def write_discharge(deck: Deck, shunt: SynchronisedShunt, scene: Scene) -> Circuit:
    """Short pulse that takes the electrode voltage to zero through a resistance; a share of its energy is harvested."""
    capacitance = scene.transducer.capacitance
    switch = shunt.switch(capacitance, scene.excitation.period)
    on_time = DISCHARGE * 2 * math.pi / scene.omega
    write_timing(deck, switch, on_time, scene)
    deck.section("discharge: takes V(p) to zero within the pulse; its energy is what is harvested or lost")
    closed = DECAY * capacitance / on_time
    power = write_switch(deck, ("p", "0"), closed, closed, 1e-7 * scene.omega * capacitance)
    return Circuit(f"{number(switch.efficiency)}*{power}" if switch.efficiency else "0", fastest=on_time)
