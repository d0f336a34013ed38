"""Diodes with the dc side behind them as netlist elements."""

from __future__ import annotations

import math

from piezoharvest.description.shunts.bridge import Bridge
from piezoharvest.description.shunts.curves.load_curve import LoadCurve
from piezoharvest.spice.deck import Deck, number
from piezoharvest.spice.operating_point import NetlistCircuit, OperatingPoint
from piezoharvest.spice.supply import write_supply
from piezoharvest.spice.switching import changes_of, odd_voltage

# Bridge: ratio of its least resistance to 1/(w C), and of the smoothing of its corner to the expected voltage.
BRIDGE = 1e-4
CORNER = 1e-5
# Strays to ground of a dc side behind real diodes, as a share of the clamped capacitance.
STRAY = 1e-5


class _Diodes:
    """Paths of diodes, as lines or with a model."""

    def __init__(self, deck: Deck, shunt: Bridge, point: OperatingPoint) -> None:
        self.deck, self.shunt, self.model = deck, shunt, point.diodes
        self.corner = number((CORNER * point.voltage) ** 2)
        if self.model is not None:
            deck.add(f".model diode {self.model}")
            return
        deck.comment(
            "What diodes of a path pass is a current through a resistance above the voltage at which they begin to "
            "conduct, with a rounded corner; real diodes stand here with --diodes."
        )
        self.least = BRIDGE / (point.omega * point.capacitance)
        if shunt.diode_curve is None:
            self.drop = deck.parameter("diode_drop", shunt.diode_drop)
            self.resistance = deck.parameter("resistance_path", self.least + shunt.path_resistance)

    def current(self, voltage: str) -> str:
        """Current of a path of lines for the voltage across it."""
        if self.shunt.diode_curve is None:
            return self._hinge(f"0.5/{self.resistance}", f"({voltage}-{self.shunt.diodes}*{self.drop})")
        bends = _path_bends(self.shunt, self.least)
        return " + ".join(self._hinge(number(0.5 * rise), f"({voltage}-{number(at)})") for at, rise in bends)

    def _hinge(self, factor: str, excess: str) -> str:
        """Twice the excess above zero, with a rounded corner, times a factor."""
        return f"{factor}*({excess} + sqrt({excess}*{excess}+{self.corner}))"

    def add(self, name: str, plus: str, minus: str) -> None:
        """One diode between two nodes, with what it conducts backwards."""
        if self.model is not None:
            self.deck.add(f"D{name} {plus} {minus} diode")
        else:
            across = "-".join(f"V({node})" for node in (plus, minus) if node != "0")
            across = f"(-{across})" if plus == "0" else f"({across})"
            self.deck.add(f"B{name} {plus} {minus} I={self.current(across)}")
        if self.shunt.diode_leakage:
            self.deck.add(f"Rback{name} {plus} {minus}", 1 / self.shunt.diode_leakage)


def _path_bends(shunt: Bridge, least: float) -> list[tuple[float, float]]:
    """Voltages (V) across a path of diodes at which its conductance rises, and by how much (S).

    `least` is a resistance (ohm) in line with the path.
    """
    own, curve = shunt.path_resistance + least, shunt.diode_curve
    if curve is None:
        return [(float(shunt.path_drop), 1.0 / own)]
    at = [shunt.path_drop + shunt.diodes * v + own * i for i, v in zip(curve.currents, curve.voltages, strict=True)]
    conductances = [1.0 / (own + shunt.diodes * curve.piece(k)[1]) for k in range(curve.pieces)]
    return list(zip(map(float, at[:-1]), changes_of(conductances), strict=True))


def write_bridge(deck: Deck, shunt: Bridge, point: OperatingPoint) -> NetlistCircuit:
    """Bridge across the electrodes, with currents that depend on the voltage."""
    if point.diodes is not None:
        return _write_real_bridge(deck, shunt, point, "p")
    deck.section("bridge: V(dc) is the voltage behind it")
    diodes = _Diodes(deck, shunt, point)
    pairs = [diodes.current(f"({sign}V(p)-V(dc))") for sign in ("", "-")]
    deck.add(f"Bin p 0 I={pairs[0]} - ({pairs[1]})")
    deck.add(f"Bout 0 dc I={pairs[0]} + {pairs[1]}")
    if shunt.diode_leakage:
        deck.comment("What all four diodes conduct backwards: Rback between the leads, and Rleak of the dc side.")
        deck.add("Rback p 0", 1 / shunt.diode_leakage)
    return write_dc_side(deck, shunt, point)


