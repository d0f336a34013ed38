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
    stage = 0  # while it is closed it goes through stages

    def driven(self, period: float | None) -> None:
        """Set the switch's timing for an excitation of this period (s), or of none."""
        lag = self.time_lag + (self.phase_lag * period / (2.0 * math.pi) if period else 0.0)
        hold_off = (0.25 * period if period else 0.0) if self.hold_off is None else self.hold_off
        self.switch = Switch(lag, hold_off, 0.5 * period if period else 0.0, self.detector_threshold)

    def act(self, z: np.ndarray) -> bool:
        """Carry out what is due; True if the electrodes are to be discharged at once."""
        switch = self.switch
        if switch.opening <= switch.due:
            times, self.stage = self.stage_times(), self.stage + 1
            if self.stage < len(times):
                switch.opening += times[self.stage]
            else:
                switch.opening, self.closed, self.stage = math.inf, 0, 0
            self.opened(z)
            return False
        when, kind = switch.planned.pop(0)
        if self.closed:
            return False
        self.closed = kind
        times = self.stage_times()
        switch.pulses.append((when, when + sum(times)))
        if not sum(times):
            self.closed = 0
            return True
        switch.opening = when + times[0]
        return False

    def stage_times(self) -> tuple[float, ...]:
        """Length of each stage of the switch that has just closed, s."""
        return (self.on_time,)

    def opened(self, z: np.ndarray) -> None:
        """Change the circuit's states when the switch opens or goes on to its next stage."""


class SSDI(Switched, Circuit):
    """Inductance and resistance of the switched loop across the electrodes; the state is its current.

    The loop rings with the clamped capacitance C: Q = sqrt(L/C)/R, w_d^2 = 1/(L C) - (R/2L)^2, closed for pi/w_d.
    """

    quality: float
    inductance: float | None
    flip_time: float | None
    on_time_error: float
    switch_resistance: float | None = None
    source_voltage = 0.0

    def meet(self, capacitance):
        damped = math.sqrt(1.0 - 0.25 / self.quality**2)  # w_d over 1/sqrt(L C)
        if self.inductance is None:
            assert self.flip_time is not None  # one of the two is given
            self.inductance = (self.flip_time * damped / math.pi) ** 2 / capacitance
        impedance = math.sqrt(self.inductance / capacitance)
        self.resistance = impedance / self.quality + (self.switch_resistance or 0.0)
        damped = math.sqrt(1.0 - 0.25 * (self.resistance / impedance) ** 2)
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


class Staged(Switched):
    """Diodes, whose conducting sign is `sign`, and a switch with stages."""

    sign = 0

    @property
    def branch(self) -> int:
        """Sign of the diodes, kind of the extremum and stage in one number."""
        return self.sign + 3 * self.closed + 9 * self.stage

    @branch.setter
    def branch(self, value: int) -> None:
        self.stage = round(value / 9)
        self.closed = round((value - 9 * self.stage) / 3)
        self.sign = value - 9 * self.stage - 3 * self.closed

    @property
    def conducting(self) -> int:
        """Sign of the voltage at which the bridge conducts."""
        return self.sign

    def fire(self, guard: int) -> None:
        """Begin or cease to conduct."""
        self.sign = 0 if self.sign else 1 - 2 * guard


class SSHC(Staged, Rectifier):
    """Bridge and switched capacitors; states are their voltages and the dc voltage.

    Stage k of 2 n + 1 connects capacitor k, later 2 n - k, with the other sign; the middle one shorts the electrodes.
    """

    flip_capacitances: tuple[float, ...]
    switch_resistance: float
    phase_time: float | None
    on_time_error: float

    def meet(self, capacitance):
        phase = 10.0 * self.switch_resistance * capacitance if self.phase_time is None else self.phase_time
        self.phase = phase * (1.0 + self.on_time_error)
        self.storage = (*self.flip_capacitances, *self.storage)

    def stage_times(self):
        return (self.phase,) * (2 * len(self.flip_capacitances) + 1)

    def path(self, z, v):
        """Current of the closed switches, with the number of the capacitor they lead to, if any, and its sign."""
        count = len(self.flip_capacitances)
        if not self.closed:
            return 0.0 * v, None, 0
        if self.stage == count:
            return v / self.switch_resistance, None, 0
        first = self.stage < count
        which, side = (self.stage, -self.closed) if first else (2 * count - self.stage, self.closed)
        return (v - side * z[which]) / self.switch_resistance, which, side

    def flow(self, z, v, free, elastance):
        beside, which, side = self.path(z, v)
        i, rates = self.bridge_flow(z, v, free, elastance, beside=beside)
        own = (side * beside / c if n == which else 0.0 * v for n, c in enumerate(self.flip_capacitances))
        return i, (*own, *rates)

    def guards(self, z, v, i):
        return super().guards(z, v, i - self.path(z, v)[0])

    def dc_current(self, z, v, i):
        return super().dc_current(z, v, i - self.path(z, v)[0])


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
        opposed = v - self.sign * self.limit(z) - self.path_resistance * z[0]
        rate = self.loop_rate(z[0], opposed) if self.sign else 0.0 * v
        return z[0], (rate, *self.dc_rates(z, self.sign * z[0]))

    def guards(self, z, v, i):
        if not self.closed:
            return [0.0 * v - 1.0, 0.0 * v - 1.0]
        if self.sign:
            return [-self.sign * z[0], 0.0 * v - 1.0]
        limit = self.limit(z)
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


