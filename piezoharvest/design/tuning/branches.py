"""Start values for shunts with one branch for each of several modes.

Every branch is tuned to resonate at its mode with what the electrodes and the other branches are there, without losses:
for current-flowing branches this is L = (C_p + C_i)/(w_i^2 C_p C_i) of Behrens, Moheimani & Fleming (2003), for
blocking ones that of Wu (1998), both with the other branches counted. Resistances follow the transfer-function rule of
Hagood & von Flotow (1991) with the coupling that the branch's capacitor leaves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain

import numpy as np

from piezoharvest.description.shunts import Shunt
from piezoharvest.description.shunts.linear.current_blocking import CurrentBlocking
from piezoharvest.description.shunts.linear.current_flowing import CurrentFlowing

# Capacitances of the branches over the clamped one. Those of a branch small and those of a blocking circuit large keep
# the branches apart; the other way more power goes into each.
_RATIOS = {CurrentFlowing: (0.1, 0.3, 1.0), CurrentBlocking: (1.0, 3.0, 10.0)}
_ROUNDS, _ACCURACY = 50, 1e-6  # of the fixed-point iteration, which halves its error in each round
_SOURCES = {CurrentFlowing: "Behrens et al. 2003", CurrentBlocking: "Wu 1998"}
Values = dict[str, float]
Reactance = Callable[[int, float, np.ndarray], float]
"""Lossless reactance in ohm of a branch, at rad/s, with the inductances of all branches."""


def branch_values(shunt: Shunt, modes: Sequence[tuple[float, float]], capacitance: float) -> list[tuple[str, Values]]:
    """Start values of all parts of a shunt with branches, with the formula they come from.

    Parameters
    ----------
    shunt : Shunt
        Gives the kind and the number of branches.
    modes : sequence of (float, float)
        Short- and open-circuit resonance in rad/s of each mode, the most strongly coupled first.
    capacitance : float
        Clamped capacitance, F.
    """
    if not isinstance(shunt, CurrentFlowing | CurrentBlocking) or not modes:
        return []
    count = len(shunt.inductances)
    kept = sorted(modes[:count], key=lambda mode: mode[1])
    # Branches beyond the number of modes take what is left of them.
    kept += [kept[-1]] * (count - len(kept))
    make = _flowing if isinstance(shunt, CurrentFlowing) else _blocking
    of, source = next((cls, _SOURCES[cls]) for cls in _SOURCES if isinstance(shunt, cls))
    found = [(ratio, make(shunt, np.array(kept), ratio, capacitance)) for ratio in _RATIOS[of]]
    formula = f"each branch in resonance at its mode ({source})"
    named = [(f"{formula}, with C = {ratio:g} times the clamped one", values) for ratio, values in found]
    return [(name, values) for name, values in named if all(np.isfinite(v) and v > 0 for v in values.values())]


def _flowing(shunt: Shunt, modes: np.ndarray, ratio: float, capacitance: float) -> Values:
    assert isinstance(shunt, CurrentFlowing)
    series = np.full(len(modes), ratio * capacitance)
    series[: shunt.without_capacitor] = np.inf

    def reactance(n: int, omega: float, inductances: np.ndarray) -> float:
        return float(omega * inductances[n] - 1 / (omega * series[n]))

    inductances, resistances = _resonant(modes, series, capacitance, reactance)
    return _named(inductances=inductances, resistances=resistances, capacitances=series[shunt.without_capacitor :])


def _blocking(shunt: Shunt, modes: np.ndarray, ratio: float, capacitance: float) -> Values:
    assert isinstance(shunt, CurrentBlocking)
    opened, blocking = modes[:, 1], np.full(len(modes), ratio * capacitance)
    coils = 1 / (opened**2 * blocking)

    def reactance(n: int, omega: float, inductances: np.ndarray) -> float:
        with np.errstate(divide="ignore"):
            blocks = 1 / (1 / (omega * coils) - omega * blocking)
        return float(omega * inductances[n] + np.sum(np.delete(blocks, n)))

    inductances, resistances = _resonant(modes, np.full(len(modes), np.inf), capacitance, reactance)
    return _named(
        inductances=inductances, resistances=resistances, blocking_inductances=coils, blocking_capacitances=blocking
    )


def _resonant(
    modes: np.ndarray, series: np.ndarray, capacitance: float, reactance: Reactance
) -> tuple[np.ndarray, np.ndarray]:
    """Inductances (n,) at which every branch resonates at its mode, and resistances (n,) for these.

    NaN where there are none, as branches disturb each other too much.
    """
    short, opened = modes.T
    coupling = (opened**2 - short**2) / short**2
    count = len(opened)
    inductances, seen = 1 / (opened**2 * capacitance), np.full(count, capacitance)
    for _ in range(_ROUNDS):
        # Capacitance of the electrodes and the other branches at each mode.
        others = [
            sum(-1 / reactance(m, w, inductances) for m in range(count) if m != n) / w for n, w in enumerate(opened)
        ]
        seen = 0.5 * (seen + np.maximum(capacitance + np.array(others), 0.1 * capacitance))
        missing = [1 / (w * seen[n]) - reactance(n, w, 0 * inductances) for n, w in enumerate(opened)]
        inductances, before = np.array(missing) / opened, inductances
    if np.max(np.abs(inductances / before - 1)) > _ACCURACY:
        inductances = np.full(count, np.nan)
    total = 1 / (1 / seen + 1 / series)
    return inductances, np.sqrt(2 * coupling * total / seen) / (1 + coupling) / (total * short)


def _named(**lists: np.ndarray) -> Values:
    """Values by the names of single entries of lists."""
    return dict(
        chain.from_iterable(((f"{name}.{n}", float(v)) for n, v in enumerate(vs)) for name, vs in lists.items())
    )
