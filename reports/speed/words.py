"""Numbers in words, and tables in Markdown."""

from __future__ import annotations

import math
from collections.abc import Sequence

PREFIXES = {0: "", -1: "m", -2: "µ", -3: "n"}


def si(value: float, unit: str, measured: bool = True) -> str:
    """A value with a prefix to its unit; with three figures, where it was `measured`."""
    value = float(f"{value:.3g}")
    power = min(max(math.floor(math.log10(value) / 3 + 1e-9), -3), 0)
    scaled = value * 1000.0**-power
    return f"{figures(scaled) if measured else f'{scaled:.3g}'} {PREFIXES[power]}{unit}"


def seconds(value: float) -> str:
    """A time."""
    return si(value, "s")


def capacitance(value: float) -> str:
    """A capacitance."""
    return si(value, "F", measured=False)


def figures(value: float) -> str:
    """Three figures, without exponent, above a thousandth."""
    if value >= 1000:
        return f"{float(f'{value:.3g}'):,.0f}"
    return f"{value:#.3g}".rstrip(".")


def error(value: float) -> str:
    """An error with one figure."""
    return f"{value:.0e}".replace("e-0", "e-")


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]], words: Sequence[int] = (0,)) -> str:
    """A table; the columns whose numbers are in `words` are left aligned, the others right."""
    rule = "".join("---|" if n in words else "---:|" for n in range(len(header)))
    lines = ["| " + " | ".join(header) + " |", "|" + rule]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"
