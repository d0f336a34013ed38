"""Worst case of every candidate of a design, and tuning for it where that is asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import LinearShunt, Shunt
from piezoharvest.description.shunts.linear.short import Short
from piezoharvest.description.system import System
from piezoharvest.description.tolerance import Tolerance
from piezoharvest.design.drafts import Draft
from piezoharvest.design.goal import DesignFigures, Goal
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.parts.rounding import Judge
from piezoharvest.design.parts.series import Series
from piezoharvest.design.parts.worst_case import Measure, WorstCase, objective_of
from piezoharvest.design.robust.box import Box
from piezoharvest.design.robust.certificate.enclosure import Enclosure
from piezoharvest.design.robust.certificate.search import certify
from piezoharvest.design.robust.hardening import Hardening, WorstPoints
from piezoharvest.design.robust.robust_parts import RobustParts
from piezoharvest.design.robust.space import ToleranceSpace
from piezoharvest.design.robust.specimen import ConfidenceRegion, region_of
from piezoharvest.design.robust.worst import LimitCase, RobustCase
from piezoharvest.design.tuning.minimax import Tuned
from piezoharvest.design.tuning.region import Region
from piezoharvest.design.tuning.starts import Start
from piezoharvest.engine.work_limit import MAX_WORK, Budget
from piezoharvest.linear import check_stability
from piezoharvest.progress import silent

# For the tuning of one candidate and for its worst case: each as much as all the rest of a design may take, and the
# share after which no further step begins.
_WORK, _SHARE = MAX_WORK * 5 // 4, 0.75
_SAMPLES, _AT_ONCE = 10_000, 1000  # random points, simulations in a batch
_TWO_PORT_SAMPLES = 200_000  # points times frequencies on the two-port, about a second
_KEPT = 1e-6  # e-folds beyond a limit
_SURE = 0.01  # e-folds: with a certificate nearer than this no samples are needed
_MOST_CORNERS = 256


@dataclass
class Robustness:
    """Worst cases in the tolerance of a study.

    Attributes
    ----------
    view : LinearView
        The study's transducer in its operation.
    reference : float
        Displacement in m with shorted electrodes that attenuations are counted from.
    tolerance : Tolerance
    region : ConfidenceRegion
        That of the specimen file which the tolerance names.

    Raises
    ------
    ParameterError
        The specimen file has no standard error of a parameter, or a frequency varies that the excitation has not.
    """

    view: LinearView
    reference: float
    tolerance: Tolerance
    region: ConfidenceRegion = field(init=False)

    def __post_init__(self) -> None:
        self.region = region_of(self.tolerance)
        self.view = replace(self.view, reference=self.reference)
        Box.of(self.tolerance, Short(), self.view.operation)

    @property
    def goal(self) -> Goal:
        """Goal of the design."""
        return self.view.goal

    def hardened(
        self, draft: Draft, nominal: Tuned, region: Region, exact: bool, starts: list[Start],
        progress: Callable[[str], object] = silent,
    ) -> Tuned:  # fmt: skip
        """The draft tuned for its worst case, beginning at its nominal optimum.

        `exact` says that the two-port is as good as the simulation, `starts` are then further start values, and
        `progress` takes messages.
        """
        space = self._space(nominal.shunt, exact)
        affordable = self._share(space)
        if not draft.free or not space.box.names:
            return nominal

        worst = self._worst_points(space, affordable)
        return Hardening(space, draft, region, worst, affordable, starts, progress).run(nominal)

    def rounded(
        self, draft: Draft, series: Series, known: dict[str, float], region: Region | None, exact: bool,
        progress: Callable[[str], object] = silent,
    ) -> tuple[dict[str, float], Judge, bool]:  # fmt: skip
        """Preferred values with the best worst case, what has judged them, and True if nothing ended the search.

        `known` are those that are best without a tolerance, `draft` is the shunt as tuned for its worst case.
        """
        space = self._space(draft.shunt, exact)
        affordable = self._share(space)
        search = RobustParts(space, region, self._worst_points(space, affordable), affordable, progress)
        values, judge = search.run(draft, series, known)
        return values, judge, search.complete

    def _worst_points(self, space: ToleranceSpace, affordable: Callable[[], bool]) -> WorstPoints:
        """Function of a shunt that gives its worst points: of the objective, and of each limit."""

        def worst_points(shunt: Shunt) -> list[np.ndarray]:
            own = space.with_shunt(shunt)
            return [WorstCase(own, measure, affordable).run() for measure in self._measures.values()]

        return worst_points

    def case(self, shunt: Shunt, nominal: Shunt, exact: bool) -> RobustCase:
        """Worst case of a shunt; `nominal` is the optimum without a tolerance, for the cost of being robust."""
        space = self._space(shunt, exact)
        affordable = self._share(space)
        sure = self._stable(space)
        found = {name: WorstCase(space, measure, affordable) for name, measure in self._measures.items()}
        points = {name: search.run() for name, search in found.items()}
        search = found["objective"]
        certified = self._certified(space, search) if exact else None
        gap = None if certified is None else abs(self._loss(certified) - search.worst)
        samples, sampled = 0, None
        if gap is None or gap > _SURE:
            samples, sampled = self._sample(space, search, affordable)
        points["objective"] = search.known
        figures = space.expected(points["objective"])
        limits = tuple(self._limit(space, name, points[name]) for name in points if name != "objective")
        return RobustCase(
            objective="attenuation_db" if self.goal.damping else "harvested_power",
            figures=figures._replace(response=None), corner=space.box.corner(points["objective"]),
            certified=None if certified is None else self._shown(certified),
            gap=None if certified is None else self._distance(self._loss(certified) - self.goal.score(figures)),
            nominal_cost=self._cost(space, nominal), limits=limits, samples=samples,
            sampled=None if sampled is None else self._shown(sampled),
            converged=sure and figures.converged and all(s.converged for s in found.values()),
            left_out=tuple(name for name in self.tolerance.widths if name not in space.box.names),
        )  # fmt: skip

    def _space(self, shunt: Shunt, exact: bool) -> ToleranceSpace:
        box = Box.of(self.tolerance, shunt, self.view.operation, self.region)
        return ToleranceSpace(box, self.view, shunt, exact, Budget(_WORK))

    @property
    def _measures(self) -> dict[str, Measure]:
        """What is worst: the objective, and each limit."""
        goal = self.goal
        some = DesignFigures(1.0, 1.0, 1.0, 0.0)
        found = {"objective": objective_of(goal)}
        for n, name in enumerate(goal.excess(some)):
            found[name] = Measure(
                lambda figures, name=name: goal.excess(figures)[name],
                lambda slopes, n=n: goal.excess_slopes(slopes)[n],
            )
        return found

    @staticmethod
    def _share(space: ToleranceSpace) -> Callable[[], bool]:
        """True until so much of the work is done that the last step might take more than all of it."""
        least = space.work.left * (1 - _SHARE)
        return lambda: space.work.left > least

    def _certified(self, space: ToleranceSpace, search: WorstCase) -> float | None:
        """Certified figure, W or m; the search goes on from what the certificate meets that is worse."""
        known = self._figure(search.worst)
        if not known > 0 or space.nominal.transducer.electrodes:  # enclosures have one pair of electrodes
            return None
        if not space.box.names:
            return known
        found = certify(Enclosure(space.nominal, space.shunt, space.box), known)
        if found is None:
            return None
        if np.all(np.isfinite(found.point)):
            search.climb_from(found.point)
        return found.certified

    def _sample(
        self, space: ToleranceSpace, search: WorstCase, affordable: Callable[[], bool]
    ) -> tuple[int, float | None]:
        """Number of random points and the worst figure among them; the search goes on from one that is worse."""
        size = len(space.box.names)
        if not (space.batched and size):
            return 0, None
        most = min(_SAMPLES, _TWO_PORT_SAMPLES // space.cost) if space.exact else _SAMPLES // space.cost
        points = space.box.random(np.random.default_rng(1), most)
        step, scores = max(_AT_ONCE // space.cost, 1), np.empty(0)
        for first in range(0, most, step):
            if not affordable():
                break
            part = space.sampled(points[first : first + step])
            scores = np.append(scores, [self.goal.score(f) if f.converged else -np.inf for f in part])
        if not len(scores):
            return 0, None
        worst = int(np.argmax(scores))
        if scores[worst] > search.worst:
            search.climb_from(points[worst])
        return len(scores), self._figure(scores[worst])

    def _limit(self, space: ToleranceSpace, name: str, point: np.ndarray) -> LimitCase:
        figures = space.figures(point)
        excess = self.goal.excess(figures)[name]
        value = {
            "max_voltage": figures.voltage_amplitude, "max_displacement": figures.displacement_amplitude,
            "min_power": figures.harvested_power, "min_attenuation_db": figures.attenuation_db,
        }[name]  # fmt: skip
        return LimitCase(name, value, excess, space.box.corner(point), bool(excess <= _KEPT))

    def _stable(self, space: ToleranceSpace) -> bool:
        """True if an active circuit is stable in all corners; one without active parts always is."""
        shunt, box = space.shunt, space.box
        capacitance = self.view.transducer.capacitance
        if not isinstance(shunt, LinearShunt) or all(s.storage >= 0 for s in shunt.states(capacitance)):
            return True
        corners = product(*box.bounds) if 2 ** len(box.names) <= _MOST_CORNERS else [-box.widths, box.widths]
        try:
            for corner in corners:
                point = np.array(corner)
                check_stability(System(box.transducer(self.view.transducer, point), space.shunt_at(point)))
        except (ParameterError, np.linalg.LinAlgError):
            return False
        return True

    def _cost(self, space: ToleranceSpace, nominal: Shunt) -> float:
        if nominal == space.shunt:
            return 0.0
        middle = np.zeros(len(space.box.names))
        return self._distance(
            self.goal.score(space.figures(middle)) - self.goal.score(space.with_shunt(nominal).figures(middle))
        )

    def _distance(self, loss: float) -> float:
        """A loss in e-folds as a share of the power, or in dB."""
        return float(loss * 20 / np.log(10)) if self.goal.damping else float(-np.expm1(-loss))

    def _loss(self, figure: float) -> float:
        with np.errstate(divide="ignore"):
            return float(np.log(figure) if self.goal.damping else -np.log(figure))

    def _figure(self, loss: float) -> float:
        """Displacement in m, or power in W."""
        return float(np.exp(loss if self.goal.damping else -loss))

    def _shown(self, figure: float) -> float:
        """The objective's figure: attenuation in dB, or power in W."""
        return 20 * float(np.log10(figure / self.reference)) if self.goal.damping else figure
