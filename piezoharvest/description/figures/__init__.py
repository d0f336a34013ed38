"""Transducers from figures that people have: a modal test, or a data sheet. One kind of figures, one file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from piezoharvest.description import catalogue
from piezoharvest.description.figures.base import Figures, Lumped
from piezoharvest.description.figures.blocked_force import BlockedForce
from piezoharvest.description.figures.coupling_factor import CouplingFactor
from piezoharvest.description.figures.impedance import Impedance
from piezoharvest.description.figures.modal import Modal
from piezoharvest.description.figures.open_circuit import OpenCircuit
from piezoharvest.description.figures.plate import Plate
from piezoharvest.description.figures.power import HarvestedPower
from piezoharvest.description.figures.stack import Stack
from piezoharvest.description.parameters import ParameterError, check_choice

# A kind of data sheet is recognised by the first of these keys that is there.
DATA_SHEETS: dict[str, type[Figures]] = {
    "blocking_force": BlockedForce,
    "free_stroke": BlockedForce,
    "d33": Stack,
    "d31": Plate,
    "open_circuit_voltage": OpenCircuit,
    "antiresonance_frequency": Impedance,
    "coupling_factor": CouplingFactor,
    "power": HarvestedPower,
}

__all__ = [
    "DATA_SHEETS", "BlockedForce", "CouplingFactor", "Figures", "HarvestedPower", "Impedance", "Lumped", "Modal",
    "OpenCircuit", "Plate", "Stack", "data_sheet", "data_sheet_keys",
]  # fmt: skip


def data_sheet(figures: Mapping[str, Any]) -> tuple[type[Figures], dict[str, Any]]:
    """Kind of figures that a data sheet gives, and its figures; those of a `material` are filled in by its name.

    Raises
    ------
    ParameterError
        None of the keys tells a kind, or the material is unknown.
    """
    given = _with_material(figures)
    for key, kind in DATA_SHEETS.items():
        if key in given:
            return kind, given
    raise ParameterError("datasheet", f"missing key, one of {', '.join(DATA_SHEETS)} or material is needed")


def data_sheet_keys() -> set[str]:
    """Keys that data sheets of all kinds may have."""
    return {field.name for kind in DATA_SHEETS.values() for field in fields(kind)} | {"material"}


def _with_material(figures: Mapping[str, Any]) -> dict[str, Any]:
    """Figures with the constants of their material: of a plate where a length is given, else of a stack."""
    given = dict(figures)
    if "material" not in given:
        return given
    name = given.pop("material")
    check_choice("material", name, catalogue.materials())
    constants = catalogue.material(name)["material"]
    keys = ("d31", "s11") if "length" in given else ("d33", "s33")
    return {**{key: constants[key] for key in (*keys, "relative_permittivity")}, **given}
