"""Loads of the solver whose switches find the extrema of the voltage by themselves, written from docs/equations.md."""

from __future__ import annotations

import numpy as np

from piezoharvest.bench.solver.loads.circuits import Circuit, Rectifier
from piezoharvest.bench.solver.loads.switched import SSDI

# Slots of the guards: a breaker opens; the voltage has fallen from an envelope (maxima, minima), or rises beyond it;
# and what circuits add: a bridge, or empty electrodes.
OPENS, FALLS, RISES, FURTHER = 0, 1, 3, 5
PACE = 25.0  # sqrt(L C) times this is of the size of the time in which the voltage moves, for the size of its rate
# Of an envelope capacitor: not above zero, above it, charged by the voltage, pulled down with it, just used up.
EMPTY, FULL, CHARGED, PULLED, USED = range(5)


class Breaking(SSDI):
    """A coil behind two breakers; states are those of the coil, both envelope voltages, and of a dc side.

    `closed` is the sign of the voltage whose breaker conducts, 0 while both are open. `kept` tells, by this sign, what
    each envelope capacitor does.
    """

    envelope_capacitance: float
    threshold: float
    diode_drop: float
    breaker_drop: float | None
    base_resistance: float
    on_time_error = 0.0
    path_diodes = 1
    guard_count = 7
    sign = closed = 0
    kept: dict[int, int]
    moved: dict[int, float]  # states that the last change of the branch moves, and where to
    rise: np.ndarray  # of the voltage, V/s
    path: np.ndarray  # current of the closed breaker, A
    beside: np.ndarray | float  # current of the electrodes through junctions behind a resistance, A

    def __init__(self, shunt):
        super().__init__(shunt)
        self.kept = {1: EMPTY, -1: EMPTY}

    def driven(self, period):
        """Nothing: its switches are not timed."""

    @property
    def guard_unit(self) -> str:
        """Voltages: currents and rates are made such by constants of the loop."""
        return "V"

    def meet(self, capacitance):
        super().meet(capacitance)
        coil, rest = self.storage[: self.coil_states], self.storage[self.coil_states :]
        self.storage = (*coil, self.envelope_capacitance, self.envelope_capacitance, *rest)
        self.impedance = 1.0 / self.surge
        self.pace = PACE * capacitance * self.impedance
        own = self.diode_drop if self.breaker_drop is None else self.breaker_drop
        self.drop = own + (self.path_diodes - 1) * self.diode_drop

    @property
    def branch(self) -> int:
        """Signs of bridge and closed breaker, and what both capacitors do, in one number."""
        return (self.sign + 1) + 3 * (self.closed + 1) + 9 * self.kept[1] + 45 * self.kept[-1]

    @branch.setter
    def branch(self, value: int) -> None:
        low, rest = divmod(value, 45)
        high, rest = divmod(rest, 9)
        self.kept = {1: high, -1: low}
        self.closed, self.sign = rest // 3 - 1, rest % 3 - 1

    @property
    def conducting(self) -> int:
        return self.sign

    def envelope(self, sign: int) -> int:
        """Number of the state that is the voltage of an envelope capacitor."""
        return self.coil_states + (sign < 0)

    def moves_along(self, sign: int) -> bool:
        """Whether an envelope capacitor has the rate of the voltage: behind a diode, or a junction and nothing else."""
        return self.kept[sign] == CHARGED or (self.kept[sign] == PULLED and not self.base_resistance)

    def flow(self, z, v, free, elastance):
        # A capacitor across the leads is one more of the electrodes.
        beside = self.envelope_capacitance * sum(self.moves_along(s) for s in (1, -1))
        share = 1.0 / (1.0 + beside * elastance)
        self.beside, rates = 0.0, {}
        for s in (1, -1):
            rates[s] = 0.0 * v
            if self.kept[s] == PULLED and self.base_resistance:
                current = self.fallen(s, z, v) / self.base_resistance
                self.beside = self.beside - s * current
                rates[s] = -current / self.envelope_capacitance
        i, (coil, further) = self.inner(z, v, share * free, share * elastance)
        self.rise = share * (free - elastance * i)
        for s in (1, -1):
            if self.moves_along(s):
                rates[s] = s * self.rise
        return i + beside * self.rise, (*coil, rates[1], rates[-1], *further)

    def inner(self, z, v, free, elastance) -> tuple[np.ndarray, tuple]:
        """Current without what moves with the voltage, and the rates of the coil's states and of further ones."""
        across = v - self.closed * self.drop
        self.path = self.loop_current(z, across)
        return self.path + self.beside, (self.loop_rates(z, across), ())

    def fallen(self, sign, z, v):
        """Voltage by which the electrodes are below an envelope, less the threshold."""
        return z[self.envelope(sign)] - sign * v - self.threshold

    def guards(self, z, v, i):
        never = 0.0 * v - 1.0
        found = [never] * self.guard_count
        if self.closed:
            found[OPENS] = -self.closed * self.impedance * self.path
        for n, s in enumerate((1, -1)):
            kept, fallen = self.kept[s], self.fallen(s, z, v)
            if kept == PULLED:
                found[FALLS + n] = -fallen if self.base_resistance else s * self.pace * self.rise
            elif kept == USED and self.closed != s:
                found[FALLS + n] = self.diode_drop - s * v
            elif (kept == FULL and not self.closed) or (kept in (EMPTY, USED) and self.may_pull(s)):
                found[FALLS + n] = fallen
            if kept == CHARGED:
                found[RISES + n] = -s * self.pace * self.rise
            elif kept in (EMPTY, FULL) and self.may_charge(s):
                found[RISES + n] = s * v - z[self.envelope(s)] - self.diode_drop
        return found

    def may_charge(self, sign: int) -> bool:
        """Whether the voltage of this sign can charge its envelope capacitor."""
        return self.kept[-sign] != CHARGED

    def may_pull(self, sign: int) -> bool:
        """Whether the junction behind this envelope capacitor can conduct."""
        return self.kept[-sign] != PULLED and self.sign != sign

    def let_go(self, sign: int) -> None:
        """Hold an envelope capacitor that the voltage has moved."""
        if self.kept[sign] == CHARGED:
            self.kept[sign] = FULL if sign * float(self.voltage[0]) > self.diode_drop else EMPTY
        elif self.kept[sign] == PULLED:
            self.kept[sign] = USED if self.closed == sign else EMPTY

    def fire(self, guard):
        self.moved = {}
        if guard == OPENS:
            if self.core_resistance is None and self.stray is None:
                self.moved = {0: 0.0}  # else the coil rings on
            self.closed = 0
            return
        s = 1 if guard in (FALLS, RISES) else -1
        kept, voltage = self.kept[s], s * float(self.voltage[0])
        if kept in (CHARGED, PULLED):
            self.let_go(s)
        elif guard >= RISES:
            # Exactly so: else it would be charged again as soon as the voltage has turned.
            self.kept[s], self.moved = CHARGED, {self.envelope(s): voltage - self.diode_drop}
        elif kept == FULL:
            self.kept[s], self.closed, self.moved = USED, s, {self.envelope(s): 0.0}
        elif kept == USED and self.closed != s:
            self.kept[s] = EMPTY
        else:
            self.kept[s] = PULLED
            if not self.base_resistance:
                self.moved = {self.envelope(s): voltage + self.threshold}

    def blocked(self, z):
        for n, value in self.moved.items():
            z[n] = value


