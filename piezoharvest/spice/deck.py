"""Lines of a netlist, in the subset of the language common to ngspice and LTspice.

In common are R, C, L, D, T, V, E, F, G and H elements, subcircuits, parameters in braces, and B sources written with
+ - * / and the functions abs, exp, floor, max, min, sin and sqrt. Avoided because they differ: powers (^ is an
exclusive or in LTspice), the ternary operator, limit(), expressions in .meas, further properties of an inductor.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable
from typing import ClassVar

from piezoharvest.description.parameters import ParameterError


def number(value: float) -> str:
    """A number in a format that both programs read.

    Raises
    ------
    ParameterError
        It is not finite: values of the study are too large or too small.
    """
    if not math.isfinite(value):
        wanted = "each must be finite: the study has extreme values"
        raise ParameterError("netlist", f"found {value:g} among its numbers, {wanted}")
    return f"{float(value):.12g}"


def total(terms: Iterable[tuple[float | str, str]]) -> str:
    """Expression for a sum of coefficient * expression, "0" if it is empty; coefficients may be names in braces."""
    given = [(c if isinstance(c, str) else number(c), expression) for c, expression in terms if c]
    return " + ".join(f"({c})*{expression}" for c, expression in given) or "0"


class Deck:
    """A netlist, written from top to bottom.

    Values of R, L and C elements become parameters named after them ("resistance_load" for Rload), which stand at the
    top; other values do with `parameter`.
    """

    QUANTITIES: ClassVar[dict[str, str]] = {"R": "resistance", "L": "inductance", "C": "capacitance"}

    def __init__(self, title: str):
        self._lines = ["* " + " ".join(title.split())]
        self._parameters: dict[str, float] = {}
        self._top = 1

    def parameters_here(self) -> None:
        """Let the .param lines stand at this place."""
        self._top = len(self._lines)

    def parameter(self, name: str, value: float) -> str:
        """Add a parameter, and return what stands for it in an element or an expression."""
        name = name.lower()
        number(value)  # refuses what is not finite
        known = self._parameters.setdefault(name, float(value))
        assert known == float(value), f"{name} has two values"
        return f"{{{name}}}"

    def comment(self, text: str = "") -> None:
        """Add a comment, wrapped; an empty one sets a section apart."""
        self._lines += textwrap.wrap(text, 110, initial_indent="* ", subsequent_indent="*   ") or ["*"]

    def section(self, name: str) -> None:
        """Add a heading."""
        self._lines += ["*", f"* --- {name} ---"]

    def add(self, *words: object) -> None:
        """Add one element or command; floats are written by `number`, and long lines are continued."""
        element = str(words[0]).split()[0]
        if element[0] in self.QUANTITIES and len(words) > 1 and isinstance(words[1], float):
            name = f"{self.QUANTITIES[element[0]]}_{element[1:].strip('_') or element}"
            words = (words[0], self.parameter(name, words[1]), *words[2:])
        line = " ".join(number(word) if isinstance(word, float) else str(word) for word in words)
        self._lines += textwrap.wrap(
            line, 110, subsequent_indent="+ ", break_long_words=False, break_on_hyphens=False
        )  # fmt: skip

    def include(self, other: Deck, suffix: str) -> None:
        """Add the lines of another netlist, a suffix behind the names of its parameters."""
        for name, value in other._parameters.items():
            self.parameter(name + suffix, value)
        self._lines += [re.sub(r"\{(\w+)\}", rf"{{\1{suffix}}}", line) for line in other._lines[1:]]

    def text(self) -> str:
        """The whole netlist."""
        parameters = [f".param {name}={number(value)}" for name, value in self._parameters.items()]
        return "\n".join([*self._lines[: self._top], *parameters, *self._lines[self._top :], ".end", ""])
