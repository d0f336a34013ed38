"""Columns of a frequency response or an impedance by the names that analysers give them, where a campaign names none.

Keysight E4990A, help on "Saving trace data to a file" (helpfiles.keysight.com): `|Z|(Ohm)-data`, `theta-z(deg)-data`,
`Z-Real(Ohm)-data`, `Cp(F)-data`, `D-data`. OMICRON Bode Analyzer Suite, by analogy to the gain in its users' files
(`Trace 1: Gain: Magnitude (dB)`): `Trace 1: Impedance: Magnitude (Ω)`. Of LCR meters, as Hioki's, no file was seen:
their usual names are taken, Z, PHASE or theta, R or Rs, X, Cp, Cs, Lp, Ls, Rp, D, Q, G, B and Y, with a unit where they
have one. The siemens is known in this list alone: elsewhere an "S" is more likely a second.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType

from piezoharvest.readers import Reader
from piezoharvest.readers.units import stated_unit

_TRACE = r"(?:trace \d+: )?impedance: ?"
_ADMITTANCE = r"(?:trace \d+: )?admittance: ?"
_ANY = r"(?:trace \d+: )?(?:impedance|admittance): ?"
_TANGENT = r"tan ?\(?\u03b4\)?"
_SIEMENS = r"(?: ?[(\[](?:s|siemens)[)\]])?(?:-data)?"
_GAIN = r"(?:trace \d+: )?(?:gain|frf|h1|h2|transfer function|response)[:, ] ?"
# Names without their units, in lower case, and the SI unit that the file states for them. A phase has to state it: a
# number may be degrees or radians. A name alone, as "R", may state none.
_NAMES: Mapping[str, tuple[re.Pattern[str], str, bool]] = MappingProxyType({
    "frequency": (re.compile(r"f|freq\.?|frequency(?:: trace \d+)?"), "Hz", False),
    "real": (re.compile(rf"r|rs|z-real|re\(z\)|resistance|{_TRACE}real"), "ohm", False),
    "imaginary": (re.compile(rf"x|xs|z-imag|im\(z\)|reactance|{_TRACE}imaginary"), "ohm", False),
    "magnitude": (re.compile(rf"z|\|z\||impedance|{_TRACE}magnitude"), "ohm", False),
    "phase": (re.compile(rf"phase|theta|\u03b8|theta-?z|\u03b8z|z-?phase|{_TRACE}phase"), "rad", True),
    "admittance": (re.compile(rf"(?:y|\|y\||admittance|{_ADMITTANCE}magnitude){_SIEMENS}"), "S", False),
    "admittance_phase": (re.compile(rf"theta-?y|\u03b8y|y-?phase|{_ADMITTANCE}phase"), "rad", True),
    "conductance": (re.compile(rf"(?:g|y-real|re\(y\)|conductance|{_ADMITTANCE}real){_SIEMENS}"), "S", False),
    "susceptance": (re.compile(rf"(?:b|y-imag|im\(y\)|susceptance|{_ADMITTANCE}imaginary){_SIEMENS}"), "S", False),
    "parallel_capacitance": (re.compile(rf"cp|parallel capacitance|{_ANY}cp"), "F", False),
    "series_capacitance": (re.compile(rf"cs|series capacitance|{_ANY}cs"), "F", False),
    "parallel_inductance": (re.compile(rf"lp|parallel inductance|{_ANY}lp"), "H", False),
    "series_inductance": (re.compile(rf"ls|series inductance|{_ANY}ls"), "H", False),
    "parallel_resistance": (re.compile(rf"rp|parallel resistance|{_ANY}rp"), "ohm", False),
    "loss_factor": (re.compile(rf"(?:d|df|{_TANGENT}|loss factor|{_ANY}{_TANGENT})(?:-data)?"), "", False),
    "quality_factor": (re.compile(rf"(?:q|quality factor|{_ANY}q)(?:-data)?"), "", False),
})  # fmt: skip


# Of a frequency response, of whichever unit; a magnitude may be a level.
_FRF_NAMES: Mapping[str, tuple[re.Pattern[str], str, bool]] = MappingProxyType({
    "frequency": _NAMES["frequency"],
    "real": (re.compile(rf"real(?: part)?|re|{_GAIN}real(?: part)?"), "", False),
    "imaginary": (re.compile(rf"imag(?:inary)?(?: part)?|im|{_GAIN}imag(?:inary)?(?: part)?"), "", False),
    "magnitude": (re.compile(rf"mag(?:nitude)?\.?|amp(?:litude|l\.)?|gain|abs|{_GAIN}mag(?:nitude)?"), "", False),
    "phase": (re.compile(rf"phase|phase angle|angle|{_GAIN}phase"), "rad", True),
    "coherence": (re.compile(r"coherence|coh\.?|gamma\^?2"), "", False),
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
            if si in ("", unit.si) if unit is not None else not stated:
                return column
    return None
