"""Loads for the solver: the current of each, given the electrodes' behaviour without load current.

Without load current the electrode voltage would change at the rate `free` (V/s), and a load current i reduces this by
`elastance` i (V/s). A circuit that constrains the voltage finds its current from that: its constraint holds in the
derivative, and held when it began.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from piezoharvest.bench.solver.loads.switch import Switch
from piezoharvest.description.shunts import Shunt

Flow = tuple[np.ndarray, Sequence[np.ndarray]]


class Circuit:
    """Open electrodes, and base class of all loads.

    Attributes
    ----------
    storage : tuple of float
        Inductance or capacitance of each of its states, H or F: energy is storage z^2/2.
    guard_count : int
        Number of guards.
    branch : int
        0, or the sign of the voltage at which a bridge conducts, and whether a switch is closed.
    surge : float
        Peak current of its switched loop per volt, A/V.
    switch : Switch or None
        Its timing, if it has one.
    guard_unit : "A" or "V"
        What its guards are.
    guard_units : sequence of "A", "V" or "S"
        The same of each guard; "S" is of the size of what a switch watches.
    smooth : bool
        It is nonlinear between events.
    active : bool
        It may feed energy into an oscillation that grows from rest.
    tracks : bool
        It waits to be told the open electrodes' voltage, by `track`.
    real_coil : bool
        Its coil may have a core loss and a self-resonance.
    turning, voltage : (instants,) array
        What controllers watch: sum T_i u_i (A), and the electrode voltage (V).
    """

    storage: tuple[float, ...] = ()
    guard_count = 0
    branch = 0
    surge = 0.0
    switch: Switch | None = None
    smooth = False
    active = False
    tracks = False
    real_coil = False
    turning: np.ndarray
    voltage: np.ndarray

    def __init__(self, shunt: Shunt) -> None:
        # Every key of the shunt's table as an attribute of that name.
        self.__dict__.update(vars(shunt))

    def meet(self, capacitance: float) -> None:
        """Set what depends on the transducer's clamped capacitance (F)."""

    def start(self) -> np.ndarray | float:
        """Its states at rest."""
        return 0.0

    def track(self, open_voltage: float) -> None:
        """Set what depends on the peak voltage of open electrodes (V)."""

    def driven(self, period: float | None) -> None:
        """Set what depends on the period of the excitation (s), if it has one."""

    @property
    def timed(self) -> bool:
        """Whether it acts at instants of its own."""
        return self.switch is not None

    @property
    def due(self) -> float:
        """Next instant at which it acts, s."""
        return self.switch.due if self.switch else math.inf

    def act(self, z: np.ndarray) -> bool:
        """Carry out what is due; True if the electrodes are to be discharged at once."""
        return False

    def dc(self, z: np.ndarray) -> np.ndarray | None:
        """Voltage behind a bridge, V; None where there is none."""
        return None

    def dc_current(self, z: np.ndarray, v: np.ndarray, i: np.ndarray) -> np.ndarray | None:
        """Current into the load behind a bridge, A; None where there is none."""
        return None

    @property
    def conducting(self) -> int:
        """Sign of the voltage at which a bridge conducts, 0 where it blocks."""
        return self.branch

    @property
    def guard_unit(self) -> str:
        """A current while a bridge conducts, else voltages."""
        return "A" if self.conducting else "V"

    @property
    def guard_units(self) -> Sequence[str]:
        """All alike."""
        return [self.guard_unit] * self.guard_count

    def blocked(self, z: np.ndarray) -> None:
        """Change the states after a guard has crossed zero."""

    def flow(self, z: np.ndarray, v: np.ndarray, free: np.ndarray, elastance: np.ndarray) -> Flow:
        """Load current (A) and the rates of the circuit's states."""
        return 0.0 * v, ()

    def guards(self, z: np.ndarray, v: np.ndarray, i: np.ndarray) -> list[np.ndarray]:
        """Values below zero while the branch holds; the first to cross zero determines the next branch."""
        return []

    def fire(self, guard: int) -> None:
        """Change the branch after a guard has crossed zero."""

    def tied(self, z: np.ndarray) -> np.ndarray | None:
        """Voltage that the present branch imposes, or None."""
        return None


class Short(Circuit):
    """Short circuit."""

    def flow(self, z, v, free, elastance):
        return free / elastance, ()

    def tied(self, z):
        return np.zeros(1)


class Resistor(Circuit):
    """A resistance."""

    resistance: float

    def flow(self, z, v, free, elastance):
        return v / self.resistance, ()


