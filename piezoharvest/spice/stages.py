"""Switches that lead a circuit through several stages as netlist elements."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from piezoharvest.description.circuit import Switch
from piezoharvest.description.shunts.double_switch.dssh import DSSH
from piezoharvest.description.shunts.double_switch.essh import ESSH
from piezoharvest.description.shunts.extraction import Extraction
from piezoharvest.description.shunts.harvesting.bias_flip import BiasFlip
from piezoharvest.description.shunts.harvesting.sc_sece import SCSECE
from piezoharvest.description.shunts.harvesting.sece import SECE
from piezoharvest.description.shunts.harvesting.sice import SICE
from piezoharvest.description.shunts.harvesting.sshc import SSHC
from piezoharvest.description.shunts.real_coil import RealCoil
from piezoharvest.spice.bridges import write_bridge
from piezoharvest.spice.deck import Deck, number
from piezoharvest.spice.operating_point import NetlistCircuit, OperatingPoint
from piezoharvest.spice.switching import (
    DECAY,
    DISCHARGE,
    EDGE,
    IDEAL,
    STEEPNESS,
    Timing,
    critical_of_winding,
    write_coil,
    write_conductance,
    write_discharge,
    write_timing,
)

# A phase hands over to the next where both conduct this share of what they do when closed: the charge that both move
# then is 1e-5 of that of a phase of ten time constants. An open switch conducts this share.
HANDOVER, OPEN = 1e-2, 1e-9
# Load of a coil whose current is cut, over sqrt(L/C): what the contact takes while it opens, in 1e-3 of the time that
# it was closed, grows with it, and the time that the current takes to end falls: 1e-3 of the energy, two such times.
LOAD = 0.3
# A bridge around empty electrodes, over sqrt(L/C): what it lets the coil's current change their voltage by.
SHORTED = 1e-3


def write_sshc(deck: Deck, shunt: SSHC, point: OperatingPoint) -> NetlistCircuit:
    """Bridge, and switched capacitors at nodes of their own, which the phases connect with either sign."""
    capacitance = point.capacitance
    switch = shunt.switch(capacitance, point.excitation.period)
    closed, phase = 1 / shunt.switch_resistance, switch.on_time / len(shunt.stages)
    timing = write_timing(deck, switch, phase, point)
    conductances = []
    for n, _ in enumerate(shunt.stages):
        timing.pulse(str(n), n * phase, (n + 1) * phase)
        conductances.append(write_conductance(deck, str(n), HANDOVER * closed, closed, OPEN * closed))
    deck.section("switched capacitors: V(flipN) is that of the N-th, connected with either sign")
    deck.comment("After a maximum of sum T_i x_i the voltage is negative, and V(pulse) is 1: shared with the sign -1.")
    for n, name in enumerate(shunt.stages):
        if name == "short":
            deck.add(f"Bshort p 0 I=V(p)*{conductances[n]}")
            continue
        node, side = f"flip{name[-1]}", "-4" if name.startswith("share") else "4"
        sign = f"max(-1, min(1, {side}*V(pulse{n})))"
        current = f"(V(p)-{sign}*V({node}))*{conductances[n]}"
        deck.add(f"Bpath{n} p 0 I={current}")
        deck.add(f"Bcharge{n} 0 {node} I={sign}*{current}")
        if name.startswith("share"):
            capacitance = shunt.flip_capacitances[int(name[-1]) - 1]
            deck.add(f"C{node} {node} 0", capacitance, point.condition(f"flip_{name[-1]}"))
    return write_bridge(deck, shunt, point)._replace(fastest=phase)


def write_bias_flip(deck: Deck, shunt: BiasFlip, point: OperatingPoint) -> NetlistCircuit:
    """Bridge, and a coil with a source in line that is the bias capacitor of the step, at a node of its own."""
    switch = shunt.switch(point.capacitance, point.excitation.period)
    shares = [float(shunt.stage(f"+{stage}", point.capacitance)) for stage in shunt.stages]
    ends = switch.on_time * np.cumsum([0.0, *shares])
    step = switch.on_time * min(shares)
    timing = write_timing(deck, switch, step, point)
    timing.pulse("", 0.0, switch.on_time)
    write_coil(deck, shunt, point, "bias", step)
    deck.section("bias: V(capacitorN) is in line with the coil in step N, with the other sign in the last but N - 1")
    deck.add("Vbiased bias biased 0")
    sources = []
    capacitances = {state.name: float(state.storage) for state in shunt.states(point.capacitance)}
    for k in range(1, shunt.steps // 2 + 1):
        last = shunt.steps + 1 - k
        for n in (k, last):
            timing.pulse(str(n), float(ends[n - 1]), float(ends[n]))
        deck.add(f"Bside{k} side{k} 0 V={_steep(f'V(pulse{last})')}-({_steep(f'V(pulse{k})')})")
        deck.add(f"Cbias{k} capacitor{k} 0", capacitances[f"bias_{k}"], point.condition(f"bias_{k}"))
        deck.add(f"Bbias{k} 0 capacitor{k} I=V(side{k})*I(Vbiased)")
        sources.append(f"V(side{k})*V(capacitor{k})")
    deck.add(f"Bbias biased 0 V={' + '.join(sources) or '0'}")
    return write_bridge(deck, shunt, point)._replace(fastest=step)


def _steep(pulse: str) -> str:
    """Expression of a pulse of which the long rounded ends are cut off, and that changes around its half height."""
    return f"max(0, min(1, 4*{pulse}-1.5))-max(0, min(1, -4*{pulse}-1.5))"


def write_sece(deck: Deck, shunt: SECE, point: OperatingPoint) -> NetlistCircuit:
    """At once, as a short pulse through a resistance, or through a coil."""
    if shunt.inductance is None:
        return write_discharge(deck, shunt, point)
    switch = shunt.switch(point.capacitance, point.excitation.period)
    timing = write_timing(deck, switch, switch.on_time, point)
    harvested = _write_extraction(deck, shunt, point, timing, switch.on_time)
    return NetlistCircuit(harvested, fastest=switch.on_time)


def write_sice(deck: Deck, shunt: SICE, point: OperatingPoint) -> NetlistCircuit:
    """Two coils: one inverts after a minimum, one extracts after a maximum."""
    capacitance = point.capacitance
    switch = shunt.switch(capacitance, point.excitation.period)
    extraction = switch.on_time * float(shunt.stage("extract", capacitance))
    timing = write_timing(deck, switch, extraction, point)
    timing.pulse("any", 0.0, switch.on_time)
    deck.add("Bpulse pulse 0 V=min(0, V(pulseany))")
    write_coil(deck, shunt, point, "0", switch.on_time)
    harvested = _write_extraction(deck, shunt, point, timing, extraction, "max(0, V(pulsex))")
    return NetlistCircuit(harvested, fastest=extraction)


def write_sc_sece(deck: Deck, shunt: SCSECE, point: OperatingPoint) -> NetlistCircuit:
    """Extraction through a coil, then a resistance across the electrodes."""
    capacitance = point.capacitance
    switch = shunt.switch(capacitance, point.excitation.period)
    extraction = float(shunt.swing_time(capacitance))
    timing = write_timing(deck, switch, extraction, point)
    harvested = _write_extraction(deck, shunt, point, timing, extraction)
    timing.pulse("short", extraction, switch.on_time)
    closed = 1 / shunt.loop(capacitance)[1]
    conductance = write_conductance(deck, "short", HANDOVER * closed, closed, OPEN * point.omega * capacitance)
    deck.add(f"Bshort p 0 I=V(p)*{conductance}")
    return NetlistCircuit(harvested, fastest=min(extraction, float(shunt.short_time)))


def write_dssh(deck: Deck, shunt: DSSH, point: OperatingPoint) -> NetlistCircuit:
    """Coil and bridge in line with the intermediate capacitor, which a second pulse empties through a resistance."""
    capacitance = point.capacitance
    switch = shunt.switch(capacitance, point.excitation.period)
    timing = _write_first_stage(deck, shunt, point, switch, switch.on_time)
    length = DISCHARGE * 2 * math.pi / point.omega
    timing.pulse("empty", switch.on_time, switch.on_time + length)
    closed = DECAY * shunt.intermediate_capacitance / length
    conductance = write_conductance(deck, "empty", closed, closed, 1e-7 * point.omega * capacitance)
    deck.add(f"Bempty between 0 I=V(between)*{conductance}")
    power = f"{number(shunt.efficiency)}*V(between)*V(between)*{conductance}"
    # Emptying takes time here, in which the engine's capacitor, emptied at once, has no voltage.
    full = f"max(0, min(1, 0.5-{number(STEEPNESS)}*(abs(V(pulseempty))-0.5)))"
    return NetlistCircuit(power if shunt.efficiency else "0", f"V(between)*{full}", fastest=min(length, switch.on_time))


def write_essh(deck: Deck, shunt: ESSH, point: OperatingPoint) -> NetlistCircuit:
    """The same with a second coil, which takes a part of the intermediate capacitor's energy to the load."""
    capacitance = point.capacitance
    switch = shunt.switch(capacitance, point.excitation.period)
    swing, transfer = float(shunt.swing_time(capacitance)), float(shunt.transfer_time())
    # The second switch opens at a voltage, with a current: edges as sharp as those of a pulse of a quarter the length.
    fastest = min(swing, transfer / 4)
    timing = _write_first_stage(deck, shunt, point, switch, swing, fastest)
    impedance = math.sqrt(shunt.second_inductance / shunt.intermediate_capacitance)
    coil = LoadedCoil(shunt.second_coil(), impedance, 2 * EDGE * fastest / STEEPNESS)
    timing.pulse("x", swing + coil.early, swing + transfer)
    power = write_coil_to_load(deck, point, coil, "V(between)", shunt.efficiency)
    deck.add("Bdraw between 0 I=I(Vcoil)")
    return NetlistCircuit(power, "V(between)", fastest=fastest)


