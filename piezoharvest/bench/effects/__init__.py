"""Effects of the bench by name, found in the modules of this package."""

import importlib
import pkgutil

from piezoharvest.bench.effects.base import BenchEffect
from piezoharvest.description.parameters import subclasses_by

__all__ = ["BenchEffect", "registered"]

for _module in pkgutil.walk_packages(__path__, f"{__name__}."):
    importlib.import_module(_module.name)


def registered() -> dict[str, type[BenchEffect]]:
    """All effects of the bench by name."""
    return subclasses_by("name", BenchEffect)
