"""Readers of tables of numbers in text, with what instruments say above them; its modules are found by scanning."""

from __future__ import annotations

import importlib
import pkgutil

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")
