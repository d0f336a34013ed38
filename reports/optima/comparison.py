"""Random designs of each candidate's kind beside the tuned one, all judged by the same figures."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from piezoharvest.description.shunts import LinearShunt, Shunt
from piezoharvest.description.system import System
from piezoharvest.design import DesignResult, design
from piezoharvest.design.drafts import Draft, Drafting
from piezoharvest.design.goal import Goal
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.operation import mean_nodes, operation_of
from piezoharvest.design.trial import Trial
from piezoharvest.design.tuning.region import Region, values_at
from piezoharvest.design.tuning.starts import Host
from piezoharvest.engine import simulate_many
from piezoharvest.engine.work_limit import Budget
from piezoharvest.study import DesignOptions, Study

PROMISE = 1e-4  # of the objective: no random design may be better by more
_NEAR = (1e-4, 0.5)  # e-folds, or rad: distances from the optimum of half of the designs
_AT_ONCE = 2000  # designs in a batch
_LINES, _FEW = 241, 9  # frequencies over a band at which linear and switched designs are looked at first, at most
_ROUGH = 1e-2  # error of the mean over the band at these: below 1 % the best ones are among those that are kept
_KEPT, _KEPT_SIMULATED = 40, 12  # best ones of all that are judged as the tuned design is
_EVERYTHING = 10**15  # work that is allowed for what is judged
# Of `engine.work_limit`, for each design of a batch on average: ten times what one takes. Designs without a periodic
# motion, which would take a thousand times as long, are then given up.
_WORK = 1_000_000


class Compared(NamedTuple):
    """The best random design of a kind beside the tuned one.

    Attributes
    ----------
    kind : str
    drawn, designs : int
        Random designs within the region of the tuning, and those of them that have figures.
    gain : float
        By how much the best of them is better, relative; negative where it is worse.
    tuned, better : dict
        Values of the free fields of the tuned and of the best random design.
    """

    kind: str
    drawn: int
    designs: int
    gain: float
    tuned: dict[str, float]
    better: dict[str, float]


@dataclass(frozen=True, eq=False)
class Comparison:
    """Compares the candidates of a study with random designs of the same kinds.

    Attributes
    ----------
    study : Study
    designs, simulated : int
        Random designs of each kind on the two-port, and of each that has to be simulated.
    seed : int
    """

    study: Study
    designs: int
    simulated: int
    seed: int = 0

    def rows(self) -> Iterator[Compared]:
        """One comparison for each candidate that has something to tune."""
        result = self.result
        for draft in self._drafts:
            tuned = next(c.shunt for c in result.candidates if c.shunt.kind == draft.kind)
            if draft.free:
                yield self._compare(draft, tuned)

    @cached_property
    def result(self) -> DesignResult:
        """Result of the design."""
        return design(self.study)

    @cached_property
    def _view(self) -> LinearView:
        options = self.study.design or DesignOptions()
        operation = operation_of(self.study.excitation, options.band, self.study.transducer)
        return LinearView(self.study.transducer, operation, Goal(options))

    @cached_property
    def _trial(self) -> Trial:
        return Trial(self._view, left=_EVERYTHING)

    @property
    def _drafts(self) -> list[Draft]:
        options = self.study.design or DesignOptions()
        return Drafting(self.study.transducer, self.study.shunts, options, self._view.operation).drafts()

    def _compare(self, draft: Draft, tuned: Shunt) -> Compared:
        region = Region.of(draft, Host.of(self._view.working()), self._view.goal.options.max_inductance)
        best = region.logs(draft.values_of(tuned))
        count, kept = self.designs, _KEPT
        if self._by_simulation(draft.shunt):
            count, kept = self.simulated, _KEPT_SIMULATED
        points = self._points(region, best, count)
        scores = np.concatenate([self._scores(draft, part) for part in np.array_split(points, self._batches(points))])
        order = np.argsort(np.where(np.isfinite(scores), scores, np.inf))[:kept]
        exact = [self._score(draft.with_values(region.values(points[n]))) for n in order]
        first = int(np.argmin(exact))
        gain = float(np.expm1(self._score(tuned) - exact[first]))
        return Compared(
            draft.kind, len(points), int(np.sum(np.isfinite(scores))), gain,
            draft.values_of(tuned), region.values(points[order[first]]),
        )  # fmt: skip

    def _points(self, region: Region, best: np.ndarray, count: int) -> np.ndarray:
        """Random points (n, d): half all over the region, half at any distance from the optimum."""
        rng = np.random.default_rng((self.seed, len(best)))
        half = count // 2
        wide = region.lower + (region.upper - region.lower) * rng.random((half, len(best)))
        far = np.exp(rng.uniform(*np.log(_NEAR), (half, 1)))
        near = best + far * rng.normal(size=(half, len(best)))
        return np.array([p for p in np.vstack((wide, near)) if region.contains(p)])

    def _batches(self, points: np.ndarray) -> int:
        return max(len(points) // _AT_ONCE, 1)

    def _by_simulation(self, shunt: Shunt) -> bool:
        return not isinstance(shunt, LinearShunt) or self._view.transducer.hysteresis is not None

    def _scores(self, draft: Draft, points: np.ndarray) -> np.ndarray:
        """Score of each design, in one batch; over a band its peaks, or its mean power, from few frequencies."""
        view, band = self._view, self._view.operation.band
        values = values_at(draft.free, points)
        if not self._by_simulation(draft.shunt):
            grid = view.operation.frequencies[:1] if band is None else np.linspace(*band, _LINES)
            found = view.levels(draft.with_values(values), grid)
            return self._objective(found.power, found.displacement.max(axis=-1))
        lines, weights = view.operation.frequencies, np.ones(1)
        if band is not None:
            lines, weights = mean_nodes(band, view.transducer, _ROUGH, _FEW)
            if view.goal.damping:
                lines, weights = np.linspace(*band, _FEW), np.full(_FEW, 1 / _FEW)
        columns = draft.with_values(values_at(draft.free, np.repeat(points, len(lines), axis=0)))
        count, sines = len(points) * len(lines), view.operation.at(np.tile(lines, len(points))[:, None])
        system = System(view.transducer, columns)
        found = simulate_many(system, sines, count, attenuation=False, budget=Budget(_WORK * count))
        power, level, trusted = (
            found[name].reshape(len(points), -1) for name in ("harvested_power", "displacement_amplitude", "converged")
        )
        scores = self._objective(power @ weights, level.max(axis=1))
        return np.where(np.all(trusted > 0, axis=1), scores, np.inf)

    def _objective(self, power: np.ndarray, level: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            return np.log(level) if self._view.goal.damping else -np.log(np.maximum(power, 1e-300))

    def _score(self, shunt: Shunt) -> float:
        """The score that counts: exact on the two-port, else of all frequencies of the mean or of the worst peak."""
        if not self._by_simulation(shunt):
            return self._view.goal.score(self._view.figures(shunt))
        figures = self._trial.figures(shunt, complete=True)
        return self._view.goal.score(figures) if figures.converged else np.inf


def compared(study: Study, designs: int, simulated: int, seed: int = 0) -> tuple[list[Compared], float]:
    """Comparisons of a study, and the processor time in s."""
    begun = time.process_time()
    return list(Comparison(study, designs, simulated, seed).rows()), time.process_time() - begun
