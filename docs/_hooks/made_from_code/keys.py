"""Keys of the components' tables: what the reference and the schema say of a dataclass field."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import MISSING
from typing import Any, NamedTuple, get_type_hints

from piezoharvest.description.parameters import Component
from piezoharvest.study import unit_of
from piezoharvest.study.building import component_in, key_of, without_none


class Key(NamedTuple):
    """A key of a table: its name in a file, the field behind it, the field's type without None, and its SI unit."""

    name: str
    field: dataclasses.Field
    hint: Any
    unit: str

    @property
    def required(self) -> bool:
        """True if the key has no default."""
        return self.field.default is MISSING and self.field.default_factory is MISSING

    @property
    def doc(self) -> str:
        """Description of the key; of a table that has none the first sentence of its class."""
        inner = component_in(self.hint)
        return self.field.metadata.get("doc") or (first_sentence(inner) if inner else "")

    @property
    def is_quantity(self) -> bool:
        """True for a number with unit and bounds, or a list of them."""
        return "unit" in self.field.metadata


def keys_of(cls: type[Component]) -> Iterator[Key]:
    """Keys of a component's table, in the order of its fields."""
    hints = get_type_hints(cls)
    for field in dataclasses.fields(cls):
        if field.init:
            unit = unit_of(cls, field) if "unit" in field.metadata else ""
            yield Key(key_of(field), field, without_none(hints[field.name]), unit)


def first_sentence(cls: type) -> str:
    """First line of a class's docstring, without its full stop."""
    return (cls.__doc__ or "").strip().split("\n")[0].removesuffix(".")
