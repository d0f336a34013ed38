"""Headers, units, labels and digits."""

from __future__ import annotations

import numpy as np

from reports.paper.audit.finding import Finding, finding, span
from reports.paper.model import table_value
from reports.paper.tables import UNITS, experiment, paper, parameters, rows


def header_of_table_iii() -> Finding:
    """Table III is headed as electrical, and is mechanical."""
    headers = {name: table["headers"] for name, table in paper()["tables"].items()}
    pairs = list(zip(rows("I"), rows("III"), strict=True))
    energy = span(b.energy.value / a.energy.value for a, b in pairs)
    peak = span(b.peak.value / a.peak.value for a, b in pairs)
    supported = headers["III"] == headers["I"] and energy[0] > 5 and peak[0] > 5
    return finding("header-table-iii", supported, energy_ratio=energy, peak_ratio=peak)


def units_of_stiffness_and_coupling() -> Finding:
    """Stiffness in Ns/m, coupling without a unit."""
    force, metre, volt, charge = (UNITS(name).dimensionality for name in ("N", "m", "V", "C"))
    misprinted = parameters()["k"].printed_unit == parameters()["b"].printed_unit
    wrong = UNITS("N*s/m").dimensionality != force / metre
    resonance = np.sqrt(table_value("k") / table_value("m")) / (2 * np.pi)
    return finding(
        "units-k-and-t", misprinted and wrong and force / volt == charge / metre, resonance_kHz=float(resonance) / 1e3
    )


def units_of_hysteresis() -> Finding:
    """Thresholds in uF, slopes in V/uF: two readings."""
    charge, volt = UNITS("C").dimensionality, UNITS("V").dimensionality
    printed = (UNITS("uF").dimensionality, UNITS("V/uF").dimensionality)
    r = np.array([float(parameters()[f"r_{n}"].printed.text) for n in (1, 2, 3)])
    w = np.array([float(parameters()[f"w_{n}"].printed.text) for n in (1, 2, 3)])
    slope, capacitance = float(w.sum()), table_value("C")
    return finding(
        "units-of-hysteresis",
        printed not in ((charge, volt / charge), (volt, charge / volt)),
        saturation_V=float(w @ r),
        smallest=float(r[0]),
        largest=float(r[-1]),
        slope=slope,
        slope_over_capacitor=1e6 * slope * capacitance,
        series_uF=1e6 / (1 / capacitance + 1e6 / slope),
    )


def labels_and_levels() -> Finding:
    """Force levels that are named twice or not at all."""
    forces = experiment()["sine_forces_N"]
    twice = sorted({f for f in forces if forces.count(f) > 1})
    tabled = {row.force for table in ("I", "II", "III", "IV") for row in rows(table)}
    missing = sorted(set(forces) - tabled)

    def words(values: list[float]) -> str:
        return ", ".join(f"{value / 1e3:.2f}" for value in values)

    return finding(
        "labels-and-levels",
        bool(twice) and bool(missing),
        listed=words(forces),
        named_twice=words(twice),
        not_tabled=words(missing),
    )


def digits_of_table_ii() -> Finding:
    """Peak powers with one or two digits."""
    relative = [row.peak.half / row.peak.value for row in rows("II")]
    worst = rows("II")[int(np.argmax(relative))]
    return finding(
        "digits-of-table-ii",
        max(relative) > 0.05,
        row=worst.label,
        peak=worst.peak.text,
        half_digit_mW=worst.peak.half * 1e3,
        largest=max(relative),
        median=float(np.median(relative)),
        table_i=max(row.peak.half / row.peak.value for row in rows("I")),
    )
