"""A law in words: its formula with units, and its values in SI units."""

from __future__ import annotations

import dataclasses
import re
from dataclasses import replace
from typing import Any

from piezoharvest.description.effects.nameless.circuit_places import SwitchLoop
from piezoharvest.description.effects.nameless.forms import (
    DeadZone,
    Form,
    Knee,
    Line,
    Monomial,
    Polynomial,
    Power,
    TwoKnees,
)
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import (
    Delay,
    LaggingFunction,
    LateBy,
    Memory,
    Play,
    Relaxation,
    Resonance,
)
from piezoharvest.description.effects.nameless.places import Place
from piezoharvest.description.effects.nameless.shapes import Bump, Coulomb, Shape, Shockley, StepChange, Stribeck

SYMBOLS = {
    "force": "F", "displacement": "x", "velocity": "x'", "displacement_rate": "x'", "voltage": "v", "current": "i",
    "base_acceleration": "a", "force_rate": "F'", "base_acceleration_rate": "a'", "time": "t", "amplitude": "A",
    "frequency": "f", "displacement_amplitude": "X", "campaign_time": "t", "diode_current": "i", "loop_current": "|i|",
    "dc_voltage": "v_dc",
}  # fmt: skip
PURE = ("exponent", "excess", "damping_ratio")  # values without a unit
ADDED = ("factor", "second")  # values in the unit of what a law adds
LEAST_SHOWN = 1e-4  # of a factor: a constant below it is left out, as formulas have four digits
Value = tuple[float, float | None, str]


def per(unit: str, other: str, power: int = 1) -> str:
    """Unit of a quotient."""
    if not other:
        return unit
    if unit == other and power == 1:
        return ""
    below = f"({other})" if "/" in other else other
    return f"{unit or '1'}/{below}" + (f"^{power}" if power != 1 else "")


def unit_of(name: str, component: Form | Memory, place: Place) -> str:
    """Unit of a fitted value of a form or memory."""
    declared = next(f.metadata.get("unit") for f in dataclasses.fields(component) if f.name == name)
    if declared or name in PURE:
        return declared or ""
    return place.unit if name in ADDED else place.input_unit


def in_si(form: Form, place: Place, found: dict[str, Value]) -> dict[str, Value]:
    """Factors as they stand in a formula: those of powers before x^n, that of a line or a knee as its slope."""
    if "factor" not in found:
        return found
    value, std, _ = found["factor"]
    if isinstance(form, Knee | Line | DeadZone):
        slope = value, std, per(place.unit, place.input_unit)
        return {"slope": slope, **{name: each for name, each in found.items() if name != "factor"}}
    if isinstance(form, TwoKnees):
        slopes = zip(("slope_above", "slope_below"), ADDED, strict=True)
        found = {**found, **{name: (*found[key][:2], per(place.unit, place.input_unit)) for name, key in slopes}}
        return {name: each for name, each in found.items() if name not in ADDED}
    if isinstance(form, Monomial):
        return {"factor": _scaled(found["factor"], form.scale, form.exponent, place)}
    if isinstance(form, Polynomial):
        names = (f"factor_{n}" for n in form.exponents)
        both = zip(names, ADDED, form.exponents, strict=True)
        return {name: _scaled(found[key], form.scale, n, place) for name, key, n in both}
    if isinstance(form, Power):
        # At the reference input, where factor and exponent are told apart.
        return {**found, "reference": (form.scale, None, place.input_unit)}
    return found


def _scaled(value: Value, scale: float, exponent: int, place: Place) -> Value:
    size = scale**exponent
    error = None if value[1] is None else value[1] / size
    return value[0] / size, error, per(place.unit, place.input_unit, exponent)


def memory_values(memory: Memory) -> dict[str, Any]:
    """Values of a memory by name."""
    return {f.name: getattr(memory, f.name) for f in dataclasses.fields(memory) if "unit" in f.metadata}


def formula(law: Law) -> str:
    """The law as a formula with units."""
    # What has no unit, as a relative change, leaves a gap in its place.
    return re.sub(r" +(?=[);]|$)", "", re.sub(" +", " ", _formula(law)))


