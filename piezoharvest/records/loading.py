"""Reading a campaign: its file, all its records, and the findings of their checks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.transducer import INERT, Transducer
from piezoharvest.readers.base import MAX_NUMBERS
from piezoharvest.records.bench_limits import BenchLimits
from piezoharvest.records.campaign import Campaign
from piezoharvest.records.checks import check
from piezoharvest.records.errors import CampaignError
from piezoharvest.records.finding import Finding, counted
from piezoharvest.records.reading.entries import (
    FrfEntry,
    TimeEntry,
    build_entry,
    build_sources,
    default_sources,
    response_units,
)
from piezoharvest.records.reading.frequency_record import read_frequency_record
from piezoharvest.records.reading.time_record import read_record
from piezoharvest.records.record import FrequencyRecord, Record
from piezoharvest.study import StudyError, build, build_transducer, read_toml

_TABLES = ("title", "transducer", "channels", "records", "experiment")
UNKNOWN = "unknown"  # mass or damping of a specimen whose inertia and damping are negligible
PLACEHOLDER = 1.0  # placeholder for the mass and damping of a quasi-static specimen; it has no effect


def load_campaign(path: str | Path) -> Campaign:
    """Read a campaign with all its records, and check them.

    Parameters
    ----------
    path : str or Path
        TOML file as in section 4 of the interface; data files are relative to it.

    Returns
    -------
    Campaign
        Its findings are warnings.

    Raises
    ------
    CampaignError
        The file or a data file cannot be read, or a check found an error: the message is that of the first, all are in
        the error's `campaign`, whose records can still be plotted.

    Notes
    -----
    In addition to the keys of the interface, a file may have

    - `[channels]`: `time` (column and unit) beside the measured channels; `column` as a number counted from 1, as an
      index into an array such as "data[:, 2]", or as a list of columns that are averaged; `file` if a channel is
      in a separate file. `sigma`, like `gain` and `offset`, is in the channel's unit.
      Without `unit` and `gain` the values are in the unit that the file states for the column, in brackets, in a row
      of units or at the end of the name, or else in the SI unit. A file that states another unit than the campaign is
      an error; `gain` overrules the file.
    - `[records.channels]`: the same for one record.
    - `rows = [first, last]`: the part of a file that is the record, in rows as findings count them (lines of a text
      file). Other rows are ignored.
    - text tables (.txt, .dat, .tsv) and single arrays (.npy) as data files. The table of a text file is the first run
      of rows of equal width that are numbers, with the names in the row above it and units below the names.
    - `skip_rows = n`: lines of a text file to skip; `header_row = n`: the line with the names, from
      1, with the table below it.
    - `kind = "frf"`: `input` (default force), `output` and a load; columns frequency_Hz, real and imaginary, or
      magnitude and phase_rad or phase_deg, or a complex response, and coherence; or others by `[records.channels]`.
    - `quasi_static = true` in `[transducer]`, or `mass = "unknown"` or `damping = "unknown"`: for a specimen that
      follows its drive without delay, whose mass and damping may be left out.
    - `kind = "periodic"`: signals over time that are a few periods of a sine in steady state; `frequency` (Hz) where it
      is known, else it is found in the drive.
    - `[experiment]`: what the bench can do in a planned record (`BenchLimits`).
    - `kind = "impedance"`: `mechanical` ("free" or "blocked"); columns frequency_Hz, resistance_ohm and reactance_ohm,
      or impedance_ohm and phase_rad or phase_deg. Sweeps may go up or down and overlap; a line at 0 Hz is left out.
    """
    path = Path(path)
    campaign = _read(path)
    errors = campaign.errors
    if errors:
        first = errors[0]
        more = f" (and {counted(len(errors) - 1, 'more error')})" if len(errors) > 1 else ""
        where = {"channel": first.channel, "rows": first.rows, "campaign": campaign}
        raise CampaignError(path.parent / first.file, "", first.message + more, **where)
    return campaign


def _read(path: Path) -> Campaign:
    try:
        table = read_toml(path)
        with np.errstate(all="ignore"):  # values that are or become NaN are found by the checks
            return _campaign(table, path)
    except ParameterError as error:
        raise CampaignError(path, error.key, error.message) from None
    except CampaignError:
        raise
    except StudyError as error:
        raise CampaignError(error.path, error.key, error.message) from None


def _campaign(table: Mapping[str, Any], path: Path) -> Campaign:
    """Campaign from the tables of its file; raises `ParameterError` and `CampaignError`."""
    for key in table:
        if key not in _TABLES:
            raise ParameterError(key, f"unknown key, known keys are {', '.join(_TABLES)}")
    title = table.get("title", path.stem)
    if not isinstance(title, str):
        raise ParameterError("title", f"found {repr(title)[:80]}, allowed is a string")
    if "transducer" not in table:
        raise ParameterError("transducer", "missing table [transducer]")
    transducer, unknown = _nominal(table["transducer"])
    sources = {**default_sources(), **build_sources(table.get("channels", {}), "campaign", "channels")}
    entries = table.get("records")
    if not isinstance(entries, list) or not entries:
        found = "missing" if entries is None else f"found {repr(entries)[:60]}"
        raise ParameterError("records", f"{found}, at least one table [[records]] is needed")
    read = list(_entries(entries, sources, path))
    records = tuple(record for record, _ in read)
    fitted = dict.fromkeys(value for record in records if isinstance(record, Record) for value in record.fitted)
    transducer = replace(transducer, effects=(*transducer.effects, *fitted))
    # A channel may be missing in some records; one that [channels] names and no record has may be misspelt.
    measured = {channel for record in records if isinstance(record, Record) for channel in record.signals}
    absent = [[f for f in some if f.check != "missing column" or f.channel not in measured] for _, some in read]
    found = (tuple((*some, *_checked(record, transducer))) for record, some in zip(records, absent, strict=True))
    limits = build(BenchLimits, table.get("experiment", {}), "experiment")
    campaign = Campaign(title, path, transducer, records, tuple(found), unknown, limits)
    if "mass" in unknown and campaign.drives_base:
        raise ParameterError("transducer.mass", "missing key, records driven by a base acceleration need a number (kg)")
    return campaign


def _nominal(table: Any) -> tuple[Transducer, tuple[str, ...]]:
    """Transducer from its table, and its unknown parameters; an unknown mass is taken as negligible."""
    table = dict(table) if isinstance(table, Mapping) else table
    unknown: tuple[str, ...] = ()
    if isinstance(table, dict):
        unknown = tuple(name for name in INERT if table.get(name) == UNKNOWN)
        if unknown or table.get("quasi_static") is True:
            unknown = tuple(name for name in INERT if name in unknown or not {name, "catalogue"} & set(table))
            table |= {"quasi_static": True, **dict.fromkeys(unknown, PLACEHOLDER)}
    transducer = build_transducer(table)
    if transducer.electrodes:
        found = f"found {len(transducer.electrodes)}, allowed is none: the records of a campaign are of one pair"
        raise ParameterError("transducer.electrodes", found)
    return transducer, unknown


def _checked(record: Record | FrequencyRecord, transducer: Transducer) -> tuple[Finding, ...]:
    """Findings of the checks of a record."""
    if transducer.quasi_static:
        rate = record.frequency.max() if isinstance(record, FrequencyRecord) else record.sample_rate
        transducer = transducer.settled(1.0 / float(rate))
    return check(record, transducer)


def _entries(entries: list, sources: Mapping, path: Path) -> Iterator[tuple[Record | FrequencyRecord, list[Finding]]]:
    """Read all records; they are in memory at the same time."""
    count = 0
    for n, entry in enumerate(entries):
        record, found = _read_entry(entry, f"records.{n}", sources, path.parent)
        count += len(record) * (1 + len(record.signals) if isinstance(record, Record) else 4)
        if count > MAX_NUMBERS:
            raise ParameterError(
                f"records.{n}", f"found {count} numbers in the records up to this one, allowed are {MAX_NUMBERS} in all"
            )
        yield record, found


def _read_entry(table: Any, key: str, sources: Mapping, folder: Path) -> tuple[Record | FrequencyRecord, list[Finding]]:
    """Read the record of one entry of [[records]]."""
    entry = build_entry(table, key)
    own = entry.channels or {}
    if isinstance(entry, TimeEntry):
        shunt = entry.across(key, entry.drive == "voltage")
        sources = {**sources, **build_sources(own, "record", f"{key}.channels")}
        return read_record(entry, key, sources, shunt, folder)
    shunt = entry.across(key, entry.input == "voltage") if isinstance(entry, FrfEntry) else None
    if isinstance(entry, FrfEntry) and entry.fitted(shunt, key):
        message = "found fit for a frequency response, allowed is fit in records over time"
        raise ParameterError(f"{key}.shunt.fit", message)
    sources = build_sources(own, "record", f"{key}.channels", response_units(entry))
    return read_frequency_record(entry, key, sources, shunt, folder)
