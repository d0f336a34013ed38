"""Parameters of a study by their dotted paths, as in "shunts.0.load_resistance"."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any, get_args, get_origin, get_type_hints

from piezoharvest.description.excitation import Excitation
from piezoharvest.description.parameters import Component
from piezoharvest.description.paths import named, placed, tree_of
from piezoharvest.description.system import System
from piezoharvest.study import Study

_ROOTS = ("transducer", "excitation", "shunts")


def parameters(study: Study) -> dict[str, dataclasses.Field]:
    """Every path of a study that holds a number, with the field that gives its unit and bounds.

    An optional number that the study omits has a path as well; integers (a seed) have none.
    """
    return dict(item for root in _ROOTS for item in _paths(getattr(study, root), root))


def _paths(part: Any, path: str) -> Iterator[tuple[str, dataclasses.Field]]:
    if isinstance(part, tuple):
        for word, inner in named(part):
            yield from _paths(inner, f"{path}.{word}")
    elif isinstance(part, Component):
        hints = get_type_hints(type(part))
        for field in dataclasses.fields(part):
            here, value, hint = f"{path}.{field.name}", getattr(part, field.name), hints[field.name]
            if "unit" not in field.metadata:
                yield from _paths(value, here)
            elif hint is float or (float in get_args(hint) and get_origin(hint) is not tuple):
                yield here, field
            elif isinstance(value, tuple):
                yield from ((f"{here}.{n}", field) for n in range(len(value)))


def place(study: Study, shunt: int, paths: Sequence[str], values: Sequence[Any]) -> tuple[System, Excitation]:
    """Replace the values at paths of a study.

    Parameters
    ----------
    study : Study
    shunt : int
        Index of the system's shunt; values for the others are ignored.
    paths : sequence of str
        As `parameters` gives them.
    values : sequence of float or (designs, 1) array
        One for each path; with arrays the components stand for a batch of designs.

    Raises
    ------
    ParameterError
        A component rejects its values; the key is the path.
    """
    tree = tree_of(paths, values)
    transducer = placed(study.transducer, tree.get("transducer", {}), "transducer")
    excitation = placed(study.excitation, tree.get("excitation", {}), "excitation")
    own = tree.get("shunts", {}).get(str(shunt), {})
    return System(transducer, placed(study.shunts[shunt], own, f"shunts.{shunt}")), excitation
