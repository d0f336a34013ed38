"""Scales of smooth elements that act through others alone: the slope of a coupling's law, which a product takes.

An element that acts on the motion itself has the scale at which its output counts as much as a state. That of one that
acts through another follows from the other's derivative by it, at inputs of the size that the drive gives the states.
Out of scale, its output would be below the tolerance of the steps, and nobody would feel it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from piezoharvest.equations.terms import CURVE, PRODUCT, TIMED, SmoothElement


def influences(
    elements: Sequence[SmoothElement], direct: np.ndarray, by_state: np.ndarray, by_output: np.ndarray
) -> np.ndarray:
    """Largest influence of each element's output on the motion, directly or through the elements behind it.

    Parameters
    ----------
    elements : sequence of SmoothElement
        In their order: an input is that of an earlier one.
    direct : (..., e) array
        Influence on the equations of motion of a unit of each output.
    by_state : (..., e, 2) array
        Sizes of the inputs, but for what comes from other elements.
    by_output : (..., e, 2, e) array
        Magnitude of each input's coefficient of each output.

    Returns
    -------
    (..., e) array
        As `direct`, where that is not zero.
    """
    sizes, slopes = np.zeros_like(direct), np.zeros_like(by_state)
    for k, element in enumerate(elements):
        first, second = np.moveaxis(
            by_state[..., k, :] + np.sum(by_output[..., k, :, :] * sizes[..., None, :], -1), -1, 0
        )
        sizes[..., k], slopes[..., k, 0] = _output(element, first, second)
        slopes[..., k, 1] = first if element.power == PRODUCT else 0.0
    found = direct.copy()
    for k in reversed(range(len(elements))):
        found += found[..., k, None] * np.sum(slopes[..., k, :, None] * by_output[..., k, :, :], axis=-2)
    return np.where(direct > 0.0, direct, found)


def _output(element: SmoothElement, first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Size of an output, and of its derivative by the first input, for inputs of these sizes."""
    power = element.power
    if power == PRODUCT:
        return first * second, second
    if power == TIMED or power <= CURVE:  # of a curve that of its argument, which is of the size of one
        return first, np.ones_like(first)
    if element.pieces is not None:
        _, slope, bend = np.abs(np.real(element.pieces.coefficients)).reshape(-1, 3).max(axis=0)
        return first * (slope + bend * first), slope + 2.0 * bend * first
    return first**power, power * first ** (power - 1)
