"""Checks of raw data. Each looks for one kind of fault and yields its findings; nothing is repaired.

Raw samples are checked first: NaN, faulty time stamps, channels that do not change. Only if these checks find no error
are spectra compared with the predictions of the nominal model.
"""

from __future__ import annotations

from collections.abc import Iterator

from piezoharvest.description.transducer import Transducer
from piezoharvest.records.checks.dynamics import lost_between_samples, too_short, too_slow
from piezoharvest.records.checks.frequency import check_frequency
from piezoharvest.records.checks.hum import mains_hum
from piezoharvest.records.checks.model import against_model
from piezoharvest.records.checks.periodic import periodic
from piezoharvest.records.checks.raw import beyond_measure, clock, not_a_number
from piezoharvest.records.checks.spikes import spikes
from piezoharvest.records.checks.stated import overlaps, stated_noise
from piezoharvest.records.checks.stuck import constant, standing_still
from piezoharvest.records.checks.unused import unused
from piezoharvest.records.finding import Finding
from piezoharvest.records.record import FrequencyRecord, Record
from piezoharvest.records.spectra import Spectra

__all__ = ["check", "overlaps"]

_MAX_LOST_SHARE = (
    0.15  # share of a response lost between samples: the lines of such a record are not those of the drive
)


def check(record: Record | FrequencyRecord, transducer: Transducer) -> tuple[Finding, ...]:
    """Check a record before it is used.

    Parameters
    ----------
    record : Record or FrequencyRecord
    transducer : Transducer
        Nominal values, by which unit, sign, length and sample rate are judged.

    Returns
    -------
    tuple of Finding
        Errors and warnings in the order of the checks; empty for a healthy record.
    """
    if isinstance(record, FrequencyRecord):
        return tuple(check_frequency(record, transducer))
    found = list(_raw(record))
    if _errors(found):
        return tuple(found)
    found += [*stated_noise(record), *periodic(record)]
    spectra = Spectra(record)
    lost = lost_between_samples(record, spectra, transducer)
    if lost < _MAX_LOST_SHARE:
        found += against_model(record, spectra, transducer)
    if not _errors(found):
        found += mains_hum(record, spectra, transducer)
        found += [] if record.periodic else [*too_short(record, transducer), *too_slow(record, lost, transducer)]
        found += unused(record)
    return tuple(found)


def _errors(found: list[Finding]) -> bool:
    """True if a finding is an error, so that later checks cannot be made."""
    return any(finding.severity == "error" for finding in found)


def _raw(record: Record) -> Iterator[Finding]:
    strange = list(beyond_measure(record))
    yield from strange
    if strange:
        return
    yield from clock(record)
    missing = list(not_a_number(record))
    yield from missing
    if not missing:
        yield from constant(record)
        yield from standing_still(record)
        yield from spikes(record)
