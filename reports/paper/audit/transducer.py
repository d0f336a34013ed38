"""Table V against Tables I to IV: coupling, hysteresis, losses, stiffness, loads and forces."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from reports.paper.audit.finding import Finding, finding, mean, span
from reports.paper.model import open_circuit_voltage_per_force, table_circuit, table_value, transducer
from reports.paper.rows import RECORD, Bench, simulated
from reports.paper.tables import Row, experiment, rows

_LEVELS = (500.0, 750.0, 1000.0)


def _half_range(force: float) -> float:
    """Amplitude (N) of a sine between the offset and the force."""
    return 0.5 * (force - experiment()["offset_N"])


def _chosen(table: str, force: float) -> list[Row]:
    return [row for row in rows(table) if row.force == force]


def _peak_voltage(row: Row) -> float:
    """Voltage (V) that a step's peak power needs on its load."""
    return float(np.sqrt(row.peak.value * row.ohm))


def voltage_beyond_open_circuit() -> Finding:
    """Peak powers that Table V's coupling cannot give."""
    per_force = open_circuit_voltage_per_force(transducer("none"))
    steps = span(_peak_voltage(row) / (per_force * row.force) for row in rows("I"))
    # The sines' load is not printed: the smallest one gives the least voltage.
    smallest = min(experiment()["loads_ohm"])
    voltages = [np.sqrt((row.peak.value - row.peak.half) * smallest) for row in rows("II")]
    least = [v / (per_force * _half_range(row.force)) for v, row in zip(voltages, rows("II"), strict=True)]
    return finding(
        "voltage-beyond-open-circuit",
        steps[0] > 1.1,
        open_circuit_mV_per_N=1e3 * per_force,
        voltage_V=span(_peak_voltage(row) for row in rows("I")),
        over_open_circuit=steps,
        power_factor=[steps[0] ** 2, steps[1] ** 2],
        sines=len(least),
        sines_above=sum(bool(value > 1) for value in least),
        sines_over=span(least),
    )


def _stroke_per_force(row: Row) -> float:
    """Displacement amplitude for which a row of Table IV is the sum of |F x'| over a record, m/N of force amplitude."""
    middle = 0.5 * (row.force + experiment()["offset_N"])
    return row.energy.value / (RECORD * row.hertz * 4 * middle * _half_range(row.force))


def stiffness_agrees() -> Finding:
    """Stiffness of Table V against Table IV."""
    strokes = [_stroke_per_force(row) for row in _chosen("IV", 1000.0)]
    ratio = span(stroke * table_value("k") for stroke in strokes)
    return finding(
        "stiffness-agrees",
        max(abs(value - 1) for value in ratio) < 0.05,
        record_s=RECORD,
        stroke_nm_per_N=span(1e9 * stroke for stroke in strokes),
        over_table_v=ratio,
    )


def displacement_is_not_the_specimens() -> Finding:
    """Displacement saturates with force; voltage does not."""
    stroke = [mean(_stroke_per_force(row) for row in _chosen("IV", force)) for force in (500.0, 1000.0)]
    voltage = [np.sqrt(_chosen("II", force)[-1].energy.value) / _half_range(force) for force in (500.0, 1000.0)]
    work = [mean(row.energy.value for row in _chosen("III", force)) for force in (500.0, 1000.0)]
    exponent = float(np.log2(work[1] / work[0]))
    bend, change = stroke[1] / stroke[0] - 1, float(voltage[1] / voltage[0] - 1)
    return finding(
        "displacement-is-not-the-specimens",
        bend < -0.15 and abs(change) < 0.05 and exponent < 1.9,
        stroke_nm_per_N=[1e9 * value for value in stroke],
        table_v_nm_per_N=1e9 / table_value("k"),
        stroke_change=bend,
        voltage_change=change,
        step_exponent=exponent,
    )


def hysteresis_against_scaling() -> Finding:
    """Power grows as force squared, which a hysteresis of part of a volt does not let it."""
    found = {frequency: _exponents(frequency) for frequency in (1.0, 5.0)}
    supported = all(e[0] < 2.05 and min(e[3:]) > e[0] + 2 * e[1] for e in found.values())
    return finding("hysteresis-against-scaling", supported, at_1_Hz=found[1.0], at_5_Hz=found[5.0])


