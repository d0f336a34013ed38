"""Full fits of models that differ in their effects, and their scores: none is made twice, the best are remembered."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.description.effects import Effect
from piezoharvest.diagnose.residual_tests import Leftover, structure
from piezoharvest.diagnose.score_tests import ScoredEffect, effect_parameters, extended, scores
from piezoharvest.diagnose.start_values import CampaignScales, displacement_of, jitter_of, scene_of
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.levenberg_marquardt import ITERATIONS, UNFINISHED, Fit
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import covariance, fit, inflation, inverse, linearised
from piezoharvest.identify.fitting.problem import Problem, carried, prior_of
from piezoharvest.identify.identifiability import UNKNOWN, size_of, undetermined
from piezoharvest.identify.start_values.initial_hysteresis_state import recalled
from piezoharvest.predict.parameters import Parameter, parameters_of, put, value_at
from piezoharvest.predict.prediction import PredictionError

STRAYED = 0.4  # of a logarithm: a parameter that is so far from its nominal value may stand in for an effect
ROUGHLY = 0.5  # of -2 ln L that a trial fit may still promise
COARSELY = 10.0  # the same, of a fit that only serves for scores
WANTED = 10.0  # of -2 ln L that parameters gain by straying: with less the data does not want them there
CLOSE = 6.0  # of -2 ln L: odds of twenty to one
PLAIN = 12  # iterations after which a fit without an effect costs
CERTAIN = 2.0  # standard errors: what is nearer to nothing is not told from it, whatever it lowers the cost by
NEEDED = 1e4  # of -2 ln L more, by which the effect is needed, whatever the end of that fit would be


@dataclass(frozen=True)
class EffectChange:
    """A model with one effect more or less.

    Attributes
    ----------
    found : Fit
    """

    found: Fit

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of its effects."""
        return tuple(effect.name for effect in self.found.model.transducer.effects)

    @property
    def cost(self) -> float:
        """-2 ln L but for a constant."""
        return self.found.cost

    @property
    def fair_cost(self) -> float:
        """Cost with two for every number that the effects take: sets of different sizes are compared by it."""
        return self.cost + 2.0 * sum(parameter.path[0] == "effects" for parameter in self.found.model.parameters)


class Made(NamedTuple):
    """A full fit that was made.

    Attributes
    ----------
    names : str
        Of its effects, " + " between them.
    change : float
        Of -2 ln L from the model without effects.
    inflated : float
        How many times as large the variance of the last effect's strength is as white noise would make it.
    """

    names: str
    change: float
    inflated: float


