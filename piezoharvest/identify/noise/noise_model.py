"""Noise of a campaign: white in every channel, plus that of the drive filtered by the specimen.

A residual is r = n - G n_d: the noise n of the channels less the response G to the noise n_d of the measured drive. Its
cross-spectral matrix diag(sigma^2) + sigma_d^2 G G^H is coloured and couples the channels; with it an output-error fit
is right to first order in the noise of the drive (errors in variables: Soderstrom, Automatica 43(6), 939-958, 2007;
Whittle's likelihood: Brillinger, Time Series, 1981).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from piezoharvest.identify.noise.differences import median_variance

UPPER_BAND = 0.5  # share of the band from which on noise is estimated: lower frequencies may be model errors
BANDS = 16  # that separate noise from lines
LINE_STANDARD_DEVIATIONS = 6.0  # standard deviations above the median from which on a band contains a line
CEILING_FACTOR = 1.3  # times the noise at a channel's highest frequencies: scatter of its estimate in short records
MIN_NOISE_RATIO = 0.1  # of the noise before: limits the weight that a channel with less noise gets at once
MAX_ITERATIONS, TOLERANCE = 50, 1e-6  # most iterations to the most likely noise, and relative change at the end
MIN_EIGENVALUE_RATIO = 1e-12  # relative eigenvalue of an information matrix that counts as zero
LEAST_INFORMATION = 1.0  # about the square of a noise, in units of that square: below, residuals do not determine it


@dataclass(frozen=True)
class Noise:
    """Standard deviations of white noise by channel, the drive's under its own name; SI units."""

    sigma: Mapping[str, float]

    def at(self, levels: Mapping[str, float]) -> Noise:
        """Noise of a record whose channels have other levels than the campaign."""
        return Noise({name: levels.get(name, 1.0) * sigma for name, sigma in self.sigma.items()}) if levels else self

    def covariance(self, channels: Sequence[str], drive: str, gain: np.ndarray) -> np.ndarray:
        """Cross-spectral matrices of the residuals.

        Parameters
        ----------
        channels : sequence of str
        drive : str
        gain : (f, channels) complex array
            Response of the channels to the drive.

        Returns
        -------
        (f, channels, channels) complex array
        """
        own = np.diag([self.sigma[channel] ** 2 for channel in channels])
        return own + self.sigma.get(drive, 0.0) ** 2 * gain[:, :, None] * np.conj(gain[:, None, :])


def initial_noise(values: np.ndarray, kept: np.ndarray | slice = slice(None)) -> float:
    """Noise of a channel from its (kept) fourth differences, which are almost zero for a smooth signal."""
    return float(np.sqrt(median_variance(values, 4, kept)))


