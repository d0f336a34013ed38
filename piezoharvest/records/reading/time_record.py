"""Reading of a record over time from its entry: open files, find and read columns, convert to SI units."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import combinations
from pathlib import Path
from types import MappingProxyType

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.description.shunts import Resistor, Shunt
from piezoharvest.readers import MissingColumnError, Reader, ReadError
from piezoharvest.readers.base import cut, last_part, named_time, shown
from piezoharvest.readers.units import stated_unit
from piezoharvest.records.errors import CampaignError
from piezoharvest.records.finding import Finding
from piezoharvest.records.reading.channels import ALSO, COLUMNS, UNITS, ChannelSource
from piezoharvest.records.reading.entries import PeriodicEntry, Sources, TimeEntry
from piezoharvest.records.reading.files import Files
from piezoharvest.records.reading.in_memory import InMemory
from piezoharvest.records.reading.time_stamps import even_times
from piezoharvest.records.record import Record, Signal

_RATE_TOLERANCE = 1e-3  # relative, between the time stamps and a given sample rate


class TimeRecordReader:
    """Reader of one record over time.

    Parameters
    ----------
    entry : TimeEntry
    sources : mapping of str to (ChannelSource, level)
        By channel; a column may be missing unless the record itself names it or it is the drive. If [channels] names
        it, its absence is added to `findings`.
    shunt : Shunt or None
    files : Files

    Raises
    ------
    CampaignError
        A column is missing, not numeric or of another length.
    """

    def __init__(self, entry: TimeEntry, sources: Sources, shunt: Shunt | None, files: Files):
        self.entry, self.sources, self.shunt, self.files = entry, sources, shunt, files
        self.findings: list[Finding] = []
        self.columns: dict[str, list[str]] = {}
        for channel in UNITS:
            if channel in sources:
                self._find(channel)
        if len(self.columns.keys() - {"time"}) < 2:
            reader = files.reader(entry.file)
            found = f"(the {reader.part}s are {shown(reader.names)}){self._naming('voltage', reader)}"
            message = f"no channel other than the drive was found, at least one is needed {found}"
            raise CampaignError(files.folder / entry.file, "", message)
        self.findings += self._overlooked()
        self.values = self._read()

    def file(self, channel: str) -> str:
        """File with the data of a channel."""
        return self.sources[channel][0].file or self.entry.file

    def error(self, channel: str, message: str) -> CampaignError:
        """Error that concerns a channel."""
        return CampaignError(self.files.folder / self.file(channel), channel, message, channel=channel)

    def _find(self, channel: str) -> None:
        """Find the columns of a channel, or add a finding that it is missing."""
        source, level = self.sources[channel]
        name = self.file(channel)
        reader = self.files.reader(name)
        try:
            default = self._default(channel, reader)
            usual = level == "default" or source.column is None
            self.columns[channel] = list(map(reader.resolve, (default,) if usual else source.columns(default)))
        except MissingColumnError as error:
            drive = channel == self.entry.drive
            if level == "record" or drive or (channel == "time" and level == "campaign"):
                what = f"{channel}, the drive" if drive else channel
                message = error.message + ((self._other_drive() or self._naming(channel, reader)) if drive else "")
                raise CampaignError(self.files.folder / name, what, message, channel=channel) from None
            if channel == "time" and (known := named_time(reader)):
                self.columns[channel] = [known]
                if reader.unit(known) is None:
                    says = f"time = {{ column = {known!r} }} in [channels] says so"
                    message = f"column {known!r} is taken as the time in s, as no other is named; {says}"
                    self.findings.append(Finding("warning", "time unit", name, channel, (), message))
                return
            if level == "campaign":
                message = f"{error.message}; the record is used without this channel"
                self.findings.append(Finding("warning", "missing column", name, channel, (), message))
        except ReadError as error:
            raise self.files.error(name, channel, error) from None

    def _default(self, channel: str, reader: Reader) -> str:
        """Default column of a channel, in the spelling of its unit that the file has."""
        usual, other = COLUMNS[channel], ALSO.get(channel)
        names = {last_part(name) for name in reader.names}
        return other if other in names and usual not in names else usual

    def _naming(self, channel: str, reader: Reader) -> str:
        """How to name the column of a channel, if it was sought under its usual name only; else ""."""
        if self.sources[channel][1] != "default":
            return ""
        if isinstance(reader, InMemory):
            return f'; channels = {{"{channel}": {{"column": NAME}}}} names another key'
        return f"; {channel} = {{ column = NAME }} in [channels] names another {reader.part}"

    def _overlooked(self) -> Iterator[Finding]:
        """A warning for each column that is not used, but has the name of a channel that the record lacks.

        Such as "displacement_mm", where "displacement_m" is read unless [channels] gives another name; a column
        "voltage_ref" is another quantity.
        """
        reader, used = self.files.reader(self.entry.file), {name for some in self.columns.values() for name in some}
        for channel, (_, level) in self.sources.items():
            if channel == "time" or channel in self.columns or level != "default":
                continue
            near = [name for name in reader.names if name not in used and _is_named(last_part(name), channel)]
            if near:
                found = f"the {reader.part} {cut(near[0])!r} is not used, as {COLUMNS[channel]!r} is expected"
                message = found + self._naming(channel, reader)
                yield Finding("warning", "unused column", self.entry.file, channel, (), message)

    def _other_drive(self) -> str:
        """What a record without a force says if [channels] names the acceleration of its base; else ""."""
        named = {channel for channel, (_, level) in self.sources.items() if level != "default"}
        if self.entry.drive != "force" or "force" in named or "base_acceleration" not in named:
            return ""
        return '; where the base is what moves, the record needs drive = "base_acceleration"'

    def _read(self) -> dict[str, np.ndarray]:
        """Raw values by channel, file by file, all of one length."""
        values: dict[str, np.ndarray] = {}
        for name in dict.fromkeys(map(self.file, self.columns)):
            wanted = {channel: some for channel, some in self.columns.items() if self.file(channel) == name}
            values |= self.files.read(name, wanted)
        count = len(values[self.entry.drive])
        for channel, raw in values.items():
            if len(raw) != count:
                message = f"found {counted(len(raw), 'sample')}, but {count} in the drive, {self.entry.drive}"
                raise self.error(channel, message)
            if raw.dtype.kind == "c":
                raise self.error(channel, "found complex numbers, allowed are real numbers")
        if count < 2:
            raise self.error(self.entry.drive, f"found {counted(count, 'sample')}, allowed are two or more")
        self._differ(values)
        return values

    def _differ(self, values: Mapping[str, np.ndarray]) -> None:
        """Raise an error if two channels have equal samples: noise makes different sensors differ."""
        for one, other in combinations((channel for channel in values if channel != "time"), 2):
            ohm = {one, other} == {"voltage", "current"} and self.shunt == Resistor(resistance=1.0)
            if np.array_equal(values[one], values[other]) and np.ptp(values[one]) > 0 and not ohm:
                raise self.error(
                    other, f"its samples are the same as those of {one}, but each channel needs its own samples"
                )

    def signals(self) -> dict[str, Signal]:
        """All channels in SI units, "time" among them."""
        self._clock()
        return {channel: self._signal(channel) for channel in list(self.values)}

    def _signal(self, channel: str) -> Signal:
        name, raw = self.file(channel), self.values.pop(channel)
        values = raw if channel == "time" else self._si(channel, raw)
        source, columns = self._source(channel), self.columns.get(channel, [])
        if channel == "time":
            return Signal(values, None, name, ", ".join(columns), self.files.reader(name).numbering)
        stated = self.files.unit(name, columns, UNITS[channel])
        reverse, factor = source.reverse(UNITS[channel], stated), source.factor(UNITS[channel], stated)
        sigma, gain = (None if value is None else value * factor for value in (source.sigma, source.gain))
        rows, columns = self.files.reader(name).numbering, ", ".join(columns)
        return Signal(values, sigma, name, columns, rows, reverse, factor, gain)

    def _source(self, channel: str) -> ChannelSource:
        return self.sources[channel][0] if channel in self.sources else ChannelSource()

    def _si(self, channel: str, raw: np.ndarray) -> np.ndarray:
        """Values in the channel's SI unit."""
        columns = self.columns.get(channel, [])
        return self.files.to_si(self.file(channel), channel, columns, self._source(channel), raw, UNITS[channel])

    def _clock(self) -> None:
        """Set the times, in s, from a column, from the format, or from the sample rate."""
        rate, count = self.entry.sample_rate, len(self.values[self.entry.drive])
        if "time" not in self.values:
            stamps = self._stamps_of_format()
            if stamps is None and rate is not None:
                self.values["time"] = np.arange(count) / rate
                return
            if stamps is None:
                reader = self.files.reader(self.entry.file)
                given = "channels" if isinstance(reader, InMemory) else "[channels]"
                needed = (
                    f"give a {reader.part} time_s, the name of another one in {given}, or sample_rate in the record"
                )
                raise self.error("time", f"there is no time among the {reader.part}s {shown(reader.names)}; {needed}")
            self.values["time"] = self._at_stated_rate(stamps)
        raw = self.values["time"]
        time = self._si("time", raw)
        span = float(time[-1] - time[0])
        if rate is not None and span > 0 and abs((count - 1) / span / rate - 1) > _RATE_TOLERANCE:
            stated = f"but sample_rate says {rate:.6g} Hz"
            raise self.error("time", f"the time stamps have a sample rate of {(count - 1) / span:.6g} Hz, {stated}")
        second = span / float(raw[-1] - raw[0]) if span > 0 else 1.0
        even = even_times(raw, None if rate is None else 1.0 / (rate * second))
        if even is None:
            self.values["time"] = time
            return
        self.values["time"] = self._si("time", even.times)
        if even.coarse and rate is None:
            step = second * float(even.times[1] - even.times[0])
            found = f"found time stamps rounded to {second * even.unit:.3g} s, taken for even ones of {step:.6g} s"
            message = f"{found}: a lost sample would not be detected; give finer stamps or sample_rate"
            self.findings.append(Finding("warning", "coarse time", self.file("time"), "time", (), message))

    def _at_stated_rate(self, stamps: np.ndarray) -> np.ndarray:
        """Times of the format, at the record's sample rate if they are rounded; a warning where it is missing."""
        error, rate = self.files.reader(self.file(self.entry.drive)).step_error, self.entry.sample_rate
        if error <= _RATE_TOLERANCE or len(stamps) < 2:
            return stamps
        step = float(stamps[1] - stamps[0])
        if rate is not None and abs(step * rate - 1) <= error:
            return stamps[0] + np.arange(len(stamps)) / rate
        found = f"the file states a sampling interval of {step:.6g} s, rounded and up to {100 * error:.2g} % off"
        message = f"{found}: sample_rate in the record would define it"
        self.findings.append(Finding("warning", "coarse time", self.file("time"), "time", (), message))
        return stamps

    def _stamps_of_format(self) -> np.ndarray | None:
        """Time stamps that the format itself stores, the same for all channels; None if it stores none."""
        found: np.ndarray | None = None
        for channel in sorted(self.values, key=lambda name: name != self.entry.drive):
            own = self.files.time_of(self.file(channel), self.columns[channel][0])
            if own is not None and found is None and channel == self.entry.drive:
                found = own
            elif own is not None and found is not None and not np.allclose(own[[0, -1]], found[[0, -1]], rtol=1e-9):
                message = f"its samples are from {own[0]:g} s to {own[-1]:g} s, but those of the drive"
                raise self.error(channel, f"{message} from {found[0]:g} s to {found[-1]:g} s")
        return found