def _exponents(frequency: float) -> list[float]:
    """Exponent of energy over amplitude: printed, its uncertainty, simulated without hysteresis, play, stop reading."""
    low, high = (next(row for row in _chosen("II", f) if row.hertz == frequency) for f in (500.0, 1000.0))
    reach = np.log(_half_range(1000.0) / _half_range(500.0))
    load = experiment()["loads_ohm"][1]
    exponents = [np.log(high.energy.value / low.energy.value) / reach]
    exponents.append(sum(row.energy.half / row.energy.value for row in (low, high)) / reach)
    for reading in ("none", "play", "stop"):
        bench = Bench(transducer(reading))
        exponents.append(np.log(simulated(bench, high, load).energy / simulated(bench, low, load).energy) / reach)
    return [float(value) for value in exponents]


def loss_beside_the_load() -> Finding:
    """Energy falls with the load where peak voltage rises."""
    ends = [(chosen[0], chosen[-1]) for chosen in (_chosen("I", force) for force in _LEVELS)]
    energy = span(high.energy.value / low.energy.value - 1 for low, high in ends)
    square = span((_peak_voltage(high) / _peak_voltage(low)) ** 2 - 1 for low, high in ends)
    bench = Bench(transducer("stop"))
    model = simulated(bench, ends[-1][1]).energy / simulated(bench, ends[-1][0]).energy - 1
    leaks = [_leak_from_decay(force) for force in _LEVELS]
    loads = experiment()["loads_ohm"]
    return finding(
        "loss-beside-the-load",
        energy[1] < -0.05 and square[0] > 0 and model > -0.02,
        energy_change=energy[::-1],
        voltage_squared_change=square,
        model_change=model,
        leak_kohm=span(1e-3 * leak for leak in leaks),
        lost_share=span(load / (load + mean(leaks)) for load in loads),
    )


def _leak_from_decay(force: float) -> float:
    """Leak resistance (ohm) from a straight line of P_peak/E over 1/R."""
    chosen = _chosen("I", force)
    slope, level = np.polyfit([1 / row.ohm for row in chosen], [row.peak.value / row.energy.value for row in chosen], 1)
    return float(slope / level)


def load_of_the_sines() -> Finding:
    """Tables II and IV do not say which load."""
    loads = experiment()["loads_ohm"]
    constants = [_time_constant(force) for force in _LEVELS]
    constant, nominal = float(np.median(constants)), table_circuit().capacitance
    capacitance = [constant / load for load in loads]
    return finding(
        "load-of-the-sines",
        abs(capacitance[0] / nominal - 1) < 0.3 and capacitance[1] < nominal,
        time_constant_s=span(constants),
        median_s=constant,
        capacitance_uF=[1e6 * value for value in capacitance],
        table_v_uF=1e6 * nominal,
        voltage_factor=float(np.sqrt(loads[1] / loads[0])),
    )


def _time_constant(force: float) -> float:
    """R C (s) from the energies at 1 and 5 Hz."""
    by_frequency = {row.hertz: row.energy.value for row in _chosen("II", force)}
    wanted = by_frequency[1.0] / by_frequency[5.0]

    def excess(tau: float) -> float:
        first, last = ((2 * np.pi * f * tau) ** 2 for f in (1.0, 5.0))
        return first / (1 + first) * (1 + last) / last - wanted

    return float(brentq(excess, 1e-4, 10.0))  # pyright: ignore[reportArgumentType]


def force_at_middle_level() -> Finding:
    """Rows at 0.75 kN lie above the law through 0.5 and 1 kN."""
    excess = []
    for table, reach in (("I", float), ("II", _half_range)):
        for low, middle, high in zip(*(_chosen(table, force) for force in _LEVELS), strict=True):
            position = np.log(reach(750.0) / reach(500.0)) / np.log(reach(1000.0) / reach(500.0))
            law = low.energy.value ** (1 - position) * high.energy.value**position
            excess.append(middle.energy.value / law - 1)
    return finding(
        "force-at-750-n",
        min(excess) > 0 and mean(excess) > 0.05,
        energy_excess=span(excess),
        mean_energy_excess=mean(excess),
        mean_force_excess=mean(np.sqrt(1 + np.array(excess)) - 1),
    )


def converter_range() -> Finding:
    """Voltages beyond the converter's range."""
    limit = experiment()["converter_range_V"]
    beyond = [row for row in rows("I") if _peak_voltage(row) > limit]
    return finding(
        "converter-range",
        bool(beyond),
        limit_V=limit,
        rows=len(beyond),
        voltage_V=span(_peak_voltage(row) for row in beyond),
        if_clipped_V=span(row.peak.value / limit * row.ohm for row in beyond),
    )