class SeriesRL(Circuit):
    """Resistance and inductance in series; the state is their current."""

    resistance: float
    inductance: float

    def __init__(self, shunt):
        super().__init__(shunt)
        self.storage = (self.inductance,)

    def flow(self, z, v, free, elastance):
        return z[0], ((v - self.resistance * z[0]) / self.inductance,)


class ParallelRL(SeriesRL):
    """Resistance and inductance side by side; the state is the inductor's current."""

    def flow(self, z, v, free, elastance):
        return z[0] + v / self.resistance, (v / self.inductance,)


class SeriesRLC(SeriesRL):
    """One branch of resistance, inductance and capacitance; states are current and capacitor voltage."""

    capacitance: float

    def __init__(self, shunt):
        super().__init__(shunt)
        self.storage = (self.inductance, self.capacitance)

    def flow(self, z, v, free, elastance):
        return z[0], ((v - self.resistance * z[0] - z[1]) / self.inductance, z[0] / self.capacitance)


class ParallelRLC(ParallelRL):
    """Resistance, inductance and capacitance side by side: the capacitor takes C dv/dt."""

    capacitance: float

    def flow(self, z, v, free, elastance):
        others, rates = super().flow(z, v, free, elastance)
        return (others + self.capacitance * free) / (1.0 + self.capacitance * elastance), rates


class NegativeCapacitance(Circuit):
    """Negative capacitance beside the resistance, or in series with it: the state is then its voltage."""

    capacitance: float
    resistance: float
    topology: str
    active = True

    def __init__(self, shunt):
        super().__init__(shunt)
        self.storage = (self.capacitance,) if self.topology == "series" else ()

    def flow(self, z, v, free, elastance):
        if self.topology == "series":
            current = (v - z[0]) / self.resistance
            return current, (-current / self.capacitance,)
        return (v / self.resistance - self.capacitance * free) / (1.0 - self.capacitance * elastance), ()


class OpAmpNegativeCapacitance(Circuit):
    """Capacitance between the electrodes and the output of an amplifier with a gain of 2, which is the state.

    Its branch is 0, or the sign of the voltage at which the output has saturated.
    """

    capacitance: float
    resistance: float
    gain_bandwidth: float
    saturation: float
    guard_count = 2
    active = True

    def meet(self, capacitance):
        self.storage = (self.capacitance,)

    def flow(self, z, v, free, elastance):
        moves = 0.0 * v if self.branch else 2.0 * np.pi * self.gain_bandwidth * (v - 0.5 * z[0])
        current = v / self.resistance + self.capacitance * (free - moves)
        return current / (1.0 + self.capacitance * elastance), (moves,)

    def guards(self, z, v, i):
        if self.branch:
            return [-self.branch * (v - 0.5 * z[0]), 0.0 * v - 1.0]
        return [z[0] - self.saturation, -z[0] - self.saturation]

    def fire(self, guard):
        self.branch = 0 if self.branch else 1 - 2 * guard


class CurrentFlowing(Circuit):
    """Series branches side by side; states are all currents, then the capacitor voltages of the last branches."""

    inductances: tuple[float, ...]
    resistances: tuple[float, ...]
    capacitances: tuple[float, ...]

    def __init__(self, shunt):
        super().__init__(shunt)
        self.storage = (*self.inductances, *self.capacitances)

    def flow(self, z, v, free, elastance):
        count, without = len(self.inductances), len(self.inductances) - len(self.capacitances)
        across = [v - (z[count + n - without] if n >= without else 0.0) for n in range(count)]
        parts = zip(across, self.resistances, z[:count], self.inductances, strict=True)
        currents = [(u - r * i) / inductance for u, r, i, inductance in parts]
        voltages = [z[without + n] / c for n, c in enumerate(self.capacitances)]
        return sum(z[:count]), (*currents, *voltages)


class CurrentBlocking(Circuit):
    """Branches with blocking circuits; states are the branch currents, then coil current and voltage of each block."""

    inductances: tuple[float, ...]
    resistances: tuple[float, ...]
    blocking_inductances: tuple[float, ...]
    blocking_capacitances: tuple[float, ...]
    coil_quality: float | None

    def __init__(self, shunt):
        super().__init__(shunt)
        count = len(self.inductances)
        self.blocks = [(n, m) for n in range(count) for m in range(count) if m != n]
        of_blocks = [(self.blocking_inductances[m], self.blocking_capacitances[m]) for _, m in self.blocks]
        self.storage = (*self.inductances, *(part for pair in of_blocks for part in pair))

    def flow(self, z, v, free, elastance):
        count, rates = len(self.inductances), []
        left = [v - r * i for r, i in zip(self.resistances, z[:count], strict=True)]
        for k, (n, m) in enumerate(self.blocks):
            coil, voltage = z[count + 2 * k], z[count + 2 * k + 1]
            inductance, capacitance = self.blocking_inductances[m], self.blocking_capacitances[m]
            loss = 0.0 if self.coil_quality is None else np.sqrt(inductance / capacitance) / self.coil_quality
            left[n] = left[n] - voltage
            rates += [(voltage - loss * coil) / inductance, (z[n] - coil) / capacitance]
        return sum(z[:count]), (*(u / part for u, part in zip(left, self.inductances, strict=True)), *rates)


