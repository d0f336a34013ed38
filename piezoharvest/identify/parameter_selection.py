"""Parameters that the records determine; the others stay at their nominal values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from piezoharvest.description.transducer import Transducer
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import fit
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.identifiability import uncertain, undetermined
from piezoharvest.identify.start_values.multistart import ROUGH_TOLERANCE, tune_to_responses
from piezoharvest.predict.parameters import Parameter, put, value_at

MIN_CONTRADICTION = 25.0  # change of -2 ln L, five standard errors, by which records contradict a nominal value


class Selection(NamedTuple):
    """The last fit, its parameters fixed at nominal values, and those whose nominal values the records contradict."""

    last: Fit
    fixed: list[int]
    contradicted: list[int]


def select_parameters(
    problem: Problem, first: Fit, model: Model, nuisance: Sequence[np.ndarray], progress: Callable[[str], None]
) -> Selection:
    """Fit of the parameters that the records determine; others stay nominal unless the records contradict that."""

    def refitted(fixed: Sequence[int]) -> Fit:
        kept = tuple(p for k, p in enumerate(model.parameters) if k not in fixed)
        device = _with_nominal(model.transducer, problem.nominal, [model.parameters[k] for k in fixed])
        start = (
            tune_to_responses(problem, replace(model, transducer=device, parameters=kept), progress) if fixed else model
        )
        return fit(problem, start, nuisance, first.noise, progress=progress, rounds=1)

    fixed, contradicted = undetermined(first), list[int]()
    last = refitted(fixed)
    for k in list(fixed):
        if not _contradicts(last, first):
            break
        freed = refitted([other for other in fixed if other != k])
        if _contradicts(last, freed):
            fixed, last = [other for other in fixed if other != k], freed
            contradicted.append(k)
    places = {parameter.path: k for k, parameter in enumerate(model.parameters)}
    while True:
        doubts = [places[last.model.parameters[n].path] for n in uncertain(last)]
        doubt = next((k for k in doubts if k not in contradicted), None)
        if doubt is None:
            return Selection(last, fixed, contradicted)
        less = refitted([*fixed, doubt])
        if _contradicts(less, last):
            contradicted.append(doubt)
        else:
            fixed, last = [*fixed, doubt], less


def _contradicts(fewer: Fit, more: Fit) -> bool:
    """True if records contradict the values that the fit with fewer parameters keeps fixed."""
    return fewer.cost - more.cost > max(MIN_CONTRADICTION, ROUGH_TOLERANCE * more.cost)


def _with_nominal(transducer: Transducer, nominal: Transducer, parameters: Sequence[Parameter]) -> Transducer:
    for parameter in parameters:
        transducer = put(transducer, parameter.path, value_at(nominal, parameter.path))
    return transducer
