"""First variation of an orbit: derivatives of its states, event times, energy and extremes."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np

from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.propagation.trajectory import ACTS, NOTHING, OPENS
from piezoharvest.engine.sensitivity.dual_modes import Dual, DualMode, Flow, dual
from piezoharvest.engine.sensitivity.orbit import Motion, Tape
from piezoharvest.engine.steady_search import EngineError, solve_conserving

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
NODES, WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS
# Rad of the fastest mode in an interval: a power, which has twice the frequency, is integrated to 1e-12.
MAX_PHASE = 2.5
DECAYED = 36.0  # exp(-36) is below rounding
MIN_TOLERANCE = 4 * np.finfo(float).eps  # smallest tolerance that brentq accepts
TIME_TOLERANCE = 1e-9  # of the period: times that differ by less are equal


class Leg:
    """A motion of the tape in its mode, with the columns of the variation.

    Columns are derivatives with respect to the n states at the beginning of the span, then to the p quantities.
    """

    def __init__(self, motion: Motion, mode: DualMode, flow: Flow, columns: np.ndarray):
        self.motion, self.mode, self.flow, self.columns = motion, mode, flow, columns
        self.shift = np.zeros(len(columns))  # derivatives of the time of the event that ends it

    def at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """States (m, a) and columns (m, n + p, a) at times counted from the beginning of the motion."""
        columns = self.flow.states(self.columns, times)
        forced = self.flow.forced(self.motion.start, times)
        columns[:, -forced.shape[1] :] += forced
        return self.flow.states(self.motion.start, times), columns

    @cached_property
    def end(self) -> tuple[np.ndarray, np.ndarray]:
        """State and columns at the end of the motion, at fixed time."""
        states, columns = self.at(np.array([self.motion.length]))
        return states[0], columns[0]

    def rate(self, state: np.ndarray) -> np.ndarray:
        """Rate of the state."""
        return self.mode.matrix.value @ state

    @cached_property
    def grid(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Nodes and weights of a quadrature over the motion, with states and columns there.

        Its intervals resolve every part of the motion that has not decayed yet.
        """
        edges, length, rates = [0.0], self.motion.length, self.flow.rates
        while edges[-1] < length:
            alive = np.abs(rates[-np.real(rates) * edges[-1] < DECAYED])
            step = MAX_PHASE / max(float(np.max(alive, initial=0.0)), MAX_PHASE / length)
            edges.append(length if edges[-1] + 1.01 * step >= length else edges[-1] + step)
        steps = np.diff(edges)
        times = (np.array(edges[:-1])[:, None] + steps[:, None] * NODES).ravel()
        return times, (steps[:, None] * WEIGHTS).ravel(), *self.at(times)


