"""Comparison of channels with the nominal model: a likely wrong unit or sign, swapped channels, a dead channel.

The linear two-port predicts each response in the lines with the drive's energy. As nominal values may be wrong, a
channel is judged only by what all variants of `expectation` agree on, and unless it is dead, only if it is coherent
with the drive and above its own noise.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from itertools import combinations

import numpy as np

from piezoharvest.description.shunts import LinearShunt, Shunt
from piezoharvest.description.shunts.linear.resistor import Resistor
from piezoharvest.description.shunts.linear.short import Short
from piezoharvest.description.transducer import Transducer
from piezoharvest.records.checks.score import MAX_FACTOR, Score, likely_cause, scores_of
from piezoharvest.records.finding import Finding, shifted
from piezoharvest.records.reading.channels import UNITS
from piezoharvest.records.record import Record
from piezoharvest.records.spectra import Spectra

ELECTRIC = ("voltage", "current")  # channels whose sign is that of the leads
_MUCH_NEARER = 5.0  # ratio of two deviations of an amplitude from the prediction
_LEAST_AGREEMENT = 0.8  # correlation, in phase, of exchanged channels with their predictions
_MIN_STEP = 0.2  # of the drive's range from one sample to the next
_JUMP = 5.0  # medians of the change between two samples from which on a voltage is taken for one that a switch inverts


def against_model(record: Record, spectra: Spectra, transducer: Transducer) -> Iterator[Finding]:
    """Compare every response with the prediction of the nominal model."""
    scores = scores_of(record, {channel: spectra[channel] for channel in record.signals}, spectra, transducer)
    wrong = any(score.too_large or score.too_small or score.reversed for score in scores.values())
    swapped = _swapped(record, spectra, transducer, scores) if wrong else None
    if swapped:
        yield _finding(record, "swapped", swapped[0], _swap_message(*swapped))
        scores = {} if record.drive in swapped else {c: score for c, score in scores.items() if c not in swapped}

    def misfit(load: Shunt) -> float | None:
        behind = dataclasses.replace(record, shunt=load)
        others = scores_of(behind, {channel: spectra[channel] for channel in record.signals}, spectra, transducer)
        judged = [others[channel] for channel, score in scores.items() if score.judged]
        return sum(abs(np.log(score.factor)) for score in judged) if all(score.fine for score in judged) else None

    yield from _wrong_units(record, scores, misfit)
    yield from _wrong_signs(record, scores, lambda: _with_other_polarity(record, spectra, transducer))
    if "current" in record.responses and not wrong and not isinstance(record.shunt, LinearShunt):
        yield from _beyond_charge(record, transducer)
    over = ("voltage", "current") if _over_between_samples(record, transducer) else ()
    for channel, score in scores.items():
        if score.too_small and not score.judged and channel not in over:
            least = f"found at most {score.high:.2g} times what the nominal model gives for this {_named(record.drive)}"
            message = f"{least}, and not correlated with it; likely a dead channel"
            yield _finding(record, "dead", channel, message)


def _over_between_samples(record: Record, transducer: Transducer) -> bool:
    """True if the charge from a step of the drive flows off between two samples, unmeasured."""
    shunt, drive = record.shunt, record[record.drive]
    if np.max(np.abs(np.diff(drive))) < _MIN_STEP * np.ptp(drive):
        return False
    if record.drive == "voltage" or isinstance(shunt, Short):
        return True
    return isinstance(shunt, Resistor) and shunt.resistance * transducer.capacitance * record.sample_rate < 1


def _swapped(
    record: Record, spectra: Spectra, transducer: Transducer, scores: Mapping[str, Score]
) -> tuple[str, str] | None:
    """Two channels that are wrong, but right if they are exchanged; of several pairs that which fits best.

    If the drive is exchanged, no response is right; with a single response, a wrong prefix may be the cause instead.
    Where no amplitude is wrong, a wrong sign is likelier than an exchange that does not fit in phase.
    """
    channels = {channel: spectra[channel] for channel in record.signals}
    off = any(score.too_large or score.too_small for score in scores.values())
    best: tuple[float, tuple[str, str]] | None = None
    for one, other in combinations(channels, 2):
        if len(scores) == 1 and _prefix(next(iter(scores.values())).factor):
            continue
        exchanged = scores_of(record, channels | {one: channels[other], other: channels[one]}, spectra, transducer)
        involved = scores.keys() if record.drive in (one, other) else {one, other}
        members = [exchanged[channel] for channel in (one, other) if channel in exchanged]
        rest = [score.fine for channel, score in exchanged.items() if scores[channel].judged]
        if not members or not all(score.fine for score in members) or not all(rest):
            continue
        if not all(_is_better(scores[channel], exchanged[channel]) for channel in involved if channel in exchanged):
            continue
        if not off and min(score.agreement for score in members) < _LEAST_AGREEMENT:
            continue
        misfit = sum(abs(np.log(score.factor)) for score in exchanged.values() if score.fine)
        if best is None or misfit < best[0]:
            best = misfit, (one, other)
    return None if best is None else best[1]


def _is_better(score: Score, exchanged: Score) -> bool:
    """True if a response is wrong as it is, or at the edge of what is allowed and not so with channels exchanged."""
    if not score.fine:
        return True
    return abs(np.log(score.factor)) - abs(np.log(exchanged.factor)) > np.log(_MUCH_NEARER)


def _wrong_units(
    record: Record, scores: Mapping[str, Score], misfit: Callable[[Shunt], float | None]
) -> Iterator[Finding]:
    """Findings for channels coherent with the prediction but of another magnitude; for the drive, if all are.

    `misfit` is that of all channels behind another load, which is named where they agree with the prediction.
    """
    off = {c: score for c, score in scores.items() if score.judged and (score.too_large or score.too_small)}
    factors = [score.factor for score in off.values()]
    alike = len(off) > 1 and max(factors) < MAX_FACTOR * min(factors)
    if alike and len(off) == sum(score.judged for score in scores.values()):
        factor = 1 / float(np.exp(np.mean(np.log(factors))))
        message = (
            f"found {factor:.2g} times the {_named(record.drive)} that the nominal model infers from all responses"
        )
        yield _finding(record, "unit", record.drive, f"{message}, {_unit_hint(record, record.drive, factor, misfit)}")
        return
    for channel, score in off.items():
        message = f"found {score.factor:.2g} times what the nominal model gives for this {_named(record.drive)}"
        yield _finding(record, "unit", channel, f"{message}, {_unit_hint(record, channel, score.factor, misfit)}")


def _beyond_charge(record: Record, transducer: Transducer) -> Iterator[Finding]:
    """Finding for a current behind a circuit with events that displacement and voltage have no charge for.

    Whatever the circuit is, the current is i = -d(C v + T x)/dt, so that its mean magnitude is no more than those of
    both parts together. Noise of the two only raises that. How little it may be depends on the circuit. An inversion of
    the voltage is shorter than a sample, which may hit its pulse: samples beside one are left out.
    """
    if "displacement" not in record.signals or "voltage" not in record.signals or record.drive == "voltage":
        return
    steps = np.diff(record["time"])
    voltage, strain = np.diff(record["voltage"]), np.diff(record["displacement"])
    median = float(np.median(np.abs(voltage)))  # zero of a coarse converter
    calm = np.abs(voltage) <= (_JUMP * median if median > 0.0 else np.inf)
    inside = calm[1:] & calm[:-1]  # samples with calm steps on both sides
    coupling = max(abs(mode.coupling) for mode in transducer.all_modes)
    rates = (transducer.capacitance * np.abs(voltage) + coupling * np.abs(strain)) / steps
    most = float(np.mean(0.5 * (rates[1:] + rates[:-1])[inside])) if inside.any() else 0.0
    factor = float(np.mean(np.abs(record["current"][1:-1][inside]))) / most if most > 0.0 else 0.0
    if factor > MAX_FACTOR:
        than = "times the largest current that displacement and voltage give with the nominal capacitance and coupling"
        # The least prefix of so much; nominal values may be off by two.
        hint = _unit_hint(record, "current", 1000.0 ** np.ceil(np.log10(0.5 * factor) / 3.0))
        yield _finding(record, "unit", "current", f"found at least {factor:.2g} {than}, {hint}")


def _unit_hint(
    record: Record, channel: str, factor: float, misfit: Callable[[Shunt], float | None] | None = None
) -> str:
    """Text with what is allowed, and the unit, or the load, that would explain the factor."""
    prefix = _prefix(factor / record.signals[channel].factor)
    told = prefix is not None and channel != "base_acceleration" and _prefix(factor) != ""
    unit = f" (is it {prefix}{UNITS[channel]}?)" if told else ""
    allowed = f"a factor of up to {MAX_FACTOR:g} either way is allowed"
    cause = f"a wrong unit{unit} or `gain`"
    load = None if misfit is None else likely_cause(record.shunt, misfit, cause, "a wrong unit or `gain`")
    return f"{allowed}; {load or f'likely {cause}'}"


def _prefix(factor: float) -> str | None:
    """Prefix of the unit that would explain values too large by a factor, "" for none; None if no prefix would."""
    power = float(np.log10(factor))
    prefix = {-3: "k", -6: "M", 0: "", 3: "m", 6: "u", 9: "n"}.get(3 * round(power / 3))
    return prefix if abs(power - 3 * round(power / 3)) < 1 else None


def _with_other_polarity(record: Record, spectra: Spectra, transducer: Transducer) -> bool:
    """True if all responses have the right sign once the leads are exchanged."""
    turned = transducer.reversed_leads
    scores = scores_of(record, {channel: spectra[channel] for channel in record.signals}, spectra, turned)
    return not any(score.reversed for score in scores.values())


def _wrong_signs(record: Record, scores: Mapping[str, Score], turned: Callable[[], bool]) -> Iterator[Finding]:
    """Findings for channels of the opposite sign to the prediction; for the drive, if all are.

    `turned` tells whether exchanged leads are the reason, which one finding says for all channels.
    """
    opposed, drive = [channel for channel, score in scores.items() if score.reversed], record.drive
    than = f"of opposite sign to what the nominal model gives for this {_named(drive)}"
    if not opposed:
        return
    if (set(opposed) <= set(ELECTRIC) or drive == "voltage") and turned():
        gains = " and ".join(f"{c} = {{ {record.signals[c].reverse} }}" for c in ELECTRIC if c in record.signals)
        several = " and ".join(map(_named, opposed))
        message = (
            f"found {several} {than}; likely the leads have the other polarity, which is free: "
            "with a positive coupling, a positive displacement makes the voltage of open electrodes negative, so that "
            f"a coupling below zero in [transducer] is right here, and so is {gains} in [channels]"
        )
        yield _finding(record, "sign", opposed[0], message)
        return
    if len(opposed) > 1 and len(opposed) == sum(score.judged for score in scores.values()):
        message = f"found all responses {than}, {_sign_hint(record, drive)}"
        yield _finding(record, "sign", drive, message)
        return
    for channel in opposed:
        hint = " (current is that of the load, out of the transducer)" if channel == "current" else ""
        yield _finding(record, "sign", channel, f"found values {than}, {_sign_hint(record, channel)}{hint}")


def _sign_hint(record: Record, channel: str) -> str:
    """What corrects a wrong sign, with the unit and gain that the channel has already."""
    return f"likely a wrong sign, which {channel} = {{ {record.signals[channel].reverse} }} in [channels] corrects"


def _swap_message(one: str, other: str) -> str:
    found = f"found that {_named(one)} and {_named(other)} fit the nominal model only when exchanged"
    return f"{found}; likely their columns are swapped"


def _named(channel: str) -> str:
    return channel.replace("_", " ")


def _finding(record: Record, check: str, channel: str, message: str) -> Finding:
    signal = record.signals[channel]
    return Finding("error", check, signal.file, channel, shifted([(0, len(record) - 1)], signal.first_row), message)
