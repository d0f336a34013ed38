"""Reports (HTML pages with figures) of a design, an identification and a diagnosis."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from piezoharvest.report.diagnosis import write_diagnosis
    from piezoharvest.report.identification import write_identification
    from piezoharvest.report.pages import write_report

__all__ = ["write_diagnosis", "write_identification", "write_report"]

_HOME = {"write_diagnosis": "diagnosis", "write_report": "pages", "write_identification": "identification"}


def __getattr__(name: str) -> Any:
    # Lazy: matplotlib and jinja2 are only imported when a report is written.
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
