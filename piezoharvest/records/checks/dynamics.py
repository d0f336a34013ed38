"""Checks for records too short, or sampled too slowly, for the dynamics of the nominal model."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from piezoharvest.description.shunts import LinearShunt, Short
from piezoharvest.description.shunts.linear.resistor import Resistor
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.linear import poles
from piezoharvest.records.checks.score import predicted
from piezoharvest.records.expectation import transfers
from piezoharvest.records.finding import Finding, shifted
from piezoharvest.records.record import Record
from piezoharvest.records.spectra import Spectra, spread

_MISTAKEN = 1e3  # durations: who waits too short a time does so by less than a prefix
_MAX_LOST_SHARE = 0.05  # of a response's amplitude, between samples
_LIMITED_BANDWIDTH = 0.4  # cycles per sample, up to which the interpolation of records is accurate
_MAX_SHARE_ABOVE = 1e-3  # of a drive's power
_MAX_LINES = 100
_MAX_IMAGES = 64


def too_short(record: Record, transducer: Transducer) -> Iterator[Finding]:
    """Check for a record shorter than the slowest time constant: the initial state still shows at the end."""
    shunt = Short() if record.drive == "voltage" else record.shunt
    if not isinstance(shunt, LinearShunt):
        return
    point = "slip" if transducer.hysteresis else "stick"
    rates = -np.real(poles(System(transducer, shunt), operating_point=point))
    rates = rates[rates > 0]
    slowest = 1 / rates.min() if len(rates) else 0.0
    if record.duration < slowest:
        found = f"the record lasts {record.duration:.4g} s, less than the slowest time constant"
        message = f"{found} of the nominal model, {slowest:.4g} s"
        if isinstance(shunt, Resistor) and shunt.resistance * transducer.capacitance > _MISTAKEN * record.duration:
            message += f"; likely a wrong prefix of the load resistance, {shunt.resistance:g} ohm"
        rows = shifted([(0, len(record) - 1)], record.time.first_row)
        yield Finding("warning", "too short", record.time.file, "time", rows, message)


def lost_between_samples(record: Record, spectra: Spectra, transducer: Transducer) -> float:
    """Error of a response, relative to its amplitude, from linear interpolation between the samples of the drive.

    Interpolation weakens a line at f by sinc^2(f/fs) and adds images at n fs +- f, which may excite a resonance. The
    resulting response of the nominal model is compared with the response to the smooth drive.
    """
    rate, drive = record.sample_rate, spectra[record.drive]
    lines = spread(spectra.lines(drive), _MAX_LINES)
    kept = spectra.frequencies[lines]
    if not len(kept):
        return 0.0
    images = np.concatenate([n * rate + side * kept for n in range(1, _MAX_IMAGES + 1) for side in (-1, 1)])
    frequencies = np.concatenate((kept, images))
    responses = transfers(transducer, record.shunt, record.drive, frequencies, nominal=True)
    causes = {record.drive: np.tile(drive[lines], len(frequencies) // len(kept))}
    expected = (predicted(responses, channel, causes) for channel in ("displacement", "voltage", "current"))
    spectrum = next((found for found in expected if found is not None), None)
    if spectrum is None:
        return 0.0
    power, weight = np.abs(spectrum[0]) ** 2, np.sinc(frequencies / rate) ** 2
    smooth, error = power[: len(kept)], power * weight**2
    error[: len(kept)] = smooth * (1 - weight[: len(kept)]) ** 2
    return float(np.sqrt(error.sum() / smooth.sum()))


def too_slow(record: Record, lost: float, transducer: Transducer) -> Iterator[Finding]:
    """Check for a sample rate at which the samples do not tell the drive between them.

    Behind a linear circuit a fast drive acts as a function of limited bandwidth, to 0.4 of the sample rate; behind
    diodes and switches it is made of straight lines that act as a smooth curve does.
    """
    if lost <= _MAX_LOST_SHARE:
        return
    signal, rate = record.signals[record.drive], f"found {record.sample_rate:.6g} Hz"
    share, highest = _share_above(signal.values, _LIMITED_BANDWIDTH), _LIMITED_BANDWIDTH * record.sample_rate
    if not isinstance(record.shunt, LinearShunt):
        found = f"{rate}, at which straight lines between samples would lose {lost:.0%}"
        allowed = f"of the response that the nominal model gives, up to {_MAX_LOST_SHARE:.0%} is allowed"
        remedy = "the interpolation in use loses less, but parameters may be off by as much as it loses: sample faster"
        message = f"{found} {allowed}; {remedy}"
    elif share > _MAX_SHARE_ABOVE:
        above = f"and {share:.1%} of the drive's power above {highest:.4g} Hz"
        message = f"{rate}, {above}, where samples do not determine the motion between them; sample faster"
    elif transducer.short_circuit_frequency > highest:
        resonance = f"where the nominal model resonates at {transducer.short_circuit_frequency:.4g} Hz"
        remedy = "components of the drive there are aliased to lower frequencies: sample faster"
        message = f"{rate}, {resonance}, {highest:.4g} Hz is allowed; {remedy}"
    else:
        return
    rows = shifted([(0, len(record) - 1)], signal.first_row)
    yield Finding("warning", "sample rate", signal.file, record.drive, rows, message)


def _share_above(values: np.ndarray, cycles: float) -> float:
    """Share of a signal's power above a frequency, in cycles per sample."""
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(len(values)))) ** 2
    return float(power[np.fft.rfftfreq(len(values)) > cycles].sum() / max(power.sum(), np.finfo(float).tiny))