class BiasFlip(Staged, SSDI, Rectifier):
    """Bridge and a coil that swings in steps; states are its current, the bias capacitors and the dc voltage."""

    steps: int
    bias_capacitance: float | None

    def meet(self, capacitance):
        super().meet(capacitance)
        bias = 1e5 * capacitance if self.bias_capacitance is None else self.bias_capacitance
        coil, *rest = self.storage
        stiffness = 1.0 / capacitance + 1.0 / bias
        assert self.inductance is not None  # set above
        swing = math.sqrt(stiffness / self.inductance - (0.5 * self.resistance / self.inductance) ** 2)
        self.biased_time = math.pi / swing * (1.0 + self.on_time_error)
        self.bias, self.storage = bias, (coil, *(bias for _ in range(self.steps // 2)), *rest)

    def stage_times(self):
        middle = [2 * k == self.steps - 1 for k in range(self.steps)]
        return tuple(self.on_time if alone else self.biased_time for alone in middle)

    def side(self):
        """The bias capacitor in line, or None, and the sign with which it is."""
        if not self.closed or 2 * self.stage == self.steps - 1:
            return None, 0
        first = 2 * self.stage < self.steps
        return (self.stage, -self.closed) if first else (self.steps - 1 - self.stage, self.closed)

    def flow(self, z, v, free, elastance):
        which, sign = self.side()
        i, rates = self.bridge_flow(z, v, free, elastance, beside=z[0])
        across = v if which is None else v - sign * z[1 + which]
        own = (sign * z[0] / self.bias if n == which else 0.0 * v for n in range(self.steps // 2))
        return i, (self.loop_rate(z[0], across), *own, *rates)

    def guards(self, z, v, i):
        return super(SSDI, self).guards(z, v, i - z[0])

    def dc_current(self, z, v, i):
        return super().dc_current(z, v, i - z[0])


def emptying(inductance: float, resistance: float, capacitance: float) -> float:
    """First time at which a capacitance, discharged through a coil and its resistance, has no voltage, s."""
    poles = np.roots([inductance, resistance, 1.0 / capacitance])
    swing, decay = abs(poles[0].imag), -poles[0].real
    return float((math.pi - math.atan2(swing, decay)) / swing)


class Extracting(Staged, SSDI):
    """Charge goes through a bridge into a coil while the switch is closed; the state is the coil's current."""

    diode_drop: float
    diode_resistance: float

    def meet(self, capacitance):
        super().meet(capacitance)
        time = emptying(self.inductance or 0.0, self.resistance, capacitance)
        self.emptying = time * (1.0 + self.on_time_error)

    def act(self, z):
        discharged = super().act(z)
        self.sign = self.way()
        return discharged

    def way(self) -> int:
        """Sign of the voltage for which the bridge leads to the coil: it is lowest at a maximum."""
        return -self.closed if self.closed and not self.stage else 0

    def stage_times(self):
        return (self.emptying,)

    def flow(self, z, v, free, elastance):
        lost = (self.resistance + 2.0 * self.diode_resistance) * z[0] + 2.0 * self.diode_drop * self.sign
        return z[0], ((v - lost) / self.inductance if self.sign else 0.0 * v,)

    guard_count = 2

    def guards(self, z, v, i):
        return [-self.sign * z[0] if self.sign else 0.0 * v - 1.0, 0.0 * v - 1.0]

    def fire(self, guard):
        self.sign = 0

    def blocked(self, z):
        if not self.sign:
            z[0] = 0.0


class SSDS(SSDI):
    """Short of the electrodes until its own swing would have emptied them; at once without an inductance."""

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
        rate = self.loop_rate(z[0], opposed) if self.sign else 0.0 * v
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

    def meet(self, capacitance):
        super().meet(capacitance)
        self.storage = (*self.storage, self.second_inductance)
        impedance = math.sqrt(self.second_inductance / self.intermediate_capacitance)
        self.second_resistance = impedance / self.second_quality
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


SWITCHED: dict[str, type[Circuit]] = {
    "parallel_sshi": ParallelSSHI,
    "series_sshi": SeriesSSHI,
    "sshc": SSHC,
    "bias_flip": BiasFlip,
    "sece": SECE,
    "sice": SICE,
    "sc_sece": SCSECE,
    "dssh": DSSH,
    "essh": ESSH,
    "ssds": SSDS,
    "ssdi": SSDI,
    "ssdv": SSDV,
}
