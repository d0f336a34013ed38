"""Where a netlist begins: a point of the engine's steady state, so that no time is spent on settling."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezoharvest.description.excitation import Excitation
from piezoharvest.description.system import System
from piezoharvest.engine.lowering.lower import Lowered, lower
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory.state import EngineState
from piezoharvest.engine.run import Machine
from piezoharvest.engine.sensitivity.orbit import Motion, record_motions
from piezoharvest.engine.simulation import search
from piezoharvest.engine.steady_search import EngineError, Orbit, Shooting, check


class SteadyStart(NamedTuple):
    """State at an instant of a periodic steady state.

    Attributes
    ----------
    values : dict of str to float
        States and "v_t" by name, SI.
    time : float
        The instant, in s after the drive's phase zero.
    period : float
        s
    rising : bool
        sum T_i x_i grows at the instant.
    turns : (n,) array
        Instants of its extrema in the period before, s before the instant, all below zero and ascending.
    """

    values: dict[str, float]
    time: float
    period: float
    rising: bool
    turns: np.ndarray

    def sides(self, length: float, hold_off: float) -> tuple[np.ndarray, np.ndarray]:
        """Sign of sum T_i x_i' as the switch takes it, over a time (s) before the start.

        Returns
        -------
        (m,) array
            Instants at which it changes, s before the start, ascending.
        (m + 1,) array
            The sign before, between and after them; there is no turn where nothing moves. Changes within the
            hold-off of one that counted do not count.
        """
        if not len(self.turns):
            return np.zeros(0), np.zeros(1)
        cycles = int(np.ceil((length + hold_off) / self.period)) + 2
        turns = (self.turns + self.period * np.arange(-cycles, 1)[:, None]).ravel()
        signs = (1.0 if self.rising else -1.0) * (-1.0) ** np.arange(len(turns) - 1, -1, -1)
        last, counted = -np.inf, []
        for n, turn in enumerate(turns):
            if turn - last >= hold_off * (1 - 1e-9):
                last = turn
                counted.append(n)
        recent = [n for n in counted if turns[n] > -length]
        first = [n for n in counted if turns[n] <= -length][-1:]
        return turns[recent], signs[[*first, *recent]]


def steady_start(system: System, excitation: Excitation) -> SteadyStart | None:
    """Middle of the longest motion of the steady state that a motion from rest comes to; None if there is none."""
    if excitation.period is None:
        return None
    with np.errstate(all="ignore"):
        lowered = lower(system, excitation)
        try:
            orbit, mirrored, _, _, settles = search(lowered, excitation)
            if not settles:
                return None
            return _start(lowered, Shooting(Machine(lowered), excitation.period, mirrored), orbit)
        except EngineError:
            return None


def _start(lowered: Lowered, shooting: Shooting, orbit: Orbit) -> SteadyStart:
    """Start at the middle of the longest motion that an orbit has within a period."""
    machine, period = shooting.machine, shooting.period
    motions, _ = record_motions(machine, shooting, orbit, period)
    longest = max(motions, key=lambda motion: motion.length)
    instant = 0.5 * (longest.begins + longest.ends)
    state = shooting.load(orbit, sample_time=np.array([instant]))
    check(machine.run(state, instant))
    before = np.sort(np.mod(np.array(_turns(shooting, orbit, motions)) - instant, period) - period)
    values = _values(lowered, state)
    return SteadyStart(values, float(np.mod(instant, period)), period, bool(state.D[st.DIRECTION] > 0), before)


def _turns(shooting: Shooting, orbit: Orbit, motions: tuple[Motion, ...]) -> list[float]:
    """Instants at which sum T_i x_i turns: between motions, of which several events may end one."""
    state = shooting.load(orbit)
    turns, direction = [], state.D[st.DIRECTION]
    for motion in motions:
        check(shooting.machine.run(state, 0.5 * (motion.begins + motion.ends)))
        if state.D[st.DIRECTION] != direction:
            turns.append(motion.begins)
            direction = state.D[st.DIRECTION]
    return turns


def _values(lowered: Lowered, state: EngineState) -> dict[str, float]:
    """States in SI units, and the voltage of the clamped capacitance."""
    scaled = state.z[: len(lowered.states)] * lowered.program.scale
    values = dict(zip(lowered.states, map(float, scaled), strict=True))
    outputs = dict(zip(pg.OUTPUTS, map(float, state.samples[0]), strict=True))
    return values | {"v_t": outputs["voltage"] - outputs["hysteresis_voltage"]}
