"""The effects that the bench can switch on, by name; every module of this package is found by scanning it."""

import importlib
import pkgutil

from piezoharvest.parameters import subclasses_by
from piezoharvest.records.bench.effects.base import BenchEffect

__all__ = ["BenchEffect", "registered"]

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")


def registered() -> dict[str, type[BenchEffect]]:
    """All effects of the bench by name."""
    return subclasses_by("name", BenchEffect)