def _write_first_stage(
    deck: Deck, shunt: DSSH, point: OperatingPoint, switch: Switch, swing: float, shortest: float | None = None
) -> Timing:
    """Switched coil and bridge in line with the intermediate capacitor, for `swing` seconds."""
    timing = write_timing(deck, switch, shortest or swing, point)
    timing.pulse("", 0.0, swing)
    impedance = write_coil(deck, shunt, point, "b", shortest or swing)
    deck.section("bridge in line with the inductor, V(between) is the intermediate capacitor")
    current = point.voltage / impedance
    deck.add("Vbridge b opposed 0")
    deck.add("Hbridge through 0 Vbridge", 1 / current)
    # Beside a core or a winding hardly anything keeps the current from changing at once: its sign changes less steeply.
    ideal = shunt.core_resistance is None and shunt.self_resonance is None
    rounding = 1e-8 if ideal else 1e-6 if shunt.self_resonance is None else 1e-5
    deck.add(f"Bdirection direction 0 V=V(through)/sqrt(V(through)*V(through)+{number(rounding)})")
    drop, resistance = (deck.parameter(key, getattr(shunt, key)) for key in ("diode_drop", "diode_resistance"))
    lost = f"2*{resistance}*{number(current)}*V(through)"
    deck.add(f"Bin opposed 0 V=V(direction)*(V(between)+2*{drop}) + {lost}")
    deck.add(f"Bout 0 between I={number(current)}*V(through)*V(direction)")
    deck.add("Cbetween between 0", shunt.intermediate_capacitance, point.condition("intermediate"))
    return timing


