"""Score tests: what every effect would explain if it were there, from one linearisation at its null.

Source: Rao, Linear Statistical Inference, 1973, section 6e (score test); Davies, Biometrika 74(1), 33-43, 1987
(parameters that exist only where the effect does).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from piezoharvest.description.effects import Effect, registered
from piezoharvest.diagnose.start_values import CampaignScales
from piezoharvest.identify.fitting.evaluation import whole
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import inverse, linearised
from piezoharvest.identify.fitting.problem import Problem, carried
from piezoharvest.predict.parameters import Parameter, parameter_of, put
from piezoharvest.predict.prediction import PredictionError


@dataclass(frozen=True)
class ScoredEffect:
    """An effect at one start, with what the linearisation says of it.

    Attributes
    ----------
    effect : Effect
        With the strength that the linearisation estimates.
    score : float
        By how much it would lower the sum of squares.
    freedom : int
        Numbers that it takes for that.
    signature : (s,) array
        Its information with all starts, parameters projected out, as a row: for cosines.
    place : int
        Its column in the signatures.
    """

    effect: Effect
    score: float
    freedom: int
    signature: np.ndarray
    place: int

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.effect.name

    @property
    def p_value(self) -> float:
        """Probability of such a score without the effect, for this start alone."""
        return float(chi2.sf(self.score, self.freedom))


def effect_parameters(effects: Sequence[Effect], first: int = 0) -> list[Parameter]:
    """What varies of effects; of a line the record's own numbers are its strength."""
    found = []
    for n, effect in enumerate(effects, first):
        for field in dataclasses.fields(effect):
            if "unit" not in field.metadata or getattr(effect, field.name) is None or field.default is None:
                continue
            if field.metadata.get("null") is not None and effect_line(effect):
                continue
            found.append(parameter_of(effect, field, ("effects", n, field.name)))
    return found


def effect_line(effect: Effect) -> bool:
    """Whether the effect is a line on a channel."""
    return type(effect).line is not Effect.line


def scores(
    problem: Problem, found: Fit, scene: CampaignScales, library: Sequence[type[Effect]] | None = None
) -> list[ScoredEffect]:
    """Scores of all effects that are not in the model, the highest first.

    Parameters
    ----------
    problem : Problem
    found : Fit
        Converged.
    scene : CampaignScales
    library : sequence of Effect classes, optional
        Default: all that are registered.
    """
    classes = list(registered().values()) if library is None else list(library)
    starts = [start for cls in classes for start in cls.starts(scene) if _new(start, found)]
    smooth = [start for start in starts if not np.isinf(_strength(start)) and type(start).span is Effect.span]
    jumpy = [start for start in starts if start not in smooth]
    return sorted([*_smooth(problem, found, smooth), *_tried(problem, found, jumpy)], key=lambda c: -c.score)


def _new(start: Effect, found: Fit) -> bool:
    """Whether the model does not have it yet: one of a kind, or one for each channel."""
    taken = {getattr(e, "channel", None) for e in found.model.transducer.effects if e.name == start.name}
    return getattr(start, "channel", None) not in taken


def _strength(start: Effect) -> float:
    return getattr(start, type(start).strength().name)


def extended(model: Model, effects: Sequence[Effect], parameters: Sequence[Parameter]) -> Model:
    """Model with more effects and what varies of them."""
    transducer = put(model.transducer, ("effects",), (*model.transducer.effects, *effects))
    return replace(model, transducer=transducer, parameters=(*model.parameters, *parameters))


