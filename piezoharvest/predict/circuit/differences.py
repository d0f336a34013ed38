"""Derivatives of a prediction behind a circuit by differences, where the motion between events is nonlinear."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from piezoharvest.predict.parameters import put, value_at
from piezoharvest.predict.prediction import Block, PredictionError

if TYPE_CHECKING:
    from piezoharvest.predict.circuit.circuit_prediction import CircuitPrediction

# Change of a channel, relative to its size, by a difference: truncation is then about 1e-7, and the engine's error with
# smooth elements, 1e-8, gives 3e-5.
CHANGE = 3e-4
MIN_CHANGE = 1e-6  # by the largest step, below which the engine's error would be the derivative
MIN_STEP = 1e-8  # first step of a variable, in its unit, enlarged until the change is large enough
LARGEST_STEP = 0.1  # of a logarithm, a value, or a nuisance parameter in its unit
MAX_TRIALS = 8  # of steps up to 1e3 times as large as the one before


def differences(of: CircuitPrediction, channels: Sequence[str], size: int) -> Iterator[Block]:
    """Blocks of a prediction with central differences for all parameters and nuisance parameters.

    Where an event of one of the runs lies on the other side of a sample, the difference of the other side is taken.
    """
    base = _values(of, channels)
    slopes = np.stack([_lane(of, k, base, channels) for k in range(len(of.parameters) + len(of.nuisance))], axis=-1)
    for begin in range(0, len(base), size):
        yield Block(begin, base[begin : begin + size], slopes[begin : begin + size], None)


def _values(of: CircuitPrediction, channels: Sequence[str]) -> np.ndarray:
    return np.concatenate([block.values for block in of.blocks(derivatives=False, channels=channels)])


def _moved(of: CircuitPrediction, k: int, step: float) -> CircuitPrediction:
    """Prediction with another value of a parameter's variable, or of a nuisance parameter."""
    device, nuisance = of.transducer, of.nuisance
    if k < len(of.parameters):
        parameter = of.parameters[k]
        inner = float(np.real(parameter.inner(value_at(device, parameter.path)))) + step
        device = put(device, parameter.path, float(np.real(parameter.outer(inner))))
    else:
        nuisance = nuisance + step * (np.arange(len(nuisance)) == k - len(of.parameters))
    return type(of)(device, of.setting, (), nuisance, relaxed=of.relaxed, under_way=of.under_way)


def _lane(of: CircuitPrediction, k: int, base: np.ndarray, channels: Sequence[str]) -> np.ndarray:
    """Derivatives (samples, channels) with respect to one variable."""
    if _has_none(of, k):
        return np.zeros_like(base)
    largest = np.max(np.abs(base), axis=0) + 1e-300
    step, most = _step(of, k), _largest_step(of, k)
    for _ in range(MAX_TRIALS):
        upper = _change(of, k, step, base, channels)
        if upper is None:
            return np.zeros_like(base)
        change = float(np.max(np.median(np.abs(upper), axis=0) / largest))
        if change >= 0.1 * CHANGE:
            break
        if step >= most:
            if change < MIN_CHANGE:
                return np.zeros_like(base)
            break
        step = min(step * (1e3 if change == 0.0 else float(np.clip(CHANGE / change, 2.0, 1e3))), most)
    else:
        return np.zeros_like(base)
    down = None if _bounded_below(of, k, step) else _change(of, k, -step, base, channels)
    if down is None:
        return upper / step
    lower = -down
    smaller = np.where(np.abs(upper) < np.abs(lower), upper, lower)
    unlike = np.abs(upper - lower) > 0.5 * (np.abs(upper) + np.abs(lower))
    return np.where(unlike, smaller, 0.5 * (upper + lower)) / step


def _change(of: CircuitPrediction, k: int, step: float, base: np.ndarray, channels: Sequence[str]) -> np.ndarray | None:
    """Change of a prediction by a step of one variable; None where it cannot be simulated there."""
    try:
        return _values(_moved(of, k, step), channels) - base
    except PredictionError:
        return None


def _largest_step(of: CircuitPrediction, k: int) -> float:
    """Step of a variable beyond which a change of the prediction would be none of a derivative.

    Of one without influence steps would grow until the model moves so fast that a run takes all the work it may.
    """
    begun = k - len(of.parameters) - of.begun_from
    if 0 <= begun < len(of.begun):
        return LARGEST_STEP * float(of.reach[begun])
    if k >= len(of.parameters) or of.parameters[k].scaling == "log":
        return LARGEST_STEP
    size = abs(float(np.real(of.parameters[k].inner(value_at(of.transducer, of.parameters[k].path)))))
    return LARGEST_STEP * size if size > 0 else np.inf


def _has_none(of: CircuitPrediction, k: int) -> bool:
    """True for a parameter of an effect at its null value, other than the strength."""
    if k >= len(of.parameters) or of.parameters[k].path[0] != "effects":
        return False
    _, n, name = of.parameters[k].path
    effect = of.transducer.effects[int(n)]
    return effect.absent and effect.strength().name != name


def _step(of: CircuitPrediction, k: int) -> float:
    """First step of a variable."""
    begun = k - len(of.parameters) - of.begun_from
    if 0 <= begun < len(of.begun):
        return 1e-6 * (float(of.reach[begun]) or MIN_STEP)
    if k >= len(of.parameters) or of.parameters[k].scaling == "log":
        return 1e-6
    parameter = of.parameters[k]
    size = abs(float(np.real(parameter.inner(value_at(of.transducer, parameter.path)))))
    return 1e-6 * size if size > 0 else MIN_STEP


def _bounded_below(of: CircuitPrediction, k: int, step: float) -> bool:
    """True if a variable may not be smaller by a step."""
    if k >= len(of.parameters):
        return False
    parameter = of.parameters[k]
    return float(np.real(parameter.inner(value_at(of.transducer, parameter.path)))) - step < parameter.lower
