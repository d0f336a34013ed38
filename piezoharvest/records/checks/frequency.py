"""Checks of frequency responses and impedances: values, frequencies, and comparison with the nominal model."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from piezoharvest.description.shunts import Shunt
from piezoharvest.description.transducer import Transducer
from piezoharvest.records.checks.model import ELECTRIC
from piezoharvest.records.checks.raw import ALLOWED_MAGNITUDES, impossible_magnitudes
from piezoharvest.records.checks.score import MAX_FACTOR, likely_cause
from piezoharvest.records.expectation import impedances, transfers
from piezoharvest.records.finding import Finding, runs, shifted
from piezoharvest.records.reading.channels import RATES
from piezoharvest.records.record import FrequencyRecord

_MAX_NEGATIVE_SHARE = 0.05  # share of |Z| by which the resistance may be below zero
_MAX_OPPOSED_COSINE = -0.5
_RESONANCE_RATIOS = (0.7, 1.4)  # least and largest ratio of a resonance to its nominal frequency
_RATIO_COUNT = 25  # ratios that are tried
_COMPARED_LINES = 100  # lines that are compared at each place


def check_frequency(record: FrequencyRecord, transducer: Transducer) -> Iterator[Finding]:
    """All checks of a frequency response or an impedance."""
    wrong = list(_values(record))
    yield from wrong
    if not wrong:
        yield from _against_model(record, transducer)


def _values(record: FrequencyRecord) -> Iterator[Finding]:
    """Checks for values that are impossible."""
    finite = np.isfinite(record.frequency) & np.isfinite(record.response)
    if record.coherence is not None:
        finite &= np.isfinite(record.coherence)
    yield from _found(record, "nan", "response", ~finite, "rows with NaN, infinite or missing values", "numbers")
    yield from _found(record, "frequency", "frequency", record.frequency <= 0, "values not above 0 Hz", "those above")
    for channel, values in (("frequency", record.frequency), ("response", record.response)):
        yield from _found(
            record, "size", channel, impossible_magnitudes(values), "values out of range", ALLOWED_MAGNITUDES
        )
    if record.coherence is not None:
        outside = (record.coherence < 0) | (record.coherence > 1 + 1e-6)
        yield from _found(record, "coherence", "coherence", outside, "values outside", "values from 0 to 1")
    if len(record) > 1 and finite.all() and np.all(record.response == record.response[0]):
        yield from _found(record, "constant", "response", finite, "equal values", "a response that changes")


def _found(
    record: FrequencyRecord, check: str, channel: str, mask: np.ndarray, what: str, allowed: str
) -> Iterator[Finding]:
    """Finding for the lines of a mask, unless it is empty."""
    if mask.any():
        rows = shifted(runs(mask), record.first_row)
        some = what if mask.sum() > 1 else f"{what.partition(' ')[0].removesuffix('s')} {what.partition(' ')[2]}"
        message = f"found {int(mask.sum())} {some}, allowed are {allowed}"
        yield Finding("error", check, record.name, channel, rows, message)


def _against_model(record: FrequencyRecord, transducer: Transducer) -> Iterator[Finding]:
    """Checks for a likely wrong unit or sign."""
    everything = np.ones(len(record), bool)
    if record.kind == "impedance":
        active = np.real(record.response) < -_MAX_NEGATIVE_SHARE * np.abs(record.response)
        if np.mean(active) > 0.5:
            what = "values with a resistance below zero"
            yield from _found(record, "sign", "response", active, what, "passive ones; likely a wrong sign or phase")
            return
    expected = _expected(record, transducer, record.frequency)
    response = record.response / (2j * np.pi * record.frequency) ** RATES.get(record.output, 0)
    if expected is None or not any(_deviation(response, expected)):
        return
    # Near a resonance, phase and magnitude change by more than the error of a nominal value suggests.
    few = np.linspace(0, len(record) - 1, min(len(record), _COMPARED_LINES)).astype(int)
    placed = _with_shifted_resonances(record, transducer, few)
    ratio, opposed = _deviation(response[few], placed if placed is not None else expected[:, few])
    if ratio:
        what = f"values of {_times(ratio)} times what the nominal model gives"

        def misfit(load: Shunt) -> float | None:
            behind = dataclasses.replace(record, shunt=load)
            others = _with_shifted_resonances(behind, transducer, few)
            if others is None or any(_deviation(response[few], others)):
                return None
            return abs(float(np.median(np.log(np.abs(response[few]) / np.abs(others)))))

        cause = likely_cause(record.shunt, misfit, "a wrong unit", "a wrong unit") or "likely a wrong unit"
        allowed = f"those up to {MAX_FACTOR:g} times more or less; {cause}"
        yield from _found(record, "unit", "response", everything, what, allowed)
    if opposed:
        what = "values against what the nominal model gives"
        between = (record.input in ELECTRIC) != (record.output in ELECTRIC)
        leads = (
            " or leads of the other polarity, for which the coupling in [transducer] is below zero" if between else ""
        )
        yield from _found(
            record, "sign", "response", everything, what, f"those of its sign; likely a wrong sign{leads}"
        )


def _times(ratio: float) -> str:
    """A ratio in words: 780, not 7.8e+02."""
    return f"{float(f'{ratio:.2g}'):g}"


def _deviation(response: np.ndarray, expected: np.ndarray) -> tuple[float | None, bool]:
    """Ratio of a response to all expected ones (variants, f), if it is large, and True if it opposes all of them."""
    ratio = np.median(np.log(np.abs(response) / np.abs(expected)), axis=-1)
    far = ratio.min() > np.log(MAX_FACTOR) or ratio.max() < -np.log(MAX_FACTOR)
    turn = np.median(np.cos(np.angle(response) - np.angle(expected)), axis=-1)
    return float(np.exp(np.median(ratio))) if far else None, bool(turn.max() < _MAX_OPPOSED_COSINE)


def _with_shifted_resonances(record: FrequencyRecord, transducer: Transducer, few: np.ndarray) -> np.ndarray | None:
    """Expected responses (variants, f) of some lines with the resonances shifted about their nominal frequencies."""
    own = np.array([np.sqrt(mode.stiffness / mode.mass) / (2 * np.pi) for mode in transducer.all_modes])
    band = np.linspace(record.frequency.min(), record.frequency.max(), _RATIO_COUNT)
    factors = np.concatenate([np.geomspace(*_RESONANCE_RATIOS, _RATIO_COUNT), (own[:, None] / band).ravel()])
    factors = factors[(factors >= _RESONANCE_RATIOS[0]) & (factors <= _RESONANCE_RATIOS[1])]
    expected = _expected(record, transducer, np.outer(factors, record.frequency[few]).ravel())
    return None if expected is None else expected.reshape(-1, len(few))


def _expected(record: FrequencyRecord, transducer: Transducer, frequency: np.ndarray) -> np.ndarray | None:
    """Response of the nominal model, of a rate its displacement, (variants, f); None if there is no prediction."""
    if record.kind == "impedance":
        return impedances(transducer, frequency, record.mechanical)
    output = "displacement" if record.output in RATES else record.output
    responses = transfers(transducer, record.shunt, record.input, frequency).get(output)
    expected = None if responses is None else responses[record.input]
    return expected if expected is not None and np.all(expected) else None
