"""Steps within a sample that a model with elements needs, from how responses bend between samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import comb

import numpy as np

from piezoharvest.predict.discrete_model import STEPS_AFTER_JUMP, Setting

MIN_RELATIVE_NOISE = 5e-5  # of a response's standard deviation: accuracy that is enough for any smaller noise
# Standard deviations of a parameter that follows the error of interpolation, within a step of a model with elements, in
# every sample: its error grows with the root of their number. With the noise of one sample in its place, a stiffening
# was 0.3 % too large, 20 standard deviations.
MAX_INTERPOLATION_ERROR = 1.0
MAX_SUBSTEPS = 16  # most such steps in a sample
NOISE_MARGIN = 1.2  # times the variance of noise: smaller differences count as noise
STRAIGHT, CUBIC = 2, 4  # orders of the differences that interpolation by lines and by cubics neglects
# Error over this difference. Of a line it is a twelfth on average. A cubic through values and rates is 1/384 off at
# most, but outputs of elements bend more than their inputs: the cube of a sine by a quarter of the fourth power of 3.
_ERRORS = {STRAIGHT: 1.0 / 12.0, CUBIC: 1.0 / 100.0}


def with_steps(setting: Setting, responses: Sequence[tuple[np.ndarray, float]]) -> Setting:
    """Setting with the steps in a sample that responses, with the standard deviations of their noise, call for."""
    bends = {order: max(curvature_of(*each, setting.jumps, order) for each in responses) for order in _ERRORS}
    straight, cubic = (_steps_for(bends[order], setting.count, order) for order in (STRAIGHT, CUBIC))
    return replace(setting, fine=cubic, fine_straight=straight)


def curvature_of(values: np.ndarray, sigma: float, jumps: np.ndarray, order: int) -> float:
    """Rms difference of an order of a response, in units of its noise: for a sine, (w h)^order times its rms.

    If the noise is almost zero, a small part of the response's standard deviation is used instead.
    """
    bends = np.diff(values, order)
    beside = jumps[:, None] + np.arange(-order, STEPS_AFTER_JUMP)  # these steps are small ones anyway
    bends[beside[(beside >= 0) & (beside < len(bends))]] = 0.0
    above = np.mean(bends**2) - NOISE_MARGIN * comb(2 * order, order) * sigma**2 if len(bends) else 0.0
    return float(np.sqrt(above) / max(sigma, MIN_RELATIVE_NOISE * values.std())) if above > 0.0 else 0.0


def _steps_for(bend: float, count: int, order: int) -> int:
    error = np.sqrt(count) * bend * _ERRORS[order]
    return int(np.clip(np.ceil((error / MAX_INTERPOLATION_ERROR) ** (1.0 / order)), 1, MAX_SUBSTEPS))
