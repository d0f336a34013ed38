"""Rows and findings as files that programs read."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

import numpy as np

from reports.paper import reproduction
from reports.paper.audit.finding import Finding
from reports.paper.reproduction import READINGS, Compared
from reports.paper.tables import experiment, paper

_COLUMNS = (
    "table", "force_N", "load_ohm", "frequency_Hz",
    "printed_energy_J", "energy_half_digit_J", "printed_peak_W", "peak_half_digit_W", "model",
    "electrical_J", "electrical_peak_W", "mechanical_net_J", "mechanical_gross_J", "mechanical_peak_W", "converged",
)  # fmt: skip


def findings_json(findings: dict[str, list[Finding]]) -> str:
    """All findings as JSON: part, claim, evidence, confidence and the rest of `Finding`."""
    flat = [{"part": part, **asdict(finding)} for part, group in findings.items() for finding in group]
    content = {"paper": paper()["title"], "findings": _plain(flat)}
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    """Numbers as JSON has them: NumPy's as Python's, six digits, null for what is not finite."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, bool | str) or value is None:
        return value
    return float(f"{float(value):.6g}") if np.isfinite(value) else None


def rows_csv() -> str:
    """Every row, load of the sines and reading of the hysteresis, simulated: SI units, energies of one cycle."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for name, results in _all_simulations():
        for c in results:
            row, cycle = c.row, c.simulated.cycle
            printed = (row.energy.value, row.energy.half, row.peak.value, row.peak.half)
            head = (row.table, row.force, c.simulated.load, row.frequency or "")
            numbers = ([f"{value:.6g}" for value in group] for group in (printed, cycle))
            writer.writerow((*head, *next(numbers), name, *next(numbers), c.simulated.converged))
    return stream.getvalue()


def _all_simulations() -> Iterable[tuple[str, list[Compared]]]:
    """Table V in all readings, sines on all loads (steps once), and the extended model."""
    for reading in READINGS:
        for load in range(len(experiment()["loads_ohm"])):
            results = reproduction.per_cycle(reading, load)
            yield f"Table V, {reading}", [c for c in results if load == 0 or c.row.load is None]
    yield "extended", list(reproduction.extended())
