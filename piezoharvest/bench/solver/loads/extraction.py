"""Loads of the solver with a switch that takes the charge off the electrodes, written from docs/equations.md."""

from __future__ import annotations

import math

import numpy as np

from piezoharvest.bench.solver.loads.circuits import Circuit
from piezoharvest.bench.solver.loads.switched import SSDI, Staged


def emptying(inductance: float, resistance: float, capacitance: float) -> float:
    """First time at which a capacitance, discharged through a coil and its resistance, has no voltage, s."""
    poles = np.roots([inductance, resistance, 1.0 / capacitance])
    swing, decay = abs(poles[0].imag), -poles[0].real
    return float((math.pi - math.atan2(swing, decay)) / swing)


class Extracting(Staged, SSDI):
    """Charge goes through a bridge into a coil while the switch is closed; the state is the coil's current.

    Once the electrodes are empty, the current goes round through both halves of the bridge, which short them.
    """

    real_coil = False
    round = False

    diode_drop: float
    diode_resistance: float

    def meet(self, capacitance):
        super().meet(capacitance)
        time = emptying(self.inductance or 0.0, self.resistance, capacitance)
        self.emptying = time * (1.0 + self.on_time_error)

    @property
    def branch(self) -> int:
        """As of other circuits with stages, and whether the current goes round through the bridge."""
        return super().branch + 100 * self.round

    @branch.setter
    def branch(self, value: int) -> None:
        self.round = value > 50
        set_staged = Staged.branch.fset
        assert set_staged is not None  # it has one
        set_staged(self, value - 100 * self.round)

    def act(self, z):
        before = self.closed, self.stage
        discharged = super().act(z)
        if (self.closed, self.stage) != before:  # an action that finds the switch closed changes nothing
            self.sign, self.round = self.way(), False
        return discharged

    def way(self) -> int:
        """Sign of the voltage for which the bridge leads to the coil: it is lowest at a maximum."""
        return -self.closed if self.closed and not self.stage else 0

    def stage_times(self):
        return (self.emptying,)

    def flow(self, z, v, free, elastance):
        line, drops = 2.0 * self.diode_resistance, 2.0 * self.diode_drop * self.sign
        if self.round:
            shorted = v / self.diode_resistance if self.diode_resistance else free / elastance
            return shorted, (-((self.resistance + 0.5 * line) * z[0] + drops) / self.inductance,)
        rate = (v - (self.resistance + line) * z[0] - drops) / self.inductance
        return z[0], (rate if self.sign else 0.0 * v,)

    def tied(self, z):
        return 0.0 * z[0] if self.round and not self.diode_resistance else None

    guard_count = 2

    @property
    def guard_units(self):
        return ["A", "A" if self.round else "V"][: self.guard_count]

    def guards(self, z, v, i):
        if not self.sign:
            return [0.0 * v - 1.0, 0.0 * v - 1.0]
        current = self.sign * z[0]
        return [-current, self.sign * i - current if self.round else -self.sign * v]

    def fire(self, guard):
        if guard:
            self.round = not self.round
        else:
            self.sign, self.round = 0, False

    def blocked(self, z):
        if not self.sign:
            z[0] = 0.0


class SSDS(SSDI):
    """Short of the electrodes until its own swing would have emptied them; at once without an inductance."""

    real_coil = False

    quality: float | None

    def meet(self, capacitance):
        if self.inductance is not None:
            super().meet(capacitance)
            self.on_time = emptying(self.inductance, self.resistance, capacitance) * (1.0 + self.on_time_error)

    def flow(self, z, v, free, elastance):
        return (0.0 * v, ()) if self.inductance is None else super().flow(z, v, free, elastance)

    def opened(self, z):
        z[:] = 0.0


class SECE(Extracting):
    """At once without a coil."""

    quality: float | None

    def meet(self, capacitance):
        if self.inductance is None:
            self.guard_count, self.emptying = 0, 0.0
        else:
            super().meet(capacitance)

    def flow(self, z, v, free, elastance):
        return (0.0 * v, ()) if self.inductance is None else super().flow(z, v, free, elastance)

    def guards(self, z, v, i):
        return [] if self.inductance is None else super().guards(z, v, i)

    def opened(self, z):
        z[:] = 0.0

    def blocked(self, z):
        if self.inductance is not None:
            super().blocked(z)