class Trials:
    """Fits and scores of a campaign.

    Parameters
    ----------
    problem : Problem
    base : Fit
        Of the model without effects.
    library : sequence of Effect classes or None
    tell : callable

    Attributes
    ----------
    made : list of Made
    """

    def __init__(
        self,
        problem: Problem,
        base: Fit,
        library: Sequence[type[Effect]] | None,
        tell: Callable[[str], None],
    ):
        self.problem, self.base, self.library, self.tell = problem, base, library, tell
        self.made: list[Made] = []
        self._scored: dict[int, tuple[EffectChange, list[ScoredEffect]]] = {}
        self._own_noise: dict[int, tuple[Fit, Fit]] = {}
        self._known: dict[tuple[str, ...], EffectChange] = {}
        self._structure: dict[tuple[int, bool], tuple[Fit, tuple[Leftover, ...]]] = {}

    def scores(self, now: EffectChange) -> list[ScoredEffect]:
        """Scores of all effects against a model."""
        if id(now) not in self._scored:
            scene = scene_of(self.problem.data, now.found)
            self._scored[id(now)] = now, scores(self.problem, now.found, scene, self.library)
        return self._scored[id(now)][1]

    def structure(self, found: Fit, *, scattered: bool = True) -> tuple[Leftover, ...]:
        """Where a fit leaves structure; `scattered` as in `leftover.structure`."""
        key = id(found), scattered
        if key not in self._structure:
            self._structure[key] = found, structure(self.problem, found, scattered=scattered)
        return self._structure[key][1]

    def left(self, found: Fit) -> tuple[Leftover, ...]:
        """Where a fit with effects leaves structure, whitened by itself and with its own noise.

        The model without effects may pass on the noise of a drive in another way, by which it would not be white.
        """
        plain = self.structure(found)
        if not plain or len(found.model.transducer.effects) == len(self.base.model.transducer.effects):
            return plain
        if id(found) not in self._own_noise:
            try:
                own = fit(self.problem, found.model, found.own, found.noise, rounds=2)
            except (PredictionError, np.linalg.LinAlgError):
                own = found
            self._own_noise[id(found)] = found, own
        return self.structure(self._own_noise[id(found)][1])

    def extended(
        self,
        now: EffectChange,
        effect: Effect,
        aim: float,
        varied: Sequence[Parameter] | None = None,
        most: int = ITERATIONS,
    ) -> EffectChange | None:
        """Full fit with one effect more, and what else varies; None where the model then has no solution.

        It is given up where it will not come to this -2 ln L. What has not varied so far is let go only when the effect
        has its place, which it might take otherwise.
        """
        more = effect_parameters([effect], len(now.found.model.transducer.effects))
        model = extended(now.found.model, [effect], more)
        own = carried(self.problem, now.found.model, now.found.own, model)
        if varied is not None and set(varied) > set(now.found.model.parameters):
            alone = self._fit(model, own, now.found, enough=COARSELY, most=most)
            if alone is None:
                return None
            model, own = replace(alone.found.model, parameters=(*varied, *more)), alone.found.own
        step = self._kept(self._fit(model, own, now.found, aim=aim, most=most))
        return step if most < ITERATIONS else self._seen(step)

    def finished(self, tried: Sequence[EffectChange]) -> list[EffectChange]:
        """Fits of which those that crawl go on when it is known what they have to come to; the best first."""
        done = [step for step in tried if step.found.message != UNFINISHED]
        for slow in sorted((step for step in tried if step.found.message == UNFINISHED), key=lambda s: s.fair_cost):
            step = self._kept(self._fit(slow.found.model, slow.found.own, slow.found, aim=aim_beside(done)))
            done += [] if step is None else [step]
        return sorted((step for step in done if self._seen(step)), key=lambda step: step.fair_cost)

    def _seen(self, step: EffectChange | None) -> EffectChange | None:
        """The step, unless its last effect is none that the records can show."""
        if step is None:
            return None
        transducer, noise = step.found.model.transducer, step.found.noise
        scene = replace(
            self._scene,
            displacement=displacement_of(self._records, transducer),
            jitter=jitter_of(self._records, transducer, noise),
        )
        effect = step.found.model.transducer.effects[-1]
        if not effect.shown(scene):
            self.tell(f"{effect.name} is out of the range that the records show")
            return None
        return step

    @cached_property
    def _records(self) -> list[Data]:
        return [data for data in self.problem.data if isinstance(data, Data)]

    @cached_property
    def _scene(self) -> CampaignScales:
        """What the records can show, whatever the model."""
        return scene_of(self.problem.data, self.base)

    def held(self, now: EffectChange) -> EffectChange | None:
        """Full fit with the parameters that have strayed at their nominal values; None where none has."""
        strayed, model = self.strayed(now), now.found.model
        if not strayed:
            return None
        transducer = model.transducer
        for parameter in strayed:
            transducer = put(transducer, parameter.path, value_at(self.problem.nominal, parameter.path))
        kept = tuple(p for p in model.parameters if p not in strayed)
        return self._fit(
            replace(model, transducer=transducer, parameters=kept), now.found.own, now.found, enough=COARSELY
        )

    def strayed(self, now: EffectChange) -> list[Parameter]:
        """Parameters that the data wants far from their nominal values: they may stand in for an effect.

        By how much the cost would rise on their way back is told by their covariance, along the values, not their
        logarithms: what is all but zero changes a logarithm without being felt.
        """
        nominal, found = self.problem.nominal, now.found
        far, away = [], []
        for k, p in enumerate(found.model.parameters):
            if p.scaling == "log" and p.path[0] != "effects":
                back = p.inner(value_at(nominal, p.path)) - p.inner(value_at(found.model.transducer, p.path))
                if abs(back) > STRAYED:
                    far.append(k)
                    away.append(np.expm1(back))
        if not far:
            return []
        covariance = inverse(found.information + found.prior)[np.ix_(far, far)]
        wanted = np.dot(away, np.linalg.solve(covariance, away)) > WANTED
        return [found.model.parameters[k] for k in far] if wanted else []

    def redetermined(self, now: EffectChange) -> EffectChange:
        """The same with what the data determines now: without the effect that was found it told less, or seemed to.

        So it is asked again where stops were when the records began. Whether it tells a parameter that was left at its
        nominal value is asked of one linearisation there.
        """
        model, found, nominal = now.found.model, now.found, self.problem.nominal
        own = tuple(parameter for parameter in model.parameters if parameter.path[0] == "effects")
        drives = {data.drive for data in self.problem.data if isinstance(data, Data)}
        full = replace(model, parameters=(*parameters_of(nominal, drives), *own))
        if len(full.parameters) > len(model.parameters):
            information, _, _ = linearised(self.problem, full, found.own, found)
            prior = np.diag(prior_of(self.problem, full)[1])
            found = replace(found, model=full, information=information, prior=prior)
        out = {full.parameters[k].path for k in undetermined(found)} - {parameter.path for parameter in own}
        kept = tuple(parameter for parameter in full.parameters if parameter.path not in out)
        begun = recalled(self.problem, now.found)
        if kept == model.parameters and begun is None:
            return now
        transducer = model.transducer
        for path in out:
            transducer = put(transducer, path, value_at(nominal, path))
        again = self._kept(
            self._fit(replace(model, transducer=transducer, parameters=kept), begun or now.found.own, now.found)
        )
        return again or now

    def freed(self, held: EffectChange, now: EffectChange) -> EffectChange | None:
        """Full fit from there with all that varies in another step."""
        model = replace(held.found.model, parameters=now.found.model.parameters)
        return self.remember(self._fit(model, held.found.own, now.found))

    def without(self, now: EffectChange, n: int) -> EffectChange | None:
        """The best that is known without the n-th effect."""
        keys = _keys(now.found.model)
        keys = keys[:n] + keys[n + 1 :]
        if keys not in self._known:
            self.drop(now, n)
        return self._known.get(keys)

    def drop(self, now: EffectChange, n: int) -> None:
        """Make a full fit from here without the n-th effect."""
        less = _less(now.found.model, n)
        known = self._known.get(_keys(less))
        aim = np.inf if known is None else known.cost + CLOSE  # only what is better matters
        own = carried(self.problem, now.found.model, now.found.own, less)
        step = self._fit(less, own, now.found, aim=min(aim, now.cost + NEEDED), most=PLAIN)
        if step is not None and step.found.message == UNFINISHED and step.cost < now.cost + NEEDED:
            step = self._fit(step.found.model, step.found.own, step.found, aim=aim)
        self.remember(step)

    def polished(self, now: EffectChange) -> EffectChange:
        """The same fit to the end."""
        found = now.found
        return EffectChange(self._descended(found.model, found.own, found))

    def _descended(self, model: Model, own, before: Fit, **options: Any) -> Fit:
        """Fit with the noise and the whiteners of another."""
        return fit(self.problem, model, own, before.noise, white=before.white, estimate_noise=False, **options)

    def remember(self, step: EffectChange | None) -> EffectChange | None:
        """The step; the best with its effects is known from now on."""
        if step is not None:
            key = _keys(step.found.model)
            self._known[key] = min(step, self._known.get(key, step), key=lambda each: each.cost)
        return step

    def _kept(self, step: EffectChange | None) -> EffectChange | None:
        """The step, remembered if its descent came to an end."""
        return self.remember(step) if step is not None and step.found.converged else step

    def _fit(
        self, model: Model, own, before: Fit, *, aim: float = np.inf, enough: float = ROUGHLY, most: int = ITERATIONS
    ) -> EffectChange | None:
        try:
            found = self._descended(model, own, before, enough=enough, aim=aim, most=most)
        except (PredictionError, np.linalg.LinAlgError):
            return None
        step = EffectChange(found)
        names, change = " + ".join(step.effects), step.cost - self.base.cost
        self.made.append(Made(names, change, inflated(found, -1)))
        self.tell(f"tried {names or 'nominal values'}: -2 ln L {change:+.1f}")
        return step


