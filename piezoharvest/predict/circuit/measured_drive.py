"""The measured drive of a record as an excitation of the engine."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline

from piezoharvest.description.effects.nameless.sizes import RecordSizes
from piezoharvest.description.excitation import Samples
from piezoharvest.predict.drive import PolynomialDrive, corners_of, jumps_of


@dataclass(frozen=True, kw_only=True)
class MeasuredDrive(Samples):
    """Drive of a record: a force in N, a base acceleration or, `imposed`, the acceleration of the structure in m/s^2.

    It stands for no key of a study, so it has no kind.
    """

    values: np.ndarray = field(repr=False, compare=False)
    size: RecordSizes | None = None  # type: ignore[misc]
    base: bool = False  # type: ignore[misc]
    imposed: bool = False  # type: ignore[misc]

    @property
    def rest(self) -> float:
        """What acts at rest: no acceleration does."""
        return 0.0 if self.imposed else float(self.values[0])


def imposed_motion(values: np.ndarray) -> PolynomialDrive:
    """Cubic spline through the samples of an imposed displacement, whose acceleration is straight between them.

    It has no corners: a structure with mass does not jump.
    """
    spline = CubicSpline(np.arange(len(values)), values)
    return PolynomialDrive(np.ascontiguousarray(spline.c[::-1].T), np.zeros(0, int))


def straight_drive(values: np.ndarray) -> PolynomialDrive:
    """Straight lines between samples that act as the smooth curve through them does.

    Lines through the samples themselves would lose (w h)^2/12 of a sine of angular frequency w between samples h apart,
    which is significant in a record of ten thousand samples. The second difference makes up for it, to (w h)^4/360,
    except at corners and jumps, which are no samples of a smooth curve.
    """
    knots = values.copy()
    bends = np.diff(values, 2)
    jumps = jumps_of(values)
    sharp = np.concatenate([corners_of(values), jumps, jumps + 1]).astype(int)
    bends[np.clip(sharp - 1, 0, max(len(bends) - 1, 0))] = 0.0
    knots[1:-1] -= bends / 12.0
    coefficients = np.zeros((len(values) - 1, 4))
    coefficients[:, 0], coefficients[:, 1] = knots[:-1], np.diff(knots)
    return PolynomialDrive(coefficients, np.zeros(0, int))
