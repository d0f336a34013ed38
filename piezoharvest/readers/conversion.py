"""Units that a user writes into a file of ours, converted by pint: "kN", or a number with its unit, "52 nF"."""

from __future__ import annotations

import math
import re
import sys
from functools import cache
from typing import Any

from piezoharvest.description.parameters import ParameterError

# Syntax of a unit: names with a small power, times, divided by, brackets and 1. pint accepts more and evaluates it
# all: "10**1000000000 N" never ends. So no power of a number, of brackets or of a power, and none of the words that
# pint reads as powers. The pattern is atomic, because backtracking could take as long.
_POWER = r"(?>\s*(?:\*\*|\^)\s*[+-]?\d(?:\.\d)?(?![\w.])|⁻?[¹²³⁴])"
_LETTERS = r"[^\W\d¹²³⁴⁰-⁹]++"
_NAME = rf"(?!(?:square|squared|cubic|cubed)\b)(?>{_LETTERS}(?:[0-9]++(?:{_LETTERS})?+)*+|[°%‰])"
_UNIT = re.compile(rf"\s*+(?>(?:{_NAME}{_POWER}?+|1(?!\w)|\*(?!\s*\*)|[/·()])\s*+)*+")
_MAX_UNIT_LENGTH = 64  # characters: twice the longest meaningful unit


# A number in front of its unit: digits are not taken by the unit, so that there is one way to read each text.
_NUMBER = r"\s*+([+-]?+(?:\d++\.?+\d*+|\.\d++)(?:[eE][+-]?+\d++)?+)\s*+"
_QUANTITY, _BARE = re.compile(rf"{_NUMBER}(\S.*+)"), re.compile(_NUMBER)
# As people write them, and pint does not: kOhm, MOHM, khz.
_OHM = re.compile(r"(?<![^\W\d_])([a-zA-Z\u00b5\u03bc]?)(?:O[hH][mM])[sS]?(?![^\W\d_])")
_HERTZ = re.compile(r"(?<![^\W\d_])([kMG]?)(?:hz|HZ)(?![^\W\d_])")
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d+,\d+(?:[eE][+-]?\d+)?(?:\s*[^\W\d].*)?")
# Where an acceleration is wanted g is standard gravity, not the gram, which converts to none.
_GRAVITY = re.compile(r"(?<!\w)([muµμ]?)g(?!\w)")


@cache
def _registry() -> Any:
    """Unit registry of pint; created only when a file names a unit, because it takes most of a second."""
    from pint import UnitRegistry

    return UnitRegistry()


def with_unit(text: str, si: str) -> float | None:
    """Value in an SI unit of a text such as "52 nF", "1 g" (of an acceleration: 9.80665 m/s^2), "5 %" or "10 deg".

    None if the text is not a number with something behind it.

    Parameters
    ----------
    text : str
        A number and a unit.
    si : str
        SI unit of the quantity, "" for a pure number.

    Raises
    ------
    ParameterError
        The unit is missing, unknown or has another dimension; the error's key is "unit".
    """
    if len(text) <= _MAX_UNIT_LENGTH and _DECIMAL_COMMA.fullmatch(text):
        raise ParameterError("unit", f"found {text!r}, must have a decimal point, not a comma")
    if si and len(text) <= _MAX_UNIT_LENGTH and (bare := _BARE.fullmatch(text)):
        example = f"{bare[1]} {si}"
        raise ParameterError("unit", f"found {text!r} without its unit, must be a number, or text such as {example!r}")
    match = _QUANTITY.fullmatch(text)
    if match is None:
        return None
    return float(match[1]) * unit_factor(match[2].strip(), si or "dimensionless")


def _without_rounding(factor: float) -> float:
    """The decimal number of 15 digits that a product of prefixes has come near to: 1e-9 for 1.0000000000000003e-9."""
    decimal = float(f"{factor:.15g}")
    return decimal if abs(decimal - factor) <= 4 * sys.float_info.epsilon * abs(factor) else factor


@cache
def unit_factor(unit: str, si: str) -> float:
    """Factor from a unit to an SI unit.

    Raises
    ------
    ParameterError
        The unit is unknown or has another dimension; the error's key is "unit".
    """
    if unit == si:
        return 1.0
    found = repr(unit) if len(unit) <= _MAX_UNIT_LENGTH else f"{unit[:_MAX_UNIT_LENGTH]!r} and more"
    registry, pure = _registry(), si in ("", "dimensionless")
    try:
        if len(unit) > _MAX_UNIT_LENGTH or not _UNIT.fullmatch(unit):
            raise ValueError
        plain = _HERTZ.sub(r"\1Hz", _OHM.sub(r"\1ohm", unit))
        meant = _GRAVITY.sub(r"\1standard_gravity", plain) if "m/s^2" in si else plain
        given, wanted = registry.Quantity(1.0, meant), registry.Quantity(1.0, si)
        if given.dimensionality != wanted.dimensionality:
            needed = "no unit, or one such as %" if pure else f"a unit that converts to {si}"
            raise ParameterError("unit", f"found the unit {found}, must be {needed}")
        factor = _without_rounding(float((given / wanted).to_base_units().magnitude))
        if not 0 < factor < math.inf:
            raise ValueError
        turns = "radian" in str(given.to_base_units().units)
    except ParameterError:
        raise
    except Exception:  # pint's parser raises errors of many kinds: undefined units, syntax, assertions
        raise ParameterError("unit", f"found the unit {found}, must be a unit such as {'%' if pure else si}") from None
    # To pint a radian is dimensionless: 1 rad/s would be 1 Hz.
    return factor / (2 * math.pi) if si == "Hz" and turns else factor
