"""Single values within components by name: a field, or one of a field's list as in "inductances.0"."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, TypeVar, get_origin, get_type_hints

import numpy as np

from piezoharvest.description.parameters import Component

_C = TypeVar("_C", bound=Component)


def value_at(part: Component, name: str) -> Any:
    """Value of a field, or of one entry of its list."""
    field, _, place = name.partition(".")
    value = getattr(part, field)
    return value[int(place)] if place else value


def unit_at(part: Component | type[Component], name: str) -> str:
    """SI unit of a field, or of the entries of its list; empty for a field without one."""
    return part.__dataclass_fields__[name.partition(".")[0]].metadata.get("unit", "")


def with_values(part: _C, values: Mapping[str, Any]) -> _C:
    """The component with other values of fields, or of single entries of their lists.

    Values are numbers, or columns (designs, 1) of a batch, which the other entries of their list then are, too.
    """
    changes: dict[str, Any] = {}
    for name, value in values.items():
        field, _, place = name.partition(".")
        if place:
            entries = changes.setdefault(field, list(getattr(part, field)))
            entries[int(place)] = value
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
