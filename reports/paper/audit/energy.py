"""What the energies per cycle can and cannot be."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from reports.paper import closed_form as cf
from reports.paper.audit.finding import Finding, finding, mean, span
from reports.paper.model import table_circuit, table_value, transducer
from reports.paper.rows import RECORD, Bench, simulated
from reports.paper.tables import Row, experiment, rows

_LEVELS = (500.0, 750.0, 1000.0)


def _above_peak(table: str) -> Finding:
    """An energy per cycle that would need more than the peak power all the time."""
    ratios = [row.energy.value * row.hertz / row.peak.value for row in rows(table)]
    favourable = [(row.energy.value - row.energy.half) / (row.peak.value + row.peak.half) for row in rows(table)]
    least = min(ratio * row.hertz for ratio, row in zip(favourable, rows(table), strict=True))
    last = rows(table)[-1]
    return finding(
        f"mean-above-peak-{table.lower()}",
        least > 1,
        row=last.label,
        rows=len(ratios),
        energy=last.energy.text,
        peak=last.peak.text,
        frequency_Hz=last.hertz,
        mean_mW=last.energy.value * last.hertz * 1e3,
        row_ratio=ratios[-1],
        mean_over_peak=span(ratios),
        least_with_rounding=least,
    )


def electrical_mean_above_peak() -> Finding:
    """Mean above peak in Table II."""
    return _above_peak("II")


def mechanical_mean_above_peak() -> Finding:
    """Mean above peak in Table IV."""
    return _above_peak("IV")


def sums_over_a_record() -> Finding:
    """Both tables of sines are sums over about ten seconds."""
    # A sinusoidal v and i: mean power is half the peak. The energy is then the mean times the length of the record.
    lengths = np.array([2 * row.energy.value / row.peak.value for row in rows("II")])
    weights = np.array([1 / (row.peak.relative**2 + row.energy.relative**2) for row in rows("II")])
    length = float(np.average(lengths, weights=weights))
    exponent = _exponent_of_frequency("IV")
    difference = max(abs(row.energy.value / _gross(row) - 1) for row in rows("IV") if row.force == 1000.0)
    cycles = {row.hertz: row.energy.value / (RECORD * row.hertz) for row in rows("II") if row.force == 1000.0}
    return finding(
        "sums-over-a-record",
        8 < length < 12 and abs(exponent - 1) < 0.05 and np.ptp(np.log(lengths)) < 0.5 and difference < 0.1,
        record_s=RECORD,
        seconds=span(lengths),
        mean_s=length,
        exponent_of_frequency=exponent,
        largest_difference=difference,
        first_cycle_uJ=cycles[1.0] * 1e6,
        last_cycle_uJ=cycles[5.0] * 1e6,
    )


def _exponent_of_frequency(table: str) -> float:
    """Exponent of the energy over the frequency, mean over the forces."""
    slopes = []
    for force in _LEVELS:
        chosen = [row for row in rows(table) if row.force == force]
        frequency, energy = np.log([[row.hertz, row.energy.value] for row in chosen]).T
        slopes.append(np.polyfit(frequency, energy, 1)[0])
    return mean(slopes)


def _gross(row: Row) -> float:
    """Integral of |F x'| (J) over a record with x = F/k of Table V: twice the work of one rise, for each cycle."""
    low, high = experiment()["offset_N"], row.force
    return (high**2 - low**2) / table_value("k") * RECORD * row.hertz


def mechanical_energy_is_gross() -> Finding:
    """Mechanical power by magnitude rather than net."""
    printed = [row.energy.value / RECORD / row.peak.value for row in rows("IV")]
    net, gross = zip(*(mean_over_peak_of_loop(force) for force in _LEVELS), strict=True)
    loss = max(row.energy.value / (RECORD * row.hertz) for row in rows("IV") if row.force == 1000.0)
    half = 0.5 * (1000.0 - experiment()["offset_N"])
    return finding(
        "mechanical-energy-is-gross",
        min(printed) > max(net) and max(printed) < 1.05 * max(gross),
        record_s=RECORD,
        mean_over_peak=span(printed),
        largest_net=max(net),
        gross=span(gross),
        loss_mJ=loss * 1e3,
        loss_over_largest_loop=loss / (np.pi * half**2 / table_value("k")),
        longer_record=min(printed) / max(net),
    )


