"""Selection of effects under large drives, where a model without them is in another motion: smaller ones first.

Beside a spring that bends much the resonance has two stable motions, and a linear model that is fitted to large ones is
far off in all its parameters: from there no score tells what is missing.
"""

from __future__ import annotations

import numpy as np

from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.selection.candidate_fits import FIT_TOLERANCE, CandidateFits
from piezoharvest.diagnose.selection.effect_change import EffectChange
from piezoharvest.diagnose.selection.stepwise_selection import Search, Searcher
from piezoharvest.identify.fitting.levenberg_marquardt import MAX_ITERATIONS
from piezoharvest.identify.fitting.output_error import fit, mean_square
from piezoharvest.identify.start_values.growing_drives import SmallerDrives
from piezoharvest.predict.prediction import PredictionError

# Iterations: without effects, the parameters that small drives show are no better for having been fitted to large ones.
KEPT_AS_THEY_ARE = 0


def select(trials: CandidateFits) -> Search:
    """Effects that are missing from a model; where much is left of a large misfit, from smaller drives on.

    Parameters
    ----------
    trials : CandidateFits
        From the fit without effects.
    """
    found = Searcher(trials).run()
    if not found.left or mean_square(found.final) < thresholds.LARGE_MISFIT or trials.problem.needs_engine:
        return found
    try:
        other = _from_smaller_drives(trials)
    except (PredictionError, np.linalg.LinAlgError):  # from there the model cannot follow the larger drives
        return found
    return other if other is not None and other.final.cost < found.final.cost else found


def _from_smaller_drives(trials: CandidateFits) -> Search | None:
    """The search for all records from what those with smaller drives show; None where they show no explanation."""
    base, smaller = trials.base, SmallerDrives.of(trials.problem)
    less = smaller and smaller.fitted(base.model, base.noise)
    if smaller is None or less is None:
        return None
    names = ", ".join(data.name for data in smaller.part.data)
    trials.progress(f"{names}: smaller drive, so effects are sought here first")
    shown = select(CandidateFits(smaller.part, less, trials.library, trials.progress, trials.held))
    if shown.left:  # what no effect explains there, none will where drives are larger
        return None
    begun = fit(
        trials.problem, shown.final.model, smaller.nuisance_of_all(shown.final), base.noise, white=base.white,
        estimate_noise=False, enough=FIT_TOLERANCE, most=MAX_ITERATIONS if shown.order else KEPT_AS_THEY_ARE,
    )  # fmt: skip
    return Searcher(trials).run(EffectChange(begun), shown.p_values)
