"""Catalogue of parts that can be bought, with their sources, by which shunts in studies may name them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from functools import cache
from typing import Any, NamedTuple

from piezoharvest.description.catalogue import content, toml_files
from piezoharvest.description.diode import exponential_diode
from piezoharvest.description.parameters import ParameterError, check_choice

# A, peak: some volts across the impedance of some 10 nF at some 10 Hz, as most harvesters have.
USUAL_CURRENT = 1e-4
USUAL_SUPPLY = 3.0  # V: two cells, or what a buck converter of a sensor node delivers
# Units of what the files have, but of `count`.
UNITS = {
    "saturation_current": "A", "emission": "", "series_resistance": "ohm", "reverse_conductance": "S",
    "inductance": "H", "winding_resistance": "ohm", "self_resonance": "Hz", "capacitance": "F",
    "leakage_current": "A", "rated_voltage": "V", "on_resistance": "ohm", "gate_charge": "C", "gate_voltage": "V",
    "delay": "s", "supply_current": "A", "count": "",
}  # fmt: skip


class Option(NamedTuple):
    """A key of a shunt beside the name of a part, a number greater than 0."""

    key: str
    unit: str
    usual: float
    doc: str


class Sort(NamedTuple):
    """What shunts may name parts of.

    Attributes
    ----------
    file : str
        TOML file with the parts.
    doc : str
        What is named, in words.
    needed : tuple of str
        Keys of which a kind of shunt must have one to have such a part.
    keys : tuple of str
        Keys of the shunt that stand for the part.
    values : callable
        These keys from the part, the option's value, the clamped capacitance (F, or None where it is not known) and the
        class of the shunt.
    option : Option, optional
    """

    file: str
    doc: str
    needed: tuple[str, ...]
    keys: tuple[str, ...]
    values: Callable[[Mapping[str, Any], float | None, float | None, type], Mapping[str, float]]
    option: Option | None = None


def _diode(part: Mapping[str, Any], current: float | None, capacitance: float | None, cls: type) -> dict[str, float]:
    """The straight line that is best over a half sine of the current, and the conductance backwards."""
    assert current is not None  # or the usual one
    laws = (part[key] for key in ("saturation_current", "emission", "series_resistance"))
    try:
        line = exponential_diode(*laws, peak_current=current)
    except ParameterError as error:
        raise ParameterError("diode_current", error.message) from None
    return {**line.keys, "diode_leakage": part["reverse_conductance"]}


def _coil(part: Mapping[str, Any], option: float | None, capacitance: float | None, cls: type) -> dict[str, float]:
    """As it is where a kind has a winding; where it has a quality, sqrt(L/C)/R."""
    found = {key: part[key] for key in ("inductance", "winding_resistance", "self_resonance")}
    if "winding_resistance" in cls.__dataclass_fields__:
        return found
    if capacitance is None:
        message = "found where the clamped capacitance is not known: give inductance and quality = sqrt(L/C)/R instead"
        raise ParameterError("coil", message)
    quality = (part["inductance"] / capacitance) ** 0.5 / part["winding_resistance"]
    if not quality > 0.5:
        found = f"found a coil of {part['inductance']:g} H and {part['winding_resistance']:g} ohm"
        raise ParameterError("coil", f"{found}, with which {capacitance:g} F do not swing: take a larger inductance")
    return {**found, "quality": quality}


def _capacitor(part: Mapping[str, Any], option: float | None, capacitance: float | None, cls: type) -> dict[str, float]:
    """With its leakage as a conductance; that of several in series is smaller."""
    leakage = part["leakage_current"] / part["rated_voltage"] / getattr(cls, "capacitors", 1)
    return {
        "smoothing_capacitance": part["capacitance"],
        "smoothing_resistance": part["series_resistance"],
        "dc_leakage": leakage,
    }


def _switch(part: Mapping[str, Any], option: float | None, capacitance: float | None, cls: type) -> dict[str, float]:
    """All transistors in line; each gate is charged anew for every action."""
    energy = part["gate_charge"] * part["gate_voltage"]
    return {"switch_resistance": part["count"] * part["on_resistance"], "gate_energy": part["count"] * energy}


def _comparator(
    part: Mapping[str, Any], supply: float | None, capacitance: float | None, cls: type
) -> dict[str, float]:
    """Its delay, and what it takes from its supply."""
    assert supply is not None  # or the usual one
    return {"time_lag": part["delay"], "control_power": part["supply_current"] * supply}


SORTS: Mapping[str, Sort] = {
    "diode": Sort(
        "diodes", "diode", ("diode_drop",), ("diode_drop", "diode_resistance", "diode_leakage"), _diode,
        Option("diode_current", "A", USUAL_CURRENT, "peak of its current"),
    ),
    "coil": Sort(
        "coils", "coil", ("winding_resistance", "quality"),
        ("inductance", "quality", "winding_resistance", "self_resonance"), _coil,
    ),
    "capacitor": Sort(
        "capacitors", "smoothing capacitor", ("smoothing_capacitance",),
        ("smoothing_capacitance", "smoothing_resistance", "dc_leakage"), _capacitor,
    ),
    "switch": Sort(
        "switches", "switch", ("switch_resistance",), ("switch_resistance", "gate_energy"), _switch,
    ),
    "comparator": Sort(
        "comparators", "comparator", ("control_power",), ("time_lag", "control_power"), _comparator,
        Option("comparator_supply", "V", USUAL_SUPPLY, "voltage of its supply"),
    ),
}  # fmt: skip


@cache
def parts(sort: str) -> Mapping[str, Mapping[str, Any]]:
    """Parts of a sort by name, as in its file."""
    return content(toml_files("parts")[SORTS[sort].file])


def sorts_of(fields: Collection[str]) -> dict[str, Sort]:
    """What a kind of shunt with these keys may name, by the key."""
    return {key: sort for key, sort in SORTS.items() if any(needed in fields for needed in sort.needed)}


def with_parts(table: Mapping[str, Any], cls: type, capacitance: float | None = None) -> dict[str, Any]:
    """Keys of a shunt in which those of parts replace their names, as far as the kind has them.

    Parameters
    ----------
    table : mapping
        Keys of a shunt, without its kind.
    cls : type
        Its class.
    capacitance : float, optional
        Clamped capacitance of its electrodes, F, from which the quality of a coil follows.

    Raises
    ------
    ParameterError
        There is no such part, the kind has none, or the table gives the keys itself.
    """
    values = dict(table)
    for key in SORTS:
        values = _with_part(values, key, cls, capacitance)
    return values


def _with_part(table: dict[str, Any], key: str, cls: type, capacitance: float | None) -> dict[str, Any]:
    """The same for parts of one sort."""
    sort, option, fields = SORTS[key], SORTS[key].option, cls.__dataclass_fields__
    if key not in table:
        if option and option.key in table and option.key not in fields:
            raise ParameterError(option.key, f"found without {key}, which must be named with it")
        return table
    name = table.pop(key)
    if not any(needed in fields for needed in sort.needed):
        raise ParameterError(key, f"found {name!r:.60}, but this kind of shunt has no {sort.doc}")
    check_choice(key, name, parts(key))
    for given in sort.keys:
        if given in table:
            raise ParameterError(given, f"found together with {key}, which gives it too: remove one of the two")
    number = None if option is None else _number(table.pop(option.key, option.usual), option)
    found = sort.values(parts(key)[name], number, capacitance, cls)
    return {**table, **{each: value for each, value in found.items() if each in fields}}


def _number(value: Any, option: Option) -> float:
    """The value of an option."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < float("inf"):
        raise ParameterError(option.key, f"found {value!r}, must be a finite number greater than 0 {option.unit}")
    return float(value)
