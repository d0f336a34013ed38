"""Sparse regression of the residual on simple functions of the signals: a hint at the cause where no effect fits.

Source: Pati, Rezaiifar & Krishnaprasad, 27th Asilomar Conference, 1993 (orthogonal matching pursuit). Residuals and
signals are whitened, and the fitted parameters projected out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from operator import add

import numpy as np

from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.evaluation import map_records
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.likelihood import Whitener, spectra_of
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.model import residual_blocks
from piezoharvest.identify.fitting.output_error import inverse
from piezoharvest.identify.fitting.problem import Problem

MAX_TERMS = 3  # at most
MIN_RELATIVE_GAIN = 0.05  # of the gain of the first term: smaller gains are not reported
MIN_GAIN = 20.0  # of -2 ln L: smallest gain of a term, allowing for the number of terms tried
SQUARE_SIGN = "²"
Signals = dict[str, np.ndarray]
Terms = Callable[[Signals, float, dict[str, float]], Iterator[tuple[str, np.ndarray]]]
SYMBOLS = {
    "force": "F", "base_acceleration": "a", "displacement": "x", "velocity": "x'", "acceleration": "x''",
    "voltage": "v", "current": "i", "dc_voltage": "v_dc", "dc_current": "i_dc",
}  # fmt: skip


@dataclass(frozen=True)
class Hint:
    """One term of a sparse regression of the residual.

    Attributes
    ----------
    channel : str
        Channel of the residual.
    term : str
        Function of the signals, each less its mean and divided by its largest value.
    size : float
        Coefficient: change of the channel, in its SI unit, where the term is one.
    gain : float
        Decrease of -2 ln L by this term and those before it.
    """

    channel: str
    term: str
    size: float
    gain: float

    @property
    def of_higher_modes(self) -> bool:
        """True of what modes far above the drive's band add to a motion: it is proportional to the drive."""
        drives = [SYMBOLS[name] for name in ("force", "base_acceleration")]
        like = {"displacement": drives, "velocity": [f"d{drive}/dt" for drive in drives]}
        return self.term in like.get(self.channel, ())


def square_terms(problem: Problem, found: Fit) -> list[tuple[str, str, float]]:
    """Decrease of -2 ln L by the square of each signal in each channel: (channel, term, decrease).

    Each term is tested alone with the fitted parameters projected out; under noise, rounding included, the decrease is
    chi-squared with one degree of freedom. Odd functions are left out: a fit biased by noise in the drive leaves
    residuals along them that look significant.
    """
    normal = _NormalEquations(problem, found, _squares)
    return [
        (channel, term, float(normal.gradient[k] ** 2 / (normal.products[k, k] + normal.more_variance[k])))
        for k, (channel, term) in enumerate(normal.names)
        if normal.visible[k]
    ]


def hints(problem: Problem, found: Fit) -> list[Hint]:
    """Terms that explain most of the residual of records over time, by decreasing gain.

    Parameters
    ----------
    problem : Problem
    found : Fit
        Converged fit of these records.
    """
    normal = _NormalEquations(problem, found, _terms)
    return _orthogonal_matching_pursuit(normal) if normal.names else []


class _NormalEquations:
    """Normal equations of terms and residual, whitened, with the parameters of the fit projected out."""

    def __init__(self, problem: Problem, final: Fit, terms: Terms) -> None:
        scales, at = _scales(problem), len(final.model.parameters)
        count = at + sum(map(len, final.nuisance))
        self.names: list[tuple[str, str]] = []
        sums: dict[tuple[str, str], int] = {}
        records = [
            (data, nuisance, white)
            for data, nuisance, white in zip(problem.data, final.nuisance, final.white, strict=True)
            if isinstance(data, Data) and isinstance(white, Whitener)
        ]
        parts = []
        evaluated = map_records(lambda record: _record_sums(record, final, terms, scales), records)
        for (_, nuisance, _), (sums_of_record, names) in zip(records, evaluated, strict=True):
            columns = np.concatenate([np.arange(len(final.model.parameters)), np.arange(at, at + len(nuisance))])
            parts.append((columns, sums_of_record, names))
            at += len(nuisance)
            for name in names:
                sums.setdefault(name, len(sums))
        self.names = list(sums)
        total = np.zeros((count + len(sums),) * 2)
        right, scatter = np.zeros(count + len(sums)), np.zeros_like(total)
        for columns, (products, gradient, spread), names in parts:
            places = np.concatenate([columns, [count + sums[name] for name in names]]).astype(int)
            total[np.ix_(places, places)] += products
            right[places] += gradient
            scatter[np.ix_(places, places)] += spread
        plain = total[:count, :count] + final.prior
        solved = inverse(plain) @ np.column_stack([total[:count, count:], right[:count]])
        self.products = total[count:, count:] - total[count:, :count] @ solved[:, :-1]
        self.gradient = right[count:] - total[count:, :count] @ solved[:, -1]
        rest = np.vstack([-solved[:, :-1], np.eye(len(sums))])  # terms, parameters projected out
        self.more_variance = np.einsum("ik,ij,jk->k", rest, scatter, rest, optimize=True)
        # Terms in the span of the parameters are left with rounding errors.
        self.visible = np.diag(self.products) > 1e-8 * np.diag(total)[count:]