def _write_extraction(
    deck: Deck, shunt: Extraction, point: OperatingPoint, timing: Timing, on_time: float, pulse: str = "V(pulsex)"
) -> str:
    """Bridge, coil and switch; return an expression of the harvested power.

    When the switch opens, the voltage of the coil reverses, and its current goes on through what stands for the load.
    The switch is closed for `on_time` (s) from the action on; the coil has a pulse of its own, "x", of which `pulse`
    may be a part.
    """
    real = shunt.coil(point.capacitance)
    impedance = math.sqrt(real.inductance / point.capacitance)
    coil = LoadedCoil(real, impedance, 2 * EDGE * on_time / STEEPNESS, 2 * shunt.diode_resistance)
    timing.pulse("x", coil.early, on_time)
    # The voltage is negative after a maximum, at which the pulse is 1.
    side = f"max(-1, min(1, 4*{pulse}))"
    # Once the electrodes are empty, all diodes conduct, and the coil meets one resistance of a diode instead of two.
    beyond, around = f"max(0, {side}*V(p))", SHORTED * impedance
    voltage = f"max(0, -{side}*V(p))+{number(shunt.diode_resistance / around)}*{beyond}"
    voltage += f"-2*{deck.parameter('diode_drop', shunt.diode_drop)}"
    power = write_coil_to_load(deck, point, coil, voltage, shunt.efficiency)
    deck.comment("The bridge is a diode in line with the coil, on either side of the electrodes by the pulse's sign.")
    deck.add(f"Bdraw p 0 I=-{side}*I(Vcoil)")
    deck.comment("Bfree: once the electrodes are empty, all diodes conduct, and their voltage stays at zero.")
    # While the coil is connected: the pulse goes on longer, as its edges are not that sharp.
    deck.add(f"Bfree p 0 I={side}*{beyond}/{number(around)}/(1+exp(-V(switchx)))")
    return power


