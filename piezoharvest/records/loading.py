"""Reading a campaign: its file or tables and arrays, all its records, and the findings of their checks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.description.modes_file import check_base
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.transducer import INERT, Transducer
from piezoharvest.readers import Reader
from piezoharvest.readers.base import MAX_NUMBERS
from piezoharvest.records import campaign as plain
from piezoharvest.records.bench_limits import BenchLimits
from piezoharvest.records.checks import check, overlaps
from piezoharvest.records.errors import CampaignError
from piezoharvest.records.finding import Finding
from piezoharvest.records.reading.entries import (
    FrfEntry,
    TimeEntry,
    build_entry,
    build_sources,
    default_sources,
    response_units,
)
from piezoharvest.records.reading.frequency_record import read_frequency_record
from piezoharvest.records.reading.in_memory import in_memory
from piezoharvest.records.reading.time_record import read_record
from piezoharvest.records.record import FrequencyRecord, Record
from piezoharvest.study import StudyError, build, build_transducer, check_kind_of_file, read_toml, transducer_table
from piezoharvest.study import unknown as unknown_name
from piezoharvest.study.words import typed

_TABLES = ("title", "transducer", "channels", "records", "experiment")
_SOURCES = ("catalogue", "modal", "datasheet")  # keys of [transducer] that give mass and damping, too
UNKNOWN = "unknown"  # mass or damping of a specimen whose inertia and damping are negligible
PLACEHOLDER = 1.0  # placeholder for the mass and damping of a quasi-static specimen; it has no effect


class Campaign(plain.Campaign):
    """Measured records of one specimen, from a file (`load_campaign`) or from arrays.

    Attributes are those of `piezoharvest.records.campaign.Campaign`: title, path, transducer, records, findings,
    unknown, limits.
    """

    @classmethod
    def from_arrays(
        cls,
        transducer: Transducer | Mapping[str, Any],
        records: Sequence[Mapping[str, Any]],
        *,
        channels: Mapping[str, Any] | None = None,
        title: str = "campaign",
    ) -> Campaign:
        """Campaign from arrays of NumPy or DataFrames, through the same checks as one from files.

        Parameters
        ----------
        transducer : Transducer or mapping
            Nominal values: an object, or the table [transducer] of a campaign file.
        records : sequence of mappings
            Each as a table of [[records]], with `data` instead of `file`: a mapping of column names to arrays
            (n,), or a DataFrame. `name` stands for it in messages; default "record 1" and so on. `shunt` may be an
            object.
        channels : mapping, optional
            As the table [channels]: `{"force": {"column": "F", "unit": "kN"}}`; default columns are `force_N`, ...
        title : str

        Raises
        ------
        CampaignError
            As from a file; it names the record, the channel, and rows counted from 1.

        Examples
        --------
        >>> import numpy as np
        >>> from piezoharvest import Campaign, Resistor, Transducer
        >>> t = np.arange(400) / 1000
        >>> force = 0.02 * np.sin(2 * np.pi * 31.0 * t)
        >>> nominal = Transducer(mass=0.01, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
        >>> data = {"force_N": force, "displacement_m": force / 600.0}
        >>> records = [{"data": data, "sample_rate": 1000.0, "shunt": Resistor(resistance=1e5)}]
        >>> Campaign.from_arrays(nominal, records).records[0].responses
        ('displacement',)
        """
        path = Path(str(title))
        tables, data = in_memory(records, path)
        sources = dict(channels) if isinstance(channels, Mapping) else channels or {}
        whole = {"title": title, "transducer": transducer, "channels": sources, "records": tables}
        with reading(path):
            campaign = campaign_of(whole, path, data=data)
        return checked(campaign)

    @classmethod
    def from_frame(cls, frame: Any, transducer: Transducer | Mapping[str, Any], **record: Any) -> Campaign:
        """Campaign of one record from a DataFrame; keywords are keys of [[records]], and `channels` as in a record.

        >>> import pandas as pd                                                                      # doctest: +SKIP
        >>> Campaign.from_frame(pd.read_csv("run.csv"), nominal, load_resistance=1e5)                # doctest: +SKIP
        """
        return cls.from_arrays(transducer, [{"data": frame, **record}])


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
      Without `unit` and `gain` that is the unit that the file states for the column, in brackets, in a row of units or
      at the end of the name, or else the SI unit. A file that states another unit than the campaign is
      an error; `gain` overrules the file.
    - `[records.channels]`: the same for one record.
    - `rows = [first, last]`: the part of a file that is the record, in rows as findings count them (lines of a text
      file). Other rows are ignored.
    - text tables (.txt, .dat, .tsv, .lvm) and single arrays (.npy) as data files, see `docs/data-files.md`.
      The table of a text file is the first run of rows of equal width that are numbers, with the names in the row above
      it and units below the names.
    - `skip_rows = n`: lines of a text file to skip; `header_row = n`: the line with the names, from
      1, with the table below it.
    - `kind = "frf"`: `input` (default force), `output` and a load; columns frequency_Hz, real and imaginary, or
      magnitude and phase_rad or phase_deg, or a complex response, and coherence; or others by `[records.channels]`.
      The output may be the displacement (receptance), velocity (mobility) or acceleration (accelerance), relative to
      the base. A magnitude may be a level, by its unit "dB" (0 dB is the SI unit) or "dB re um/N".
    - `quasi_static = true` in `[transducer]`, or `mass = "unknown"` or `damping = "unknown"`: for a specimen that
      follows its drive without delay, whose mass and damping may be left out.
    - `kind = "periodic"`: signals over time that are a few periods of a sine in steady state; `frequency` (Hz) where it
      is known, else it is found in the drive.
    - `[experiment]`: what the bench can do in a planned record (`BenchLimits`).
    - `kind = "impedance"`: `mechanical` ("free" or "blocked"); columns frequency_Hz, resistance_ohm and reactance_ohm,
      or impedance_ohm and phase_rad or phase_deg. Sweeps may go up or down and overlap; a line at 0 Hz is left out.
    """
    path = Path(path)
    with reading(path):
        campaign = campaign_of(read_toml(path), path)
    return checked(campaign)


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn whatever is wrong with a campaign's file into `CampaignError`."""
    try:
        with np.errstate(all="ignore"):  # values that are or become NaN are found by the checks
            yield
    except ParameterError as error:
        raise CampaignError(path, error.key, error.message) from None
    except CampaignError:
        raise
    except StudyError as error:
        raise CampaignError(error.path, error.key, error.message) from None


def checked(campaign: Campaign) -> Campaign:
    """The campaign; raises `CampaignError` where a check found an error."""
    errors = campaign.errors
    if errors:
        first = errors[0]
        more = f" (and {counted(len(errors) - 1, 'more error')})" if len(errors) > 1 else ""
        where = {"channel": first.channel, "rows": first.rows, "campaign": campaign}
        raise CampaignError(campaign.path.parent / first.file, "", first.message + more, **where)
    return campaign


def campaign_of(
    table: Mapping[str, Any], path: Path, where: str = "", before: int = 0, data: Sequence[Reader] = ()
) -> Campaign:
    """Campaign from the tables of its file, with the findings of the checks.

    Parameters
    ----------
    table : mapping
    path : Path
        The file.
    where : str
        Prefix of the keys of its own tables: "specimens.0." for one of several specimens.
    before : int
        Numbers in the records of other specimens of the file, which are in memory at the same time.
    data : sequence of Reader
        Where each record is read from; without them from its file.

    Raises
    ------
    ParameterError, CampaignError
        Something in the tables, or a data file, is wrong.
    """
    if "specimens" in table:
        raise ParameterError("specimens", "found several specimens, which only identify and diagnose accept")
    check_kind_of_file(table, "campaign")
    for key in table:
        if key not in _TABLES:
            raise unknown_name(key, key, _TABLES, "key")
    title = table.get("title", path.stem)
    if not isinstance(title, str):
        raise ParameterError("title", f"found {repr(title)[:80]}, must be a string")
    if "transducer" not in table:
        raise ParameterError("transducer", "missing table [transducer]")
    transducer, unknown = _nominal(table["transducer"], path.parent)
    sources = {**default_sources(), **build_sources(table.get("channels", {}), "campaign", "channels")}
    entries = table.get("records")
    if entries is None or entries == []:
        found = "missing" if entries is None else "found []"
        table_name = f"[[{where and 'specimens.'}records]]"
        raise ParameterError(f"{where}records", f"{found}, at least one table {table_name} is needed")
    typed(list, entries, f"{where}records")
    read = list(_entries(entries, f"{where}records", sources, path, before, data))
    records = tuple(record for record, _ in read)
    fitted = dict.fromkeys(value for record in records if isinstance(record, Record) for value in record.fitted)
    transducer = replace(transducer, effects=(*transducer.effects, *fitted))
    # A channel may be missing in some records; one that [channels] names and no record has may be misspelt.
    measured = {channel for record in records if isinstance(record, Record) for channel in record.signals}
    absent = [[f for f in some if f.check != "missing column" or f.channel not in measured] for _, some in read]
    late = overlaps(records)
    found = (
        tuple((*some, *_checked(record, transducer), *(f for at, f in late if at is record)))
        for record, some in zip(records, absent, strict=True)
    )
    limits = build(BenchLimits, table.get("experiment", {}), "experiment")
    campaign = Campaign(title, path, transducer, records, tuple(found), unknown, limits)
    if "mass" in unknown and campaign.drives_base:
        raise ParameterError("transducer.mass", "missing key, records driven by a base acceleration need a number (kg)")
    if campaign.drives_base:
        try:
            check_base(table["transducer"], transducer.effective_mass, "a record driven by a base acceleration")
        except ParameterError as error:
            raise error.within("transducer") from None
    return campaign


def _nominal(table: Any, folder: Path) -> tuple[Transducer, tuple[str, ...]]:
    """Transducer from its table or file, and its unknown parameters; an unknown mass is taken as negligible."""
    table = transducer_table(dict(table) if isinstance(table, Mapping) else table, folder)
    unknown: tuple[str, ...] = ()
    if isinstance(table, dict):
        table = dict(table)
        unknown = tuple(name for name in INERT if table.get(name) == UNKNOWN)
        if unknown or table.get("quasi_static") is True:
            unknown = tuple(name for name in INERT if name in unknown or not {name, *_SOURCES} & set(table))
            table |= {"quasi_static": True, **dict.fromkeys(unknown, PLACEHOLDER)}
    made = isinstance(table, Transducer)  # of a campaign that is made in Python
    transducer = table if made else build_transducer(table)
    if transducer.electrodes:
        found = "found further electrodes, but the records of a campaign are for one pair"
        raise ParameterError("transducer.electrodes", found)
    return transducer, unknown


def _checked(record: Record | FrequencyRecord, transducer: Transducer) -> tuple[Finding, ...]:
    """Findings of the checks of a record."""
    if transducer.quasi_static:
        rate = record.frequency.max() if isinstance(record, FrequencyRecord) else record.sample_rate
        transducer = transducer.settled(1.0 / float(rate))
    return check(record, transducer)


def _entries(
    entries: list, where: str, sources: Mapping, path: Path, count: int, data: Sequence[Reader]
) -> Iterator[tuple[Record | FrequencyRecord, list[Finding]]]:
    """Read all records; they are in memory at the same time, with `count` numbers of others."""
    for n, entry in enumerate(entries):
        record, found = _read_entry(entry, f"{where}.{n}", sources, path.parent, data[n] if data else None)
        count += record.numbers
        if count > MAX_NUMBERS:
            raise ParameterError(
                f"{where}.{n}", f"found {count} numbers in the records up to this one, allowed are {MAX_NUMBERS} in all"
            )
        yield record, found


def _read_entry(
    table: Any, key: str, sources: Mapping, folder: Path, data: Reader | None
) -> tuple[Record | FrequencyRecord, list[Finding]]:
    """Read the record of one entry of [[records]]."""
    entry = build_entry(table, key)
    own = entry.channels or {}
    if isinstance(entry, TimeEntry):
        shunt = entry.across(key, entry.drive == "voltage")
        sources = {**sources, **build_sources(own, "record", f"{key}.channels")}
        return read_record(entry, key, sources, shunt, folder, data)
    shunt = entry.across(key, entry.input == "voltage") if isinstance(entry, FrfEntry) else None
    if isinstance(entry, FrfEntry) and entry.fitted(shunt, key):
        message = "found fit for a frequency response, but only time records can have it"
        raise ParameterError(f"{key}.shunt.fit", message)
    sources = build_sources(own, "record", f"{key}.channels", response_units(entry))
    return read_frequency_record(entry, key, sources, shunt, folder, data)
