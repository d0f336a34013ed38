"""Catalogue of parts that can be bought, with their sources, by which shunts in studies may name them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import cache
from typing import Any

from piezoharvest.description.catalogue import content, toml_files
from piezoharvest.description.diode import exponential_diode
from piezoharvest.description.parameters import ParameterError, check_choice

DIODE, CURRENT = "diode", "diode_current"
KEYS = ("diode_drop", "diode_resistance", "diode_leakage")  # that stand for a diode
# A, peak: some volts across the impedance of some 10 nF at some 10 Hz, as most harvesters have.
USUAL_CURRENT = 1e-4


@cache
def diodes() -> Mapping[str, Mapping[str, Any]]:
    """Diodes by name, as in diodes.toml."""
    return content(toml_files("parts")["diodes"])


def with_parts(table: Mapping[str, Any], fields: Collection[str]) -> dict[str, Any]:
    """Keys of a shunt in which those of a diode replace its name.

    `diode = "BAT54"` gives the straight line that is best over a half sine of the current with the peak `diode_current`
    (A), and the conductance backwards where the kind has one.

    Parameters
    ----------
    table : mapping
        Keys of a shunt, without its kind.
    fields : collection of str
        Keys that its kind has.

    Raises
    ------
    ParameterError
        There is no such diode, the kind has none, or the table gives the keys itself.
    """
    values = dict(table)
    if DIODE not in values:
        if CURRENT in values and CURRENT not in fields:
            raise ParameterError(CURRENT, f"found without {DIODE}, which must name the diode of this peak current")
        return values
    name, current = values.pop(DIODE), values.pop(CURRENT, USUAL_CURRENT)
    if KEYS[0] not in fields:
        raise ParameterError(DIODE, f"found {name!r:.60}, but this kind of shunt has no diodes")
    check_choice(DIODE, name, diodes())
    for key in KEYS:
        if key in values:
            raise ParameterError(key, f"found together with {DIODE}, which gives it too: remove one of the two")
    if isinstance(current, bool) or not isinstance(current, int | float) or not current > 0:
        raise ParameterError(CURRENT, f"found {current!r}, must be a finite number greater than 0 A")
    part = diodes()[name]
    laws = (part[key] for key in ("saturation_current", "emission", "series_resistance"))
    try:
        line = exponential_diode(*laws, peak_current=float(current))
    except ParameterError as error:
        raise ParameterError(CURRENT, error.message) from None
    found = {**line.keys, "diode_leakage": part["reverse_conductance"]}
    return {**values, **{key: value for key, value in found.items() if key in fields}}
