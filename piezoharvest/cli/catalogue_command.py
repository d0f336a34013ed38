"""`piezoharvest catalogue`: the transducers, materials and parts that come with the package."""

from __future__ import annotations

from typing import Any

from piezoharvest.cli import tables
from piezoharvest.cli.notes import note
from piezoharvest.description import catalogue
from piezoharvest.description.catalogue import parts as bought
from piezoharvest.study import build_transducer
from piezoharvest.study.words import not_in_catalogue

_VALUES = ("mass", "damping", "stiffness", "coupling", "capacitance")
# Units of the constants of a material.
_CONSTANTS = {"d33": "C/N", "d31": "C/N", "s33": "m^2/N", "s11": "m^2/N", "relative_permittivity": "",
              "density": "kg/m^3"}  # fmt: skip


def names() -> tuple[str, ...]:
    """Names of all transducers, materials and parts."""
    found = (part for key in bought.SORTS for part in bought.parts(key))
    return (*catalogue.names(), *catalogue.materials(), *found)


def show(name: str | None, *, as_json: bool) -> int:
    """Print all entries in a line each, or one entry with its source and values."""
    if name is None:
        entries = [_transducer(entry) for entry in catalogue.names()]
        materials = [_material(material) for material in catalogue.materials()]
        parts = {sort.file: [_part(key, name) for name in bought.parts(key)] for key, sort in bought.SORTS.items()}
        if as_json:
            tables.print_json({"transducers": entries, "materials": materials, **parts})
        else:
            tables.print_catalogue(entries, materials, parts)
            note("`piezoharvest catalogue NAME` shows one entry with its source")
        return 0
    found = _one(name)
    if as_json:
        tables.print_json(found)
    else:
        tables.print_entry(found)
    return 0


def _one(name: str) -> dict[str, Any]:
    """A transducer, a material or a part of the catalogue."""
    if name in catalogue.names():
        return _transducer(name)
    if name in catalogue.materials():
        return _material(name)
    found = {part: key for key in bought.SORTS for part in bought.parts(key)}
    if name in found:
        return _part(found[name], name)
    raise not_in_catalogue("NAME", name, names())


def _material(name: str) -> dict[str, Any]:
    """A material of the catalogue with its constants."""
    found = catalogue.material(name)
    values = {key: {"value": value, "unit": _CONSTANTS[key]} for key, value in found["material"].items()}
    return {
        "key": name, "name": found["name"], "source": found["source"], "note": found["note"].strip(), "values": values,
    }  # fmt: skip


def _part(sort: str, name: str) -> dict[str, Any]:
    """A part of the catalogue with what its data sheet says."""
    found = bought.parts(sort)[name]
    values = {key: {"value": value, "unit": bought.UNITS[key]} for key, value in found.items() if key in bought.UNITS}
    return {
        "key": name, "name": f"{name}, {bought.SORTS[sort].doc}", "source": found["source"], "note": found["note"],
        "values": values,
    }  # fmt: skip


def _transducer(name: str) -> dict[str, Any]:
    """A transducer of the catalogue with its values, resonances and coupling."""
    entry, transducer = catalogue.entry(name), build_transducer({"catalogue": name})
    units = {field: transducer.__dataclass_fields__[field].metadata["unit"] for field in _VALUES}
    squared = transducer.coupling_squared
    return {
        "key": name,
        "name": entry["name"],
        "source": entry["source"],
        "note": entry["note"].strip(),
        "values": {field: {"value": getattr(transducer, field), "unit": units[field]} for field in _VALUES}
        | {
            "short_circuit_frequency": {"value": transducer.short_circuit_frequency, "unit": "Hz"},
            "open_circuit_frequency": {"value": transducer.open_circuit_frequency, "unit": "Hz"},
            "coupling_factor": {"value": (squared / (1 + squared)) ** 0.5, "unit": ""},
        },
        "modes": 1 + len(transducer.modes),
        "assumptions": list(transducer.assumptions),
    }
