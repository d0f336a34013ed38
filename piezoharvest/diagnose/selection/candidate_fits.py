"""Full fits of models that differ in their effects, and their score tests, cached so that none is repeated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.description.effects import Effect
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.preparation.held_values import deviating
from piezoharvest.diagnose.residual_structure.residual_tests import ResidualTest, failed_tests
from piezoharvest.diagnose.scanning.scan import scanned_fit
from piezoharvest.diagnose.selection.effect_change import EffectChange, cost_to_reach, effect_keys, model_without
from piezoharvest.diagnose.selection.score_tests import (
    ScoredEffect,
    effect_parameters,
    extended,
    scores,
    starts_of,
    starts_show,
    weakened,
)
from piezoharvest.diagnose.selection.significance import standard_errors_from_zero, variance_inflation
from piezoharvest.diagnose.selection.start_values import CampaignScales, campaign_scales, displacement_of, drive_jitter
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.levenberg_marquardt import MAX_ITERATIONS, NOT_CONVERGED, Fit
from piezoharvest.identify.fitting.model import Model, begun_effects, inner_values
from piezoharvest.identify.fitting.output_error import (
    excess_of,
    fit,
    follows_exactly,
    inverse,
    linearised,
    mean_square,
)
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_model, prior_of, starts_as_shown
from piezoharvest.identify.growing_fit import growing_fit
from piezoharvest.identify.identifiability import undetermined
from piezoharvest.identify.start_values.growing_drives import fit_from_small_drives
from piezoharvest.identify.start_values.initial_hysteresis_state import search_initial_states
from piezoharvest.predict.parameters import Parameter, parameters_of, put, value_at
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.progress import Step, each_told

FIT_TOLERANCE = 0.5  # of -2 ln L: predicted decrease at which a trial fit stops
COARSE_FIT_TOLERANCE = 10.0  # the same, for a fit that only serves for scores
REMOVAL_ITERATIONS = 12  # iterations of a fit without one effect before its cost is compared


class FitRecord(NamedTuple):
    """Record of a full fit that was made.

    Attributes
    ----------
    names : str
        Names of its effects, joined by " + ".
    change : float
        Change of -2 ln L from the model without effects.
    inflated : float
        Variance of the last effect's strength over that with white residuals.
    """

    names: str
    change: float
    variance_inflation: float


class CandidateFits:
    """Fits and scores of a campaign.

    Parameters
    ----------
    problem : Problem
    base : Fit
        Of the model without effects.
    library : sequence of Effect classes or None
    progress : callable
    held : sequence of Parameter
        Parameters that the base keeps where they are, and that are free beside effects.

    Attributes
    ----------
    fit_records : list of FitRecord
    """

    def __init__(
        self,
        problem: Problem,
        base: Fit,
        library: Sequence[type[Effect]] | None,
        progress: Callable[[str], None],
        held: Sequence[Parameter] = (),
    ):
        self.problem, self.base, self.library, self.progress = problem, base, library, progress
        self.held = tuple(held)
        self.fit_records: list[FitRecord] = []
        self._scored: dict[int, tuple[EffectChange, list[ScoredEffect]]] = {}
        self._refitted: dict[int, tuple[Fit, Fit]] = {}
        self._best_fits: dict[tuple[str, ...], EffectChange] = {}
        self._scanned: dict[tuple[tuple[str, ...], Effect], EffectChange] = {}
        self._failed_tests: dict[tuple[int, bool], tuple[Fit, tuple[ResidualTest, ...]]] = {}

    def scores(self, now: EffectChange) -> list[ScoredEffect]:
        """Score tests of all effects against a model."""
        if id(now) not in self._scored:
            scales = campaign_scales(self.problem.data, now.found)
            found = [
                *scores(self.problem, now.found, scales, self.library, self.progress),
                *self._scanned_scores(now, scales),
            ]
            self._scored[id(now)] = now, sorted(found, key=lambda candidate: -candidate.score)
        return self._scored[id(now)][1]

    def _scanned_scores(self, now: EffectChange, scales: CampaignScales) -> list[ScoredEffect]:
        """Gains of effects whose strength has no derivative, each by a fit of its own.

        Without the effect the model has other events than the records; parameters that were fitted to these may be far
        off, so the fit begins at the nominal values.
        """
        found, keys = [], effect_keys(now.found.model)
        scanned = [start for start in starts_of(scales, now.found, self.library) if start.scanned]
        new = [start for start in scanned if (keys, start) not in self._scanned]
        for start in each_told(self.progress, lambda start: f"testing {start.name}", new):
            step = self._scan(now, start)
            if step is not None:
                self._scanned[keys, start] = step
        for start in scanned:
            if (keys, start) in self._scanned:
                gain = now.cost - self._scanned[keys, start].cost
                found += [ScoredEffect(start, gain, 1, np.zeros(0), -1)] if gain > 0.0 else []
        return found

    def _scan(self, now: EffectChange, start: Effect) -> EffectChange | None:
        """Fit from nominal values with an effect whose strength is scanned; None where the model has no solution."""
        nominal, before = self.problem.nominal, now.found
        own = tuple(p for p in before.model.parameters if p.path[0] == "effects")
        drives = {data.drive for data in self._records}
        device = replace(nominal, effects=(*before.model.transducer.effects, start))
        model = replace(before.model, transducer=device, parameters=(*parameters_of(nominal, drives), *own))
        try:
            found = scanned_fit(self.problem, growing_fit(self.problem, model))
        except (PredictionError, np.linalg.LinAlgError):
            return None
        return self._fit(found.model, found.nuisance, before)

    def failed_tests(self, found: Fit, *, drive_noise: bool = True) -> tuple[ResidualTest, ...]:
        """Failed residual tests of a fit; `drive_noise` as in `residual_tests.failed_tests`."""
        key = id(found), drive_noise
        if key not in self._failed_tests:
            self._failed_tests[key] = found, failed_tests(self.problem, found, drive_noise=drive_noise)
        return self._failed_tests[key][1]

    def failed_tests_refitted(self, found: Fit) -> tuple[ResidualTest, ...]:
        """Failed residual tests of a fit with effects, whitened by its own model and with its own noise.

        The model without effects may pass on the drive's noise differently: its whitening would not be white here.
        """
        plain = self.failed_tests(found)
        if not plain or len(found.model.transducer.effects) == len(self.base.model.transducer.effects):
            return plain
        if id(found) not in self._refitted:
            try:
                refitted = fit(self.problem, found.model, found.nuisance, found.noise, rounds=2)
            except (PredictionError, np.linalg.LinAlgError):
                refitted = found
            self._refitted[id(found)] = found, refitted
        return self.failed_tests(self._refitted[id(found)][1])

    def follows_exactly(self, now: EffectChange) -> bool:
        """True if a model follows records without noise as closely as it can be computed."""
        return follows_exactly(self.problem, now.found)

    def extended(
        self,
        now: EffectChange,
        effect: Effect,
        aim: float,
        varied: Sequence[Parameter] | None = None,
        most: int = MAX_ITERATIONS,
        *,
        begun: bool = False,
    ) -> EffectChange | None:
        """Full fit with one effect added, and other parameters freed; None where the model then has no solution.

        With `begun` the effect may be under way as records begin. The fit is abandoned if it will not reach the cost
        `aim`. Parameters that were fixed so far are freed only after a first fit of the effect, whose place they might
        take otherwise.
        """
        if effect.scanned:
            return self.remember(self._scanned.get((effect_keys(now.found.model), effect)))
        more = effect_parameters([effect], len(now.found.model.transducer.effects))
        model = extended(now.found.model, [effect], more)
        model = replace(model, at_rest=model.at_rest and not begun)
        nuisance = nuisance_for_model(self.problem, now.found.model, now.found.nuisance, model)
        model, nuisance = self._better_start(model, nuisance, now.found)
        if varied is not None and set(varied) > set(now.found.model.parameters):
            alone = self._fit(model, nuisance, now.found, enough=COARSE_FIT_TOLERANCE, most=most)
            if alone is None:
                return None
            model, nuisance = replace(alone.found.model, parameters=(*varied, *more)), alone.found.nuisance
        step = self._remember_converged(self._fit(model, nuisance, now.found, aim=aim, most=most))
        return step if most < MAX_ITERATIONS else self._visible(step)

    def _better_start(
        self, model: Model, nuisance: tuple[np.ndarray, ...], before: Fit
    ) -> tuple[Model, tuple[np.ndarray, ...]]:
        """Start of a fit with one effect more: the better one of two after one step.

        Either the effect as its score has it beside the parameters of the fit without it, or the effect hardly there,
        from where one step changes all of them at once: what had taken its place may lie in another valley.
        """
        *rest, effect = model.transducer.effects
        weak = None if self.problem.needs_engine else weakened(effect)  # a step of the engine takes long
        if weak is None:
            return model, nuisance
        hardly = replace(model, transducer=replace(model.transducer, effects=(*rest, weak)))
        found = []
        for start in (model, hardly):
            with suppress(PredictionError, np.linalg.LinAlgError):
                found.append(self._refit(start, nuisance, before, most=1))
        best = min(found, key=lambda each: each.cost, default=None)
        return (model, nuisance) if best is None else (best.model, best.nuisance)

    def complete(self, tried: Sequence[EffectChange]) -> list[EffectChange]:
        """Fits by increasing fair cost; unfinished ones are continued now that the cost to reach is known."""
        done = [step for step in tried if step.found.message != NOT_CONVERGED]
        left = sorted((step for step in tried if step.found.message == NOT_CONVERGED), key=lambda s: s.fair_cost)
        for slow in each_told(self.progress, lambda step: f"testing {step.effects[-1]} to the end", left, most=True):
            step = self._remember_converged(
                self._fit(slow.found.model, slow.found.nuisance, slow.found, aim=cost_to_reach(done))
            )
            done += [] if step is None else [step]
        return sorted((step for step in done if self._visible(step)), key=lambda step: step.fair_cost)

    def varied(self, now: EffectChange) -> tuple[Parameter, ...]:
        """Parameters that are free in fits with one effect more."""
        return self.held if now.found is self.base and self.held else now.found.model.parameters

    def _visible(self, step: EffectChange | None) -> EffectChange | None:
        """The step, or None if the records cannot show its last effect at the fitted values."""
        if step is None or self._is_start_alone(step):
            return None
        transducer, noise = step.found.model.transducer, step.found.noise
        scales = replace(
            self._scales,
            displacement=displacement_of(self._records, transducer),
            jitter=drive_jitter(self._records, transducer, noise),
        )
        effect = step.found.model.transducer.effects[-1]
        if not effect.shown(scales):
            self.progress(f"{effect.name} is outside the range that the records can show")
            return None
        return step

    def _is_start_alone(self, step: EffectChange) -> bool:
        """True if only initial states of the last effect matter: a decay as each record begins is no effect."""
        last = len(step.effects) - 1
        if not self.count_begun(step.found.model, last):
            return False
        return standard_errors_from_zero(self.problem, step.found, last) < thresholds.MIN_STANDARD_ERRORS

    @cached_property
    def _records(self) -> list[Data]:
        return [data for data in self.problem.data if isinstance(data, Data)]

    @cached_property
    def _scales(self) -> CampaignScales:
        """Scales of the campaign, independent of the model."""
        return campaign_scales(self.problem.data, self.base)

    def at_nominal(self, now: EffectChange) -> EffectChange | None:
        """Full fit with the deviating parameters at their nominal values; None where no parameter deviates."""
        deviating, model = self.deviating(now), now.found.model
        if not deviating:
            return None
        transducer = model.transducer
        for parameter in deviating:
            transducer = put(transducer, parameter.path, value_at(self.problem.nominal, parameter.path))
        kept = tuple(p for p in model.parameters if p not in deviating)
        return self._fit(
            replace(model, transducer=transducer, parameters=kept),
            now.found.nuisance,
            now.found,
            enough=COARSE_FIT_TOLERANCE,
        )

    def deviating(self, now: EffectChange) -> list[Parameter]:
        """Parameters whose estimates are far from their nominal values (`held_values.deviating`)."""
        return deviating(now.found, self.problem.nominal)

    def count_begun(self, model: Model, n: int | None = None) -> int:
        """Number of initial states of effects, or of the n-th effect, that are nuisance parameters of the records."""
        each = (effect for data in self.problem.data for effect in begun_effects(model, data))
        return sum(n is None or effect == n for effect in each)

    def parameter_count(self, found: Fit, n: int) -> int:
        """Number of parameters of the n-th effect, nuisance parameters included."""
        effects = found.model.transducer.effects
        n = n % len(effects)
        parameters = sum(parameter.path[:2] == ("effects", n) for parameter in found.model.parameters)
        lines = sum(
            2
            for data in self.problem.data
            for channel in (*data.channels, getattr(data, "drive", ""))
            if effects[n].line(channel)
        )
        return parameters + lines + effects[n].scanned + self.count_begun(found.model, n)

    def freedom(self, found: Fit) -> int:
        """Number of parameters of all effects that were added, nuisance parameters included."""
        given, count = (len(each.model.transducer.effects) for each in (self.base, found))
        return sum(self.parameter_count(found, n) for n in range(given, count))

    def with_states_begun(self, now: EffectChange) -> EffectChange:
        """Full fit with free initial states of the effects, where one linearisation says that they are not at rest."""
        found = now.found
        free = replace(found.model, at_rest=False)
        count = self.count_begun(free)
        if not found.model.at_rest or not count:
            return now
        nuisance = nuisance_for_model(self.problem, found.model, found.nuisance, free)
        information, gradient, _ = linearised(self.problem, free, nuisance, found)
        means, precision = prior_of(self.problem, free)
        slope = gradient - precision * (np.concatenate([inner_values(free), *nuisance]) - means)
        gain = float(slope @ inverse(information + np.diag(precision)) @ slope)
        if not starts_show(gain, count, excess_of(found)):
            return now
        step = self._fit(free, nuisance, found)
        if step is None or self._is_start_alone(step):
            return now
        self.progress(f"{', '.join(now.effects)}: not settled as records begin: initial values are fitted too")
        return self._remember_converged(step) or now

    def begun_as_shown(self, now: EffectChange) -> EffectChange:
        """Full fit of records behind switches from where their first samples show that they begin, if that is better.

        A fit without the effect may have moved these starts to where the switch acts once more at the very beginning,
        or once less, from where no small step leads back.
        """
        model, found = now.found.model, now.found
        if not self.problem.has_events:
            return now
        again = self._fit(model, starts_as_shown(self.problem, model, found.nuisance), found)
        better = again is not None and again.cost < now.cost - thresholds.MIN_IMPROVEMENT
        return (self._remember_converged(again) or now) if better else now

    def redetermine(self, now: EffectChange) -> EffectChange:
        """Refit with the set of parameters that the data determines now that an effect is in the model.

        The initial states of hysteresis stops are estimated anew. A parameter that was left at its nominal value is
        freed if one linearisation there shows that the data determines it.
        """
        model, found, nominal = now.found.model, now.found, self.problem.nominal
        of_effects = tuple(parameter for parameter in model.parameters if parameter.path[0] == "effects")
        drives = {data.drive for data in self.problem.data if isinstance(data, Data)}
        full = replace(model, parameters=(*parameters_of(nominal, drives), *of_effects))
        if len(full.parameters) > len(model.parameters):
            information, _, _ = linearised(self.problem, full, found.nuisance, found)
            prior = np.diag(prior_of(self.problem, full)[1])
            found = replace(found, model=full, information=information, prior=prior)
        out = {full.parameters[k].path for k in undetermined(found)} - {parameter.path for parameter in of_effects}
        kept = tuple(parameter for parameter in full.parameters if parameter.path not in out)
        begun = search_initial_states(self.problem, now.found)
        if kept == model.parameters and begun is None:
            return now
        transducer = model.transducer
        for path in out:
            transducer = put(transducer, path, value_at(nominal, path))
        again = self._remember_converged(
            self._fit(replace(model, transducer=transducer, parameters=kept), begun or now.found.nuisance, now.found)
        )
        return again or now

    def restarted(self, now: EffectChange) -> EffectChange:
        """The fit, or where much is left a better one with its effects that starts at the nominal values.

        What was fitted without an effect that dominates the misfit may lie in another minimum. So it starts with the
        records whose drive is small, where there are such.
        """
        if mean_square(now.found) < 1.0 + thresholds.MUCH_LEFT:
            return now
        model, transducer = now.found.model, now.found.model.transducer
        for parameter in model.parameters:
            if parameter.path[0] != "effects":
                transducer = put(transducer, parameter.path, value_at(self.problem.nominal, parameter.path))
        start, nuisance = replace(model, transducer=transducer), now.found.nuisance
        with suppress(PredictionError, np.linalg.LinAlgError):
            start, nuisance = fit_from_small_drives(self.problem, start, now.found.noise) or (start, nuisance)
        again = self._fit(start, nuisance, now.found, aim=now.fair_cost)
        if again is None or again.cost > now.cost - thresholds.MIN_IMPROVEMENT:
            return now
        self.progress("a fit that starts from the nominal values has a smaller misfit")
        self.remember(again)
        return again

    def with_freed_parameters(self, at_nominal: EffectChange, now: EffectChange) -> EffectChange | None:
        """Full fit from another step's values with all parameters of `now` free."""
        model = replace(at_nominal.found.model, parameters=now.found.model.parameters)
        return self.remember(self._fit(model, at_nominal.found.nuisance, now.found))

    def best_without(self, now: EffectChange, n: int) -> EffectChange | None:
        """Best known fit without the n-th effect."""
        keys = effect_keys(now.found.model)
        keys = keys[:n] + keys[n + 1 :]
        if keys not in self._best_fits:
            self.fit_without(now, n)
        return self._best_fits.get(keys)

    def fit_without(self, now: EffectChange, n: int) -> None:
        """Fit the model without the n-th effect, from the present values, and remember it."""
        less = model_without(now.found.model, n)
        known = self._best_fits.get(effect_keys(less))
        aim = np.inf if known is None else known.cost + thresholds.CLOSE_COST  # only a better fit matters
        nuisance = nuisance_for_model(self.problem, now.found.model, now.found.nuisance, less)
        indispensable = now.cost + thresholds.INDISPENSABLE_GAIN
        step = self._fit(less, nuisance, now.found, aim=min(aim, indispensable), most=REMOVAL_ITERATIONS)
        if step is not None and step.found.message == NOT_CONVERGED and step.cost < indispensable:
            step = self._fit(step.found.model, step.found.nuisance, step.found, aim=aim)
        self.remember(step)

    def refined(self, now: EffectChange) -> EffectChange:
        """The same fit, iterated to full convergence; as it is where the model cannot be followed from there."""
        found = now.found
        try:
            return EffectChange(self._refit(found.model, found.nuisance, found), now.begun)
        except (PredictionError, np.linalg.LinAlgError):
            return now

    def _refit(self, model: Model, nuisance, before: Fit, **options: Any) -> Fit:
        """Fit with the noise and the whitening of another fit."""
        return fit(
            self.problem, model, nuisance, before.noise, white=before.white, estimate_noise=False,
            **options,
        )  # fmt: skip

    def remember(self, step: EffectChange | None) -> EffectChange | None:
        """Record the step as the best with its effects if it is; returns the step."""
        if step is not None:
            key = effect_keys(step.found.model)
            self._best_fits[key] = min(step, self._best_fits.get(key, step), key=lambda each: each.cost)
        return step

    def _remember_converged(self, step: EffectChange | None) -> EffectChange | None:
        """The step, remembered if its fit has converged."""
        return self.remember(step) if step is not None and step.found.converged else step

    def _fit(
        self,
        model: Model,
        nuisance,
        before: Fit,
        *,
        aim: float = np.inf,
        enough: float = FIT_TOLERANCE,
        most: int = MAX_ITERATIONS,
    ) -> EffectChange | None:
        try:
            found = self._refit(model, nuisance, before, enough=enough, aim=aim, most=most)
        except (PredictionError, np.linalg.LinAlgError):
            return None
        step = EffectChange(found, self.count_begun(model))
        names, change = " + ".join(step.effects), step.cost - self.base.cost
        self.fit_records.append(FitRecord(names, change, variance_inflation(found, -1)))
        self.progress(Step(f"tried {names or 'nominal values'}: change of the misfit (-2 ln L) {change:+.1f}"))
        return step
