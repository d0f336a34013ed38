"""Synchronised switches as netlist elements."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from piezoharvest.description.circuit import Switch
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts.curves.loop_sections import Section
from piezoharvest.description.shunts.curves.voltage_curve import VoltageCurve
from piezoharvest.description.shunts.damping.ssds import SSDS
from piezoharvest.description.shunts.real_coil import RealCoil, WoundCoil, WoundSwitch
from piezoharvest.description.shunts.switching import SynchronisedShunt
from piezoharvest.spice.deck import Deck, number
from piezoharvest.spice.device import coupled_acceleration, coupled_velocity
from piezoharvest.spice.operating_point import NetlistCircuit, OperatingPoint

# Switched loop: ratio to sqrt(L/C) of the resistance that absorbs the current cut when the switch opens, inverse ratio
# of that of the closed switch, and conductance of the open switch relative to 1/sqrt(L/C).
IDEAL, OPEN = 1e4, 1e-8
# Resistance of the contact that closes as a share of that of the closed switch, the rest of which is in line.
CONTACT = 1e-2
# Stray capacitance of a coil with a core, over the clamped one.
CORE_STRAY = 2e-4
# The pulse that closes a switch rises and falls over this fraction of its length to each side; logarithm of the
# switch's conductance per unit of the pulse.
EDGE = 0.1
# Time in which the sign that counts for the switch follows that of the motion, as a share of the pulse.
FOLLOW = 0.01
STEEPNESS = 200.0
# Instantaneous discharges take this fraction of a period, and end at exp(-14) of the voltage.
DISCHARGE, DECAY = 1 / 200, 14.0


def write_timing(deck: Deck, switch: Switch, on_time: float, point: OperatingPoint) -> Timing:
    """Write the sign of the motion by which the switch acts; `on_time` (s) is that of its shortest pulse.

    Raises
    ------
    ParameterError
        The switch leaves out extrema at small voltages: the lines that delay the pulse cannot tell one from another.
    """
    if switch.threshold > 0:
        found = f"found {switch.threshold:g} V, for which a netlist has no element"
        raise ParameterError("detector_threshold", f"{found}, must be 0, with which the switch acts at every extremum")
    deck.section("timing of the switch: V(pulse...) is 1 after a maximum and -1 after a minimum of sum T_i x_i, else 0")
    deck.comment(
        f"V(extremum) is the sign of sum T_i x_i', rounded over {number(EDGE * on_time)} s to each side of a crossing, "
        "and delayed by ideal lines; both edges of the pulse are rounded alike, so that its length is exact."
    )
    deck.add("Brate rate 0 V=(" + coupled_velocity(deck, point) + f")/{number(point.current)}")
    width = number(EDGE * on_time / point.current)
    deck.add("Bwidth width 0 V=(" + coupled_acceleration(deck, point) + f")*{width}")
    deck.add("Bextremum extremum 0 V=max(-1, min(1, V(rate)/sqrt(V(width)*V(width)+1e-12)))")
    lines = _Lines(deck, point, on_time, switch.hold_off)
    taken = "extremum"
    if switch.hold_off > 2 * lines.settled:
        _write_hold_off(deck, lines, switch.hold_off)
        taken = "taken"
    return Timing(lines, taken, switch)


class Timing(NamedTuple):
    """Where the netlist has the sign of the motion by which the switch acts."""

    lines: _Lines
    taken: str
    switch: Switch

    def pulse(self, name: str, begins: float, ends: float) -> None:
        """Node `pulse` with `name` behind it: 1 or -1 between two times (s) counted from the action."""
        nodes = []
        for place, time in (("begin", begins), ("finish", ends)):
            delay = self.switch.lag + time
            late = delay > 1e-4 * self.lines.on_time
            nodes.append(self.lines.write(f"{place}{name}", self.taken, delay) if late else self.taken)
        # Timed from the previous extremum, of the other kind, the pulse has the other sign.
        half = "(-0.5)" if self.switch.early else "0.5"
        powered = "*V(powered)" if self.lines.point.cold else ""
        self.lines.deck.add(f"Bpulse{name} pulse{name} 0 V={half}*(V({nodes[1]})-V({nodes[0]})){powered}")


class _Lines(NamedTuple):
    """Ideal lines that delay the sign of the motion; those of a netlist that begins in motion get its history, too."""

    deck: Deck
    point: OperatingPoint
    on_time: float  # of the shortest pulse, s
    hold_off: float

    @property
    def settled(self) -> float:
        """Time (s) after which the rounded sign has changed for certain."""
        return 4 * EDGE * self.on_time

    def write(self, name: str, source: str, delay: float) -> str:
        """Node `name` with the voltage of the node `source` a while before; returns it."""
        start, deck = self.point.start, self.deck
        if start is None:
            deck.add(f"T{name} {source} 0 {name} 0 Z0=1 TD={number(delay)}")
            deck.add(f"R{name} {name} 0 1")
            return name
        # A line knows nothing of the time before the run: what it gives until the delay has passed comes from a source.
        # Both change from one to the other as slowly as a sign is rounded.
        fade = 2 * EDGE * self.on_time
        deck.add(f"B{name}in {name}in 0 V=V({source})*min(1, time*{number(1 / fade)})")
        deck.add(f"T{name} {name}in 0 {name}out 0 Z0=1 TD={number(delay)}")
        deck.add(f"R{name} {name}out 0 1")
        times, signs = start.sides(delay, self.hold_off)
        rounding = 0.5 * fade
        points = [(0.0, signs[0])]
        for turn, before, after in zip(times + delay, signs[:-1], signs[1:], strict=True):
            if before != after and turn > rounding:
                points += [(turn - rounding, before), (turn + rounding, after)]
        points = [*(point for point in points if point[0] < delay), (delay, signs[-1]), (delay + fade, 0.0)]
        deck.add(f"V{name}past {name}past 0 PWL(", *(f"{time:.12g} {value:g}" for time, value in points), ")")
        deck.add(f"B{name} {name} 0 V=V({name}out)+V({name}past)")
        return name


def _write_hold_off(deck: Deck, lines: _Lines, hold_off: float) -> None:
    """Node `taken`: the sign as the switch takes it, which does not change within the hold-off of a change."""
    deck.comment(
        "V(taken) is that sign as the switch takes it: it follows (within a hundredth of the pulse) but where it has "
        "changed within the hold-off, which V(held) tells, the sign a hold-off ago, beside V(recent), that just now."
    )
    sign = lines.point.start.sides(0.0, hold_off)[1][-1] if lines.point.start else 0.0
    deck.add(f"Cstored stored 0 {number(FOLLOW * lines.on_time)} IC={sign:g}")
    deck.add("Btaken taken 0 V=V(stored)")
    held, recent = lines.write("held", "taken", hold_off), lines.write("recent", "taken", lines.settled)
    free = f"max(0, min(1, 3-2*abs(V({held})-V({recent}))))"
    deck.add(f"Bstored 0 stored I=(V(extremum)-V(stored))*{free}")


def write_conductance(deck: Deck, name: str, critical: float, closed: float, opened: float) -> str:
    """Return an expression of a conductance (S) that follows the pulse of this name.

    Its logarithm changes steeply around the pulse's value 1/2, at which it is `critical` (S), the conductance at which
    the circuit responds, so that it closes and opens at the intended times.
    """
    low, high = number(math.log(opened / critical)), number(math.log(closed / critical))
    deck.add(f"Bswitch{name} switch{name} 0 V=min({high}, max({low}, {number(STEEPNESS)}*(abs(V(pulse{name}))-0.5)))")
    return f"{number(critical)}*exp(V(switch{name}))"


def write_switch(deck: Deck, nodes: tuple[str, str], critical: float, closed: float, opened: float) -> str:
    """Write a conductance that follows the pulse, and return an expression of its power."""
    conductance = write_conductance(deck, "", critical, closed, opened)
    across = f"V({nodes[0]})" if nodes[1] == "0" else f"(V({nodes[0]})-V({nodes[1]}))"
    deck.add(f"Bcontact {nodes[0]} {nodes[1]} I={across}*{conductance}")
    return f"{across}*{across}*{conductance}"


class LoopOfNetlist(NamedTuple):
    """Timing of an inductive switch, and the impedance sqrt(L/C) of its loop."""

    on_time: float
    impedance: float


def write_loop(deck: Deck, shunt: WoundSwitch | SSDS, point: OperatingPoint, end: str) -> LoopOfNetlist:
    """Inductor, its resistance and switch from `p` to the node `end`."""
    capacitance = point.capacitance
    switch = shunt.switch(capacitance, point.excitation.period)
    write_timing(deck, switch, switch.on_time, point).pulse("", 0.0, switch.on_time)
    return LoopOfNetlist(switch.on_time, write_coil(deck, shunt, point, end, switch.on_time))


def write_coil(deck: Deck, shunt: WoundCoil, point: OperatingPoint, end: str, on_time: float) -> float:
    """Inductor, its resistance and a switch that follows V(pulse); return the impedance sqrt(L/C)."""
    if shunt.self_resonance is not None:
        return _write_wound_coil(deck, shunt, point, end, on_time)
    capacitance = point.capacitance
    inductance, resistance = shunt.loop(capacitance)
    impedance = math.sqrt(inductance / capacitance)
    deck.section("switched inductor")
    deck.comment(
        "Rsnubber takes up the current that still flows when the switch opens; what it takes while the switch is "
        "closed is left out of Rloop."
    )
    curve, sections = (shunt.switch_curve, shunt.sections) if isinstance(shunt, WoundSwitch) else (None, ())
    begin = write_sections(deck, sections, "p", point)
    deck.add(f"Lloop {begin} l", inductance, point.condition("current"))
    ideal = impedance * max(IDEAL, 100 * impedance / float(resistance))
    deck.add(f"Rsnubber {begin} l", ideal)
    core = shunt.core_resistance
    if core is not None:
        deck.add("Rcore p l", core)
        deck.comment("A stray capacitance beside the core: without, its current may change at once, and steps vanish.")
        deck.add("Cstray p l", CORE_STRAY * capacitance, "IC=0")
    deck.add(f"Rloop l {'c' if curve else 'k'}", resistance - 2 * impedance**2 / ideal)
    if curve:
        deck.comment("What the closed switch takes beside the resistance of the loop, over its current.")
        deck.add(f"Bcurve c k V={odd_voltage(curve, '((V(l)-V(c))/{resistance_loop})')}")
    # The switch changes by a factor e in the time 2 EDGE on_time/STEEPNESS. A current cut by a resistance kappa L/time
    # * exp(t/time) carries the charge as if it ended at t = -(ln kappa + Euler's gamma) time, and one that begins
    # through it starts at the mirror image: with kappa = exp(-gamma) both happen at t = 0.
    time = 2 * EDGE * on_time / STEEPNESS
    critical = math.exp(np.euler_gamma) * time / inductance
    if core is not None:  # the current goes over to what is beside the inductance before that
        critical += 1 / core + math.exp(-np.euler_gamma) * CORE_STRAY * capacitance / time
    write_switch(deck, ("k", end), critical, ideal / impedance**2, OPEN / impedance)
    return impedance


def write_sections(deck: Deck, sections: Sequence[Section], node: str, point: OperatingPoint) -> str:
    """What lags behind the current of a coil, from a node on; return the node at its end.

    In front of the coil, whose current does not jump: behind it ngspice finds no step when the switch closes.
    """
    if sections:
        deck.comment("What in line with the coil lags behind its current.")
    for section in sections:
        name, begins = section.name, point.initial(section.name)
        resistance, time_constant = float(section.resistance), float(section.time_constant)
        nodes = f"{node} {name}"
        deck.add(f"R{name} {nodes}", resistance)
        if section.beside == "inductance":
            deck.add(f"L{name} {nodes}", resistance * time_constant, f"IC={number(begins)}")
        else:
            deck.add(f"C{name} {nodes}", time_constant / resistance, f"IC={number(resistance * begins)}")
        node = name
    return node


def odd_voltage(curve: VoltageCurve, current: str) -> str:
    """Voltage of a curve that begins at zero over a current of either direction."""
    bends = [
        f"{number(change)}*(max({current}-{number(at)},0)-max(-({current})-{number(at)},0))"
        for at, change in zip(
            curve.currents[:-1], changes_of([curve.piece(k)[1] for k in range(curve.pieces)]), strict=True
        )
        if change
    ]
    return " + ".join(bends) or "0"


def changes_of(slopes: list[float]) -> list[float]:
    """Slope of the first piece, and by how much each of the others is steeper than the one before."""
    return np.diff(slopes, prepend=0.0).tolist()


def _write_wound_coil(deck: Deck, shunt: WoundCoil, point: OperatingPoint, end: str, on_time: float) -> float:
    """The same with the capacitance of the winding, between which and the electrodes the switch is."""
    coil, stray = shunt.real_coil(point.capacitance), float(shunt.stray_capacitance(point.capacitance))
    resistance, impedance = float(coil.contact), math.sqrt(float(coil.inductance) / point.capacitance)
    deck.section("switched inductor with the capacitance of its winding, which the current goes on to when it opens")
    write_winding(deck, coil, point)
    contact = CONTACT * resistance
    deck.add("Rclosed l k", (1 - CONTACT) * resistance)
    critical = critical_of_winding(stray, 2 * EDGE * on_time / STEEPNESS)
    write_switch(deck, ("k", end), min(critical, 0.1 / contact), 1 / contact, OPEN / impedance)
    return impedance


def write_winding(deck: Deck, coil: RealCoil, point: OperatingPoint) -> None:
    """Inductance, core, winding and its capacitance between `p` and `l`."""
    deck.add("Lloop p w", coil.inductance, point.condition("inductor"))
    if coil.core is not None:
        deck.add("Rcore p w", coil.core)
    deck.add("Rwinding w l", coil.resistance)
    deck.add("Cwinding p l", coil.stray, point.condition("winding"))


def critical_of_winding(stray: float, change: float) -> float:
    """Conductance (S) at which a winding is cut off by a switch that changes by a factor e in `change` (s).

    A capacitance behind a conductance kappa C/change * exp(-t/change) keeps the voltage as if it was cut off at
    t = (ln kappa + Euler's gamma) change: with kappa = exp(-gamma) this is t = 0, as for an inductance.
    """
    return math.exp(-np.euler_gamma) * stray / change


def write_discharge(deck: Deck, shunt: SynchronisedShunt, point: OperatingPoint) -> NetlistCircuit:
    """Short pulse that takes the electrode voltage to zero through a resistance; part of the energy is harvested."""
    capacitance = point.capacitance
    switch = shunt.switch(capacitance, point.excitation.period)
    on_time = DISCHARGE * 2 * math.pi / point.omega
    write_timing(deck, switch, on_time, point).pulse("", 0.0, on_time)
    deck.section("discharge: takes V(p) to zero within the pulse; its energy is what is harvested or lost")
    closed = DECAY * capacitance / on_time
    power = write_switch(deck, ("p", "0"), closed, closed, 1e-7 * point.omega * capacitance)
    if switch.drop:  # right where this leaves something of the energy
        deck.comment("The diodes' drops are no elements here: their energy is left out of what is harvested.")
        power = f"{power}*(1-{number(switch.drop)}/(abs(V(p))+1e-9))"
    return NetlistCircuit(f"{number(switch.efficiency)}*{power}" if switch.efficiency else "0", fastest=on_time)
