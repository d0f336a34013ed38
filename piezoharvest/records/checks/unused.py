"""Channels that no prediction has: they are left out of fits."""

from __future__ import annotations

from collections.abc import Iterator

from piezoharvest.records.finding import Finding, shifted
from piezoharvest.records.record import Record


def unused(record: Record) -> Iterator[Finding]:
    """Check for channels that the model does not predict under the record's drive.

    Of a force it knows the one that drives, or the one that an imposed displacement takes.
    """
    reasons = {
        "force": record.drive not in ("force", "displacement"),
        "acceleration": record.drive == "displacement",
        "base_acceleration": record.drive != "base_acceleration",
        "gate": True,
    }
    for channel, signal in record.signals.items():
        if reasons.get(channel, False):
            rows = shifted([(0, len(record) - 1)], signal.first_row)
            message = f"found a channel that is not predicted in a record driven by {record.drive}; it is not used"
            yield Finding("warning", "unused", signal.file, channel, rows, message)
