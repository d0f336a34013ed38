"""Tracing of the front of a tuned draft, by the method that fits its circuit and excitation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import LinearShunt, Shunt
from piezoharvest.design.drafts import Draft, any_harvests
from piezoharvest.design.front.point import Front, FrontPoint
from piezoharvest.design.front.surface import SurfaceFront
from piezoharvest.design.front.two_port import TwoPortFront
from piezoharvest.design.goal import DesignFigures
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.trial import Trial
from piezoharvest.design.tuning.region import Region
from piezoharvest.design.tuning.starts import Host
from piezoharvest.engine.work_limit import MAX_WORK
from piezoharvest.progress import silent

_MAX_WORK = MAX_WORK * 5 // 2  # of all fronts together: twice what the tuning may take, about 20 s
_LOADS = np.geomspace(1 / 30, 30, 13)  # factors of the best load where each has to be simulated alone


@dataclass
class FrontTracer:
    """Traces fronts between harvested power and damping.

    Its simulations have a budget of their own.

    Attributes
    ----------
    view : LinearView
        The transducer in its operation, with the limits of the design.
    host : Host
    exact : callable
        True for a linear shunt that the two-port tells as much of as the simulation.
    notes : list of str
        Remarks on kinds whose front is left out, or is not complete.
    progress : callable
        Takes messages on the progress.
    """

    view: LinearView
    host: Host
    exact: Callable[[LinearView, Shunt], bool]
    notes: list[str] = field(default_factory=list)
    progress: Callable[[str], object] = silent

    def __post_init__(self) -> None:
        self.trial = Trial(self.view, left=_MAX_WORK)

    def front(self, draft: Draft, best: Shunt) -> Front:
        """Front of a draft that is tuned for harvest; without points if no design keeps the limits.

        A circuit that harvests nothing, or has nothing to tune, has one point.
        """
        varied = any_harvests(best, self.view.transducer, 2 * np.pi / self.host.omega) and draft.free
        free = draft.free if varied else ()
        found: list[tuple[Shunt, DesignFigures]] = []
        try:
            found.extend(self._designs(draft, best) if varied else [(best, self._figures(best))])
        except ParameterError as error:
            self.notes.append(f"{draft.kind}: its front is left out: {error.message}")
        kept = [
            FrontPoint(shunt, figures.harvested_power, figures.attenuation_db)
            for shunt, figures in found
            if figures.converged and not self._violates(shunt, figures)
        ]
        if len(kept) < len(found):
            count = counted(len(found) - len(kept), "design")
            self.notes.append(f"{draft.kind}: left out of its front: {count} beyond the limits or not converged")
        return Front.of(draft.kind, free, kept)

    def _designs(self, draft: Draft, best: Shunt) -> Iterator[tuple[Shunt, DesignFigures]]:
        region = Region.of(draft, self.host, self.view.goal.options.max_inductance)
        if isinstance(best, LinearShunt):
            for shunt in TwoPortFront(self.view, draft, self.host, region, best, self.progress).designs():
                yield shunt, self._figures(shunt)
        elif self.view.operation.apart:
            yield from SurfaceFront(self.trial, draft, region, best).designs()
        else:
            (name,) = draft.free
            for factor in _LOADS:
                value = float(np.clip(factor * getattr(best, name), *np.exp([region.lower[0], region.upper[0]])))
                shunt = draft.with_values({name: value})
                yield shunt, self._figures(shunt)

    def _figures(self, shunt: Shunt) -> DesignFigures:
        """Figures by the two-port where it is exact, else by simulation."""
        if isinstance(shunt, LinearShunt) and self.view.operation.periodic and self.exact(self.view, shunt):
            return self.view.figures(shunt)
        return self.trial.figures(shunt, complete=True)

    def _violates(self, shunt: Shunt, figures: DesignFigures) -> tuple[str, ...]:
        return self.view.goal.violated(figures, shunt, self.view.transducer.capacitance)
