"""Shunts as netlist elements between the electrodes, nodes `p` and 0, with one function for each kind."""

from __future__ import annotations

import math
from collections.abc import Callable

from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts.base import LinearShunt, Shunt
from piezoharvest.description.shunts.cold_start import StartedSwitch
from piezoharvest.description.shunts.switching import SynchronisedShunt
from piezoharvest.spice.breakers import write_breakers
from piezoharvest.spice.bridges import write_bridge, write_doubler, write_half_wave, write_series_bridge
from piezoharvest.spice.controllers.adaptive import write_adaptive_rl
from piezoharvest.spice.controllers.sampled import write_digital
from piezoharvest.spice.deck import Deck, number, total
from piezoharvest.spice.operating_point import NetlistCircuit, OperatingPoint
from piezoharvest.spice.stages import (
    write_bias_flip,
    write_dssh,
    write_essh,
    write_sc_sece,
    write_sece,
    write_sice,
    write_sshc,
)
from piezoharvest.spice.supply import write_control
from piezoharvest.spice.switching import write_discharge, write_loop

HELD = 1e4  # over what drives it beyond, with which a saturated output is held at its limit


def write_shunt(deck: Deck, shunt: Shunt, point: OperatingPoint) -> NetlistCircuit:
    """Write a shunt of any supported kind.

    Raises
    ------
    ParameterError
        The kind is not supported, as one from a user's own script.
    """
    if shunt.kind not in WRITERS:
        known = ", ".join(sorted(WRITERS))
        found = f"found kind {shunt.kind!r}, which cannot be exported to SPICE, allowed are {known}"
        if isinstance(shunt, LinearShunt):
            found += "; shunt_from(linearize_shunt(...)) makes a network of it"
        raise ParameterError("shunt", found)
    deck.section(f"shunt: {shunt.kind}")
    if isinstance(shunt, StartedSwitch) and shunt.start_voltage is not None:
        write_control(deck, shunt, point)
        point = point._replace(cold=True)
    circuit = WRITERS[shunt.kind](deck, shunt, point)
    circuit = _less_control(deck, shunt, point, circuit)
    for other in shunt.others:
        circuit = _beside(deck, circuit, other, point)
    return circuit


def _less_control(deck, shunt, point, circuit):
    """The circuit, what its control takes being no part of what is harvested."""
    if not isinstance(shunt, SynchronisedShunt) or not (shunt.gate_energy or shunt.control_power):
        return circuit
    power = shunt.control_power
    if shunt.gate_energy:
        period = point.excitation.period
        if period is None:
            found = f"found {shunt.gate_energy:g} J under an excitation without a period"
            raise ParameterError("gate_energy", f"{found}, but a netlist has its mean over a period")
        deck.comment("Gates take the mean power of two actions a period in all stages, whether they happen or not.")
        power = power + 2 * _stages(shunt) * shunt.gate_energy / period
    return circuit._replace(harvested=f"{circuit.harvested} - {deck.parameter('power_control', power)}")


def _stages(shunt):
    """Number of stages of one action of the switch."""
    configuration, count = shunt.closed(shunt.configurations()[0], 1), 1
    while (configuration := shunt.opened(configuration)) != shunt.opened(configuration):
        count += 1
    return count


def _beside(deck, circuit, other, point):
    """Add another shunt, at electrodes of its own: a subcircuit, in which nodes and elements have their usual names."""
    own, number = Deck(""), other.electrode
    found = write_shunt(own, other, point.of_other(other))
    own.add("Bharvested harvested 0 V=" + found.harvested)
    deck.add(f".subckt shunt{number} p harvested")
    deck.include(own, f"_electrode{number}")
    deck.add(f".ends shunt{number}")
    deck.add(f"Xshunt{number} p{number} harvested{number} shunt{number}")
    harvested = f"{circuit.harvested} + V(harvested{number})"
    return circuit._replace(harvested=harvested, slowest=max(circuit.slowest, found.slowest))


def _open(deck, shunt, point):
    deck.comment("Nothing is connected.")
    return NetlistCircuit()


def _short(deck, shunt, point):
    deck.add("Vshort p 0 0")
    return NetlistCircuit()


