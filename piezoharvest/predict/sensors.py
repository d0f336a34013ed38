"""What sensors and wiring make of predicted channels: delay and range."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.ndimage import spline_filter1d
from scipy.special import ndtr

from piezoharvest.description.effects.base import Effect
from piezoharvest.predict.parameters import Parameter, put

FAR = 8.0  # standard deviations from the end of a range, where it is not felt
SHORT = 8  # samples, whose ends are all that there is
LEAST = 1e-12  # of the range, that a noise is at least

Sensed = tuple[np.ndarray, np.ndarray | None]


@dataclass(frozen=True, eq=False)
class Course:
    """How predicted channels go on between their samples.

    Attributes
    ----------
    sample_time : float
        s.
    jumps : sequence of int
        Samples after which the drive jumps.
    between : ((samples - 1) * parts + 1, channels) array or None
        What a model predicts between the samples, too: where it has corners, what is delayed by parts of a sample does
        not lie on a smooth curve through these. To the samples more may have been added.
    abrupt : bool
        Whether the drive jumps at the very beginning: then all values between the first two samples come after that.
    """

    sample_time: float
    jumps: Sequence[int] | np.ndarray = ()
    between: np.ndarray | None = None
    abrupt: bool = False

    def pieces(self, samples: int) -> list[tuple[int, int]]:
        """First sample of each piece without a jump, and the one after its last."""
        inner = (jump + 1 for jump in self.jumps if 0 <= jump < samples - 1)
        return list(pairwise([0, *inner, samples]))


def sensed(
    effects: Sequence[Effect], parameters: Sequence[Parameter], noise: Mapping[str, float], course: Course,
    values: np.ndarray, slopes: np.ndarray | None,
) -> Sensed:  # fmt: skip
    """Values of channels as they are read, with the derivatives to all parameters.

    Parameters
    ----------
    effects : sequence of Effect
        In the order of the transducer.
    parameters : sequence of Parameter
        Of the derivatives, which may be more.
    noise : mapping of str to float
        Of every channel, in their order, what scatters it before it comes to the end of its range.
    course : Course
    values : (samples, channels) array
    slopes : (samples, channels, derivatives) array or None
    """
    for n, effect in enumerate(effects):
        for c, (channel, scatter) in enumerate(noise.items()):
            delay, span = effect.late(channel), effect.span(channel)
            place = _place(parameters, n, "delay") if delays(effect, channel) else None
            if delay or place is not None:
                _delay(values, slopes, c, course, delay, place)
            if np.isfinite(span):
                _clip(values, slopes, c, span, scatter, _place(parameters, n, "limit"))
    return values, slopes


def delays(effect: Effect, channel: str) -> bool:
    """Whether the delay of an effect acts on a channel, be it zero now."""
    return type(effect).late is not Effect.late and put(effect, ("delay",), 1.0).late(channel) == 1.0


def _place(parameters: Sequence[Parameter], effect: int, field: str) -> int | None:
    """Column of an effect's parameter."""
    path = ("effects", effect, field)
    return next((k for k, parameter in enumerate(parameters) if parameter.path == path), None)


def late_somewhere(effects: Sequence[Effect], channels: Sequence[str]) -> bool:
    """Whether one of the effects makes a channel late."""
    return any(effect.late(channel) for effect in effects for channel in channels)


def _delay(values, slopes, c: int, course: Course, delay: float, place: int | None) -> None:
    """Shift a channel by a time, each piece between jumps by itself; before the record it stood still."""
    samples = delay / course.sample_time
    at = np.arange(len(values)) - samples
    delayed = np.empty(len(values))
    for begin, end in reversed(course.pieces(len(values))):  # what is written is not read any more
        # From the last sample before a jump on it is at its new value.
        late = np.flatnonzero((at > begin - 1 if begin else True) & (at <= end - 1))
        where, first = np.maximum(at[late], begin), float(begin)
        if course.between is None or end - begin < SHORT:
            delayed[late] = _spline(values[begin:end, c], begin)(where)
        else:
            parts = (len(course.between) - 1) // (len(values) - 1)
            first -= (parts - 1) / parts if course.abrupt and begin == 1 else 0.0
            places = np.maximum(at[late], first)
            delayed[late] = _through_corners(values[begin:end, c], begin, first, course.between[:, c], parts, places)
        if slopes is None:
            continue
        if samples:
            slopes[late[0] : late[-1] + 1, c] = _along(slopes[begin:end, c].T, where - begin).T
        if place is not None:
            falling = -_spline(values[begin:end, c], begin)(where, 1) / course.sample_time
            slopes[late, c, place] = np.where(at[late] > first, falling, 0.0)
    values[:, c] = delayed


def _through_corners(
    values: np.ndarray, begin: int, first: float, between: np.ndarray, parts: int, places: np.ndarray
) -> np.ndarray:
    """Values at places that are counted in samples, from values at parts of these from the first on.

    What has been added to the samples, which begin later, has no corners.
    """
    early = round(first * parts)
    part = between[early : (begin + len(values) - 1) * parts + 1]
    found, added = _along(part, places * parts - early, parts), values - between[begin * parts :: parts][: len(values)]
    return found + _spline(added, begin)(np.maximum(places, begin)) if np.any(added) else found


def _spline(values: np.ndarray, begin: int) -> BSpline:
    """Through samples that are counted from `begin`."""
    return make_interp_spline(begin + np.arange(len(values)), values, k=min(3, len(values) - 1))


def _along(values: np.ndarray, places: np.ndarray, step: int = 1) -> np.ndarray:
    """Values (..., samples) at places `step` samples apart, of which the first ones may all be the first sample.

    By the same cubic spline but for its ends, which are mirrored: a filter takes a tenth of the time.
    """
    if values.shape[-1] < SHORT:
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
    """Mean reading of a channel that ends at +-limit: noise takes it there before its mean comes so far."""
    noise = max(noise, LEAST * limit)
    near = np.abs(values[:, c]) > limit - FAR * noise
    x = values[near, c]
    upper, lower = (limit - x) / noise, (-limit - x) / noise
    over, under = ndtr(-upper), ndtr(lower)
    inside = 1.0 - over - under
    values[near, c] = x * inside + noise * (_density(lower) - _density(upper)) + limit * (over - under)
    if slopes is not None:
        slopes[near, c] *= inside[:, None]
        if place is not None:  # varied is 1/limit
            slopes[near, c, place] = -(over - under) * limit**2


def _density(x: np.ndarray) -> np.ndarray:
    """Of the normal distribution."""
    return np.exp(-0.5 * x**2) / np.sqrt(2 * np.pi)
