"""Joint rounding of the parts of a shunt to preferred values.

The parts act together: where one is rounded up, another has to be rounded so that their resonance stays in place. All
combinations of the values nearest to the optimum are compared; on the two-port also those nearest to the optimum of the
others with one part held, at values ever further away until even that optimum is worse than the best combination. Then
boxes about the best one are searched in every pair of parts, until none holds a better one. On the two-port a whole box
is one batch, whose best are judged exactly.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations, product
from typing import Protocol

import numpy as np

from piezoharvest.description.shunts import Shunt
from piezoharvest.design.drafts import Draft
from piezoharvest.design.goal import DesignFigures, Goal
from piezoharvest.design.parts.series import Series
from piezoharvest.design.places import value_at
from piezoharvest.design.tuning.minimax import MinimaxView, tune
from piezoharvest.design.tuning.region import Region
from piezoharvest.design.tuning.starts import Start
from piezoharvest.progress import Stage, silent

_SIDES = ((-1, 0, 1, 2), (0, 1))  # steps from the value below the optimum: two on each side of it, or one
_REACH = 5  # steps of a pair of parts
# Values at which one part is held: in a decade of the finer series, and at most in one direction. In coarse series the
# boxes reach from one to the next.
_HELD_A_DECADE, _MOST_HELD = 3, 3
_MOST_WALKED = 3  # parts: with more the boxes hold enough combinations, and tuning the others takes long
_GAIN = 1e-3  # in merit, 0.1 % of power: for less it is not worth while to go on
_MOST = 512  # combinations in one box
_EXACT = 4  # best of a batch that are judged exactly
_BROKEN = 1e3  # merit where a limit is exceeded: above any loss by rounding
_LIMIT_TOLERANCE = 1e-6  # e-folds beyond a limit

Numbers = tuple[int, ...]


class Judge(Protocol):
    """Gives the figures of a shunt: the two-port, simulations, or the worst of either in a tolerance."""

    def figures(self, shunt: Shunt, /) -> DesignFigures:
        """Figures of a shunt."""
        ...


class BatchView(MinimaxView, Judge, Protocol):
    """A two-port on which batches are compared: at one point, or the worst of several."""

    def survey(self, shunt: Shunt) -> np.ndarray:
        """Frequencies in Hz at which shunts that resemble one are compared."""
        ...

    def sampled(self, batch: Shunt, grid: np.ndarray) -> list[DesignFigures]:
        """Figures of each of a batch of designs, at the frequencies of a grid (Hz)."""
        ...


@dataclass
class RoundedParts:
    """Search for the best preferred values of a shunt's parts.

    Attributes
    ----------
    draft : Draft
        The shunt as tuned; `draft.free` holds the parts to round.
    series : Series
    judge : Judge
        Gives the figures that decide.
    view : BatchView or None
        Two-port on which batches are ordered before they are judged; None for circuits with switches.
    region : Region or None
        Values that the tuning may take.
    goal : Goal
    affordable : callable
        True as long as more simulations may be made.
    complete : bool
        True after a search that was not ended by the budget.
    progress : callable
        Takes messages on the progress.
    """

    draft: Draft
    series: Series
    judge: Judge
    view: BatchView | None
    region: Region | None
    goal: Goal
    affordable: Callable[[], bool]
    complete: bool = True
    progress: Callable[[str], object] = silent
    _merits: dict[Numbers, float] = field(default_factory=dict)

    def run(self) -> dict[str, float]:
        """Preferred values of the parts."""
        ideal = list(self.draft.first().values())
        singly = tuple(self.series.nearest(value) for value in ideal)
        below = tuple(self.series.below(value) for value in ideal)
        sides = [s for s in _SIDES[self.view is None :] if len(s) ** len(ideal) <= _MOST]
        near = _box(below, [sides[0]] * len(ideal)) if sides else ()
        # The values nearest one by one are always judged, so that no joint rounding is worse than they are.
        best, before = self._best_of((singly,)), None
        best = self._best_of(near, best)
        if self.judge is self.view and self.region is not None and 1 < len(ideal) <= _MOST_WALKED:
            for place, _ in enumerate(ideal):
                for step in (1, -1):
                    best = self._walk(place, step, best)
        kind, turn = self.draft.shunt.kind, 0
        while best != before:
            before, turn, boxes = best, turn + 1, list(self._boxes(best))
            stage = Stage(self.progress, f"{kind}: parts of {self.series.name}, round {turn}", "boxes of values")
            for n, box in enumerate(boxes):
                stage.reached(n, len(boxes))
                best = self._best_of(box, best)
        return self._values(best)

    def _walk(self, place: int, step: int, best: Numbers) -> Numbers:
        """Hold one part at values ever larger, or smaller, tune the others and round them, as long as that may help."""
        assert self.view is not None and self.region is not None
        name, values = self.draft.free[place], self.draft.first()
        others = {n: v for n, v in values.items() if n != name}
        stride = step * max(len(self.series.mantissas) // _HELD_A_DECADE, _REACH)
        first = self.series.below(values[name]) + (step > 0)
        for number in range(first, first + stride * _MOST_HELD, stride):
            held = self.series.value(number)
            if not self.region.lower[place] <= np.log(held) <= self.region.upper[place]:
                break
            region = self.region.beside(name, held)
            draft = dataclasses.replace(self.draft, shunt=self.draft.with_values({name: held}), free=tuple(others))
            tuned = tune(self.view, draft, Start("", others), region)
            if not tuned.merit < self._merits[best] - _GAIN:
                break
            others = {n: value_at(tuned.shunt, n) for n in others}
            below = [number if n == name else self.series.below(others[n]) for n in self.draft.free]
            best = self._best_of(_box(below, [(0,) if n == name else _SIDES[0] for n in self.draft.free]), best)
        return best

    def _boxes(self, centre: Numbers) -> Iterator[Iterable[Numbers]]:
        """Combinations about a centre: steps of every pair of parts, the others kept; then one step of all at once."""
        n, reach = len(centre), _REACH if self.view else 1
        for pair in combinations(range(n), min(n, 2)):
            yield _box(centre, [range(-reach, reach + 1) if k in pair else (0,) for k in range(n)])
        if n > 2 and 3**n <= _MOST and self.view:
            yield _box(centre, [(-1, 0, 1)] * n)

    def _best_of(self, box: Iterable[Numbers], best: Numbers | None = None) -> Numbers:
        """The best of a box, or what was the best before."""
        box = [numbers for numbers in box if numbers not in self._merits]
        tried = [numbers for numbers in box if self._allowed(numbers)]
        if best is None:
            tried = tried or box  # outside the region only where nothing else is known
            best = tried[0]
        for numbers in self._most_promising(tried):
            if self._merits and not self.affordable():
                self.complete = False
                break
            self._merits[numbers] = self._merit(self._shunt(numbers), numbers)
        return min((best, *(n for n in tried if n in self._merits)), key=self._merits.__getitem__)

    def _most_promising(self, box: list[Numbers]) -> list[Numbers]:
        """Those of a box that are to be judged exactly, the best by a batch on the two-port."""
        if self.view is None or len(box) <= _EXACT:
            return box
        columns = np.array([list(self._values(numbers).values()) for numbers in box]).T
        batch = self.draft.with_values({n: x[:, None] for n, x in zip(self.draft.free, columns, strict=True)})
        rough = [self._rank(figures) for figures in self.view.sampled(batch, self.view.survey(self.draft.shunt))]
        return [box[k] for k in np.argsort(rough, kind="stable")[:_EXACT]]

    def _merit(self, shunt: Shunt, numbers: Numbers) -> float:
        figures = self.judge.figures(shunt)
        return self._rank(figures) + (0.0 if self._allowed(numbers) else 2 * _BROKEN)

    def _rank(self, figures: DesignFigures) -> float:
        """Merit of figures, far worse where they break a limit: penalties of tuning are too small for large steps."""
        broken = any(not by <= _LIMIT_TOLERANCE for by in self.goal.excess(figures).values())
        return self.goal.merit(figures) + _BROKEN * broken

    def _allowed(self, numbers: Numbers) -> bool:
        """True if the values are within the region of the tuning."""
        return self.region is None or self.region.contains(np.log(list(self._values(numbers).values())))

    def _values(self, numbers: Numbers) -> dict[str, float]:
        return dict(zip(self.draft.free, map(self.series.value, numbers), strict=True))

    def _shunt(self, numbers: Numbers) -> Shunt:
        return self.draft.with_values(self._values(numbers))


def _box(centre: Sequence[int], steps: Iterable[Iterable[int]]) -> Iterator[Numbers]:
    """Combinations of steps from a centre."""
    return product(*([c + step for step in of] for c, of in zip(centre, steps, strict=True)))
