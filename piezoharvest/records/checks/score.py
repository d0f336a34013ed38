"""Comparison of responses with the predictions of the nominal model, in the lines with the drive's energy.

Where they disagree, another prefix of a value of the load ("1 mohm" for "1 Mohm") may be the reason.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from piezoharvest.description.shunts import LinearShunt, Resistor, Shunt
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
# Sum of the squared correlations of a Hann window's line with all others, 1 + 2 (2/3)^2 + 2 (1/6)^2: so many lines are
# worth one that is independent.
_LINES_FOR_ONE = 1.0 + 2.0 * (4.0 / 9.0 + 1.0 / 36.0)
# By chance a response rings as the prediction does where both are a resonance, few lines wide, whatever the drive is: a
# decay beside the noise of a drive at rest. In one of a thousand records such a response may count as coherent.
_MOST_CHANCE = 1e-3
# Powers of ten between the prefixes that are taken for one another: m and M are 9 apart, u and M 12, neighbours 3, a
# prefix that was left out 3 or 6. The least change is told, unless a larger one is nearer by more than a factor of two,
# which nominal values may be off.
_POWERS = (3, -3, 6, -6, 9, -9, 12, -12)
_NEARER = float(np.log(2.0))
_FAR = 6  # decades; beyond them a prefix of the load is likelier than a unit such as nV, which nobody records


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
        True if the response is above its own noise; beside a drive that leaves no lines free for that, if it is not by
        chance that it is so coherent.
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
    else:
        best = expected[int(fit.argmax())]
        stands_out = _chance(fit.max(), best, measured) < _MOST_CHANCE
    return Score(
        low=float(np.min(energy / expected_size)), high=float(np.max(energy / expected_size)),
        agreement=float(np.max(correlation.real[fit >= _NEARLY_BEST * fit.max()])), coherence=float(fit.max()),
        stands_out=stands_out,
    )  # fmt: skip


def _chance(coherence: float, one: np.ndarray, other: np.ndarray) -> float:
    """Probability that spectra (f,) of these magnitudes and random phases have at least this coherence."""
    powers = np.abs(one) ** 2, np.abs(other) ** 2
    together = max(float(powers[0] @ powers[1]), np.finfo(float).tiny)
    count = float(powers[0].sum() * powers[1].sum()) / together / _LINES_FOR_ONE
    return float(max(1.0 - coherence**2, 0.0) ** max(count - 1.0, 0.0))


def likely_cause(shunt: Shunt | None, misfit: Callable[[Shunt], float | None], cause: str, plain: str) -> str | None:
    """Text of a message that says what is likely wrong, the load as well.

    Parameters
    ----------
    shunt : Shunt or None
        As the campaign says.
    misfit : callable
        Logarithm of the factor by which a record is off what is expected behind another load; None if it disagrees.
    cause : str
        What else may be wrong, such as "a wrong unit (is it mV?)".
    plain : str
        The same without a guess of the unit, where the load is the likelier cause.

    Returns
    -------
    str or None
        None if no other prefix of a value of the load makes the record agree.
    """
    best: tuple[float, Shunt, str, int] | None = None
    for other, name, power in _with_other_prefixes(shunt):
        off = misfit(other)
        if off is not None and (best is None or off < best[0] - _NEARER):
            best = off, other, name, power
    if best is None:
        return None
    _, other, name, power = best
    found, right = getattr(shunt, name), getattr(other, name)
    field = next(field for field in dataclasses.fields(other) if field.name == name)
    what = field.metadata["doc"] if isinstance(shunt, Resistor) else f"{name} of the load"
    unit = field.metadata["unit"]
    prefixes = "; the prefix m is 1e-3, M is 1e6" if abs(power) >= _FAR else ""
    load = f"a wrong prefix of the {what} (found {found:g} {unit}, {right:g} {unit} would do{prefixes})"
    return f"likely {load}, or {plain}" if abs(power) > _FAR else f"likely {cause}, or {load}"


def _with_other_prefixes(shunt: Shunt | None) -> Iterator[tuple[Shunt, str, int]]:
    """Loads with one value changed by a prefix, the value's name and the power of ten."""
    if not isinstance(shunt, LinearShunt):  # behind diodes and switches there is no prediction
        return
    for power in _POWERS:
        for field in dataclasses.fields(shunt):
            value = getattr(shunt, field.name)
            if field.metadata.get("unit") and isinstance(value, float) and value != 0.0:
                try:
                    yield dataclasses.replace(shunt, **{field.name: value * 10.0**power}), field.name, power
                except ValueError:  # a value that cannot be
                    continue