class Rectifier(Circuit):
    """Bridge into a smoothing capacitor (whose voltage is the last state) with its load, or into a constant voltage.

    A conductance beside each diode is one across the leads and one across the dc side. Its saturation current leaves
    the dc side once for each diode of a path, in proportion to the dc voltage below `saturation_voltage`.
    """

    smoothing_capacitance: float | None
    load_resistance: float | None
    dc_voltage: float | None
    diode_drop: float
    diode_leakage: float
    diode_saturation: float
    saturation_voltage: float
    dc_leakage: float
    diode_resistance: float
    diodes = 2  # in a path
    guard_count = 2

    def __init__(self, shunt):
        super().__init__(shunt)
        self.storage = () if self.smoothing_capacitance is None else (self.smoothing_capacitance,)
        self.charging = 0.0 if self.smoothing_capacitance is None else 1.0 / self.smoothing_capacitance
        self.conductance = 0.0 if self.load_resistance is None else 1.0 / self.load_resistance
        self.smooth = bool(self.storage and self.diode_saturation)  # its corner is not an event

    def dc(self, z):
        return z[-1] if self.dc_voltage is None else self.dc_voltage + 0.0 * z.sum(axis=0)

    def dc_current(self, z, v, i):
        if self.load_resistance is not None:
            return self.conductance * self.dc(z)
        return self.conducting * (i - self.diode_leakage * v)

    def dc_rates(self, z, rectified):
        """Rate of the dc voltage, if it has one."""
        if self.dc_voltage is not None:
            return ()
        leaks = self.conductance + self.diode_leakage + self.dc_leakage
        return (self.charging * (rectified - leaks * self.dc(z) - self.saturated(z)),)

    def saturated(self, z):
        """Current that saturated diodes take of the dc side."""
        return self.diodes * self.diode_saturation * np.clip(self.dc(z) / self.saturation_voltage, 0.0, 1.0)

    def flow(self, z, v, free, elastance):
        return self.bridge_flow(z, v, free, elastance, beside=0.0)

    def bridge_flow(self, z, v, free, elastance, beside):
        """Load current with a current `beside` the bridge: conducting, v changes as the dc voltage does."""
        past, sign, through = beside + self.diode_leakage * v, self.conducting, 0.0 * v
        if sign and self.path_resistance:
            through = (v - sign * self.limit(z)) / self.path_resistance
        elif sign:
            (rate,) = self.dc_rates(z, 0.0) or (0.0,)
            through = (free - elastance * past - sign * rate) / (elastance + self.charging)
        return past + through, self.dc_rates(z, sign * through)

    def guards(self, z, v, i):
        if self.conducting:
            return [-self.conducting * (i - self.diode_leakage * v), 0.0 * i - 1.0]
        limit = self.limit(z)
        return [v - limit, -v - limit]

    @property
    def path_resistance(self):
        """Resistance of all parts of a path, ohm."""
        return self.diodes * self.diode_resistance

    def limit(self, z):
        """Voltage above which the diodes conduct."""
        return self.dc(z) + self.diodes * self.diode_drop

    def fire(self, guard):
        self.branch = 0 if self.branch else 1 - 2 * guard

    def tied(self, z):
        return self.conducting * self.limit(z) if self.conducting and not self.path_resistance else None


class Battery(Rectifier):
    """Bridge into a constant voltage with a resistance, which lies in line with the diodes."""

    internal_resistance: float

    @property
    def path_resistance(self):
        return 2.0 * self.diode_resistance + self.internal_resistance

    def dc_current(self, z, v, i):
        leaks = (self.diode_leakage + self.dc_leakage) * self.dc(z) + self.saturated(z)
        return super().dc_current(z, v, i) - leaks


