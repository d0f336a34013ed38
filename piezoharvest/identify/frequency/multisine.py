"""Frequency responses from periodic multisines, with noise separated from nonlinear distortion.

Source: Pintelon & Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., 2012, chapters 4 and 7 (the
robust method): differences between periods are noise; differences between realisations, beyond the noise, are the
stochastic part of nonlinear distortion; the part common to all is the best linear approximation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from piezoharvest.counting import counted

_MIN_LINE_POWER = 1e-3  # of the strongest line's power: a line with less is not excited
_SMOOTHING_LINES = 21  # lines over which variances, estimated from few realisations, are averaged


class FrequencyError(ValueError):
    """A frequency response or its modes cannot be estimated from the data."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MultisineResponse:
    """Best linear approximation of a system with u inputs and y outputs at f excited lines.

    Attributes
    ----------
    frequency : (f,) array
        Hz.
    response : (f, y, u) array of complex
        Output per input.
    noise, total : (f, y, u) array
        Standard deviation of the response by noise alone, and by noise and nonlinear distortion together, as a complex
        number: that of each of its parts is a factor sqrt(2) less. `total` is NaN if realisations are no more than
        inputs.
    noise_level, distortion_level : (f, y) array
        Rms of a line in one period of the output. The distortion is from the realisations or, if they are too few,
        from the lines within the band that are not excited; NaN if there are none of these either.
    transient : (y,) array
        Rms difference of the last period from the first in its first tenth, over that in its last tenth: near 1 in
        the periodic steady state.
    """

    frequency: np.ndarray
    response: np.ndarray
    noise: np.ndarray
    total: np.ndarray
    noise_level: np.ndarray
    distortion_level: np.ndarray
    transient: np.ndarray


def multisine_response(inputs: np.ndarray, outputs: np.ndarray, sample_rate: float, skip: int = 0) -> MultisineResponse:
    """Frequency response from whole periods of multisines.

    Parameters
    ----------
    inputs : (samples, u, realisations, periods) array
        One period along the first axis, as many realisations as inputs or more.
    outputs : (samples, y, realisations, periods) array
    sample_rate : float
        Hz.
    skip : int
        Leading periods to leave out because of their transient.

    Raises
    ------
    FrequencyError
        The arrays do not match, are not finite, or have too few realisations or periods.
    """
    inputs, outputs = _checked(inputs, outputs, skip)
    samples, sources, realisations, periods = inputs.shape
    spectra_in, spectra_out = (np.fft.rfft(values, axis=0) / samples for values in (inputs, outputs))
    power = (np.abs(spectra_in) ** 2).sum(axis=(1, 2, 3))
    power[0] = 0.0
    lines = np.flatnonzero(power > _MIN_LINE_POWER * power.max())
    u, y = spectra_in[lines].mean(-1), spectra_out[lines].mean(-1)
    response = y @ np.linalg.pinv(u)
    # Per realisation: the noise of its mean over periods, and the deviation from the linear response.
    each = spectra_out[lines] - np.einsum("fij,fjrp->firp", response, spectra_in[lines])
    scatter = (np.abs(each - each.mean(-1, keepdims=True)) ** 2).sum(-1) / (periods - 1)
    noise = _smooth(scatter.mean(-1))
    freedom = realisations - sources
    left = (np.abs(each.mean(-1)) ** 2).sum(-1)
    total = _smooth(left / freedom) if freedom > 0 else np.full(noise.shape, np.nan)
    distortion = (
        total - noise / periods if freedom > 0 else _distortion_between_lines(spectra_out, lines, noise / periods)
    )
    gain = np.real(np.diagonal(np.linalg.inv(u @ u.conj().swapaxes(1, 2)), axis1=1, axis2=2))
    return MultisineResponse(
        frequency=lines * sample_rate / samples, response=response,
        noise=np.sqrt(noise[:, :, None] / periods * gain[:, None, :]),
        total=np.sqrt(total[:, :, None] * gain[:, None, :]),
        noise_level=np.sqrt(2 * noise), distortion_level=np.sqrt(2 * np.maximum(distortion, 0.0)),
        transient=_transient(outputs),
    )  # fmt: skip


def _distortion_between_lines(spectra: np.ndarray, lines: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Distortion power at the excited lines, interpolated from lines that are not excited; (f, y)."""
    between = np.setdiff1d(np.arange(lines[0], lines[-1]), lines)
    if len(between) == 0:
        return np.full(noise.shape, np.nan)
    # Averaged over the same bandwidth, in which there are fewer of these lines.
    size = max(_SMOOTHING_LINES * len(between) // (len(lines) + len(between)), 1)
    power = _smooth((np.abs(spectra[between].mean(-1)) ** 2).mean(-1), size)
    at_lines = [np.interp(lines, between, column) for column in power.T]
    return np.stack(at_lines, axis=1) - noise


def _smooth(power: np.ndarray, size: int = _SMOOTHING_LINES) -> np.ndarray:
    from scipy.ndimage import uniform_filter1d

    return uniform_filter1d(power, min(size, len(power)), axis=0, mode="nearest")


def _transient(outputs: np.ndarray) -> np.ndarray:
    change = outputs[..., -1] - outputs[..., 0]
    change = change - change.mean(axis=0)
    tenth = max(len(change) // 10, 1)
    first, last = (np.sqrt((part**2).mean(axis=(0, 2))) for part in (change[:tenth], change[-tenth:]))
    return first / np.where(last > 0, last, np.inf)


def _checked(inputs: np.ndarray, outputs: np.ndarray, skip: int) -> tuple[np.ndarray, np.ndarray]:
    inputs, outputs = (np.asarray(values, float) for values in (inputs, outputs))
    kept = [shape[:1] + shape[2:] for shape in (inputs.shape, outputs.shape)]
    if inputs.ndim != 4 or outputs.ndim != 4 or kept[0] != kept[1]:
        shapes = f"found shapes {inputs.shape} and {outputs.shape}"
        raise FrequencyError(f"inputs and outputs: {shapes}, axes must be (samples, channels, realisations, periods)")
    inputs, outputs = inputs[..., skip:], outputs[..., skip:]
    for name, values in (("inputs", inputs), ("outputs", outputs)):
        if not np.all(np.isfinite(values)):
            count = np.sum(~np.isfinite(values))
            raise FrequencyError(
                f"{name}: found {counted(int(count), 'NaN or infinite value')}, allowed are finite numbers"
            )
    _, sources, realisations, periods = inputs.shape
    if realisations < sources or periods < 2:
        each = counted(realisations, "realisation"), counted(periods, "period"), counted(sources, "input")
        found = "found {} of {} for {}".format(*each)
        raise FrequencyError(
            f"inputs: {found}, allowed are at least as many realisations as inputs, each of 2 periods or more"
        )
    return inputs, outputs