def mean_over_peak_of_loop(force: float) -> tuple[float, float]:
    """Largest mean over peak of F x' for any phase of a sinusoidal x, and the mean of |F x'| over peak in phase."""
    offset = experiment()["offset_N"]
    middle, half = 0.5 * (force + offset), 0.5 * (force - offset)
    angle = np.linspace(0, 2 * np.pi, 4001)
    phase = np.linspace(0, np.pi / 2, 181)[:, None]
    power = (middle + half * np.sin(angle)) * np.cos(angle - phase)
    whole = np.trapezoid(power, angle, axis=1) / (2 * np.pi)
    gross = np.trapezoid(np.abs(power[0]), angle) / (2 * np.pi)
    return float(np.max(whole / power.max(axis=1))), float(gross / power[0].max())


def steps_against_time_constant() -> Finding:
    """Energy over peak power of Table I against R C."""
    circuit, hold = table_circuit(), experiment()["hold_s"]
    seconds = np.array([row.energy.value / row.peak.value for row in rows("I")])
    loads = np.array([row.ohm + experiment()["shunt_ohm"] for row in rows("I")])
    constants = loads * circuit.capacitance
    rises = [_rise_for(circuit, load, wanted, hold) for load, wanted in zip(loads, seconds, strict=True)]
    then, printed = _voltage_ratios(circuit, rises, hold)
    return finding(
        "steps-against-time-constant",
        np.min(seconds / constants) > 2 and min(then) > max(printed) + 0.2,
        energy_over_peak_s=span(seconds),
        time_constant_s=span(constants),
        ratio=span(seconds / constants),
        rise_times_needed_s=span(rises),
        voltage_ratio_then=span(then),
        voltage_ratio_printed=span(printed),
        capacitance_needed_uF=span(1e6 * seconds / loads),
    )


def _rise_for(circuit: cf.Circuit, load: float, wanted: float, hold: float) -> float:
    """Rise time (s) that gives the wanted energy over peak power (s)."""

    def excess(rise: float) -> float:
        energy, peak = cf.step(circuit, np.ones(1), np.array([load]), rise, hold)
        return float(energy[0] / peak[0]) - wanted

    return float(brentq(excess, 1e-3, 0.99 * hold))  # pyright: ignore[reportArgumentType]


def _voltage_ratios(circuit: cf.Circuit, rises: list[float], hold: float) -> tuple[list[float], list[float]]:
    """Peak voltage on the largest over that on the smallest load, by force: with slow rises, and as printed."""
    then, printed = [], []
    for force in _LEVELS:
        chosen = [(row, rise) for row, rise in zip(rows("I"), rises, strict=True) if row.force == force]
        loads = np.array([chosen[0][0].ohm, chosen[-1][0].ohm])
        rise = 0.5 * (chosen[0][1] + chosen[-1][1])
        _, slow = cf.step(circuit, np.ones(2), loads, rise, hold)
        measured = np.array([chosen[0][0].peak.value, chosen[-1][0].peak.value])
        for peaks, ratios in ((slow, then), (measured, printed)):
            ratios.append(float(np.sqrt(peaks[1] * loads[1] / (peaks[0] * loads[0]))))
    return then, printed


def steps_against_stroke() -> Finding:
    """The path that Table III's energies need."""
    # |F x'| over load and release is twice the work F x / 2 of a linear specimen: E/F is the stroke.
    strokes = np.array([row.energy.value / row.force for row in rows("III")])
    ratio = strokes * table_value("k") / np.array([row.force for row in rows("III")])
    sines = {f: mean(r.energy.value / (RECORD * r.hertz) for r in rows("IV") if r.force == f) for f in _LEVELS}
    cycles = span(row.energy.value / sines[row.force] for row in rows("III"))
    return finding(
        "steps-against-stroke",
        cycles[0] > 5 and ratio.min() > 5,
        cycles=cycles,
        stroke_um=span(1e6 * strokes),
        stroke_over_table_v=span(ratio),
        sine_cycle_mJ=span(1e3 * energy for energy in sines.values()),
        energy_over_peak_s=span(row.energy.value / row.peak.value for row in rows("III")),
        printed_mJ=span(1e3 * row.energy.value for row in rows("III")),
    )


def step_peak_is_the_machines() -> Finding:
    """Table III's peak powers follow from how fast the force rises."""
    row = next(row for row in rows("III") if row.force == 1000.0)
    rises = [0.0, 0.03, 0.06, 0.12]
    peaks = [simulated(Bench(transducer("stop"), rise), row).peak for rise in rises]
    return finding(
        "step-peak-is-the-machines",
        max(peaks) > 5 * min(peaks),
        row=row.label,
        printed=row.peak.text,
        rise_ms=[1e3 * rise for rise in rises],
        peak_mW=[1e3 * peak for peak in peaks],
        cutoff_Hz=experiment()["filter_cutoff_Hz"],
    )
