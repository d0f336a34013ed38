"""What a model leaves: where whitened residuals are more than noise, and how sure that is."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from scipy.stats import chi2

from piezoharvest.diagnose.drive_noise import drive_scatter
from piezoharvest.diagnose.residual_regression import along_squares
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.evaluation import at_once
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.likelihood import Whitener
from piezoharvest.identify.fitting.measured_responses import FrequencyData, ResponseWeights
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.noise.noise_model import first_guess, rounding
from piezoharvest.identify.noise.spectra import in_time

STRUCTURE = 1e-5  # level at which residuals are more than noise
HARMONICS = 12
APART = 3  # lines that are compared: neighbours are alike by the window of an analyser
LEAST = 20  # lines
SLOW = 1.5  # Hz: below it what a rounded sensor reads of a held load is off by a constant that is no noise
HELD = 1e-5  # of the drive's range, that it moves from sample to sample
OFTEN = 0.3  # share of the samples
ROUNDED = 0.01  # of the noise, that rounding may be off
BANDS = np.array([0.0, 0.25, 0.6, 1.5, 4.0, 10.0, 25.0, 60.0, 150.0])  # Hz
BURST = 8  # samples
UPPER = 0.5  # share of the band from which on a record shows its noise alone


@dataclass(frozen=True)
class Leftover:
    """One place where residuals are compared with noise.

    Attributes
    ----------
    where : str
        "0.6 to 1.5 Hz", "harmonic 3 of the drive", "along x²", "alike over frequency".
    record, channel : str
        The record, or "all"; the channel as whitened (each less what those before it tell), or "all".
    squares, count : float
        Sum of squares in units of the noise, and how many.
    """

    where: str
    record: str
    channel: str
    squares: float
    count: float

    @property
    def key(self) -> tuple[str, str, str]:
        """What it is found again by in what another model leaves."""
        return self.where, self.record, self.channel

    @property
    def above(self) -> float:
        """Squares above those that noise has."""
        return self.squares - self.count

    @property
    def p_value(self) -> float:
        """Probability that noise alone is so large."""
        return float(chi2.sf(self.squares, self.count))

    @property
    def excess(self) -> float:
        """By how much it is above noise, in units of the noise's own scatter."""
        return float(self.above / np.sqrt(2.0 * self.count))


@dataclass(frozen=True, eq=False)
class ResidualBlock:
    """Some samples of a record, and what a model leaves of them.

    Attributes
    ----------
    data : Data
    white : Whitener
    begin : int
        First sample.
    residual : (samples, channels) array
    spectrum : (f, channels) array
        Whitened.
    scatter : (bands, channels) array, optional
        Variance that the noise of the drive adds.
    """

    data: Data
    white: Whitener
    begin: int
    residual: np.ndarray
    spectrum: np.ndarray
    scatter: np.ndarray | None = None

    @cached_property
    def frequencies(self) -> np.ndarray:
        """Of the spectrum, in Hz."""
        return np.fft.rfftfreq(len(self.residual), self.data.setting.sample_time)

    @cached_property
    def level(self) -> np.ndarray:
        """Noise (f, channels) in this record, in units of that of all; rounding scatters more between two steps."""
        upper = self.spectrum[int(UPPER * len(self.spectrum)) : -1]
        variance = np.tile(np.maximum(0.5 * (np.abs(upper) ** 2).mean(axis=0), 1.0), (len(self.spectrum), 1))
        if self.scatter is not None:
            bands = np.searchsorted(BANDS, self.frequencies, "right") - 1
            variance += np.vstack([self.scatter, np.zeros(len(self.data.channels))])[bands]
        return np.sqrt(variance)

    @cached_property
    def levelled(self) -> np.ndarray:
        """Spectrum, each channel in units of its noise in this record."""
        return self.spectrum / self.level

    def rounded(self, line: int) -> np.ndarray:
        """What rounded sensors add to the variance of a levelled line's parts, (channels,).

        Where a drive comes back to the same values, so do the errors of rounding.
        """
        predicted = self.data.part(self.begin, self.begin + len(self.residual)) - self.residual
        channels = np.arange(predicted.shape[1])
        parts = np.zeros((len(self.spectrum), len(channels), len(channels), 2), complex)
        parts[line, channels, channels] = 1.0, 1j
        matrices = self.white.of(len(self.residual))
        scatter = self.white.scatter(predicted, parts.reshape(*parts.shape[:2], -1), matrices)
        return np.diag(scatter).reshape(-1, 2).mean(axis=1) / self.level[line] ** 2


def blocks_of(problem: Problem, found: Fit) -> Iterator[ResidualBlock]:
    """Blocks of the records over time."""
    for data, own, white in zip(problem.data, found.own, found.white, strict=True):
        yield from _of_record(found.model, data, own, white)


