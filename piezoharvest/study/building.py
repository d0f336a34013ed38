"""Components from TOML tables, checked by pydantic models that are generated from the components' dataclasses."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import MISSING
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, Strict, ValidationError, create_model

from piezoharvest.description import effects, excitation, shunts
from piezoharvest.description.catalogue.parts import SORTS, sort_of, sorts_of, with_parts
from piezoharvest.description.effects import Effect
from piezoharvest.description.effects.nameless.kinds import PARTS, in_a_path, kinds_of
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.excitation import Excitation
from piezoharvest.description.parameters import Component, ParameterError, allowed
from piezoharvest.description.shunts import Shunt
from piezoharvest.description.transducer import Transducer
from piezoharvest.readers.conversion import with_unit
from piezoharvest.study.words import WORDS, shown_value, typed, unknown

_C = TypeVar("_C", bound=Component)


def build_excitation(table: Any, folder: Path, where: str = "excitation") -> Excitation:
    """Excitation from its table, by kind; a file that it names is relative to `folder`."""
    cls, keys = _by_kind(table, excitation.registered(), where)
    if isinstance(keys.get("file"), str):
        keys["file"] = str(folder / keys["file"])
    return build(cls, keys, where)


def build_shunt(table: Any, where: str = "shunt", transducer: Transducer | None = None) -> Shunt:
    """Shunt from its table, by kind; the transducer, where it is known, tells what the quality of a named coil is."""
    cls, keys = _by_kind(table, shunts.registered(), where)
    number, capacitance = keys.get("electrode", 0), None
    if transducer is not None and type(number) is int and 0 <= number < len(transducer.all_electrodes):
        capacitance = transducer.all_electrodes[number].capacitance
    _check_parts_keys(keys, where)
    for option in (sort.option for sort in SORTS.values()):
        if option is not None and isinstance(keys.get(option.key), str):
            keys[option.key] = in_si(keys[option.key], option.unit, f"{where}.{option.key}")
    try:
        keys = with_parts(keys, cls, capacitance)
    except ParameterError as error:
        raise error.within(where) from None
    return build(cls, keys, where)


def _check_parts_keys(table: Mapping[str, Any], where: str) -> None:
    """Raise `ParameterError` where a part of the catalogue is named by a key for something else."""
    for key, value in table.items():
        right = sort_of(value)
        if right is not None and key != right and key != "netlist":
            found = f"found {value!r}, which is a {SORTS[right].doc} of the catalogue"
            raise ParameterError(f"{where}.{key}", f"{found}: {right} = {value!r} names it")


def build_effect(name: str, table: Any, where: str) -> Effect:
    """Effect from its table, by name; one that has a `place` is a law without a name.

    Raises
    ------
    ParameterError
        There is no such effect, or its table does not fit.
    """
    known = effects.registered()
    if name in known:
        return build(known[name], table, where)
    if not isinstance(table, dict) or "place" not in table:
        told = unknown(where, name, known, "effect").message
        raise ParameterError(where, f"{told}; one of your own is read from its file by --effects")
    for key in table:
        if key not in PARTS:
            raise unknown(f"{where}.{key}", key, PARTS, "key")
    if "form" not in table:
        raise ParameterError(f"{where}.form", "missing key, a law has a place and a form")
    places = {key: f"{where}.{key}" for key in table}
    parts: dict[str, Any] = {
        key: build(*_by_kind(part, kinds_of(key), places[key]), places[key]) for key, part in table.items()
    }
    law = Law(**parts)
    if in_a_path(law.name) != name:
        raise ParameterError(where, f"found the law {in_a_path(law.name)!r} under this name, must have its own")
    return law


def build(cls: type[_C], table: Any, where: str) -> _C:
    """Build a component from a table, as tomllib gives it, whose keys are the fields of its dataclass.

    Raises
    ------
    ParameterError
        A key is missing, unknown, of the wrong type or out of bounds; its key begins with `where`, the table's path.
    """
    values = dict(typed(dict, table, where))
    hints = get_type_hints(cls)
    for field in dataclasses.fields(cls):
        key, part = key_of(field), component_in(hints[field.name])
        if part is not None and field.name in values:
            values[field.name] = _build_part(part, hints[field.name], values[field.name], f"{where}.{field.name}")
        elif key in values and "unit" in field.metadata:
            values[key] = in_si(values[key], unit_of(cls, field), f"{where}.{key}")
    try:
        checked = _model(cls).model_validate(values)
        return cls(**{name: _frozen(getattr(checked, name)) for name in checked.model_fields_set})
    except ValidationError as error:
        raise _validation_message(cls, error).within(where) from None
    except ParameterError as error:
        raise ParameterError(error.key.removesuffix("_"), error.message).within(where) from None
    except (ValueError, OSError) as error:
        raise ParameterError(where, f"values that {cls.__name__} does not accept ({error})") from None


def unit_of(cls: type[Component], field: dataclasses.Field) -> str:
    """SI unit of a field; of those that excitations share, a force's and an acceleration's, the one of this kind."""
    first, *other = field.metadata["unit"].split(" or ")
    return other[0] if other and issubclass(cls, Excitation) and (cls.base or cls.imposed) else first


def in_si(value: Any, unit: str, where: str) -> Any:
    """The value of a quantity, or the list of them, in its SI unit, where it is text with a unit ("52 nF")."""
    if isinstance(value, list):
        return [in_si(each, unit, f"{where}.{n}") for n, each in enumerate(value)]
    if not isinstance(value, str):
        return value
    try:
        converted = with_unit(value, unit)
        return value if converted is None else converted
    except ParameterError as error:
        raise ParameterError(where, error.message) from None


def _build_part(part: type[Component], hint: Any, value: Any, where: str) -> Any:
    """Component or tuple of components inside another one; effects stand in a table by name."""
    if issubclass(part, Effect):
        return tuple(build_effect(name, table, f"{where}.{name}") for name, table in typed(dict, value, where).items())
    if issubclass(part, Shunt):
        return build_list(value, where, build_shunt)
    if get_origin(hint) is tuple:
        return build_list(value, where, lambda table, place: build(part, table, place))
    return build(part, value, where)


def build_list(value: Any, where: str, make) -> tuple:
    """Components from a list of tables."""
    return tuple(make(table, f"{where}.{n}") for n, table in enumerate(typed(list, value, where)))


def _by_kind(table: Any, known: Mapping[str, type[_C]], where: str) -> tuple[type[_C], dict[str, Any]]:
    """Class that the table's `kind` names, and the table's other keys."""
    keys = dict(typed(dict, table, where))
    if "kind" not in keys:
        raise ParameterError(f"{where}.kind", f"missing key, allowed are {', '.join(sorted(known))}")
    kind = keys.pop("kind")
    if not isinstance(kind, str) or kind not in known:
        raise unknown(f"{where}.kind", kind, known)
    return known[kind], keys


def component_in(hint: Any) -> type[Component] | None:
    """Component class within an annotation such as `Hysteresis | None` or `tuple[Mode, ...]`."""
    if get_origin(hint) is None:
        return hint if isinstance(hint, type) and issubclass(hint, Component) else None
    return next((part for part in map(component_in, get_args(hint)) if part is not None), None)


@cache
def _model(cls: type[Component]) -> type[BaseModel]:
    """Pydantic model with the fields of a component's dataclass: no additional keys, no conversion to numbers."""
    hints = get_type_hints(cls)
    fields: dict[str, Any] = {
        field.name: (
            _strict(hints[field.name]),
            Field(... if MISSING is field.default is field.default_factory else None, alias=key_of(field)),
        )
        for field in dataclasses.fields(cls)
        if field.init
    }
    return create_model(cls.__name__, __config__=ConfigDict(extra="forbid", protected_namespaces=()), **fields)


