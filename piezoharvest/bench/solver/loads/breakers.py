"""Loads of the solver whose switches find the extrema of the voltage by themselves, written from docs/equations.md."""

from __future__ import annotations

import numpy as np

from piezoharvest.bench.solver.loads.circuits import Circuit, Rectifier
from piezoharvest.bench.solver.loads.switched import SSDI

# Slots of the guards: a breaker opens, or closes (after a maximum, a minimum), an envelope turns or follows (maxima,
# minima), and what circuits add: a bridge, or empty electrodes.
OPENS, CLOSES, FOLLOWS, FURTHER = 0, 1, 3, 5
PACE = 25.0  # sqrt(L C) times this is of the size of the time in which the voltage moves, for the size of its rate


class Breaking(SSDI):
    """A coil behind two breakers; states are those of the coil, both envelope voltages, and of a dc side.

    `position` is 0 while both are open, s while that of the sign s conducts, and 2 s once its current has ended, until
    the voltage is below a diode's drop. `following` is the sign of the voltage that charges its envelope capacitor,
    `charged` are the signs of those that have a charge.
    """

    envelope_capacitance: float
    threshold: float
    diode_drop: float
    breaker_drop: float | None
    on_time_error = 0.0
    path_diodes = 1
    guard_count = 7
    sign = position = following = 0
    charged: frozenset[int] = frozenset()
    moved: dict[int, float]  # states that the last change of the branch moves, and where to
    rise: np.ndarray  # of the voltage, V/s
    path: np.ndarray  # current of the closed breaker, A

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
    def closed(self) -> int:
        """Sign of the voltage whose breaker conducts, 0 if none does."""
        return self.position if abs(self.position) == 1 else 0

    @property
    def branch(self) -> int:
        """Signs of bridge and envelope, position and charges in one number."""
        charges = (1 in self.charged) + 2 * (-1 in self.charged)
        return (self.sign + 1) + 3 * (self.following + 1) + 9 * (self.position + 2) + 45 * charges

    @branch.setter
    def branch(self, value: int) -> None:
        charges, rest = divmod(value, 45)
        self.charged = frozenset(s for s, bit in ((1, 1), (-1, 2)) if charges & bit)
        self.position, rest = rest // 9 - 2, rest % 9
        self.following, self.sign = rest // 3 - 1, rest % 3 - 1

    @property
    def conducting(self) -> int:
        return self.sign

    def envelope(self, sign: int) -> int:
        """Number of the state that is the voltage of an envelope capacitor."""
        return self.coil_states + (sign < 0)

    def flow(self, z, v, free, elastance):
        # A capacitor across the leads is one more of the electrodes.
        beside = self.envelope_capacitance if self.following else 0.0
        share = 1.0 / (1.0 + beside * elastance)
        i, (coil, further) = self.inner(z, v, share * free, share * elastance)
        self.rise = share * (free - elastance * i)
        rises = [self.rise * s if self.following == s else 0.0 * v for s in (1, -1)]
        return i + beside * self.rise, (*coil, *rises, *further)

    def inner(self, z, v, free, elastance) -> tuple[np.ndarray, tuple]:
        """Current without that of the envelopes, and the rates of the coil's states and of further ones."""
        across = v - self.closed * self.drop
        self.path = self.loop_current(z, across)
        return self.path, (self.loop_rates(z, across), ())

    def guards(self, z, v, i):
        never = 0.0 * v - 1.0
        found = [never] * self.guard_count
        if self.closed:
            found[OPENS] = -self.closed * self.impedance * self.path
        elif self.position:
            found[OPENS] = self.diode_drop - np.sign(self.position) * v
        for n, s in enumerate((1, -1)):
            held = z[self.envelope(s)]
            if not self.position and s in self.charged and self.following != s:
                found[CLOSES + n] = held - s * v - self.threshold
            if not self.following and self.may_follow(s):
                found[FOLLOWS + n] = s * v - held - self.diode_drop
        if self.following:
            found[FOLLOWS] = -self.following * self.pace * self.rise
        return found

    def may_follow(self, sign: int) -> bool:
        """Whether the voltage of this sign can charge its envelope capacitor: not while a breaker keeps it empty."""
        return self.position * sign <= 0 and self.sign != -sign

    def fire(self, guard):
        self.moved = {}
        if guard == OPENS:
            if self.closed and self.core_resistance is None and self.stray is None:
                self.moved = {0: 0.0}  # else the coil rings on
            self.position = 2 * self.closed
        elif guard < FOLLOWS:
            self.position = 1 if guard == CLOSES else -1
            self.charged, self.moved = self.charged - {self.position}, {self.envelope(self.position): 0.0}
        elif self.following:
            self.following = 0
        else:
            self.following = 1 if guard == FOLLOWS else -1
            self.charged |= {self.following}
            # Exactly so: else it would follow again as soon as it has turned.
            held = self.following * float(self.voltage[0]) - self.diode_drop
            self.moved = {self.envelope(self.following): held}

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
            self.position, self.moved = 2 * self.closed, {0: 0.0}
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
        return self.path, (self.loop_rates(z, across), self.dc_rates(z, self.closed * self.path))

    def dc_current(self, z, v, i):
        return self.closed * self.path if self.load_resistance is None else self.conductance * self.dc(z)


class SelfPoweredSSHI(Breaking, Rectifier):
    """Breakers and coil beside a bridge, whose conducting sign is `sign`."""

    through: np.ndarray  # current of the bridge, A

    def inner(self, z, v, free, elastance):
        across = v - self.closed * self.drop
        self.path = self.loop_current(z, across)
        i, dc = self.bridge_flow(z, v, free, elastance, beside=self.path)
        self.through = i - self.path - self.diode_leakage * v
        return i, (self.loop_rates(z, across), dc)

    @property
    def holds(self) -> bool:
        """Whether the voltage stays where it is while the bridge conducts."""
        return self.dc_voltage is not None and not self.path_resistance

    def may_follow(self, sign):
        return super().may_follow(sign) and not (self.sign and self.holds)

    def guards(self, z, v, i):
        found = super().guards(z, v, i)
        if self.sign:
            found[FURTHER] = -self.sign * self.impedance * self.through
            return found
        for n, s in enumerate((1, -1)):
            if self.holds or self.following != -s:
                found[FURTHER + n] = s * v - self.limit(z)
        return found

    def fire(self, guard):
        if guard < FURTHER:
            super().fire(guard)
            return
        self.sign, self.moved = 0 if self.sign else 1 - 2 * (guard - FURTHER), {}
        if self.sign and self.holds:
            self.following = 0

    def dc_current(self, z, v, i):
        return self.sign * self.through if self.load_resistance is None else self.conductance * self.dc(z)


BREAKING: dict[str, type[Circuit]] = {
    "self_powered_sece": SelfPoweredSECE,
    "self_powered_series_sshi": SelfPoweredSeriesSSHI,
    "self_powered_sshi": SelfPoweredSSHI,
    "self_powered_ssdi": Breaking,
}
