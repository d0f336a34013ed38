"""What sensors and wiring make of predicted channels: delay, range, lines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from piezoharvest.effects.base import Effect
from piezoharvest.predict.parameters import Parameter

Sensed = tuple[np.ndarray, np.ndarray | None]


def sensed(
    effects: Sequence[Effect], parameters: Sequence[Parameter], channels: Sequence[str], sample_time: float,
    values: np.ndarray, slopes: np.ndarray | None,
) -> Sensed:  # fmt: skip
    """Values of channels as they are read, with the derivatives to all parameters.

    Parameters
    ----------
    effects : sequence of Effect
        In the order of the transducer.
    parameters : sequence of Parameter
        Of the derivatives, which may be more.
    channels : sequence of str
    sample_time : float
        s.
    values : (samples, channels) array
    slopes : (samples, channels, derivatives) array or None
    """
    for n, effect in enumerate(effects):
        for c, channel in enumerate(channels):
            delay, span = effect.late(channel), effect.span(channel)
            place = _place(parameters, n, "delay")
            if delay or place is not None:
                _delay(values, slopes, c, delay / sample_time, sample_time, place)
            if np.isfinite(span):
                _clip(values, slopes, c, span, _place(parameters, n, "limit"))
    return values, slopes


def _place(parameters: Sequence[Parameter], effect: int, field: str) -> int | None:
    """Column of an effect's parameter."""
    path = ("effects", effect, field)
    return next((k for k, parameter in enumerate(parameters) if parameter.path == path), None)


def _delay(values, slopes, c: int, samples: float, sample_time: float, place: int | None) -> None:
    """Shift a channel by a number of samples; before the record it stood still."""
    at = np.maximum(np.arange(len(values)) - samples, 0.0)
    spline = CubicSpline(np.arange(len(values)), values[:, c])
    values[:, c] = spline(at)
    if slopes is None:
        return
    if samples:
        slopes[:, c] = CubicSpline(np.arange(len(values)), slopes[:, c])(at)
    if place is not None:
        slopes[:, c, place] = np.where(at > 0, -spline(at, 1) / sample_time, 0.0)


def _clip(values, slopes, c: int, limit: float, place: int | None) -> None:
    """Hold a channel within its range."""
    over = np.abs(values[:, c]) > limit
    side = np.sign(values[over, c])
    values[over, c] = side * limit
    if slopes is not None:
        slopes[over, c] = 0.0
        if place is not None:  # varied is 1/limit
            slopes[over, c, place] = -side * limit**2