def key_of(field: dataclasses.Field) -> str:
    """Key of a field in a file: its name, without the underscore appended to Python keywords (`from_`)."""
    return field.name.removesuffix("_")


def _strict(hint: Any) -> Any:
    """Annotation without conversions between types, except from int to float and from list to tuple.

    A field that takes several types is left to the component's own check.
    """
    hint = without_none(hint)
    if hint in (float, int, str, bool):
        return Annotated[hint, Strict()]
    if get_origin(hint) is tuple:
        return tuple[tuple(part if part is Ellipsis else _strict(part) for part in get_args(hint))]  # pyright: ignore
    return hint if get_origin(hint) is Literal else Any


def without_none(hint: Any) -> Any:
    """The annotation, or X for `X | None`."""
    parts = [part for part in get_args(hint) if part is not NoneType]
    return parts[0] if get_origin(hint) in (Union, UnionType) and len(parts) == 1 else hint


def _validation_message(cls: type[Component], error: ValidationError) -> ParameterError:
    """An error of pydantic in words: an unknown key first, which may explain a missing one; missing ones at once."""
    order = {"extra_forbidden": 0, "missing": 2}
    details = error.errors(include_url=False)
    first = min(details, key=lambda detail: order.get(detail["type"], 1))
    name, *inner = map(str, first["loc"])
    fields = {key_of(field): field for field in dataclasses.fields(cls) if field.init}
    if first["type"] == "extra_forbidden":
        named = sorts_of(fields) if issubclass(cls, Shunt) else {}
        options = [sort.option.key for sort in named.values() if sort.option]
        return unknown(name, name, [*fields, *named, *options], "key")
    field = fields[name]
    hint = without_none(get_type_hints(cls)[field.name])
    if first["type"] != "missing" and inner:
        name, hint = f"{name}.{inner[0]}", get_args(hint)[0]
    # An element is missing if a list is too short: the list is reported.
    if first["type"] == "missing" and not inner:
        others = [str(each["loc"][0]) for each in details if each["type"] == "missing" and len(each["loc"]) == 1][1:]
        more = f"; also missing: {', '.join(others)}" if others else ""
        return ParameterError(name, f"missing key, must be {allowed_values(field, hint)}{more}")
    return ParameterError(name, f"found {shown_value(first['input'])}, must be {allowed_values(field, hint)}")


def allowed_values(field: dataclasses.Field, hint: Any) -> str:
    """Allowed values of a field, in words."""
    if get_origin(hint) is Literal:
        return " or ".join(map(repr, get_args(hint)))
    if get_origin(hint) is tuple:
        parts = get_args(hint)
        count = "" if Ellipsis in parts else f" of {len(parts)}"
        if component_in(parts[0]) is not None:
            return f"a list{count} of tables"
        return f"a list{count}, each {allowed_values(field, parts[0])}"
    if hint in (int, float):
        return allowed(field).replace("finite", "whole" if hint is int else "finite")
    if component_in(hint) is not None:
        return "a table"
    return WORDS.get(hint, "a string or a list")


def _frozen(value: Any) -> Any:
    return tuple(map(_frozen, value)) if isinstance(value, list | tuple) else value
