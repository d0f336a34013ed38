"""Laws that are in no library, as functions of an input in units of its largest value; two are random expressions."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

Function = Callable[[np.ndarray], np.ndarray]
STRAIGHT = 0.3  # least share of an expression that is no straight line: less is hardly a law
DEPTH = 3  # of a random expression


class Drawn(NamedTuple):
    """A law of one trial.

    Attributes
    ----------
    of : callable
        Of the input over its largest value.
    form : str or None
        The word of `diagnose` for its formula; None where there is none, so that a table is right.
    exponent : float or None
        Of a power.
    text : str
    slack : float or None
        Of a backlash, the law with a memory: half its width, of the largest input.
    """

    of: Function
    form: str | None
    exponent: float | None
    text: str
    slack: float | None = None


def _knee(rng: np.random.Generator) -> Drawn:
    c = rng.uniform(0.4, 0.7)
    return Drawn(lambda z: np.sign(z) * np.maximum(np.abs(z) - c, 0.0), "knee", None, f"hinge(|z| - {c:.3f}) sign(z)")


def _one_sided_knee(rng: np.random.Generator) -> Drawn:
    c = rng.uniform(0.2, 0.6)
    return Drawn(lambda z: np.maximum(z - c, 0.0), "knee", None, f"hinge(z - {c:.3f})")


def _exponent(rng: np.random.Generator, low: float, high: float, step: int) -> float:
    """An exponent that is none of a polynomial, by 0.15 at least."""
    while True:
        n = float(rng.uniform(low, high))
        if all(abs(n - whole) > 0.15 for whole in range(step % 2 + 1, 6, step)):
            return n


def _power(rng: np.random.Generator) -> Drawn:
    n = _exponent(rng, 1.3, 3.6, 2)
    return Drawn(lambda z: np.sign(z) * np.abs(z) ** n, "power", n, f"|z|^{n:.3f} sign(z)")


def _even_power(rng: np.random.Generator) -> Drawn:
    n = _exponent(rng, 1.3, 2.8, 1)
    return Drawn(lambda z: np.abs(z) ** n, "power", n, f"|z|^{n:.3f}")


def _fifth(rng: np.random.Generator) -> Drawn:
    return Drawn(lambda z: z**5, "polynomial", 5.0, "z^5")


def _scaled(curve: Function, form: str, low: float, high: float, text: str) -> Callable[..., Drawn]:
    def drawn(rng: np.random.Generator) -> Drawn:
        s = rng.uniform(low, high)
        return Drawn(lambda z: curve(z / s), form, None, text.format(f"z / {s:.3f}"))

    return drawn


def _langevin(y: np.ndarray) -> np.ndarray:
    """Coth y - 1/y, by its series where the two cancel."""
    near = np.abs(y) < 1e-2
    far = np.where(near, 1.0, y)
    return np.where(near, y / 3.0 - y**3 / 45.0, 1.0 / np.tanh(far) - 1.0 / far)


def _backlash(rng: np.random.Generator) -> Drawn:
    r = rng.uniform(0.05, 0.2)
    return Drawn(lambda z: z, "play", None, f"play(z; {r:.3f})", r)


def _expression(rng: np.random.Generator) -> Drawn:
    """A random expression tree that is no straight line, zero at zero, at most one."""
    z = np.linspace(-1.0, 1.0, 201)
    while True:
        drawn = _through_zero(*_tree(rng, DEPTH), z)
        values = drawn.of(z)
        rest = values - np.polyval(np.polyfit(z, values, 1), z)
        if np.linalg.norm(rest) > STRAIGHT * np.linalg.norm(values):
            return drawn


def _through_zero(of: Function, text: str, z: np.ndarray) -> Drawn:
    zero = float(of(np.zeros(1))[0])
    size = float(np.abs(of(z) - zero).max()) or 1.0
    return Drawn(lambda x: (of(x) - zero) / size, None, None, text)


def _tree(rng: np.random.Generator, depth: int) -> tuple[Function, str]:
    if depth == 0:
        a, b = rng.uniform(0.5, 3.0), rng.uniform(-1.0, 1.0)
        return (lambda z: a * z + b), f"({a:.2f} z {b:+.2f})"
    name = str(rng.choice(("sin", "tanh", "exp", "square", "+", "*")))
    left, words = _tree(rng, depth - 1)
    if name in UNARY:
        return (lambda z: UNARY[name](left(z))), f"{name}{words}"
    right, others = _tree(rng, depth - 1)
    return (lambda z: BINARY[name](left(z), right(z))), f"({words} {name} {others})"


UNARY: dict[str, Function] = {
    "sin": np.sin, "tanh": np.tanh, "exp": lambda y: np.exp(np.clip(y, -5.0, 2.0)), "square": np.square,
}  # fmt: skip
BINARY = {"+": np.add, "*": np.multiply}
LAWS: dict[str, Callable[[np.random.Generator], Drawn]] = {
    "knee": _knee,
    "one_sided_knee": _one_sided_knee,
    "power": _power,
    "even_power": _even_power,
    "fifth": _fifth,
    "exponential": _scaled(lambda y: np.exp(y) - 1.0, "exponential", 0.3, 0.6, "exp({}) - 1"),
    "sinh": _scaled(np.sinh, "sinh", 0.25, 0.5, "sinh({})"),
    "tanh": _scaled(np.tanh, "tanh", 0.2, 0.5, "tanh({})"),
    "langevin": _scaled(_langevin, "langevin", 0.08, 0.2, "coth({0}) - 1/({0})"),
    "backlash": _backlash,
    "expression_1": _expression,
    "expression_2": _expression,
}
SHARP = ("knee", "one_sided_knee")  # with a corner, which has no slope
TWO_SIDED = ("even_power", "expression_1", "expression_2")  # would give energy at a port


def draw(name: str, rng: np.random.Generator, *, passive: bool) -> Drawn:
    """A law of a name; where it has to be `passive` with the sign of its input, elsewhere with a random sign."""
    drawn = LAWS[name](rng)
    if not passive:
        sign = float(rng.choice((-1.0, 1.0)))
        return drawn._replace(of=lambda z: sign * drawn.of(z))
    if name not in TWO_SIDED:
        return drawn
    of = drawn.of
    one_way = drawn._replace(form=None, exponent=None, text=f"|{drawn.text}| where z > 0")
    if name == "even_power":
        return one_way._replace(of=lambda z: np.where(z > 0.0, of(np.maximum(z, 0.0)), 0.0))
    return drawn._replace(of=lambda z: np.sign(z) * np.abs(of(z)), text=f"|{drawn.text}| sign(z)")