class SICE(Extracting):
    """After a minimum the coil inverts the voltage; both currents are states, that of the inversion first."""

    def meet(self, capacitance):
        super().meet(capacitance)
        self.storage = self.storage * 2

    def way(self):
        return -1 if self.closed > 0 else 0

    def stage_times(self):
        return (self.emptying,) if self.closed > 0 else (self.on_time,)

    def flow(self, z, v, free, elastance):
        i, (rate,) = super().flow(z[1:], v, free, elastance)
        swing = (v - self.resistance * z[0]) / self.inductance if self.closed < 0 else 0.0 * v
        return z[0] + i, (swing, rate)

    def guards(self, z, v, i):
        return super().guards(z[1:], v, i)

    def blocked(self, z):
        super().blocked(z[1:])

    def opened(self, z):
        z[:2] = 0.0


class SCSECE(Extracting):
    """After the extraction the loop's resistance shorts the electrodes."""

    short_time: float

    def stage_times(self):
        return self.emptying, self.short_time

    def flow(self, z, v, free, elastance):
        i, rates = super().flow(z, v, free, elastance)
        return (i + v / self.resistance if self.stage else i), rates


class DSSH(Staged, SSDI):
    """A bridge in line with the coil charges a capacitor, which is emptied when the switch opens; its state is last."""

    real_coil = False

    intermediate_capacitance: float
    diode_drop: float
    diode_resistance: float
    guard_count = 2

    def meet(self, capacitance):
        super().meet(capacitance)
        self.storage = (*self.storage, self.intermediate_capacitance)

    def dc(self, z):
        return z[1]

    def flow(self, z, v, free, elastance):
        opposed = v - self.sign * (z[1] + 2.0 * self.diode_drop) - 2.0 * self.diode_resistance * z[0]
        (rate,) = self.loop_rates(z, opposed)[:1] if self.sign else (0.0 * v,)
        return z[0], (rate, self.sign * z[0] / self.intermediate_capacitance)

    def guards(self, z, v, i):
        if not self.closed:
            return [0.0 * v - 1.0, 0.0 * v - 1.0]
        if self.sign:
            return [-self.sign * z[0], 0.0 * v - 1.0]
        limit = z[1] + 2.0 * self.diode_drop
        return [v - limit, -v - limit]

    def blocked(self, z):
        if not self.sign:
            z[0] = 0.0

    def opened(self, z):
        z[:2], self.sign = 0.0, 0


class ESSH(DSSH):
    """The capacitor's energy goes in part through a second coil, whose current is the last state."""

    second_inductance: float
    second_quality: float
    residual: float
    second_switch_resistance: float | None = None

    def meet(self, capacitance):
        super().meet(capacitance)
        self.storage = (*self.storage, self.second_inductance)
        impedance = math.sqrt(self.second_inductance / self.intermediate_capacitance)
        self.second_resistance = impedance / self.second_quality + (self.second_switch_resistance or 0.0)
        self.transfer = math.acos(self.residual) * impedance * self.intermediate_capacitance

    def stage_times(self):
        return (self.on_time, self.transfer)

    def flow(self, z, v, free, elastance):
        i, (rate, charging) = super().flow(z, v, free, elastance)
        second = (z[1] - self.second_resistance * z[2]) / self.second_inductance if self.stage else 0.0 * v
        return i, (rate, charging - z[2] / self.intermediate_capacitance, second)

    def guards(self, z, v, i):
        return [0.0 * v - 1.0, 0.0 * v - 1.0] if self.stage else super().guards(z, v, i)

    def opened(self, z):
        z[0], z[2], self.sign = 0.0, 0.0, 0


EXTRACTING: dict[str, type[Circuit]] = {
    "sece": SECE,
    "sice": SICE,
    "sc_sece": SCSECE,
    "dssh": DSSH,
    "essh": ESSH,
    "ssds": SSDS,
}
