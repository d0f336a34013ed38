"""Units as instruments write them into files: in brackets after a name, in a separate row, or as a suffix."""

from __future__ import annotations

import math
import re
import unicodedata
from typing import NamedTuple

_PREFIXES = {"p": 1e-12, "n": 1e-9, "u": 1e-6, "\u03bc": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6, "G": 1e9}
_LONG_PREFIXES = {"pico": 1e-12, "nano": 1e-9, "micro": 1e-6, "milli": 1e-3, "kilo": 1e3, "mega": 1e6}
# Symbols that take prefixes, and words in any case with or without a plural s: SI unit and factor. Units that no
# channel is measured in are included, so that they are recognised as wrong for a channel.
_SYMBOLS = {
    "s": ("s", 1.0), "N": ("N", 1.0), "m": ("m", 1.0), "V": ("V", 1.0), "A": ("A", 1.0), "Hz": ("Hz", 1.0),
    "ohm": ("ohm", 1.0), "Ohm": ("ohm", 1.0), "\u03a9": ("ohm", 1.0), "g": ("m/s^2", 9.80665),
    "W": ("W", 1.0), "Pa": ("Pa", 1.0), "F": ("F", 1.0), "H": ("H", 1.0), "C": ("C", 1.0), "rad": ("rad", 1.0),
    "strain": ("strain", 1.0), "\u03b5": ("strain", 1.0),
}  # fmt: skip
_WORDS = {
    "second": ("s", 1.0), "sec": ("s", 1.0), "min": ("s", 60.0), "minute": ("s", 60.0), "newton": ("N", 1.0),
    "lbf": ("N", 4.4482216152605), "kgf": ("N", 9.80665), "meter": ("m", 1.0), "metre": ("m", 1.0),
    "cm": ("m", 1e-2), "inch": ("m", 0.0254), "volt": ("V", 1.0), "amp": ("A", 1.0), "ampere": ("A", 1.0),
    "hertz": ("Hz", 1.0), "hz": ("Hz", 1.0), "khz": ("Hz", 1e3), "ohm": ("ohm", 1.0), "radian": ("rad", 1.0),
    "deg": ("rad", math.pi / 180), "degree": ("rad", math.pi / 180), "°": ("rad", math.pi / 180),
    "db": ("dB", 1.0), "%": ("%", 1.0), "°c": ("degC", 1.0), "siemens": ("S", 1.0), "g_0": ("m/s^2", 9.80665),
    "strain": ("strain", 1.0),
}  # fmt: skip
# Levels: "dB re 1 g/N", "dB re. 1e-6 m/N", "dB ref (m/s)/N", "dB (m/N)".
_LEVEL = re.compile(
    r"db\s*(?:\bre[fl]?\b\.?:?\s*|(?=[(\[]))(?P<size>\d[\d.]*(?:e[+-]?\d+)?\s+)?(?P<unit>\S.*)", re.IGNORECASE
)
_COMPOUND = {"rad/s": ("Hz", 0.5 / math.pi), "rpm": ("Hz", 1 / 60)}
# A mobility or an accelerance with all that it is divided by in brackets: "m/(s*N)", "mm/(N s^2)".
_BELOW = re.compile(r"(\w*m)\s*/\s*\(\s*(?:(s\^?2?)\s*[*·⋅ ]\s*(\w*N)|(\w*N)\s*[*·⋅ ]\s*(s\^?2?))\s*\)")
_ACCELERATION = re.compile(r"(\w*m)\s*(?:/|\s|per|_per_|_)\s*s\s*(?:\^|\*\*)?-?\s*2")
_SPEED = re.compile(r"(\w*m)\s*(?:/|per|_per_|_)\s*s")
_BRACKETS = re.compile(r"(.*?)\s*(?:\(([^()]+|[^()]*\([^()]*\)[^()]*)\)|\[([^][]+)\])\s*(?:-data)?\s*", re.S)
_BEHIND = re.compile(r"(.*\S)\s*(?:\s/\s*|/(?=\S+$)|\sin\s+|,\s+)(\S+)", re.S)


class Unit(NamedTuple):
    """A unit that a file states.

    Attributes
    ----------
    text : str
        As written in the file.
    si : str
        SI unit of the quantity, as `records.channels` writes it.
    factor : float
        Factor from this unit to the SI unit.
    firm : bool
        True if it can only be a unit: the end of a name such as "force_A" may be something else.
    of : str
        SI unit of what a level in "dB" is of, if the file states it; `factor` is then the size of 0 dB.
    """

    text: str
    si: str
    factor: float
    firm: bool = True
    of: str = ""


