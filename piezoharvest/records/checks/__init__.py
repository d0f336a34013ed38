"""Checks of raw data. Each looks for one kind of fault and yields what it finds; nothing is repaired.

Raw samples come first: what is not a number, time that does not run, channels that do not move. Only where these have
found no error are spectra compared with what the nominal model foretells.
"""

from __future__ import annotations

from collections.abc import Iterator

from piezoharvest.description.transducer import Transducer
from piezoharvest.records.checks.dynamics import lost_between_samples, too_short, too_slow
from piezoharvest.records.checks.frequency import check_frequency
from piezoharvest.records.checks.hum import mains_hum
from piezoharvest.records.checks.model import against_model
from piezoharvest.records.checks.raw import beyond_measure, clock, not_a_number
from piezoharvest.records.checks.spikes import spikes
from piezoharvest.records.checks.stated import stated_noise
from piezoharvest.records.checks.stuck import constant, standing_still
from piezoharvest.records.finding import Finding
from piezoharvest.records.record import FrequencyRecord, Record
from piezoharvest.records.spectra import Spectra

__all__ = ["check"]

_ALIASED = 0.15  # of a response that is lost between samples: the lines of such a record are not those of the drive


def check(record: Record | FrequencyRecord, transducer: Transducer) -> tuple[Finding, ...]:
    """Look at a record before it is believed.

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
    found += stated_noise(record)
    spectra = Spectra(record)
    lost = lost_between_samples(record, spectra, transducer)
    if lost < _ALIASED:
        found += against_model(record, spectra, transducer)
    if not _errors(found):
        found += mains_hum(record, spectra, transducer)
        found += too_short(record, transducer)
        found += too_slow(record, lost)
    return tuple(found)


def _errors(found: list[Finding]) -> bool:
    """Whether what comes next has nothing to go by."""
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
