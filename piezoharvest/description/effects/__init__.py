"""Physical effects beyond the lumped model; every module of this package is found by scanning it."""

import importlib
import pkgutil
from typing import TYPE_CHECKING, Any

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import subclasses_by

__all__ = ["Effect", "registered"]

for _module in pkgutil.walk_packages(__path__, f"{__name__}."):
    importlib.import_module(_module.name)


def registered() -> dict[str, type[Effect]]:
    """All effects by name, including those that a user's script defines."""
    return subclasses_by("name", Effect)


if TYPE_CHECKING:
    # The classes come from scanning, which type checkers cannot follow.
    def __getattr__(name: str) -> Any: ...


globals().update({cls.__name__: cls for cls in registered().values()})
