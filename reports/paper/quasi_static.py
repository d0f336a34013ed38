"""Waveforms of the quasi-static transducer under any effect, along the samples of a force: all rows at once.

The closed forms hold for a linear circuit only. Here the specimen's displacement is that of springs, friction and creep
under the force, its charge follows the displacement, and the node of the electrodes is integrated by the trapezoidal
rule. Arrays are (rows, samples).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

_PARTS = 97  # samples of a ramp, and of what follows it
_PERIOD = 4 * _PARTS - 3
_NEWTON = 3


class Drive(NamedTuple):
    """Time (s) and force (N) of each row, how often it is repeated to settle, and frequency (Hz; 0: a step)."""

    time: np.ndarray
    force: np.ndarray
    repeats: np.ndarray
    frequency: np.ndarray


class Node(NamedTuple):
    """What is connected to the electrodes, each (rows,) or a number.

    `beta` (1/V^2) is that of a charge C v (1 + beta v^2); `slow_capacitance` (F) and `slow_time` (s) are of a branch
    with a resistance in series.
    """

    conductance: np.ndarray
    capacitance: float
    beta: float
    slow_capacitance: float
    slow_time: float


def drive(low: np.ndarray, high: np.ndarray, frequency: np.ndarray, rise_time: float, hold: float) -> Drive:
    """Samples of sines between two forces (N), and of steps (frequency 0), held and released for `hold` s each."""
    ramp = np.linspace(0.0, rise_time, _PARTS)
    after = rise_time + np.concatenate(([0.0], np.geomspace(1e-3, hold - rise_time, _PARTS - 1)))
    half = np.concatenate((ramp, after[1:]))
    step_time = np.concatenate((half, hold + half[1:]))
    up = np.minimum(half / rise_time, 1.0)
    step_shape = np.concatenate((up, 1.0 - up[1:]))
    angle = np.linspace(0.0, 2 * np.pi, _PERIOD)
    sine = (frequency > 0)[:, None]
    time = np.where(sine, angle / (2 * np.pi * np.where(sine, frequency[:, None], 1.0)), step_time)
    shape = np.where(sine, 0.5 + 0.5 * np.sin(angle), step_shape)
    force = low[:, None] + (high - low)[:, None] * shape
    return Drive(time, force, np.where(frequency > 0, 1 + np.ceil(frequency), 1).astype(np.int64), frequency)


def delayed(driven: Drive, signal: np.ndarray, time_constant: float) -> np.ndarray:
    """First-order lag of a signal that follows the force: settled for sines, from rest for steps."""
    s = 2j * np.pi * driven.frequency * time_constant
    # The fundamental begins settled, its harmonics settle within the repeats.
    highest, lowest = signal.max(axis=1), signal.min(axis=1)
    settled = 0.5 * (highest + lowest) + 0.5 * (highest - lowest) * np.imag(1 / (1 + s))
    start = np.where(driven.frequency > 0, settled, signal[:, 0])
    return _lag(driven.time, signal, start, driven.repeats, time_constant)


@njit(cache=True)
def _lag(time, signal, start, repeats, time_constant):
    """First-order lag, exact for what is straight between samples."""
    found = np.empty_like(signal)
    for row in range(signal.shape[0]):
        y = start[row]
        for _ in range(repeats[row]):
            found[row, 0] = y
            for n in range(1, signal.shape[1]):
                h = (time[row, n] - time[row, n - 1]) / time_constant
                kept = np.exp(-h)
                mean = (1.0 - kept) / h if h > 1e-9 else 1.0
                y = kept * y + (mean - kept) * signal[row, n - 1] + (1.0 - mean) * signal[row, n]
                found[row, n] = y
    return found


@njit(cache=True)
def play(force, threshold):
    """Play operator of the force, once through to settle."""
    found = np.empty_like(force)
    for row in range(force.shape[0]):
        y = 0.0
        for _ in range(2):
            for n in range(force.shape[1]):
                y = min(max(y, force[row, n] - threshold), force[row, n] + threshold)
                found[row, n] = y
    return found


def voltage(driven: Drive, charge: np.ndarray, node: Node) -> np.ndarray:
    """Voltage (V) that a charge (C) pushed onto the electrodes makes: settled for sines, from rest for steps."""
    s = 2j * np.pi * driven.frequency
    slow = 1 / (1 + node.slow_time * s)
    swing = np.where(driven.frequency > 0, 0.5 * np.ptp(charge, axis=1), 0.0)
    whole = swing * s / (node.conductance + s * (node.capacitance + node.slow_capacitance * slow))
    start = np.stack((np.imag(whole), np.imag(whole * slow)))
    conductance = np.broadcast_to(node.conductance, (len(charge),)).astype(float)
    return _node(driven.time, charge, start, driven.repeats, conductance, *node[1:])


@njit(cache=True)
def _node(time, charge, start, repeats, conductance, capacitance, beta, slow_capacitance, slow_time):
    """The node's balance of charge by the trapezoidal rule, Newton's method for the voltage."""
    found = np.empty_like(charge)
    for row in range(charge.shape[0]):
        v, slow = start[0, row], start[1, row]
        for _ in range(repeats[row]):
            found[row, 0] = v
            for n in range(1, charge.shape[1]):
                h = time[row, n] - time[row, n - 1]
                a = 0.5 * h / slow_time
                # Charge of the slow branch: its capacitor's voltage is (kept + a v)/(1 + a) at the end of the step.
                kept = slow * (1.0 - a) + a * v
                gain = slow_capacitance * a / (1.0 + a) + 0.5 * h * conductance[row]
                known = charge[row, n] - charge[row, n - 1] + capacitance * v * (1.0 + beta * v * v)
                known -= 0.5 * h * conductance[row] * v + slow_capacitance * (kept / (1.0 + a) - slow)
                for _ in range(_NEWTON if beta != 0.0 else 1):
                    off = capacitance * v * (1.0 + beta * v * v) + gain * v - known
                    v -= off / (max(capacitance * (1.0 + 3.0 * beta * v * v), 0.1 * capacitance) + gain)
                slow = (kept + a * v) / (1.0 + a)
                found[row, n] = v
    return found
