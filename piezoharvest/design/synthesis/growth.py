"""Growth of ladders: from the load alone, arm by arm and resonator by resonator, to a given number of arms.

Each ladder of the best so far is extended at every place by a coil or a capacitor that hardly acts, or by both in
resonance, at impedances far below, at and far above that of the electrodes; all values are then optimised along the
gradient (L-BFGS-B), and the best few go on. So no order is worse than the one before it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize

from piezoharvest.design.synthesis.measure import LadderMeasure

_KEPT = 3  # ladders of an order that are extended by resonators; by single arms the best of them
# e-folds of a new arm's impedance from that of the electrodes: those of an arm that hardly acts, and of a resonator's
_SLIGHT, _LEVELS = 1.5, (-2.5, 0.0, 2.5)
_ROUGH, _FINE = (50, 1e-7), (200, 1e-10)  # iterations and relative accuracy: for all, and for those that are kept
_EQUAL = 1e-4  # e-folds, 0.01 % of the power: of ladders as close as this the one with smaller coils is taken
_GAIN = 1e-5  # e-folds, 0.001 % of the power: for less no arm is added


class Grown(NamedTuple):
    """Ladder with its merit: arms from the electrodes on, logarithms of their values and of the load."""

    merit: float
    arms: str
    logs: np.ndarray


@dataclass
class Growth:
    """Growth of ladders.

    Attributes
    ----------
    measure : LadderMeasure
    places : sequence of float
        Angular frequencies to which resonators are tuned at first, rad/s.
    impedance : float
        Impedance of the electrodes at the first of these, ohm.
    loss : float
        Series resistance of all coils in ohm per henry.
    span : float
        e-folds that values may be away from those of this impedance.
    max_inductance : float
        H.
    """

    measure: LadderMeasure
    places: tuple[float, ...]
    impedance: float
    loss: float
    span: float
    max_inductance: float = np.inf
    _beams: list[list[Grown]] = field(default_factory=list)
    _best: list[Grown] = field(default_factory=list)

    def best(self, order: int) -> Grown:
        """Best ladder with at most so many arms; what has grown is kept for the next order."""
        beams, best = self._beams, self._best
        if not beams:
            beams.append([self.optimised("", np.log([self.impedance]))])
            best.append(beams[0][0])
        for n in range(len(beams), order + 1):
            starts = [start for grown in beams[n - 1][:1] for start in self._with_arm(grown)]
            starts += [start for grown in (beams[n - 2] if n > 1 else ()) for start in self._with_resonator(grown)]
            beams.append(self._selected(starts))
            found = beams[n][0] if beams[n] else best[-1]
            best.append(found if found.merit < best[-1].merit - _GAIN else best[-1])
        return best[order]

    def optimised(self, arms: str, logs: np.ndarray, effort: tuple[int, float] = _FINE) -> Grown:
        """Values of a ladder that are optimal near a start."""
        bounds = list(zip(*self.box(arms), strict=True))
        found: Any = minimize(
            lambda p: self.measure.value(arms, p, self.loss), np.clip(logs, *self.box(arms)), jac=True, bounds=bounds,
            method="L-BFGS-B", options={"maxiter": effort[0], "ftol": effort[1], "gtol": 0.1 * effort[1]},
        )  # fmt: skip
        return Grown(float(found.fun) if np.isfinite(found.fun) else np.inf, arms, found.x)

    def box(self, arms: str) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest logarithms of the values of the arms and the load."""
        middle = np.array([*(self._typical(arm) for arm in arms), np.log(self.impedance)])
        high = middle + self.span
        high[: len(arms)][[arm in "Ll" for arm in arms]] = min(
            self._typical("L") + self.span, float(np.log(self.max_inductance))
        )
        return np.minimum(middle - self.span, high - 2 * self.span), high

    def _typical(self, arm: str, place: int = 0) -> float:
        """Logarithm of the value at which an arm has the impedance of the electrodes at one of the places."""
        omega = self.places[place]
        return float(np.log(self.impedance / omega) if arm in "Ll" else -np.log(self.impedance * omega))

    def _selected(self, starts: Iterable[tuple[str, np.ndarray]]) -> list[Grown]:
        """The best few of different circuits that grow from some starts."""
        found: dict[str, Grown] = {}
        for arms, logs in starts:
            grown, circuit = self.optimised(arms, logs, _ROUGH), _circuit(arms)
            if circuit not in found or grown.merit < found[circuit].merit:
                found[circuit] = grown
        kept = sorted(found.values(), key=lambda grown: grown.merit)[:_KEPT]
        return sorted((self.optimised(grown.arms, grown.logs) for grown in kept), key=_preference)

    def _with_arm(self, grown: Grown) -> Iterator[tuple[str, np.ndarray]]:
        """The ladder with another arm that hardly acts, at every place where it is not beside one of its kind."""
        for k, arm in self._insertions(grown.arms, ("L", "C", "l", "c")):
            # In series a small impedance hardly acts, across a large one.
            away = _SLIGHT if arm in "lC" else -_SLIGHT
            yield _inserted(grown, k, arm, [self._typical(arm) + away])

    def _with_resonator(self, grown: Grown) -> Iterator[tuple[str, np.ndarray]]:
        """The ladder with a coil and a capacitor in resonance, in series or across, at every place."""
        for k, arms in self._insertions(grown.arms, ("LC", "lc")):
            for place in range(len(self.places)):
                for level in _LEVELS:
                    logs = [self._typical(arms[0], place) + level, self._typical(arms[1], place) - level]
                    yield _inserted(grown, k, arms, logs)

    @staticmethod
    def _insertions(arms: str, kinds: Iterable[str]) -> Iterator[tuple[int, str]]:
        """Places and new arms such that no two of a kind stand side by side."""
        for k in range(len(arms) + 1):
            beside = arms[max(k - 1, 0) : k + 1]
            for kind in kinds:
                if not set(kind) & set(beside):
                    yield k, kind


def _preference(grown: Grown) -> tuple[float, float]:
    """Order of ladders: by merit, of those that are as good by their largest coil."""
    coils = [log for arm, log in zip(grown.arms, grown.logs, strict=False) if arm in "Ll"]
    return round(grown.merit / _EQUAL), max(coils, default=-np.inf)


def _inserted(grown: Grown, place: int, arms: str, logs: list[float]) -> tuple[str, np.ndarray]:
    return grown.arms[:place] + arms + grown.arms[place:], np.insert(grown.logs, [place] * len(logs), logs)


def _circuit(arms: str) -> str:
    """Name of the circuit: neighbouring arms that are all in series, or all across, may be exchanged."""
    return re.sub("[LC]+|[lc]+", lambda match: "".join(sorted(match[0])), arms)