def _record_sums(record: tuple[Data, np.ndarray, Whitener], final: Fit, terms: Terms, scales: dict[str, float]):
    """Normal equations of one record over its parameters, then terms; and the names of its terms."""
    data, nuisance, white = record
    products, gradient, scatter, counted, switching, names = 0.0, 0.0, 0.0, 0.0, np.zeros(()), []
    for _, begin, residual, slopes in residual_blocks(final.model, data, nuisance, True):
        W = white.of(len(residual))
        assert slopes is not None
        signals = _signals(data, begin, residual)
        residual -= white.passed(begin, begin + len(residual))
        predicted = data.part(begin, begin + len(residual)) - residual
        evaluated = list(terms(signals, data.setting.sample_time, scales))
        added = np.column_stack([values for _, values in evaluated])[:, None, :]
        added = np.broadcast_to(added, (*residual.shape, added.shape[2]))  # a term added to each of the channels
        residual, slopes, added = (white.weighted(begin, values) for values in (residual, slopes, added))
        # Whitened: for a term added to a channel, that column of the whitening matrix.
        placed = (W[:, :, :, None] * spectra_of(added)[:, None, :, :]).reshape(len(W), W.shape[1], -1)
        placed = white.reduced(begin, len(residual), placed.transpose(1, 2, 0)).transpose(2, 0, 1)
        whitened = np.concatenate([white.whitened(begin, slopes).transpose(2, 0, 1), placed], axis=2)
        known = scatter, counted, switching
        scatter, counted, switching = map(add, known, white.spread(begin, predicted, whitened, W))
        columns = whitened.reshape(-1, whitened.shape[2])
        target = white.whitened(begin, residual).T.reshape(-1)
        products = products + np.real(columns.conj().T @ columns)
        gradient = gradient + np.real(columns.conj().T @ target)
        names = [(channel, name) for channel in data.channels for name, _ in evaluated]
    return (products, gradient, scatter - counted + switching @ switching.T), names


def _signals(data, begin: int, left: np.ndarray) -> Signals:
    """The drive and the predicted channels, both without measurement noise, which would correlate with the residual."""
    end = begin + len(left)
    found = {data.drive: (data.record[data.drive] - data.rest)[begin:end]}
    predicted = data.values[begin:end] - left
    return {**found, **dict(zip(data.channels, predicted.T, strict=True))}


def _scales(problem: Problem) -> dict[str, float]:
    """Largest absolute value of each signal in the whole campaign."""
    found: dict[str, float] = {}
    for data in problem.data:
        if not isinstance(data, FrequencyData):
            for channel in (data.drive, *data.channels):
                found[channel] = max(found.get(channel, 0.0), float(np.abs(data.record[channel]).max()))
    return found


def _squares(signals: Signals, step: float, scales: dict[str, float]) -> Iterator[tuple[str, np.ndarray]]:
    """Squares of the signals."""
    for channel, values in signals.items():
        yield SYMBOLS[channel] + SQUARE_SIGN, (values / (scales[channel] or 1.0)) ** 2


def _terms(signals: Signals, step: float, scales: dict[str, float]) -> Iterator[tuple[str, np.ndarray]]:
    """Simple functions of the signals, scaled to about one."""
    count = len(next(iter(signals.values())))
    time = np.linspace(-1.0, 1.0, count)
    yield "a constant", np.ones(count)
    yield "time", time
    yield from _squares(signals, step, scales)
    for channel, values in signals.items():
        s, z = SYMBOLS[channel], values / (scales[channel] or 1.0)
        yield s, z
        yield f"{s}³", z**3
        yield f"|{s}|", np.abs(z)
        yield f"√|{s}| sign {s}", np.sqrt(np.abs(z)) * np.sign(z)
        yield f"d{s}/dt", _scaled(np.gradient(z, step))
        yield f"sign d{s}/dt", np.tanh(20.0 * _scaled(np.gradient(z, step)))
        yield f"integral of {s}", np.cumsum(z - z[0]) / count
        yield f"time × {s}", time * z


def _scaled(values: np.ndarray) -> np.ndarray:
    return values / (float(np.abs(values).max()) or 1.0)


def _orthogonal_matching_pursuit(normal: _NormalEquations) -> list[Hint]:
    """Orthogonal matching pursuit on the normal equations."""
    G, g = normal.products, normal.gradient
    chosen: list[int] = []
    found: list[Hint] = []
    gained = 0.0
    while len(chosen) < MAX_TERMS:
        gains = np.full(len(g), -np.inf)
        for k in np.flatnonzero(normal.visible):
            if k not in chosen:
                at = [*chosen, k]
                gains[k] = float(g[at] @ inverse(G[np.ix_(at, at)]) @ g[at])
        best = int(np.argmax(gains))
        first = found[0].gain if found else gains[best]
        if not np.isfinite(gains[best]) or gains[best] - gained < max(MIN_GAIN, MIN_RELATIVE_GAIN * first):
            break
        chosen.append(best)
        gained = float(gains[best])
        size = inverse(G[np.ix_(chosen, chosen)]) @ g[chosen]
        found.append(Hint(*normal.names[best], float(size[-1]), gained))
    return found
