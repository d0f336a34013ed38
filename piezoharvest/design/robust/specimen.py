"""Confidence region of an identified specimen, from the covariance in its file.

The region is the ellipsoid d' C^-1 d <= r^2 of relative deviations d of the transducer's quantities, C being their
relative covariance and r^2 the quantile of chi-square with as many degrees of freedom (Seber & Wild, Nonlinear
Regression, 1989, section 5.1).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.tolerance import Tolerance
from piezoharvest.specimen import Specimen, load_specimen
from piezoharvest.specimen.draws import root_of
from piezoharvest.study import StudyError

NAMES = ("stiffness", "mass", "damping", "coupling", "capacitance")
LEVEL = 0.95  # probability of the region, where the tolerance has none
_KEY = "design.tolerance.from"


@dataclass(frozen=True, eq=False)
class ConfidenceRegion:
    """Ellipsoid of relative deviations: d = spread @ u for u in the unit ball.

    Attributes
    ----------
    names : tuple of str
        Quantities of the transducer, r of them.
    spread : (r, r) array
    radius : float
        Semi-axes in standard deviations.
    """

    names: tuple[str, ...] = ()
    spread: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    radius: float = 1.0

    def inside(self, points: np.ndarray) -> np.ndarray:
        """Points (..., r) of the cube about the ball, those outside of it moved to its surface."""
        length = np.sqrt(np.sum(np.square(points), axis=-1, keepdims=True))
        return points / np.maximum(length, 1.0)

    def pull(self, point: np.ndarray) -> np.ndarray:
        """Derivatives (r, r) of the deviations by the coordinates of a point (r,) of the cube."""
        length = float(np.linalg.norm(point))
        if length <= 1.0:
            return self.spread
        along = point / length
        return self.spread @ (np.eye(len(point)) - np.outer(along, along)) / length

    def drawn(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Points (count, r) of the Gaussian within the region."""
        found = np.empty((0, len(self.names)))
        while len(found) < count:
            more = rng.standard_normal((2 * count, len(self.names))) / self.radius
            found = np.concatenate((found, more[np.sum(more**2, axis=1) <= 1.0]))
        return found[:count]


def region_of(tolerance: Tolerance) -> ConfidenceRegion:
    """Confidence region from the specimen file of a tolerance; of no quantity that has a half-width of its own.

    Effects and hysteresis are as identified: the region is that of the transducer's quantities, whatever these are.

    Raises
    ------
    ParameterError
        The file cannot be read, has none of the quantities, leaves one open, or is too uncertain.
    """
    if tolerance.from_ is None:
        return ConfidenceRegion()
    path = Path(tolerance.from_)
    try:
        specimen = load_specimen(path)
    except StudyError as error:
        text = f"{error.key}: {error.message}" if error.key else error.message
        raise ParameterError(_KEY, f"{path.name}: {text}") from None
    own = {name for name in NAMES if getattr(tolerance, name) is not None}
    names = tuple(name for name in NAMES if name in specimen.values and name not in own)
    lacking = [name for name in NAMES if name in specimen.lacking and name not in own and name not in names]
    if lacking:
        remedy = f"give a half-width {lacking[0]} in [design.tolerance], 0 if it is known"
        raise ParameterError(_KEY, f"{path.name} has no standard error of {lacking[0]}, {remedy}")
    if not names and not own:
        raise ParameterError(_KEY, f"{path.name} holds none of {', '.join(NAMES)}, at least one is needed")
    return _region(specimen, names, LEVEL if tolerance.level is None else tolerance.level, path)


def _region(specimen: Specimen, names: tuple[str, ...], level: float, path: Path) -> ConfidenceRegion:
    values = np.array([specimen.values[name] for name in names])
    for name, value in zip(names, values, strict=True):
        if value == 0:
            raise ParameterError(_KEY, f"{path.name} has {float(value)!r} as {name}, must be a number other than 0")
    places = [list(specimen.values).index(name) for name in names]
    relative = specimen.covariance[np.ix_(places, places)] / np.outer(values, values)
    sure = [n for n, name in enumerate(names) if relative[n, n] > 0]
    names, relative = tuple(names[n] for n in sure), relative[np.ix_(sure, sure)]
    radius = float(np.sqrt(chi2.ppf(level, max(len(names), 1))))
    for name, width in zip(names, radius * np.sqrt(np.diag(relative)), strict=True):
        if not width < 1:
            found = f"the region of {100 * level:g} % reaches {width:.3g} of the value"
            raise ParameterError(_KEY, f"{path.name} leaves {name} open: {found}, must be less than 1, else give a "
                                       f"half-width {name} in [design.tolerance]")  # fmt: skip
    return ConfidenceRegion(names, radius * root_of(relative), radius)
