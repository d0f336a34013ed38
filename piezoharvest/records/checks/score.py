"""Comparison of responses with the predictions of the nominal model, in the lines with the drive's energy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from piezoharvest.description.transducer import Transducer
from piezoharvest.records.expectation import Transfers, transfers
from piezoharvest.records.record import Record
from piezoharvest.records.spectra import Spectra, spread

MAX_FACTOR = 30.0  # by which an amplitude may differ from the prediction; a wrong prefix is 1000
_MIN_COHERENCE = 0.7
_NEARLY_BEST = 0.8  # of the best variant's coherence
_MAX_OPPOSED_AGREEMENT = -0.5
_MIN_POWER_RATIO = 10.0  # in power
_MAX_LINE_SHARE = 0.2  # largest share of the drive's lines, up to its highest: the others show the noise


@dataclass(frozen=True)
class Score:
    """Comparison of a response with its prediction.

    Attributes
    ----------
    low, high : float
        Measured over predicted amplitude, the least and the largest of all variants.
    agreement : float
        Correlation with the prediction, from -1 to 1: the largest of the variants that fit nearly best.
    coherence : float
        Magnitude of the complex correlation, the best of all variants.
    stands_out : bool
        True if the response is above its own noise.
    """

    low: float
    high: float
    agreement: float
    coherence: float
    stands_out: bool

    @property
    def judged(self) -> bool:
        """True if the response is caused by the drive, so that its unit and sign can be judged."""
        return self.coherence > _MIN_COHERENCE and self.stands_out

    @property
    def too_large(self) -> bool:
        """True if the response is larger than predicted by every variant."""
        return self.low > MAX_FACTOR

    @property
    def too_small(self) -> bool:
        """True if the response is smaller than predicted by every variant."""
        return self.high < 1 / MAX_FACTOR

    @property
    def reversed(self) -> bool:
        """True if the response is of the opposite sign to the prediction of every variant."""
        return self.judged and self.agreement < _MAX_OPPOSED_AGREEMENT

    @property
    def fine(self) -> bool:
        """True if the response is in the right unit and of the right sign."""
        return self.judged and not (self.too_large or self.too_small or self.reversed)

    @property
    def factor(self) -> float:
        """Measured over predicted amplitude."""
        return float(np.sqrt(self.low * self.high))


def scores_of(
    record: Record, spectra: Mapping[str, np.ndarray], own: Spectra, transducer: Transducer
) -> dict[str, Score]:
    """Score of every response with a prediction."""
    lines = own.lines(spectra[record.drive])
    if not len(lines):
        return {}
    some = spread(lines)
    responses = transfers(transducer, record.shunt, record.drive, own.frequencies[some])
    found = {}
    for channel in record.responses:
        expected = predicted(responses, channel, {cause: values[some] for cause, values in spectra.items()})
        if expected is not None:
            found[channel] = _score(spectra[channel], some, lines, expected)
    return found


def predicted(responses: Transfers, channel: str, causes: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Predicted spectrum (variants, f) of a response; None if there is no prediction or it is zero."""
    by_cause = responses.get(channel)
    if by_cause is None:
        return None
    total = np.sum([transfer * causes[cause] for cause, transfer in by_cause.items() if cause in causes], axis=0)
    return total if np.any(total, axis=-1).all() else None


def _score(response: np.ndarray, some: np.ndarray, lines: np.ndarray, expected: np.ndarray) -> Score:
    """Compare a response with its expectation (variants, f) in some of the drive's lines."""
    measured = response[some]
    energy = np.linalg.norm(measured)
    expected_size = np.linalg.norm(expected, axis=-1)
    correlation = expected.conj() @ measured / np.maximum(energy * expected_size, np.finfo(float).tiny)
    fit = np.abs(correlation)
    others = np.ones(min(len(response), 2 * int(lines[-1]) + 10), bool)
    others[: lines[0]] = False
    others[np.unique(np.clip(lines[:, None] + np.arange(-3, 4), 0, len(others) - 1))] = False
    stands_out = True
    if others.sum() > 10 and len(lines) < _MAX_LINE_SHARE * len(others):
        floor = np.median(np.abs(response[: len(others)][others]) ** 2)
        stands_out = bool(energy**2 > _MIN_POWER_RATIO * floor * len(some))
    return Score(
        low=float(np.min(energy / expected_size)), high=float(np.max(energy / expected_size)),
        agreement=float(np.max(correlation.real[fit >= _NEARLY_BEST * fit.max()])), coherence=float(fit.max()),
        stands_out=stands_out,
    )  # fmt: skip
