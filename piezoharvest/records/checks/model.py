"""Channels against the nominal model: a likely wrong unit or sign, two that are swapped, one that is dead.

The linear two-port foretells each response in the lines where the drive has its energy. As nominal values are not
truth, a channel is judged only by what all variants of `expectation` agree on, and unless it is dead, only where it is
coherent with the drive and stands out of its own noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from piezoharvest.records.channels import UNITS
from piezoharvest.records.expectation import Transfers, transfers
from piezoharvest.records.finding import Finding, shifted
from piezoharvest.records.record import Record
from piezoharvest.records.spectra import Spectra, spread
from piezoharvest.transducer import Transducer

FACTOR = 30.0  # by which an amplitude may differ from what is foretold; a wrong prefix is 1000
_COHERENT = 0.7
_NEARLY = 0.8  # of the best variant's coherence
_OPPOSED = -0.5
_ABOVE_FLOOR = 10.0  # in power
_FEW = 0.2  # of the lines below the highest one that the drive uses: the others show the noise


@dataclass(frozen=True)
class Score:
    """How a response compares with what is foretold.

    Attributes
    ----------
    low, high : float
        Measured over foretold amplitude, the least and the largest of all variants.
    agreement : float
        Correlation with what is foretold, from -1 to 1: the largest of the variants that fit nearly best.
    coherence : float
        Magnitude of the complex correlation, the best of all variants.
    stands_out : bool
        Whether the response is above its own noise.
    """

    low: float
    high: float
    agreement: float
    coherence: float
    stands_out: bool

    @property
    def judged(self) -> bool:
        """Whether the response is one to the drive, so that unit and sign can be told."""
        return self.coherence > _COHERENT and self.stands_out

    @property
    def too_large(self) -> bool:
        """Larger than foretold by every variant."""
        return self.low > FACTOR

    @property
    def too_small(self) -> bool:
        """Smaller than foretold by every variant."""
        return self.high < 1 / FACTOR

    @property
    def reversed(self) -> bool:
        """Against what is foretold by every variant."""
        return self.judged and self.agreement < _OPPOSED

    @property
    def fine(self) -> bool:
        """A response in the right unit and of the right sign."""
        return self.judged and not (self.too_large or self.too_small or self.reversed)

    @property
    def factor(self) -> float:
        """Measured over foretold amplitude."""
        return float(np.sqrt(self.low * self.high))


def against_model(record: Record, spectra: Spectra, transducer: Transducer) -> Iterator[Finding]:
    """Compare every response with what the nominal model foretells."""
    scores = _scores(record, {channel: spectra[channel] for channel in record.signals}, spectra, transducer)
    off = {channel for channel, score in scores.items() if score.too_large or score.too_small}
    swapped = _swapped(record, spectra, transducer, scores) if off else None
    if swapped:
        yield _finding(record, "swapped", swapped[0], _swap_message(*swapped))
        scores = {} if record.drive in swapped else {c: score for c, score in scores.items() if c not in swapped}
    yield from _wrong_units(record, scores)
    yield from _wrong_signs(record, scores)
    for channel, score in scores.items():
        if score.too_small and not score.judged:
            least = f"found at most {score.high:.2g} times what the nominal model gives for this {_named(record.drive)}"
            message = f"{least}, and no likeness to it, allowed is a channel that is alive"
            yield _finding(record, "dead", channel, message)


def _scores(
    record: Record, spectra: Mapping[str, np.ndarray], own: Spectra, transducer: Transducer
) -> dict[str, Score]:
    """Score of every response that something is foretold of."""
    lines = own.lines(spectra[record.drive])
    if not len(lines):
        return {}
    some = spread(lines)
    foretold = transfers(transducer, record.shunt, record.drive, own.frequencies[some])
    found = {}
    for channel in record.responses:
        expected = predicted(foretold, channel, {cause: values[some] for cause, values in spectra.items()})
        if expected is not None:
            found[channel] = _score(spectra[channel], some, lines, expected)
    return found


def predicted(foretold: Transfers, channel: str, causes: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Spectrum (variants, f) that a response should have; None where nothing is known or nothing is to come."""
    by_cause = foretold.get(channel)
    if by_cause is None:
        return None
    total = np.sum([transfer * causes[cause] for cause, transfer in by_cause.items() if cause in causes], axis=0)
    return total if np.any(total, axis=-1).all() else None