def _resistor(deck, shunt, point):
    deck.add("Rload p 0", shunt.resistance)
    capacitance = point.capacitance + getattr(shunt, "capacitance", 0.0)
    return _load("p", shunt, 2 * shunt.resistance * capacitance)


def _series_rl(deck, shunt, point):
    _coil(deck, shunt, point, "r")
    deck.add("Rload r 0", shunt.resistance)
    return _load("r", shunt, 2 * shunt.inductance / (shunt.resistance + getattr(shunt, "winding", 0.0)))


def _parallel_rl(deck, shunt, point):
    _coil(deck, shunt, point, "0")
    return _resistor(deck, shunt, point)


def _coil(deck, shunt, point, end):
    """Coil from the lead to `end`: inductance beside its core, in line with the winding; capacitance across both."""
    begin = "p"
    if getattr(shunt, "winding", 0.0):
        deck.add("Rwinding p w", shunt.winding)
        begin = "w"
    deck.add(f"Lshunt {begin} {end}", shunt.inductance, point.condition("current"))
    if getattr(shunt, "core_resistance", None) is not None:
        deck.add(f"Rcore {begin} {end}", shunt.core_resistance)
    if getattr(shunt, "self_resonance", None) is not None:
        deck.add(f"Cwinding p {end}", shunt.stray_capacitance, point.condition("winding"))


def _series_rlc(deck, shunt, point):
    deck.add("Lshunt p c", shunt.inductance, point.condition("current"))
    deck.add("Cshunt c r", shunt.capacitance, point.condition("voltage"))
    deck.add("Rload r 0", shunt.resistance)
    return _load("r", shunt, 2 * shunt.inductance / shunt.resistance)


def _parallel_rlc(deck, shunt, point):
    deck.add("Cshunt p 0", shunt.capacitance, point.condition("voltage"))
    return _parallel_rl(deck, shunt, point)


def _op_amp(deck, shunt, point):
    deck.comment("V(out) is the output of the amplifier, an integrator of its input, held at the saturation.")
    begins = point.initial("v_t") - point.initial("across")
    limit = deck.parameter("saturation", shunt.saturation)
    beyond = f"(max(0, V(out)-{limit})+min(0, V(out)+{limit}))*{number(HELD)}"
    deck.add(f"Binput 0 out I=V(p)-0.5*V(out)-{beyond}")
    deck.add("Cout out 0", 1 / (2 * math.pi * shunt.gain_bandwidth), f"IC={number(begins)}")
    deck.add("Eout u 0 out 0 1")
    deck.add("Cnegative p u", shunt.capacitance, point.condition("across"))
    deck.add("Rload p 0", shunt.resistance)
    return _load("p", shunt, 2 * shunt.resistance * point.capacitance)


def _branches(deck, shunt, point):
    harvested = []
    for n, inductance, resistance, capacitance in shunt.branches():
        if capacitance is not None:
            deck.add(f"Cbranch{n} c{n} r{n}", capacitance, point.condition(f"voltage_{n}"))
        deck.add(f"Lbranch{n} p {'r' if capacitance is None else 'c'}{n}", inductance, point.condition(f"current_{n}"))
        deck.add(f"Rbranch{n} r{n} 0", resistance)
        harvested.append((f"1/{{resistance_branch{n}}}", f"V(r{n})*V(r{n})"))
    slowest = max(2 * inductance / resistance for _, inductance, resistance, _ in shunt.branches())
    return NetlistCircuit(total(harvested), slowest=slowest)


