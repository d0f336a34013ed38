"""The data files of one record: opened once, read column by column, errors with file, channel and row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from itertools import combinations
from pathlib import Path

import numpy as np

from piezoharvest.description.parameters import ParameterError
from piezoharvest.readers import MissingColumnError, Reader, ReadError, open_reader
from piezoharvest.readers.units import Unit
from piezoharvest.records.errors import CampaignError
from piezoharvest.records.finding import Finding
from piezoharvest.records.reading.channels import ChannelSource
from piezoharvest.records.reading.entries import Entry


class Files(ExitStack):
    """The data files of one record, each opened once and closed at the end.

    Parameters
    ----------
    folder : Path
        Folder to which their names are relative.
    entry : Entry
        The record's table in the campaign.
    data : Reader, optional
        In the place of the record's file.
    """

    def __init__(self, folder: Path, entry: Entry, data: Reader | None = None):
        super().__init__()
        self.folder, self.entry = folder, entry
        lines = {"skip_rows": entry.skip_rows, "header_row": entry.header_row}
        self._lines = {key: value for key, value in lines.items() if value is not None}
        self._open: dict[str, Reader] = {} if data is None else {entry.file: data}

    def reader(self, name: str) -> Reader:
        """Reader of a file; raises `CampaignError`."""
        if name not in self._open:
            try:
                self._open[name] = self.enter_context(open_reader(self.folder / name, **self._lines))
            except ReadError as error:
                raise self.error(name, "", error) from None
        return self._open[name]

    def read(self, name: str, columns: Mapping[str, Sequence[str]]) -> dict[str, np.ndarray]:
        """Raw values by channel from one file, in the record's rows; several columns of a channel are averaged.

        Raises
        ------
        CampaignError
            A column cannot be read, or two channels have the same one.
        """
        self._distinct(name, columns)
        reader = self.reader(name)
        wanted = list(dict.fromkeys(column for some in columns.values() for column in some))
        try:
            raw = reader.read(wanted) if self.entry.rows is None else reader.read_rows(wanted, self._rows(reader))
        except ReadError as error:
            channel = next((key for key, some in columns.items() if error.column in some), "")
            raise self.error(name, channel, error) from None
        raw = {column: _real(values) for column, values in raw.items()}
        return {
            channel: raw[some[0]] if len(some) == 1 else np.mean([raw[column] for column in some], axis=0)
            for channel, some in columns.items()
        }

    def to_si(
        self, name: str, channel: str, columns: Sequence[str], source: ChannelSource, raw: np.ndarray, si: str
    ) -> np.ndarray:
        """Values of a channel in its SI unit, by the units that the campaign and the file state.

        Raises
        ------
        CampaignError
            These units contradict each other, or the columns that are averaged have different units.
        """
        reader = self.reader(name)
        stated = [reader.unit(column) for column in columns]
        units = [unit if unit and (unit.firm or unit.si == si) else None for unit in stated] or [None]
        try:
            if len({unit and unit[1:3] for unit in units}) > 1 and not source.unit and source.gain is None:
                found = " and ".join(repr(unit.text) if unit else "none" for unit in units)
                raise ParameterError(
                    "unit",
                    f"the columns to be averaged have the units {found} in the file, give one unit in the campaign",
                )
            return source.to_si(raw, si, units[0], levels=channel == "magnitude")
        except ParameterError as error:
            key = f"{channel} (column {', '.join(columns)!r})"
            raise CampaignError(self.folder / name, key, error.message, channel=channel) from None

    def unit(self, name: str, columns: Sequence[str], si: str) -> Unit | None:
        """Unit that the file states for a channel in this SI unit, the same for all its columns."""
        units = [self.reader(name).unit(column) for column in columns]
        return next((unit for unit in units if unit and unit.si == si), None)

    def time_of(self, name: str, column: str) -> np.ndarray | None:
        """Time of a column's samples in the record's rows, in s, if the format stores it."""
        reader = self.reader(name)
        time = reader.time_of(column)
        if time is None or self.entry.rows is None:
            return time
        begin, end = (row - reader.first_row for row in self._rows(reader))
        return time[begin : end + 1]

    def below(self) -> list[Finding]:
        """Findings for files that are cut off, and for lines with numbers below the tables, which were not read."""
        not_read = "this line and those below it are not read (the key `rows` of a record selects lines)"
        cut = [
            Finding("warning", "cut off", name, "", (), f"{reader.cut_off}; likely the file is cut off")
            for name, reader in self._open.items()
            if reader.cut_off
        ]
        return cut + [
            Finding("warning", "rows below", name, "", ((row, row),), f"found {text!r} below the table: {not_read}")
            for name, reader in self._open.items()
            if reader.left_out is not None
            for row, text in [reader.left_out]
        ]

    def error(self, name: str, channel: str, error: ReadError) -> CampaignError:
        """Campaign error from that of a reader, with file, channel, column and row."""
        rows = () if error.row is None else ((error.row, error.row),)
        in_message = isinstance(error, MissingColumnError) or error.column == "rows"  # in the message
        column = f"column {error.column!r}" if error.column and channel and not in_message else ""
        key = " ".join(part for part in (channel, f"({column})" if column else "") if part)
        key = key or ("rows" if error.column == "rows" else "")
        return CampaignError(self.folder / name, key, error.message, channel=channel, rows=rows)

    def _rows(self, reader: Reader) -> tuple[int, int]:
        """The record's rows in a file: the same samples, counted from its beginning, as in the record's main file."""
        assert self.entry.rows is not None
        ahead = reader.first_row - self.reader(self.entry.file).first_row
        return self.entry.rows[0] + ahead, self.entry.rows[1] + ahead

    def _distinct(self, name: str, columns: Mapping[str, Sequence[str]]) -> None:
        """Raise an error if two channels have the same column."""
        for (one, some), (other, others) in combinations(columns.items(), 2):
            if both := [column for column in some if column in others]:
                message = f"column {both[0]!r} is also that of {one}, but each channel needs its own column"
                raise CampaignError(self.folder / name, other, message, channel=other)


def _real(values: np.ndarray) -> np.ndarray:
    """Real part of complex values if all imaginary parts are zero, as in a real column of a complex array."""
    return np.ascontiguousarray(np.real(values)) if np.iscomplexobj(values) and not np.any(np.imag(values)) else values
