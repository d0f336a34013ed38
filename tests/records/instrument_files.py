"""Text files as instruments write them: one table of numbers, in many layouts."""

from __future__ import annotations

import random
from dataclasses import dataclass

import numpy as np

SAMPLES = 60
# Numbers that a float holds as they are printed, so that what is read back can be compared to the last bit.
TIME = np.arange(SAMPLES) / 1000
FORCE = np.array([float(f"{x:.5f}") for x in np.sin(0.3 * np.arange(SAMPLES))])
VOLTAGE = np.array([float(f"{x:.4f}") for x in 2 * np.cos(0.2 * np.arange(SAMPLES))])
COLUMNS = (TIME, FORCE, VOLTAGE)
NAMES = ("Zeit", "CH1", "CH2")
UNITS = ("s", "N", "V")


def rows(delimiter=",", decimal=".", form="{!r}", columns=COLUMNS) -> list[str]:
    """Lines of the table."""
    table = ([form.format(float(x)).replace(".", decimal) for x in row] for row in zip(*columns, strict=True))
    return [delimiter.join(row) for row in table]


def lines(*parts) -> str:
    """Text of lines and lists of lines."""
    return "".join(f"{line}\n" for part in parts for line in ([part] if isinstance(part, str) else part))


@dataclass(frozen=True)
class Layout:
    """One way to write a file."""

    encoding: str
    ending: str
    delimiter: str
    decimal: str
    preamble: str
    units: str
    quotes: str
    trailing: bool
    padded: bool
    footer: str
    last_line_ends: bool

    def text(self) -> str:
        """The file."""
        d = self.delimiter
        names, table = [*NAMES], [line.split(d) for line in rows(d, self.decimal)]
        if self.units in ("()", "[]"):
            names = [f"{name} {self.units[0]}{unit}{self.units[1]}" for name, unit in zip(names, UNITS, strict=True)]
        below = {"row": [[*UNITS]], "bracket row": [[f"({unit})" for unit in UNITS]]}.get(self.units, [])
        header = [names, *below]
        if self.quotes in ("names", "all"):
            header = [[f'"{cell}"' for cell in row] for row in header]
        if self.quotes == "all":
            table = [[f'"{cell}"' for cell in row] for row in table]
        end = d if self.trailing else ""
        if self.padded:
            table = [[f" {cell:>12}" if '"' not in cell else cell for cell in row] for row in table]
        body = [d.join(row) + end for row in [*header, *table]]
        above = {
            "none": [],
            "title": ["Messung 7, µ-Bench", ""],
            "settings": [f"Model{d}SDS1104X{d}", f"Sample Interval{d}0{self.decimal}001{d}s", f"Scale{d}2{d}2", ""],
            "comments": ["# bench 7", "% 20 °C"],
        }[self.preamble]
        below = {
            "none": [], "blank": ["", ""], "comment": ["# end"], "end": ["END"], "delimiters": [d * 2, d * 2],
            "statistics": ["", f"Mean{d}0{d}1", f"Max{d}2{d}3"],
        }[self.footer]  # fmt: skip
        text = "\n".join([*above, *body, *below]) + ("\n" if self.last_line_ends else "")
        return text.replace("\n", self.ending)


def random_layout(seed: int) -> Layout:
    """One of the many combinations."""
    pick = random.Random(seed).choice
    delimiter, decimal = pick([(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ",")])
    footer = pick(["none", "none", "blank", "comment", "end", "delimiters", "statistics"])
    return Layout(
        encoding=pick(["utf-8", "utf-8-sig", "latin-1", "utf-16", "utf-16-le", "utf-16-be"]),
        ending=pick(["\n", "\r\n", "\r"]), delimiter=delimiter, decimal=decimal,
        preamble=pick(["none", "title", "settings", "comments"]), units=pick(["", "()", "[]", "row", "bracket row"]),
        quotes=pick(["", "names", "all"]), trailing=pick([False, True]), padded=pick([False, True]), footer=footer,
        last_line_ends=pick([True, False]),
    )  # fmt: skip
