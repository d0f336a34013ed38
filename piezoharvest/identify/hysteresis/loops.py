"""Prandtl-Ishlinskii operators from measured loops: stop type (charge in) and play type (voltage in).

With fixed thresholds the fit is convex: offset, slope and weights, the latter not negative. The thresholds are placed
by the record (`threshold_placement`), the initial states are estimated with them (`play_operators`), and the standard
errors hold for a coloured residual (`coloured_noise`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.identify.hysteresis.loop_fit import Kind, Loop, LoopError, LoopFit
from piezoharvest.identify.hysteresis.loop_model import MAX_THRESHOLD, LoopData, LoopShape, convex_fit
from piezoharvest.identify.hysteresis.threshold_placement import place_thresholds, refine_shape
from piezoharvest.identify.noise.coloured_noise import covariance
from piezoharvest.identify.noise.differences import median_variance
from piezoharvest.threads import single_threaded

__all__ = ["Loop", "LoopError", "LoopFit", "identify_loop"]
_MIN_SAMPLES = 30  # least number of samples


@single_threaded
def identify_loop(
    signal: np.ndarray,
    output: np.ndarray,
    *,
    kind: Kind,
    thresholds: Sequence[float] | None = None,
    virgin: bool = False,
) -> LoopFit:
    """Identify a Prandtl-Ishlinskii operator from a record of its input and output.

    Parameters
    ----------
    signal, output : (samples,) array
        Evenly sampled, slow enough for the output to be rate-independent.
    kind : "stop" or "play"
        Stop: voltage from charge, force from displacement. Play: displacement or charge from voltage.
    thresholds : sequence of float, optional
        Unit of the input, increasing. By default their number and values are estimated.
    virgin : bool
        True if the record begins from the virgin state: the path from 0 to its first sample is monotone. Else the
        initial states are estimated.

    Raises
    ------
    LoopError
        The arrays have unsuitable shapes or values, or too few samples.
    """
    signal, output = _checked(signal, output)
    data = LoopData(signal=signal, output=output, kind=kind, virgin=virgin)
    if thresholds is None:
        return _fit(data, place_thresholds(data), np.empty(0), placed=True)
    given = _increasing(thresholds)
    seen = given <= MAX_THRESHOLD * data.excited
    shape = refine_shape(data, LoopShape(given[seen], np.zeros(seen.sum())), move=False)
    return _fit(data, shape, given[~seen], placed=False)


def _fit(data: LoopData, shape: LoopShape, unseen: np.ndarray, placed: bool) -> LoopFit:
    """Convex fit of a shape, with the standard errors of all estimated parameters."""
    n, design = len(shape.thresholds), shape.design(data)
    linear = convex_fit(design, data.output)
    residual = data.output - design @ linear
    derivatives = shape.derivatives(data, linear[2:])
    jacobian = np.hstack((design, derivatives if placed else derivatives[:, n:]))
    std = np.sqrt(np.diag(covariance(jacobian, residual)))
    return LoopFit(
        kind=data.kind, offset=float(linear[0]), slope=float(linear[1]),
        thresholds=shape.thresholds, weights=linear[2:],
        offset_std=float(std[0]), slope_std=float(std[1]), weights_std=std[2 : 2 + n],
        thresholds_std=std[2 + n : 2 + 2 * n] if placed else np.zeros(n), states=shape.states(data),
        rms=float(np.sqrt(np.mean(residual**2))), noise=median_variance(data.output, 6) ** 0.5, excited=data.excited,
        unseen=unseen,
    )  # fmt: skip


def _checked(signal: np.ndarray, output: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    signal, output = (np.asarray(values, float) for values in (signal, output))
    if signal.ndim != 1 or signal.shape != output.shape:
        shapes = f"found arrays of shapes {signal.shape} and {output.shape}"
        raise LoopError(f"signal and output: {shapes}, allowed are two arrays of the same length")
    if len(signal) < _MIN_SAMPLES:
        raise LoopError(f"signal: found {counted(len(signal), 'sample')}, allowed are {_MIN_SAMPLES} or more")
    for name, values in (("signal", signal), ("output", output)):
        if not np.all(np.isfinite(values)):
            row = int(np.argmin(np.isfinite(values)))
            raise LoopError(f"{name}, sample {row}: found {values[row]}, allowed are finite numbers")
    if len(np.unique(np.sign(np.diff(signal)))) < 2:
        raise LoopError("signal: found no reversal, but a loop needs a signal that goes up and down")
    return signal, output


def _increasing(thresholds: Sequence[float]) -> np.ndarray:
    values = np.asarray(thresholds, float)
    if values.ndim != 1 or not np.all(np.isfinite(values)) or np.any(np.diff(values, prepend=0.0) <= 0):
        raise LoopError(f"thresholds: found {list(thresholds)}, allowed are increasing numbers greater than 0")
    return values
