"""Laws under large drives, where a model without the law is in another motion: sought under smaller drives first.

Beside a spring that bends much the resonance has two stable motions, and the model without the law is in the wrong one:
it visits other inputs, and neither scores nor fits from there tell the place. Under small drives it is near enough.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from piezoharvest.description.parameters import ParameterError
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.discovery.forms.formulas import as_table, ranked
from piezoharvest.diagnose.discovery.forms.known import named
from piezoharvest.diagnose.discovery.law_fits import FIT_TOLERANCE, ITERATIONS, LawFit, best_of
from piezoharvest.diagnose.discovery.search import Found, can_search, search, with_its_noise
from piezoharvest.diagnose.discovery.visited import visited_inputs
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.output_error import excess_of, fit, mean_square
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.start_values.growing_drives import of_records, with_smaller_drives
from piezoharvest.predict.parameters import put, value_at
from piezoharvest.predict.prediction import PredictionError

ENOUGH = 10.0  # of -2 ln L: predicted decrease at which a fit that only gives start values ends


def search_growing(problem: Problem, start: Fit, progress: Callable[[str], None]) -> Found | None:
    """As `search`, from the records with smaller drives on; None where these show no law that the others have, too.

    It is tried where the misfit is large, and where no record is behind diodes or switches.

    Parameters
    ----------
    problem : Problem
    start : Fit
        Of the model without it.
    progress : callable
    """
    chosen = with_smaller_drives(problem)
    part = of_records(problem, chosen)
    if not chosen or mean_square(start) < thresholds.LARGE_MISFIT or problem.needs_engine or not can_search(part):
        return None
    less = _alone(part, start)
    if less is None or mean_square(less) < 1.0 + thresholds.MUCH_LEFT:
        return None
    progress(f"{', '.join(data.name for data in part.data)}: the drive is smaller, so that laws are sought there first")
    found = search_growing(part, less, progress) or search(part, less, progress)
    grown = None if found is None else _grown(_Growth(problem, start, chosen), found)
    if found is not None and grown is None:
        progress("that explains little of the records with larger drives")
    return grown


def _alone(part: Problem, start: Fit) -> Fit | None:
    """Fit of the same model to some of the records, from the nominal values; None where it has no solution."""
    model, transducer = start.model, start.model.transducer
    for parameter in model.parameters:
        if parameter.path[0] != "effects":
            transducer = put(transducer, parameter.path, value_at(part.nominal, parameter.path))
    try:
        return fit(part, replace(model, transducer=transducer), noise=start.noise, estimate_noise=False, enough=ENOUGH)
    except (PredictionError, np.linalg.LinAlgError):
        return None


@dataclass(frozen=True, eq=False)
class _Growth:
    """From laws that some records show to all records.

    Attributes
    ----------
    problem : Problem
    start : Fit
        Without a law.
    chosen : tuple of int
        Numbers of the records that show the laws.
    """

    problem: Problem
    start: Fit
    chosen: tuple[int, ...]

    def fitted(self, law: LawFit, aim: float = np.inf) -> LawFit | None:
        """Fit of all records with a law of some; None where the model has no solution."""
        model = law.found.model
        nuisance = list(self.problem.start(model))
        for k, own in zip(self.chosen, law.found.nuisance, strict=True):
            nuisance[k] = own
        try:
            found = fit(
                self.problem, model, nuisance, self.start.noise, white=self.start.white, estimate_noise=False,
                enough=FIT_TOLERANCE, most=ITERATIONS, aim=aim,
            )  # fmt: skip
        except (PredictionError, ParameterError, np.linalg.LinAlgError):
            return None
        visited = visited_inputs(self.problem, found)[law.place.input] if law.law.memory is None else law.visited
        return LawFit(found, visited)


def _grown(growth: _Growth, found: Found) -> Found | None:
    """What some of the records show, fitted to all; None where it explains little of these."""
    problem, start = growth.problem, growth.start
    best = growth.fitted(found.best)
    if best is None or excess_of(best.found) > (1.0 - thresholds.MIN_LAW_GAIN) * excess_of(start):
        return None
    table = best if best.law.memory is not None else as_table(problem, best)
    if table is None:
        return None
    forms = ranked(problem, table) if table is not best else [best]
    aim = table.evidence + thresholds.CLOSE_COST
    rivals = [growth.fitted(each, aim) for each in found.rivals]
    best = with_its_noise(problem, forms[0])
    return replace(
        found, best=best, table=table, rivals=tuple(best_of([each for each in rivals if each is not None])),
        start=start, forms=tuple(forms), known=named(problem, best),
    )  # fmt: skip
