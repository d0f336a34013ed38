"""Fits of candidates with the printed rounding as noise, and what they predict of rows that were left out.

The residual is the logarithm of predicted over printed, of energy and peak power.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from reports.paper.candidates import ABSENT, START, Candidate, Parameters
from reports.paper.tables import Row, experiment, rows

_REACH = np.log(100.0)  # how far a search may go from where it begins
_STARTS = 6
_TRIALS = 60  # of parameters in one search, at most; half as many near a fit


class Fit(NamedTuple):
    """A fitted candidate.

    Attributes
    ----------
    candidate : Candidate
    parameters : dict
        All parameters, the free ones fitted.
    spread : dict
        Relative standard deviation of the free ones, from the residuals that are left.
    residuals : (rows, 2) array
        Of energies and peaks.
    noise : (rows, 2) array
        Standard deviation that rounding and repeatability explain.
    """

    candidate: Candidate
    parameters: Parameters
    spread: dict[str, float]
    residuals: np.ndarray
    noise: np.ndarray

    @property
    def rms(self) -> float:
        """Of all residuals."""
        return rms(self.residuals)

    @property
    def reduced_chi_squared(self) -> float:
        """Sum of squares over noise for each degree of freedom: 1 where rounding and repeatability explain the rest."""
        return float(np.sum((self.residuals / self.noise) ** 2) / (self.residuals.size - len(self.candidate.free)))


def rms(values: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


@cache
def repeatability() -> float:
    """Relative scatter between rows that should be equal: Table III's energies, which hardly feel the load; pooled."""
    groups = [[np.log(r.energy.value) for r in rows("III") if r.force == f] for f in experiment()["step_forces_N"]]
    return float(np.sqrt(np.mean([np.var(group, ddof=1) for group in groups if group])))


def rounding(chosen: Sequence[Row]) -> np.ndarray:
    """Standard deviation of the logarithms that the printed digits leave, (rows, 2)."""
    return np.array([[row.energy.relative, row.peak.relative] for row in chosen])


def residuals(candidate: Candidate, p: Parameters, chosen: Sequence[Row]) -> np.ndarray:
    """Logarithms of predicted over printed, (rows, 2)."""
    printed = np.array([[row.energy.value, row.peak.value] for row in chosen])
    return np.log(np.stack(candidate.predict(p, chosen, candidate.choice), axis=-1) / printed)


def fit(candidate: Candidate, chosen: Sequence[Row], near: Parameters | None = None) -> Fit:
    """Fit a candidate to rows; with `near` by one search from there, else from several starts."""
    noise = np.hypot(rounding(chosen), repeatability())

    def parameters(x: np.ndarray) -> Parameters:
        return {**ABSENT, **dict(zip(candidate.free, np.exp(x).tolist(), strict=True))}

    def weighted(x: np.ndarray) -> np.ndarray:
        return (residuals(candidate, parameters(x), chosen) / noise).ravel()

    if not candidate.free:
        return Fit(candidate, dict(ABSENT), {}, residuals(candidate, ABSENT, chosen), noise)
    centre = np.log([START[name] for name in candidate.free])
    bounds = (centre - _REACH, centre + _REACH)
    # Steps of 1e-4 for the derivatives: far above what the engine's sampling of peaks leaves.
    options = {"diff_step": 1e-4, "x_scale": 0.3, "ftol": 1e-6, "max_nfev": _TRIALS if near is None else _TRIALS // 2}
    searches = [
        least_squares(weighted, np.clip(x, *bounds), bounds=bounds, **options) for x in _starts(candidate, centre, near)
    ]
    best = min(searches, key=lambda found: found.cost)
    scale = 2 * best.cost / max(best.fun.size - len(best.x), 1)
    deviations = np.linalg.norm(np.linalg.pinv(best.jac), axis=1) * np.sqrt(scale)
    found = parameters(best.x)
    spread = dict(zip(candidate.free, deviations.tolist(), strict=True))
    return Fit(candidate, found, spread, residuals(candidate, found, chosen), noise)


def _starts(candidate: Candidate, centre: np.ndarray, near: Parameters | None) -> list[np.ndarray]:
    if near is not None:
        return [np.log([near[name] for name in candidate.free])]
    scattered = np.random.default_rng(1).normal(0.0, 0.5, (_STARTS - 1, len(centre)))
    return [centre, *(centre + scattered)]


def folds(chosen: Sequence[Row]) -> Mapping[str, list[bool]]:
    """Which rows each fold leaves out: a force level, a load, a frequency."""
    found = {}
    for attribute, factor, unit in (("force", 1e-3, "kN"), ("load", 1e-3, "kΩ"), ("frequency", 1.0, "Hz")):
        for value in sorted({getattr(row, attribute) for row in chosen} - {None}):
            found[f"{value * factor:g} {unit}"] = [getattr(row, attribute) == value for row in chosen]
    return found


def left_out(best: Fit, chosen: Sequence[Row]) -> dict[str, np.ndarray]:
    """Residuals of each fold's left-out rows, predicted from a fit to the others that starts at the fit to all.

    A parameter that the other rows do not see (the force at 0.75 kN without its rows) keeps the value at which it is
    absent.
    """
    found = {}
    for name, out in folds(chosen).items():
        kept = [row for row, gone in zip(chosen, out, strict=True) if not gone]
        gone = [row for row, gone in zip(chosen, out, strict=True) if gone]
        partial = replace(best.candidate, free=tuple(p for p in best.candidate.free if _seen(p, kept)))
        found[name] = residuals(partial, fit(partial, kept, near=best.parameters).parameters, gone)
    return found


def _seen(parameter: str, kept: Sequence[Row]) -> bool:
    if parameter == "force_750":
        return any(row.force == 750.0 for row in kept)
    if parameter.startswith("load_"):
        label = experiment()["loads_ohm"][int(parameter[-1]) - 1]
        return any(row.load == label for row in kept)
    return True
