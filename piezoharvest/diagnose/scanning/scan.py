"""Values of a strength without a derivative that are tried, and the interval in which the likelihood is the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from piezoharvest.diagnose import thresholds
from piezoharvest.identify.fitting.evaluation import sums_of
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import fit
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.predict.parameters import put
from piezoharvest.predict.prediction import PredictionError

HALVINGS = 12  # of a step between two values that differ: the end of an interval is known to 1/4000 of it
MAX_SCANS = 6  # of the values, each with a fit after it
FACTORS = np.geomspace(0.5, 2.0, 25)  # on a value, that are tried
BESIDE = 1e-3  # share of the end of an interval by which the next values with other events lie beyond it
STEPS = 24  # from a value outwards, the first of FIRST of it, each half as large again
FIRST, GROWTH = 1e-3, 1.5


class Scan:
    """Cost of a fit over the strength of one of its effects, all else as it is.

    Parameters
    ----------
    problem : Problem
    found : Fit
    n : int
        Place of the effect in the model.
    """

    def __init__(self, problem: Problem, found: Fit, n: int) -> None:
        self.problem, self.found = problem, found
        effects = found.model.transducer.effects
        self.n = n % len(effects)
        self.path = ("effects", self.n, type(effects[self.n]).strength().name)
        self.value = float(getattr(effects[self.n], str(self.path[-1])))

    def model_at(self, value: float) -> Model:
        """The fit's model with another value."""
        return replace(self.found.model, transducer=put(self.found.model.transducer, self.path, value))

    def cost_at(self, value: float) -> float:
        """Sum of squares at a value; infinite where the records cannot be predicted."""
        bare = replace(self.model_at(value), parameters=())
        try:
            sums = sums_of(self.problem, bare, self.found.nuisance, self.found.white)
        except PredictionError:
            return np.inf
        return sum(float(each.squares.sum()) for each in sums)

    def best(self) -> float:
        """The value with the lowest cost of those about the present one, or if none is lower of those beside its piece.

        The ends of the interval with the same events are looked for last: that takes the longest.
        """
        here = self.cost_at(self.value)
        about = self._lowest(here, self.value * FACTORS)
        if about is not None:
            return about
        low, high = self._end(here, -1.0, 0.5 * BESIDE), self._end(here, 1.0, 0.5 * BESIDE)
        beside = np.array([low * (1.0 - BESIDE), high * (1.0 + BESIDE)])
        return self._lowest(here, beside[np.isfinite(beside)]) or self.value

    def _lowest(self, here: float, values: np.ndarray) -> float | None:
        """Of some values that with the lowest cost; None if that is not below the present one."""
        costs = [self.cost_at(value) for value in values]
        k = int(np.argmin(costs))
        return float(values[k]) if costs[k] < here - thresholds.MIN_IMPROVEMENT else None

    def interval(self) -> tuple[float, float]:
        """Lowest and highest value with the same events as now; infinite where no larger one changes any."""
        here = self.cost_at(self.value)
        return self._end(here, -1.0), self._end(here, 1.0)

    def _end(self, here: float, direction: float, share: float = 0.0) -> float:
        """End of the interval on one side: outwards until the cost is another, then by bisection to a share of it."""
        inside, step = self.value, FIRST * self.value
        for _ in range(STEPS):
            outside = max(inside + direction * step, 0.0)
            if not self._same(here, outside):
                break
            inside, step = outside, GROWTH * step
            if inside == 0.0:
                return 0.0
        else:
            return np.inf
        for _ in range(HALVINGS):
            if abs(outside - inside) < share * inside:
                break
            middle = 0.5 * (inside + outside)
            inside, outside = (middle, outside) if self._same(here, middle) else (inside, middle)
        return inside

    def _same(self, here: float, value: float) -> bool:
        return abs(self.cost_at(value) - here) < thresholds.MIN_IMPROVEMENT


def scanned_fit(problem: Problem, found: Fit) -> Fit:
    """Fit with the strength of its last effect, which is scanned, where the cost is lowest: in the middle of that.

    The value, then all else, and so on: with other values of the parameters other events may fit better.
    """
    for _ in range(MAX_SCANS):
        scan = Scan(problem, found, -1)
        best = scan.best()
        if best == scan.value:
            break
        found = fit(problem, scan.model_at(best), found.nuisance, found.noise, rounds=2)
    scan = Scan(problem, found, -1)
    low, high = scan.interval()
    return replace(found, model=scan.model_at(0.5 * (low + high))) if np.isfinite(high) else found


def spread(low: float, high: float) -> float | None:
    """Standard deviation of a value of which nothing is known but the interval; None for an open one."""
    return float((high - low) / np.sqrt(12.0)) if np.isfinite(high) else None
