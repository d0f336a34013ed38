"""Play operators of many thresholds at once, with their initial states.

Between two turning points of the input an operator's output is one clipped line, so that the recursion runs over the
turning points only.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Plays(NamedTuple):
    """Play operators of n thresholds along a signal.

    Attributes
    ----------
    outputs : (samples, n) array
        Unit of the signal.
    slopes : (samples, n) array
        Derivatives of the outputs by their thresholds: -1, 0 or 1.
    kept : (samples, n) array of bool
        True where the output still is the initial state.
    """

    outputs: np.ndarray
    slopes: np.ndarray
    kept: np.ndarray


def turning_points(signal: np.ndarray) -> np.ndarray:
    """Indices where a signal reverses, the last of equal samples, with those of its first and its last sample."""
    moves = np.flatnonzero(np.diff(signal))
    directions = np.sign(np.diff(signal)[moves])
    reversals = moves[1:][directions[1:] != directions[:-1]]
    return np.unique(np.concatenate(([0], reversals, [len(signal) - 1])))


def plays(signal: np.ndarray, thresholds: np.ndarray, states: np.ndarray | float = 0.0) -> Plays:
    """Outputs of play operators, their derivatives, and a mask of the samples still at the initial states.

    Parameters
    ----------
    signal : (samples,) array
        Piecewise monotone between its samples.
    thresholds : (n,) array
        Unit of the signal, at least 0.
    states : (n,) array or float
        Outputs before the first sample.
    """
    signal, thresholds = np.asarray(signal, float), np.asarray(thresholds, float)
    points = turning_points(signal)
    state = np.broadcast_to(np.asarray(states, float), thresholds.shape).copy()
    slope, kept = np.zeros(len(thresholds)), np.ones(len(thresholds), bool)
    outputs, slopes = (np.empty((len(points), len(thresholds))) for _ in range(2))
    keeps = np.empty((len(points), len(thresholds)), bool)
    for n, value in enumerate(signal[points]):
        state, slope, kept = _clip(value, thresholds, state, slope, kept)
        outputs[n], slopes[n], keeps[n] = state, slope, kept
    before = np.searchsorted(points, np.arange(len(signal)), side="right") - 1
    return Plays(*_clip(signal[:, None], thresholds, outputs[before], slopes[before], keeps[before]))


def _clip(
    value: np.ndarray, thresholds: np.ndarray, state: np.ndarray, slope: np.ndarray, kept: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    low, high = value - thresholds, value + thresholds
    pushed, pulled = state < low, state > high
    moved = np.where(pushed, low, np.where(pulled, high, state))
    return moved, np.where(pushed, -1.0, np.where(pulled, 1.0, slope)), kept & ~pushed & ~pulled


def initial_states(
    first: float, thresholds: np.ndarray, turns: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Initial states that are admissible: neighbours differ by no more than their thresholds do.

    Parameters
    ----------
    first : float
        First sample of the signal.
    thresholds, turns : (n,) array
        Increasing thresholds, and the share of each gap by which the state goes up (1) or down (-1).

    Returns
    -------
    states : (n,) array
    by_turns, by_thresholds : (n, n) array
        Derivatives: row = state.
    """
    gaps = np.diff(thresholds, prepend=0.0)
    lower = np.tri(len(thresholds))
    changes = (np.eye(len(turns)) - np.eye(len(turns), k=-1)) * turns[:, None]
    return first + lower @ (turns * gaps), lower * gaps, lower @ changes


def half_excursions(signal: np.ndarray) -> np.ndarray:
    """Half of the distance that the signal has moved since its last reversal; (samples,).

    After a reversal, the operators with thresholds below this move, those above rest: the distribution of these values
    shows at which thresholds a record is informative.
    """
    points = turning_points(signal)
    before = points[np.maximum(np.searchsorted(points, np.arange(len(signal)), side="left") - 1, 0)]
    return 0.5 * np.abs(signal - signal[before])
