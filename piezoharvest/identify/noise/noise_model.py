"""Noise of a campaign as it is: white in every channel, and that of the drive as the specimen passes it on.

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

UPPER = 0.5  # share of the band from which noise is estimated: what is slower may be structure
BANDS = 16  # that tell noise from lines
FAR = 6.0  # standard deviations that a band is above the median where a line spoils it
LOOSE = 1.3  # times what a channel shows at its highest frequencies: so much its own estimate scatters in short records
LEAST = 0.1  # of the noise before: a channel that seems to have less is not given all the weight at once
SCORINGS, SETTLED = 50, 1e-6  # iterations to the most likely noise; relative change at their end
ALIKE = 1e-12  # relative eigenvalue of an information that tells nothing
FOURTH = 70.0  # gain of fourth differences for the variance of white noise


@dataclass(frozen=True)
class Noise:
    """Standard deviations of white noise by channel, the drive's under its own name; SI units."""

    sigma: Mapping[str, float]

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


def first_guess(values: np.ndarray, kept: np.ndarray | slice = slice(None)) -> float:
    """Noise of a channel from its fourth differences, or those that are kept: a smooth signal hardly has any."""
    fourth = np.diff(values, 4)[kept]
    return float(np.sqrt(np.median(fourth**2) / 0.4549 / FOURTH)) if len(fourth) else 0.0


def ceiling(values: np.ndarray) -> float:
    """Standard deviation that the white noise of a channel has at most: all that its upper half band shows is noise.

    Residuals may show more there, what a wrong model makes of the noise of the drive, but that is no noise of this
    channel.
    """
    window = np.hanning(len(values))
    power = np.abs(np.fft.rfft((values - values.mean()) * window)[int(UPPER * (len(values) // 2 + 1)) :]) ** 2
    return LOOSE * float(np.sqrt(power.mean() / np.sum(window**2)))


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
        What is known and kept.
    start : Noise
        Weights, and what is kept where the residuals do not tell.
    limits : mapping of str to (float, float)
        For each name the smallest and the largest that is possible.
    """
    names = list(start.sigma)
    bounds = np.array([np.square(limits.get(name, (0.0, np.inf))) / start.sigma[name] ** 2 for name in names]).T
    parts = [part for one in spectra for part in _parts(names, start, *one)]
    shares = np.array([(known.get(name, start.sigma[name]) / start.sigma[name]) ** 2 for name in names])
    free = np.array([k for k, name in enumerate(names) if name not in known and any(p.told[k] for p in parts)], int)
    for _ in range(SCORINGS if len(free) else 0):
        before = shares.copy()
        information, score = (np.sum(t, axis=0) for t in zip(*(_scoring(p, shares) for p in parts), strict=True))
        shares = _most_likely(information, score, shares, free, bounds)
        if np.abs(shares - before).max() < SETTLED * shares.max():
            break
    return Noise({name: float(np.sqrt(share)) * start.sigma[name] for name, share in zip(names, shares, strict=True)})


def _most_likely(
    information: np.ndarray, score: np.ndarray, shares: np.ndarray, free: np.ndarray, limits: np.ndarray
) -> np.ndarray:
    """Shares of which the free ones are the most likely; what would leave its limits stays there for the others."""
    found, (lowest, highest) = shares.copy(), limits
    while len(free):
        fixed = np.delete(np.arange(len(shares)), free)
        right = score[free] - information[np.ix_(free, fixed)] @ found[fixed]
        found[free] = np.maximum(_nonnegative(information[np.ix_(free, free)], right), LEAST**2)
        outside = (found < lowest) | (found > highest)
        if not outside[free].any():
            break
        found[free] = np.clip(found, lowest, highest)[free]
        free = free[~outside[free]]
    return found


def _nonnegative(information: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solution without negative values, also where some of them cannot be told apart: one channel and its drive."""
    values, vectors = np.linalg.eigh(information)
    root = np.sqrt(np.maximum(values, ALIKE * values.max()))
    return nnls(root[:, None] * vectors.T, vectors.T @ right / root)[0]


class _Part(NamedTuple):
    """Mean cross-spectrum of residuals in a band, in units of the start, and what each source of noise makes of it.

    Attributes
    ----------
    cross : (channels, channels) array
    sources : (names, channels, channels) array
    count : int
        Frequencies.
    told : (names,) array of bool
    """

    cross: np.ndarray
    sources: np.ndarray
    count: int
    told: np.ndarray


def _parts(
    names: Sequence[str], start: Noise, channels: Sequence[str], drive: str, residual: np.ndarray, gain: np.ndarray
) -> list[_Part]:
    """Bands of a record without those that a line spoils.

    Where the noise of the drive is many times that of a sensor, this shows in how the channels go together alone: each
    band is taken as a whole, and so narrow that the response hardly changes in it.
    """
    upper = slice(int(len(residual) * UPPER), None)
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
        cross, told = np.real(_cross(left)).mean(axis=0), np.asarray(sources.any(axis=(1, 2)))
        found.append(_Part(cross, sources, len(left), told))
    times = np.array([np.diag(part.cross) / np.diag(part.sources.sum(axis=0)) for part in found])
    spoilt = np.any(times > np.median(times, axis=0) * (1.0 + FAR / np.sqrt(found[-1].count)), axis=1)
    return [part for part, bad in zip(found, spoilt, strict=True) if not bad]


def _scoring(part: _Part, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Information about the shares of the sources, and what it makes of their best values, at some shares.

    Fisher's scoring of Whittle's likelihood: what channels have in common, the noise of the drive, does not hide how
    they differ.
    """
    inverse = np.linalg.inv(np.tensordot(shares, part.sources, 1))
    weighed = inverse @ part.sources @ inverse
    information = part.count * np.einsum("kab,lba->kl", weighed, part.sources)
    return information, part.count * np.einsum("kab,ba->k", weighed, part.cross)


def _cross(values: np.ndarray) -> np.ndarray:
    return values[:, :, None] * np.conj(values[:, None, :])


class Rounding(NamedTuple):
    """How a channel is rounded: step, amplitude of the mean error within it, what a second device adds."""

    step: float
    size: float
    second: float


def rounding(values: np.ndarray, sigma: float) -> Rounding:
    """Step to which a sensor rounds, and the errors that noise does not average out.

    The mean of rounded values is off by (step / pi) exp(-2 pi^2 s^2 / step^2) sin(2 pi x / step), s being the noise
    before (Widrow & Kollar, Quantization Noise, 2008, ch. 4); where a load is held, that is an error which does not
    change. So is the error of a converter behind a sensor that rounds more coarsely: standard deviation of a twelfth of
    its step squared.

    Parameters
    ----------
    values : (n,) array
    sigma : float
        Standard deviation of the noise with the rounding.
    """
    # Of all values: from sample to sample a fast sine may never move by little.
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