class SelfPoweredSECE(Breaking):
    """The breaker opens where the electrodes are empty, and what is in the coil goes to the load."""

    path_diodes = 2
    guard_count = 6

    def guards(self, z, v, i):
        found = super().guards(z, v, i)
        if self.closed:
            found[FURTHER] = -self.closed * v
        return found

    def fire(self, guard):
        if guard == FURTHER:
            self.closed, self.moved = 0, {0: 0.0}
        else:
            super().fire(guard)


class SelfPoweredSeriesSSHI(Breaking, Rectifier):
    """Breakers and coil in line with a bridge."""

    path_diodes = 3
    guard_count = 5

    def meet(self, capacitance):
        super().meet(capacitance)
        # In line with the coil, and with its switch where that charges a winding.
        self.resistance += self.path_resistance
        if self.stray is not None:
            self.switch_resistance = (self.switch_resistance or 0.0) + self.path_resistance

    def inner(self, z, v, free, elastance):
        across = v - self.closed * (self.drop + self.dc(z))
        self.path = self.loop_current(z, across)
        return self.path + self.beside, (self.loop_rates(z, across), self.dc_rates(z, self.closed * self.path))

    def dc_current(self, z, v, i):
        return self.closed * self.path if self.load_resistance is None else self.conductance * self.dc(z)


class SelfPoweredSSHI(Breaking, Rectifier):
    """Breakers and coil beside a bridge, whose conducting sign is `sign`."""

    through: np.ndarray  # current of the bridge, A

    def inner(self, z, v, free, elastance):
        across = v - self.closed * self.drop
        self.path = self.loop_current(z, across)
        i, dc = self.bridge_flow(z, v, free, elastance, beside=self.path + self.beside)
        self.through = i - self.path - self.beside - self.diode_leakage * v
        return i, (self.loop_rates(z, across), dc)

    @property
    def holds(self) -> bool:
        """Whether the voltage stays where it is while the bridge conducts."""
        return self.dc_voltage is not None and not self.path_resistance

    def may_charge(self, sign):
        return super().may_charge(sign) and not (self.sign and self.holds)

    def may_pull(self, sign):
        return super().may_pull(sign) and not (self.sign and self.holds and not self.base_resistance)

    def guards(self, z, v, i):
        found = super().guards(z, v, i)
        if self.sign:
            found[FURTHER] = -self.sign * self.impedance * self.through
            return found
        for n, s in enumerate((1, -1)):
            if self.kept[s] != PULLED:
                found[FURTHER + n] = s * v - self.limit(z)
        return found

    def fire(self, guard):
        if guard < FURTHER:
            super().fire(guard)
            return
        self.sign, self.moved = 0 if self.sign else 1 - 2 * (guard - FURTHER), {}
        if self.sign and self.holds:
            for s in (1, -1):
                if self.moves_along(s):
                    self.let_go(s)

    def dc_current(self, z, v, i):
        return self.sign * self.through if self.load_resistance is None else self.conductance * self.dc(z)


BREAKING: dict[str, type[Circuit]] = {
    "self_powered_sece": SelfPoweredSECE,
    "self_powered_series_sshi": SelfPoweredSeriesSSHI,
    "self_powered_sshi": SelfPoweredSSHI,
    "self_powered_ssdi": Breaking,
}
