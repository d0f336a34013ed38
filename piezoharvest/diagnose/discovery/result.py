"""A law that was found: its place, its formula in words, its curve with its band, and what else it might be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from piezoharvest.description.effects.nameless.forms import Form, Knee, Monomial, Power
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.shapes import Shape
from piezoharvest.diagnose.discovery.law_fits import LawFit, derivative, inputs_and_values
from piezoharvest.identify.fitting.output_error import covariance
from piezoharvest.predict.parameters import value_at

CURVE_POINTS = 61
SYMBOLS = {
    "force": "F", "displacement": "x", "velocity": "x'", "displacement_rate": "x'", "voltage": "v", "current": "i",
    "base_acceleration": "a", "force_rate": "F'", "base_acceleration_rate": "a'", "time": "t",
}  # fmt: skip


@dataclass(frozen=True)
class Rival:
    """Another place with the law that it would need, and the logarithm of its odds against the best."""

    place: str
    input: str
    form: str
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
        The curve over the visited range in SI units, and its standard error; time is a share of each record.
    gain : float
        Share of the validation error above the noise that it removes.
    p_value : float
        Of adding it, corrected for the number of places tried.
    rivals : tuple of Rival
        The likeliest first.
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

    @property
    def visited(self) -> tuple[float, float]:
        """Lowest and highest input of the records."""
        return float(self.input[0]), float(self.input[-1])

    @property
    def place(self) -> str:
        """Name of the place."""
        return self.law.place.name


def discovery(best: LawFit, gain: float, p_value: float, rivals: tuple[Rival, ...]) -> Discovery:
    """Result of a fit of a law."""
    scatter = covariance(best.found)[np.ix_(best.own, best.own)]
    x, value = inputs_and_values(best, CURVE_POINTS)
    slopes = derivative(best, x)
    std = np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", slopes, scatter, slopes), 0.0))
    values = _values(best, np.sqrt(np.maximum(np.diag(scatter), 0.0)))
    return Discovery(best.law, formula(best.law), best.form.word, values, x, value, std, gain, p_value, rivals)


def _values(best: LawFit, std: np.ndarray) -> dict[str, tuple[float, float | None, str]]:
    """Values of the law's parameters with standard errors, in SI units; none for a table, whose curve says all."""
    found: dict[str, tuple[float, float | None, str]] = {}
    form, place = best.form, best.law.place
    if not isinstance(form, Knee | Power | Monomial | Shape):
        return found
    for k, error in zip(best.own, std, strict=True):
        parameter = best.found.model.parameters[k]
        value = float(np.real(value_at(best.found.model.transducer, parameter.path)))
        slope = parameter.slope(parameter.inner(value))
        found[str(parameter.path[-1])] = value, float(slope * error), _unit(form, str(parameter.path[-1]), place)
    return _in_si(form, place, found)


def _unit(form: Form, name: str, place: Any) -> str:
    if name == "exponent":
        return ""
    return place.unit if name == "factor" else place.input_unit


def _in_si(form: Form, place: Any, found: dict[str, Any]) -> dict[str, tuple[float, float | None, str]]:
    """The factor of powers as it stands before |x|^n, and that of a knee as a slope."""
    value, std, _ = found["factor"]
    if isinstance(form, Knee):
        found["factor"] = value, std, _per(place.unit, place.input_unit)
        found = {"slope": found.pop("factor"), **found}
    elif isinstance(form, Monomial):
        size = form.scale**form.exponent
        found = {"factor": (value / size, std / size, _per(place.unit, place.input_unit, form.exponent))}
    elif isinstance(form, Power):
        # At the reference input, where factor and exponent are told apart.
        found["reference"] = form.scale, None, place.input_unit
    return found


def _per(unit: str, other: str, power: int = 1) -> str:
    if not other:
        return unit
    below = f"({other})" if "/" in other else other
    return f"{unit or '1'}/{below}" + (f"^{power}" if power != 1 else "")


def formula(law: Law) -> str:
    """The law as a formula with units."""
    form, place = law.form, law.place
    s, unit, of = SYMBOLS.get(place.input, place.input), place.unit, place.input_unit
    if isinstance(form, Knee):
        name, sign = _per(unit, of), "-" if form.knee >= 0 else "+"
        inside = f"{s} {sign} {abs(form.knee):.4g} {of}".rstrip()
        side = {2: ", odd", 1: "", -1: ", below"}[form.sides]
        return f"{form.factor:.4g} {name} * hinge({inside}){side}"
    if isinstance(form, Monomial):
        return f"{form.factor / form.scale**form.exponent:.4g} {_per(unit, of, form.exponent)} * {s}^{form.exponent}"
    if isinstance(form, Power):
        sign = f" * sign({s})" if form.odd else ""
        return f"{form.factor:.4g} {unit} * |{s} / {form.scale:.4g} {of}|^{form.exponent:.4g}{sign}"
    if isinstance(form, Shape):
        inside, words = f"{s} / {form.scale:.4g} {of}".rstrip(), {"exponential": "exp"}
        less = (" - 1" if form.curve == "exponential" else "") + (f" - {inside}" if form.bent else "")
        return f"{form.factor:.4g} {unit} * ({words.get(form.curve, form.curve)}({inside}){less})"
    return f"table of {s} ({of or 'share of a record'}) to {unit or 'a relative change'}"


def as_json(found: Discovery) -> dict[str, Any]:
    """The entry of `diagnose --json`."""
    return {
        "place": found.place, "input": found.law.place.input, "memory": None, "formula": found.formula,
        "form": found.form,
        "parameters": {n: {"value": v, "std": s, "unit": u} for n, (v, s, u) in found.parameters.items()},
        "curve": {"input": found.input.tolist(), "value": found.value.tolist(), "std": found.std.tolist()},
        "visited": list(found.visited), "gain": found.gain, "p_value": found.p_value,
        "rivals": [
            {"place": r.place, "input": r.input, "form": r.form, "log_odds": r.log_odds} for r in found.rivals
        ],
    }  # fmt: skip
