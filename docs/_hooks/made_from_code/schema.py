"""JSON schemas of studies and campaigns, made from the code: editors complete and check keys by them.

They say what a key may be by itself. What several keys have to be together is said by the programme alone.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any, Literal, get_args, get_origin

from made_from_code.keys import Key, keys_of
from made_from_code.reference import body
from piezoharvest.bench.effects import registered as bench_effects
from piezoharvest.bench.settings import Bench, RecordOptions
from piezoharvest.description import catalogue, effects, excitation, shunts
from piezoharvest.description.catalogue.parts import parts, sorts_of
from piezoharvest.description.figures import DATA_SHEETS, Modal
from piezoharvest.description.parameters import Component
from piezoharvest.description.shunts.linear.network import Network
from piezoharvest.description.transducer import Transducer
from piezoharvest.records.bench_limits import BenchLimits
from piezoharvest.records.reading.channels import UNITS, ChannelSource
from piezoharvest.records.reading.entries import ENTRIES, RESPONSE_COLUMNS
from piezoharvest.study import DesignOptions, SweepOptions
from piezoharvest.study.building import component_in

Schema = dict[str, Any]
_DRAFT = "http://json-schema.org/draft-07/schema#"  # the one that editors for TOML know
_BOUNDS = {"above": "exclusiveMinimum", "at_least": "minimum", "below": "exclusiveMaximum", "at_most": "maximum"}
_STRINGS = {"type": "array", "items": {"type": "string"}}
_LAW: Schema = {"type": "object", "required": ["place", "form"], "description": "a law without a name"}
_PLAIN: dict[Any, Schema] = {bool: {"type": "boolean"}, str: {"type": "string"}}


def _parts(fields: Collection[str]) -> Schema:
    """Keys by which a shunt may name parts of the catalogue."""
    found: Schema = {}
    for key, sort in sorts_of(fields).items():
        found[key] = {"enum": list(parts(key)), "description": f"{sort.doc} whose values are taken"}
        if sort.option:
            doc = f"{sort.option.doc} ({sort.option.unit})"
            found[sort.option.key] = {"type": "number", "exclusiveMinimum": 0, "description": doc}
    return found


def study() -> Schema:
    """Schema of a study file."""
    tables: Schema = {
        "title": {"type": "string", "description": "text for reports"},
        "transducer": {"anyOf": [{"type": "string", "description": "specimen file"}, _transducer()]},
        "excitation": _by_kind(excitation.registered()),
        "shunts": {"type": "array", "items": {"$ref": "#/definitions/shunt"}, "minItems": 1},
        "design": of_component(DesignOptions),
        "sweep": of_component(SweepOptions),
        "bench": _bench(),
    }
    needed = [{"required": ["shunts"]}, {"required": ["design"]}]
    schema = _table("Study of piezoharvest", tables, ["transducer", "excitation"]) | {"anyOf": needed}
    return {"$schema": _DRAFT, **schema, "definitions": {"shunt": _by_kind(shunts.registered())}}


def campaign() -> Schema:
    """Schema of a campaign file."""
    tables: Schema = {
        "title": {"type": "string", "description": "text for reports"},
        "transducer": {"anyOf": [{"type": "string", "description": "specimen file"}, _transducer()]},
        "channels": _channels(UNITS),
        "records": {"type": "array", "items": {"oneOf": [_entry(kind) for kind in ENTRIES]}, "minItems": 1},
        "experiment": of_component(BenchLimits),
        "specimens": {"type": "array", "items": {"type": "object", "required": ["records"]}},
    }
    schema = _table("Campaign of piezoharvest", tables, ["transducer"])
    schema["anyOf"] = [{"required": ["records"]}, {"required": ["specimens"]}]
    fit = {"fit": {**_STRINGS, "description": "keys of the circuit that are fitted"}}
    return {"$schema": _DRAFT, **schema, "definitions": {"shunt": _by_kind(shunts.registered(), fit)}}


def of_component(cls: type[Component], more: Mapping[str, Schema] | None = None) -> Schema:
    """Schema of a component's table, with further keys."""
    known = list(keys_of(cls))
    properties = {**(more or {}), **{key.name: _key(cls, key) for key in known}}
    return _table(body(cls), properties, [key.name for key in known if key.required])


def _table(words: str, properties: Mapping[str, Schema], required: Iterable[str] = ()) -> Schema:
    return {
        "type": "object", "description": words, "properties": dict(properties), "required": list(required),
        "additionalProperties": False,
    }  # fmt: skip


