"""Steps of the linear modes of a run and their derivatives, arranged for `along_tape`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.sensitivity.dual_modes import Dual, DualMode, dual

# |A| times the shortest tabulated step. The rest of a motion, which is shorter, is a Taylor series of five terms: its
# error is below (0.01)^6/6!, rounding.
FINEST = 1e-2
MAX_HALVINGS = 60
TERMS = 8  # of the series of the shortest step


class ModeSteps(NamedTuple):
    """Modes of a run.

    m modes, l lengths of steps, a augmented states, o outputs, w kinds of events, p quantities.

    Attributes
    ----------
    rate, growth, outputs, guards : arrays
        (m, a, a) generator A; (m, l, a, a) exp(A h/2^l) - 1, so that short steps lose no digits; (m, o, a); (m, w, a)
        forms whose zero is an event of a kind: the circuit's guards, the extremum, and two sides of each stop.
    d_rate, d_growth, d_outputs, d_guards : arrays
        Their derivatives, with the quantities as last axis.
    depends_rate, depends : (m, a, a) and (m, l, a, a) bool array
        True where rate and growth have derivatives: a quantity changes few of their elements.
    d_limits : (w, p) array
        Derivatives of the numbers added to the forms.
    levels : (m,) int array
        Number of lengths in use.
    """

    rate: np.ndarray
    growth: np.ndarray
    outputs: np.ndarray
    guards: np.ndarray
    d_rate: np.ndarray
    d_growth: np.ndarray
    d_outputs: np.ndarray
    d_guards: np.ndarray
    depends_rate: np.ndarray
    depends: np.ndarray
    d_limits: np.ndarray
    levels: np.ndarray


def mode_steps(program: pg.Program, count: int, modes: Sequence[ModeArrays]) -> ModeSteps:
    """Tables of modes.

    Parameters
    ----------
    program : Program
        Lowered from complex steps of its quantities.
    count : int
        Number of quantities.
    modes : sequence of ModeArrays
        Of this program.
    """
    deepest = max(len(each.growth) for each in modes)

    def filled(part: np.ndarray) -> np.ndarray:
        return np.concatenate([part, np.zeros((deepest - len(part), *part.shape[1:]), part.dtype)])

    own = program.guard_target.shape[1]
    limits = np.zeros((own + 1 + 2 * len(program.stop_state), count))
    for j in range(len(program.stop_state)):
        change = _spread(dual(program.stop_limit[..., j], 0).change, count)
        limits[own + 1 + 2 * j], limits[own + 2 + 2 * j] = -change, change
    stacked = {
        name: np.array([getattr(mode, name) for mode in modes])
        for name in ("rate", "outputs", "guards", "d_rate", "d_outputs", "d_guards", "depends_rate")
    }
    by_level = {
        name: np.array([filled(getattr(mode, name)) for mode in modes]) for name in ("growth", "d_growth", "depends")
    }
    return ModeSteps(
        **stacked, **by_level, d_limits=limits, levels=np.array([len(mode.growth) for mode in modes])
    )  # fmt: skip


class ModeArrays:
    """Arrays of one mode, as in `ModeSteps`.

    Parameters
    ----------
    program : Program
        Lowered from complex steps of its quantities.
    count : int
        Number of quantities.
    configuration : int
        Of the circuit.
    slip : (h,) int array
        Stops that slip (not zero).
    h : float
        Longest step, s.
    rows : sequence of int
        Outputs that are wanted, as places in `pg.OUTPUTS`.
    """

    def __init__(self, program: pg.Program, count: int, configuration: int, slip: np.ndarray, h: float, rows) -> None:
        mode = DualMode(program, configuration, slip)
        self.rate, self.d_rate = _last(mode.matrix, count)
        self.growth, self.d_growth = _growths(mode.matrix, count, h)
        self.depends_rate, self.depends = (np.any(change, axis=-1) for change in (self.d_rate, self.d_growth))
        self.outputs, self.d_outputs = _last(Dual(*(part[..., list(rows), :] for part in mode.outputs)), count)
        guards = [_guard(program, mode, what, slip) for what in range(_kinds(program))]
        self.guards = np.array([row.value for row in guards])
        self.d_guards = np.array([_spread(row.change, count).T for row in guards])


def _kinds(program: pg.Program) -> int:
    """Number of kinds of events: the circuit's guards, the extremum, two sides of each stop."""
    return program.guard_target.shape[1] + 1 + 2 * len(program.stop_state)


def _guard(program: pg.Program, mode: DualMode, what: int, slip: np.ndarray) -> Dual:
    """Form whose zero is an event."""
    own, a = program.guard_target.shape[1], program.rate.shape[-1]
    if what < own:
        return mode.guard(what)
    if what == own:
        return dual(program.trigger_row, 1)
    j = (what - own - 1) // 2
    if slip[j] != 0:
        return mode.stop_rate(j)
    # The output of a stop minus its limit, at the upper side; plus its limit at the lower one.
    row = np.zeros(a)
    row[program.stop_state[j]] = 1.0
    return Dual(row, np.zeros((1, a)))


def _growths(matrix: Dual, count: int, h: float) -> tuple[np.ndarray, np.ndarray]:
    """exp(A h/2^l) - 1 from l = 0 on, and its derivatives: the finest by its series, the others by doubling."""
    A, dA = matrix.value, np.broadcast_to(matrix.change, (count, *matrix.value.shape))
    size = max(float(np.max(np.sum(np.abs(A), axis=1))) * h, FINEST)
    halvings = min(int(np.ceil(np.log2(size / FINEST))), MAX_HALVINGS)
    A, dA = A * (h / 2.0**halvings), dA * (h / 2.0**halvings)
    term, d_term = A, dA
    E, dE = A.copy(), dA.copy()
    for k in range(2, TERMS):
        term, d_term = term @ A / k, (d_term @ A + term @ dA) / k
        E, dE = E + term, dE + d_term
    found = [(E, dE)]
    with np.errstate(over="ignore", invalid="ignore"):  # of a law that would give energy: the engine finds no end
        for _ in range(halvings):
            E, dE = 2.0 * E + E @ E, 2.0 * dE + dE @ E + E @ dE
            found.append((E, dE))
    growth, change = zip(*reversed(found), strict=True)
    return np.array(growth), np.ascontiguousarray(np.moveaxis(np.array(change), 1, -1))


def _spread(change: np.ndarray, count: int) -> np.ndarray:
    """Derivatives with the quantities as first axis, also where none has an influence."""
    return np.broadcast_to(change, (count, *change.shape[1:]))


def _last(both: Dual, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Values, and derivatives with the quantities as last axis."""
    return both.value, np.ascontiguousarray(np.moveaxis(_spread(both.change, count), 0, -1))
