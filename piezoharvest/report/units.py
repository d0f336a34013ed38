"""Formatting of numbers for reports: engineering notation, units and names."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

from piezoharvest.counting import counted
from piezoharvest.readers.units import bracketed
from piezoharvest.records.reading.channels import UNITS

_PREFIXES = {-15: "f", -12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_ACRONYMS = {"rl", "rlc", "sshi", "sece", "ssds", "ssdi", "ssdv"}
_SYMBOLS = {
    "resistance": "R", "inductance": "L", "capacitance": "C", "load_resistance": "R_load", "dc_voltage": "V_dc",
    "smoothing_capacitance": "C_s", "quality": "Q_i", "source_voltage": "V_s", "flip_time": "flip time",
    "diode_drop": "V_D", "efficiency": "η", "phase_lag": "φ",
}  # fmt: skip
NONE = "–"
SPACE = "\u202f"  # narrow no-break space, between a number and its unit


def pretty_unit(unit: str) -> str:
    """Unit for display: "N s/m" becomes "N·s/m", "ohm" the Greek letter, "m/s^2" gets a superscript."""
    unit = unit.replace("ohm", "Ω").replace(" or ", " | ")
    unit = re.sub(r"(?<=\w) (?=\w)", "·", unit).replace(" | ", " or ")
    return re.sub(r"\^(-?\d+)", lambda found: found.group(1).translate(_SUPERSCRIPT), unit)


def takes_prefix(unit: str) -> bool:
    """True if an SI prefix can stand before the unit: no power, percentage or choice of units."""
    plain = unit[:1].isalpha() and " or " not in unit and unit not in ("dB", "rad")
    return plain and "^" not in unit.split("/")[0]


def prefix_of(largest: float, unit: str = "W") -> tuple[float, str]:
    """Factor and prefix that bring a number between 1 and 1000; mass is given in grams, as kg already has a prefix.

    Parameters
    ----------
    largest : float
        The number, in the unit.
    unit : str
        SI unit.

    Returns
    -------
    float
        Factor for values in the unit.
    str
        Prefixed unit, for display.
    """
    base, scale = ("g" + unit[2:], 1e3) if unit.startswith("kg") else (unit, 1.0)
    size = abs(largest) * scale
    if not takes_prefix(unit) or size == 0 or not math.isfinite(size):
        return 1.0, pretty_unit(unit)
    # Of the rounded number, so that 999.96 counts as 1000.
    power = 3 * (int(f"{size:.3e}".partition("e")[2]) // 3)
    power = min(max(power, min(_PREFIXES)), max(_PREFIXES))
    return scale / 10.0**power, _PREFIXES[power] + pretty_unit(base)


def number(value: float, digits: int = 3, *, exact: bool = False) -> str:
    """Number with significant digits and a true minus sign; a dash if it is not finite.

    An `exact` number was given, not computed: it has no trailing zeros.
    """
    if value is None or not math.isfinite(value):
        return NONE
    text = f"{value:{'' if exact else '#'}.{digits}g}".rstrip(".") if value else "0"
    mantissa, _, exponent = text.partition("e")
    if exponent:
        text = f"{mantissa.rstrip('.')}·10{str(int(exponent)).translate(_SUPERSCRIPT)}"
    return text.replace("-", "\u2212")


def engineering(value: float | None, unit: str = "", digits: int = 3, *, exact: bool = False) -> str:
    """Number with its unit and an SI prefix, such as "98.1 kΩ"; a dash if it is not finite."""
    if value is None or not math.isfinite(value):
        return NONE
    factor, printed = prefix_of(float(f"{value:.{digits}g}"), unit)  # as it is printed: 999.5 ms is 1.00 s
    text = number(value * factor, digits, exact=exact)
    return f"{text}{SPACE}{printed}" if printed else text


def listed(values: Iterable[float], unit: str = "", digits: int = 3) -> str:
    """Numbers as given, of one unit, with a common prefix, such as "0.1, 0.3, 0.7 µC"."""
    values = list(values)
    factor, printed = prefix_of(max(map(abs, values), default=0.0), unit)
    text = ", ".join(number(value * factor, digits, exact=True) for value in values)
    return f"{text}{SPACE}{printed}" if printed else text


def percent(share: float | None, digits: int = 3) -> str:
    """Share as a percentage."""
    if share is None or not math.isfinite(share):
        return NONE
    return f"<{SPACE}0.01{SPACE}%" if 0 < share < 1e-4 else f"{number(100 * share, digits)}{SPACE}%"


def decibel(value: float | None) -> str:
    """Decibels with a sign and one decimal."""
    if value is None or not math.isfinite(value):
        return NONE
    text = f"{value:+.1f}".replace("-", "\u2212")
    return f"{'0.0' if float(f'{value:.1f}') == 0 else text}{SPACE}dB"


def kind_name(kind: str) -> str:
    """Kind of a shunt or an excitation for display: "parallel_sshi" becomes "parallel SSHI"."""
    return " ".join(word.upper() if word in _ACRONYMS else word for word in kind.split("_"))


def symbol(name: str) -> str:
    """Symbol or words for a shunt's key."""
    field, _, place = name.partition(".")
    number = f" {int(place) + 1}" if place else ""
    return _SYMBOLS.get(field, field.replace("_", " ")) + number


def quantity_text(value: Any, unit: str | None, digits: int = 3) -> str:
    """A field's value as given: number, list of numbers, or other."""
    if value is None:
        return NONE
    if isinstance(value, list | tuple) and value and all(isinstance(v, int | float) for v in value):
        return listed(value, unit or "", digits)
    if isinstance(value, Mapping) and "currents" in value:  # a curve
        return counted(len(value["currents"]), "point")
    if isinstance(value, bool | str) or not isinstance(value, int | float):
        return str(value)
    return engineering(float(value), unit or "", digits, exact=True)


def with_error(value: float, std: float | None, unit: str) -> str:
    """Value and standard error, both to the error's second digit: "7.82141 ± 0.00065 N/V"; or the value alone."""
    if not std or not math.isfinite(std):
        return engineering(value, unit, 4)
    factor, printed = prefix_of(max(abs(value), std), unit)
    places = max(0, 1 - math.floor(math.log10(std * factor)))
    text = f"{factor * value:.{places}f} ± {factor * std:.{places}f}".replace("-", "\u2212")
    return f"{text}{SPACE}{printed}" if printed else text


def response_unit(channel: str) -> str:
    """SI unit of a channel, or of a response such as "voltage/current"."""
    output, _, given = channel.partition("/")
    if (output, given) == ("voltage", "current"):
        return "ohm"
    return f"{UNITS[output]}/{bracketed(UNITS[given])}" if given else UNITS[output]
