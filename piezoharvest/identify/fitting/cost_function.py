"""Cost of a model by records and priors, with its derivatives."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from piezoharvest.description.parameters import ParameterError
from piezoharvest.identify.fitting.evaluation import sums_of, total_information, whiteners
from piezoharvest.identify.fitting.likelihood import Sums, Whitener
from piezoharvest.identify.fitting.measured_responses import ResponseWeights
from piezoharvest.identify.fitting.model import Model, with_values
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.noise.noise_model import Noise
from piezoharvest.predict.prediction import PredictionError

Whiteners: TypeAlias = tuple[Whitener | ResponseWeights, ...]


class Point(NamedTuple):
    """A point of the descent: the variables as one array, and the cost with its derivatives there.

    The slope is the negative gradient of half the cost.
    """

    model: Model
    nuisance: tuple[np.ndarray, ...]
    values: np.ndarray
    sums: tuple[Sums, ...]
    information: np.ndarray
    slope: np.ndarray
    squares: float
    cost: float


class CostFunction:
    """Cost of a model by records and priors, with fixed whiteners."""

    def __init__(self, problem: Problem, white: Whiteners, mean: np.ndarray, precision: np.ndarray) -> None:
        self.problem, self.white, self.mean, self.precision = problem, white, mean, precision

    def at(self, model: Model, nuisance: Sequence[np.ndarray], values: np.ndarray) -> Point:
        """Evaluate a model."""
        return self._judged(model, nuisance, values, sums_of(self.problem, model, nuisance, self.white))

    def tried(self, here: Point, values: np.ndarray) -> Point | None:
        """Evaluate a model with other values; None if the records cannot be predicted with them."""
        try:
            model = with_values(here.model, values[: len(here.model.parameters)])
            return self.at(model, _split(values, model, here.nuisance), values)
        except (PredictionError, ParameterError, np.linalg.LinAlgError, ArithmeticError):
            return None

    def by_its_own(self, here: Point, noise: Noise) -> tuple[CostFunction, Point]:
        """Evaluate the final point with the whiteners of its own model."""
        white = whiteners(self.problem, here.model, here.nuisance, noise)
        judge = CostFunction(self.problem, white, self.mean, self.precision)
        return judge, judge.at(here.model, here.nuisance, here.values)

    def _judged(
        self, model: Model, nuisance: Sequence[np.ndarray], values: np.ndarray, sums: tuple[Sums, ...]
    ) -> Point:
        information, gradient, squares = total_information(model, nuisance, sums)
        away = values - self.mean
        cost = squares + float(self.precision @ away**2)
        return Point(model, tuple(nuisance), values, sums, information, gradient - self.precision * away, squares, cost)


def _split(values: np.ndarray, model: Model, nuisance: Sequence[np.ndarray]) -> tuple[np.ndarray, ...]:
    ends = np.cumsum([len(model.parameters), *(len(mine) for mine in nuisance)])
    return tuple(values[begin:end] for begin, end in itertools.pairwise(ends))
