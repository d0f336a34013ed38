"""Readable formulas for a law: fitted to its table first, then the best of them in its place in the model.

A formula is compared with a table on the table's own terms: the kinks that stand for it, with the covariance of those
that were found. Sources: Schwarz, Ann. Stat. 6(2), 461-464, 1978 (information criterion); the forms are those of
springs, contacts, diodes and friction.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from piezoharvest.description.effects.nameless.forms import Form, TwoKnees
from piezoharvest.description.effects.nameless.shapes import Shockley, StepChange
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.discovery.forms.closest import FittedFormula, closest
from piezoharvest.diagnose.discovery.forms.distance import (
    CurveDistance,
    Distance,
    drop_path,
    of_itself,
    recorded,
    spread_inputs,
)
from piezoharvest.diagnose.discovery.forms.families import STEP_WIDTH, families
from piezoharvest.diagnose.discovery.forms.moments import better_moment
from piezoharvest.diagnose.discovery.law_fits import OWN, TABLES, LawFit, fitted, without_law
from piezoharvest.diagnose.discovery.tables.knots import pieces_of, table_for
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.output_error import mean_square
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.predict.parameters import put, value_at
from piezoharvest.progress import Stage, follower

# Formulas, the closest to the table, that are fitted in the model; more where the table is too coarse for the curve, so
# that it leaves more than noise and closeness to it tells little.
REFITTED, REFITTED_BEYOND_TABLE = 3, 6
TABLE_IS_COARSE = 1.5  # mean square of whitened residuals with the table, beyond what noise scatters by
FARTHER = 4.0  # times as far from the table as the closest: a formula that is not fitted where a step is slow
SAME = 6  # decimals of a criterion: more are rounding
MOMENTS = 2  # times that a better moment is looked for from the last one


def candidates(table: LawFit, of_curve: Distance | None = None) -> list[FittedFormula]:
    """Formulas for a table, or for the curve of a formula, the best first; each from several starts."""
    distance = of_curve or Distance(table)
    found: list[FittedFormula] = []
    for some in families(table, distance):
        tried = [closest(distance, each) for each in (some if isinstance(some, tuple) else (some,))]
        done = [each for each in tried if each is not None]
        found += [min(done, key=lambda each: each.criterion)] if done else []
    return sorted(found, key=lambda each: round(each.criterion, SAME))  # of the same in other words the first


def ranked(problem: Problem, table: LawFit, most: int = 0, kind: type[Form] = Form) -> list[LawFit]:
    """The table and the formulas that stand for it with fewer parameters, fitted in the model, the likeliest first.

    At least `most` of the formulas closest to the table are fitted, and of them those of a kind.
    """
    tried = [table]
    coarse = mean_square(table.found) > TABLE_IS_COARSE
    count = REFITTED_BEYOND_TABLE if coarse and not problem.needs_engine else REFITTED
    count *= 2 if of_itself(table.place) else 1  # with and without its straight line a curve is as close to the table
    most = max(most, count)
    every = candidates(table) if isinstance(table.form, TABLES) else []
    most += any(isinstance(each.form, TwoKnees) for each in every[:most])  # it may be one knee
    # A table is too coarse to tell of a diode near no current, and of what happens at once.
    some = every[:most] + [each for each in every[most:] if isinstance(each.form, Shockley | StepChange)]
    some = [each for each in some if isinstance(each.form, kind)]
    in_order = sorted(some, key=lambda each: not isinstance(each.form, StepChange))
    for each in Stage(follower(), "trying formulas", "forms", most=True).over(in_order):
        own = isinstance(each.form, Shockley | StepChange)
        if problem.needs_engine and not own and each.criterion > FARTHER * some[0].criterion:
            continue
        # From a coarse table a formula begins far away, and how its fit goes on is not seen from its first steps.
        far = coarse and min(mean_square(one.found) for one in tried) > TABLE_IS_COARSE
        best = np.inf if far else min(one.criterion for one in tried) + thresholds.CLOSE_COST
        start, form = _begun(problem, table, each.form, Distance(table))
        found = fitted(problem, start, dataclasses.replace(table.law, form=form), table.visited, aim=best)
        if found is not None and isinstance(form, StepChange):
            found = _at_its_moment(problem, start, found)
        tried += [found] if found is not None and found.found.converged else []
    return sorted(tried, key=lambda each: each.criterion)


def _at_its_moment(problem: Problem, start: Fit, found: LawFit) -> LawFit:
    """The fit of a step at the best moment near it."""
    for _ in range(MOMENTS):
        better = better_moment(problem, found, STEP_WIDTH * recorded(found.visited)[0])
        law = better and dataclasses.replace(found.law, form=better)
        again = law and fitted(problem, start, law, found.visited)
        if again is None or not again.found.cost < found.found.cost:
            break
        found = again
    return found


def _begun(problem: Problem, table: LawFit, form: Form, distance: Distance) -> tuple[Fit, Form]:
    """The fit without its table, from which that of a formula begins near its end, and the formula to begin with.

    The parameter of the model is less by the straight line that a formula has, not the table. At a diode it is the
    constant drop, which is free beside a law there; Shockley's diode has none, but a lower saturation current.
    """
    bare, place = without_law(problem, table), table.place
    transducer = bare.model.transducer
    path = drop_path(transducer, place) if place.in_circuit else (OWN.get(place.name, ""),)
    if path not in {p.path for p in bare.model.parameters} or table.law.memory is not None:
        return bare, form
    value = value_at(transducer, path) - (distance.constant(form) if place.in_circuit else distance.line(form))
    free = bare.model.parameters
    if isinstance(form, Shockley):  # a drop beside it would be its saturation current in other words
        form, value = dataclasses.replace(form, scale=form.scale * np.exp(-value / form.factor)), 0.0
        free = tuple(p for p in free if p.path != path)
    elif not value > 0.0 and path != ("coupling",):
        return bare, form
    moved = dataclasses.replace(bare.model, transducer=put(transducer, path, value), parameters=free)
    return dataclasses.replace(bare, model=moved), form


def beside(problem: Problem, known: Sequence[LawFit], most: int = REFITTED_BEYOND_TABLE) -> list[LawFit]:
    """Further formulas that are near the curve of the likeliest of those known, fitted from where that is.

    A table that is coarse, or has not come to its end, has other parameters than a formula that fits better: from there
    the fit of the right one may begin too far away.
    """
    law = min(known, key=lambda each: each.criterion)
    if law.law.memory is not None or isinstance(law.form, TABLES):
        return []
    distance, kinds, found = CurveDistance(law), {_kind(each.form) for each in known}, list[LawFit]()
    for each in Stage(follower(), "trying formulas", "forms", most=True).over(candidates(law, distance)[:most]):
        if _kind(each.form) in kinds:
            continue
        start, form = _begun(problem, law, each.form, distance)
        again = fitted(problem, start, dataclasses.replace(law.law, form=form), law.visited)
        found += [again] if again is not None and again.found.converged else []
    return found


def _kind(form: Form) -> tuple[object, ...]:
    """What tells a formula from another but the values of its parameters."""
    fitted_too = {field.name for field in dataclasses.fields(form) if "unit" in field.metadata} | {"scale", "knots"}
    rest = (field.name for field in dataclasses.fields(form) if field.name not in fitted_too)
    return type(form), *(getattr(form, name) for name in rest)


def as_table(problem: Problem, law: LawFit) -> LawFit | None:
    """The fit with a table over all that the law has visited, begun where the law is; None where it has no solution."""
    form = table_for(law.place, law.visited, in_engine=problem.needs_engine)
    bare = without_law(problem, law)
    if form is None:
        return None
    x = spread_inputs(law)
    basis = np.column_stack([pieces_of(form, x), np.ones(len(x)), *[x] * law.law.bent])
    size = np.abs(basis).max(axis=0)
    found = np.linalg.lstsq(basis / size, np.real(law.form.values(x)), rcond=1e-10)[0] / size
    kinks, path = found[: len(form.kinks)], (OWN.get(law.place.name, ""),)
    if law.law.bent and path in {p.path for p in bare.model.parameters}:
        value = value_at(bare.model.transducer, path) + float(found[-1])
        if value > 0.0 or path == ("coupling",):
            moved = put(bare.model.transducer, path, value)
            bare = dataclasses.replace(bare, model=dataclasses.replace(bare.model, transducer=moved))
    begun = dataclasses.replace(law.law, form=dataclasses.replace(form, kinks=tuple(map(float, kinks))))
    return fitted(problem, bare, begun, law.visited, float(np.sqrt(np.mean(kinks**2))))