def _key(cls: type[Component], key: Key) -> Schema:
    unit = f" ({key.unit})" if key.unit else ""
    return {"description": key.doc + unit, **_special(cls, key), **_value(key, key.hint)}


def _special(cls: type[Component], key: Key) -> Schema:
    """Schemas of the keys whose type in the code says less than what is allowed."""
    if key.hint is Any and key.name == "shunt":
        return {"allOf": [{"$ref": "#/definitions/shunt"}]}
    if key.hint is Any and key.name in ("excitation", "channels"):
        return {"type": "object"}
    if cls is Network and key.name == "netlist":
        return {"type": ["string", "array"]}
    return {}


def _value(key: Key, hint: Any) -> Schema:
    """Schema of a value of a type; a number may be text with a unit."""
    if hint in _PLAIN:
        return _PLAIN[hint]
    if hint in (int, float):
        bounds = {word: key.field.metadata[name] for name, word in _BOUNDS.items() if _bound(key, name) is not None}
        number = {"type": "integer" if hint is int else "number", **bounds}
        return number if hint is int or not key.is_quantity else {"anyOf": [number, {"type": "string"}]}
    if get_origin(hint) is Literal:
        return {"enum": list(get_args(hint))}
    if component_in(hint) is effects.Effect:
        return {**_by_name(effects.registered()), "additionalProperties": _LAW}
    if get_origin(hint) is tuple:
        parts = get_args(hint)
        count = {} if Ellipsis in parts else {"minItems": len(parts), "maxItems": len(parts)}
        return {"type": "array", "items": _value(key, parts[0]), **count}
    inner = component_in(hint)
    if inner is shunts.Shunt:
        return {"$ref": "#/definitions/shunt"}
    return of_component(inner) if inner is not None else {}


def _bound(key: Key, name: str) -> float | None:
    return key.field.metadata.get(name)


def _by_kind(known: Mapping[str, type[Component]], more: Mapping[str, Schema] | None = None) -> Schema:
    """Schema of a table whose key `kind` says what its other keys are."""
    tables = []
    for kind, cls in known.items():
        fields = {key.name for key in keys_of(cls)}
        table = of_component(cls, {"kind": {"const": kind}, **_parts(fields), **(more or {})})
        from_parts = {key for sort in sorts_of(fields).values() for key in sort.keys}
        needed = [key for key in table["required"] if key not in from_parts]
        tables.append({**table, "required": ["kind", *needed]})
    return {"oneOf": tables}


def _by_name(known: Mapping[str, type[Component]]) -> Schema:
    """Schema of a table of tables, each of which is a component by its name."""
    return _table("a table for each effect", {name: of_component(cls) for name, cls in known.items()})


def _transducer() -> Schema:
    """Schema of [transducer], whose values may come from the catalogue or from figures."""
    sheets = {key.name: _key(cls, key) for cls in DATA_SHEETS.values() for key in keys_of(cls)}
    material = {"enum": list(catalogue.materials()), "description": "material whose constants are taken"}
    more = {
        "catalogue": {"enum": list(catalogue.names()), "description": "entry whose keys are the defaults"},
        "modes_file": {"type": "string", "description": "modes of the host, one a row, or shapes at nodes (.unv)"},
        "shapes": {"type": "object", "description": "positions of force and sensor in a universal file, and couplings"},
        "modal": of_component(Modal),
        "datasheet": _table("figures of a data sheet", {"material": material, **sheets}),
    }
    table = of_component(Transducer, more)
    # A campaign may leave out mass and damping.
    own = [key for key in table.pop("required") if key not in ("mass", "damping")]
    return {**table, "anyOf": [{"required": own}, *({"required": [key]} for key in more)]}


def _bench() -> Schema:
    # A record may hold what the study has already, so that none of the keys of a kind is required here.
    table = of_component(Bench, {"effects": _by_name(bench_effects())})
    table["properties"]["records"]["items"] = of_component(RecordOptions)
    return table


def _channels(names: Iterable[str]) -> Schema:
    return _table("source of each channel", {name: of_component(ChannelSource) for name in names})


def _entry(kind: str) -> Schema:
    """Schema of one of [[records]]; one without a kind is of signals over time."""
    table = of_component(ENTRIES[kind], {"kind": {"const": kind}} if kind == "time" else None)
    table["properties"] |= {"kind": {"const": kind}, "channels": _channels(RESPONSE_COLUMNS.get(kind, UNITS))}
    return table
