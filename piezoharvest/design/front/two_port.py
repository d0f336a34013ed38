"""Fronts of linear shunts on the exact two-port, by the epsilon-constraint method.

Source: Haimes, Lasdon & Wismer, IEEE Trans. Syst. Man Cybern. 1(3), 296-297, 1971. One figure is optimised while the
other one is held by a limit that moves from point to point (Mavrotas, Appl. Math. Comput. 213(2), 455-465, 2009, on how
the ends of the range are chosen). Each point is tuned by gradients from the point before it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from piezoharvest.description.shunts import Shunt
from piezoharvest.design.drafts import Draft
from piezoharvest.design.front.point import TIE, nondominated
from piezoharvest.design.goal import Goal
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.tuning.joint import joint_starts
from piezoharvest.design.tuning.minimax import MinimaxProgram, tune
from piezoharvest.design.tuning.region import Region, values_at
from piezoharvest.design.tuning.starts import Host, Start
from piezoharvest.progress import Stage, silent

# Steps of the power, and of the damping, each from its own end and wider by the square: near an end the other figure is
# a parabola, along which such steps are even.
_STEPS, _BAND_STEPS = 25, 11  # over a band a step takes ten times as long
_ROUNDS = 6  # of the exchange of peaks
# Random designs in the region, and as many within e-folds of the front; frequencies at which their peaks are compared.
_RANDOM, _NEAR, _SAMPLES, _CHALLENGES = 1024, 0.3, 81, 3
_CLOSED_FORMS = 3  # that the best for damping is tuned from, besides the best for harvest


@dataclass
class TwoPortFront:
    """Traces the front of a linear shunt.

    Attributes
    ----------
    view : LinearView
    draft : Draft
    host : Host
    region : Region
    best : Shunt
        The draft tuned for harvest.
    progress : callable
        Takes messages on the progress.
    """

    view: LinearView
    draft: Draft
    host: Host
    region: Region
    best: Shunt
    progress: Callable[[str], object] = silent

    def designs(self) -> list[Shunt]:
        """Designs from the best for harvest to the best for damping; some may be dominated by others."""
        damped = self._damped()
        first, last = self.view.figures(self.best), self.view.figures(damped)
        rise = np.log(first.displacement_amplitude / last.displacement_amplitude)
        fall = first.harvested_power - last.harvested_power
        if rise < TIE or fall < TIE * first.harvested_power:
            return [self.best, damped]
        shares = np.linspace(0, 1, (_BAND_STEPS if self.view.operation.band else _STEPS) + 1)[1:-1] ** 2
        powers = first.harvested_power - fall * shares
        levels = last.displacement_amplitude * np.exp(rise * shares)
        down = self._along(self.best, "damping", [{"min_power": float(power)} for power in powers])
        up = self._along(damped, "harvest", [{"max_displacement": float(level)} for level in levels])
        return self._challenged([self.best, *down, *up, damped])

    def _damped(self) -> Shunt:
        """The draft tuned for damping, from closed forms and from the best for harvest."""
        view = self._view(self.best, "damping")

        def merit(start: Start) -> float:
            return view.merit(self.draft.with_values(self.region.values(self._logs(start))))

        tried = sorted(joint_starts(view, self.draft, self.host), key=merit)[:_CLOSED_FORMS]
        tried.append(Start("the best for harvest", self.draft.values_of(self.best)))
        return min((tune(view, self.draft, start, self.region) for start in tried), key=lambda t: t.merit).shunt

    def _logs(self, start: Start) -> np.ndarray:
        return self.region.logs(start.values)

    def _along(self, end: Shunt, objective: str, limits: list[dict[str, float]]) -> list[Shunt]:
        """Designs for a sequence of limits: each is tuned from the one before it, whose peaks it begins with."""
        found, p = [end], self.region.logs(self.draft.values_of(end))
        grid = self.view.grid(end)
        name = f"{self.draft.kind}: front from the best for {'harvest' if objective == 'damping' else 'damping'}"
        stage = Stage(self.progress, name, "designs")
        for n, limit in enumerate(limits):
            stage.reached(n, len(limits))
            view = self._view(found[-1], objective, **limit)
            program = MinimaxProgram(view, self.draft, self.region, grid)
            for _ in range(_ROUNDS):
                p, _ = program.solve(p)
                if not program.widen(p):
                    break
            grid = self.view.grid(program.shunt(p))
            found.append(program.shunt(p))
        return found[1:]

    def _challenged(self, designs: list[Shunt]) -> list[Shunt]:
        """The designs, and what is tuned from random ones wherever such a one is better than a design of the front.

        A tuning may end in a local optimum, or on the ridge of two equal peaks before its optimum.
        """
        for _ in range(_CHALLENGES):
            figures = [self.view.figures(shunt) for shunt in designs]
            kept = nondominated([f.harvested_power for f in figures], [f.displacement_amplitude for f in figures])
            designs, figures = [designs[n] for n in kept], [figures[n] for n in kept]
            points, power, level = self._random(designs)
            better = []
            for f in figures:
                gain = np.log(f.displacement_amplitude / level)
                n = int(np.argmax(np.where(power >= f.harvested_power, gain, -np.inf)))
                if power[n] >= f.harvested_power and gain[n] > TIE:
                    view = self._view(designs[0], "damping", min_power=f.harvested_power)
                    start = Start("a random design", self.region.values(points[n]))
                    better.append(tune(view, self.draft, start, self.region).shunt)
            if not better:
                break
            designs = designs + better
        return designs

    def _random(self, designs: list[Shunt]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Random designs (n, d) in the region and near those of the front, their power (W) and displacement (m)."""
        region, names = self.region, self.draft.free
        random = np.random.default_rng(1).random((_RANDOM, len(names)))
        wide = region.lower + (region.upper - region.lower) * random
        near = np.array([region.logs(self.draft.values_of(shunt)) for shunt in designs])
        near = np.repeat(near, _RANDOM // len(near) + 1, axis=0)[:_RANDOM] + _NEAR * (2 * random - 1) ** 3
        points = np.array([p for p in np.vstack((wide, near)) if region.contains(p)])
        band = self.view.operation.band
        grid = self.view.operation.frequencies[:1] if band is None else np.linspace(*band, _SAMPLES)
        found = self.view.levels(self.draft.with_values(values_at(names, points)), grid)
        return points, found.power, np.max(found.displacement, axis=-1)

    def _view(self, near: Shunt, objective: Any, **limit: float) -> LinearView:
        """The two-port with another goal, with hysteresis at the amplitude with a shunt."""
        options = dataclasses.replace(self.view.goal.options, objective=objective, **limit)
        return dataclasses.replace(self.view.working(near), goal=Goal(options))
