"""Equations of a specimen with laws at places, written down here and integrated by SciPy, without the package.

    m x'' + b x' + k x = F + (T + c'(x)) v - s(x) - d(x') - k p_k(t) x - b p_b(t) x'
    (C + a'(v)) v' = -(T + c'(x)) x' - v / R - l(v) - e(v)          i = v / R + l(v)

with laws s (spring), d (damper), c (coupling), a (capacitor), l (load), e (electrodes), p (parameters over time).
A sensor then shows its true channel plus a law of one of the true channels. LSODA (backward differences) where the
structure is stiff, else DOP853: Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I and II.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

Law = Callable[[Any], Any]
RTOL, ATOL = 1e-9, (1e-14, 1e-10, 1e-9)  # m, m/s, V: far below the noise of the sensors
SLOPE_STEP = 1e-6  # of the largest input, for the slope of a law


def nothing(x: Any) -> Any:
    """The law of a healthy specimen."""
    return 0.0 * x


@dataclass(frozen=True)
class Drive:
    """Sum of sines and an offset, N."""

    amplitudes: tuple[float, ...]
    frequencies: tuple[float, ...]
    offset: float = 0.0

    def __call__(self, t: Any) -> Any:
        terms = (a * np.sin(2 * np.pi * f * t) for a, f in zip(self.amplitudes, self.frequencies, strict=True))
        return self.offset + sum(terms)

    def at_once(self) -> Callable[[float], float]:
        """The same for one time, quickly."""
        parts = [(a, 2 * math.pi * f) for a, f in zip(self.amplitudes, self.frequencies, strict=True)]
        return lambda t: self.offset + sum(a * math.sin(w * t) for a, w in parts)

    def rate(self, t: Any) -> Any:
        """N/s."""
        terms = (
            2 * np.pi * f * a * np.cos(2 * np.pi * f * t)
            for a, f in zip(self.amplitudes, self.frequencies, strict=True)
        )
        return sum(terms)


@dataclass(frozen=True)
class Reading:
    """What a sensor shows beside its true channel: a law of another one, after a backlash of half its width."""

    channel: str
    of: str
    law: Law
    slack: float = 0.0

    def added(self, true: Mapping[str, np.ndarray]) -> np.ndarray:
        """What it adds to a channel."""
        x = true[self.of]
        return self.law(x) if not self.slack else self.law(play(x, self.slack) - x)


def play(x: np.ndarray, slack: float) -> np.ndarray:
    """Backlash: follows an input at a distance of `slack` (Visintin, Differential Models of Hysteresis, 1994)."""
    y = np.empty_like(x)
    last = x[0]
    for n, value in enumerate(x):
        last = min(max(last, value - slack), value + slack)
        y[n] = last
    return y


@dataclass(frozen=True)
class Specimen:
    """Lumped parameters (kg, N s/m, N/m, N/V, F) and what is added to them; `slopes` of capacitor and coupling.

    `laws` are functions of x, x', v or the time in s since the record began, by the name of the place; `product` is a
    force of x and x' together.
    """

    mass: float
    damping: float
    stiffness: float
    coupling: float
    capacitance: float
    laws: Mapping[str, Law] = field(default_factory=dict)
    sizes: Mapping[str, float] = field(default_factory=dict)
    readings: tuple[Any, ...] = ()  # `Reading`, or what else has a channel and `added`
    product: Callable[[Any, Any], Any] | None = None
    load_error: float = 0.0

    def slope(self, place: str) -> Law:
        """Derivative of a law, by differences."""
        law, step = self.laws.get(place), SLOPE_STEP * self.sizes.get(place, 1.0)
        return nothing if law is None else lambda x: (law(x + step) - law(x - step)) / (2 * step)


def true_channels(
    on: Specimen, drive: Drive, load: float, duration: float, rate: float, *, stiff: bool
) -> dict[str, np.ndarray]:
    """All channels of one record without the errors of sensors, from equilibrium under the offset of the drive."""
    get = lambda place: on.laws.get(place, nothing)  # noqa: E731
    spring, damper, conduct, drawn = get("spring"), get("damper"), get("load"), get("electrodes")
    k_change, b_change = get("parameter.stiffness"), get("parameter.damping")
    charge, coupled, leaving = on.slope("capacitor"), on.slope("coupling"), get("leaving")
    product, load = on.product or (lambda x, u: 0.0), load * (1.0 + on.load_error)

    pushed = drive.at_once()

    def slopes(t: float, y: np.ndarray) -> tuple[float, float, float]:
        x, u, v = float(y[0]), float(y[1]), float(y[2])
        coupling = on.coupling + coupled(x)
        force = pushed(t) + coupling * v - on.damping * (1 + b_change(t)) * u - spring(x) - damper(u)
        force -= on.stiffness * (1 + k_change(t)) * x + product(x, u)
        out = v / load + conduct(v) + drawn(v) + leaving(v)
        return u, force / on.mass, -(out + coupling * u) / (on.capacitance + charge(v))

    t = np.arange(round(duration * rate)) / rate
    begin = drive(0.0) / on.stiffness
    for _ in range(50):
        begin = (drive(0.0) - spring(begin)) / (on.stiffness * (1 + k_change(0.0)))
    method = "LSODA" if stiff else "DOP853"
    run = solve_ivp(slopes, (0.0, t[-1]), [begin, 0.0, 0.0], method, t, rtol=RTOL, atol=ATOL)
    if not run.success:
        raise ArithmeticError(run.message)
    x, u, v = run.y
    return {
        "time": t, "force": drive(t), "force_rate": drive.rate(t), "displacement": x,
        "displacement_rate": u, "voltage": v, "current": v / load + conduct(v),
    }  # fmt: skip


def read(on: Specimen, true: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What ideal sensors show, but for the laws of their readings."""
    shown = dict(true)
    for each in on.readings:
        shown[each.channel] = shown[each.channel] + each.added(true)
    return shown
