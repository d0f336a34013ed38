"""How the errors of identified parameters go together: correlations, and regions of two of them."""

from __future__ import annotations

import numpy as np

from piezoharvest.specimen import Specimen

CONFIDENCE = 0.95


def correlations(specimen: Specimen) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the parameters that the records determine, and the correlations of their errors, (n, n) array."""
    names, covariance = _known(specimen)
    std = np.sqrt(np.diag(covariance))
    return names, covariance / np.outer(std, std)


def confidence_region(specimen: Specimen, first: str, second: str) -> np.ndarray:
    """Edge of the region that holds two parameters with a probability of `CONFIDENCE`, (2, 200) array in SI units.

    Raises
    ------
    ValueError
        The records do not determine a parameter of such a name, or both are the same.
    """
    names, covariance = _known(specimen)
    for name in (first, second):
        if name not in names:
            raise ValueError(f"found {name!r}, the records determine {', '.join(names)}")
    if first == second:
        raise ValueError(f"found {first!r} twice, a region is for two different parameters")
    places = [names.index(first), names.index(second)]
    angle = np.linspace(0, 2 * np.pi, 200)
    # A chi-squared of two degrees of freedom is below -2 ln(1 - p) with the probability p.
    circle = np.sqrt(-2 * np.log(1 - CONFIDENCE)) * np.array([np.cos(angle), np.sin(angle)])
    middle = np.array([[specimen.values[first]], [specimen.values[second]]])
    return middle + np.linalg.cholesky(covariance[np.ix_(places, places)]) @ circle


def _known(specimen: Specimen) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the parameters that the records determine, and their covariance in SI units."""
    names = [name for name in specimen.values if name not in specimen.lacking]
    places = [list(specimen.values).index(name) for name in names]
    return tuple(names), specimen.covariance[np.ix_(places, places)]
