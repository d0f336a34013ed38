"""A hint where no known effect fits: which simple functions of the signals make up the residual. Not a cause.

Source: Pati, Rezaiifar & Krishnaprasad, 27th Asilomar Conference, 1993 (orthogonal matching pursuit), on residuals and
signals that are whitened and have the fitted parameters projected out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.evaluation import at_once
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.likelihood import Whitener, spectra_of
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.model import residual_blocks
from piezoharvest.identify.fitting.output_error import inverse
from piezoharvest.identify.fitting.problem import Problem

TERMS = 3  # at most
SMALL = 0.05  # of what the first term explains: less is not worth telling
SURE = 20.0  # of -2 ln L that a term has to take off: over all that are tried
SQUARE = "²"
Signals = dict[str, np.ndarray]
Terms = Callable[[Signals, float, dict[str, float]], Iterator[tuple[str, np.ndarray]]]
SYMBOLS = {"force": "F", "displacement": "x", "voltage": "v", "current": "i", "base_acceleration": "a"}


@dataclass(frozen=True)
class Hint:
    """One term of a sparse regression of the residual.

    Attributes
    ----------
    channel : str
        Whose residual.
    term : str
        Function of the signals, each less its mean and divided by its largest value.
    size : float
        Coefficient: by how much the channel, in its SI unit, changes where the term is one.
    gain : float
        By how much -2 ln L falls with this term and those before it.
    """

    channel: str
    term: str
    size: float
    gain: float


def along_squares(problem: Problem, found: Fit) -> list[tuple[str, str, float]]:
    """Channels, squares of the signals, and by how much -2 ln L falls where the one follows the other.

    Each for itself, with the parameters projected out: of noise, that of rounded sensors with it, the squares of one
    number. Odd functions are left out, for a fit that noise in the drive has bent leaves of them what looks like more
    than noise.
    """
    normal = _Normal(problem, found, _squares)
    return [
        (channel, term, float(normal.gradient[k] ** 2 / (normal.products[k, k] + normal.rounded[k])))
        for k, (channel, term) in enumerate(normal.names)
        if normal.visible[k]
    ]


def hints(problem: Problem, found: Fit) -> list[Hint]:
    """Terms that explain most of what a model leaves in records over time, the strongest first.

    Parameters
    ----------
    problem : Problem
    found : Fit
        Of these records, converged.
    """
    normal = _Normal(problem, found, _terms)
    return _pursuit(normal) if normal.names else []


class _Normal:
    """Sums of products of terms and of the residual, whitened, with the parameters of the fit projected out."""

    def __init__(self, problem: Problem, final: Fit, terms: Terms) -> None:
        scales, at = _scales(problem), len(final.model.parameters)
        count = at + sum(map(len, final.own))
        self.names: list[tuple[str, str]] = []
        sums: dict[tuple[str, str], int] = {}
        records = [
            (data, own, white)
            for data, own, white in zip(problem.data, final.own, final.white, strict=True)
            if isinstance(data, Data) and isinstance(white, Whitener)
        ]
        parts = []
        told = at_once(lambda record: _record(record, final, terms, scales), records)
        for (_, own, _), (sums_of_record, names) in zip(records, told, strict=True):
            columns = np.concatenate([np.arange(len(final.model.parameters)), np.arange(at, at + len(own))])
            parts.append((columns, sums_of_record, names))
            at += len(own)
            for name in names:
                sums.setdefault(name, len(sums))
        self.names = list(sums)
        total = np.zeros((count + len(sums),) * 2)
        right, scatter = np.zeros(count + len(sums)), np.zeros_like(total)
        for columns, (products, gradient, rounded), names in parts:
            places = np.concatenate([columns, [count + sums[name] for name in names]]).astype(int)
            total[np.ix_(places, places)] += products
            right[places] += gradient
            scatter[np.ix_(places, places)] += rounded
        plain = total[:count, :count] + final.prior
        solved = inverse(plain) @ np.column_stack([total[:count, count:], right[:count]])
        self.products = total[count:, count:] - total[count:, :count] @ solved[:, :-1]
        self.gradient = right[count:] - total[count:, :count] @ solved[:, -1]
        rest = np.vstack([-solved[:, :-1], np.eye(len(sums))])  # of each term, parameters projected out
        self.rounded = np.einsum("ik,ij,jk->k", rest, scatter, rest, optimize=True)
        # Terms that the parameters do all of are left with rounding errors.
        self.visible = np.diag(self.products) > 1e-8 * np.diag(total)[count:]


def _record(record: tuple[Data, np.ndarray, Whitener], final: Fit, terms: Terms, scales: dict[str, float]):
    """Sums of one record over its parameters, then terms; and the names of its terms."""
    data, own, white = record
    products, gradient, rounded, names = 0.0, 0.0, 0.0, []
    for _, begin, residual, slopes in residual_blocks(final.model, data, own, True):
        W = white.of(len(residual))
        assert slopes is not None
        signals = _signals(data, begin, residual)
        residual -= white.passed(begin, begin + len(residual))
        told = list(terms(signals, data.setting.sample_time, scales))
        spectra = spectra_of(np.column_stack([values for _, values in told]))
        # A term in a channel: that column of the whitener.
        placed = (W[:, :, :, None] * spectra[:, None, None, :]).reshape(len(W), W.shape[1], -1)
        whitened = np.concatenate([W @ spectra_of(slopes), placed], axis=2)
        rounded = rounded + white.scatter(data.part(begin, begin + len(residual)) - residual, whitened, W)
        columns = whitened.reshape(-1, whitened.shape[2])
        target = (W @ spectra_of(residual)[:, :, None])[:, :, 0].reshape(-1)
        products = products + np.real(columns.conj().T @ columns)
        gradient = gradient + np.real(columns.conj().T @ target)
        names = [(channel, name) for channel in data.channels for name, _ in told]
    return (products, gradient, rounded), names


def _signals(data, begin: int, left: np.ndarray) -> Signals:
    """The drive and the other channels as predicted of it, both without its noise: that is not explained by itself."""
    end = begin + len(left)
    found = {data.drive: (data.record[data.drive] - data.rest)[begin:end]}
    predicted = data.values[begin:end] - left
    return {**found, **dict(zip(data.channels, predicted.T, strict=True))}


def _scales(problem: Problem) -> dict[str, float]:
    """Largest value of each signal in the whole campaign."""
    found: dict[str, float] = {}
    for data in problem.data:
        if not isinstance(data, FrequencyData):
            for channel in (data.drive, *data.channels):
                found[channel] = max(found.get(channel, 0.0), float(np.abs(data.record[channel]).max()))
    return found


def _squares(signals: Signals, step: float, scales: dict[str, float]) -> Iterator[tuple[str, np.ndarray]]:
    """Squares of the signals."""
    for channel, values in signals.items():
        yield SYMBOLS[channel] + SQUARE, (values / (scales[channel] or 1.0)) ** 2


def _terms(signals: Signals, step: float, scales: dict[str, float]) -> Iterator[tuple[str, np.ndarray]]:
    """Simple functions of the signals, each of a size near one."""
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


def _pursuit(normal: _Normal) -> list[Hint]:
    """Orthogonal matching pursuit on the normal equations."""
    G, g = normal.products, normal.gradient
    chosen: list[int] = []
    found: list[Hint] = []
    gained = 0.0
    while len(chosen) < TERMS:
        gains = np.full(len(g), -np.inf)
        for k in np.flatnonzero(normal.visible):
            if k not in chosen:
                at = [*chosen, k]
                gains[k] = float(g[at] @ inverse(G[np.ix_(at, at)]) @ g[at])
        best = int(np.argmax(gains))
        first = found[0].gain if found else gains[best]
        if not np.isfinite(gains[best]) or gains[best] - gained < max(SURE, SMALL * first):
            break
        chosen.append(best)
        gained = float(gains[best])
        size = inverse(G[np.ix_(chosen, chosen)]) @ g[chosen]
        found.append(Hint(*normal.names[best], float(size[-1]), gained))
    return found