def aim_beside(others: Sequence[EffectChange]) -> float:
    """What another fit has to come to beside these."""
    return min((other.fair_cost for other in others), default=np.inf) + CLOSE


def inflated(found: Fit, n: int) -> float:
    """How many times as large the variance of the n-th effect's strength is as white noise would make it.

    The errors of a sensor that rounds are alike as long as its load is held: they look like creep, like a contact, or
    like the end of a range.
    """
    place = _strength_of(found, n)
    return 1.0 if place is None else inflation(found, place)


def significance(found: Fit, n: int) -> float:
    """Square of the n-th effect's strength in its standard errors (Wald); endless for a line."""
    place = _strength_of(found, n)
    if place is None:
        return np.inf
    parameter = found.model.parameters[place]
    inner = parameter.inner(value_at(found.model.transducer, parameter.path))
    size = 1.0 if parameter.scaling == "log" else float(np.real(inner))
    return size**2 / float(covariance(found)[place, place])


def errors(problem: Problem, found: Fit, n: int) -> float:
    """How many of its standard errors the n-th effect's strength is away from nothing.

    Parameters that the records do not determine are taken for known: an effect that is in proportion to one of these is
    no less there.
    """
    scatter, place = covariance(found, _uncertain(found)), _strength_of(found, n)
    if place is None:
        size, error = amplitude_of(problem, found, n, scatter)
        return size / error if error > 0.0 else np.inf
    parameter = found.model.parameters[place]
    if parameter.scaling == "log":
        return np.inf
    inner = float(np.real(parameter.inner(value_at(found.model.transducer, parameter.path))))
    return abs(inner) / float(np.sqrt(scatter[place, place]))


