"""Loads of the solver with a switch that acts at the extrema of sum T_i x_i, written from docs/equations.md.

A switch changes a circuit at instants of its own: planned after an extremum, and its opening after the on-time.
"""

from __future__ import annotations

import math

import numpy as np

from piezoharvest.bench.solver.circuits import Circuit, Rectifier

# Share of the hold-off by which rounding may bring the next action forward.
ROUNDING = 1e-9


class Switch:
    """When a switch acts: planned actions, the one opening that is due, and the pulses so far.

    Attributes
    ----------
    side : int
        Direction in which sum T_i x_i moves, 0 at rest.
    opening : float
        When the closed switch opens, s; infinite while it is open.
    pulses : list of (float, float)
        When it has closed, and when it opened, s.
    """

    def __init__(self, lag: float, hold_off: float, half_period: float, threshold: float) -> None:
        self.lag, self.hold_off, self.half_period, self.threshold = lag, hold_off, half_period, threshold
        self.side, self.last, self.opening = 0, -math.inf, math.inf
        self.planned: list[tuple[float, int]] = []
        self.pulses: list[tuple[float, float]] = []

    @property
    def due(self) -> float:
        """Next instant at which something happens, s."""
        return min(self.opening, self.planned[0][0] if self.planned else math.inf)

    def guards(self, strain_current: np.ndarray) -> tuple[np.ndarray | float, np.ndarray | float]:
        """Two values below zero until the next extremum, or until the motion begins."""
        if self.side:
            return -self.side * strain_current, 0.0 * strain_current - 1.0
        return strain_current, -strain_current

    def turn(self, guard: int, time: float, voltage: float) -> None:
        """Note that the motion has begun, or an extremum with the electrode voltage at it; plan what follows."""
        if not self.side:
            self.side = 1 - 2 * guard
            return
        kind, self.side = self.side, -self.side
        when = time + self.lag
        if self.lag < 0.0:  # before the coming extremum, of the other kind, half a period from this one
            kind, when = -kind, when + self.half_period
        if abs(voltage) >= self.threshold and when - self.last >= self.hold_off * (1.0 - ROUNDING):
            self.last = when
            self.planned.append((when, kind))


class Switched:
    """What all circuits with a switch have in common: the key `time_lag` and so on of their tables.

    The switch is open where `closed` is 0, else the kind of the extremum: 1 for a maximum.
    """

    phase_lag: float
    time_lag: float
    hold_off: float | None
    detector_threshold: float
    closed = 0
    on_time = 0.0

    def driven(self, period: float | None) -> None:
        """Set the switch's timing for an excitation of this period (s), or of none."""
        lag = self.time_lag + (self.phase_lag * period / (2.0 * math.pi) if period else 0.0)
        hold_off = (0.25 * period if period else 0.0) if self.hold_off is None else self.hold_off
        self.switch = Switch(lag, hold_off, 0.5 * period if period else 0.0, self.detector_threshold)

    def act(self, z: np.ndarray) -> bool:
        """Carry out what is due; True if the electrodes are to be discharged at once."""
        switch = self.switch
        if switch.opening <= switch.due:
            switch.opening, self.closed = math.inf, 0
            self.opened(z)
            return False
        when, kind = switch.planned.pop(0)
        if self.closed:
            return False
        switch.pulses.append((when, when + self.on_time))
        if not self.on_time:
            return True
        self.closed, switch.opening = kind, when + self.on_time
        return False

    def opened(self, z: np.ndarray) -> None:
        """Change the circuit's states when the switch opens."""


class Discharge(Switched, Circuit):
    """SSDS and SECE: open electrodes whose voltage is taken to zero at once."""


