"""The effects that specimens of one kind share: sets that were found in any of them, fitted in all of them.

Each set is judged by the sum over specimens of -2 ln of the marginal likelihood (Laplace), with the whiteners of a
specimen kept, so that its costs can be compared. The prior of an effect's values is as wide as the effect is large in
the specimen that shows it: one that plainly has none of it is likelier without. A specimen that another set explains
far better counts with odds of a hundred to one against: it is of another kind, and does not decide for the others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.result import Diagnosis
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.model import Model, inner_values
from piezoharvest.identify.fitting.output_error import covariance, fit
from piezoharvest.identify.fitting.problem import nuisance_for_model
from piezoharvest.population.naming import kind_of
from piezoharvest.population.oddness import MIN_ODDS
from piezoharvest.population.pooling import names_of
from piezoharvest.predict.parameters import Parameter, is_of_circuit
from piezoharvest.predict.prediction import PredictionError

Form = frozenset[str]  # kinds of effects
PRICE_OF_ANOTHER = 2.0 * float(np.log(MIN_ODDS))  # of -2 ln L, for a specimen of another kind


@dataclass(frozen=True, eq=False)
class JointForm:
    """The set of effects that specimens share.

    Attributes
    ----------
    form : frozenset of str
        Kinds of its effects.
    fits : tuple of Fit
        Of each specimen with this set; with its own for one of another kind.
    apart : tuple of int
        Specimens of another kind: another set explains them far better.
    rivals : tuple of frozenset of str
        Other sets that are nearly as likely over all specimens.
    gain : float
        Decrease of -2 ln L over the specimens of the kind by the set.
    """

    form: Form
    fits: tuple[Fit, ...]
    apart: tuple[int, ...]
    rivals: tuple[Form, ...]
    gain: float


def joint_form(found: Sequence[Diagnosis], names: Sequence[str], progress: Callable[[str], None]) -> JointForm:
    """The set of effects that specimens share, from the diagnosis of each by itself."""
    donors = _candidates(found)
    fits = [_fits(each, donors, name, progress) for each, name in zip(found, names, strict=True)]
    costs = {form: np.array([_cost(mine[form], donor) for mine in fits]) for form, (_, donor) in donors.items()}
    least = np.min(list(costs.values()), axis=0) + PRICE_OF_ANOTHER
    totals = {form: float(np.minimum(cost, least).sum()) for form, cost in costs.items()}
    # Of two specimens that differ neither is the odd one: both stay, with a set that can follow both, and
    # the result says that they differ.
    possible = [form for form in donors if len(found) > 2 or np.all(np.isfinite(costs[form]))]
    best = min(possible, key=lambda form: (totals[form], len(form)))
    apart = tuple(np.flatnonzero(costs[best] > least).tolist()) if len(found) > 2 else ()
    chosen = [
        mine[_own_form(each) if n in apart else best] for n, (mine, each) in enumerate(zip(fits, found, strict=True))
    ]
    rivals = [
        f for f in possible if f != best and len(f) == len(best) and totals[f] < totals[best] + thresholds.CLOSE_COST
    ]
    kept = [fit for fit in chosen if fit is not None]
    kind = [n for n in range(len(found)) if n not in apart]
    gain = sum(_plain(fits[n][frozenset()]) - kept[n].cost for n in kind)
    return JointForm(best, tuple(kept), apart, tuple(rivals), gain)


def _own_form(found: Diagnosis) -> Form:
    return frozenset(kind_of(effect) for effect in _effects(found, found.search.final))


def _effects(found: Diagnosis, step: Fit):
    """Effects of a fit beside those that the campaign names."""
    return step.model.transducer.effects[found.search.given_effects :]


def _candidates(found: Sequence[Diagnosis]) -> dict[Form, tuple[Diagnosis, Fit]]:
    """Sets of effects that were found in any specimen or are as likely there, none, with a fit that has each."""
    donors: dict[Form, tuple[Diagnosis, Fit]] = {frozenset(): (found[0], found[0].search.base)}
    for each in found:
        rivals = (step.found for step, _ in each.search.alternatives)
        for step in (each.search.final, *rivals):
            donors.setdefault(frozenset(kind_of(effect) for effect in _effects(each, step)), (each, step))
    return donors


def _fits(
    found: Diagnosis, donors: dict[Form, tuple[Diagnosis, Fit]], name: str, progress: Callable[[str], None]
) -> dict[Form, Fit | None]:
    """Fits of a specimen with each set; None where its records cannot be followed with one."""
    own = [found.search.base, found.search.final, *(step.found for step, _ in found.search.alternatives)]
    known: dict[Form, Fit | None] = {}
    for step in own:
        known.setdefault(frozenset(kind_of(effect) for effect in _effects(found, step)), step)
    for form, (donor, step) in donors.items():
        if form not in known:
            progress(f"{name}: with {' and '.join(sorted(form))}, which another specimen has")
            known[form] = _with_effects(found, donor, step)
    return known


def _with_effects(found: Diagnosis, donor: Diagnosis, step: Fit) -> Fit | None:
    """Fit of a specimen with the effects of another's, from its values with and without its own effects."""
    tried = [_from(found, start, donor, step) for start in (found.search.base, found.search.final)]
    return min((each for each in tried if each is not None), key=lambda each: each.cost, default=None)