class Variation:
    """First variation of the orbit on a tape.

    Parameters
    ----------
    tape : Tape
    program : Program
        The same system, lowered from complex steps of its quantities.
    quantities : int
        Their number p.
    """

    def __init__(self, tape: Tape, program: pg.Program, quantities: int):
        self.tape, self.program, self.p = tape, program, quantities
        self.n, self.a = program.rate.shape[-2:]
        self.modes: dict[tuple, tuple[DualMode, Flow]] = {}
        period = self._number("period")
        share = 0.5 if tape.mirrored else 1.0
        self.span = Dual(share * period.value, share * period.change)
        self.harvest = Dual(np.zeros(()), np.zeros(self.n + self.p))
        self.legs = self._follow()
        self.start = self._first_state()

    def _number(self, name: str) -> Dual:
        """A scalar of the program, with its derivatives with respect to all columns."""
        found = dual(getattr(self.program, name), 0)
        return Dual(found.value, self._for_columns(found.change))

    def _for_columns(self, change: np.ndarray) -> np.ndarray:
        """Derivatives (p,) of a number, preceded by zeros for the initial states."""
        return np.concatenate([np.zeros(self.n), np.broadcast_to(change, self.p)])

    def _mode(self, motion: Motion) -> tuple[DualMode, Flow]:
        key = (motion.configuration, *(motion.slip != 0))
        if key not in self.modes:
            mode = DualMode(self.program, motion.configuration, motion.slip)
            self.modes[key] = mode, Flow(mode.matrix)
        return self.modes[key]

    def _follow(self) -> list[Leg]:
        """Propagate the columns along the whole span, with a saltation at every event."""
        columns = np.zeros((self.n + self.p, self.a))
        columns[: self.n, : self.n] = np.eye(self.n)
        legs: list[Leg] = []
        motions, closing = self.tape.motions, np.zeros(self.n + self.p)
        for motion, following in zip(motions, (*motions[1:], None), strict=True):
            leg = Leg(motion, *self._mode(motion), columns)
            legs.append(leg)
            self._collect(leg)
            if following is None:
                break
            state, columns = leg.end
            leg.shift, lag = self._shift(leg, legs, closing), self._number("lag")
            acts = self._closes(motion, following) or self._extracts(state, following)
            if acts and lag.value == 0.0:
                # The extremum and the action are one event here, delayed by a lag.
                leg.shift = leg.shift + lag.change
            if acts or (motion.what == OPENS and self._closed(following)):
                closing = leg.shift  # of a later stage, too
                gate = self._number("gate_energy")
                self._add(-float(gate.value), -gate.change)
            before = leg.rate(state)
            columns = self._reset(columns + np.outer(leg.shift, before), state, motion, following)
            after = self._mode(following)[0].matrix.value @ following.start
            columns = columns - np.outer(leg.shift, after)
            next_leg = Leg(following, *self._mode(following), columns)
            gain = self._power(leg, state) - self._power(next_leg, following.start)
            self._add(0.0, gain * leg.shift)
        return legs

    def _add(self, value: float, change: np.ndarray) -> None:
        self.harvest = Dual(self.harvest.value + value, self.harvest.change + change)

    def _closes(self, motion: Motion, following: Motion) -> bool:
        """True if the switch closes between two motions."""
        return not self._closed(motion) and self._closed(following)

    def _closed(self, motion: Motion) -> bool:
        """True if the switch is closed during a motion."""
        return bool(self.program.opened[motion.configuration] != motion.configuration)

    def _shift(self, leg: Leg, legs: list[Leg], closing: np.ndarray) -> np.ndarray:
        """Derivative of the time of the event that ends a leg."""
        what, motion = leg.motion.what, leg.motion
        if what == OPENS:
            time = dual(self.program.on_time * self.program.stage[..., motion.configuration], 0)
            return closing + self._for_columns(time.change)
        if what == ACTS:
            lag, late = self._number("lag"), TIME_TOLERANCE * self.span.value
            causes = (other for other in legs[:-1] if abs(other.motion.ends + lag.value - motion.ends) <= late)
            cause = next(causes, None)
            if cause is None:
                raise EngineError("an action of the switch was decided before the span in which it happens")
            return cause.shift + lag.change
        state, columns = leg.end
        row, offset = self._guard_row(leg)
        forced = np.broadcast_to(row.change @ state, self.p)
        change = columns @ row.value + self._for_columns(forced) + offset
        return -change / (row.value @ leg.rate(state))

    def _guard_row(self, leg: Leg) -> tuple[Dual, np.ndarray]:
        """Form whose zero ends a leg, and the derivatives of the number added to it."""
        program, what, own = self.program, leg.motion.what, self.program.guard_target.shape[1]
        nothing = np.zeros(self.n + self.p)
        if what < own:
            return leg.mode.guard(what), nothing
        if what == own:
            return dual(program.trigger_row, 1), nothing
        j, side = (what - own - 1) // 2, (what - own - 1) % 2
        if leg.motion.slip[j] != 0:
            return leg.mode.stop_rate(j), nothing
        row = np.zeros(self.a)
        row[program.stop_state[j]] = 1.0
        sign = 1.0 - 2.0 * side
        return Dual(row, np.zeros((1, self.a))), -sign * self._limit(j).change

    def _limit(self, j: int) -> Dual:
        limit = dual(self.program.stop_limit[..., j], 0)
        return Dual(limit.value, self._for_columns(limit.change))

    def _reset(self, columns: np.ndarray, state: np.ndarray, motion: Motion, following: Motion) -> np.ndarray:
        """Effect of an event on the columns beside its shift: currents cut, stops at limits, charge extracted."""
        program, what = self.program, motion.what
        for j in np.flatnonzero((following.slip != 0) & (motion.slip == 0)):
            columns[:, program.stop_state[j]] = following.slip[j] * self._limit(int(j)).change
        if what == OPENS:
            for k in np.flatnonzero(program.cut):
                self._cut(columns, state, int(k))
        if 0 <= what < program.guard_target.shape[1] and program.guard_cut[motion.configuration, what] >= 0:
            self._cut(columns, state, int(program.guard_cut[motion.configuration, what]))
        return self._extract(columns, state, following) if self._extracts(state, following) else columns

    def _cut(self, columns: np.ndarray, state: np.ndarray, which: int) -> None:
        """Set a state to zero, and add what is harvested of its energy."""
        share = dual(self.program.recovered[..., which], 0)
        if share.value or np.any(share.change):
            storage = dual(self.program.storage[..., which, which], 0)
            energy = 0.5 * storage.value * state[which] ** 2
            change = storage.value * state[which] * columns[:, which]
            change = change + 0.5 * state[which] ** 2 * self._for_columns(storage.change)
            self._add(share.value * energy, share.value * change + energy * self._for_columns(share.change))
        columns[:, which] = 0.0
        state[which] = 0.0

    def _extracts(self, state: np.ndarray, following: Motion) -> bool:
        """True if the electrode voltage is set to zero between a state and the following motion."""
        row = dual(self.program.voltage_row, 1).value
        return self.program.switched == 2 and abs(row @ following.start) <= TIME_TOLERANCE * abs(row @ state)

    def _extract(self, columns: np.ndarray, state: np.ndarray, following: Motion) -> np.ndarray:
        """Extract charge until the voltage is zero, with the sticking stops, and add the harvested energy."""
        program, charge, after = self.program, self.program.charge, following.start
        row, before, taken = dual(program.voltage_row, 1), columns.copy(), after[charge] - state[charge]
        free, lost = [charge], Dual(np.zeros(()), np.zeros(self.n + self.p))
        slipped = []
        for j, stop in enumerate(program.stop_state):
            moved = after[stop] - state[stop]
            if abs(moved - taken) <= TIME_TOLERANCE * abs(taken):
                free.append(stop)
                continue
            if moved != 0.0:
                columns[:, stop] = np.sign(after[stop]) * self._limit(j).change
            slipped.append((j, stop, moved))
        voltage = columns @ row.value + self._for_columns(np.broadcast_to(row.change @ after, self.p))
        columns[:, free] -= (voltage / np.sum(row.value[free]))[:, None]
        for j, stop, moved in slipped:
            # Work of the saturated stop over the charge moved while it slipped.
            length, sign = abs(taken) - abs(moved), np.sign(taken)
            weight = dual(program.stop_weight[..., j] * program.stop_limit[..., j], 0)
            shorter = sign * (columns[:, charge] - before[:, charge] - columns[:, stop] + before[:, stop])
            lost = Dual(
                lost.value + weight.value * length,
                lost.change + weight.value * shorter + self._for_columns(weight.change) * length,
            )
        efficiency, kept = self._number("efficiency"), self._stored(state, before)
        left = self._stored(after, columns)
        energy = kept.value - left.value - lost.value
        change = kept.change - left.change - lost.change
        drop, scale = self._number("drop"), dual(program.scale[..., charge], 0)
        moved = np.sign(taken) * (columns[:, charge] - before[:, charge])
        moved = scale.value * moved + abs(taken) * self._for_columns(scale.change)
        energy = energy - drop.value * scale.value * abs(taken)
        change = change - drop.value * moved - drop.change * scale.value * abs(taken)
        if energy > 0:
            self._add(efficiency.value * energy, efficiency.value * change + efficiency.change * energy)
        return columns

    def _stored(self, state: np.ndarray, columns: np.ndarray) -> Dual:
        """Stored energy of a state."""
        storage, z = dual(self.program.storage, 2), state[: self.n]
        own = 0.5 * np.einsum("i,pij,j->p", z, storage.change, z)
        change = columns[:, : self.n] @ (0.5 * (storage.value + storage.value.T) @ z)
        return Dual(0.5 * z @ storage.value @ z, change + self._for_columns(own))

    def _power(self, leg: Leg, state: np.ndarray) -> float:
        """Harvested power at a state."""
        coefficient, first, second = leg.mode.harvest
        return float(np.sum(coefficient.value * (first.value @ state) * (second.value @ state)))

    def _collect(self, leg: Leg) -> None:
        """Add the energy harvested in a leg."""
        coefficient, first, second = leg.mode.harvest
        if not coefficient.value.size or leg.motion.length == 0.0:
            return
        _, weights, states, columns = leg.grid
        factors, changes = [], []
        for form in (first, second):
            own = np.broadcast_to(np.einsum("pka,ma->mpk", form.change, states), (len(states), self.p, len(form.value)))
            total = columns @ form.value.T
            total[:, self.n :] += own
            factors.append(states @ form.value.T)
            changes.append(total)
        c = coefficient.value
        product = factors[0] * factors[1]
        change = changes[0] * factors[1][:, None, :] + changes[1] * factors[0][:, None, :]
        own = np.einsum("m,mk,pk->p", weights, product, coefficient.change)
        self._add(weights @ product @ c, np.einsum("m,mck,k->c", weights, change, c) + self._for_columns(own))

    def _first_state(self) -> np.ndarray:
        """Derivative (n, p) of the initial state of the span, from periodicity."""
        n, last = self.n, self.legs[-1]
        state, columns = last.end
        columns = columns + np.outer(self.span.change, last.rate(state))
        parity = self.program.odd if self.tape.mirrored else np.ones(n)
        monodromy, forced = parity[:, None] * columns[:n, :n].T, parity[:, None] * columns[n:, :n].T
        return solve_conserving(np.eye(n) - monodromy, forced)

    def _total(self, columns: np.ndarray) -> np.ndarray:
        """Total derivatives with respect to the quantities, including those by way of the initial state."""
        return columns[self.n :] + np.tensordot(self.start.T, columns[: self.n], 1)

    def power(self) -> Dual:
        """Harvested power, W."""
        last = self.legs[-1]
        energy, span = self.harvest, self.span
        change = self._total(energy.change + self._power(last, last.end[0]) * span.change)
        power = energy.value / span.value
        return Dual(power, (change - power * span.change[self.n :]) / span.value)

    def amplitude(self, output: int) -> Dual:
        """Half of peak-to-peak of an output."""
        found = [extreme for leg in self.legs for extreme in self._extremes(leg, output)]
        if not found:
            raise EngineError("an output has no extremum, to within rounding")
        if self.tape.mirrored:
            value, leg, time = max(found, key=lambda extreme: abs(extreme[0]))
            return Dual(abs(value), np.sign(value) * self._change_of(output, leg, time))
        low, early, first = min(found, key=lambda extreme: extreme[0])
        high, late, last = max(found, key=lambda extreme: extreme[0])
        change = self._change_of(output, late, last) - self._change_of(output, early, first)
        return Dual(0.5 * (high - low), 0.5 * change)

    def _extremes(self, leg: Leg, output: int) -> Iterator[tuple[float, Leg, float]]:
        """Values of an output at its extrema within a leg, at the event that ends it, and after a jump before it.

        Each with its leg and its time from the leg's beginning; infinity denotes the event.
        """
        row = leg.mode.outputs.value[output]
        if leg.motion.length > 0.0:
            for time in self._turns(leg, row):
                yield float(row @ leg.flow.states(leg.motion.start, np.array([time]))[0]), leg, time
        if leg.motion.what != NOTHING:
            yield float(row @ leg.end[0]), leg, np.inf
        if leg is not self.legs[0] and self.program.switched == 2:
            yield float(row @ leg.motion.start), leg, 0.0

    def _change_of(self, output: int, leg: Leg, time: float) -> np.ndarray:
        """Derivatives (p,) of an output at a fixed time of a leg, or at its final event with the event's shift."""
        if np.isinf(time):
            state, columns = leg.end
            columns = columns + np.outer(leg.shift, leg.rate(state))
        else:
            state, columns = (found[0] for found in leg.at(np.array([time])))
        rows = leg.mode.outputs
        return self._total(columns) @ rows.value[output] + np.broadcast_to(rows.change[:, output] @ state, self.p)

    def _turns(self, leg: Leg, row: np.ndarray) -> Iterator[float]:
        """Times within a leg at which the rate of a form changes sign."""
        from scipy.optimize import brentq

        slope = row @ leg.mode.matrix.value
        times = np.concatenate([[0.0], leg.grid[0], [leg.motion.length]])
        rates = leg.flow.states(leg.motion.start, times) @ slope
        # A rate that is zero at an event does not count as another extremum beside it.
        rates[np.abs(rates) <= TIME_TOLERANCE * np.max(np.abs(rates))] = 0.0
        for k in np.flatnonzero(rates[:-1] * rates[1:] < 0):
            # Near an event that shifts, the change of an output depends on the place of its extremum to first order.
            turn: Any = brentq(
                lambda t: leg.flow.states(leg.motion.start, np.array([t]))[0] @ slope, times[k], times[k + 1],
                xtol=MIN_TOLERANCE * leg.motion.length, rtol=MIN_TOLERANCE,
            )  # fmt: skip
            yield turn
