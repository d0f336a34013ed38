"""Excitation, mechanics and transducer as netlist elements."""

from __future__ import annotations

import math

import numpy as np

from piezoharvest.description.excitation import Ramps
from piezoharvest.spice.deck import Deck, number, total
from piezoharvest.spice.effects import write_effects
from piezoharvest.spice.operating_point import OperatingPoint
from piezoharvest.spice.stop import SATURATION_SHARE, write_stop


def write_drive(deck: Deck, point: OperatingPoint) -> None:
    """Node `drive`: force in N or base acceleration in m/s^2."""
    deck.section("excitation: V(drive) is the " + ("base acceleration, m/s^2" if point.excitation.base else "force, N"))
    signal = point.signal
    if isinstance(signal, Ramps):
        deck.add("Vdrive drive 0 PWL(", *_points(signal), ")")
    elif len(signal.frequencies) == 1:
        amplitude, phase = np.broadcast_to(signal.amplitudes, 1)[0], math.degrees(signal.phases[0])
        sine = (signal.offset, amplitude, signal.frequencies[0], 0, 0, phase)
        deck.add(f"Vdrive drive 0 SIN({' '.join(map(number, sine))})")
    else:
        tones = zip(signal.frequencies, signal.amplitudes, signal.phases, strict=True)
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


def write_mechanics(deck: Deck, point: OperatingPoint) -> None:
    """Nodes `u1`, `f1`, ... of each mode, and the output sums over the modes."""
    deck.section("mechanics: force is current, velocity is voltage, mass is capacitance, damping is conductance")
    deck.comment(
        "Of mode n: V(un) velocity in m/s, V(fn) force of the spring in N (displacement times stiffness), into which "
        "the velocity is integrated. No inductor is used: LTspice would give it a series resistance unasked."
    )
    for n, (mode, gain) in enumerate(zip(point.transducer.all_modes, gains(point), strict=True), 1):
        deck.add(f"Cmass{n} u{n} 0", mode.mass, "IC=0")
        if mode.damping:
            deck.add(f"Rdamping{n} u{n} 0", 1 / mode.damping)
        deck.add(f"Gdrive{n} 0 u{n} drive 0", gain)
        deck.add(f"Gspring{n} u{n} 0 f{n} 0 1")
        deck.add(f"Cspring{n} f{n} 0", 1 / mode.stiffness, f"IC={number(mode.stiffness * point.rest[f'x{n}'])}")
        deck.add(f"Grate{n} 0 f{n} u{n} 0 1")
        deck.add(f"Gcoupling{n} 0 u{n} t 0", mode.coupling)


def displacement(point: OperatingPoint) -> str:
    """Expression of the displacement output, m."""
    modes = enumerate(point.transducer.all_modes, 1)
    return total((mode.force_participation / mode.stiffness, f"V(f{n})") for n, mode in modes)


def coupled_acceleration(point: OperatingPoint) -> str:
    """Expression of sum T_i x_i'', A/s."""
    terms = []
    for n, (mode, gain) in enumerate(zip(point.transducer.all_modes, gains(point), strict=True), 1):
        forces = [(gain, "V(drive)"), (mode.coupling, "V(t)"), (-mode.damping, f"V(u{n})"), (-1.0, f"V(f{n})")]
        if point.terms.pushes[n - 1].any():
            forces.append((1.0, f"V(push{n})"))
        terms += [(mode.coupling / mode.mass * factor, signal) for factor, signal in forces]
    return total(terms)


def coupled_velocity(point: OperatingPoint) -> str:
    """Expression of sum T_i x_i', A."""
    return total((mode.coupling, f"V(u{n})") for n, mode in enumerate(point.transducer.all_modes, 1))


def mechanical_power(point: OperatingPoint) -> str:
    """Expression of the power that the drive delivers, W."""
    return f"V(drive)*({total((gain, f'V(u{n})') for n, gain in enumerate(gains(point), 1))})"


def write_transducer(deck: Deck, point: OperatingPoint) -> None:
    """Electrode node `p`, clamped node `t`, hysteresis between them, and the effects."""
    transducer = point.transducer
    deck.section("transducer: V(p) electrode voltage v_p, V(t) voltage v_t of the clamped capacitance")
    deck.comment("I(Vport) is i_p, into the transducer's positive lead.")
    inner = "h" if transducer.hysteresis else "t"
    deck.add(f"Vport p {inner} 0")
    deck.add("Ccl t 0", transducer.capacitance, "IC=0")
    for n, mode in enumerate(transducer.all_modes, 1):
        deck.add(f"Gstrain{n} t 0 u{n} 0", mode.coupling)
    if transducer.hysteresis:
        _write_hysteresis(deck, point)
    write_effects(deck, point)


def _write_hysteresis(deck: Deck, point: OperatingPoint) -> None:
    """Stop operators, as capacitors that integrate the current while they stick."""
    hysteresis = point.transducer.hysteresis
    assert hysteresis is not None
    deck.section("hysteresis: V(h,t) is v_h, the sum of stop operators of the charge")
    deck.comment(
        f"V(s1), V(s2), ... are the operators over their thresholds, within -1 and 1. They follow the charge exactly "
        f"until {SATURATION_SHARE:g} before the threshold, then approach it exponentially: the area of a loop is wrong "
        f"by about {SATURATION_SHARE**2:.0e} of that of the square of side 2 r."
    )
    voltages = []
    for n, (r, w) in enumerate(zip(hysteresis.thresholds, hysteresis.weights, strict=True), 1):
        write_stop(deck, point, f"s{n}", "I(Vport)", r)
        voltages.append((w * r, f"V(s{n})"))
    deck.add("Bhysteresis h t V=" + total(voltages))
