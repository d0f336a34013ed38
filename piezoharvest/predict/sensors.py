"""Effects of sensors and wiring on predicted channels: delay and range."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.ndimage import spline_filter1d
from scipy.special import ndtr

from piezoharvest.description.effects.base import Effect
from piezoharvest.predict.parameters import Parameter

CLIPPING_SIGMAS = 8.0  # standard deviations from the end of a range, beyond which it has no influence
MIN_SPLINE_SAMPLES = 8  # samples: a shorter piece is dominated by its ends
MIN_NOISE = 1e-12  # of the range: smallest noise

Sensed = tuple[np.ndarray, np.ndarray | None]


@dataclass(frozen=True, eq=False)
class Course:
    """Course of predicted channels between their samples.

    Attributes
    ----------
    sample_time : float
        s.
    jumps : sequence of int
        Samples after which the drive jumps.
    between : ((samples - 1) * parts + 1, channels) array or None
        Prediction of a model also between the samples: at its corners, values delayed by parts of a sample do not lie
        on a smooth curve through these. The samples may contain further terms.
    abrupt : bool
        The drive jumps at the very beginning: all values between the first two samples are after that.
    """

    sample_time: float
    jumps: Sequence[int] | np.ndarray = ()
    between: np.ndarray | None = None
    abrupt: bool = False

    def pieces(self, samples: int) -> list[tuple[int, int]]:
        """First sample and end (exclusive) of each piece without a jump."""
        inner = (jump + 1 for jump in self.jumps if 0 <= jump < samples - 1)
        return list(pairwise([0, *inner, samples]))


def sensed(
    effects: Sequence[Effect], parameters: Sequence[Parameter], noise: Mapping[str, float], course: Course,
    values: np.ndarray, slopes: np.ndarray | None,
) -> Sensed:  # fmt: skip
    """Readings of channels, with derivatives with respect to all parameters.

    Parameters
    ----------
    effects : sequence of Effect
        In the order of the transducer.
    parameters : sequence of Parameter
        Parameters of the first derivatives; there may be more derivatives.
    noise : mapping of str to float
        Standard deviation of every channel, in order, before its range is limited.
    course : Course
    values : (samples, channels) array
    slopes : (samples, channels, derivatives) array or None
    """
    for n, effect in enumerate(effects):
        for c, (channel, scatter) in enumerate(noise.items()):
            delay, span = effect.late(channel), effect.span(channel)
            place = _place(parameters, n, *effect.delay_path) if effect.delays(channel) else None
            if delay or place is not None:
                _delay(values, slopes, c, course, delay, place)
            if np.isfinite(span):
                _clip(values, slopes, c, span, scatter, _place(parameters, n, "limit"))
    return values, slopes


def _place(parameters: Sequence[Parameter], effect: int, *fields: str) -> int | None:
    """Column of an effect's parameter."""
    path = ("effects", effect, *fields)
    return next((k for k, parameter in enumerate(parameters) if parameter.path == path), None)


def any_delays(effects: Sequence[Effect], channels: Sequence[str]) -> bool:
    """True if one of the effects delays a channel."""
    return any(effect.late(channel) for effect in effects for channel in channels)


def _delay(values, slopes, c: int, course: Course, delay: float, place: int | None) -> None:
    """Delay a channel, each piece between jumps separately; it was constant before the record."""
    samples = delay / course.sample_time
    at = np.arange(len(values)) - samples
    delayed = np.empty(len(values))
    for begin, end in reversed(course.pieces(len(values))):  # values are read before they are overwritten
        # After the last sample before a jump it has its new value.
        late = np.flatnonzero((at > begin - 1 if begin else True) & (at <= end - 1))
        where, first = np.maximum(at[late], begin), float(begin)
        if course.between is None or end - begin < MIN_SPLINE_SAMPLES:
            delayed[late] = _spline(values[begin:end, c], begin)(where)
        else:
            parts = (len(course.between) - 1) // (len(values) - 1)
            first -= (parts - 1) / parts if course.abrupt and begin == 1 else 0.0
            places = np.maximum(at[late], first)
            delayed[late] = _between_samples(values[begin:end, c], begin, first, course.between[:, c], parts, places)
        if slopes is None:
            continue
        if samples:
            slopes[late[0] : late[-1] + 1, c] = _along(slopes[begin:end, c].T, where - begin).T
        if place is not None:
            falling = -_spline(values[begin:end, c], begin)(where, 1) / course.sample_time
            slopes[late, c, place] = np.where(at[late] > first, falling, 0.0)
    values[:, c] = delayed


def _between_samples(
    values: np.ndarray, begin: int, first: float, between: np.ndarray, parts: int, places: np.ndarray
) -> np.ndarray:
    """Values at places counted in samples, from values at parts of these from the first sample on.

    Terms added to the samples, which begin later, are smooth.
    """
    early = round(first * parts)
    part = between[early : (begin + len(values) - 1) * parts + 1]
    found, added = _along(part, places * parts - early, parts), values - between[begin * parts :: parts][: len(values)]
    return found + _spline(added, begin)(np.maximum(places, begin)) if np.any(added) else found


def _spline(values: np.ndarray, begin: int) -> BSpline:
    """Spline through samples that are counted from `begin`."""
    return make_interp_spline(begin + np.arange(len(values)), values, k=min(3, len(values) - 1))


def _along(values: np.ndarray, places: np.ndarray, step: int = 1) -> np.ndarray:
    """Values (..., samples) at places `step` samples apart, the first of which may all be the first sample.

    By the same cubic spline except for its ends, which are mirrored: as a filter it takes a tenth of the time.
    """
    if values.shape[-1] < MIN_SPLINE_SAMPLES:
        return _spline(values.T, 0)(places).T
    still = int(np.count_nonzero(places == 0.0))
    found = np.zeros((*values.shape[:-1], len(places)))
    found[..., :still] = values[..., :1]
    if still == len(places):
        return found
    whole = int(places[still])
    x = places[still] - whole
    sides = [(0, 0)] * (values.ndim - 1) + [(1, 2)]
    padded = np.pad(spline_filter1d(values, 3, mode="mirror"), sides, mode="reflect")
    weights = ((1 - x) ** 3, 3 * x**3 - 6 * x**2 + 4, -3 * x**3 + 3 * x**2 + 3 * x + 1, x**3)
    moving = found[..., still:]
    last = step * (moving.shape[-1] - 1) + 1
    for k, weight in enumerate(weights):
        moving += weight / 6.0 * padded[..., whole + k : whole + k + last : step]
    return found


def _clip(values, slopes, c: int, limit: float, noise: float, place: int | None) -> None:
    """Mean reading of a channel limited to +-limit: with noise, the limit acts before the mean reaches it."""
    noise = max(noise, MIN_NOISE * limit)
    near = np.abs(values[:, c]) > limit - CLIPPING_SIGMAS * noise
    x = values[near, c]
    upper, lower = (limit - x) / noise, (-limit - x) / noise
    over, under = ndtr(-upper), ndtr(lower)
    inside = 1.0 - over - under
    values[near, c] = x * inside + noise * (_density(lower) - _density(upper)) + limit * (over - under)
    if slopes is not None:
        slopes[near, c] *= inside[:, None]
        if place is not None:  # the variable is 1/limit
            slopes[near, c, place] = -(over - under) * limit**2


def _density(x: np.ndarray) -> np.ndarray:
    """Density of the normal distribution."""
    return np.exp(-0.5 * x**2) / np.sqrt(2 * np.pi)
