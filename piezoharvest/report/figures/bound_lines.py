"""The bound of passive linear shunts as lines in the figures of a design."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from piezoharvest.design.bound import limits_along
from piezoharvest.design.goal import Goal
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.operation import operation_of
from piezoharvest.design.result import Bound
from piezoharvest.report.spans import design_band
from piezoharvest.report.subjects import Subject
from piezoharvest.study import DesignOptions, Study


class BoundLine(NamedTuple):
    """A line in a figure: its label, frequencies (f,) in Hz, and values (f,) in W or m."""

    label: str
    frequencies: np.ndarray
    values: np.ndarray


@dataclass(frozen=True)
class BoundLines:
    """Limits of passive linear shunts, for a study with a sinusoidal drive.

    Attributes
    ----------
    study : Study
    bound : Bound
    linear : Subject or None
        Best linear candidate, at whose amplitude hysteresis is linearised.
    """

    study: Study
    bound: Bound
    linear: Subject | None

    @property
    def power(self) -> float | None:
        """Bound of the harvested power in the operation of the design, W."""
        return self.bound.harvested_power

    def most_power(self, frequencies: np.ndarray) -> BoundLine | None:
        """Bound of the mean power over the band; without a band, at each frequency (f,) in Hz alone, W."""
        if self.power is None:
            return None
        if (band := design_band(self.study)) is not None:
            return BoundLine("bound for the mean over the band", np.array(band), np.full(2, self.power))
        return BoundLine("bound at each frequency", frequencies, limits_along(self._view, frequencies)[0])

    def least_displacement(self, frequencies: np.ndarray) -> BoundLine | None:
        """Bound of the worst peak in the band; without a band, at each frequency (f,) in Hz alone, m."""
        if self.bound.attenuation_db is None:
            return None
        if (band := design_band(self.study)) is not None:
            peak = 10 ** (self.bound.attenuation_db / 20) * self._view.shorted
            return BoundLine("bound for the worst peak", np.array(band), np.full(2, peak))
        least = limits_along(self._view, frequencies)[1]
        return BoundLine("bound at each frequency", frequencies, np.where(least > 0, least, np.nan))

    @cached_property
    def _view(self) -> LinearView:
        study, options = self.study, self.study.design or DesignOptions()
        operation = operation_of(study.excitation, options.band, study.transducer)
        view = LinearView(study.transducer, operation, Goal(options))
        return view.working(self.linear.shunt if self.linear else None)
