"""The printed values of Tables I to V, with half a unit of the last printed digit as their uncertainty."""

from __future__ import annotations

import csv
import tomllib
from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pint

DATA = Path(__file__).parent / "data"
UNITS = pint.UnitRegistry()


class Printed(NamedTuple):
    """A printed number: its digits, its value in SI units, and half a unit of its last digit, in SI units too."""

    text: str
    value: float
    half: float

    @property
    def relative(self) -> float:
        """Standard deviation of the logarithm that rounding causes: uniform within half a digit."""
        return self.half / self.value / np.sqrt(3)


class Row(NamedTuple):
    """A row of Tables I to IV. Steps have a load, sines a frequency; the paper prints no load for the sines."""

    table: str
    force: float
    load: float | None
    frequency: float | None
    energy: Printed
    peak: Printed

    @property
    def hertz(self) -> float:
        """Frequency of a sine, Hz."""
        assert self.frequency is not None, f"Table {self.table} is of steps"
        return self.frequency

    @property
    def ohm(self) -> float:
        """Load of a step, ohm."""
        assert self.load is not None, f"Table {self.table} has no load"
        return self.load

    @property
    def label(self) -> str:
        """What the row is told by, as printed."""
        force = f"{self.force / 1e3:g} kN"
        return f"{force}, {self.load / 1e3:g} kΩ" if self.load is not None else f"{force}, {self.frequency:g} Hz"


class Parameter(NamedTuple):
    """A row of Table V; `unit` is what its unit has to be, `printed_unit` what stands there."""

    symbol: str
    description: str
    printed: Printed
    printed_unit: str
    unit: str


def printed(text: str, unit: str) -> Printed:
    """Read a printed number of the given unit.

    Raises
    ------
    ValueError
        The text is not a positive number.
    """
    number = Decimal(text)
    exponent = number.as_tuple().exponent
    if not isinstance(exponent, int) or number <= 0:
        raise ValueError(f"found {text!r}, must be a positive number")
    factor = UNITS.Quantity(1.0, unit).to_base_units().magnitude
    return Printed(text, float(number) * factor, 0.5 * 10.0**exponent * factor)


@cache
def paper() -> dict[str, Any]:
    """Captions, headers and the experiment's settings."""
    return tomllib.loads((DATA / "paper.toml").read_text(encoding="utf-8"))


def experiment() -> dict[str, Any]:
    """Settings of the experiments, SI units."""
    return paper()["experiment"]


@cache
def rows(table: str) -> tuple[Row, ...]:
    """All rows of Table I, II, III or IV."""
    return tuple(_row(table, line) for line in _lines(paper()["tables"][table]["file"]))


def all_rows() -> tuple[Row, ...]:
    """All rows of Tables I to IV."""
    return tuple(row for table in ("I", "II", "III", "IV") for row in rows(table))


@cache
def parameters() -> dict[str, Parameter]:
    """Table V by symbol."""
    found = {}
    for line in _lines("table5.csv"):
        value = printed(line["value"], line["unit"])
        found[line["symbol"]] = Parameter(
            line["symbol"], line["description"], value, line["printed_unit"], line["unit"]
        )
    return found


def _lines(file: str) -> list[dict[str, str]]:
    with (DATA / file).open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def _row(table: str, line: dict[str, str]) -> Row:
    load = printed(line["load_kohm"], "kohm").value if "load_kohm" in line else None
    frequency = float(line["frequency_Hz"]) if "frequency_Hz" in line else None
    energy, peak = printed(line["energy_mJ"], "mJ"), printed(line["peak_mW"], "mW")
    return Row(table, printed(line["force_kN"], "kN").value, load, frequency, energy, peak)