def _is_named(name: str, channel: str) -> bool:
    """True if a column is called as a channel is, with a unit or a number behind the name or without."""
    bare = re.sub(r"[\W_]*\d*$", "", stated_unit(name)[0]).lower()
    return re.sub(r"[\W_]+", "_", bare) == channel


def read_record(
    entry: TimeEntry, key: str, sources: Sources, shunt: Shunt | None, folder: Path, data: Reader | None = None
) -> tuple[Record, list[Finding]]:
    """Read a record over time.

    Parameters
    ----------
    entry : TimeEntry
    key : str
        Key of its table in the campaign.
    sources : mapping of str to (ChannelSource, level)
        By channel, as in `TimeRecordReader`.
    shunt : Shunt or None
    folder : Path
        Folder to which file names are relative.
    data : Reader, optional
        In the place of the file.

    Returns
    -------
    Record
    list of Finding
        Missing columns, coarse time stamps, and lines that were not read.

    Raises
    ------
    CampaignError
        A file cannot be read, or a column is missing, not numeric or of another length.
    """
    with Files(folder, entry, data) as files:
        reading = TimeRecordReader(entry, sources, shunt, files)
        signals = reading.signals()
        findings = [*reading.findings, *files.below()]
    record = Record(
        name=entry.file, key=key, role=entry.role, drive=entry.drive, shunt=shunt, start_time=entry.start_time,
        time=signals.pop("time"), signals=MappingProxyType(signals), fitted=entry.fitted(shunt, key),
        periodic=isinstance(entry, PeriodicEntry), frequency=getattr(entry, "frequency", None),
    )  # fmt: skip
    return record, findings
