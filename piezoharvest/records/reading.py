"""From the entry of a record to the record: files opened, columns found and read, values in SI units."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType

import numpy as np

from piezoharvest.readers import MissingColumnError, ReadError
from piezoharvest.readers.base import shown
from piezoharvest.records.channels import COLUMNS, UNITS, Source
from piezoharvest.records.entries import Sources, TimeEntry
from piezoharvest.records.errors import CampaignError
from piezoharvest.records.files import Files
from piezoharvest.records.finding import Finding
from piezoharvest.records.record import Record, Signal
from piezoharvest.shunts import Shunt

_RATE_TOLERANCE = 1e-3  # between the time stamps and a sample rate that is given too


class Reading:
    """One record over time on its way from files to signals.

    Parameters
    ----------
    entry : TimeEntry
    sources : mapping of str to (Source, level)
        By channel; a column may be missing unless the record itself names it or it is the drive's. That of one that
        [channels] names is noted in `findings`.
    files : Files

    Raises
    ------
    CampaignError
        A column is missing, not numeric or of another length.
    """

    def __init__(self, entry: TimeEntry, sources: Sources, files: Files):
        self.entry, self.sources, self.files = entry, sources, files
        self.findings: list[Finding] = []
        self.columns: dict[str, list[str]] = {}
        for channel in UNITS:
            if channel in sources:
                self._find(channel)
        if len(self.columns.keys() - {"time"}) < 2:
            names = shown(files.reader(entry.file).names)
            message = f"found no channel beside the drive, allowed is one or more (there are the columns {names})"
            raise CampaignError(files.folder / entry.file, "", message)
        self.values = self._read()

    def file(self, channel: str) -> str:
        """File that a channel comes from."""
        return self.sources[channel][0].file or self.entry.file

    def error(self, channel: str, message: str) -> CampaignError:
        """Error of a channel."""
        return CampaignError(self.files.folder / self.file(channel), channel, message, channel=channel)

    def _find(self, channel: str) -> None:
        """Find the columns of a channel, or note that it is missing."""
        source, level = self.sources[channel]
        name = self.file(channel)
        reader = self.files.reader(name)
        try:
            self.columns[channel] = [reader.resolve(column) for column in source.columns(COLUMNS[channel])]
        except MissingColumnError as error:
            drive = channel == self.entry.drive
            if level == "record" or drive or (channel == "time" and level == "campaign"):
                what = f"{channel}, the drive" if drive else channel
                raise CampaignError(self.files.folder / name, what, error.message, channel=channel) from None
            if level == "campaign":
                message = f"{error.message}; the record is used without this channel"
                self.findings.append(Finding("warning", "missing column", name, channel, (), message))
        except ReadError as error:
            raise self.files.error(name, channel, error) from None

    def _read(self) -> dict[str, np.ndarray]:
        """Raw values by channel, file by file, all of one length."""
        values: dict[str, np.ndarray] = {}
        for name in dict.fromkeys(map(self.file, self.columns)):
            wanted = {channel: some for channel, some in self.columns.items() if self.file(channel) == name}
            values |= self.files.read(name, wanted)
        count = len(values[self.entry.drive])
        for channel, raw in values.items():
            if len(raw) != count:
                message = f"found {len(raw)} samples, allowed are {count} as in the drive, {self.entry.drive}"
                raise self.error(channel, message)
            if raw.dtype.kind == "c":
                raise self.error(channel, "found complex values, allowed are real ones")
        if count < 2:
            raise self.error(self.entry.drive, f"found {count} samples, allowed are two or more")
        return values

    def signals(self) -> dict[str, Signal]:
        """All channels in SI units, "time" among them."""
        self._clock()
        part = self._part()
        return {channel: self._signal(channel, part) for channel in list(self.values)}

    def _signal(self, channel: str, part: slice) -> Signal:
        source, si = self.sources.get(channel, (Source(), "default"))[0], UNITS[channel]
        first_row = self.files.reader(self.file(channel)).first_row + (part.start or 0)
        values = source.to_si(self.values.pop(channel)[part], si)
        column = ", ".join(self.columns.get(channel, []))
        return Signal(values, source.sigma_si(si), self.file(channel), column, first_row)

    def _clock(self) -> None:
        """See to time stamps: of a column, as the format tells them, or by the sample rate."""
        rate, count = self.entry.sample_rate, len(self.values[self.entry.drive])
        if "time" not in self.values:
            stamps = self._stamps_of_format()
            if stamps is None and rate is not None:
                self.values["time"] = np.arange(count) / rate
                return
            if stamps is None:
                names = shown(self.files.reader(self.entry.file).names)
                allowed = "allowed is a column time_s, another one in [channels], or sample_rate in the record"
                raise self.error("time", f"found no time among the columns {names}, {allowed}")
            self.values["time"] = stamps
        time = self.sources["time"][0].to_si(self.values["time"], "s")
        span = float(time[-1] - time[0])
        if rate is not None and span > 0 and abs((count - 1) / span / rate - 1) > _RATE_TOLERANCE:
            allowed = f"allowed is what sample_rate says, {rate:.6g} Hz, or no such key"
            raise self.error("time", f"found {(count - 1) / span:.6g} Hz, {allowed}")

    def _stamps_of_format(self) -> np.ndarray | None:
        """Time stamps that the format itself keeps, the same for all channels; None where it keeps none."""
        found: np.ndarray | None = None
        for channel in sorted(self.values, key=lambda name: name != self.entry.drive):
            own = self.files.reader(self.file(channel)).time_of(self.columns[channel][0])
            if own is not None and found is None and channel == self.entry.drive:
                found = own
            elif own is not None and found is not None and not np.allclose(own[[0, -1]], found[[0, -1]], rtol=1e-9):
                message = f"found samples from {own[0]:g} s to {own[-1]:g} s, allowed is the time base of the drive"
                raise self.error(channel, f"{message}, {found[0]:g} s to {found[-1]:g} s")
        return found

    def _part(self) -> slice:
        """Samples that the record's rows stand for; all of them unless it says so."""
        if self.entry.rows is None:
            return slice(0, None)
        first_row = self.files.reader(self.entry.file).first_row
        begin, end = (row - first_row for row in self.entry.rows)
        count = len(self.values["time"])
        if begin < 0 or end >= count:
            found = f"found {list(self.entry.rows)}, allowed is from {first_row} to {first_row + count - 1}"
            raise CampaignError(self.files.folder / self.entry.file, "rows", found)
        return slice(begin, end + 1)


def read_record(
    entry: TimeEntry, key: str, sources: Sources, shunt: Shunt | None, folder: Path
) -> tuple[Record, list[Finding]]:
    """Read a record over time.

    Parameters
    ----------
    entry : TimeEntry
    key : str
        Where it stands in the campaign.
    sources : mapping of str to (Source, level)
        By channel, as in `Reading`.
    shunt : Shunt or None
    folder : Path
        What files are relative to.

    Returns
    -------
    Record
    list of Finding
        Columns that are missing.

    Raises
    ------
    CampaignError
        A file cannot be read, or a column is missing, not numeric or of another length.
    """
    with Files(folder) as files:
        reading = Reading(entry, sources, files)
        signals = reading.signals()
    record = Record(
        name=entry.file, key=key, role=entry.role, drive=entry.drive, shunt=shunt, start_time=entry.start_time,
        time=signals.pop("time"), signals=MappingProxyType(signals),
    )  # fmt: skip
    return record, reading.findings
