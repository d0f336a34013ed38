"""Lines of a netlist, in the subset of the language common to ngspice and LTspice.

In common are R, C, L, T, V, E, G and H elements, and B sources written with + - * / and the functions abs, exp, max,
min, sin and sqrt. Avoided because they differ: powers (^ is an exclusive or in LTspice), the ternary operator, limit(),
expressions in .meas, parameters of an inductor.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable


def number(value: float) -> str:
    """A number in a format that both programs read."""
    return f"{float(value):.12g}"


def total(terms: Iterable[tuple[float, str]]) -> str:
    """Expression for a sum of coefficient * expression, "0" if it is empty."""
    return " + ".join(f"({number(c)})*{expression}" for c, expression in terms if c) or "0"


class Deck:
    """A netlist, written from top to bottom."""

    def __init__(self, title: str):
        self._lines = ["* " + " ".join(title.split())]

    def comment(self, text: str = "") -> None:
        """Add a comment, wrapped; an empty one sets a section apart."""
        self._lines += textwrap.wrap(text, 110, initial_indent="* ", subsequent_indent="*   ") or ["*"]

    def section(self, name: str) -> None:
        """Add a heading."""
        self._lines += ["*", f"* --- {name} ---"]

    def add(self, *words: object) -> None:
        """Add one element or command; floats are written by `number`, and long lines are continued."""
        line = " ".join(number(word) if isinstance(word, float) else str(word) for word in words)
        self._lines += textwrap.wrap(
            line, 110, subsequent_indent="+ ", break_long_words=False, break_on_hyphens=False
        )  # fmt: skip

    def text(self) -> str:
        """The whole netlist."""
        return "\n".join([*self._lines, ".end", ""])
