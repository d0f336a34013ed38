"""The measured drive of a record as an excitation of the engine."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from piezoharvest.description.excitation import Excitation, ramps_through
from piezoharvest.predict.drive import Drive, corners_of, jumps_of


@dataclass(frozen=True, kw_only=True)
class MeasuredDrive(Excitation):
    """Samples of a force in N or of a base acceleration in m/s^2, joined by straight lines (first-order hold).

    It stands for no key of a study, so it has no kind.
    """

    values: np.ndarray = field(repr=False)
    sample_time: float
    base: bool = False  # type: ignore[misc]

    @property
    def length(self):
        """Length of the record, s."""
        return (len(self.values) - 1) * self.sample_time

    @property
    def samples(self):
        """Number of samples."""
        return len(self.values)

    @property
    def rest(self):
        """First value, under which the structure is at rest before."""
        return float(self.values[0])

    def signal(self):
        """Straight pieces through the samples."""
        return ramps_through(np.arange(len(self.values)) * self.sample_time, self.values)


def straight_drive(values: np.ndarray) -> Drive:
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
    return Drive(coefficients, np.zeros(0, int))
