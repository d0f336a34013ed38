"""Draws of a specimen from the distribution of its identified values."""

from __future__ import annotations

import dataclasses

import numpy as np

from piezoharvest.description.paths import found_at, placed, tree_of
from piezoharvest.description.transducer import Transducer
from piezoharvest.specimen.file import Specimen

# Of the identified value: the least of what a draw would take below a bound that it must be above (a resistance of
# 1/x, x being drawn below zero, is a thousand times as large: the effect is nearly absent).
_LEAST = 1e-3


def drawn(specimen: Specimen, count: int, seed: int) -> Transducer:
    """A batch of transducers, drawn from the Gaussian of a specimen: values are arrays (count, 1).

    Values are normal on the scale on which they were fitted (logarithms of what is positive), and what falls beyond a
    bound is put on it.

    Parameters
    ----------
    specimen : Specimen
        With a transducer.
    count : int
    seed : int

    Raises
    ------
    ParameterError
        A draw is refused by its component.
    """
    names, transducer = list(specimen.values), specimen.transducer
    assert transducer is not None
    centre = np.array(
        [_inner(specimen.values[name], scale) for name, scale in zip(names, specimen.scaling, strict=True)]
    )
    slopes = np.array(
        [_slope(specimen.values[name], scale) for name, scale in zip(names, specimen.scaling, strict=True)]
    )
    root = root_of(specimen.covariance * np.outer(slopes, slopes))
    inner = centre + np.random.default_rng(seed).standard_normal((count, len(names))) @ root.T
    columns = {}
    for n, (name, scale) in enumerate(zip(names, specimen.scaling, strict=True)):
        value, field = found_at(transducer, name)
        columns[name] = _bounded(_outer(inner[:, n], value, scale), value, field)[:, None]
    return placed(transducer, _ordered(tree_of(names, [columns[name] for name in names])), "transducer")


def root_of(covariance: np.ndarray) -> np.ndarray:
    """Matrix R with R R' = covariance, which may be singular."""
    size = np.sqrt(np.diag(covariance))
    scale = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))


def _inner(value: float, scaling: str) -> float:
    if scaling == "log":
        return float(np.log(abs(value)))
    return 1.0 / value if scaling == "reciprocal" else value


def _slope(value: float, scaling: str) -> float:
    """Derivative of the fitted variable by the value."""
    if scaling == "log":
        return 1.0 / value
    return -(value**-2.0) if scaling == "reciprocal" else 1.0


def _outer(inner: np.ndarray, value: float, scaling: str) -> np.ndarray:
    if scaling == "log":
        return np.sign(value) * np.exp(inner)
    return 1.0 / np.maximum(inner, _LEAST / value) if scaling == "reciprocal" else inner


def _bounded(values: np.ndarray, identified: float, field: dataclasses.Field) -> np.ndarray:
    """Values within the bounds of a field."""
    meta, margin = field.metadata, _LEAST * abs(identified)
    for open_, closed, sign in (("above", "at_least", 1.0), ("below", "at_most", -1.0)):
        limits = [meta[closed]] if meta[closed] is not None else []
        limits += [meta[open_] + sign * margin] if meta[open_] is not None else []
        for limit in limits:
            values = np.maximum(values, limit) if sign > 0 else np.minimum(values, limit)
    return values


def _ordered(tree: dict) -> dict:
    """The tree with the thresholds of each draw in increasing order."""
    thresholds = tree.get("hysteresis", {}).get("thresholds", {})
    if len(thresholds) > 1:
        ranks = sorted(thresholds, key=int)
        columns = np.sort(np.hstack([thresholds[rank] for rank in ranks]), axis=1)
        thresholds.update({rank: columns[:, n : n + 1] for n, rank in enumerate(ranks)})
    return tree
