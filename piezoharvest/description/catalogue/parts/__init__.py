"""Catalogue of parts that can be bought, with their sources, by which shunts in studies may name them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

from piezoharvest.description.catalogue import content, toml_files
from piezoharvest.description.diode import exponential_curve, exponential_diode
from piezoharvest.description.parameters import ParameterError, check_choice
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.curves.curved import takes_diode_curve

USUAL_SUPPLY = 3.0  # V: two cells, or what a buck converter of a sensor node delivers
# Units of what the files have, but of `count`.
UNITS = {
    "saturation_current": "A", "emission": "", "series_resistance": "ohm", "reverse_conductance": "S",
    "inductance": "H", "winding_resistance": "ohm", "self_resonance": "Hz", "capacitance": "F",
    "leakage_current": "A", "rated_voltage": "V", "on_resistance": "ohm", "gate_charge": "C", "gate_voltage": "V",
    "delay": "s", "supply_current": "A", "count": "",
}  # fmt: skip


class Option(NamedTuple):
    """A key of a shunt beside the name of a part, a number greater than 0; `usual` is None where it has no default."""

    key: str
    unit: str
    usual: float | None
    doc: str


class ShuntTable(NamedTuple):
    """Where a part is: the class of the shunt, its table, and the clamped capacitance (F) where it is known."""

    cls: type[Shunt]
    table: Mapping[str, Any]
    capacitance: float | None


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
        These keys from the part, the option's value and the place.
    option : Option, optional
    """

    file: str
    doc: str
    needed: tuple[str, ...]
    keys: tuple[str, ...]
    values: Callable[[Mapping[str, Any], float | None, ShuntTable], Mapping[str, Any]]
    option: Option | None = None


def _diode(part: Mapping[str, Any], current: float | None, place: ShuntTable) -> dict[str, Any]:
    """The law as a broken line, or as the straight one for a current, and what it passes backwards."""
    law = [part[key] for key in ("saturation_current", "emission", "series_resistance")]
    backwards = {"diode_leakage": part.get("reverse_conductance", 0.0), "diode_saturation": part["saturation_current"]}
    if current is not None:
        try:
            line = exponential_diode(*law, peak_current=current)
        except ParameterError as error:
            raise ParameterError("diode_current", error.message) from None
        constant = "diode_resistance" not in place.cls.__dataclass_fields__
        return {**line.keys, **backwards, **({"diode_drop": line.mean_drop(current)} if constant else {})}
    if "storage" in place.table or not takes_diode_curve(place.cls):
        where = "with storage" if "storage" in place.table else "in this kind of shunt"
        needed = 'give the peak of the current to which it is fitted, such as "1 mA"'
        raise ParameterError("diode_current", f"missing key, {where} a diode is a straight line: {needed}")
    curve = exponential_curve(*law)
    # The current of a path has what the blocking diodes pass in it.
    currents = [0.0, *(float(f"{each + law[0]:.6g}") for each in curve.currents[1:])]
    return {"diode_curve": {"currents": currents, "voltages": [*curve.voltages]}, **backwards}


def _coil(part: Mapping[str, Any], option: float | None, place: ShuntTable) -> dict[str, float]:
    """As it is where a kind has a winding; where it has a quality, sqrt(L/C)/R."""
    found = {key: part[key] for key in ("inductance", "winding_resistance", "self_resonance")}
    capacitance = place.capacitance
    if "winding_resistance" in place.cls.__dataclass_fields__:
        return found
    if not {"switch", "switch_resistance"} & set(place.table):
        found = "missing key, the winding of a coil by name is charged through a switch"
        raise ParameterError("switch", f'{found}: name one, such as "2N7002W", or give switch_resistance')
    if capacitance is None:
        message = "found where the clamped capacitance is not known: give inductance and quality = sqrt(L/C)/R instead"
        raise ParameterError("coil", message)
    quality = (part["inductance"] / capacitance) ** 0.5 / part["winding_resistance"]
    if not quality > 0.5:
        found = f"found a coil of {part['inductance']:g} H and {part['winding_resistance']:g} ohm"
        raise ParameterError("coil", f"{found}, with which {capacitance:g} F do not swing: take a larger inductance")
    return {**found, "quality": quality}


def _capacitor(part: Mapping[str, Any], option: float | None, place: ShuntTable) -> dict[str, float]:
    """With its leakage as a conductance; that of several in series is smaller."""
    leakage = part["leakage_current"] / part["rated_voltage"] / getattr(place.cls, "capacitors", 1)
    return {
        "smoothing_capacitance": part["capacitance"],
        "smoothing_resistance": part["series_resistance"],
        "dc_leakage": leakage,
    }


def _switch(part: Mapping[str, Any], option: float | None, place: ShuntTable) -> dict[str, float]:
    """All transistors in line; each gate is charged anew for every action."""
    energy = part["gate_charge"] * part["gate_voltage"]
    return {"switch_resistance": part["count"] * part["on_resistance"], "gate_energy": part["count"] * energy}


def _comparator(part: Mapping[str, Any], supply: float | None, place: ShuntTable) -> dict[str, float]:
    """Its delay, and what it takes from its supply."""
    assert supply is not None  # or the usual one
    return {"time_lag": part["delay"], "control_power": part["supply_current"] * supply}


SORTS: Mapping[str, Sort] = {
    "diode": Sort(
        "diodes", "diode", ("diode_drop",),
        ("diode_drop", "diode_resistance", "diode_leakage", "diode_saturation", "diode_curve"), _diode,
        Option("diode_current", "A", None, "peak of its current, for which it is a straight line instead of a curve"),
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


def with_parts(table: Mapping[str, Any], cls: type[Shunt], capacitance: float | None = None) -> dict[str, Any]:
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


def _with_part(table: dict[str, Any], key: str, cls: type[Shunt], capacitance: float | None) -> dict[str, Any]:
    """The same for parts of one sort."""
    sort, option, fields = SORTS[key], SORTS[key].option, cls.__dataclass_fields__
    if key not in table:
        if option and option.key in table and option.key not in fields:
            raise ParameterError(option.key, f"found without {key}, which must be named with it")
        return table
    name = table.pop(key)
    if not any(needed in fields for needed in sort.needed):
        raise ParameterError(key, f"found {name!r:.60}, but this kind of shunt has no {sort.doc}")
    _check_name(key, name, [own for own in sort.keys if own in fields])
    for own in sort.keys:
        if own in table:
            raise ParameterError(own, f"found together with {key}, which gives it too: remove one of the two")
    given = None if option is None else table.pop(option.key, option.usual)
    number = None if option is None or given is None else _number(given, option)
    found = sort.values(parts(key)[name], number, ShuntTable(cls, table, capacitance))
    return {**table, **{each: value for each, value in found.items() if each in fields}}


def _check_name(key: str, name: Any, keys: Sequence[str]) -> None:
    """Raise `ParameterError` unless the catalogue has a part of this name; `keys` describe another one."""
    try:
        check_choice(key, name, parts(key))
    except ParameterError as error:
        raise ParameterError(key, f"{error.message}; another one is described by {', '.join(keys)}") from None


def sort_of(name: Any) -> str | None:
    """Key that names a part, if the catalogue has one of this name."""
    return next((key for key in SORTS if isinstance(name, str) and name in parts(key)), None)


def _number(value: Any, option: Option) -> float:
    """The value of an option."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < float("inf"):
        raise ParameterError(option.key, f"found {value!r}, must be a finite number greater than 0 {option.unit}")
    return float(value)