def _of_record(
    model: Model,
    data: Data | FrequencyData,
    own: np.ndarray,
    white: Whitener | ResponseWeights,
    scatter: np.ndarray | None = None,
) -> Iterator[ResidualBlock]:
    if isinstance(data, Data) and isinstance(white, Whitener):
        for begin, residual, spectrum in white.left(model, own):
            yield ResidualBlock(data, white, begin, residual, spectrum, scatter)


def _blocks(
    found: Fit, scattered: bool, data: Data | FrequencyData, own: np.ndarray, white: Whitener | ResponseWeights
) -> list[ResidualBlock]:
    """Blocks of a record, with what the noise of its drive adds if wanted."""
    sigma, scatter = found.noise.sigma, None
    if scattered and isinstance(data, Data) and isinstance(white, Whitener) and data.drive in sigma:
        scatter = drive_scatter(data, white, found.model, own, sigma[data.drive], BANDS)
    return list(_of_record(found.model, data, own, white, scatter))


def leftovers(problem: Problem, found: Fit, *, scattered: bool = True) -> list[Leftover]:
    """All comparisons, the least likely first.

    Parameters
    ----------
    problem : Problem
    found : Fit
    scattered : bool
        Whether to take into account what the noise of drives adds, which takes a while.
    """
    of_records = at_once(partial(_blocks, found, scattered), problem.data, found.own, found.white)
    blocks = list(itertools.chain(*of_records))
    places = [*_bands(blocks), *_harmonics(blocks), *_lines(blocks), *_bursts(blocks), *_responses(problem, found)]
    for channel, square, squares in along_squares(problem, found):
        places.append(Leftover(f"along {square}", "all", channel, squares, 1))
    return sorted(places, key=lambda place: (place.p_value, -place.excess))


def _count(part: np.ndarray, frequencies: np.ndarray) -> int:
    """Real numbers in some lines: zero frequency has one."""
    return 2 * len(part) - int(np.sum(frequencies == 0))


def _bands(blocks: Sequence[ResidualBlock]) -> list[Leftover]:
    found = []
    pooled: dict[tuple[int, str], list[float]] = {}
    for block in blocks:
        data, frequencies, spectrum = block.data, block.frequencies, block.levelled
        rounded = _rounded_while_held(data)
        for k, (low, high) in enumerate(itertools.pairwise(BANDS)):
            part = (frequencies >= low) & (frequencies < high)
            if not part.any():
                continue
            for c, channel in enumerate(data.channels):
                squares = float((np.abs(spectrum[part, c]) ** 2).sum())
                count = _count(spectrum[part, c], frequencies[part])
                if high <= SLOW and channel in rounded:
                    continue
                found.append(Leftover(f"{low:g} to {high:g} Hz", data.name, channel, squares, count))
                total = pooled.setdefault((k, channel), [0.0, 0.0])
                total[0] += squares
                total[1] += count
    for (k, channel), (squares, count) in pooled.items():
        found.append(Leftover(f"{BANDS[k]:g} to {BANDS[k + 1]:g} Hz", "all", channel, squares, count))
    return found


def _rounded_while_held(data: Data) -> set[str]:
    """Channels whose rounding noise does not average out in this record, because its drive is held."""
    held = float(
        np.mean(np.abs(np.gradient(data.record[data.drive] - data.rest)) < HELD * np.ptp(data.record[data.drive]))
    )
    found = set()
    for channel in data.channels if held > OFTEN else ():
        sigma = first_guess(data.record[channel]) or 1.0
        error = rounding(data.record[channel], data.sigma.get(channel, sigma))
        if max(error.size, error.second) > ROUNDED * sigma:
            found.add(channel)
    return found


def _harmonics(blocks: Sequence[ResidualBlock]) -> list[Leftover]:
    """Lines at multiples of the frequency at which the drive is strongest, for drives that are nearly one line.

    Each in units of its own scatter.
    """
    pooled: dict[str, list[float]] = {}
    found = []
    for block in blocks:
        data, frequencies = block.data, block.frequencies
        line = fundamental(data)
        if line is None:
            continue
        per_record = [0.0, 0.0]
        for k in range(1, HARMONICS + 1):
            at = round(k * line / frequencies[1])
            if at >= len(frequencies) - 1:
                break
            squares = np.abs(block.levelled[at]) ** 2 / (1.0 + block.rounded(at))
            for channel, square in zip(data.channels, squares.tolist(), strict=True):
                for key in (f"harmonic {k} of the drive|{channel}", f"harmonics of the drive|{channel}"):
                    total = pooled.setdefault(key, [0.0, 0.0])
                    total[0] += square
                    total[1] += 2
                per_record[0] += square
                per_record[1] += 2
        found.append(Leftover("harmonics of the drive", data.name, "all", *per_record))
    for key, (squares, count) in pooled.items():
        where, channel = key.split("|")
        found.append(Leftover(where, "all", channel, squares, count))
    return found


