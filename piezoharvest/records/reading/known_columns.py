"""Columns of a frequency response or an impedance by the names that analysers give them, where a campaign names none.

Keysight E4990A, help on "Saving trace data to a file" (helpfiles.keysight.com) and files of its users:
`|Z|(Ohm)-data`, `theta-z(deg)-data`, `Z-Real(Ohm)-data`, `Cp(F)-data`, `D()-data`. OMICRON Bode Analyzer Suite, by
analogy to the gain in files of its users, of version 3 (`Trace 1: Gain: Magnitude (dB)`): `Trace 1: Impedance:
Magnitude (Ω)`; of version 2 (`TR1: Gain (Real),TR1: Gain (Imag),TR1: Gain (dB),TR2: Gain (Degree)`): `TR1: Impedance
(Ohm)`. Of LCR meters, as Hioki's, no file was seen: their usual names are taken, Z, PHASE or theta, R or Rs, X, Cp, Cs,
Lp, Ls, Rp, D, Q, G, B and Y, with a unit where they have one. German names are those of the quantities and, by analogy,
of the Bode Analyzer Suite: `Trace 1: Impedanz: Betrag (Ω)`. The siemens is known in this list alone: elsewhere an "S"
is more likely a second.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType

from piezoharvest.readers import Reader
from piezoharvest.readers.units import stated_unit

_ANY_TRACE = r"(?:(?:trace|(?:mess)?kurve) \d+: |tr\d+: )?"
_TRACE = rf"{_ANY_TRACE}impedan(?:ce|z)(?:: ?| ?\()"
_ADMITTANCE = rf"{_ANY_TRACE}admittan(?:ce|z)(?:: ?| ?\()"
_ANY = rf"{_ANY_TRACE}(?:impedan|admittan)(?:ce|z): ?"
_REAL = r"real(?: part|teil)?"
_IMAGINARY = r"imag(?:inary|in\u00e4r)?(?: part|teil)?"
_SIZE = r"(?:mag(?:nitude)?|betrag)"
_ANGLE = r"phase(?:nwinkel)?"
_TANGENT = r"tan ?\(?\u03b4\)?"
_SIEMENS = r"(?: ?[(\[](?:s|siemens)[)\]])?(?:-data)?"
_TRANSFER = r"(?:gain|verst\u00e4rkung|frf|h1|h2|hv|transfer function|frequency response|frequenzgang|response)"
_GAIN = rf"{_ANY_TRACE}{_TRANSFER}(?:[:, ] ?| ?\()"
_RATIO = r"(?:receptance|mobility|accelerance|inertance|compliance)"
# Names without their units, in lower case, and the SI unit that the file states for them. A phase has to state it: a
# number may be degrees or radians. A name alone, as "R", may state none.
_NAMES: Mapping[str, tuple[re.Pattern[str], str, bool]] = MappingProxyType({
    "frequency": (re.compile(r"f|freq\.?|(?:frequency|frequenz)(?:: (?:trace|(?:mess)?kurve) \d+)?"), "Hz", False),
    "real": (re.compile(rf"r|rs|z-real|re\(z\)|resistance|wirkwiderstand|{_TRACE}{_REAL}\)?"), "ohm", False),
    "imaginary": (re.compile(
        rf"x|xs|z-imag|im\(z\)|reactance|blindwiderstand|{_TRACE}{_IMAGINARY}\)?"), "ohm", False),
    "magnitude": (re.compile(
        rf"z|\|z\||{_ANY_TRACE}impedan(?:ce|z)|scheinwiderstand|{_TRACE}{_SIZE}"), "ohm", False),
    "phase": (re.compile(
        rf"phase|phasenwinkel|theta|\u03b8|theta-?z|\u03b8z|z-?phase"
        rf"|tr\d+: impedan(?:ce|z)|{_TRACE}{_ANGLE}"), "rad", True),
    "admittance": (re.compile(rf"(?:y|\|y\||{_ANY_TRACE}admittan(?:ce|z)|{_ADMITTANCE}{_SIZE}){_SIEMENS}"), "S", False),
    "admittance_phase": (re.compile(
        rf"theta-?y|\u03b8y|y-?phase|tr\d+: admittan(?:ce|z)|{_ADMITTANCE}{_ANGLE}"), "rad", True),
    "conductance": (re.compile(
        rf"(?:g|y-real|re\(y\)|conductance|wirkleitwert|{_ADMITTANCE}{_REAL}\)?){_SIEMENS}"), "S", False),
    "susceptance": (re.compile(
        rf"(?:b|y-imag|im\(y\)|susceptance|blindleitwert|{_ADMITTANCE}{_IMAGINARY}\)?){_SIEMENS}"), "S", False),
    "parallel_capacitance": (re.compile(rf"cp|parallel capacitance|parallelkapazit\u00e4t|{_ANY}cp"), "F", False),
    "series_capacitance": (re.compile(rf"cs|series capacitance|serienkapazit\u00e4t|{_ANY}cs"), "F", False),
    "parallel_inductance": (re.compile(rf"lp|parallel inductance|parallelinduktivit\u00e4t|{_ANY}lp"), "H", False),
    "series_inductance": (re.compile(rf"ls|series inductance|serieninduktivit\u00e4t|{_ANY}ls"), "H", False),
    "parallel_resistance": (re.compile(rf"rp|parallel resistance|parallelwiderstand|{_ANY}rp"), "ohm", False),
    "loss_factor": (re.compile(
        rf"(?:d|df|{_TANGENT}|loss factor|verlustfaktor|{_ANY}{_TANGENT})(?:\(\))?(?:-data)?"), "", False),
    "quality_factor": (re.compile(
        rf"(?:q|quality factor|g\u00fctefaktor|g\u00fcte|{_ANY}q)(?:\(\))?(?:-data)?"), "", False),
})  # fmt: skip


# Of a frequency response, of whichever unit; a magnitude may be a level.
_FRF_NAMES: Mapping[str, tuple[re.Pattern[str], str, bool]] = MappingProxyType({
    "frequency": _NAMES["frequency"],
    "real": (re.compile(rf"(?:{_RATIO} )?{_REAL}|re|{_GAIN}{_REAL}\)?"), "", False),
    "imaginary": (re.compile(
        rf"(?:{_RATIO} )?{_IMAGINARY}|im|{_GAIN}{_IMAGINARY}\)?"), "", False),
    "magnitude": (re.compile(
        rf"mag(?:nitude)?\.?|amp(?:litude|l\.)?|gain|abs|betrag|h1|h2|hv|frf"
        rf"|{_ANY_TRACE}(?:gain|verst\u00e4rkung)|{_GAIN}{_SIZE}"
        rf"|\|?{_RATIO}\|?(?: (?:mag(?:nitude)?|amp(?:litude)?|abs)\.?)?"), "", False),
    "phase": (re.compile(
        rf"(?:{_RATIO} )?phase|phase angle|phasenwinkel|angle|tr\d+: gain|{_GAIN}{_ANGLE}"), "rad", True),
    "coherence": (re.compile(r"coherence|koh\u00e4renz|coh\.?|gamma\^?2"), "", False),
})  # fmt: skip


def known_column(reader: Reader, part: str, kind: str = "impedance") -> str | None:
    """The first column that is named like a part of a response and has its unit; None if there is none.

    Parameters
    ----------
    reader : Reader
    part : str
        "frequency", "real", "imaginary", "magnitude", "phase" or "coherence".
    kind : "impedance" or "frf"
    """
    names = _NAMES if kind == "impedance" else _FRF_NAMES
    if part not in names:
        return None
    pattern, si, stated = names[part]
    for n, name in enumerate(reader.names, start=1):
        bare = stated_unit(name)[0].strip().strip('"').strip().lower()
        if pattern.fullmatch(bare):
            column = reader.resolve(n)
            unit = reader.unit(column)
            fits = not stated if unit is None else si == unit.si or (si == "" and unit.si != "rad")
            if fits:
                return column
    return None
