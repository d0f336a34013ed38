"""Laws under large drives, where a model without the law is in another motion: sought under smaller drives first.

Beside a spring that bends much the resonance has two stable motions, and the model without the law is in the wrong one:
it visits other inputs, and neither scores nor fits from there tell the place. Under small drives it is near enough.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from piezoharvest.description.parameters import ParameterError
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.discovery.forms.formulas import as_table, beside, ranked
from piezoharvest.diagnose.discovery.forms.known import named
from piezoharvest.diagnose.discovery.law_fits import FIT_TOLERANCE, ITERATIONS, TABLES, LawFit, best_of, ended
from piezoharvest.diagnose.discovery.search import MIN_SCORE, Found, can_search, search, with_all_free, with_its_noise
from piezoharvest.diagnose.discovery.tables.visited import visited_inputs
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import excess_of, fit, mean_square
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.start_values.growing_drives import SmallerDrives
from piezoharvest.predict.parameters import Parameter
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.progress import Stage, follower

NEAR = 100.0  # of the lowest misfit: a fit that was stopped below that is continued to its end
ALIKE = 10  # formulas that are fitted where drives are small: where a law bends little, many are about the same


def search_growing(
    problem: Problem, start: Fit, progress: Callable[[str], None], given: Sequence[Parameter] = ()
) -> Found | None:
    """As `search`, from the records with smaller drives on; None where these show no law that the others have, too.

    It is tried where the misfit is large, and where no record is behind diodes or switches.

    Parameters
    ----------
    problem : Problem
    start : Fit
        Of the model without it.
    progress : callable
    given : sequence of Parameter
        Those that were held without a law are free with it.
    """
    smaller = SmallerDrives.of(problem)
    large = mean_square(start) > thresholds.LARGE_MISFIT
    if smaller is None or not large or problem.needs_engine or not can_search(smaller.part):
        return None
    part, less = smaller.part, smaller.fitted(start.model, start.noise)
    if less is None or mean_square(less) < 1.0 + thresholds.MUCH_LEFT:
        return None
    progress(f"{', '.join(data.name for data in part.data)}: smaller drive, so laws are sought here first")
    found = search_growing(part, less, progress, given) or search(part, less, progress)
    found = found and with_all_free(part, found, given)
    grown = None if found is None else _of_all(smaller, start, found)
    if found is not None and grown is None:
        progress("that explains little of the records with larger drives")
    return grown


def _of_all(smaller: SmallerDrives, start: Fit, found: Found) -> Found | None:
    """What some of the records show, fitted to all; None where it explains little of these."""
    problem, grow = smaller.problem, partial(_fitted, smaller, start)
    # None is given up: in another motion than the records' a fit may go on slowly for a while, and end well.
    forms = Stage(follower(), "trying formulas in all records", "forms").over(_close_forms(smaller.part, found))
    grown = [law for law in map(grow, forms) if law is not None]
    least = min((law.found.cost for law in grown), default=0.0)
    grown = [ended(problem, start, law) if law.found.cost < NEAR * least else law for law in grown]
    grown += beside(problem, grown) if grown else []  # where drives are small its scale says little of a curve
    first = min(grown, key=lambda each: each.criterion, default=None)
    if first is None or excess_of(first.found) > (1.0 - thresholds.MIN_LAW_GAIN) * excess_of(start):
        return None
    table = first if first.law.memory is not None else as_table(problem, first)
    if table is None:
        return None
    formulas = [each for each in grown if not isinstance(each.form, TABLES) and each.found.converged]
    if table.law.memory is None and not any(each.criterion < table.criterion for each in formulas):
        formulas = [each for each in ranked(problem, table) if each is not table]
    forms = sorted((table, *formulas), key=lambda each: each.criterion)
    rivals = [grow(each, table.evidence + thresholds.CLOSE_COST) for each in found.rivals]
    best = with_its_noise(problem, forms[0])
    return replace(
        found, best=best, table=table, rivals=tuple(best_of([each for each in rivals if each is not None])),
        start=start, forms=tuple(forms), known=named(problem, best),
    )  # fmt: skip


def _close_forms(part: Problem, found: Found) -> list[LawFit]:
    """Forms of a law that some of the records do not tell apart: others may."""
    forms = ranked(part, found.table, ALIKE) if found.table.law.memory is None else list(found.forms)
    forms += beside(part, forms, ALIKE)
    least = min(each.criterion for each in forms)
    return [each for each in forms if each.criterion < least + MIN_SCORE]


def _fitted(smaller: SmallerDrives, start: Fit, law: LawFit, aim: float = np.inf) -> LawFit | None:
    """Fit of all records with a law of some; None where the model has no solution, or not all have the law's input."""
    nuisance = smaller.nuisance_of_all(law.found)
    try:
        found = _fit(smaller.problem, start, law.found.model, nuisance, ITERATIONS, aim)
    except (PredictionError, ParameterError, np.linalg.LinAlgError):
        return None
    if law.law.memory is not None:
        return LawFit(found, law.visited)
    visited = visited_inputs(smaller.problem, found).get(law.place.input)
    return None if visited is None else LawFit(found, visited)


def _fit(
    problem: Problem, start: Fit, model: Model, nuisance: Sequence[np.ndarray], most: int, aim: float = np.inf
) -> Fit:
    """Fit with the noise and the whitening of that without a law."""
    return fit(
        problem, model, nuisance, start.noise, white=start.white, estimate_noise=False, enough=FIT_TOLERANCE,
        most=most, aim=aim,
    )  # fmt: skip
