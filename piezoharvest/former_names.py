"""Modules under the names that they had before the folder `description`: users' scripts go on working."""

from __future__ import annotations

import importlib
import importlib.machinery
import sys
from collections.abc import Sequence
from types import ModuleType

_MOVED = {
    name: f"piezoharvest.description.{name}"
    for name in (
        "catalogue", "circuit", "effects", "excitation", "hysteresis", "limits", "netlist", "parameters", "shunts",
        "system", "transducer",
    )
}  # fmt: skip


class FormerNames:
    """Finder and loader of `piezoharvest.shunts` and others, which are the modules of their new names."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Spec of a module under its former name; None for any other."""
        package, _, inner = name.partition(".")
        moved = package == "piezoharvest" and inner in _MOVED
        return importlib.machinery.ModuleSpec(name, self) if moved else None  # type: ignore[arg-type]

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> None:
        """Leave it to Python; the module is replaced as soon as it is executed."""

    def exec_module(self, module: ModuleType) -> None:
        """Put the module of the new name in place of this one."""
        sys.modules[module.__name__] = importlib.import_module(_MOVED[module.__name__.partition(".")[2]])


def install() -> None:
    """Make the former names importable."""
    sys.meta_path.append(FormerNames())  # type: ignore[arg-type]
