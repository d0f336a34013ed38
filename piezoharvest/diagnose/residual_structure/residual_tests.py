"""Chi-squared tests of whitened residuals against noise: by frequency band, harmonic, line, burst and signal square."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from scipy.stats import chi2

from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.residual_structure.drive_noise import drive_noise_variance
from piezoharvest.diagnose.residual_structure.residual_regression import square_terms
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.evaluation import map_records
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.likelihood import Whitener
from piezoharvest.identify.fitting.measured_responses import FrequencyData, ResponseWeights
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import follows_exactly
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.noise.noise_model import initial_noise, rounding
from piezoharvest.identify.noise.spectra import first_lines, in_time

MAX_HARMONIC = 12
LINE_SEPARATION = 3  # lines between the compared ones: the window of a network analyser correlates neighbours
# Cycles per sample: edges of bands in two decades, and so on in those below, down to the lines of a record.
BAND_EDGES = np.array([0.15, 0.06, 0.025, 0.01, 0.004])
FIRST_BAND_LINES = 2.0  # lines below the second edge
BURST_SAMPLES = 8  # samples
NOISE_BAND_START = 0.5  # share of the band above which the spectrum shows noise alone


@dataclass(frozen=True)
class ResidualTest:
    """One test of residuals against noise.

    Attributes
    ----------
    where : str
        "0.6 to 1.5 Hz", "harmonic 3 of the drive", "along x²", "alike over frequency".
    record, channel : str
        The record, or "all"; the channel as whitened (conditional on those before it), or "all".
    squares, count : float
        Sum of squares in units of the noise, and its number of terms.
    """

    where: str
    record: str
    channel: str
    squares: float
    count: float

    @property
    def key(self) -> tuple[str, str, str]:
        """Identity of the test, by which it is found among the tests of another model."""
        return self.where, self.record, self.channel

    @property
    def excess_squares(self) -> float:
        """Sum of squares in excess of its expected value."""
        return self.squares - self.count

    @property
    def p_value(self) -> float:
        """Probability of so large a sum of squares by noise alone."""
        return float(chi2.sf(self.squares, self.count))

    @property
    def excess(self) -> float:
        """Excess in standard deviations of the sum of squares."""
        return float(self.excess_squares / np.sqrt(2.0 * self.count))


@dataclass(frozen=True, eq=False)
class ResidualBlock:
    """A block of samples of a record, with the residual of a model.

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
        Variance added by the noise of the drive.
    """

    data: Data
    white: Whitener
    begin: int
    residual: np.ndarray
    spectrum: np.ndarray
    scatter: np.ndarray | None = None

    @cached_property
    def frequencies(self) -> np.ndarray:
        """Frequencies of the spectrum, in Hz."""
        return np.fft.rfftfreq(len(self.residual), self.data.setting.sample_time)

    @cached_property
    def bands(self) -> list[tuple[float, float, slice]]:
        """Lower and upper edge in Hz, and lines, of each band in which the residual is tested."""
        edges, count = band_edges(len(self.data)), len(self.residual)
        hertz = edges / self.data.setting.sample_time
        lines = itertools.starmap(slice, itertools.pairwise(first_lines(edges, count)))
        return [(*ends, part) for ends, part in zip(itertools.pairwise(hertz.tolist()), lines, strict=True)]

    @cached_property
    def noise_level(self) -> np.ndarray:
        """Standard deviation of the noise (f, channels) in this record, in units of that over all records.

        It is estimated from the upper band: rounding errors depend on where between two steps the signal lies.
        """
        upper = self.spectrum[int(NOISE_BAND_START * len(self.spectrum)) : -1]
        variance = np.tile(np.maximum(0.5 * (np.abs(upper) ** 2).mean(axis=0), 1.0), (len(self.spectrum), 1))
        if self.scatter is not None:
            for (_, _, part), added in zip(self.bands, self.scatter, strict=True):
                variance[part] += added
        return np.sqrt(variance)

    @cached_property
    def normalised(self) -> np.ndarray:
        """Spectrum with each channel divided by its noise level in this record."""
        return self.spectrum / self.noise_level

    def squares(self, lines: slice) -> list[float]:
        """Sum of squares of some lines in units of the noise, for each channel."""
        return (np.abs(self.normalised[lines]) ** 2).sum(axis=0).tolist()

    def rounding_variance(self, line: int) -> np.ndarray:
        """Variance that rounding adds to the parts of one line of the levelled spectrum, (channels,).

        Rounding errors repeat where a drive returns to the same values.
        """
        predicted = self.data.part(self.begin, self.begin + len(self.residual)) - self.residual
        channels = np.arange(predicted.shape[1])
        parts = np.zeros((len(self.spectrum), len(channels), len(channels), 2), complex)
        parts[line, channels, channels] = 1.0, 1j
        matrices = self.white.of(len(self.residual))
        scatter = self.white.rounding_scatter(predicted, parts.reshape(*parts.shape[:2], -1), matrices)
        return np.diag(scatter).reshape(-1, 2).mean(axis=1) / self.noise_level[line] ** 2


def band_edges(count: int) -> np.ndarray:
    """Edges of the bands in which a record of `count` samples is tested, in cycles per sample, increasing."""
    below = np.concatenate([BAND_EDGES * 100.0**-decades for decades in range(5)])
    return np.concatenate([[0.0], below[below * count >= FIRST_BAND_LINES][::-1]])


def blocks_of(problem: Problem, found: Fit) -> Iterator[ResidualBlock]:
    """Blocks of all records over time."""
    for data, nuisance, white in zip(problem.data, found.nuisance, found.white, strict=True):
        yield from _record_blocks(found.model, data, nuisance, white)


def _record_blocks(
    model: Model,
    data: Data | FrequencyData,
    nuisance: np.ndarray,
    white: Whitener | ResponseWeights,
    scatter: np.ndarray | None = None,
) -> Iterator[ResidualBlock]:
    if isinstance(data, Data) and isinstance(white, Whitener):
        for begin, residual, spectrum in white.left(model, nuisance):
            yield ResidualBlock(data, white, begin, residual, spectrum, scatter)


def _blocks(
    found: Fit, drive_noise: bool, data: Data | FrequencyData, nuisance: np.ndarray, white: Whitener | ResponseWeights
) -> list[ResidualBlock]:
    """Blocks of a record, with the variance added by the noise of its drive if wanted."""
    scatter = None
    if drive_noise and isinstance(data, Data) and isinstance(white, Whitener) and data.drive in found.noise.sigma:
        sigma = found.noise.at(data.levels).sigma[data.drive]
        scatter = drive_noise_variance(data, white, found.model, nuisance, sigma, band_edges(len(data)))
    return list(_record_blocks(found.model, data, nuisance, white, scatter))


def run_tests(problem: Problem, found: Fit, *, drive_noise: bool = True) -> list[ResidualTest]:
    """Results of all tests, by increasing p-value.

    Parameters
    ----------
    problem : Problem
    found : Fit
    drive_noise : bool
        Include the variance that the noise of drives adds, which takes a while to compute.
    """
    of_records = map_records(partial(_blocks, found, drive_noise), problem.data, found.nuisance, found.white)
    blocks = list(itertools.chain(*of_records))
    places = [
        *_band_tests(blocks),
        *_harmonic_tests(blocks),
        *_line_tests(blocks),
        *_burst_tests(blocks),
        *_response_tests(problem, found),
    ]
    for channel, square, squares in square_terms(problem, found):
        places.append(ResidualTest(f"along {square}", "all", channel, squares, 1))
    return sorted(places, key=lambda place: (place.p_value, -place.excess))


def _band_tests(blocks: Sequence[ResidualBlock]) -> list[ResidualTest]:
    found = []
    pooled: dict[tuple[str, str], list[float]] = {}
    for block in blocks:
        data = block.data
        rounded = _rounded_at_constant_drive(data)
        for low, high, part in block.bands:
            count = 2 * (part.stop - part.start) - (part.start == 0)  # the line at zero frequency is real
            where = f"{low:.4g} to {high:.4g} Hz"
            for channel, squares in zip(data.channels, block.squares(part), strict=True):
                if count < 1 or (part.stop <= thresholds.SLOW_LINES and channel in rounded):
                    continue
                found.append(ResidualTest(where, data.name, channel, squares, count))
                total = pooled.setdefault((where, channel), [0.0, 0.0])
                total[0] += squares
                total[1] += count
    for (where, channel), (squares, count) in pooled.items():
        found.append(ResidualTest(where, "all", channel, squares, count))
    return found


def _rounded_at_constant_drive(data: Data) -> set[str]:
    """Channels whose rounding errors do not average out in this record, because its drive is constant."""
    constant_share = float(
        np.mean(
            np.abs(np.gradient(data.record[data.drive] - data.rest))
            < thresholds.MAX_CONSTANT_STEP * np.ptp(data.record[data.drive])
        )
    )
    found = set()
    for channel in data.channels if constant_share > thresholds.MIN_CONSTANT_SHARE else ():
        sigma = initial_noise(data.record[channel]) or 1.0
        error = rounding(data.record[channel], data.sigma.get(channel, sigma))
        if max(error.size, error.second) > thresholds.MIN_ROUNDING_ERROR * sigma:
            found.add(channel)
    return found


def _harmonic_tests(blocks: Sequence[ResidualBlock]) -> list[ResidualTest]:
    """Lines at multiples of the drive frequency, for drives that are nearly one sine.

    Each is in units of its own standard deviation.
    """
    pooled: dict[str, list[float]] = {}
    found = []
    for block in blocks:
        data, frequencies = block.data, block.frequencies
        line = drive_frequency_of(data)
        if line is None:
            continue
        per_record = [0.0, 0.0]
        for k in range(1, MAX_HARMONIC + 1):
            at = round(k * line / frequencies[1])
            if at >= len(frequencies) - 1:
                break
            squares = np.abs(block.normalised[at]) ** 2 / (1.0 + block.rounding_variance(at))
            for channel, square in zip(data.channels, squares.tolist(), strict=True):
                for key in (f"harmonic {k} of the drive|{channel}", f"harmonics of the drive|{channel}"):
                    total = pooled.setdefault(key, [0.0, 0.0])
                    total[0] += square
                    total[1] += 2
                per_record[0] += square
                per_record[1] += 2
        found.append(ResidualTest("harmonics of the drive", data.name, "all", *per_record))
    for key, (squares, count) in pooled.items():
        where, channel = key.split("|")
        found.append(ResidualTest(where, "all", channel, squares, count))
    return found


def _line_tests(blocks: Sequence[ResidualBlock]) -> list[ResidualTest]:
    """The strongest line of each channel over records of equal length, as the equally unlikely square of one line."""
    kinds: dict[tuple[int, float, str], list[np.ndarray]] = {}
    for block in blocks:
        data, frequencies = block.data, block.frequencies
        if len(frequencies) < thresholds.MIN_LINES:
            continue
        power = np.abs(block.normalised[1:-1]) ** 2
        power[: math.ceil(thresholds.SLOW_LINES) - 1] = 0.0  # covered by the bands
        line = drive_frequency_of(data)
        if line is not None:
            multiple = frequencies[1:-1] / line
            power[np.abs(multiple - np.round(multiple)) * line < 1.5 * frequencies[1]] = 0.0  # harmonics
        for c, channel in enumerate(data.channels):
            kinds.setdefault((len(frequencies), float(frequencies[1]), channel), []).append(power[:, c])
    found = []
    for (_, step, channel), powers in kinds.items():
        together = np.sum(powers, axis=0)
        peak, count = int(np.argmax(together)), 2 * len(powers)
        chance = _p_value_of_largest(len(together), together[peak], count)
        found.append(ResidualTest(f"{(peak + 1) * step:.4g} Hz", "all", channel, float(chi2.isf(chance, count)), count))
    return found


def _burst_tests(blocks: Sequence[ResidualBlock]) -> list[ResidualTest]:
    """The worst burst of each record, as the equally unlikely sum of squares of a single window.

    The largest sample of a window is left out, so that a single spike does not count as a burst.
    """
    found = []
    for block in blocks:
        data, count = block.data, len(block.residual)
        if len(block.frequencies) < thresholds.MIN_LINES:
            continue
        squares = np.lib.stride_tricks.sliding_window_view(in_time(block.normalised, count) ** 2, BURST_SAMPLES, axis=0)
        rest = squares.sum(axis=-1) - squares.max(axis=-1)
        for c, channel in enumerate(data.channels):
            worst = int(np.argmax(rest[:, c]))
            chance = _p_value_of_largest(len(rest), rest[worst, c], BURST_SAMPLES)
            where = f"for {BURST_SAMPLES} samples at {(block.begin + worst) * data.setting.sample_time:.6g} s"
            found.append(ResidualTest(where, data.name, channel, float(chi2.isf(chance, BURST_SAMPLES)), BURST_SAMPLES))
    return found


def _p_value_of_largest(places: int, squares: float, count: int) -> float:
    """Probability that the largest of many such sums is so large; bounded below so that its quantile is finite."""
    return float(np.clip(places * chi2.sf(squares, count), 1e-300, 1.0))


def _response_tests(problem: Problem, found: Fit) -> list[ResidualTest]:
    """Measured frequency responses, tested for correlation of the residual over frequency."""
    places = []
    for data in problem.data:
        if not isinstance(data, FrequencyData) or len(data) < thresholds.MIN_LINES:
            continue
        record, value = data.record, data.response(replace(found.model, parameters=()))[0]
        residual = (record.response - value) / data.sigma_of_lines
        # Bound the few lines that are far off at a sharp resonance, so that they do not dominate.
        residual /= np.maximum(np.abs(residual), 3.0 * np.median(np.abs(residual)))
        alike = np.real(np.vdot(residual[:-LINE_SEPARATION], residual[LINE_SEPARATION:])) / np.sum(
            np.abs(residual) ** 2
        )
        squares = 2.0 * len(data) * max(alike, 0.0) ** 2
        channel = "impedance" if record.kind == "impedance" else record.output
        places.append(ResidualTest("alike over frequency", data.name, channel, squares, 1))
    return places


def drive_frequency_of(data: Data) -> float | None:
    """Frequency in Hz of a drive that is mostly one sine; None for any other."""
    values = data.record[data.drive]
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(len(values)))) ** 2
    peak = int(np.argmax(power))
    near = slice(max(peak - 2, 0), peak + 3)
    if peak < 3 or power[near].sum() < thresholds.MIN_SINE_SHARE * power.sum():
        return None
    a, b, c = np.log(power[peak - 1 : peak + 2])
    shift = 0.5 * (a - c) / (a - 2.0 * b + c)
    return float((peak + shift) / (len(values) * data.setting.sample_time))


def whitened_squares(problem: Problem, found: Fit) -> tuple[float, float]:
    """Sum of squares of all whitened residuals, and their number."""
    squares, count = 0.0, 0.0
    for block in blocks_of(problem, found):
        squares += float((np.abs(block.normalised) ** 2).sum())
        count += block.residual.size
    for data, sums in zip(problem.data, found.sums, strict=True):
        if isinstance(data, FrequencyData):
            squares += float(sums.squares.sum())
            count += float(sums.count.sum())
    return squares, count


def failed_tests(problem: Problem, found: Fit, *, drive_noise: bool = True) -> tuple[ResidualTest, ...]:
    """Tests that noise does not explain, by increasing p-value; the level is corrected for their number.

    None where a model follows records without noise as closely as it can be computed.

    Parameters
    ----------
    problem : Problem
    found : Fit
    drive_noise : bool
        Also count the noise of drives as passed on by hysteresis operators, computed only where tests fail without it.
    """
    if follows_exactly(problem, found):
        return ()
    plain = _failed(run_tests(problem, found, drive_noise=False))
    return _failed(run_tests(problem, found)) if plain and drive_noise else plain


def _failed(places: Sequence[ResidualTest]) -> tuple[ResidualTest, ...]:
    return tuple(place for place in places if place.p_value * len(places) < thresholds.TEST_LEVEL)
