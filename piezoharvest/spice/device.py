"""Excitation, mechanics and transducer as netlist elements."""

from __future__ import annotations

import math

import numpy as np

from piezoharvest.description.excitation import Ramps
from piezoharvest.spice.deck import Deck, number, total
from piezoharvest.spice.effects import write_effects
from piezoharvest.spice.operating_point import OperatingPoint
from piezoharvest.spice.stop import write_slip


def write_drive(deck: Deck, point: OperatingPoint) -> None:
    """Node `drive`: force in N or base acceleration in m/s^2."""
    deck.section("excitation: V(drive) is the " + ("base acceleration, m/s^2" if point.excitation.base else "force, N"))
    signal, begin = point.signal, point.start.time if point.start else 0.0
    if isinstance(signal, Ramps):
        deck.add("Vdrive drive 0 PWL(", *_points(signal), ")")
    elif len(signal.frequencies) == 1:
        amplitude = deck.parameter("drive_amplitude", np.broadcast_to(signal.amplitudes, 1)[0])
        frequency = deck.parameter("drive_frequency", signal.frequencies[0])
        offset = deck.parameter("drive_offset", signal.offset)
        phase = math.degrees(signal.phases[0] + 2 * math.pi * signal.frequencies[0] * begin)
        deck.add(f"Vdrive drive 0 SIN({offset} {amplitude} {frequency} 0 0 {number(math.remainder(phase, 360))})")
    else:
        phases = signal.phases + 2 * np.pi * signal.frequencies * begin
        tones = zip(signal.frequencies, signal.amplitudes, phases, strict=True)
        sines = [(a, f"sin({number(2 * np.pi * f)}*time+({number(phase)}))") for f, a, phase in tones]
        deck.add("Bdrive drive 0 V=" + total([*sines, (signal.offset, "1")]))


def _points(signal: Ramps) -> list[str]:
    """Corners of a piecewise linear signal; a jump becomes a steep ramp, as PWL needs increasing times."""
    jump = 1e-6 * float(np.min(np.diff(signal.times)))
    ends = signal.starts + signal.slopes * np.diff(signal.times)
    points = [(signal.times[0], signal.starts[0])]
    for time, end, start in zip(signal.times[1:], ends, [*signal.starts[1:], None], strict=True):
        points.append((time, end))
        if start is not None and abs(start - end) > 1e-12 * np.max(np.abs(signal.starts)):
            points.append((time + jump, start))
    return [f"{time:.12g} {value:.9g}" for time, value in points]


def gains(point: OperatingPoint) -> list[float]:
    """Force on each mode per unit of the drive."""
    modes = point.transducer.all_modes
    return [-mode.base_mass if point.excitation.base else mode.force_participation for mode in modes]


def write_transducer(deck: Deck, point: OperatingPoint) -> None:
    """Subcircuit of mechanics, electrodes, hysteresis and effects, and its place in the circuit.

    Its pins have the names of the nodes outside: the lead `p`, the drive, and what others need to know of its inside.
    """
    count = len(point.transducer.all_modes)
    pushed = [f"push{n}" for n, push in enumerate(point.terms.pushes, 1) if push.any()]
    inside = [*(f"{kind}{n}" for n in range(1, count + 1) for kind in "uf"), *pushed]
    deck.section("transducer")
    deck.comment(
        "Pins: p positive lead (the negative one is node 0), drive, t voltage v_t of the clamped capacitance; of mode "
        "n un velocity in m/s, fn force of the spring in N" + (", pushn force of effects in N" if pushed else "") + "."
    )
    pins = f"drive t {' '.join(inside)}"
    further = range(1, 1 + len(point.transducer.electrodes))
    if further:
        deck.comment("Further electrodes have the positive leads en, outside pn; the shunt's are the lead there.")
    deck.add(f".subckt transducer {' '.join(['p', *(f'e{k}' for k in further)])} {pins}")
    _write_mechanics(deck, point)
    _write_electrodes(deck, point)
    _write_further_electrodes(deck, point)
    write_effects(deck, point)
    deck.add(".ends transducer")
    deck.section("circuit: V(p) electrode voltage v_p, I(Vload) current out of the transducer's positive lead")
    leads = ["lead" if k == point.taken[0] else f"p{k}" for k in (0, *further)]
    deck.add(f"Xtransducer {' '.join(leads)} {pins} transducer")
    deck.add("Vload lead p 0")


def _named(n: int, name: str) -> str:
    """What stands for a parameter of a mode; the first one has the plain name."""
    return f"{{{name}}}" if n == 1 else f"{{{name}_{n}}}"


def _of_mode(deck: Deck, n: int, name: str, value: float) -> str:
    """Add a parameter of a mode, and return what stands for it."""
    return deck.parameter(_named(n, name)[1:-1], value)