def _uncertain(found: Fit) -> list[int]:
    """Parameters of the specimen that residuals as they are do not determine, the least certain one first."""
    places = [k for k, parameter in enumerate(found.model.parameters) if parameter.path[0] != "effects"]
    held: list[int] = []
    while places:
        std = np.sqrt(np.diag(covariance(found, held)))
        worst = max(places, key=lambda k: std[k] / size_of(found, k))
        if std[worst] / size_of(found, worst) < UNKNOWN:
            break
        held.append(worst)
        places.remove(worst)
    return held


def amplitude_of(problem: Problem, found: Fit, n: int, scatter: np.ndarray) -> tuple[float, float]:
    """Root mean square over records of the amplitude of a line, the n-th effect, and its standard error."""
    effect = found.model.transducer.effects[n]
    start = f"{effect.name} {getattr(effect, 'channel', '')} "  # of the records' own numbers that belong to it
    names = [problem.own_names(found.model, data) for data in problem.data]
    parts = np.concatenate(found.own) * [name.startswith(start) for some in names for name in some]
    records = sum(any(name.startswith(start) for name in some) for some in names)
    amplitude = float(np.sqrt(parts @ parts / records))
    slopes = np.pad(parts / (records * amplitude), (len(scatter) - len(parts), 0))
    return amplitude, float(np.sqrt(slopes @ scatter @ slopes))


def _strength_of(found: Fit, n: int) -> int | None:
    """Column of the n-th effect's strength; none of a line, whose are the records' own, or where there is no effect."""
    effects = found.model.transducer.effects
    if not effects:
        return None
    n = n % len(effects)
    path = ("effects", n, type(effects[n]).strength().name)
    return next((k for k, parameter in enumerate(found.model.parameters) if parameter.path == path), None)


def key_of(effect: Effect) -> str:
    """What is fitted once: an effect, for each channel or label."""
    own = [field.name for field in fields(effect) if field.default is None or "unit" not in field.metadata]
    return " ".join([effect.name, *(str(getattr(effect, name)) for name in own)])


def _keys(model: Model) -> tuple[str, ...]:
    """Which effects a model has."""
    return tuple(key_of(effect) for effect in model.transducer.effects)


def _less(model: Model, n: int) -> Model:
    """Model without its n-th effect."""
    effects = model.transducer.effects
    kept = [k for k in range(len(effects)) if k != n]
    parameters = []
    for parameter in model.parameters:
        if parameter.path[0] != "effects":
            parameters.append(parameter)
        elif parameter.path[1] in kept:
            path = ("effects", kept.index(parameter.path[1]), *parameter.path[2:])
            parameters.append(replace(parameter, path=path))
    transducer = put(model.transducer, ("effects",), tuple(effects[k] for k in kept))
    return replace(model, transducer=transducer, parameters=tuple(parameters))