def _blocking(deck, shunt, point):
    ends, harvested = ["p"] * len(shunt.inductances), []
    for n, mode, name in shunt.blocks():
        ends[n], begin, coil = f"b{name}", ends[n], shunt.coil_resistance(mode)
        end, inductance = f"l{name}" if coil else ends[n], shunt.blocking_inductances[mode]
        capacitance = shunt.blocking_capacitances[mode]
        deck.add(f"Cblock{name} {begin} {ends[n]}", capacitance, point.condition(f"voltage_{name}"))
        deck.add(f"Lblock{name} {begin} {end}", inductance, point.condition(f"current_{name}"))
        if coil:
            deck.add(f"Rblock{name} l{name} {ends[n]}", coil)
    for n, (inductance, resistance) in enumerate(zip(shunt.inductances, shunt.resistances, strict=True)):
        deck.add(f"Lbranch{n} {ends[n]} r{n}", inductance, point.condition(f"current_{n}"))
        deck.add(f"Rbranch{n} r{n} 0", resistance)
        harvested.append((f"1/{{resistance_branch{n}}}", f"V(r{n})*V(r{n})"))
    losses = [(shunt.blocking_inductances[mode], shunt.coil_resistance(mode)) for _, mode, _ in shunt.blocks()]
    parts = [*zip(shunt.inductances, shunt.resistances, strict=True), *(pair for pair in losses if pair[1])]
    slowest = max(2 * inductance / resistance for inductance, resistance in parts)
    return NetlistCircuit(total(harvested), slowest=slowest)


def _tracker(deck, shunt, point):
    circuit = write_bridge(deck, shunt, point)
    return circuit._replace(harvested=f"{number(1 - shunt.sampling_duty)}*({circuit.harvested})")


def _negative_capacitance(deck, shunt, point):
    if shunt.topology == "parallel":
        deck.comment("A copy of V(p) charges Cmirror; as much current is sent back into the electrodes.")
        deck.add("Emirror m 0 p 0 1")
        deck.add("Vmirror m n 0")
        deck.add("Cmirror n 0", shunt.capacitance, point.condition("voltage"))
        deck.add("Fnegative 0 p Vmirror 1")
        return _resistor(deck, shunt, point)
    deck.comment("The current also charges Cmirror, whose voltage drives it on.")
    deck.add("Rload p r", shunt.resistance)
    deck.add("Vmirror r n 0")
    deck.add("Fmirror 0 m Vmirror 1")
    deck.add("Cmirror m 0", shunt.capacitance, f"IC={number(-point.initial('voltage'))}")
    deck.add("Enegative n 0 m 0 -1")
    power = "(V(p)-V(r))*(V(p)-V(r))/{resistance_load}"
    return NetlistCircuit(power, slowest=shunt.resistance * shunt.capacitance)


def _network(deck, shunt, point):
    nodes = {0: "0", 1: "p"}
    harvested = []
    for e in shunt.elements:
        plus, minus = (nodes.get(node, f"net{node}") for node in e.nodes)
        deck.add(f"{e.kind}_{e.name} {plus} {minus}", e.value, *_condition(e, point))
        if e.load:
            across = f"({' - '.join(f'V({node})' for node in (plus, minus) if node != '0')})"
            harvested.append((f"1/{{resistance_{e.name.lower().strip('_')}}}", f"{across}*{across}"))
    return NetlistCircuit(total(harvested))


def _condition(element, point):
    if element.kind == "R":
        return []
    return [point.condition(f"{'voltage' if element.kind == 'C' else 'current'}_{element.name}")]


