"""Radau IIA of three stages and order five, as matrices for equations that are linear over a step.

Source: Hairer & Wanner, Solving Ordinary Differential Equations II, 1996, section IV.8, with their estimate of the
error.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

_S = 6.0**0.5
NODES = np.array([(4 - _S) / 10, (4 + _S) / 10, 1.0])
_A = np.array([
    [(88 - 7 * _S) / 360, (296 - 169 * _S) / 1800, (-2 + 3 * _S) / 225],
    [(296 + 169 * _S) / 1800, (88 + 7 * _S) / 360, (-2 - 3 * _S) / 225],
    [(16 - _S) / 36, (16 + _S) / 36, 1 / 9],
])  # fmt: skip
_E = np.array([-13 - 7 * _S, -13 + 7 * _S, -1]) / 3
_GAMMA = 3 + 3 ** (2 / 3) - 3 ** (1 / 3)


class Line(NamedTuple):
    """Rates and guards as J y + b drive + c: J of shape (states + guards, states), b and c of (states + guards,).

    Attributes
    ----------
    voltage : (states + 1,) array
        Derivative of the electrode voltage with respect to the states, and its value where they are zero.
    """

    J: np.ndarray
    b: np.ndarray
    c: np.ndarray
    voltage: np.ndarray


class Step(NamedTuple):
    """A step of fixed length for one `Line`.

    Attributes
    ----------
    advance : array
        From [y, drive at the start and at the three stages, c] to [states at the stages, error estimate, guards at the
        stages], stage after stage.
    correct : (3 states, 3 states) array
        From the excess of the rates at the stages over the line to a correction of the states there.
    filter : (states, states) array
        From rate defect to error estimate.
    """

    advance: np.ndarray
    correct: np.ndarray
    filter: np.ndarray


def _outer(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Kronecker product; numpy's own takes ten times as long for small matrices."""
    product = first[:, None, :, None] * second[None, :, None, :]
    return product.reshape(len(first) * len(second), -1)


@cache
def _eye(rows: int, columns: int) -> np.ndarray:
    """Ones on the diagonal, made once for each shape: that takes as long as a product of such matrices."""
    found = np.eye(rows, columns)
    found.flags.writeable = False
    return found


def make_step(line: Line, h: float, scale: np.ndarray) -> Step:
    """Matrices of a step of length h; `scale` equalises the sizes of the states to reduce rounding."""
    J, b = line.J, line.b
    n, g = len(scale), len(J) - len(scale)
    A = J[:n] * scale[:, None] / scale
    implicit = _eye(3 * n, 3 * n) - h * _outer(_A, A)
    own, none = np.diag(scale), np.zeros((3 * n, 1))
    drives = h * _outer(_A, (scale * b[:n])[:, None])
    right = [np.tile(own, (3, 1)), none, drives, h * _outer(NODES[:, None], own), h * _outer(_A, own)]
    solved = np.linalg.solve(implicit, np.hstack(right)) / np.tile(scale, 3)[:, None]
    stages, correct = solved[:, : 2 * n + 4], solved[:, 2 * n + 4 :]

    identity = _eye(n, 2 * n + 4)
    defect = J[:n] @ identity
    defect[:, n] += b[:n]
    defect[:, n + 4 :] += _eye(n, n)
    for weight, stage in zip(_E / h, stages.reshape(3, n, -1), strict=True):
        defect += weight * (stage - identity)
    filter_ = np.linalg.inv(_GAMMA / h * _eye(n, n) - A) * scale / scale[:, None]

    advance = np.zeros((4 * n + 3 * g, 2 * n + 4 + g))
    advance[: 3 * n, : 2 * n + 4] = stages
    advance[3 * n : 4 * n, : 2 * n + 4] = filter_ @ defect
    for k in range(3):
        rows = advance[4 * n + k * g : 4 * n + (k + 1) * g]
        rows[:, : 2 * n + 4] = J[n:] @ stages[k * n : (k + 1) * n]
        rows[:, n + 1 + k] += b[n:]
        rows[:, 2 * n + 4 :] = _eye(g, g)
    return Step(advance, correct, filter_)


def nonlinear_error(step: Step, h: float, start_rates: np.ndarray, y: np.ndarray, stages: np.ndarray) -> np.ndarray:
    """Error estimate from the true rates at the start of the step; `stages` of shape (3, states)."""
    return step.filter @ (start_rates + _E / h @ (stages - y))
