"""Results in a notebook: a short text, a table in HTML, a pandas frame, axes of matplotlib."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

Row = Mapping[str, Any]


class Shown:
    """Base of results that a notebook shows: by `rows`, a table, and `heading`, a line.

    Subclasses that are drawn have a method `plot(ax=None)`, which returns the axes.
    """

    @property
    def heading(self) -> str:
        """The result in one line."""
        raise NotImplementedError

    @property
    def rows(self) -> Sequence[Row]:
        """The result as a table, in SI units: a mapping from column to value for each row."""
        raise NotImplementedError

    def __repr__(self) -> str:
        """The result in one line."""
        return f"<{type(self).__name__}: {self.heading}>"

    def _repr_html_(self) -> str:
        """The result as a table, which notebooks call for; columns in which nothing stands are left out."""
        rows = self.rows
        named = dict.fromkeys(column for row in rows for column in row)
        columns = [column for column in named if any(cell(row.get(column)) for row in rows)]
        head = "".join(f"<th>{escape(column.replace('_', ' '))}</th>" for column in columns)
        lines = ["".join(f"<td>{escape(cell(row.get(column)))}</td>" for column in columns) for row in rows]
        body = "".join(f"<tr>{line}</tr>" for line in lines)
        caption = escape(self.heading)
        return f"<table><caption>{caption}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"

    def to_frame(self) -> Any:
        """The result as a `pandas.DataFrame`, in SI units; raises `ImportError` where pandas is not installed."""
        return frame(self.rows)


def extent(name: str, unit: str, values: Any) -> Row:
    """Row of a table that shows a long array by the least and the largest of its values, complex ones by magnitude."""
    sizes = np.abs(values) if np.iscomplexobj(values) else np.asarray(values)
    least, most = (float(sizes.min()), float(sizes.max())) if sizes.size else (math.nan, math.nan)
    return {"quantity": name, "unit": unit, "least": least, "most": most}


def over(frequencies: Any) -> str:
    """Text for the frequencies (Hz) of a response: how many, and between which."""
    if len(frequencies) == 0:
        return "no frequencies"
    if len(frequencies) == 1:
        return f"1 frequency, {frequencies[0]:.6g} Hz"
    return f"{len(frequencies)} frequencies from {np.min(frequencies):.6g} to {np.max(frequencies):.6g} Hz"


def frame(data: Any, **options: Any) -> Any:
    """A `pandas.DataFrame`.

    Raises
    ------
    ImportError
        pandas, which is no dependency, is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise ImportError(
            "to_frame needs pandas, which is not installed: pip install 'piezoharvest[notebook]'"
        ) from None
    return pandas.DataFrame(data, **options)


def axes_for(ax: Any, count: int = 1, **options: Any) -> list[Any]:
    """Axes to draw into: the one given, or `count` of a new figure, one below the other.

    Parameters
    ----------
    ax : matplotlib axes or None
    count : int
    **options
        Of `matplotlib.pyplot.subplots`.
    """
    if ax is not None:
        return [ax]
    from matplotlib import pyplot

    _, found = pyplot.subplots(count, 1, squeeze=False, layout="constrained", **options)
    return list(found[:, 0])


def cell(value: Any) -> str:
    """A value in a table: four significant digits of a number, nothing for what there is not."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