def _lines(blocks: Sequence[ResidualBlock]) -> list[Leftover]:
    """The strongest line of each channel over all records of a kind, in the squares of a single one as unlikely."""
    kinds: dict[tuple[int, float, str], list[np.ndarray]] = {}
    for block in blocks:
        data, frequencies = block.data, block.frequencies
        if len(frequencies) < LEAST:
            continue
        power = np.abs(block.levelled[1:-1]) ** 2
        power[frequencies[1:-1] < SLOW] = 0.0  # bands tell of these
        line = fundamental(data)
        if line is not None:
            multiple = frequencies[1:-1] / line
            power[np.abs(multiple - np.round(multiple)) * line < 1.5 * frequencies[1]] = 0.0  # harmonics
        for c, channel in enumerate(data.channels):
            kinds.setdefault((len(frequencies), float(frequencies[1]), channel), []).append(power[:, c])
    found = []
    for (_, step, channel), powers in kinds.items():
        together = np.sum(powers, axis=0)
        peak, count = int(np.argmax(together)), 2 * len(powers)
        chance = _chance(len(together), together[peak], count)
        found.append(Leftover(f"{(peak + 1) * step:.4g} Hz", "all", channel, float(chi2.isf(chance, count)), count))
    return found


def _bursts(blocks: Sequence[ResidualBlock]) -> list[Leftover]:
    """Where a channel is off for a few samples: the worst of each record, in squares of one window as unlikely.

    The largest sample of a window is left out, so that a spike alone is none.
    """
    found = []
    for block in blocks:
        data, count = block.data, len(block.residual)
        if len(block.frequencies) < LEAST:
            continue
        squares = np.lib.stride_tricks.sliding_window_view(in_time(block.levelled, count) ** 2, BURST, axis=0)
        rest = squares.sum(axis=-1) - squares.max(axis=-1)
        for c, channel in enumerate(data.channels):
            worst = int(np.argmax(rest[:, c]))
            chance = _chance(len(rest), rest[worst, c], BURST)
            where = f"for {BURST} samples at {(block.begin + worst) * data.setting.sample_time:.6g} s"
            found.append(Leftover(where, data.name, channel, float(chi2.isf(chance, BURST)), BURST))
    return found


def _chance(places: int, squares: float, count: int) -> float:
    """Probability that the largest of many such sums is so large; never so small that it has no squares."""
    return float(np.clip(places * chi2.sf(squares, count), 1e-300, 1.0))


def _responses(problem: Problem, found: Fit) -> list[Leftover]:
    """Measured responses whose residuals are alike over frequency, which those of noise are not."""
    places = []
    for data in problem.data:
        if not isinstance(data, FrequencyData) or len(data) < LEAST:
            continue
        record, value = data.record, data.response(replace(found.model, parameters=()))[0]
        residual = (record.response - value) / data.sigma_of_lines
        # A few lines that are far off, at a sharp resonance, must not count for all.
        residual /= np.maximum(np.abs(residual), 3.0 * np.median(np.abs(residual)))
        alike = np.real(np.vdot(residual[:-APART], residual[APART:])) / np.sum(np.abs(residual) ** 2)
        squares = 2.0 * len(data) * max(alike, 0.0) ** 2
        channel = "impedance" if record.kind == "impedance" else record.output
        places.append(Leftover("alike over frequency", data.name, channel, squares, 1))
    return places


def fundamental(data: Data) -> float | None:
    """Frequency in Hz of a drive that is one line for the most part."""
    values = data.record[data.drive]
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(len(values)))) ** 2
    peak = int(np.argmax(power))
    near = slice(max(peak - 2, 0), peak + 3)
    if peak < 3 or power[near].sum() < 0.9 * power.sum():
        return None
    a, b, c = np.log(power[peak - 1 : peak + 2])
    shift = 0.5 * (a - c) / (a - 2.0 * b + c)
    return float((peak + shift) / (len(values) * data.setting.sample_time))


def share_above_noise(problem: Problem, found: Fit) -> tuple[float, float]:
    """Sum of squares of all whitened residuals, and their number."""
    squares, count = 0.0, 0.0
    for block in blocks_of(problem, found):
        squares += float((np.abs(block.levelled) ** 2).sum())
        count += block.residual.size
    for data, sums in zip(problem.data, found.sums, strict=True):
        if isinstance(data, FrequencyData):
            squares += float(sums.squares.sum())
            count += float(sums.count.sum())
    return squares, count


def structure(problem: Problem, found: Fit, *, scattered: bool = True) -> tuple[Leftover, ...]:
    """Places that noise does not explain, the least likely first; their number is corrected for.

    Parameters
    ----------
    problem : Problem
    found : Fit
    scattered : bool
        Whether noise is also what operators make of that of drives, which is asked where the rest does not explain all.
    """
    plain = _plain(leftovers(problem, found, scattered=False))
    return _plain(leftovers(problem, found)) if plain and scattered else plain


def _plain(places: Sequence[Leftover]) -> tuple[Leftover, ...]:
    return tuple(place for place in places if place.p_value * len(places) < STRUCTURE)