class HalfWave(Rectifier):
    """Series diode to the dc side, and a diode across the leads."""

    diodes = 1

    def parts(self, z, v, free, elastance):
        """Currents through the series diode and backwards through the one across the leads."""
        dc, g = self.dc(z), self.diode_leakage
        series, across, sign = g * (v - dc), g * v, self.branch
        limit = sign * self.diode_drop + (dc if sign > 0 else 0.0)
        if not sign:
            return series, across
        if self.path_resistance:
            through = (v - limit) / self.path_resistance
        else:
            charging = self.charging if sign > 0 else 0.0
            (rate,) = (self.dc_rates(z, series) or (0.0,)) if sign > 0 else (0.0,)
            through = (free - elastance * (series + across) - rate) / (elastance + charging)
        return (series + through, across) if sign > 0 else (series, across + through)

    def dc_rates(self, z, rectified):
        if self.dc_voltage is not None:
            return ()
        leaks = self.conductance + self.dc_leakage
        return (self.charging * (rectified - leaks * self.dc(z) - self.saturated(z)),)

    def flow(self, z, v, free, elastance):
        series, across = self.parts(z, v, free, elastance)
        return series + across, self.dc_rates(z, series)

    def guards(self, z, v, i):
        if self.branch:
            forward = i - self.diode_leakage * (2.0 * v - self.dc(z))
            return [-self.branch * forward, 0.0 * i - 1.0]
        return [v - self.dc(z) - self.diode_drop, -v - self.diode_drop + 0.0 * i]

    def tied(self, z):
        if not self.branch or self.path_resistance:
            return None
        return self.dc(z) + self.diode_drop if self.branch > 0 else -self.diode_drop + 0.0 * self.dc(z)

    def dc_current(self, z, v, i):
        if self.load_resistance is not None:
            return self.conductance * self.dc(z)
        g = self.diode_leakage
        return i - g * v if self.branch > 0 else g * (v - self.dc(z))


class Doubler(Rectifier):
    """Two capacitors in series with one lead between them; states are their voltages, that of the upper one first."""

    diodes = 1

    def __init__(self, shunt):
        super().__init__(shunt)
        self.storage = self.storage * 2

    def sides(self, z):
        """Voltages of both capacitors."""
        if self.dc_voltage is None:
            return z[-2], z[-1]
        return 0.5 * self.dc_voltage + 0.0 * z.sum(axis=0), 0.5 * self.dc_voltage + 0.0 * z.sum(axis=0)

    def dc(self, z):
        upper, lower = self.sides(z)
        return upper + lower

    def flow(self, z, v, free, elastance):
        upper, lower = self.sides(z)
        g, sign, charging = self.diode_leakage, self.branch, self.charging
        up, down = g * (v - upper), g * (-v - lower)
        drain = (self.conductance + self.dc_leakage) * (upper + lower) + self.saturated(z)
        if sign:
            side, into = (upper, up) if sign > 0 else (lower, down)
            if self.path_resistance:
                through = (sign * v - side - self.diode_drop) / self.path_resistance
            else:
                held = sign * (free - elastance * (up - down)) - charging * (into - drain)
                through = held / (elastance + charging)
            up, down = (up + through, down) if sign > 0 else (up, down + through)
        rates = () if self.dc_voltage is not None else (charging * (up - drain), charging * (down - drain))
        return up - down, rates

    def guards(self, z, v, i):
        upper, lower = self.sides(z)
        if self.branch:
            return [-self.branch * (i - self.diode_leakage * (2.0 * v - upper + lower)), 0.0 * i - 1.0]
        return [v - upper - self.diode_drop, -v - lower - self.diode_drop]

    def tied(self, z):
        upper, lower = self.sides(z)
        if not self.branch or self.path_resistance:
            return None
        return upper + self.diode_drop if self.branch > 0 else -lower - self.diode_drop

    def dc_current(self, z, v, i):
        if self.load_resistance is not None:
            return self.conductance * self.dc(z)
        upper, lower = self.sides(z)
        return 0.5 * self.branch * (i - self.diode_leakage * (2.0 * v - upper + lower))


UNSWITCHED: dict[str, type[Circuit]] = {
    "open": Circuit,
    "short": Short,
    "resistor": Resistor,
    "series_rl": SeriesRL,
    "parallel_rl": ParallelRL,
    "series_rlc": SeriesRLC,
    "parallel_rlc": ParallelRLC,
    "negative_capacitance": NegativeCapacitance,
    "op_amp_negative_capacitance": OpAmpNegativeCapacitance,
    "current_flowing": CurrentFlowing,
    "parallel_branches": CurrentFlowing,
    "current_blocking": CurrentBlocking,
    "rectifier": Rectifier,
    "battery": Battery,
    "half_wave": HalfWave,
    "doubler": Doubler,
}
