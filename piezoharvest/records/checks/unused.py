"""Channels that no prediction has or needs: they are left out of fits."""

from __future__ import annotations

from collections.abc import Iterator

from piezoharvest.records.finding import Finding, shifted
from piezoharvest.records.record import Record


def unused(record: Record) -> Iterator[Finding]:
    """Check for channels that the model does not predict under the record's drive.

    Of a force it knows the one that drives, or the one that an imposed displacement takes. A gate times a switch.
    """
    if "gate" in record.signals and record.gate_reason:
        message = f"found a gate, but {record.gate_reason}; it is not used"
        yield _finding(record, "gate", message)
    reasons = {
        "force": record.drive not in ("force", "displacement"),
        "acceleration": record.drive == "displacement",
        "base_acceleration": record.drive != "base_acceleration",
    }
    for channel in record.signals:
        if reasons.get(channel, False):
            message = f"found a channel that is not predicted in a record driven by {record.drive}; it is not used"
            yield _finding(record, channel, message)


def _finding(record: Record, channel: str, message: str) -> Finding:
    signal = record.signals[channel]
    rows = shifted([(0, len(record) - 1)], signal.first_row)
    return Finding("warning", "unused", signal.file, channel, rows, message)