def _write_mechanics(deck: Deck, point: OperatingPoint) -> None:
    """Nodes `u1`, `f1`, ... of each mode."""
    deck.comment(
        "Mechanics: force is current, velocity is voltage, mass is capacitance, damping is conductance. Into V(fn) the "
        "velocity is integrated; no inductor is used: LTspice would give it a series resistance unasked."
    )
    for n, (mode, gain) in enumerate(zip(point.transducer.all_modes, gains(point), strict=True), 1):
        mass, stiffness = _of_mode(deck, n, "mass", mode.mass), _of_mode(deck, n, "stiffness", mode.stiffness)
        coupling = _of_mode(deck, n, "coupling", mode.coupling)
        deck.add(f"Cmass{n} u{n} 0 {mass} {point.condition(f'u{n}')}")
        if mode.damping:
            damping = _of_mode(deck, n, "damping", mode.damping)
            deck.add(f"Rdamping{n} u{n} 0 {{1/{damping[1:-1]}}}")
        deck.add(f"Gdrive{n} 0 u{n} drive 0 {_of_mode(deck, n, 'drive_gain', gain)}")
        deck.add(f"Gspring{n} u{n} 0 f{n} 0 1")
        spring = number(mode.stiffness * point.initial(f"x{n}"))
        deck.add(f"Cspring{n} f{n} 0 {{1/{stiffness[1:-1]}}} IC={spring}")
        deck.add(f"Grate{n} 0 f{n} u{n} 0 1")
        deck.add(f"Gcoupling{n} 0 u{n} t 0 {coupling}")


def _write_electrodes(deck: Deck, point: OperatingPoint) -> None:
    """Lead `p`, clamped capacitance at `t`, hysteresis between them."""
    transducer = point.transducer
    deck.comment("Electrodes: I(Vport) is i_p, into the positive lead.")
    deck.add(f"Vport p {'h' if transducer.hysteresis else 't'} 0")
    capacitance = deck.parameter("capacitance", transducer.capacitance)
    deck.add(f"Cclamped t 0 {capacitance} IC={number(point.across(0))}")
    for n, mode in enumerate(transducer.all_modes, 1):
        deck.add(f"Gstrain{n} t 0 u{n} 0 {_of_mode(deck, n, 'coupling', mode.coupling)}")
    if not transducer.hysteresis:
        return
    deck.comment(
        "Hysteresis: V(h,t) is v_h. A Maxwell-slip network, in line with the clamped capacitance: each element sticks "
        "as a capacitor, and slips where what lies beside it conducts, at its limit in either direction."
    )
    stops = list(zip(transducer.hysteresis.thresholds, transducer.hysteresis.weights, strict=True))
    ends = ["h", *(f"h{n}" for n in range(1, len(stops))), "t"]
    for n, (threshold, weight) in enumerate(stops, 1):
        write_slip(deck, point, n, (ends[n - 1], ends[n]), threshold, weight)


def _write_further_electrodes(deck: Deck, point: OperatingPoint) -> None:
    """Positive leads `e1`, ... of the further electrodes, which are their clamped capacitances."""
    for k, electrode in enumerate(point.transducer.electrodes, 1):
        capacitance = deck.parameter(f"capacitance_electrode{k}", electrode.capacitance)
        deck.add(f"Celectrode{k} e{k} 0 {capacitance} IC={number(point.across(k))}")
        for n in range(1, 1 + len(electrode.couplings)):
            coupling = _coupling(deck, point, k, n)
            deck.add(f"Gstrain{k}_{n} e{k} 0 u{n} 0 {coupling}")
            deck.add(f"Gcoupling{k}_{n} 0 u{n} e{k} 0 {coupling}")


def _coupling(deck: Deck, point: OperatingPoint, k: int, n: int) -> str:
    """Add the coupling of electrodes with a mode as a parameter, and return what stands for it."""
    value = point.transducer.all_electrodes[k].couplings[n - 1]
    return deck.parameter(f"coupling_electrode{k}_{n}" if k else _named(n, "coupling")[1:-1], value)


def displacement(point: OperatingPoint) -> str:
    """Expression of the displacement output, m."""
    modes = enumerate(point.transducer.all_modes, 1)
    return total((f"{number(mode.seen)}/{_named(n, 'stiffness')}", f"V(f{n})") for n, mode in modes)


def coupled_acceleration(deck: Deck, point: OperatingPoint) -> str:
    """Expression of sum T_i x_i'', A/s, of the shunt's electrodes."""
    terms, further = [], range(1, 1 + len(point.transducer.electrodes))
    for n, mode in enumerate(point.transducer.all_modes, 1):
        forces = [(_named(n, "drive_gain"), "V(drive)"), (_named(n, "coupling"), "V(t)"), ("-1", f"V(f{n})")]
        if mode.damping:
            forces.append((f"-{_named(n, 'damping')}", f"V(u{n})"))
        forces += [(_coupling(deck, point, k, n), "V(p)" if k == point.taken[0] else f"V(p{k})") for k in further]
        if point.terms.pushes[n - 1].any():
            forces.append(("1", f"V(push{n})"))
        coupling = _coupling(deck, point, point.taken[0], n)
        terms.append((f"{coupling}/{_named(n, 'mass')}", f"({total(forces)})"))
    return total(terms)


def coupled_velocity(deck: Deck, point: OperatingPoint) -> str:
    """Expression of sum T_i x_i', A, of the shunt's electrodes."""
    modes = range(1, 1 + len(point.transducer.all_modes))
    return total((_coupling(deck, point, point.taken[0], n), f"V(u{n})") for n in modes)


def mechanical_power(point: OperatingPoint) -> str:
    """Expression of the power that the drive delivers, W."""
    modes = enumerate(point.transducer.all_modes, 1)
    return f"V(drive)*({total((_named(n, 'drive_gain'), f'V(u{n})') for n, _ in modes)})"
