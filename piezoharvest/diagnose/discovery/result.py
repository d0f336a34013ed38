"""A law that was found: its place, its formula in words, its curve with its band, and what else it might be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import Play
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.discovery.forms.wording import Value, formula, in_si, memory_values, unit_of
from piezoharvest.diagnose.discovery.law_fits import TABLES, LawFit, derivative, inputs_and_values
from piezoharvest.identify.fitting.output_error import covariance
from piezoharvest.predict.parameters import value_at

CURVE_POINTS = 61


@dataclass(frozen=True)
class Rival:
    """Another place with the law that it would need, and the logarithm of its odds against the best."""

    place: str
    input: str
    form: str
    log_odds: float


@dataclass(frozen=True)
class Alike:
    """Another form of a law at its place, and the logarithm of its odds against the best."""

    form: str
    formula: str
    log_odds: float


@dataclass(frozen=True, eq=False)
class Discovery:
    """A law without a name.

    Attributes
    ----------
    law : Law
        With its fitted values.
    formula : str
    form : str
    parameters : mapping of str to (value, std, unit)
    input, value, std : (n,) array
        The curve over the visited range in SI units, and its standard error; time is that since a record began.
    gain : float
        Share of the validation error above the noise that it removes.
    p_value : float
        Of adding it, corrected for the number of places tried.
    rivals : tuple of Rival
        The likeliest first.
    forms : tuple of Alike
        Other forms at this place that the records do not tell from this one, the table among them.
    """

    law: Law
    formula: str
    form: str
    parameters: dict[str, tuple[float, float | None, str]]
    input: np.ndarray
    value: np.ndarray
    std: np.ndarray
    gain: float
    p_value: float
    rivals: tuple[Rival, ...]
    forms: tuple[Alike, ...] = ()

    @property
    def visited(self) -> tuple[float, float]:
        """Lowest and highest input of the records."""
        return float(self.input[0]), float(self.input[-1])

    @property
    def place(self) -> str:
        """Name of the place."""
        return self.law.place.name


def discovery(
    best: LawFit, gain: float, p_value: float, rivals: tuple[Rival, ...], forms: Sequence[LawFit] = ()
) -> Discovery:
    """Result of a fit of a law; `forms` are those that were fitted at its place, the likeliest first."""
    scatter = covariance(best.found)[np.ix_(best.own, best.own)]
    x, value = inputs_and_values(best, CURVE_POINTS)
    slopes = derivative(best, x)
    std = np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", slopes, scatter, slopes), 0.0) + _spread(forms, x))
    values = _values(best, np.sqrt(np.maximum(np.diag(scatter), 0.0)))
    return Discovery(
        best.law, formula(best.law), best.form.word, values, x, value, std, gain, p_value, rivals, _alike(forms)
    )


def _spread(forms: Sequence[LawFit], x: np.ndarray) -> np.ndarray:
    """Variance of a law by the choice of its form: that of all forms about the first, by their odds.

    Source: Hoeting, Madigan, Raftery & Volinsky, Stat. Sci. 14(4), 382-401, 1999 (model averaging).
    """
    if len(forms) < 2:
        return np.zeros(len(x))
    odds = np.exp(-0.5 * np.array([each.criterion - forms[0].criterion for each in forms]))
    curves = np.array([np.real(each.form.values(x)) for each in forms])
    return odds / odds.sum() @ (curves - curves[0]) ** 2


def _alike(forms: Sequence[LawFit]) -> tuple[Alike, ...]:
    """Forms that the records do not tell from the first one."""
    odds = ((each, 0.5 * (forms[0].criterion - each.criterion)) for each in forms[1:])
    close = [(each, chance) for each, chance in odds if chance > -thresholds.MIN_LOG_ODDS]
    return tuple(Alike(each.form.word, formula(each.law), float(chance)) for each, chance in close)


def _values(best: LawFit, std: np.ndarray) -> dict[str, Value]:
    """Values of the law's parameters with standard errors, in SI units; none for a table, whose curve says all."""
    found: dict[str, Value] = {}
    form, law = best.form, best.law
    if isinstance(form, TABLES):
        return found
    for k, error in zip(best.own, std, strict=True):
        parameter = best.found.model.parameters[k]
        name, part = str(parameter.path[-1]), law.memory if parameter.path[2] == "memory" else form
        assert part is not None
        value = float(np.real(value_at(best.found.model.transducer, parameter.path)))
        slope = parameter.slope(parameter.inner(value))
        found[name] = value, float(slope * error), unit_of(name, part, law.place)
    return in_si(form, law.place, found)


def _memory_json(law: Law) -> dict[str, Any] | None:
    """Kind of a law's memory, and its values in SI units; whether the law is one of what follows with play."""
    if law.memory is None:
        return None
    follows = {"follows": True} if isinstance(law.memory, Play) and law.memory.follows else {}
    values = {name: float(value) for name, value in memory_values(law.memory).items()}
    return {"kind": law.memory.kind, **values, **follows}


def as_json(found: Discovery) -> dict[str, Any]:
    """The entry of `diagnose --json`."""
    return {
        "place": found.place, "input": found.law.place.input, "memory": _memory_json(found.law),
        "formula": found.formula, "form": found.form,
        "parameters": {n: {"value": v, "std": s, "unit": u} for n, (v, s, u) in found.parameters.items()},
        "curve": {"input": found.input.tolist(), "value": found.value.tolist(), "std": found.std.tolist()},
        "visited": list(found.visited), "gain": found.gain, "p_value": found.p_value,
        "rivals": [
            {"place": r.place, "input": r.input, "form": r.form, "log_odds": r.log_odds} for r in found.rivals
        ],
        "forms": [{"form": f.form, "formula": f.formula, "log_odds": f.log_odds} for f in found.forms],
    }  # fmt: skip