def _score(response: np.ndarray, some: np.ndarray, lines: np.ndarray, expected: np.ndarray) -> Score:
    """Compare a response with its expectation (variants, f) in some of the drive's lines."""
    measured = response[some]
    energy = np.linalg.norm(measured)
    foretold = np.linalg.norm(expected, axis=-1)
    correlation = expected.conj() @ measured / np.maximum(energy * foretold, np.finfo(float).tiny)
    fit = np.abs(correlation)
    others = np.ones(min(len(response), 2 * int(lines[-1]) + 10), bool)
    others[: lines[0]] = False
    others[np.unique(np.clip(lines[:, None] + np.arange(-3, 4), 0, len(others) - 1))] = False
    stands_out = True
    if others.sum() > 10 and len(lines) < _FEW * len(others):
        floor = np.median(np.abs(response[: len(others)][others]) ** 2)
        stands_out = bool(energy**2 > _ABOVE_FLOOR * floor * len(some))
    return Score(
        low=float(np.min(energy / foretold)), high=float(np.max(energy / foretold)),
        agreement=float(np.max(correlation.real[fit >= _NEARLY * fit.max()])), coherence=float(fit.max()),
        stands_out=stands_out,
    )  # fmt: skip


def _swapped(
    record: Record, spectra: Spectra, transducer: Transducer, scores: Mapping[str, Score]
) -> tuple[str, str] | None:
    """Two channels that are wrong as they stand and fine when they are exchanged.

    With the drive in the wrong place, nothing is right; with a single response, a prefix may explain as much.
    """
    channels = {channel: spectra[channel] for channel in record.signals}
    wrong = {channel for channel, score in scores.items() if not score.fine}
    for one, other in combinations(channels, 2):
        involved = scores.keys() if record.drive in (one, other) else {one, other}
        if not involved <= wrong or (len(scores) == 1 and _prefix(next(iter(scores.values())).factor)):
            continue
        exchanged = _scores(record, channels | {one: channels[other], other: channels[one]}, spectra, transducer)
        members = [exchanged[channel] for channel in (one, other) if channel in exchanged]
        rest = [score.fine for channel, score in exchanged.items() if scores[channel].judged]
        if members and all(score.fine for score in members) and all(rest):
            return one, other
    return None


def _wrong_units(record: Record, scores: Mapping[str, Score]) -> Iterator[Finding]:
    """Channels that are coherent with what is foretold but of quite another size; the drive, if it is all of them."""
    off = {c: score for c, score in scores.items() if score.judged and (score.too_large or score.too_small)}
    factors = [score.factor for score in off.values()]
    alike = len(off) > 1 and max(factors) < FACTOR * min(factors)
    if alike and len(off) == sum(score.judged for score in scores.values()):
        factor = 1 / float(np.exp(np.mean(np.log(factors))))
        message = f"found {factor:.2g} times the {_named(record.drive)} that the nominal model takes from all responses"
        yield _finding(record, "unit", record.drive, f"{message}, {_unit_hint(record.drive, factor)}")
        return
    for channel, score in off.items():
        message = f"found {score.factor:.2g} times what the nominal model gives for this {_named(record.drive)}"
        yield _finding(record, "unit", channel, f"{message}, {_unit_hint(channel, score.factor)}")


def _unit_hint(channel: str, factor: float) -> str:
    """What is allowed, and the unit that would explain the factor."""
    prefix = _prefix(factor)
    unit = f" (is it {prefix}{UNITS[channel]}?)" if prefix and channel != "base_acceleration" else ""
    return f"allowed is up to {FACTOR:g} times more or less; likely a wrong unit{unit}"


def _prefix(factor: float) -> str:
    """Prefix of a unit, if one explains that values are too large by a factor."""
    power = float(np.log10(factor))
    prefix = {-3: "k", -6: "M", 3: "m", 6: "u", 9: "n"}.get(3 * round(power / 3), "")
    return prefix if abs(power - 3 * round(power / 3)) < 1 else ""


def _wrong_signs(record: Record, scores: Mapping[str, Score]) -> Iterator[Finding]:
    """Channels that go against what is foretold; the drive, if it is all of them."""
    opposed = [channel for channel, score in scores.items() if score.reversed]
    if len(opposed) > 1 and len(opposed) == sum(score.judged for score in scores.values()):
        message = f"found all responses against what the nominal model gives for this {_named(record.drive)}"
        yield _finding(record, "sign", record.drive, f"{message}, {_SIGN_HINT}")
        return
    for channel in opposed:
        message = f"found it against what the nominal model gives for this {_named(record.drive)}"
        hint = " (current is that of the load, out of the transducer)" if channel == "current" else ""
        yield _finding(record, "sign", channel, f"{message}, {_SIGN_HINT}{hint}")


_SIGN_HINT = "allowed is the sign of the model; likely a wrong sign, which a gain below zero turns"


def _swap_message(one: str, other: str) -> str:
    found = f"found that {_named(one)} and {_named(other)} fit the nominal model only when exchanged"
    return f"{found}, allowed are columns in their places; likely swapped"


def _named(channel: str) -> str:
    return channel.replace("_", " ")


def _finding(record: Record, check: str, channel: str, message: str) -> Finding:
    signal = record.signals[channel]
    return Finding("error", check, signal.file, channel, shifted([(0, len(record) - 1)], signal.first_row), message)