def _from(found: Diagnosis, start: Fit, donor: Diagnosis, step: Fit) -> Fit | None:
    """Fit that begins at a specimen's own values, and for effects that it has not at those of another specimen."""
    given = found.search.given_effects
    mine = {kind_of(effect): effect for effect in _effects(found, start)}
    effects = [mine.get(kind_of(effect), effect) for effect in _effects(donor, step)]
    free = [p for p in start.model.parameters if p.path[0] != "effects" or int(p.path[1]) < given]
    more = [_moved(p, given - donor.search.given_effects) for p in step.model.parameters
            if p.path[0] == "effects" and int(p.path[1]) >= donor.search.given_effects]  # fmt: skip
    transducer = start.model.transducer
    transducer = replace(transducer, effects=(*transducer.effects[:given], *effects))
    model: Model = replace(start.model, transducer=transducer, parameters=(*free, *more))
    nuisance = nuisance_for_model(found.problem, start.model, start.nuisance, model)
    try:
        return fit(found.problem, model, nuisance, start.noise, white=start.white, estimate_noise=False)
    except (PredictionError, np.linalg.LinAlgError):
        return None


def _moved(parameter: Parameter, by: int) -> Parameter:
    """Parameter of an effect that stands at another place."""
    return replace(parameter, path=("effects", int(parameter.path[1]) + by, *parameter.path[2:]))


def _cost(step: Fit | None, donor: Fit) -> float:
    """-2 ln of the marginal likelihood of a specimen's records with the effects of a fit, up to a constant."""
    if step is None:
        return np.inf
    sizes = dict(zip(names_of(donor), _sizes(donor), strict=True))
    pairs = [(k, sizes[name]) for k, name in enumerate(names_of(step)) if name in sizes and _is_of_effect(step, k)]
    places, widths = [k for k, _ in pairs], np.array([size for _, size in pairs])
    scatter = covariance(step)[np.ix_(places, places)] / np.outer(widths, widths)
    # What records do not tell of a value costs nothing; a value that has no derivative costs as much as Akaike takes.
    spared = np.log(np.minimum(np.linalg.eigvalsh(scatter), 1.0)).sum() if places else 0.0
    scanned = sum(effect.scanned for effect in step.model.transducer.effects)
    return step.cost - float(spared) + 2.0 * scanned


def _is_of_effect(step: Fit, k: int) -> bool:
    parameter = step.model.parameters[k]
    return parameter.path[0] == "effects" and not is_of_circuit(parameter)


def _sizes(donor: Fit) -> list[float]:
    """Width of the prior of each parameter as that of an effect: its size, or a factor of e."""
    values = zip(donor.model.parameters, inner_values(donor.model), strict=True)
    return [1.0 if p.scaling == "log" else abs(float(value)) or 1.0 for p, value in values]


def _plain(step: Fit | None) -> float:
    return np.inf if step is None else step.cost
