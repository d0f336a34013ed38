"""Figures and pages: the report of a design."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from piezoharvest.report.pages import write_report

__all__ = ["write_report"]


def __getattr__(name: str) -> Any:
    # Lazy: matplotlib and jinja2 come only when a report is written.
    if name != "write_report":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from piezoharvest.report.pages import write_report

    return write_report
