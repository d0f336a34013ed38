"""The stack: operator from the sine, prediction of the minor loops, inverse, and what the rest of the error is."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from piezoharvest.identify.hysteresis.loop_model import convex_fit
from piezoharvest.identify.hysteresis.loops import LoopFit, identify_loop
from piezoharvest.identify.hysteresis.play_operators import plays
from piezoharvest.identify.noise.differences import median_variance
from reports.actuators.data import STACK_RATE, Loops, minor_loops, sine

CYCLE = 200  # samples of the 1 Hz sine
SETTLED = 4 * CYCLE  # samples after which the stack has done with being switched on
# The two windows of the paper (its rows count from 1), and its tracking errors there: without and with its inverse.
WINDOWS = {"without inverse": slice(5051, 6051), "with the paper's inverse": slice(11151, 12151)}
PAPER = {"without inverse": 1.68, "with the paper's inverse": 0.58}  # um
_CREEP_TIMES = (0.5, 5.0, 50.0)  # s


class Step(NamedTuple):
    """A model with one more term.

    Attributes
    ----------
    name : str
    calibration : float
        Rms in um of what it was fitted to.
    windows : tuple of float
        Rms error in the windows, held out, mean removed as the paper does.
    lag : float
        s.
    """

    name: str
    calibration: float
    windows: tuple[float, ...]
    lag: float


@lru_cache
def operator() -> LoopFit:
    """Play operators identified on the sine alone."""
    record = sine()
    return identify_loop(record.voltage[SETTLED:], record.displacement[SETTLED:], kind="play")


def rms(error: np.ndarray) -> float:
    """Root mean square without the mean, as the paper has it."""
    return float(np.std(error))


def prediction_errors() -> np.ndarray:
    """Measured less predicted displacement over the test file, um."""
    record = minor_loops()
    return record.displacement - operator().predict(record.voltage)


def tracking() -> dict[str, tuple[float, float, float]]:
    """Tracking error of the record, that predicted for our inverse, and that read back in voltage; um, by window.

    Driven with the voltage that our inverse gives for the wanted path, the stack would be off by what the operator
    errs by on this path: to first order the error of prediction at the voltage that was applied, which is near. The
    other way round, the inverse takes the measured displacement to a voltage, whose error times the mean slope is a
    displacement again.
    """
    record, fit = minor_loops(), operator()
    slope = np.ptp(record.displacement[WINDOWS["without inverse"]]) / np.ptp(record.voltage[WINDOWS["without inverse"]])
    found = {}
    for name, window in WINDOWS.items():
        measured = rms((record.wanted - record.displacement)[window])
        read = fit.undo(record.displacement[SETTLED:])[window.start - SETTLED : window.stop - SETTLED]
        found[name] = (measured, rms(prediction_errors()[window]), rms(read - record.voltage[window]) * slope)
    return found


def repeat_noise() -> float:
    """Scatter of the settled cycles about their mean cycle, each without its own mean, um."""
    cycles = sine().displacement[SETTLED : SETTLED + 35 * CYCLE].reshape(35, CYCLE)
    cycles = cycles - cycles.mean(axis=1, keepdims=True)
    return float(np.sqrt(((cycles - cycles.mean(axis=0)) ** 2).sum() / (34 * CYCLE)))


def white_noise() -> float:
    """White part of the noise, from the differences of the displacement while the voltage stands still, um."""
    return median_variance(minor_loops().displacement[4200:5000], 6) ** 0.5


def drift() -> tuple[float, float]:
    """Creep of the cycles' means (um) from the fifth to the last cycle, and rms of the residual that it makes."""
    cycles = sine().displacement[SETTLED : SETTLED + 35 * CYCLE].reshape(35, CYCLE).mean(axis=1)
    return float(cycles[-1] - cycles[0]), float(cycles.std())


def breakdown() -> tuple[Step, ...]:
    """Terms added one after the other, each fitted outside the windows and judged within them."""
    return _steps()[0]


def window_errors() -> tuple[tuple[np.ndarray, ...], ...]:
    """Errors of each step of the breakdown, by window, um."""
    return _steps()[1]


