"""The command `check`: a campaign is read and its records are checked, without a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from piezoharvest.cli import tables
from piezoharvest.cli.notes import note

if TYPE_CHECKING:
    from piezoharvest.records import Campaign
    from piezoharvest.records.record import FrequencyRecord, Record, Signal


def check(path: Path, *, as_json: bool) -> int:
    """Print what a campaign's records are taken for; 1 if there are warnings."""
    from piezoharvest.records.specimens import SpecimenSet, load

    found = load(path)
    for finding in found.warnings:
        note(f"warning: {finding}")
    campaigns = found.campaigns if isinstance(found, SpecimenSet) else (found,)
    if as_json:
        specimens = [{"title": one.title, "records": [_table(record) for record in one.records]} for one in campaigns]
        warnings = [asdict(finding) for finding in found.warnings]
        tables.print_json({"title": found.title, "specimens": specimens, "warnings": warnings})
    else:
        header = ("record", "role", "drive", "load", "samples", "contents")
        for campaign in campaigns:
            tables.print_rows(campaign.title, header, _rows(campaign))
    return 1 if found.warnings else 0


def _table(record: Record | FrequencyRecord) -> dict[str, Any]:
    """A record as a table of the JSON output: values of the load, ranges, sigma and gains in SI units."""
    from piezoharvest.design.result import shunt_table

    return {
        "file": record.name,
        "role": record.role,
        "drive": _drive(record),
        "shunt": None if record.shunt is None else record.shunt.kind,
        "load": None if record.shunt is None else shunt_table(record.shunt),
        "samples": len(record),
        "sample_rate": getattr(record, "sample_rate", None),
        "ranges": {name: [float(values.min()), float(values.max())] for name, values, _ in _contents(record)},
        "channels": {name: {"sigma": each.sigma, "gain": each.gain} for name, each in _signals(record).items()},
    }


def _drive(record: Record | FrequencyRecord) -> str:
    from piezoharvest.records.record import Record

    return record.drive if isinstance(record, Record) else record.kind


def _load(record: Record | FrequencyRecord) -> str:
    """Kind and values of the load, in lines."""
    from piezoharvest.report.subjects import values_of

    if record.shunt is None:
        return "none"
    return "\n".join((record.shunt.kind, *(f"{name} {text}" for name, text in values_of(record.shunt))))


def _signals(record: Record | FrequencyRecord) -> Mapping[str, Signal]:
    """Channels of a record over time."""
    from piezoharvest.records.record import Record

    return record.signals if isinstance(record, Record) else {}


def _scaling(signal: Signal | None, unit: str) -> str:
    """What the campaign states of a channel, behind its range."""
    from piezoharvest.report.units import engineering

    if signal is None:
        return ""
    sigma = "" if signal.sigma is None else f", sigma {engineering(signal.sigma, unit)}"
    gain = "" if signal.gain is None else f", gain {engineering(signal.gain, unit)} per raw unit"
    return sigma + gain


def _contents(record: Record | FrequencyRecord) -> list[tuple[str, np.ndarray, str]]:
    """What a record contains, as names, values and units: its channels, or frequency and the response's size."""
    from piezoharvest.records.record import Record
    from piezoharvest.report.units import response_unit

    if isinstance(record, Record):
        return [(name, record[name], response_unit(name)) for name in record.signals]
    unit = response_unit(f"{record.output}/{record.input}")
    return [("frequency", record.frequency, "Hz"), ("magnitude", np.abs(record.response), unit)]


def _rows(campaign: Campaign) -> list[Sequence[str]]:
    """Rows of the table: a record's name, and what it is taken for."""
    from piezoharvest.records.record import Record
    from piezoharvest.report.units import engineering

    def contents(record: Record | FrequencyRecord) -> str:
        lines = [
            f"{name} {engineering(float(values.min()), unit)} to {engineering(float(values.max()), unit)}"
            + _scaling(_signals(record).get(name), unit)
            for name, values, unit in _contents(record)
        ]
        if isinstance(record, Record):
            lines.insert(0, f"{engineering(record.duration, 's')} at {engineering(record.sample_rate, 'Hz')}")
        return "\n".join(lines)

    return [
        (record.name, record.role, _drive(record), _load(record), str(len(record)), contents(record))
        for record in campaign.records
    ]
