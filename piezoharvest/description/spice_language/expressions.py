"""Values in a netlist: numbers with suffixes, and expressions of parameters in braces or quotes."""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping
from typing import Any

from piezoharvest.description.netlist import spice_number

_OPERATORS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.Pow: operator.pow, ast.USub: operator.neg, ast.UAdd: operator.pos,
}  # fmt: skip
_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "sqrt": math.sqrt, "exp": math.exp, "log": math.log, "ln": math.log, "abs": abs, "min": min, "max": max,
    "sin": math.sin, "cos": math.cos, "pow": math.pow,
}  # fmt: skip
_NUMBER = re.compile(r"(?<![\w.])(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?[a-zµ]*", re.IGNORECASE)
MOST_CHARACTERS = 1000  # of an expression


def value_of(text: str, parameters: Mapping[str, float]) -> float:
    """Value of a number or an expression; names of parameters are in lower case.

    Raises
    ------
    ValueError
        It is neither; the message says what was found.
    """
    number = spice_number(text)
    if number is not None and math.isfinite(number):
        return number
    bare = text.strip()
    if bare[:1] + bare[-1:] in ("{}", "''"):
        bare = bare[1:-1]
    elif bare.lower() not in parameters:
        raise ValueError(f"found {text!r}, must be a number, or an expression in braces")
    plain = _NUMBER.sub(lambda match: _plain(match[0]), bare.lower().replace("^", "**"))
    if len(plain) > MOST_CHARACTERS:
        raise ValueError(f"found an expression of {len(plain)} characters, allowed are {MOST_CHARACTERS}")
    try:
        value = _evaluate(ast.parse(plain, mode="eval").body, parameters)
    except (SyntaxError, ArithmeticError, TypeError, RecursionError, MemoryError):
        raise ValueError(f"found {text!r}, which has no value") from None
    if not isinstance(value, float | int) or not math.isfinite(value):
        raise ValueError(f"found {text!r}, which is not a finite number")
    return float(value)


def _plain(text: str) -> str:
    number = spice_number(text)
    return text if number is None else repr(number)


def _evaluate(node: Any, parameters: Mapping[str, float]) -> float:
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return float(node.value)
    if isinstance(node, ast.Name):
        if node.id not in parameters:
            known = ", ".join(sorted(parameters)) or "none"
            raise ValueError(f"found {node.id!r}, which is not a parameter, known are {known}")
        return parameters[node.id]
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        return _OPERATORS[type(node.op)](_evaluate(node.left, parameters), _evaluate(node.right, parameters))
    if isinstance(node, ast.UnaryOp) and type(node.op) in _OPERATORS:
        return _OPERATORS[type(node.op)](_evaluate(node.operand, parameters))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in _FUNCTIONS:
        return _FUNCTIONS[node.func.id](*(_evaluate(argument, parameters) for argument in node.args))
    raise ValueError(f"found {ast.unparse(node)!r}, allowed are + - * / **, {', '.join(_FUNCTIONS)} and parameters")
