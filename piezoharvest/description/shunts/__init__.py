"""Circuits across the electrodes; every module of this package that defines a kind is found by scanning it."""

import importlib
import pkgutil
from typing import TYPE_CHECKING, Any

from piezoharvest.description.parameters import subclasses_by
from piezoharvest.description.shunts.base import LinearShunt, Shunt

__all__ = ["LinearShunt", "Shunt", "registered"]

for _module in pkgutil.walk_packages(__path__, f"{__name__}."):
    importlib.import_module(_module.name)


def registered() -> dict[str, type[Shunt]]:
    """All shunts by kind, including those that a user's script defines."""
    return subclasses_by("kind", Shunt)


if TYPE_CHECKING:
    # The classes come from scanning, which type checkers cannot follow.
    def __getattr__(name: str) -> Any: ...


globals().update({cls.__name__: cls for cls in registered().values()})
