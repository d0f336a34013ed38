"""Start values of a nonlinear model from the records with small drives on to those with large ones.

At a large amplitude a resonance that bends has two stable motions, and the model is easily in the other one than the
specimen: the cost has a minimum for each. At a small amplitude it bends little, and what it bends there foretells where
it goes as the drive grows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import fit
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.noise.noise_model import Noise

GROWTH = 2.0  # of the drive from a fit to the next: a cubic law's share of the force grows by four
ENOUGH = 10.0  # of -2 ln L: predicted decrease at which a fit that only gives start values ends


def fit_from_small_drives(problem: Problem, model: Model, noise: Noise) -> tuple[Model, tuple[np.ndarray, ...]] | None:
    """Model and nuisance parameters after fits of ever more records; None where all drives are about equally large.

    Raises
    ------
    PredictionError
        The model cannot follow the records.
    """
    stages = _stages(problem)
    known: dict[int, np.ndarray] = {}
    levels = sorted(set(stages))
    for level in levels[:-1]:
        chosen = [k for k, stage in enumerate(stages) if stage <= level]
        part = of_records(problem, chosen)
        nuisance = [known.get(k, own) for k, own in zip(chosen, part.start(model), strict=True)]
        found = fit(part, model, nuisance, noise, estimate_noise=False, enough=ENOUGH)
        model, known = found.model, dict(zip(chosen, found.nuisance, strict=True))
    if not known:
        return None
    return model, tuple(known.get(k, own) for k, own in enumerate(problem.start(model)))


def of_records(problem: Problem, chosen: Sequence[int]) -> Problem:
    """The same problem with some of its records."""
    return Problem([problem.data[k] for k in chosen], problem.nominal, problem.offset_channels, problem.beliefs)


def with_smaller_drives(problem: Problem) -> tuple[int, ...]:
    """Numbers of the records without those of the largest drives; none where all drives are about equally large."""
    stages = _stages(problem)
    return tuple(k for k, stage in enumerate(stages) if stage < max(stages))


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
