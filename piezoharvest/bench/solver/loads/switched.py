"""Loads of the solver with a switch that acts at the extrema of sum T_i x_i, written from docs/equations.md.

A switch changes a circuit at instants of its own: planned after an extremum, and its opening after the on-time.
"""

from __future__ import annotations

import math

import numpy as np

from piezoharvest.bench.solver.loads.circuits import Circuit, Rectifier
from piezoharvest.bench.solver.loads.switch import Switch
from piezoharvest.description.parameters import ParameterError


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
    """Inductance and resistance of the switched loop across the electrodes; the state is the inductance's current.

    The loop rings with the clamped capacitance C: Q = sqrt(L/C)/R, w_d^2 = 1/(L C) - (R/2L)^2, closed for pi/w_d. The
    core is a resistance beside the inductance. With a self-resonance, a second state is the voltage of the winding's
    capacitance, which the switch charges through its own resistance; both ring on while the switch is open.
    """

    quality: float
    inductance: float | None
    flip_time: float | None
    on_time_error: float
    switch_resistance: float | None = None
    core_resistance: float | None = None
    self_resonance: float | None = None
    source_voltage = 0.0
    real_coil = True

    def meet(self, capacitance):
        damped = math.sqrt(1.0 - 0.25 / self.quality**2)  # w_d over 1/sqrt(L C)
        if self.inductance is None:
            assert self.flip_time is not None  # one of the two is given
            self.inductance = (self.flip_time * damped / math.pi) ** 2 / capacitance
        impedance = math.sqrt(self.inductance / capacitance)
        self.wound = impedance / self.quality  # ohm, of the winding alone
        self.resistance = self.wound + (self.switch_resistance or 0.0)
        if self.resistance >= 2.0 * impedance:
            allowed = f"must be less than {2.0 * impedance - self.wound:.4g} ohm, with which the voltage swings"
            raise ParameterError("switch_resistance", f"found {self.switch_resistance} ohm, {allowed}")
        damped = math.sqrt(1.0 - 0.25 * (self.resistance / impedance) ** 2)
        self.on_time = math.pi * math.sqrt(self.inductance * capacitance) / damped * (1.0 + self.on_time_error)
        self.surge = math.sqrt(capacitance / self.inductance)
        self.stray = None
        if self.self_resonance is not None:
            self.stray = 1.0 / ((2.0 * math.pi * self.self_resonance) ** 2 * self.inductance)
        self.storage = (self.inductance, *(() if self.stray is None else (self.stray,)), *self.storage)

    @property
    def branch(self) -> int:
        """Kind of the extremum at which the switch has closed, 0 while it is open."""
        return self.closed

    @branch.setter
    def branch(self, value: int) -> None:
        self.closed = value

    @property
    def coil_states(self) -> int:
        """Number of its states."""
        return 1 if self.stray is None else 2

    def loop_current(self, z, across):
        """Current into the closed loop with a voltage across it."""
        if not self.closed:
            return 0.0 * across
        if self.stray is not None:
            return (across - z[1]) / self.switch_resistance
        if self.core_resistance is not None:
            return (across + self.core_resistance * z[0]) / (self.resistance + self.core_resistance)
        return z[0] + 0.0 * across

    def loop_rates(self, z, across):
        """Rates of the coil's states with a voltage across the loop."""
        into, core = self.loop_current(z, across), self.core_resistance
        if self.stray is not None:
            wound = z[0] if core is None else (z[1] + core * z[0]) / (self.wound + core)
            return (z[1] - self.wound * wound) / self.inductance, (into - wound) / self.stray
        if core is not None:
            return (core * (into - z[0]) / self.inductance,)
        return ((across - self.resistance * z[0]) / self.inductance if self.closed else 0.0 * z[0],)

    def flow(self, z, v, free, elastance):
        across = v - self.closed * self.source_voltage
        return self.loop_current(z, across), self.loop_rates(z, across)

    def opened(self, z):
        if self.stray is None:  # what is left in the inductance is cut, or goes to the core
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
        i, rates = self.bridge_flow(z, v, free, elastance, beside=self.loop_current(z, v))
        return i, (*self.loop_rates(z, v), *rates)

    def guards(self, z, v, i):
        return super(SSDI, self).guards(z, v, i - self.loop_current(z, v))

    def dc_current(self, z, v, i):
        return super().dc_current(z, v, i - self.loop_current(z, v))

    def fire(self, guard):
        self.sign = 0 if self.sign else 1 - 2 * guard


class SeriesSSHI(ParallelSSHI):
    """Bridge in line with the switched loop: it conducts while the switch is closed, and blocks at zero current."""

    real_coil = False

    def flow(self, z, v, free, elastance):
        opposed = v - self.sign * self.limit(z) - self.path_resistance * z[0]
        rates = self.loop_rates(z, opposed) if self.sign else (0.0 * v,)
        return z[0], (*rates, *self.dc_rates(z, self.sign * z[0]))

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
        coil, rest = self.storage[: self.coil_states], self.storage[self.coil_states :]
        stiffness = 1.0 / capacitance + 1.0 / bias
        assert self.inductance is not None  # set above
        swing = math.sqrt(stiffness / self.inductance - (0.5 * self.resistance / self.inductance) ** 2)
        self.biased_time = math.pi / swing * (1.0 + self.on_time_error)
        self.bias, self.storage = bias, (*coil, *(bias for _ in range(self.steps // 2)), *rest)

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
        (which, sign), across = self.side(), self.across(z, v)
        into = self.loop_current(z, across)
        i, rates = self.bridge_flow(z, v, free, elastance, beside=into)
        own = (sign * into / self.bias if n == which else 0.0 * v for n in range(self.steps // 2))
        return i, (*self.loop_rates(z, across), *own, *rates)

    def across(self, z, v):
        """Voltage across the loop, without the bias capacitor in line."""
        which, sign = self.side()
        return v if which is None else v - sign * z[self.coil_states + which]

    def guards(self, z, v, i):
        return super(SSDI, self).guards(z, v, i - self.loop_current(z, self.across(z, v)))

    def dc_current(self, z, v, i):
        return super().dc_current(z, v, i - self.loop_current(z, self.across(z, v)))


SWITCHED: dict[str, type[Circuit]] = {
    "parallel_sshi": ParallelSSHI,
    "series_sshi": SeriesSSHI,
    "sshc": SSHC,
    "bias_flip": BiasFlip,
    "ssdi": SSDI,
    "ssdv": SSDV,
}
