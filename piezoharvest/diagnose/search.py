"""Which effects are there: scores, full fits of the promising ones, forward and backward selection."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.stats import chi2

from piezoharvest.diagnose.candidates import Candidate, carried, effect_parameters, extended, scores
from piezoharvest.diagnose.leftover import Leftover, structure
from piezoharvest.diagnose.scene import Scene
from piezoharvest.effects import Effect
from piezoharvest.identify.descent import Fit
from piezoharvest.identify.fit import fit
from piezoharvest.identify.model import Model
from piezoharvest.identify.problem import Problem
from piezoharvest.predict.parameters import Parameter, put, value_at
from piezoharvest.predict.prediction import PredictionError

LEVEL = 1e-4  # chance of a false alarm, over all effects together
MOST = 3  # effects at once
PROMISING = 0.15  # of the best score: what a full fit may still turn round
FITS = 4  # full fits a stage
STAND_INS = 2  # of these against a model whose strayed parameters are held
STRAYED = 0.4  # of a logarithm: a parameter that is so far from its nominal value may stand in for an effect
ROUGHLY = 0.5  # of -2 ln L that a trial fit may still promise
COARSELY = 10.0  # the same, of a fit that only serves for scores
CLOSE = 6.0  # of -2 ln L: odds of twenty to one


@dataclass(frozen=True)
class Step:
    """A model with one effect more or less.

    Attributes
    ----------
    found : Fit
    effects : tuple of str
        Names of its effects.
    """

    found: Fit
    effects: tuple[str, ...]

    @property
    def cost(self) -> float:
        """-2 ln L but for a constant."""
        return self.found.cost


@dataclass(frozen=True)
class Search:
    """What a search has found.

    Attributes
    ----------
    base : Fit
        Without effects.
    nested : tuple of Fit
        With the first effect, the first two, and so on.
    order : tuple of Effect
        The effects in the order in which they were found, with their fitted values.
    p_values : tuple of float
        Of each, corrected for the number of effects.
    first : tuple of Candidate
        Scores of all effects against the model without any.
    left : tuple of Leftover
        Where these leave structure.
    alternatives : tuple of (Step, float)
        Other sets that are nearly as likely, with what they cost more; not looked for where structure is left.
    fits : tuple of (str, float)
        Full fits that were made: names, and cost less that of the model without effects.
    """

    base: Fit
    nested: tuple[Fit, ...]
    order: tuple[Effect, ...]
    p_values: tuple[float, ...]
    first: tuple[Candidate, ...]
    left: tuple[Leftover, ...]
    alternatives: tuple[tuple[Step, float], ...]
    fits: tuple[tuple[str, float], ...]

    @property
    def final(self) -> Fit:
        """With all effects that are there."""
        return self.nested[-1] if self.nested else self.base

    @property
    def before_last(self) -> Fit:
        """Without the last effect."""
        return self.nested[-2] if len(self.nested) > 1 else self.base

    def without_last(self) -> Search:
        """The same with the last effect taken for chance: nothing is left where it is not."""
        return replace(
            self, nested=self.nested[:-1], order=self.before_last.model.transducer.effects,
            p_values=self.p_values[:-1], left=(), alternatives=(),
        )  # fmt: skip


class Searcher:
    """Search for effects in a campaign.

    Parameters
    ----------
    problem : Problem
    scene : Scene
    library : sequence of Effect classes or None
    tell : callable
    """

    def __init__(
        self, problem: Problem, scene: Scene, library: Sequence[type[Effect]] | None, tell: Callable[[str], None]
    ):
        self.problem, self.scene, self.library, self.tell = problem, scene, library, tell
        self.fits: list[tuple[str, float]] = []
        self._scored: dict[int, tuple[Step, list[Candidate]]] = {}
        self._known: dict[tuple[str, ...], Step] = {}

    def run(self, base: Fit) -> Search:
        """Find the effects that a model without any misses."""
        self.base = base
        now, stage = self._surveyed(Step(base, ()))
        first = candidates = self._scores(now)
        levels: list[float] = []
        alternatives: list[Step] = []
        while len(now.effects) < MOST:
            tried = self._stage(now, stage)
            if not tried:
                break
            best = tried[0]
            p_value = self._p_value(now, best, candidates)
            if p_value > LEVEL:
                break
            alternatives = tried[1:]
            levels.append(p_value)
            now = best
            self.tell(f"found {', '.join(now.effects)}")
            now, levels = self._revised(now, levels)
            now, stage = self._surveyed(now)
            candidates = self._scores(now)
        now = self._polished(now)
        left = structure(self.problem, now.found)
        close = () if left else self._alternatives(now, alternatives)
        nested = self._nested(now)
        effects = now.found.model.transducer.effects
        return Search(base, nested, effects, tuple(levels), tuple(first), left, close, tuple(self.fits))

    def _scores(self, now: Step) -> list[Candidate]:
        if id(now) not in self._scored:
            self._scored[id(now)] = now, scores(self.problem, now.found, self.scene, self.library)
        return self._scored[id(now)][1]

    def _surveyed(self, now: Step) -> tuple[Step, list[tuple[Candidate, Step]]]:
        """A step, and the scores against it and against the model whose strayed parameters are at their nominal values.

        Damping delays displacement and voltage as a skew delays the voltage: once it has taken the place of one, no
        small step leads from the one to the other.
        """
        held = self._held(now)
        if held is not None and now.effects and held.cost < now.cost - CLOSE:
            # With fewer parameters it fits better: they had strayed into a minimum that is not the lowest.
            model = replace(held.found.model, parameters=now.found.model.parameters)
            freed = self._remember(self._fit(model, held.found.own, now.found))
            if freed is not None and freed.cost < now.cost - CLOSE:
                return self._surveyed(freed)
        steps = [now] if held is None else [now, held]
        return now, [(candidate, step) for step in steps for candidate in self._scores(step)]

    def _held(self, now: Step) -> Step | None:
        """Full fit with the parameters that have strayed at their nominal values; None where none has."""
        nominal, model = self.problem.nominal, now.found.model
        strayed = [
            p for p in model.parameters
            if p.scaling == "log" and p.path[0] != "effects"
            and abs(p.inner(value_at(model.transducer, p.path)) - p.inner(value_at(nominal, p.path))) > STRAYED
        ]  # fmt: skip
        if not strayed:
            return None
        transducer = model.transducer
        for parameter in strayed:
            transducer = put(transducer, parameter.path, value_at(nominal, parameter.path))
        kept = tuple(p for p in model.parameters if p not in strayed)
        return self._fit(
            replace(model, transducer=transducer, parameters=kept), now.found.own, now.found, enough=COARSELY
        )

    def _stage(self, now: Step, stage: Sequence[tuple[Candidate, Step]]) -> list[Step]:
        """Full fits of the promising effects, the best first."""
        if not stage or min(c.p_value for c, _ in stage) * len(stage) > LEVEL:
            return []
        tried: list[Step] = []
        for origin in dict.fromkeys(id(step) for _, step in stage):
            mine = [(candidate, step) for candidate, step in stage if id(step) == origin]
            chosen: dict[str, tuple[Candidate, Step]] = {}
            for candidate, step in mine:
                promising = candidate.score > PROMISING * mine[0][0].score and candidate.p_value * len(mine) < LEVEL
                if promising and _key(candidate.effect) not in chosen:
                    chosen[_key(candidate.effect)] = candidate, step
            for c, step in list(chosen.values())[: FITS if origin == id(now) else STAND_INS]:
                aim = min((_fair_cost(other) for other in tried), default=np.inf)
                fitted = self.fitted(step, c.effect, aim + CLOSE, now.found.model.parameters)
                tried += [] if fitted is None else [fitted]
        return sorted(tried, key=_fair_cost)

    def fitted(self, now: Step, effect: Effect, aim: float, varied: Sequence[Parameter] | None = None) -> Step | None:
        """Full fit with one effect more, and what else varies; None where the model then has no solution.

        It is given up where it will not come to this -2 ln L.
        """
        first = len(now.found.model.transducer.effects)
        base = now.found.model if varied is None else replace(now.found.model, parameters=tuple(varied))
        model = extended(base, [effect], effect_parameters([effect], first))
        own = carried(self.problem, now.found.model, now.found.own, model)
        step = self._fit(model, own, now.found, aim=aim)
        return self._remember(step) if step is not None and step.found.converged else step

    def _fit(self, model: Model, own, before: Fit, *, aim: float = np.inf, enough: float = ROUGHLY) -> Step | None:
        names = tuple(effect.name for effect in model.transducer.effects)
        try:
            found = fit(self.problem, model, own, before.noise, estimate_noise=False, enough=enough, aim=aim)
        except (PredictionError, np.linalg.LinAlgError):
            return None
        self.fits.append((" + ".join(names), found.cost - self.base.cost))
        self.tell(f"tried {' + '.join(names)}: -2 ln L {found.cost - self.base.cost:+.1f}")
        return Step(found, names)

    def _remember(self, step: Step | None) -> Step | None:
        """The step; the best with its effects is known from now on."""
        if step is not None:
            key = _keys(step.found.model)
            self._known[key] = min(step, self._known.get(key, step), key=lambda each: each.cost)
        return step

    def _polished(self, now: Step) -> Step:
        """The same fit to the end."""
        if not now.effects:
            return now
        found = fit(self.problem, now.found.model, now.found.own, now.found.noise, estimate_noise=False)
        return Step(found, now.effects)

    def _nested(self, now: Step) -> tuple[Fit, ...]:
        """Fits with the first effect, the first two, and so on."""
        steps = [now]
        while len(steps[0].effects) > 1:
            less = self.without(steps[0], len(steps[0].effects) - 1)
            if less is None:
                break
            steps.insert(0, less)
        steps = [steps[0]] * (len(now.effects) - len(steps)) + steps
        return tuple(step.found for step in steps) if now.effects else ()

    def _p_value(self, before: Step, after: Step, tried: Sequence[Candidate]) -> float:
        """Of an effect that was added, corrected for the number of starts that were tried."""
        return min(1.0, float(chi2.sf(before.cost - after.cost, self._freedom(after.found, -1))) * len(tried))

    def _freedom(self, found: Fit, n: int) -> int:
        """Numbers that the n-th effect takes."""
        effects = found.model.transducer.effects
        n = n % len(effects)
        own = sum(parameter.path[:2] == ("effects", n) for parameter in found.model.parameters)
        lines = sum(
            2
            for data in self.problem.data
            for channel in (*data.channels, getattr(data, "drive", ""))
            if effects[n].line(channel)
        )
        return own + lines

    def without(self, now: Step, n: int) -> Step | None:
        """The best that is known without the n-th effect."""
        keys = _keys(now.found.model)
        keys = keys[:n] + keys[n + 1 :]
        if keys not in self._known:
            self._less(now, n)
        return self._known.get(keys)

    def _less(self, now: Step, n: int) -> None:
        """Make a full fit from here without the n-th effect."""
        model = now.found.model
        effects = model.transducer.effects
        kept = [k for k in range(len(effects)) if k != n]
        parameters = []
        for parameter in model.parameters:
            if parameter.path[0] != "effects":
                parameters.append(parameter)
            elif parameter.path[1] in kept:
                parameters.append(
                    replace(parameter, path=("effects", kept.index(parameter.path[1]), *parameter.path[2:]))
                )
        less = replace(
            model,
            transducer=put(model.transducer, ("effects",), tuple(effects[k] for k in kept)),
            parameters=tuple(parameters),
        )
        self._remember(self._fit(less, carried(self.problem, model, now.found.own, less), now.found))

    def _revised(self, now: Step, levels: list[float]) -> tuple[Step, list[float]]:
        """Throw out what is no longer needed, and exchange what another effect explains better."""
        n = 0
        while len(now.effects) > 1 and n < len(now.effects) - 1:
            self._less(now, n)  # another start than that of its stage
            less = self.without(now, n)
            if less is None:
                n += 1
                continue
            gone = float(chi2.sf(less.cost - now.cost, self._freedom(now.found, n)))
            if gone > LEVEL:
                self.tell(f"{now.effects[n]} is not needed any more")
                now, levels = less, levels[:n] + levels[n + 1 :]
                continue
            candidates = self._scores(less)
            better = self._exchanged(now, less, n, candidates)
            if better is None:
                n += 1
                continue
            now, levels = better, [*levels[:n], *levels[n + 1 :], self._p_value(less, better, candidates)]
            n = 0
        return now, levels

    def _exchanged(self, now: Step, less: Step, n: int, candidates: Sequence[Candidate]) -> Step | None:
        """Model with another effect in the place of the n-th, if that fits better."""
        for candidate in candidates[:3]:
            if candidate.name == now.effects[n] or candidate.score < 0.8 * (less.cost - now.cost):
                continue
            other = self.fitted(less, candidate.effect, _fair_cost(now))
            if other is not None and _fair_cost(other) < _fair_cost(now) - 1.0:
                self.tell(f"{candidate.name} instead of {now.effects[n]}")
                return other
        return None

    def _alternatives(self, now: Step, others: Sequence[Step]) -> tuple[tuple[Step, float], ...]:
        """Sets of as many effects that are nearly as likely."""
        found: dict[frozenset[str], tuple[Step, float]] = {}
        pool = [step for step in others if len(step.effects) == len(now.effects)]
        if len(now.effects) > 1:
            for n in range(len(now.effects) - 1):
                less = self.without(now, n)
                if less is None:
                    continue
                for candidate in self._scores(less)[:4]:
                    if candidate.name not in now.effects and candidate.score > less.cost - now.cost - 3 * CLOSE:
                        other = self.fitted(less, candidate.effect, _fair_cost(now) + CLOSE)
                        pool += [other] if other is not None else []
        for step in pool:
            more = _fair_cost(step) - _fair_cost(now)
            if more < CLOSE and set(step.effects) != set(now.effects):
                key = frozenset(step.effects)
                if key not in found or more < found[key][1]:
                    found[key] = (step, more)
        return tuple(sorted(found.values(), key=lambda pair: pair[1]))


def _keys(model: Model) -> tuple[str, ...]:
    """Which effects a model has."""
    return tuple(_key(effect) for effect in model.transducer.effects)


def _key(effect: Effect) -> str:
    """What is fitted once: an effect, for each channel or label."""
    own = [field.name for field in fields(effect) if field.default is None or "unit" not in field.metadata]
    return " ".join([effect.name, *(str(getattr(effect, name)) for name in own)])


def _fair_cost(step: Step) -> float:
    """Cost with two for every number that the effects take: sets of different sizes are compared by it."""
    return step.cost + 2.0 * sum(parameter.path[0] == "effects" for parameter in step.found.model.parameters)
