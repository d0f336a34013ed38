"""Start values of a nonlinear model from the records with small drives on to those with large ones.

At a large amplitude a resonance that bends has two stable motions, and the model is easily in the other one than the
specimen: the cost has a minimum for each. At a small amplitude it bends little, and what it bends there foretells where
it goes as the drive grows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import fit
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.noise.noise_model import Noise
from piezoharvest.predict.parameters import put, value_at
from piezoharvest.predict.prediction import PredictionError

GROWTH = 2.0  # of the drive from a fit to the next: a cubic law's share of the force grows by four
ENOUGH = 10.0  # of -2 ln L: predicted decrease at which a fit that only gives start values ends


def fit_from_small_drives(problem: Problem, model: Model, noise: Noise) -> tuple[Model, tuple[np.ndarray, ...]] | None:
    """Model and nuisance parameters after fits of ever more records; None where all drives are about equally large.

    Raises
    ------
    PredictionError
        The model cannot follow the records.
    """
    smaller = SmallerDrives.of(problem)
    if smaller is None:
        return None
    model, nuisance = fit_from_small_drives(smaller.part, model, noise) or (model, smaller.part.start(model))
    found = fit(smaller.part, model, nuisance, noise, estimate_noise=False, enough=ENOUGH)
    return found.model, smaller.nuisance_of_all(found)


@dataclass(frozen=True, eq=False)
class SmallerDrives:
    """Records of a problem without those of its largest drives.

    Attributes
    ----------
    problem : Problem
    chosen : tuple of int
        Numbers of the records.
    """

    problem: Problem
    chosen: tuple[int, ...]

    @classmethod
    def of(cls, problem: Problem) -> SmallerDrives | None:
        """The records of a problem; None where all drives are about equally large."""
        stages = _stages(problem)
        chosen = tuple(k for k, stage in enumerate(stages) if stage < max(stages))
        return cls(problem, chosen) if chosen else None

    @cached_property
    def part(self) -> Problem:
        """The problem with these records alone."""
        problem = self.problem
        return Problem(
            [problem.data[k] for k in self.chosen], problem.nominal, problem.offset_channels, problem.beliefs
        )

    def fitted(self, model: Model, noise: Noise) -> Fit | None:
        """Fit of these records, begun at the nominal values; None where the model cannot follow them."""
        transducer = model.transducer
        for parameter in model.parameters:
            if parameter.path[0] != "effects":
                transducer = put(transducer, parameter.path, value_at(self.problem.nominal, parameter.path))
        start = replace(model, transducer=transducer)
        try:
            return fit(self.part, start, noise=noise, estimate_noise=False, enough=ENOUGH)
        except (PredictionError, np.linalg.LinAlgError):
            return None

    def nuisance_of_all(self, found: Fit) -> tuple[np.ndarray, ...]:
        """Nuisance parameters of all records: those of these from a fit, of the others their start values."""
        known = dict(zip(self.chosen, found.nuisance, strict=True))
        return tuple(known.get(k, own) for k, own in enumerate(self.problem.start(found.model)))


def _stages(problem: Problem) -> list[int]:
    """How often the drive has grown by a factor since the smallest one, for each record."""
    sizes = _sizes(problem)
    smallest = min((size for size in sizes if size > 0.0), default=1.0)
    return [0 if size == 0.0 else int(np.log(size / smallest) / np.log(GROWTH) + 1e-9) for size in sizes]


def _sizes(problem: Problem) -> list[float]:
    """Swing of the drive of each record over the largest of the same channel; zero for frequency responses."""
    swings = [(each.record.drive, _swing(each)) if isinstance(each, Data) else ("", 0.0) for each in problem.data]
    largest = {drive: max(swing for name, swing in swings if name == drive) for drive, _ in swings}
    return [swing / largest[drive] if largest[drive] else 0.0 for drive, swing in swings]


def _swing(data: Data | FrequencyData) -> float:
    assert isinstance(data, Data)
    return float(np.ptp(data.record[data.record.drive]))