@lru_cache
def _steps() -> tuple[tuple[Step, ...], tuple[tuple[np.ndarray, ...], ...]]:
    found = [_step("P-I, weights from the sine alone", (), sine_only=True)]
    for name, terms in (
        ("P-I, weights from the sine and the test file outside the windows", ()),
        ("+ lag of first order (rate)", ("lag",)),
        ("+ square of the voltage (asymmetry)", ("lag", "square")),
        ("+ three Kelvin-Voigt elements (creep)", ("lag", "square", "creep")),
        ("20 thresholds at equal distances for those of the sine", ("lag", "square", "creep", "fine")),
    ):
        found.append(_step(name, terms))
    steps, errors = zip(*found, strict=True)
    return steps, errors


def lag_profile(lags: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rms of the calibration by the lag (s): from the sine alone, and with the test file outside the windows; um."""
    both = [[_calibrate(("lag",), float(lag), only)[0] for lag in lags] for only in (True, False)]
    return np.array(both[0]), np.array(both[1])


def _step(name: str, terms: tuple[str, ...], sine_only: bool = False) -> tuple[Step, tuple[np.ndarray, ...]]:
    lag = 0.0
    if "lag" in terms:
        options = {"xatol": 1e-4}
        bounds = (1e-4, 0.03)
        found = minimize_scalar(lambda t: _calibrate(terms, t)[0], bounds=bounds, method="bounded", options=options)
        lag = float(found.x)
    calibration, error = _calibrate(terms, lag, sine_only)
    errors = tuple(error[window] for window in WINDOWS.values())
    return Step(name, calibration, tuple(map(rms, errors)), lag), errors


def _calibrate(terms: tuple[str, ...], lag: float, sine_only: bool = False) -> tuple[float, np.ndarray]:
    """Rms of the fit outside the windows, and the error over the test file."""
    records = (sine(), minor_loops())
    used = [np.arange(len(record.voltage)) >= SETTLED for record in records]
    for window in WINDOWS.values():
        used[1][window] = False
    if sine_only:
        used[1][:] = False
    blocks = [_columns(record, terms, lag) for record in records]
    # Free: an offset for each record, what creep it began with, and the asymmetry; not negative: all else.
    free, bound = zip(*blocks, strict=True)
    apart = np.vstack((np.hstack((free[0], 0 * free[0])), np.hstack((0 * free[1], free[1]))))
    square = np.vstack([bound[n][:, :1] for n in range(2)]) if "square" in terms else np.empty((len(apart), 0))
    rest = np.vstack([b[:, 1:] if "square" in terms else b for b in bound])
    design = np.hstack((apart, square, rest))
    target = np.concatenate([record.displacement for record in records])
    rows = np.concatenate(used)
    known = ~np.all(design[rows] == 0, axis=0)
    found = np.zeros(design.shape[1])
    number = int(known[: apart.shape[1] + square.shape[1]].sum())
    found[known] = convex_fit(design[rows][:, known], target[rows], free=number)
    error = target - design @ found
    return float(np.sqrt(np.mean(error[rows] ** 2))), error[len(records[0].voltage) :]


def _columns(record: Loops, terms: tuple[str, ...], lag: float) -> tuple[np.ndarray, np.ndarray]:
    """Columns of a record: free ones of its own, and those that all records share."""
    voltage = record.voltage
    thresholds = np.linspace(0.03, 1.79, 20) if "fine" in terms else operator().thresholds
    outputs = plays(voltage, thresholds).outputs
    shared = [voltage, *outputs.T]
    if "square" in terms:
        shared.insert(0, (voltage - 1.8) ** 2)
    own = [np.ones(len(voltage))]
    if "creep" in terms:
        time = np.arange(len(voltage)) / STACK_RATE
        shared += [low_pass(voltage, constant) for constant in _CREEP_TIMES]
        own += [np.exp(-time / constant) for constant in _CREEP_TIMES[1:]]
    if lag > 0:
        shared = [low_pass(column, lag) for column in shared]
    return np.column_stack(own), np.column_stack(shared)


def low_pass(signal: np.ndarray, constant: float) -> np.ndarray:
    """First-order lag of a signal that is linear between samples, exactly, in equilibrium at first."""
    x = 1 / (STACK_RATE * constant)
    decay = np.exp(-x)
    new = 1 - (1 - decay) / x
    old = (1 - decay) / x - decay
    return lfilter([new, old], [1, -decay], signal, zi=[signal[0] * (1 - new)])[0]