def write_series_bridge(deck: Deck, shunt: Bridge, point: OperatingPoint, node: str, current: float) -> NetlistCircuit:
    """Bridge from `node` to ground, in series with an inductor, with a voltage that depends on the current.

    `current` (A) is its peak current.
    """
    if point.diodes is not None:
        return _write_real_bridge(deck, shunt, point, node)
    deck.section("bridge in line with the inductor: V(dc) is the voltage behind it")
    deck.comment(
        "V(direction) is the sign of the current, rounded near zero; the bridge opposes it with V(dc) and two drops, "
        "and passes its magnitude on. Real diodes stand here with --diodes."
    )
    deck.add(f"Vbridge {node} opposed 0")
    deck.add("Hbridge through 0 Vbridge", 1 / current)
    deck.add(f"Bdirection direction 0 V=V(through)/sqrt(V(through)*V(through)+{number(BRIDGE**2)})")
    drop, resistance = (deck.parameter(key, getattr(shunt, key)) for key in ("diode_drop", "diode_resistance"))
    resistive = f"2*{resistance}*{number(current)}*V(through)"
    bent = ""
    if (curve := shunt.diode_curve) is not None:
        bent = f" + 2*{number(curve.voltages[0])}*V(direction)" if curve.voltages[0] else ""
        bent += f" + 2*({odd_voltage(curve, f'{number(current)}*V(through)')})"
    deck.add(f"Bin opposed 0 V=V(direction)*(V(dc)+2*{drop}) + {resistive}{bent}")
    deck.add(f"Bout 0 dc I={number(current)}*V(through)*V(direction)")
    return write_dc_side(deck, shunt, point)


def _write_real_bridge(deck: Deck, shunt: Bridge, point: OperatingPoint, node: str) -> NetlistCircuit:
    """Four diodes with a model between `node` and ground."""
    deck.section("bridge: V(dc) is the voltage behind it, between the nodes dcp and dcn")
    diodes, plus = _Diodes(deck, shunt, point), "dcp"
    for name, *nodes in (("1", node, "dcp"), ("2", "0", "dcp"), ("3", "dcn", node), ("4", "dcn", "0")):
        diodes.add(name, *nodes)
    inside = float(shunt.path_resistance - shunt.diodes * shunt.diode_resistance)
    if inside:
        plus = "inside"
        deck.add("Rinside dcp inside", inside)
    deck.add(f"Edc dc 0 {plus} dcn 1")
    deck.comment("While no diode conducts, strays of its capacitance hold the floating dc side: without, steps vanish.")
    stray = deck.parameter("capacitance_stray", STRAY * point.capacitance)
    deck.add(f"Cstrayp dcp 0 {stray} {point.condition('dc')}")
    deck.add(f"Cstrayn dcn 0 {stray} IC=0")
    return write_dc_side(deck, shunt, point, (plus, "dcn"))


def write_doubler(deck: Deck, shunt: Bridge, point: OperatingPoint) -> NetlistCircuit:
    """Two diodes and two capacitors in series, of which `p` charges one or the other against the ground."""
    deck.section("doubler: V(dc) is the voltage of both capacitors together, between the nodes upper and lower")
    diodes = _Diodes(deck, shunt, point)
    diodes.add("1", "p", "upper")
    diodes.add("2", "lower", "p")
    deck.add("Edc dc 0 upper lower 1")
    capacitors = (("upper", "upper 0", 1.0), ("lower", "0 lower", -1.0))
    if shunt.dc_voltage is not None:
        voltage = deck.parameter("dc_voltage", shunt.dc_voltage)
        for name, nodes, _ in capacitors:
            deck.add(f"V{name} {nodes} {{{voltage[1:-1]}/2}}")
        # What passes the diodes backwards is not counted.
        held = f" + 0.5*V(dc)*V(dc)*{number(shunt.diode_leakage)}" if point.diodes is None else ""
        return NetlistCircuit("V(upper)*I(Vupper) - V(lower)*I(Vlower)" + held, "V(dc)")
    assert shunt.smoothing_capacitance is not None  # or a dc voltage
    capacitance = deck.parameter("capacitance_smoothing", shunt.smoothing_capacitance)
    for name, nodes, sign in capacitors:
        voltage = 0.5 * (point.initial("dc") + sign * point.initial("difference"))
        plus, minus = nodes.split()
        if shunt.smoothing_resistance:
            resistance = deck.parameter("resistance_smoothing", shunt.smoothing_resistance)
            deck.add(f"Rsmoothing{name} {plus} inside_{name} {resistance}")
            plus = f"inside_{name}"
        deck.add(f"Csmoothing{name} {plus} {minus} {capacitance} IC={number(voltage)}")
    if shunt.dc_leakage:
        deck.add("Rleak upper lower", 1 / shunt.dc_leakage)
    _write_saturation(deck, shunt, point, "upper", "lower")
    return _write_loads(deck, shunt, point, ("upper", "lower"), ("upper", "lower"))


