"""Packages that are called as the function they are named after: `piezoharvest.design(study)`."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any


class CallablePackage(ModuleType):
    """A package whose call is that of its function of the same name.

    `from piezoharvest import design` gives the package, as soon as any of its modules is loaded. That the name of a
    function is also that of the place where it is made must not be a trap.
    """

    def __call__(self, *args: Any, **options: Any) -> Any:
        """Call the function."""
        return getattr(self, self.__name__.rpartition(".")[2])(*args, **options)


def make_callable(name: str) -> None:
    """Let a package, given by its `__name__`, be called."""
    sys.modules[name].__class__ = CallablePackage
