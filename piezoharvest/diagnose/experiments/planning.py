"""The planned record that separates two sets of effects best, or that shrinks a parameter's standard error most."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from piezoharvest.description.excitation import StepForce
from piezoharvest.description.parameters import ParameterError
from piezoharvest.diagnose.experiments.candidates import Planned, first_look, variants
from piezoharvest.diagnose.experiments.expectation import Bench, Known
from piezoharvest.diagnose.experiments.reach import reach_of
from piezoharvest.diagnose.experiments.studies import study_tables
from piezoharvest.diagnose.selection.effect_change import names_apart
from piezoharvest.diagnose.selection.score_tests import ScoredEffect, effect_parameters, extended
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.predict.parameters import Parameter, value_at
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.progress import Stage, follower
from piezoharvest.records.campaign import Campaign
from piezoharvest.study import unknown

# Of -2 ln L, ten standard deviations, and relative standard error: a record that gives as much is long enough, and the
# shortest of these is planned.
ENOUGH, WELL_KNOWN = 100.0, 0.01
REFINED = 3  # best records of the first look whose variants are looked at


@dataclass(frozen=True, eq=False)
class PlannedRecord:
    """A planned record and what it is expected to tell.

    Attributes
    ----------
    planned : Planned
    sets : tuple of tuple of str
        The two sets of effects that it tells apart; empty where it is for a parameter.
    separation : float
        Expected rise of -2 ln L of the wrong set; 0 for a parameter.
    parameter : str
        Empty where it is for sets.
    before, after : float
        Relative standard error of the parameter without and with the record.
    tables : mapping
        The study that `measure` runs.
    """

    planned: Planned
    sets: tuple[tuple[str, ...], ...]
    separation: float
    parameter: str
    before: float
    after: float
    tables: Mapping[str, Any]

    @property
    def sentence(self) -> str:
        """The record and what it would tell, in words."""
        return f"{described(self.planned)}: {self._worth}"

    @property
    def _worth(self) -> str:
        if self.parameter:
            return (
                f"the relative standard error of {self.parameter} would fall from {self.before:.2g} to {self.after:.2g}"
            )
        first, second = (" and ".join(names).replace("_", " ") or "no effect" for names in self.sets)
        size = f"{np.sqrt(self.separation):.2g} standard deviations"
        return f"the predictions with {first} and with {second} would differ by {size}"


def described(planned: Planned) -> str:
    """A planned record in words."""
    drive = planned.excitation
    unit = "m/s^2" if drive.base else "N"
    if isinstance(drive, StepForce):
        text = (
            f"a step from {drive.offset:.4g} to {drive.offset + drive.amplitude:.4g} N, held for {drive.duration:.3g} s"
        )
    else:
        size, middle = getattr(drive, "amplitude"), getattr(drive, "offset")  # noqa: B009  (a sine has both)
        about = f" about {middle:.4g} {unit}" if middle else ""
        text = f"a sine of {drive.frequency_hz:.4g} Hz and {size:.4g} {unit}{about}"
    load = getattr(planned.shunt, "resistance", None)
    circuit = _ohms(load) if load is not None and planned.shunt.kind == "resistor" else planned.shunt.kind
    span = f"{planned.duration:.3g} s long, sampled at {planned.sample_rate:.4g} Hz"
    return f"{text}, with {circuit.replace('_', ' ')}, {span}"


def _ohms(load: float) -> str:
    """A resistance with a prefix: "3.3 kohm"."""
    scale, prefix = next(((s, p) for s, p in ((1e6, "M"), (1e3, "k")) if load >= s), (1.0, ""))
    return f"{load / scale:.4g} {prefix}ohm"


class Planner:
    """Plans for one campaign.

    Parameters
    ----------
    campaign : Campaign
        With the nominal transducer as it was fitted.
    problem : Problem
        The records that were fitted.
    final : Fit
        Of the likeliest model.
    """

    def __init__(self, campaign: Campaign, problem: Problem, final: Fit) -> None:
        self.campaign, self.problem, self.final = campaign, problem, final
        reach = reach_of(campaign, [data for data in problem.data if isinstance(data, Data)])
        self.bench = reach and Bench(reach, problem.nominal, final.noise, problem.offset_channels)

    def for_sets(self, first: Fit, second: Fit) -> PlannedRecord | None:
        """The record that separates two fitted models best; None where no record within reach does."""
        return self._separating(Known.of(first), Known.of(second))

    def for_suspects(self, scored: Sequence[ScoredEffect]) -> PlannedRecord | None:
        """The record that separates the two effects best whose scores are highest, though none of them explains all."""
        known: dict[str, Known] = {}
        for candidate in sorted(scored, key=lambda each: each.p_value):
            if candidate.name in known:
                continue
            more = effect_parameters([candidate.effect], len(self.final.model.transducer.effects))
            model = extended(self.final.model, [candidate.effect], more)
            with suppress(PredictionError, np.linalg.LinAlgError):
                known[candidate.name] = Known.beyond(self.problem, self.final, model)
            if len(known) == 2:
                return self._separating(*known.values())
        return None

    def _separating(self, *models: Known) -> PlannedRecord | None:
        """The record that separates two models best."""
        if self.bench is None:
            return None
        bench = self.bench
        planned, worth = self._best(models, lambda p: bench.separation(p, models[0], models[1]), ENOUGH)
        if planned is None:
            return None
        first, second = (known.model.transducer.effects for known in models)
        sets = names_apart(first, second), names_apart(second, first)
        return PlannedRecord(planned, sets, worth, "", 0.0, 0.0, self._tables(planned))

    def for_parameter(self, parameter: Parameter) -> PlannedRecord | None:
        """The record that shrinks a parameter's standard error most; None where no record within reach does."""
        if self.bench is None:
            return None
        bench, paths = self.bench, [p.path for p in self.final.model.parameters]
        fitted = parameter.path in paths
        known = Known.of(self.final) if fitted else self._freed(parameter)
        k = [p.path for p in known.model.parameters].index(parameter.path)
        relative = self._relative(parameter)
        before = relative * float(known.errors()[k])

        def worth(planned: Planned) -> float:
            return (relative * float(known.errors(bench.information(planned, known))[k])) ** -2

        planned, best = self._best([known], worth, WELL_KNOWN**-2)
        if planned is None or not best > 1.01 * before**-2:  # by more than rounding
            return None
        return PlannedRecord(planned, (), 0.0, parameter.name, before, best**-0.5, self._tables(planned))

    def _freed(self, parameter: Parameter) -> Known:
        """The final model with one more free parameter."""
        model = self.final.model
        return Known.beyond(self.problem, self.final, replace(model, parameters=(*model.parameters, parameter)))

    def _relative(self, parameter: Parameter) -> float:
        """Relative change of a value for a unit of the fitted variable."""
        if parameter.scaling == "log":
            return 1.0
        value = float(np.real(value_at(self.final.model.transducer, parameter.path)))
        return abs(value) if parameter.scaling == "reciprocal" else 1.0 / max(abs(value), 1e-300)

    def _best(
        self, knowns: Sequence[Known], worth: Callable[[Planned], float], enough: float
    ) -> tuple[Planned | None, float]:
        """The shortest record that is worth enough, or else the one that is worth most; None if all are worthless."""
        assert self.bench is not None
        bench, models = self.bench, [known.model for known in knowns]
        looked = [bench.fitting(p, models) for p in first_look(bench.reach, models[0].transducer)]
        stage = Stage(follower(), "planning", "records")
        found = [(worth(p), n, p) for n, p in enumerate(stage.over(looked))]
        found.sort(reverse=True, key=lambda each: each[0])
        more = [bench.fitting(p, models) for _, _, base in found[:REFINED] for p in variants(bench.reach, base)]
        stage = Stage(follower(), "planning", "variants of the best records")
        found += [(worth(p), len(looked) + n, p) for n, p in enumerate(stage.over(more))]
        good = [each for each in found if each[0] >= enough]
        best = (
            min(good, key=lambda each: (each[2].duration, -each[0]))
            if good
            else max(found, key=lambda each: each[0], default=(0.0, 0, None))
        )
        return (best[2], best[0]) if best[0] > 0 else (None, 0.0)

    def _tables(self, planned: Planned) -> dict[str, Any]:
        assert self.bench is not None
        return study_tables(self.campaign, self.bench, planned, self.final.model.transducer)


def parameter_named(final: Fit, others: Sequence[Parameter], name: str) -> Parameter:
    """Parameter by its name: those of effects as "leakage.resistance".

    Raises
    ------
    ParameterError
        There is none of this name.
    """
    effects = final.model.transducer.effects
    known = {parameter.name: parameter for parameter in others}
    for parameter in final.model.parameters:
        if parameter.path[0] == "effects":
            known[f"{effects[int(parameter.path[1])].name}.{parameter.path[2]}"] = parameter
    if name not in known:
        wrong = unknown("--parameter", name, known)
        raise ParameterError(wrong.key, wrong.message)
    return known[name]
