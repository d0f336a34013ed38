"""Single values within components by name: a field, one of its list as in "inductances.0", or "others.0.resistance"."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, TypeVar, get_origin, get_type_hints

import numpy as np

from piezoharvest.description.parameters import Component

_C = TypeVar("_C", bound=Component)


def value_at(part: Component, name: str) -> Any:
    """Value of a field, or of one entry of its list."""
    part, name = owner(part, name)
    field, _, place = name.partition(".")
    value = getattr(part, field)
    return value[int(place)] if place else value


def split(name: str) -> tuple[str, str]:
    """Prefix of the name of a value in one of a shunt's others, as "others.0.", and its name there; else none."""
    words = name.split(".", 2)
    return (f"{words[0]}.{words[1]}.", words[2]) if words[0] == "others" else ("", name)


def owner(part: Any, name: str) -> tuple[Any, str]:
    """The component that has the value, and its name there: of "others.0.resistance" the shunt that is others[0]."""
    field, _, place = name.partition(".")
    number, _, inner = place.partition(".")
    return owner(getattr(part, field)[int(number)], inner) if inner else (part, name)


def unit_at(part: Component | type[Component], name: str) -> str:
    """SI unit of a field, or of the entries of its list; empty for a field without one."""
    part, name = owner(part, name)
    return part.__dataclass_fields__[name.partition(".")[0]].metadata.get("unit", "")


def with_values(part: _C, values: Mapping[str, Any]) -> _C:
    """The component with other values of fields, or of single entries of their lists.

    Values are numbers, or columns (designs, 1) of a batch, which the other entries of their list then are, too.
    """
    changes: dict[str, Any] = {}
    for name, value in values.items():
        field, _, place = name.partition(".")
        if place:
            entries, (number, _, inner) = changes.setdefault(field, list(getattr(part, field))), place.partition(".")
            entries[int(number)] = with_values(entries[int(number)], {inner: value}) if inner else value
        else:
            changes[field] = value
    for field, value in changes.items():
        if isinstance(value, list):
            batch = any(isinstance(entry, np.ndarray) for entry in value)
            changes[field] = tuple(np.broadcast_arrays(*value)) if batch else tuple(value)
    return dataclasses.replace(part, **changes)


def lists_of(cls: type[Component]) -> tuple[str, ...]:
    """Names of the fields with units that are lists of values."""
    hints = get_type_hints(cls)
    return tuple(f.name for f in dataclasses.fields(cls) if "unit" in f.metadata and get_origin(hints[f.name]) is tuple)
