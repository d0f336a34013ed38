"""Values inside components by dotted paths, as in "hysteresis.weights.1" or "effects.leakage.resistance"."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from piezoharvest.description.effects import Effect
from piezoharvest.description.effects.nameless.kinds import in_a_path, kind_of
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.netlist import Element
from piezoharvest.description.parameters import Component, ParameterError


def named(parts: tuple) -> list[tuple[str, Any]]:
    """Members of a tuple with their keys in a path: effects by name, all others by position."""
    return [(in_a_path(part.name) if isinstance(part, Effect) else str(n), part) for n, part in enumerate(parts)]


def tree_of(paths: Sequence[str], values: Sequence[Any]) -> dict[str, Any]:
    """Values as a tree of tables, one level for each word of their paths."""
    tree: dict[str, Any] = {}
    for path, value in zip(paths, values, strict=True):
        *branches, leaf = path.split(".")
        node = tree
        for word in branches:
            node = node.setdefault(word, {})
        node[leaf] = value
    return tree


def placed(part: Any, tree: Any, path: str) -> Any:
    """The part with the values of a tree in it, set together for each component, as they may depend on each other.

    Raises
    ------
    ParameterError
        A component rejects its values; the key begins with `path`.
    """
    if not isinstance(tree, Mapping):
        return tree
    if not tree:
        return part
    if isinstance(part, tuple):
        new = [placed(inner, tree.get(word, {}), f"{path}.{word}") for word, inner in named(part)]
        # Numbers beside an array become arrays of its shape, so that the tuple is one batch.
        return tuple(np.broadcast_arrays(*new)) if any(isinstance(inner, np.ndarray) for inner in new) else tuple(new)
    changes = {name: placed(getattr(part, name), inner, f"{path}.{name}") for name, inner in tree.items()}
    try:
        return dataclasses.replace(part, **changes)
    except ParameterError as error:
        raise error.within(path) from None


def found_at(part: Component, path: str) -> tuple[float, dataclasses.Field]:
    """Number at a path, and the field that gives its unit and bounds.

    Raises
    ------
    KeyError
        There is no number at the path.
    """
    value, field = quantity_at(part, path)
    if not isinstance(value, int | float):
        raise KeyError(path)
    return float(value), field


def quantity_at(part: Component, path: str) -> tuple[Any, dataclasses.Field]:
    """What is at the path of a quantity, None where it is optional and not given, and its field; or `KeyError`."""
    value, field = part, None
    for word in path.split("."):
        if isinstance(value, tuple):
            value = dict(named(value))[word]
        elif isinstance(value, Component):
            field = next((f for f in dataclasses.fields(value) if f.name == word), None)
            if field is None:
                raise KeyError(path)
            value = getattr(value, word)
        else:
            raise KeyError(path)
    if field is None or "unit" not in field.metadata:
        raise KeyError(path)
    return value, field


def component_table(component: Component) -> dict[str, Any]:
    """Table of a component in the format of a study file: effects by name, without fields that are None.

    Of a law without a name a table each of place, form and memory, by their kinds.
    """
    if isinstance(component, Law):
        parts = {"place": component.place, "form": component.form, "memory": component.memory}
        return {key: {"kind": kind_of(type(part)), **component_table(part)} for key, part in parts.items() if part}
    found: dict[str, Any] = {}
    for field in (field for field in dataclasses.fields(component) if field.init):
        value = getattr(component, field.name)
        if field.name == "effects":
            value = {in_a_path(effect.name): component_table(effect) for effect in value}
        elif isinstance(value, Component):
            value = component_table(value)
        elif isinstance(value, tuple):
            value = [component_table(part) if isinstance(part, Component) else _plain(part) for part in value]
        value = _plain(value)
        if value is not None and value not in ("", [], {}):
            found[field.name] = value
    return found


def _plain(value: Any) -> Any:
    """A number of numpy as one of Python, an element of a netlist as a table."""
    if isinstance(value, Element):
        return value.table
    return value.item() if isinstance(value, np.generic) else value
