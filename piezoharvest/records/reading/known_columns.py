"""Columns of a frequency response or an impedance by the names that analysers give them, where a campaign names none.

Keysight E4990A, help on "Saving trace data to a file" (helpfiles.keysight.com) and files of its users:
`|Z|(Ohm)-data`, `theta-z(deg)-data`, `Z-Real(Ohm)-data`, `Cp(F)-data`, `D()-data`. OMICRON Bode Analyzer Suite, by
analogy to the gain in files of its users, of version 3 (`Trace 1: Gain: Magnitude (dB)`): `Trace 1: Impedance:
Magnitude (Ω)`; of version 2 (`TR1: Gain (Real),TR1: Gain (Imag),TR1: Gain (dB),TR2: Gain (Degree)`): `TR1: Impedance
(Ohm)`. Of LCR meters, as Hioki's, no file was seen: their usual names are taken, Z, PHASE or theta, R or Rs, X, Cp, Cs,
Lp, Ls, Rp, D, Q, G, B and Y, with a unit where they have one. German names are those of the quantities. The siemens is
known in this list alone: elsewhere an "S" is more likely a second.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType

from piezoharvest.readers import Reader
from piezoharvest.readers.units import stated_unit

_ANY_TRACE = r"(?:trace \d+: |tr\d+: )?"
_TRACE = rf"{_ANY_TRACE}impedance(?:: ?| ?\()"
_ADMITTANCE = rf"{_ANY_TRACE}admittance(?:: ?| ?\()"
_ANY = rf"{_ANY_TRACE}(?:impedance|admittance): ?"
_TANGENT = r"tan ?\(?\u03b4\)?"
_SIEMENS = r"(?: ?[(\[](?:s|siemens)[)\]])?(?:-data)?"
_GAIN = rf"{_ANY_TRACE}(?:gain|frf|h1|h2|hv|transfer function|frequency response|response)(?:[:, ] ?| ?\()"
_RATIO = r"(?:receptance|mobility|accelerance|inertance|compliance)"
# Names without their units, in lower case, and the SI unit that the file states for them. A phase has to state it: a
# number may be degrees or radians. A name alone, as "R", may state none.
_NAMES: Mapping[str, tuple[re.Pattern[str], str, bool]] = MappingProxyType({
    "frequency": (re.compile(r"f|freq\.?|frequency(?:: trace \d+)?|frequenz"), "Hz", False),
    "real": (re.compile(rf"r|rs|z-real|re\(z\)|resistance|wirkwiderstand|{_TRACE}real\)?"), "ohm", False),
    "imaginary": (re.compile(
        rf"x|xs|z-imag|im\(z\)|reactance|blindwiderstand|{_TRACE}imag(?:inary)?\)?"), "ohm", False),
    "magnitude": (re.compile(
        rf"z|\|z\||{_ANY_TRACE}impedance|impedanz|scheinwiderstand|{_TRACE}magnitude"), "ohm", False),
    "phase": (re.compile(
        rf"phase|phasenwinkel|theta|\u03b8|theta-?z|\u03b8z|z-?phase|tr\d+: impedance|{_TRACE}phase"), "rad", True),
    "admittance": (re.compile(rf"(?:y|\|y\||{_ANY_TRACE}admittance|{_ADMITTANCE}magnitude){_SIEMENS}"), "S", False),
    "admittance_phase": (re.compile(rf"theta-?y|\u03b8y|y-?phase|tr\d+: admittance|{_ADMITTANCE}phase"), "rad", True),
    "conductance": (re.compile(rf"(?:g|y-real|re\(y\)|conductance|{_ADMITTANCE}real\)?){_SIEMENS}"), "S", False),
    "susceptance": (re.compile(
        rf"(?:b|y-imag|im\(y\)|susceptance|{_ADMITTANCE}imag(?:inary)?\)?){_SIEMENS}"), "S", False),
    "parallel_capacitance": (re.compile(rf"cp|parallel capacitance|{_ANY}cp"), "F", False),
    "series_capacitance": (re.compile(rf"cs|series capacitance|{_ANY}cs"), "F", False),
    "parallel_inductance": (re.compile(rf"lp|parallel inductance|{_ANY}lp"), "H", False),
    "series_inductance": (re.compile(rf"ls|series inductance|{_ANY}ls"), "H", False),
    "parallel_resistance": (re.compile(rf"rp|parallel resistance|{_ANY}rp"), "ohm", False),
    "loss_factor": (re.compile(rf"(?:d|df|{_TANGENT}|loss factor|{_ANY}{_TANGENT})(?:\(\))?(?:-data)?"), "", False),
    "quality_factor": (re.compile(rf"(?:q|quality factor|{_ANY}q)(?:\(\))?(?:-data)?"), "", False),
})  # fmt: skip


# Of a frequency response, of whichever unit; a magnitude may be a level.
_FRF_NAMES: Mapping[str, tuple[re.Pattern[str], str, bool]] = MappingProxyType({
    "frequency": _NAMES["frequency"],
    "real": (re.compile(rf"(?:{_RATIO} )?real(?: part)?|re|realteil|{_GAIN}real(?: part)?\)?"), "", False),
    "imaginary": (re.compile(
        rf"(?:{_RATIO} )?imag(?:inary)?(?: part)?|im|imagin\u00e4rteil|{_GAIN}imag(?:inary)?(?: part)?\)?"), "", False),
    "magnitude": (re.compile(
        rf"mag(?:nitude)?\.?|amp(?:litude|l\.)?|gain|abs|betrag|h1|h2|hv|frf|{_ANY_TRACE}gain|{_GAIN}mag(?:nitude)?"
        rf"|\|?{_RATIO}\|?(?: (?:mag(?:nitude)?|amp(?:litude)?|abs)\.?)?"), "", False),
    "phase": (re.compile(rf"(?:{_RATIO} )?phase|phase angle|phasenwinkel|angle|tr\d+: gain|{_GAIN}phase"), "rad", True),
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