def _smooth(problem: Problem, found: Fit, starts: Sequence[Effect]) -> list[ScoredEffect]:
    """Effects that grow smoothly from their null, all in one linearisation."""
    if not starts:
        return []
    first, base = len(found.model.transducer.effects), len(found.model.parameters)
    strengths: list[Parameter | None] = []
    for n, start in enumerate(starts, first):
        field = type(start).strength()
        strengths.append(None if effect_line(start) else parameter_of(start, field, ("effects", n, field.name)))
    model = extended(found.model, starts, [p for p in strengths if p is not None])
    own = carried(problem, found.model, found.own, model)
    information, gradient, _ = linearised(problem, model, own, found)
    columns = _columns(problem, model, starts, strengths, base, first)
    tested = sorted({k for some in columns for k in some})
    weight = information.copy()
    weight[:base, :base] += found.prior[:base, :base]
    # A range that no value comes to, say, has no information at all; what is at its limit stays there.
    away = np.abs(np.concatenate(own)) < problem.own_limits(model)
    free = (np.diag(weight) > 0.0) & np.pad(away, (len(weight) - len(away), 0), constant_values=True)
    rest = [k for k in range(len(weight)) if free[k] and k not in set(tested)]
    # Parameters of the fit projected out.
    gain = inverse(weight[np.ix_(rest, rest)]) @ information[np.ix_(rest, tested)]
    projected = information[np.ix_(tested, tested)] - information[np.ix_(tested, rest)] @ gain
    slope = gradient[tested] - gain.T @ gradient[rest]
    place = {k: n for n, k in enumerate(tested)}
    candidates = []
    for start, strength, mine in zip(starts, strengths, columns, strict=True):
        at = [place[k] for k in mine]
        block, right = projected[np.ix_(at, at)], slope[at]
        if np.any(np.diag(block) <= 1e-10 * np.diag(information)[mine]) or not at:
            continue  # the parameters of the fit do all that it could
        step = inverse(block) @ right
        score = float(right @ step)
        effect = start
        if strength is not None:
            value = float(np.real(strength.inner(_strength(start)))) + float(step[0])
            if not strength.lower <= value <= strength.upper:
                continue  # of the wrong sign
            effect = put(start, (type(start).strength().name,), float(np.real(strength.outer(value))))
        candidates.append(ScoredEffect(effect, score, len(at), projected[at[0]], at[0]))
    return candidates


def _columns(problem, model: Model, starts, strengths, base: int, first: int) -> list[list[int]]:
    """Columns of the information that belong to each start."""
    found: list[list[int]] = [[] for _ in starts]
    at = base
    for n, strength in enumerate(strengths):
        if strength is not None:
            found[n].append(at)
            at += 1
    for data in problem.data:
        if isinstance(data, FrequencyData):
            continue
        names = problem.own_names(model, data)
        # Lines stand last, in the order of their effects.
        lines = [n for n, e in enumerate(model.transducer.effects) for c in (*data.channels, data.drive) if e.line(c)]
        begin = at + len(names) - 2 * len(lines)
        for k, n in enumerate(lines):
            if n >= first:
                found[n - first] += [begin + 2 * k, begin + 2 * k + 1]
        at += len(names)
    return found


def _tried(problem: Problem, found: Fit, starts: Sequence[Effect]) -> list[ScoredEffect]:
    """Effects that begin with a jump: the cost with each as it stands, one step of all that was fitted taken.

    Without that step parameters that have taken the place of the effect would speak against it.
    """
    candidates = []
    _, before, cost = whole(found.model, found.own, found.sums)
    for start in starts:
        model = extended(found.model, [start], [])
        own = carried(problem, found.model, found.own, model)
        try:
            information, gradient, squares = linearised(problem, model, own, found)
        except PredictionError:  # no record tells of an effect with which there is no solution
            continue
        slope, weight = gradient - before, information + found.prior
        felt = np.diag(weight) > 0.0
        score = cost - squares + float(slope[felt] @ inverse(weight[np.ix_(felt, felt)]) @ slope[felt])
        if score > 0:
            candidates.append(ScoredEffect(start, score, 1, np.zeros(0), -1))
    return candidates


def cosine(first: ScoredEffect, second: ScoredEffect) -> float:
    """How alike the signatures of two candidates are, parameters projected out."""
    if first.place < 0 or second.place < 0 or len(first.signature) != len(second.signature):
        return 0.0
    size = np.sqrt(first.signature[first.place] * second.signature[second.place])
    return float(first.signature[second.place] / size) if size > 0 else 0.0


__all__ = ["ScoredEffect", "cosine", "effect_line", "effect_parameters", "extended", "scores"]
