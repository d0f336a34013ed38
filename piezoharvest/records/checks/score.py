"""How responses compare with what the nominal model foretells, in the lines where the drive has its energy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from piezoharvest.description.transducer import Transducer
from piezoharvest.records.expectation import Transfers, transfers
from piezoharvest.records.record import Record
from piezoharvest.records.spectra import Spectra, spread

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


def scores_of(
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
