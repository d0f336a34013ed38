"""Findings of the checks of a record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

Rows = tuple[tuple[int, int], ...]
_MAX_RANGES = 3  # ranges of rows in a message


@dataclass(frozen=True)
class Finding:
    """A fault of a record, certain or likely.

    Attributes
    ----------
    severity : "error" or "warning"
        Nothing can be fitted to a record with an error.
    check : str
        Name of the check: "nan", "gap", "clipped", "unit", ...
    file : str
        The data file, as the campaign names it.
    channel : str
        The channel concerned; empty for all.
    rows : tuple of (first, last)
        Rows concerned, counted from 1: lines of a text file, samples in others. Empty if no rows are meant.
    message : str
        What was found, and what is allowed.
    """

    severity: Literal["error", "warning"]
    check: str
    file: str
    channel: str
    rows: Rows
    message: str

    def __str__(self) -> str:
        return f"{self.file}: {self.place}: {self.message}"

    @property
    def place(self) -> str:
        """Channel and rows as text."""
        return ", ".join(part for part in (self.channel, in_words(self.rows)) if part)


def in_words(rows: Rows) -> str:
    """Text for rows in a message: "row 7" or "rows 7-9, 12-15 and 4 more ranges"."""
    if not rows:
        return ""
    parts = [f"{first}" if first == last else f"{first}-{last}" for first, last in rows[:_MAX_RANGES]]
    more = f" and {len(rows) - _MAX_RANGES} more ranges" if len(rows) > _MAX_RANGES else ""
    return ("row " if len(rows) == 1 and rows[0][0] == rows[0][1] else "rows ") + ", ".join(parts) + more


def runs(mask: np.ndarray) -> np.ndarray:
    """First and last index of every run of True in a mask (n,), as an integer array (runs, 2)."""
    edges = np.flatnonzero(mask[1:] != mask[:-1]) + 1
    bounds = np.concatenate(([0], edges, [len(mask)])) if len(mask) else np.zeros(1, int)
    begin, end = bounds[:-1], bounds[1:] - 1
    kept = mask[begin] if len(mask) else np.zeros(0, bool)
    return np.column_stack((begin[kept], end[kept]))


def shifted(ranges: Sequence[Sequence[int]] | np.ndarray, numbering: int | np.ndarray) -> Rows:
    """Rows of ranges of sample indices, given the row of the first sample or of each."""
    if not isinstance(numbering, np.ndarray):
        return tuple((int(begin) + numbering, int(end) + numbering) for begin, end in ranges)
    rows = np.sort(np.concatenate([numbering[:0], *(numbering[begin : end + 1] for begin, end in ranges)]))
    parts = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    return tuple((int(part[0]), int(part[-1])) for part in parts if len(part))


def index_of(row: int, numbering: int | np.ndarray) -> int:
    """Index of the sample in a row."""
    return int(np.argmin(np.abs(numbering - row))) if isinstance(numbering, np.ndarray) else row - numbering