def unit_of(text: str) -> Unit | None:
    """Unit with this text, or None if it is unknown."""
    cleaned = text.strip()
    if not 0 < len(cleaned) <= 32:
        return None
    plain = unicodedata.normalize("NFKC", cleaned)  # one sign for micro, for ohm, and 2 for its superscript
    plain = re.sub(r"(?i)(db)\s*\((re[fl]?\b.*)\)", r"\1 \2", plain)  # "dB (re 1 m/N)"
    if level := _LEVEL.fullmatch(plain):
        zero = unit_of(_without_brackets(level["unit"]))
        size = float(level["size"] or 1.0) if zero is not None else 0.0
        return Unit(cleaned, "dB", size * zero.factor, of=zero.si) if zero is not None and zero.si != "dB" else None
    found = _COMPOUND.get(plain) or _simple(plain) or _motion(plain) or _ratio(plain)
    return None if found is None else Unit(cleaned, *found)


def stated_unit(name: str) -> tuple[str, Unit | None]:
    """Name of a column without the unit in it, and that unit."""
    if len(name) > 200:
        return name, None
    if match := _BRACKETS.fullmatch(name):
        unit = unit_of(match[2] or match[3])
        if unit is not None and match[1]:
            return match[1], unit
    if (match := _BEHIND.fullmatch(name)) and (unit := unit_of(match[2])) is not None:
        return match[1].strip(), unit
    for n, mark in enumerate(name):
        if mark == "_" and n > 0 and (unit := unit_of(name[n + 1 :])) is not None:
            return name[:n], unit._replace(firm=unit.si == "dB")  # which is nothing else
    return name, None


def ratio_of(above: str, below: str) -> str:
    """Unit of a ratio, as of a frequency response: "m/N", "(m/s)/N"."""
    return f"{bracketed(above)}/{bracketed(below)}"


def bracketed(unit: str) -> str:
    """A unit as it stands in a ratio: in brackets where it is none of one word."""
    return f"({unit})" if re.search(r"[/ *]", unit) else unit


def _simple(text: str) -> tuple[str, float] | None:
    """SI unit and factor of a symbol or a word, with or without a prefix."""
    if text in _SYMBOLS:
        return _SYMBOLS[text]
    if text[:1] in _PREFIXES and text[1:] in _SYMBOLS and text != "min":
        si, factor = _SYMBOLS[text[1:]]
        return si, factor * _PREFIXES[text[0]]
    word, scale = text.lower(), 1.0
    for prefix, size in _LONG_PREFIXES.items():
        if word.startswith(prefix):
            word, scale = word.removeprefix(prefix), size
    found = _WORDS.get(word) or _WORDS.get(word.removesuffix("s")) if len(word) > 1 or word in _WORDS else None
    return None if found is None else (found[0], scale * found[1])


def _motion(text: str) -> tuple[str, float] | None:
    """SI unit and factor of a speed or an acceleration."""
    for pattern, si in ((_ACCELERATION, "m/s^2"), (_SPEED, "m/s")):
        if match := pattern.fullmatch(text):
            length = _simple(match[1])
            return None if length is None or length[0] != "m" else (si, length[1])
    return None


def _ratio(text: str) -> tuple[str, float] | None:
    """SI unit and factor of a quotient of two units, as of a frequency response."""
    if match := _BELOW.fullmatch(text):
        text = f"{match[1]}/{match[2] or match[5]}/{match[3] or match[4]}"
    for slash in (n for n, mark in enumerate(text) if mark == "/"):
        parts = [_without_brackets(part) for part in (text[:slash], text[slash + 1 :])]
        found = [_simple(part) or _motion(part) for part in parts]
        if found[0] is not None and found[1] is not None:
            same = found[0][0] == found[1][0] == "m"  # a micrometre per metre is a strain
            return "strain" if same else ratio_of(found[0][0], found[1][0]), found[0][1] / found[1][1]
    return None


def _without_brackets(text: str) -> str:
    """A text without blanks, and without one pair of brackets, around it."""
    text = text.strip()
    pair = len(text) > 1 and text[0] + text[-1] in ("()", "[]") and not re.search(r"[()\[\]]", text[1:-1])
    return text[1:-1] if pair else text
