"""The data files of one record: opened once, read column by column, errors told with file, channel and row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from piezoharvest.readers import MissingColumnError, Reader, ReadError, open_reader
from piezoharvest.records.errors import CampaignError


class Files(ExitStack):
    """The data files of one record, each opened once and closed at the end."""

    def __init__(self, folder: Path):
        super().__init__()
        self.folder = folder
        self._open: dict[str, Reader] = {}

    def reader(self, name: str) -> Reader:
        """Reader of a file; raises `CampaignError`."""
        if name not in self._open:
            try:
                self._open[name] = self.enter_context(open_reader(self.folder / name))
            except ReadError as error:
                raise self.error(name, "", error) from None
        return self._open[name]

    def read(self, name: str, columns: Mapping[str, Sequence[str]]) -> dict[str, np.ndarray]:
        """Raw values by channel, of one file; several columns of a channel are averaged. Raises `CampaignError`."""
        reader = self.reader(name)
        try:
            raw = reader.read(list(dict.fromkeys(column for some in columns.values() for column in some)))
        except ReadError as error:
            channel = next((key for key, some in columns.items() if error.column in some), "")
            raise self.error(name, channel, error) from None
        return {
            channel: raw[some[0]] if len(some) == 1 else np.mean([raw[column] for column in some], axis=0)
            for channel, some in columns.items()
        }

    def error(self, name: str, channel: str, error: ReadError) -> CampaignError:
        """The error of a reader, with file, channel, column and row."""
        rows = () if error.row is None else ((error.row, error.row),)
        told = isinstance(error, MissingColumnError)  # in the message
        column = f"column {error.column!r}" if error.column and channel and not told else ""
        key = " ".join(part for part in (channel, f"({column})" if column else "") if part)
        return CampaignError(self.folder / name, key, error.message, channel=channel, rows=rows)