def _imported(deck, shunt, point):
    """A net list again, diodes as the law that the engine has."""
    numbers = {0: "0", 1: "p"}
    names = {branch.name.lower(): f"{branch.part.kind}_{_plain(branch.name)}" for branch in shunt.branches}
    fluxes = [point.initial(f"flux_{n}") for n in range(len(shunt.coils[0]))]
    currents = dict(zip([coil.name for coil in shunt.coils[0]], shunt.coils[1] @ fluxes, strict=True))
    harvested, stored, dc = [], shunt.dc_capacitor, "0"
    for branch in shunt.branches:
        kind, model, name = branch.part.kind, branch.part.model, names[branch.name.lower()]
        plus, minus = (numbers.get(node, f"net{node}") for node in branch.nodes)
        across = f"(V({plus})-V({minus}))"
        if kind == "D":
            more = f"({number(1 / model['ron'] - 1 / model['roff'])})*max(0, {across}-{number(model['vfwd'])})"
            deck.add(f"B{name} {plus} {minus} I={across}*{number(1 / model['roff'])} + {more}")
        elif kind == "S":
            controls = (numbers.get(shunt.nodes[node], f"net{shunt.nodes[node]}") for node in branch.part.nodes[2:])
            deck.add(f".model model_{name} SW(" + " ".join(f"{key}={number(v)}" for key, v in model.items()) + ")")
            deck.add(f"{name} {plus} {minus} {' '.join(controls)} model_{name}")
        elif kind == "C":
            deck.add(f"{name} {plus} {minus}", branch.value, point.condition(f"voltage_{branch.name}"))
            if stored is not None and branch is stored[0]:
                dc = across if stored[1] > 0 else f"-{across}"
        elif kind == "L":
            deck.add(f"{name} {plus} {minus}", branch.value, f"IC={number(currents[branch.name])}")
        else:
            deck.add(f"{name} {plus} {minus}", branch.value)
        if branch.name.lower() in shunt.load:
            through = {"R": f"{across}/{number(branch.value or 1)}", "V": f"I({name})", "I": number(branch.value)}
            harvested.append((1.0, f"{across}*{through[kind]}"))
    for coupling in shunt.couplings:
        deck.add(f"K_{_plain(coupling.name)} {' '.join(names[coil] for coil in coupling.of)} {number(coupling.value)}")
    return NetlistCircuit(total(harvested), dc)


def _plain(name):
    """Name of a part without the dots of subcircuits."""
    return name.replace(".", "_")


def _parallel_sshi(deck, shunt, point):
    loop = write_loop(deck, shunt, point, "0")
    return write_bridge(deck, shunt, point)._replace(fastest=loop.on_time)


def _series_sshi(deck, shunt, point):
    loop = write_loop(deck, shunt, point, "b")
    return write_series_bridge(deck, shunt, point, "b", point.voltage / loop.impedance)._replace(fastest=loop.on_time)


def _ssdi(deck, shunt, point):
    return NetlistCircuit(fastest=write_loop(deck, shunt, point, "0").on_time)


def _ssds(deck, shunt, point):
    if shunt.inductance is None:
        return write_discharge(deck, shunt, point)
    return _ssdi(deck, shunt, point)


def _ssdv(deck, shunt, point):
    loop = write_loop(deck, shunt, point, "source")
    deck.comment("The source drives the inverted voltage further: up after a maximum, down after a minimum.")
    source = deck.parameter("source_voltage", shunt.source_voltage)
    deck.add(f"Bsource source 0 V={source}*max(-1, min(1, 4*V(pulse)))")
    return NetlistCircuit(fastest=loop.on_time)


def _load(node: str, shunt, slowest: float) -> NetlistCircuit:
    """Circuit of a load between `node` and ground, with the longest time constant."""
    return NetlistCircuit(f"V({node})*V({node})/{{resistance_load}}", slowest=slowest)


WRITERS: dict[str, Callable[..., NetlistCircuit]] = {
    "open": _open,
    "short": _short,
    "resistor": _resistor,
    "series_rl": _series_rl,
    "parallel_rl": _parallel_rl,
    "series_rlc": _series_rlc,
    "parallel_rlc": _parallel_rlc,
    "negative_capacitance": _negative_capacitance,
    "network": _network,
    "spice": _imported,
    "current_flowing": _branches,
    "parallel_branches": _branches,
    "current_blocking": _blocking,
    "rectifier": write_bridge,
    "doubler": write_doubler,
    "half_wave": write_half_wave,
    "battery": write_bridge,
    "mppt": _tracker,
    **dict.fromkeys(("self_powered_sshi", "self_powered_series_sshi", "self_powered_ssdi"), write_breakers),
    "self_powered_sece": write_breakers,
    "parallel_sshi": _parallel_sshi,
    "series_sshi": _series_sshi,
    "sshc": write_sshc,
    "bias_flip": write_bias_flip,
    "sece": write_sece,
    "sice": write_sice,
    "sc_sece": write_sc_sece,
    "dssh": write_dssh,
    "op_amp_negative_capacitance": _op_amp,
    "adaptive_rl": write_adaptive_rl,
    "digital": write_digital,
    "essh": write_essh,
    "ssds": _ssds,
    "ssdi": _ssdi,
    "ssdv": _ssdv,
}