class LoadedCoil(NamedTuple):
    """Coil whose energy goes to the load when its switch opens.

    Attributes
    ----------
    coil : RealCoil
    impedance : float
        sqrt(L/C) of its swing, ohm.
    change : float
        Time (s) in which the conductance of its switch changes by a factor e.
    line : float
        Resistance of diodes in series, ohm.
    """

    coil: RealCoil
    impedance: float
    change: float
    line: float = 0.0

    @property
    def critical(self) -> float:
        """Conductance (S) of the switch at which the current goes over to the load, or to the winding."""
        if self.coil.stray is None:
            return 1 / (LOAD * self.impedance)
        return critical_of_winding(float(self.coil.stray), self.change)

    @property
    def early(self) -> float:
        """Time (s) by which the pulse of the coil is late.

        A voltage meets the coil already where the contact resists as much as L over the time in which it changes by a
        factor e; the current goes over to the load only where it resists as much as that. A winding has both in one.
        """
        if self.coil.stray is not None:
            return 0.0
        ratio = float(self.coil.inductance) / self.change * self.critical
        return self.change * math.log(math.exp(-np.euler_gamma) * ratio)


def write_coil_to_load(deck: Deck, point: OperatingPoint, loaded: LoadedCoil, voltage: str, efficiency: float) -> str:
    """Coil at a voltage while the pulse "x" is there, then at the load; return an expression of the harvested power."""
    impedance = loaded.impedance
    deck.section("extraction: Bload takes the energy of the coil when the switch opens")
    conductance = write_conductance(deck, "x", loaded.critical, IDEAL / impedance, OPEN / impedance)
    deck.add(f"Brect rect 0 V={voltage}")
    end = _write_parts(deck, point, loaded)
    deck.add("Vcoil kx mx 0")
    # A diode: it conducts forward only.
    forward = f"0.5*(V(mx)+sqrt(V(mx)*V(mx)+{number((1e-6 * point.voltage) ** 2)}))"
    deck.add(f"Bcontactx mx 0 I={forward}*{conductance}")
    across = f"min(0, V(rect)-V({end}))"
    taken = f"{across}/{number(LOAD * impedance)}/(1+exp(V(switchx)))"
    deck.add(f"Bload rect {end} I={taken}")
    return f"{number(efficiency)}*{across}*{taken}" if efficiency else "0"


def _write_parts(deck: Deck, point: OperatingPoint, loaded: LoadedCoil) -> str:
    """The coil from `rect` to `kx`; return the node between which and `rect` the inductance is, and the load.

    Core and winding take nothing of what the load gets, as in the engine, where that happens at once.
    """
    coil = loaded.coil
    current, across = point.initial(coil.names[0]), point.initial(coil.names[1]) if coil.stray is not None else 0.0
    end = "lx" if coil.stray is None else "wx"
    deck.add(f"Lcoil rect {end}", coil.inductance, f"IC={number(abs(current))}")
    if coil.stray is None:
        deck.add("Rcoil lx kx", coil.resistance + loaded.line)
    else:
        deck.add("Rwindingx wx lx", coil.resistance)
        begins = across if current >= 0 else -across
        deck.add("Cwindingx rect lx", coil.stray, f"IC={number(begins)}")
        deck.add("Rclosedx lx kx", coil.contact + loaded.line)
    deck.add(f"Rdamp rect {end}", 10 * IDEAL * loaded.impedance)
    if coil.core is not None:
        core = deck.parameter("resistance_core", coil.core)
        deck.add(f"Bcore rect {end} I=(V(rect)-V({end}))/{core}/(1+exp(-V(switchx)))")
    return end