def _formula(law: Law) -> str:
    """The formula, with a gap where a number has no unit."""
    form, place = law.form, law.place
    symbol = SYMBOLS.get(place.input, place.input)
    if isinstance(place, SwitchLoop) and isinstance(law.memory, Relaxation):
        return _part_in_loop(form.proportional, law.memory)
    s, unit, of = _remembered(law.memory, symbol, place), place.unit, place.input_unit
    if isinstance(law.memory, LaggingFunction):
        return f"lag({formula(replace(law, memory=None))}; {law.memory.time_constant:.4g} s)"
    if isinstance(law.memory, Delay):
        return f"{symbol}(t - {law.memory.delay:.4g} s) - {symbol}(t)"
    if isinstance(form, Line):
        since = f"({s} - {form.start:.4g} {of}".rstrip() + ")" if form.start else s
        return f"{form.factor:.5g} {per(unit, of)}".rstrip() + f" * {since}"
    if isinstance(form, DeadZone):
        return f"{form.factor:.4g} {per(unit, of)} * clip({s}, +-{form.zone:.4g} {of})"
    if isinstance(form, Knee):
        side = {2: ", odd", 1: "", -1: ", below"}[form.sides]
        return f"{form.factor:.4g} {per(unit, of)} * hinge({_ahead(s, form.knee, of)}){side}"
    if isinstance(form, TwoKnees):
        above, below = (f"{_ahead(s, knee, of)}" for knee in (form.upper, form.lower))
        slopes = [f"{slope:.4g} {per(unit, of)}" for slope in (form.factor, form.second)]
        return f"{slopes[0]} * max({above}, 0) + {slopes[1]} * min({below}, 0)"
    if isinstance(form, Monomial):
        return f"{form.factor / form.scale**form.exponent:.4g} {per(unit, of, form.exponent)} * {s}^{form.exponent}"
    if isinstance(form, Polynomial):
        terms = zip((form.factor, form.second), form.exponents, strict=True)
        return " + ".join(f"{a / form.scale**n:.4g} {per(unit, of, n)} * {s}^{n}" for a, n in terms)
    return _of_scale(form, s, unit, of)


def _part_in_loop(factor: float, memory: Relaxation) -> str:
    """Voltage over the current i of a resistance with what is beside it, of which the lag tells."""
    time = memory.time_constant
    if memory.behind:
        return f"{-factor:.5g} ohm * (i - lag(i; {time:.4g} s)), {-factor:.5g} ohm beside {-factor * time:.4g} H"
    return f"{factor:.5g} ohm * lag(i; {time:.4g} s), {factor:.5g} ohm beside {time / factor:.4g} F"


def _ahead(s: str, knee: float, of: str) -> str:
    """By how much an input is above a knee."""
    return f"{s} {'-' if knee >= 0 else '+'} {abs(knee):.4g} {of}".rstrip()


def _of_scale(form: Form, s: str, unit: str, of: str) -> str:
    """Formula of a form with an input of reference, or of a table."""
    if isinstance(form, Power):
        inside = f"{s} / {form.scale:.4g} {of}".rstrip()
        if form.side:
            where = f"where {s} {'>' if form.side > 0 else '<'} 0"
            return f"{form.factor:.4g} {unit} * |{inside}|^{form.exponent:.4g} {where}"
        return f"{form.factor:.4g} {unit} * |{inside}|^{form.exponent:.4g}" + (f" * sign({s})" if form.odd else "")
    if isinstance(form, Stribeck):
        return f"{form.factor:.4g} {unit} * (1 + {form.excess:.4g} exp(-({s} / {form.speed:.4g} {of})^2)) * sign({s})"
    if isinstance(form, Coulomb):
        return f"{form.factor:.4g} {unit} * sign({s})"
    if isinstance(form, StepChange):
        come = f"tanh(({s} - {form.at:.7g} {of}) / {form.width:.4g} {of}"
        return f"{form.factor:.4g} {unit} * ({come}) + {form.before:.4g}) / 2"
    if isinstance(form, Bump):
        before = f" - {form.before:.4g}" if form.before > LEAST_SHOWN else ""
        return f"{form.factor:.4g} {unit} * (exp(-(({_ahead(s, form.at, of)}) / {form.width:.4g} {of})^2){before})"
    if isinstance(form, Shockley):
        rest = f" + {form.resistance:.4g} ohm * {s}" if form.resistance else ""
        return f"{form.factor:.4g} {unit} * log(1 + {s} / {form.scale:.4g} {of})" + rest
    if isinstance(form, Shape):
        inside = f"{s} / {form.scale:.4g} {of}".rstrip()
        curve = {"exponential": f"exp({inside}) - 1", "log": f"log(1 + {inside})"}.get(
            form.curve, f"{form.curve}({inside})"
        )
        line = f" - {s} / {form.scale / form.left_out:.4g} {of}".rstrip() if form.left_out else ""
        return f"{form.factor:.4g} {unit} * ({curve}{line})"
    return f"table of {s} ({of or 'in the unit of the drive'}) to {unit or 'a relative change'}"


def _remembered(memory: Memory | None, symbol: str, place: Place) -> str:
    """What the law is a function of."""
    if isinstance(memory, Play):
        return f"{'play' if memory.follows else 'stop'}({symbol}; {memory.threshold:.5g} {place.input_unit})"
    if isinstance(memory, Relaxation):
        lagging = f"lag({symbol}; {memory.time_constant:.4g} s)"
        return f"({lagging} - {symbol})" if memory.behind else lagging
    if isinstance(memory, LateBy):
        ago = f"{symbol}(t - {memory.delay:.4g} s)"
        return ago if memory.whole else f"({ago} - {symbol}(t))"
    if isinstance(memory, Resonance):
        lagging = f"resonance({symbol}; {memory.frequency:.4g} Hz, damping {memory.damping_ratio:.3g})"
        return f"({lagging} - {symbol})" if memory.behind else lagging
    return symbol
