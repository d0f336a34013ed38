"""Circuits across the electrodes; every module of this package that defines a kind is found by scanning it."""

import importlib
import pkgutil

from piezoharvest.parameters import subclasses_by
from piezoharvest.shunts.base import LinearShunt, Shunt

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")


def registered() -> dict[str, type[Shunt]]:
    """All shunts by kind, those that a user's own script defines included."""
    return subclasses_by("kind", Shunt)


globals().update({cls.__name__: cls for cls in registered().values()})
__all__ = ["LinearShunt", "Shunt", "registered", *sorted(cls.__name__ for cls in registered().values())]
