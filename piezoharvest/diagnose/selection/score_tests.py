"""Score tests: expected gain of every effect that is not in the model, from one linearisation at its null.

Source: Rao, Linear Statistical Inference, 1973, section 6e (score test); Davies, Biometrika 74(1), 33-43, 1987
(parameters that exist only where the effect does).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from piezoharvest.description.effects import Effect, registered
from piezoharvest.description.parameters import ParameterError
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.selection.start_values import CampaignScales
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.evaluation import total_information
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.model import Model, begun_effects
from piezoharvest.identify.fitting.output_error import excess_of, inverse, linearised
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_model, prior_of
from piezoharvest.predict.parameters import Parameter, parameter_of, put
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.progress import Stage, silent

WEAK = 1e-3  # of a strength: so little that nothing is beyond first order, and far above rounding errors
MAX_STRETCH = 4.0  # of a start value: farther off, what an effect changes goes with its square no longer


@dataclass(frozen=True)
class ScoredEffect:
    """An effect at one start value, with its score.

    Attributes
    ----------
    effect : Effect
        With the strength estimated by the linearisation.
    score : float
        Expected decrease of the sum of squares.
    degrees_of_freedom : int
        Degrees of freedom of the score.
    signature : (s,) array
        Row of the information between this and all other starts, parameters projected out: for cosines.
    column : int
        Column of this start in the signatures; -1 without one.
    begun : bool
        The effect's states do not begin at rest: records may begin while it is under way.
    """

    effect: Effect
    score: float
    degrees_of_freedom: int
    signature: np.ndarray
    column: int
    begun: bool = False

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.effect.name

    @property
    def p_value(self) -> float:
        """Probability of such a score without the effect, for this start alone."""
        return float(chi2.sf(self.score, self.degrees_of_freedom))


def effect_parameters(effects: Sequence[Effect], first: int = 0) -> list[Parameter]:
    """Free parameters of effects; the strength of a line is a nuisance parameter of each record.

    A strength that is scanned is no parameter: the records have no derivative with respect to it.
    """
    found = []
    for n, effect in enumerate(effects, first):
        for field in dataclasses.fields(effect):
            if "unit" not in field.metadata or getattr(effect, field.name) is None or field.default is None:
                continue
            if field.metadata.get("null") is not None and (is_line(effect) or effect.scanned):
                continue
            found.append(parameter_of(effect, field, ("effects", n, field.name)))
    return found


def is_line(effect: Effect) -> bool:
    """True if the effect is a spectral line on a channel."""
    return type(effect).line is not Effect.line


def scores(
    problem: Problem, found: Fit, scales: CampaignScales, library: Sequence[type[Effect]] | None = None,
    progress: Callable[[str], object] = silent,
) -> list[ScoredEffect]:  # fmt: skip
    """Score tests of all effects that are not in the model, the highest score first.

    Effects of circuits that no record has are left out, and those whose strength is scanned: they need a fit.

    Parameters
    ----------
    problem : Problem
    found : Fit
        Converged.
    scales : CampaignScales
    library : sequence of Effect classes, optional
        Default: all that are registered.
    progress : callable, optional
        Takes messages on how far long work is.
    """
    starts = [start for start in starts_of(scales, found, library) if not start.scanned]
    smooth = [start for start in starts if _grows(start)]
    quadratic = [start for start in starts if start.second_order]
    jumpy = [start for start in starts if start not in smooth and not start.second_order]
    candidates = [
        *_linearised_scores(problem, found, smooth),
        *_second_order_scores(problem, found, Stage(progress, "scoring by squares", "effects").over(quadratic)),
        *_one_step_scores(problem, found, Stage(progress, "scoring one by one", "effects").over(jumpy)),
    ]
    return sorted(candidates, key=lambda candidate: -candidate.score)


def starts_of(scales: CampaignScales, found: Fit, library: Sequence[type[Effect]] | None) -> list[Effect]:
    """Starts of all effects that the records can show and that the model does not have yet."""
    library = list(registered().values()) if library is None else library
    classes = [cls for cls in library if any(map(cls.acts_on, scales.shunts or (None,)))]
    classes = _one_name_for_a_law(classes, scales)
    return [start for cls in classes for start in _of_class(cls, scales) if _is_new(start, found)]


def _one_name_for_a_law(classes: list[type[Effect]], scales: CampaignScales) -> list[type[Effect]]:
    """Effects without those that are others of them in other quantities.

    No record could distinguish the two. The one of a circuit stands where every record is behind such a circuit.
    """
    names, left_out = {cls.name for cls in classes}, set[str]()
    for cls in classes:
        if cls.same_law in names:
            left_out.add(cls.same_law if all(map(cls.acts_on, scales.shunts)) else cls.name)
    return [cls for cls in classes if cls.name not in left_out]


def _of_class(cls: type[Effect], scales: CampaignScales) -> list[Effect]:
    """Starts of an effect; none where it needs a size, as of a displacement, that responses alone do not show."""
    try:
        return list(cls.starts(scales))
    except ParameterError:
        if np.isfinite(scales.displacement):
            raise
        return []


def _grows(start: Effect) -> bool:
    """True if an effect grows smoothly from its null value."""
    return not (np.isinf(_strength(start)) or type(start).span is not Effect.span or start.second_order)


def _is_new(start: Effect, found: Fit) -> bool:
    """True if the model does not have the effect yet: one of a kind, or one for each channel."""
    taken = {getattr(e, "channel", None) for e in found.model.transducer.effects if e.name == start.name}
    return getattr(start, "channel", None) not in taken


def _strength(start: Effect) -> float:
    return getattr(start, type(start).strength().name)


def weakened(effect: Effect) -> Effect | None:
    """An effect that is hardly there, whose records change with its strength as they do at its null.

    None where no derivative tells what it does: it sets in with a jump, changes nothing to first order, or is a line.
    """
    if is_line(effect) or effect.scanned or effect.second_order or type(effect).span is not Effect.span:
        return None
    field = type(effect).strength()
    strength = parameter_of(effect, field, ("effects", 0, field.name))
    null, value = (float(np.real(strength.inner(v))) for v in (field.metadata["null"], _strength(effect)))
    inner = null + WEAK * (value - null)
    return put(effect, (field.name,), float(np.real(strength.outer(inner)))) if np.isfinite(inner) else None


def extended(model: Model, effects: Sequence[Effect], parameters: Sequence[Parameter]) -> Model:
    """Model with additional effects and their free parameters."""
    transducer = put(model.transducer, ("effects",), (*model.transducer.effects, *effects))
    return replace(model, transducer=transducer, parameters=(*model.parameters, *parameters))


def _linearised_scores(problem: Problem, found: Fit, starts: Sequence[Effect]) -> list[ScoredEffect]:
    """Scores of effects that grow smoothly from their null, all in one linearisation."""
    if not starts:
        return []
    first, base = len(found.model.transducer.effects), len(found.model.parameters)
    strengths: list[Parameter | None] = []
    for n, start in enumerate(starts, first):
        field = type(start).strength()
        strengths.append(None if is_line(start) else parameter_of(start, field, ("effects", n, field.name)))
    model = replace(extended(found.model, starts, [p for p in strengths if p is not None]), felt=first, at_rest=False)
    nuisance = nuisance_for_model(problem, found.model, found.nuisance, model)
    information, gradient, _ = linearised(problem, model, nuisance, found)
    columns = _columns(problem, model, starts, strengths, base, first)
    begun = _begun_columns(problem, model)
    columns_at_start = [[k for k, effect in begun.items() if effect == n] for n in range(first, first + len(starts))]
    tested = sorted({k for some in (*columns, *columns_at_start) for k in some})
    idle = {k for k, effect in begun.items() if effect < first and found.model.at_rest}
    weight = information.copy()
    weight[:base, :base] += found.prior[:base, :base]
    # A range that no value reaches has no information; a parameter at its limit stays there.
    away = np.abs(np.concatenate(nuisance)) < problem.nuisance_limits(model)
    free = (np.diag(weight) > 0.0) & np.pad(away, (len(weight) - len(away), 0), constant_values=True)
    rest = [k for k in range(len(weight)) if free[k] and k not in idle.union(tested)]
    # Parameters of the fit projected out.
    gain = inverse(weight[np.ix_(rest, rest)]) @ information[np.ix_(rest, tested)]
    projected = information[np.ix_(tested, tested)] - information[np.ix_(tested, rest)] @ gain
    slope = gradient[tested] - gain.T @ gradient[rest]
    place, prior = {k: n for n, k in enumerate(tested)}, prior_of(problem, model)[1]
    excess = excess_of(found)
    candidates = []
    for start, strength, its, at_start in zip(starts, strengths, columns, columns_at_start, strict=True):
        at = [place[k] for k in its]
        if np.any(np.diag(projected)[at] <= 1e-10 * np.diag(information)[its]) or not at:
            continue  # the effect is in the span of the fitted parameters
        more = [place[k] for k in at_start]
        rest, under_way = (
            _scored(start, strength, projected, slope, places, np.concatenate([np.zeros(len(at)), prior[some]]))
            for places, some in ((at, []), (at + more, at_start))
        )
        least = 0.0 if rest is None else rest.score
        if under_way and more and starts_show(under_way.score - least, len(more), excess - least):
            candidates.append(replace(under_way, begun=True))
        elif rest is not None:
            candidates.append(rest)
    return candidates


def starts_show(gain: float, count: int, excess: float) -> bool:
    """True if initial states of effects explain significantly many squares, and most of those in excess of noise.

    Of much that the model lacks otherwise, free initial states take a part as any parameters do.
    """
    return gain > max(float(chi2.isf(thresholds.SEARCH_LEVEL, count)), thresholds.MIN_SHARE_OF_PRESENT * excess)


def _scored(
    start: Effect, strength: Parameter | None, projected: np.ndarray, slope: np.ndarray, at: list[int],
    prior: np.ndarray,
) -> ScoredEffect | None:  # fmt: skip
    """An effect with its score, from its columns of the projected information; None if its strength cannot be."""
    right, scatter = slope[at], inverse(projected[np.ix_(at, at)] + np.diag(prior))
    step, effect = scatter @ right, start
    if np.any(prior) and step[0] ** 2 < thresholds.MIN_STANDARD_ERRORS**2 * scatter[0, 0]:
        return None  # initial states alone, a decay as each record begins, are no effect
    if strength is not None:
        value = float(np.real(strength.inner(_strength(start)))) + float(step[0])
        if not strength.lower <= value <= strength.upper:
            return None
        effect = put(start, (type(start).strength().name,), float(np.real(strength.outer(value))))
    return ScoredEffect(effect, float(right @ step), len(at), projected[at[0]], at[0])


def _begun_columns(problem: Problem, model: Model) -> dict[int, int]:
    """Columns of the information matrix that are initial states of effects, and the index of the effect of each."""
    found, at = dict[int, int](), len(model.parameters)
    for data in problem.data:
        if isinstance(data, Data):
            first = at + len(data.setting.free)
            found |= dict(enumerate(begun_effects(model, data), first))
        at += len(problem.nuisance_names(model, data))
    return found


def _columns(problem, model: Model, starts, strengths, base: int, first: int) -> list[list[int]]:
    """Columns of the information matrix that belong to each start."""
    found: list[list[int]] = [[] for _ in starts]
    at = base
    for n, strength in enumerate(strengths):
        if strength is not None:
            found[n].append(at)
            at += 1
    for data in problem.data:
        if isinstance(data, FrequencyData):
            continue
        names = problem.nuisance_names(model, data)
        # Lines come last, in the order of their effects.
        lines = [n for n, e in enumerate(model.transducer.effects) for c in (*data.channels, data.drive) if e.line(c)]
        begin = at + len(names) - 2 * len(lines)
        for k, n in enumerate(lines):
            if n >= first:
                found[n - first] += [begin + 2 * k, begin + 2 * k + 1]
        at += len(names)
    return found


def _second_order_scores(problem: Problem, found: Fit, starts: Iterable[Effect]) -> list[ScoredEffect]:
    """Scores of effects that change nothing to first order at their null: from a linearisation at each start.

    What such an effect changes goes with the square of its strength s: its shape is that of the derivative at any s. So
    a step d from a start s leads to the square s^2 + 2 s d. The start is made as weak as what is in excess of noise:
    the sum of squares grows with the fourth power of s.
    """
    candidates, first, base = [], len(found.model.transducer.effects), len(found.model.parameters)
    _, before, cost = total_information(found.model, found.nuisance, found.sums)
    for start in starts:
        field = type(start).strength()
        try:
            bare = replace(extended(found.model, [start], []), parameters=())
            added = linearised(problem, bare, found.nuisance, found)[2] - cost
            weaker = min(1.0, max(excess_of(found), 1.0) / max(added, 1e-300)) ** 0.25
            start = put(start, (field.name,), weaker * _strength(start))
            model = extended(found.model, [start], [parameter_of(start, field, ("effects", first, field.name))])
            information, gradient, squares = linearised(problem, model, found.nuisance, found)
        except PredictionError:  # no solution with this effect
            continue
        slope, weight = gradient - np.insert(before, base, 0.0), information
        weight[:base, :base] += found.prior[:base, :base]
        weight[base + 1 :, base + 1 :] += found.prior[base:, base:]
        felt = np.diag(weight) > 0.0
        if not felt[base]:
            continue
        step = np.zeros(len(slope))
        step[felt] = inverse(weight[np.ix_(felt, felt)]) @ slope[felt]
        score, value = cost - squares + float(slope @ step), _strength(start)
        square = value**2 + 2.0 * value * step[base]
        if score > 0.0 and square > 0.0:
            strength = np.copysign(min(np.sqrt(square), MAX_STRETCH * abs(value)), value)
            candidates.append(ScoredEffect(put(start, (field.name,), float(strength)), score, 1, np.zeros(0), -1))
    return candidates


def _one_step_scores(problem: Problem, found: Fit, starts: Iterable[Effect]) -> list[ScoredEffect]:
    """Scores of effects that set in with a jump: decrease of the cost by each at its start, after one step of the fit.

    Without that step, parameters that compensate for the missing effect would count against it.
    """
    candidates = []
    _, before, cost = total_information(found.model, found.nuisance, found.sums)
    for start in starts:
        model = extended(found.model, [start], [])
        nuisance = nuisance_for_model(problem, found.model, found.nuisance, model)
        try:
            information, gradient, squares = linearised(problem, model, nuisance, found)
        except PredictionError:  # no solution with this effect
            continue
        slope, weight = gradient - before, information + found.prior
        felt = np.diag(weight) > 0.0
        score = cost - squares + float(slope[felt] @ inverse(weight[np.ix_(felt, felt)]) @ slope[felt])
        if score > 0:
            candidates.append(ScoredEffect(start, score, 1, np.zeros(0), -1))
    return candidates


def cosine(first: ScoredEffect, second: ScoredEffect) -> float:
    """Cosine of the angle between the signatures of two effects, parameters projected out."""
    if first.column < 0 or second.column < 0 or len(first.signature) != len(second.signature):
        return 0.0
    size = np.sqrt(first.signature[first.column] * second.signature[second.column])
    return float(first.signature[second.column] / size) if size > 0 else 0.0


__all__ = ["ScoredEffect", "cosine", "effect_parameters", "extended", "is_line", "scores", "starts_of", "weakened"]
