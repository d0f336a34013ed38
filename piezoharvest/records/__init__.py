"""Measured records: campaigns read from files of many formats, and checks of their data."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from piezoharvest.records.errors import CampaignError
    from piezoharvest.records.finding import Finding
    from piezoharvest.records.loading import Campaign, load_campaign
    from piezoharvest.records.record import FrequencyRecord, Record, Signal

__all__ = ["Campaign", "CampaignError", "Finding", "FrequencyRecord", "Record", "Signal", "load_campaign"]

_HOMES = {
    "loading": ("Campaign", "load_campaign"),
    "errors": ("CampaignError",),
    "finding": ("Finding",),
    "record": ("FrequencyRecord", "Record", "Signal"),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    # Lazy: the checks import scipy, and a campaign imports pydantic.
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