class SSDI(Switched, Circuit):
    """Inductance and resistance of the switched loop across the electrodes; the state is its current.

    The loop rings with the clamped capacitance C: Q = sqrt(L/C)/R, w_d^2 = 1/(L C) - (R/2L)^2, closed for pi/w_d.
    """

    quality: float
    inductance: float | None
    flip_time: float | None
    on_time_error: float
    source_voltage = 0.0

    def meet(self, capacitance):
        damped = math.sqrt(1.0 - 0.25 / self.quality**2)  # w_d over 1/sqrt(L C)
        if self.inductance is None:
            assert self.flip_time is not None  # one of the two is given
            self.inductance = (self.flip_time * damped / math.pi) ** 2 / capacitance
        self.resistance = math.sqrt(self.inductance / capacitance) / self.quality
        self.on_time = math.pi * math.sqrt(self.inductance * capacitance) / damped * (1.0 + self.on_time_error)
        self.surge = math.sqrt(capacitance / self.inductance)
        self.storage = (self.inductance, *self.storage)

    @property
    def branch(self) -> int:
        """Kind of the extremum at which the switch has closed, 0 while it is open."""
        return self.closed

    @branch.setter
    def branch(self, value: int) -> None:
        self.closed = value

    def loop_rate(self, current, across):
        """Rate of the loop's current with a voltage across it."""
        return (across - self.resistance * current) / self.inductance if self.closed else 0.0 * current

    def flow(self, z, v, free, elastance):
        return z[0], (self.loop_rate(z[0], v - self.closed * self.source_voltage),)

    def opened(self, z):
        z[0] = 0.0


class SSDV(SSDI):
    """A source in the loop: after a maximum, at which the voltage is lowest, it drives it further up."""

    source_voltage: float


class ParallelSSHI(SSDI, Rectifier):
    """Bridge and switched loop side by side; states are the loop's current and the dc voltage.

    `sign` is that of the voltage at which the bridge conducts, 0 while it blocks.
    """

    sign = 0

    @property
    def branch(self) -> int:
        """Both signs in one number."""
        return self.sign + 3 * self.closed

    @branch.setter
    def branch(self, value: int) -> None:
        self.closed = round(value / 3)
        self.sign = value - 3 * self.closed

    @property
    def conducting(self) -> int:
        return self.sign

    def flow(self, z, v, free, elastance):
        i, rates = self.bridge_flow(z, v, free, elastance, beside=z[0])
        return i, (self.loop_rate(z[0], v), *rates)

    def guards(self, z, v, i):
        return super(SSDI, self).guards(z, v, i - z[0])

    def dc_current(self, z, v, i):
        return super().dc_current(z, v, i - z[0])

    def fire(self, guard):
        self.sign = 0 if self.sign else 1 - 2 * guard


class SeriesSSHI(ParallelSSHI):
    """Bridge in line with the switched loop: it conducts while the switch is closed, and blocks at zero current."""

    def flow(self, z, v, free, elastance):
        opposed = v - self.sign * (self.dc(z) + 2.0 * self.diode_drop)
        rate = self.loop_rate(z[0], opposed) if self.sign else 0.0 * v
        return z[0], (rate, *self.dc_rates(z, self.sign * z[0]))

    def guards(self, z, v, i):
        if not self.closed:
            return [0.0 * v - 1.0, 0.0 * v - 1.0]
        if self.sign:
            return [-self.sign * z[0], 0.0 * v - 1.0]
        limit = self.dc(z) + 2.0 * self.diode_drop
        return [v - limit, -v - limit]

    def dc_current(self, z, v, i):
        return self.sign * z[0] if self.load_resistance is None else self.conductance * self.dc(z)

    def tied(self, z):
        return None

    def blocked(self, z):
        if not self.sign:
            z[0] = 0.0

    def opened(self, z):
        z[0], self.sign = 0.0, 0


SWITCHED: dict[str, type[Circuit]] = {
    "parallel_sshi": ParallelSSHI,
    "series_sshi": SeriesSSHI,
    "sece": Discharge,
    "ssds": Discharge,
    "ssdi": SSDI,
    "ssdv": SSDV,
}
