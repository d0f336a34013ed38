"""State-space matrices of a matrix of transfer functions with common poles.

python-control makes them with the Fortran library slycot only. Here they follow from the residues at the poles that the
entries have in common: Gilbert, SIAM J. Control 1(2), 128-151, 1963. Each pole gets as many states as its residue's
rank, so that no state is left that is not driven or not seen.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import block_diag

from piezoharvest.description.parameters import ParameterError

_SAME = 1e-5  # relative distance of poles that are one: rounding splits a double root of ten by less
_ZERO = 1e-9  # share of the largest pole; an integrator after rounding
_RANK = 1e-6  # of singular values of a residue, scaled by the responses; rounding leaves less
_CANCELS = 1e-9  # share of a pole in the response around it; rounding leaves less
_POINTS = 64  # of a circle with half the distance to the next pole: its integral errs by 2^-64


def realised(system: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Matrices A, B, C, D of a `control.TransferFunction` without a pole that is a multiple one.

    Raises
    ------
    ParameterError
        An entry has more zeros than poles, or coefficients that are not real and finite.
    """
    ratios = [
        [tuple(_coefficients(row) for row in pair) for pair in zip(*rows, strict=True)]
        for rows in zip(system.num, system.den, strict=True)
    ]
    feedthrough = np.array([[_at_infinity(*pair) for pair in row] for row in ratios])
    poles = _common_poles(np.concatenate([np.roots(below) for row in ratios for _, below in row]))
    size = _sizes(ratios, poles)
    feedthrough[np.abs(feedthrough) <= _CANCELS * size] = 0.0
    scale = _scales(size)
    blocks: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for pole in poles[np.imag(poles) >= 0]:
        if (residue := _residue(ratios, pole, poles)) is not None:
            blocks += _blocks(pole, residue, *scale)
    if not blocks:
        rows, columns = feedthrough.shape
        return np.zeros((0, 0)), np.zeros((0, columns)), np.zeros((rows, 0)), feedthrough
    a, b, c = zip(*blocks, strict=True)
    return np.asarray(block_diag(*a)), np.vstack(b), np.hstack(c), feedthrough


def responses(system: Any, s: np.ndarray) -> np.ndarray:
    """Values of a `control.TransferFunction` at points s, (s, outputs, inputs)."""
    rows = [[np.polyval(above, s) / np.polyval(below, s) for above, below in zip(*pair, strict=True)]
            for pair in zip(system.num, system.den, strict=True)]  # fmt: skip
    return np.moveaxis(np.array(rows), -1, 0)


def _coefficients(row: Any) -> np.ndarray:
    found = np.trim_zeros(np.asarray(row), "f")
    if np.iscomplexobj(found) or not np.isfinite(found).all():
        raise ParameterError("system", "found coefficients that are not real and finite, must be real numbers")
    return found


def _at_infinity(above: np.ndarray, below: np.ndarray) -> float:
    if len(above) > len(below):
        raise ParameterError("system", "found more zeros than poles in an entry, must have at most as many")
    return float(above[0] / below[0]) if len(above) == len(below) else 0.0


def _common_poles(poles: np.ndarray) -> np.ndarray:
    """Poles of which each is there once: those that differ by rounding are taken as their mean."""
    largest = np.max(np.abs(poles), initial=0.0)
    left = np.where(np.abs(poles) > _ZERO * largest, poles, 0.0)
    left = left[np.imag(left) >= 0]
    found: list[complex] = []
    while len(left):
        same = np.abs(left - left[0]) <= _SAME * np.abs(left[0])
        mean = complex(np.mean(left[same]))
        found += [mean] if mean.imag <= _SAME * abs(mean) else [mean, mean.conjugate()]
        left = left[~same]
    return np.array(found)


def _residue(ratios: list, pole: complex, poles: np.ndarray) -> np.ndarray | None:
    """Residues of all entries at a pole, by Cauchy's integral; None where zeros cancel it in all of them."""
    others = np.abs(poles - pole)
    radius = 0.5 * np.min(others[others > 0], initial=max(np.max(np.abs(poles)), 1.0))
    step = radius * np.exp(2j * np.pi * np.arange(_POINTS) / _POINTS)
    values = np.array([[_value(pair, pole + step) for pair in row] for row in ratios])
    residue = values @ step / _POINTS
    cancelled = np.abs(residue) <= _CANCELS * radius * np.max(np.abs(values), axis=-1)
    return None if np.all(cancelled) else residue


def _value(pair: tuple[np.ndarray, np.ndarray], s: np.ndarray) -> np.ndarray:
    return np.polyval(pair[0], s) / np.polyval(pair[1], s)


def _sizes(ratios: list, poles: np.ndarray) -> np.ndarray:
    """Sizes of all entries beyond the poles."""
    s = np.array([1.5 * np.max(np.abs(poles), initial=0.0) + 1e-300])
    return np.abs(np.array([[_value(pair, s)[0] for pair in row] for row in ratios]))


def _scales(size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sizes of the outputs and inputs, so that rows and columns of residues can be compared."""
    rows = np.max(size, axis=1)
    rows = np.where(rows > 0, rows, 1.0)
    columns = np.max(size / rows[:, None], axis=0)
    return rows, np.where(columns > 0, columns, 1.0)


def _blocks(
    pole: complex, residue: np.ndarray, rows: np.ndarray, columns: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Real blocks of A, B, C, one for each singular value of the residue; a pair of poles together."""
    left, size, right = np.linalg.svd(residue / np.outer(rows, columns))
    found = []
    for n in np.flatnonzero(size > _RANK * size[0]):
        c, b = left[:, n] * rows * size[n], right[n] * columns
        if np.imag(pole) == 0:
            sign = c[np.argmax(np.abs(c))] / np.max(np.abs(c))
            c, b = c / sign, b * sign
            found.append((np.array([[pole.real]]), np.real(b)[None], np.real(c)[:, None]))
        else:
            a = np.array([[pole.real, -pole.imag], [pole.imag, pole.real]])
            found.append((a, np.stack((b.real, b.imag)), 2 * np.column_stack((c.real, -c.imag))))
    return found
