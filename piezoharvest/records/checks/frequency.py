"""Frequency responses and impedances: values, order of the frequencies, and what the nominal model says."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from piezoharvest.records.checks.raw import SIZES, strange
from piezoharvest.records.checks.score import FACTOR
from piezoharvest.records.expectation import impedances, transfers
from piezoharvest.records.finding import Finding, runs, shifted
from piezoharvest.records.record import FrequencyRecord
from piezoharvest.transducer import Transducer

_ACTIVE = 0.05  # part of |Z| that may be below zero
_OPPOSED = -0.5


def check_frequency(record: FrequencyRecord, transducer: Transducer) -> Iterator[Finding]:
    """All checks of a frequency response or an impedance."""
    wrong = list(_values(record))
    yield from wrong
    if not wrong:
        yield from _against_model(record, transducer)


def _values(record: FrequencyRecord) -> Iterator[Finding]:
    """Values that cannot be."""
    finite = np.isfinite(record.frequency) & np.isfinite(record.response)
    if record.coherence is not None:
        finite &= np.isfinite(record.coherence)
    yield from _found(record, "nan", "response", ~finite, "rows with NaN, infinite or missing values", "numbers")
    yield from _found(record, "frequency", "frequency", record.frequency <= 0, "values not above 0 Hz", "those above")
    for channel, values in (("frequency", record.frequency), ("response", record.response)):
        yield from _found(record, "size", channel, strange(values), "values beyond measure", SIZES)
    if record.coherence is not None:
        outside = (record.coherence < 0) | (record.coherence > 1 + 1e-6)
        yield from _found(record, "coherence", "coherence", outside, "values outside", "values from 0 to 1")
    if len(record) > 1 and finite.all() and np.all(record.response == record.response[0]):
        yield from _found(record, "constant", "response", finite, "equal values", "a response that changes")


def _found(
    record: FrequencyRecord, check: str, channel: str, mask: np.ndarray, what: str, allowed: str
) -> Iterator[Finding]:
    """The finding that a mask stands for, unless it is empty."""
    if mask.any():
        rows = shifted(runs(mask), record.first_row)
        message = f"found {int(mask.sum())} {what}, allowed are {allowed}"
        yield Finding("error", check, record.name, channel, rows, message)


def _against_model(record: FrequencyRecord, transducer: Transducer) -> Iterator[Finding]:
    """A likely wrong unit or sign."""
    everything = np.ones(len(record), bool)
    if record.kind == "impedance":
        active = np.real(record.response) < -_ACTIVE * np.abs(record.response)
        if np.mean(active) > 0.5:
            what = "values with a resistance below zero"
            yield from _found(record, "sign", "response", active, what, "passive ones; likely a wrong sign or phase")
            return
    expected = _expected(record, transducer)
    if expected is None:
        return
    ratio = np.median(np.log(np.abs(record.response) / np.abs(expected)), axis=-1)
    if ratio.min() > np.log(FACTOR) or ratio.max() < -np.log(FACTOR):
        what = f"values of {np.exp(np.median(ratio)):.2g} times what the nominal model gives"
        allowed = f"those up to {FACTOR:g} times more or less; likely a wrong unit"
        yield from _found(record, "unit", "response", everything, what, allowed)
    turn = np.median(np.cos(np.angle(record.response) - np.angle(expected)), axis=-1)
    if turn.max() < _OPPOSED:
        what = "values against what the nominal model gives"
        yield from _found(record, "sign", "response", everything, what, "those of its sign; likely a wrong sign")


def _expected(record: FrequencyRecord, transducer: Transducer) -> np.ndarray | None:
    """The response by the nominal model, (variants, f); None where nothing is foretold."""
    if record.kind == "impedance":
        return impedances(transducer, record.frequency, record.mechanical)
    foretold = transfers(transducer, record.shunt, record.input, record.frequency).get(record.output)
    expected = None if foretold is None else foretold[record.input]
    return expected if expected is not None and np.all(expected) else None