def write_half_wave(deck: Deck, shunt: Bridge, point: OperatingPoint) -> NetlistCircuit:
    """One diode to the dc side, and one across the leads."""
    deck.section("half-wave rectifier: V(dc) is the voltage behind the series diode")
    diodes = _Diodes(deck, shunt, point)
    diodes.add("1", "p", "dc")
    diodes.add("2", "0", "p")
    return write_dc_side(deck, shunt, point)


def write_dc_side(
    deck: Deck, shunt: Bridge, point: OperatingPoint, nodes: tuple[str, str] = ("dc", "0")
) -> NetlistCircuit:
    """Smoothing capacitor and load, or constant voltage, between two nodes, and what leaks there."""
    plus, minus = nodes
    leaks = shunt.dc_conductance if point.diodes is None or not shunt.discharged else shunt.dc_leakage
    if leaks:
        deck.add(f"Rleak {plus} {minus}", 1 / leaks)
    _write_saturation(deck, shunt, point, plus, minus)
    if shunt.dc_voltage is not None:
        deck.add(f"Vdc {plus} {minus} {deck.parameter('dc_voltage', shunt.dc_voltage)}")
        return NetlistCircuit("V(dc)*I(Vdc)", "V(dc)")
    assert shunt.smoothing_capacitance is not None  # or a dc voltage
    if shunt.smoothing_resistance:
        deck.add(f"Rsmoothing {plus} inside_smoothing", shunt.smoothing_resistance)
        plus = "inside_smoothing"
    deck.add(f"Csmoothing {plus} {minus}", shunt.smoothing_capacitance, point.condition("dc"))
    return _write_loads(deck, shunt, point, nodes, (plus, minus))


def _write_saturation(deck: Deck, shunt: Bridge, point: OperatingPoint, plus: str, minus: str) -> None:
    """What saturated diodes take of the dc side between two nodes; diodes with a model do so themselves."""
    current, _ = shunt.saturated
    if not current or point.diodes is not None:
        return
    deck.comment("Saturated diodes pass a current backwards: constant, and at low voltages in proportion.")
    held, at = (
        deck.parameter("current_saturation", current),
        deck.parameter("saturation_voltage", shunt.saturation_voltage),
    )
    deck.add(f"Bsaturated {plus} {minus} I={held}*max(-1, min(1, V({plus},{minus})/{at}))")


def _write_load_curve(deck: Deck, curve: LoadCurve, nodes: tuple[str, str]) -> str:
    """What the load takes beside its resistance, between two nodes; return its current."""
    rises = changes_of([float(curve.piece(k)[1]) for k in range(curve.pieces)])
    bends = [(at, rise) for at, rise in zip(curve.voltages[:-1], rises, strict=True) if rise]
    each = [f"{number(rise)}*" + (f"max(V(dc)-{number(at)},0)" if at else "V(dc)") for at, rise in bends]
    current = " + ".join(each) or "0"
    deck.add(f"Bload {' '.join(nodes)} I={current}")
    return current


def _write_loads(
    deck: Deck, shunt: Bridge, point: OperatingPoint, nodes: tuple[str, str], store: tuple[str, str]
) -> NetlistCircuit:
    """Load and supply between two nodes, of a smoothing capacitor between two others, or the same."""
    assert shunt.smoothing_capacitance is not None
    harvested, slowest, fastest = [], 0.0, math.inf
    if shunt.load_resistance is not None:
        deck.add(f"Rload {' '.join(nodes)}", shunt.load_resistance)
        harvested.append("V(dc)*V(dc)/{resistance_load}")
        if shunt.load_curve is not None:
            harvested.append(f"V(dc)*({_write_load_curve(deck, shunt.load_curve, nodes)})")
        slowest = shunt.smoothing_capacitance * shunt.load_resistance
    if shunt.storage is not None:
        harvested.append(write_supply(deck, shunt.storage, point, nodes, store))
        fastest = min((float(phase.duration) for phase in shunt.storage.phases), default=math.inf)
    return NetlistCircuit(" + ".join(harvested), "V(dc)", fastest, slowest)
