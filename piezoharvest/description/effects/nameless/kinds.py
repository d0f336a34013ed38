"""Laws without a name in files: their parts by kind, and names for paths."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from piezoharvest.description.effects.nameless.circuit_places import CircuitPlace
from piezoharvest.description.effects.nameless.forms import Form
from piezoharvest.description.effects.nameless.memory import Memory
from piezoharvest.description.effects.nameless.places import Place
from piezoharvest.description.effects.nameless.shapes import Curve
from piezoharvest.description.parameters import Component

# Parts of a law, and what a class has to have of its own to be one that can be used.
PARTS: Mapping[str, tuple[type[Component], str]] = {
    "place": (Place, "name"), "form": (Form, "values"), "memory": (Memory, "row"),
}  # fmt: skip
assert issubclass(Curve, Form) and issubclass(CircuitPlace, Place)  # their modules have forms and places, too


def kinds_of(part: str) -> dict[str, type[Any]]:
    """Classes of places, forms or memories, by their kinds in files."""
    base, own = PARTS[part]
    usable = (cls for cls in _below(base) if getattr(cls, own, None) is not getattr(base, own, None))
    return {kind_of(cls): cls for cls in usable}


def _below(base: type) -> list[type]:
    return [cls for direct in base.__subclasses__() for cls in (direct, *_below(direct))]


def kind_of(cls: type) -> str:
    """Kind of a class in files: its name in lower case, words joined by underscores."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower()


def in_a_path(name: str) -> str:
    """Name of an effect as one word of a dotted path: laws of a reading or a parameter have a dot in theirs."""
    return name.replace(".", " ")
