"""Columns that are in memory, arrays of NumPy or a DataFrame, read as those of a file are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from piezoharvest.description.parameters import named_kind
from piezoharvest.readers.base import Reader, ReadError, check_count, cut, numbers
from piezoharvest.records.errors import CampaignError

_OF_FILES = {"file", "skip_rows", "header_row"}  # keys of [[records]] that only records in files have

_EXAMPLE = 'as in records = [{"data": {"force_N": ..., "displacement_m": ...}, "load_resistance": 1e5}]'


def in_memory(records: Any, path: Path) -> tuple[list[dict[str, Any]], list[InMemory]]:
    """Tables of [[records]] and readers of their data, from mappings with `data` instead of `file`.

    Parameters
    ----------
    records : sequence of mappings
    path : Path
        Stands for the campaign in messages.

    Raises
    ------
    CampaignError
        A record has no data, or data that is none.
    """
    if isinstance(records, Mapping | str) or not isinstance(records, Iterable) or hasattr(records, "columns"):
        raise CampaignError(path, "records", f"found {named_kind(records)}, must be a list of mappings, {_EXAMPLE}")
    tables, readers = [], []
    for n, record in enumerate(records):
        if not isinstance(record, Mapping):
            needed = f"must be a mapping with the key data, {_EXAMPLE}"
            raise CampaignError(path, f"records.{n}", f"found {named_kind(record)}, {needed}")
        for key in sorted(_OF_FILES & set(record)):
            found = "found a key of records in files, but data is a mapping of arrays or a DataFrame"
            raise CampaignError(path, f"records.{n}.{key}", found)
        if "data" not in record:
            needed = "it must be a mapping of arrays or a DataFrame"
            raise CampaignError(path, f"records.{n}.data", f"missing key, {needed}")
        table = {key: value.item() if isinstance(value, np.generic) else value for key, value in record.items()}
        table["file"] = str(table.pop("name", f"record {n + 1}"))
        try:
            readers.append(InMemory(table["file"], table.pop("data")))
        except ReadError as error:
            raise CampaignError(Path(table["file"]), error.column, error.message) from None
        tables.append(table)
    return tables, readers


class InMemory(Reader):
    """Named columns in memory; what is read are copies, so that a record stays as it is.

    Parameters
    ----------
    name : str
        Stands in messages where a file's name would.
    columns : mapping of str to array
        Or a DataFrame. Times that are dates or differences of them are in s from the first.
    """

    suffixes: ClassVar[tuple[str, ...]] = ()

    def __init__(self, name: str, columns: Any):
        super().__init__(Path(name))
        self.whole, self.part = "the mapping", "key"
        if not isinstance(columns, Mapping):
            columns = _of_frame(columns)
            self.whole, self.part = "the DataFrame", "column"
        self._columns = {str(column): _one_dimensional(values, str(column)) for column, values in columns.items()}
        self.names = tuple(self._columns)

    def read(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        """Copies of columns, (n,) arrays of float or complex; raises `ReadError`."""
        self.numbering = 1
        check_count(sum(len(self._columns[name]) for name in names))
        return {name: np.array(numbers(self._columns[name], name)) for name in names}


def _of_frame(frame: Any) -> dict[str, Any]:
    """Columns of a DataFrame; an index with a name is one of them. Raises `ReadError`."""
    if not hasattr(frame, "columns") or not hasattr(frame, "index"):
        raise ReadError(f"found data of type {type(frame).__name__}, allowed are a mapping of arrays or a DataFrame")
    columns = {str(frame.index.name): frame.index.to_numpy()} if frame.index.name is not None else {}
    for n, column in enumerate(frame.columns):
        if str(column) in columns:
            raise ReadError(f"found several columns {cut(str(column))!r}, each must have its own name", str(column))
        columns[str(column)] = frame.iloc[:, n].to_numpy()
    return columns


def _one_dimensional(values: Any, name: str) -> np.ndarray:
    """Values as a vector; dates and time differences in s from the first. Raises `ReadError`."""
    try:
        if isinstance(values, np.ma.MaskedArray):  # what is masked is missing
            values = np.ma.filled(values.astype(float), np.nan)
        array = np.asarray(values)
    except (ValueError, TypeError) as error:  # of lists of unequal lengths
        raise ReadError(f"found no array ({error})", name) from None
    if array.ndim != 1:
        raise ReadError(f"found an array of shape {array.shape}, allowed are vectors", name)
    if array.dtype.kind in "mM":
        return (array - array[0]) / np.timedelta64(1, "s") if len(array) else np.empty(0)
    return array