def noise_upper_bound(values: np.ndarray) -> float:
    """Upper bound of the standard deviation of a channel's white noise: its whole upper half band taken as noise.

    Residuals may have more there, due to the noise of the drive in a wrong model, but that is not noise of this
    channel.
    """
    window = np.hanning(len(values))
    power = np.abs(np.fft.rfft((values - values.mean()) * window)[int(UPPER_BAND * (len(values) // 2 + 1)) :]) ** 2
    return CEILING_FACTOR * float(np.sqrt(power.mean() / np.sum(window**2)))


def estimate(
    spectra: Iterable[tuple[Sequence[str], str, np.ndarray, np.ndarray]],
    known: Mapping[str, float],
    start: Noise,
    limits: Mapping[str, tuple[float, float]] = MappingProxyType({}),
) -> Noise:
    """Standard deviations from residuals.

    Parameters
    ----------
    spectra : iterable of (channels, drive, residual, gain)
        For each record, or block of one, residuals (f, channels) whose squares are spectral densities in units of white
        noise, and the response (f, channels) to the drive, both from zero to half the sample rate.
    known : mapping of str to float
        Known standard deviations, which are kept.
    start : Noise
        Start values; kept for names that the residuals do not determine.
    limits : mapping of str to (float, float)
        Smallest and largest possible standard deviation by name.
    """
    names = list(start.sigma)
    bounds = np.array([np.square(limits.get(name, (0.0, np.inf))) / start.sigma[name] ** 2 for name in names]).T
    parts = [part for one in spectra for part in _band_spectra(names, start, *one)]
    shares = np.array([(known.get(name, start.sigma[name]) / start.sigma[name]) ** 2 for name in names])
    free = np.array(
        [k for k, name in enumerate(names) if name not in known and any(p.observable[k] for p in parts)], int
    )
    determined = _determined(free, parts, shares)
    kept = np.setdiff1d(free, determined)
    shares[kept], free = np.clip(shares[kept], *bounds[:, kept]), determined
    for _ in range(MAX_ITERATIONS if len(free) else 0):
        before = shares.copy()
        information, score = (np.sum(t, axis=0) for t in zip(*(_scoring(p, shares) for p in parts), strict=True))
        shares = _most_likely(information, score, shares, free, bounds)
        if np.abs(shares - before).max() < TOLERANCE * shares.max():
            break
    return Noise({name: float(np.sqrt(share)) * start.sigma[name] for name, share in zip(names, shares, strict=True)})


def _determined(free: np.ndarray, parts: Sequence[_BandSpectrum], shares: np.ndarray) -> np.ndarray:
    """Of the free shares, those that the residuals would determine to within their own size if the others were known.

    The noise of a drive shows in the residuals only where the specimen responds to it. Far above a resonance it does
    not, and the most likely value would be anywhere between the limits.
    """
    information = sum((np.diag(_scoring(part, shares)[0]) for part in parts), start=np.zeros(len(shares)))
    return free[information[free] >= LEAST_INFORMATION]


def _most_likely(
    information: np.ndarray, score: np.ndarray, shares: np.ndarray, free: np.ndarray, limits: np.ndarray
) -> np.ndarray:
    """Shares with the free ones at their most likely values; those outside their limits are clipped and then fixed."""
    found, (lowest, highest) = shares.copy(), limits
    while len(free):
        fixed = np.delete(np.arange(len(shares)), free)
        right = score[free] - information[np.ix_(free, fixed)] @ found[fixed]
        found[free] = np.maximum(_nonnegative(information[np.ix_(free, free)], right), MIN_NOISE_RATIO**2)
        outside = (found < lowest) | (found > highest)
        if not outside[free].any():
            break
        found[free] = np.clip(found, lowest, highest)[free]
        free = free[~outside[free]]
    return found


def _nonnegative(information: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Non-negative solution, also for a singular matrix, as for one channel and its drive."""
    values, vectors = np.linalg.eigh(information)
    root = np.sqrt(np.maximum(values, MIN_EIGENVALUE_RATIO * values.max()))
    return nnls(root[:, None] * vectors.T, vectors.T @ right / root)[0]


class _BandSpectrum(NamedTuple):
    """Mean cross-spectrum of residuals in a band, in units of the start, and the contribution of each source of noise.

    Attributes
    ----------
    cross : (channels, channels) array
    sources : (names, channels, channels) array
    count : int
        Number of frequencies.
    observable : (names,) array of bool
    """

    cross: np.ndarray
    sources: np.ndarray
    count: int
    observable: np.ndarray


def _band_spectra(
    names: Sequence[str], start: Noise, channels: Sequence[str], drive: str, residual: np.ndarray, gain: np.ndarray
) -> list[_BandSpectrum]:
    """Bands of a record without those that contain a line.

    If the noise of the drive is many times that of a sensor, the latter shows only in the correlation of the channels:
    each band is used as a whole, and is so narrow that the response hardly changes in it.
    """
    upper = slice(int(len(residual) * UPPER_BAND), None)
    size = np.array([start.sigma[channel] for channel in channels])
    own = np.zeros((len(names), len(channels), len(channels)))
    for c, channel in enumerate(channels):
        own[names.index(channel), c, c] = 1.0
    found = []
    count = min(BANDS, len(residual[upper]))
    for left, passed in zip(*(np.array_split(some[upper] / size, count) for some in (residual, gain)), strict=True):
        sources = own.copy()
        if drive in names:
            sources[names.index(drive)] = start.sigma[drive] ** 2 * np.real(_cross(passed)).mean(axis=0)
        cross, observable = np.real(_cross(left)).mean(axis=0), np.asarray(sources.any(axis=(1, 2)))
        found.append(_BandSpectrum(cross, sources, len(left), observable))
    times = np.array([np.diag(part.cross) / np.diag(part.sources.sum(axis=0)) for part in found])
    spoilt = np.any(
        times > np.median(times, axis=0) * (1.0 + LINE_STANDARD_DEVIATIONS / np.sqrt(found[-1].count)), axis=1
    )
    return [part for part, bad in zip(found, spoilt, strict=True) if not bad]


def _scoring(part: _BandSpectrum, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Information matrix of the sources' shares, and right side of the equations for their best values.

    Fisher scoring of Whittle's likelihood: the noise of the drive, common to the channels, does not hide their
    differences.
    """
    inverse = np.linalg.inv(np.tensordot(shares, part.sources, 1))
    weighed = inverse @ part.sources @ inverse
    information = part.count * np.einsum("kab,lba->kl", weighed, part.sources)
    return information, part.count * np.einsum("kab,ba->k", weighed, part.cross)


def _cross(values: np.ndarray) -> np.ndarray:
    return values[:, :, None] * np.conj(values[:, None, :])


class Rounding(NamedTuple):
    """Rounding of a channel: step, amplitude of the mean error within it, standard deviation from a second device."""

    step: float
    size: float
    second: float


def rounding(values: np.ndarray, sigma: float) -> Rounding:
    """Step to which a sensor rounds, and the errors that noise does not average out.

    The mean of rounded values is off by (step / pi) exp(-2 pi^2 s^2 / step^2) sin(2 pi x / step), s being the noise
    before rounding (Widrow & Kollar, Quantization Noise, 2008, ch. 4); under a constant load, this error is constant.
    So is the error of a converter behind a sensor that rounds more coarsely: its variance is a twelfth of its step
    squared.

    Parameters
    ----------
    values : (n,) array
    sigma : float
        Standard deviation of the noise with the rounding.
    """
    # Gaps of the sorted values: from sample to sample a fast sine may never change by one step.
    gaps = np.diff(np.unique(values))
    gaps = gaps[gaps > 1e-9 * np.abs(values).max(initial=0.0)]
    if not len(gaps):
        return Rounding(1.0, 0.0, 0.0)
    # The smallest gaps are one step; behind a second device they differ by its step.
    least = gaps[gaps < 1.5 * gaps.min()]
    step = float(least.mean())
    before = max(sigma**2 - step**2 / 12.0, 0.0)
    size = step / np.pi * float(np.exp(-2.0 * np.pi**2 * before / step**2))
    return Rounding(step, size, float(np.ptp(least)) / np.sqrt(12.0))
