"""The shunts of INTERFACE.md section 2 as hybrid circuits: one class each, one flow for each of its modes.

A circuit sees the transducer only as a port. Given the electrode voltage ``v``, its rate of change at zero current
``drift`` (minus the strain current over C) and the ``elastance`` dv/dq, the voltage obeys dv/dt = elastance i_p +
drift, and the circuit answers with the current i_p INTO the transducer. Where a circuit ties the voltage (a short, a
conducting bridge) that same equation, the differentiated constraint, gives the current.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from .reference_device import charge_jump


class Flow(NamedTuple):
    """What a circuit does at one instant: port current, rates of its states, and where its power goes (W)."""

    current: float
    rates: tuple[float, ...] = ()
    harvested: float = 0.0
    loss: float = 0.0
    source: float = 0.0


class Ledger(NamedTuple):
    """Energies (J) that an instantaneous action moves."""

    hysteresis: float = 0.0
    harvested: float = 0.0
    shunt_loss: float = 0.0


class Circuit:
    """An open circuit, and the base of all others.

    ``guards`` returns values that stay at or below zero while the present mode holds, ``guard_units`` says which size
    each is to be compared with; ``fire`` changes the mode and names the event.
    """

    states: tuple[str, ...] = ()
    timing: Timing | None = None
    loop: SwitchedLoop | None = None

    def __init__(self, table: dict, capacitance: float, frequency: float | None) -> None:
        self.table = table

    def flow(self, z, v, drift, elastance) -> Flow:
        return Flow(0.0)

    def dc(self, z) -> float:
        """Dc voltage, 0 where there is no bridge."""
        return 0.0

    def stored(self, z, v) -> float:
        return 0.0

    def tied_voltage(self, z) -> float | None:
        """Electrode voltage that the present mode imposes, if any."""
        return None

    def guard_units(self) -> tuple[str, ...]:
        return ()

    def guards(self, z, v, current) -> tuple[float, ...]:
        return ()

    def fire(self, index: int, device, y) -> str:
        raise AssertionError("a circuit without guards cannot fire")

    def check(self, device) -> None:
        """Refuse what has no solution."""

    def sizes(self, charge: float, voltage: float, rate: float) -> list[float]:
        """Typical sizes of the states, for the absolute tolerance."""
        return []

    def mode(self) -> dict:
        """Discrete state, to resume from."""
        return {}

    def set_mode(self, mode: dict) -> None:
        pass


class Short(Circuit):
    """v_p = 0."""

    def flow(self, z, v, drift, elastance) -> Flow:
        return Flow(-drift / elastance)

    def tied_voltage(self, z) -> float:
        return 0.0


class Resistor(Circuit):
    """A resistor that is the load."""

    def __init__(self, table, capacitance, frequency) -> None:
        super().__init__(table, capacitance, frequency)
        self.resistance = float(table["resistance"])
        self.inductance = float(table.get("inductance", math.nan))
        self.shunt_capacitance = float(table.get("capacitance", math.nan))

    def flow(self, z, v, drift, elastance) -> Flow:
        return Flow(-v / self.resistance, (), v * v / self.resistance)


class SeriesRL(Resistor):
    """R and L in series across the electrodes; state: the load current."""

    states = ("inductor_current",)

    def flow(self, z, v, drift, elastance) -> Flow:
        (i,) = z
        return Flow(-i, ((v - self.resistance * i) / self.inductance,), self.resistance * i * i)

    def stored(self, z, v) -> float:
        return 0.5 * self.inductance * z[0] ** 2

    def sizes(self, charge, voltage, rate) -> list[float]:
        return [charge * rate]


class ParallelRL(SeriesRL):
    """R and L in parallel across the electrodes."""

    def flow(self, z, v, drift, elastance) -> Flow:
        (i,) = z
        return Flow(-i - v / self.resistance, (v / self.inductance,), v * v / self.resistance)


class SeriesRLC(SeriesRL):
    """R, L and C in series; states: load current and capacitor voltage."""

    states = ("inductor_current", "capacitor_voltage")

    def flow(self, z, v, drift, elastance) -> Flow:
        i, v_c = z
        rates = ((v - self.resistance * i - v_c) / self.inductance, i / self.shunt_capacitance)
        return Flow(-i, rates, self.resistance * i * i)

    def stored(self, z, v) -> float:
        return 0.5 * self.inductance * z[0] ** 2 + 0.5 * self.shunt_capacitance * z[1] ** 2

    def sizes(self, charge, voltage, rate) -> list[float]:
        return [charge * rate, min(voltage, charge / self.shunt_capacitance)]


class ParallelRLC(SeriesRL):
    """R, L and C in parallel: the capacitor shares the electrode voltage, so it adds no state."""

    def flow(self, z, v, drift, elastance) -> Flow:
        (i,) = z
        # i_p = -(v/R + i_L) - C dv/dt with dv/dt = elastance i_p + drift
        current = -(v / self.resistance + i + self.shunt_capacitance * drift)
        current /= 1.0 + self.shunt_capacitance * elastance
        return Flow(current, (v / self.inductance,), v * v / self.resistance)

    def stored(self, z, v) -> float:
        return 0.5 * self.inductance * z[0] ** 2 + 0.5 * self.shunt_capacitance * v**2


class ParallelNegativeCapacitance(Resistor):
    """-C_n and R in parallel across the electrodes."""

    def flow(self, z, v, drift, elastance) -> Flow:
        current = -v / self.resistance + self.shunt_capacitance * drift
        current /= 1.0 - self.shunt_capacitance * elastance
        return Flow(current, (), v * v / self.resistance)

    def stored(self, z, v) -> float:
        return -0.5 * self.shunt_capacitance * v**2

    def check(self, device) -> None:
        if self.shunt_capacitance * device.elastance([0] * device.stops) >= 1.0:
            raise ValueError("parallel negative capacitance: C_n must stay below C/(1 + C sum w_i)")


class SeriesNegativeCapacitance(Resistor):
    """-C_n in series with R; state: the voltage across -C_n."""

    states = ("capacitor_voltage",)

    def flow(self, z, v, drift, elastance) -> Flow:
        i = (v - z[0]) / self.resistance
        return Flow(-i, (-i / self.shunt_capacitance,), self.resistance * i * i)

    def stored(self, z, v) -> float:
        return -0.5 * self.shunt_capacitance * z[0] ** 2

    def sizes(self, charge, voltage, rate) -> list[float]:
        return [min(voltage, charge / self.shunt_capacitance)]


class Bridge(Circuit):
    """Dc side shared by all bridge circuits: smoothing capacitor and load, or a fixed dc voltage.

    ``polarity`` is the discrete state: 0 while the bridge blocks, else the sign of the voltage with which it conducts.
    """

    def __init__(self, table, capacitance, frequency) -> None:
        super().__init__(table, capacitance, frequency)
        self.drop = 2.0 * float(table.get("diode_drop", 0.0))
        self.fixed = float(table["dc_voltage"]) if "dc_voltage" in table else None
        self.states = () if self.fixed is not None else ("dc_voltage",)
        # A fixed voltage is the limit of an infinite smoothing capacitor without a load.
        self.dc_elastance = 0.0 if self.fixed is not None else 1.0 / float(table["smoothing_capacitance"])
        self.load = math.inf if self.fixed is not None else float(table["load_resistance"])
        self.polarity = 0

    def dc(self, z) -> float:
        return self.fixed if self.fixed is not None else z[-1]

    def threshold(self, z) -> float:
        return self.dc(z) + self.drop

    def dc_flow(self, z, bridge_current) -> tuple[tuple[float, ...], float, float]:
        """Rate of the dc voltage, harvested power and diode loss for a rectified current."""
        dc = self.dc(z)
        loss = self.drop * bridge_current
        if self.fixed is not None:
            return (), dc * bridge_current, loss
        return ((bridge_current - dc / self.load) * self.dc_elastance,), dc * dc / self.load, loss

    def stored(self, z, v) -> float:
        return 0.0 if self.fixed is not None else 0.5 * z[-1] ** 2 / self.dc_elastance

    def sizes(self, charge, voltage, rate) -> list[float]:
        return [voltage] * len(self.states)

    def mode(self) -> dict:
        return {"polarity": self.polarity}

    def set_mode(self, mode) -> None:
        self.polarity = mode["polarity"]

    def fire(self, index: int, device, y) -> str:
        if self.polarity:
            self.polarity = 0
            return "bridge_blocks"
        self.polarity = 1 if index == 0 else -1
        return "bridge_conducts"


class Rectifier(Bridge):
    """Full bridge across the electrodes, with room for a branch beside it (``branch`` is that branch's current)."""

    def tied_voltage(self, z) -> float | None:
        return self.polarity * self.threshold(z) if self.polarity else None

    def tied_current(self, z, drift, elastance, branch=0.0) -> float:
        """i_p from d/dt [v_p - polarity (v_dc + drop)] = 0, the bridge current being -i_p - branch."""
        discharge = self.polarity * self.dc(z) / self.load
        return -(drift + (branch + discharge) * self.dc_elastance) / (elastance + self.dc_elastance)

    def flow(self, z, v, drift, elastance) -> Flow:
        current = self.tied_current(z, drift, elastance) if self.polarity else 0.0
        return Flow(current, *self.dc_flow(z, -self.polarity * current))

    def guard_units(self) -> tuple[str, ...]:
        return ("current",) if self.polarity else ("voltage", "voltage")

    def guards(self, z, v, current) -> tuple[float, ...]:
        if self.polarity:
            return (self.polarity * current,)
        limit = self.threshold(z)
        return v - limit, -v - limit


class Timing:
    """When a switched shunt acts: from the extrema of sum T_i x_i to the instants of the switch.

    Parameters
    ----------
    table : dict
        The shunt's table (``phase_lag`` or ``time_lag``, ``hold_off``).
    frequency : float or None
        Drive frequency; without one, lags are times and the default hold-off is 0.
    """

    def __init__(self, table: dict, frequency: float | None) -> None:
        period = 1.0 / frequency if frequency else None
        self.lag = float(table.get("time_lag", 0.0))
        if period is not None and "phase_lag" in table:
            self.lag = float(table["phase_lag"]) * period / (2.0 * math.pi)
        if self.lag < 0.0 and period is None:
            raise ValueError("an early switch needs a drive frequency")
        self.half_period = 0.5 * period if period else 0.0
        self.hold_off = float(table.get("hold_off", 0.25 * period if period else 0.0))
        self.side = 0
        self.last = -math.inf
        self.pending: list[tuple[float, int]] = []

    def extremum(self, time: float, kind: int) -> None:
        """Note an extremum (kind 1: maximum, -1: minimum) and plan the action that belongs to it."""
        if self.lag < 0.0:
            # The coming extremum cannot be seen yet: count half a period from the one just passed.
            time, kind = time + self.half_period, -kind
        planned = time + self.lag
        # Rounding must not skip an extremum that comes exactly one hold-off after the last.
        if planned - self.last < self.hold_off * (1.0 - 1e-9):
            return
        self.last = planned
        self.pending.append((planned, kind))

    def mode(self, now: float) -> dict:
        """Discrete state, with times counted from now."""
        pending = [(time - now, kind) for time, kind in self.pending]
        return {"side": self.side, "last": self.last - now, "pending": pending}

    def set_mode(self, mode: dict) -> None:
        self.side, self.last, self.pending = mode["side"], mode["last"], list(mode["pending"])


class SwitchedLoop:
    """Inductor and resistance of a switched loop, and for how long its switch stays closed."""

    def __init__(self, table: dict, capacitance: float) -> None:
        quality = float(table["quality"])
        if quality <= 0.5:
            raise ValueError("the switched loop must be able to ring: quality > 1/2")
        # w_d^2 = 1/(L C) - (R/2L)^2 = (1 - 1/(4 Q^2))/(L C)
        shape = 1.0 - 0.25 / quality**2
        if "flip_time" in table:
            self.inductance = (float(table["flip_time"]) / math.pi) ** 2 * shape / capacitance
        else:
            self.inductance = float(table["inductance"])
        self.resistance = math.sqrt(self.inductance / capacitance) / quality
        damped = math.sqrt(shape / (self.inductance * capacitance))
        self.on_time = (1.0 + float(table.get("on_time_error", 0.0))) * math.pi / damped
        self.rate = damped
        self.closed = False

    def loss(self, i: float) -> float:
        return self.resistance * i * i

    def energy(self, i: float) -> float:
        return 0.5 * self.inductance * i * i


class ParallelSSHI(Rectifier):
    """Bridge and switched L-R branch side by side; either, both or none of them may carry current."""

    def __init__(self, table, capacitance, frequency) -> None:
        super().__init__(table, capacitance, frequency)
        self.states = ("inductor_current", *self.states)
        self.loop = SwitchedLoop(table, capacitance)
        self.timing = Timing(table, frequency)

    def flow(self, z, v, drift, elastance) -> Flow:
        i, loop = z[0], self.loop
        current = self.tied_current(z, drift, elastance, i) if self.polarity else -i
        dc_rates, harvested, loss = self.dc_flow(z, -self.polarity * (current + i))
        rate = (v - loop.resistance * i) / loop.inductance if loop.closed else 0.0
        return Flow(current, (rate, *dc_rates), harvested, loss + loop.loss(i))

    def guards(self, z, v, current) -> tuple[float, ...]:
        return super().guards(z, v, current + z[0])

    def stored(self, z, v) -> float:
        return self.loop.energy(z[0]) + super().stored(z, v)

    def sizes(self, charge, voltage, rate) -> list[float]:
        return [charge * self.loop.rate, *[voltage] * (len(self.states) - 1)]

    def mode(self) -> dict:
        return {**super().mode(), "closed": self.loop.closed}

    def set_mode(self, mode) -> None:
        super().set_mode(mode)
        self.loop.closed = mode["closed"]

    def act(self, device, y, kind) -> Ledger:
        self.loop.closed = True
        return Ledger()

    def release(self, device, y) -> Ledger:
        """Open the switch; what the inductor still holds is lost with the current that is cut."""
        self.loop.closed = False
        lost = self.loop.energy(y[device.shunt_at])
        y[device.shunt_at] = 0.0
        return Ledger(shunt_loss=lost)


class SeriesSSHI(ParallelSSHI):
    """Switch, L, R and bridge in one loop: all current passes the bridge, and stops when it falls to zero."""

    def flow(self, z, v, drift, elastance) -> Flow:
        i, loop = z[0], self.loop
        dc_rates, harvested, loss = self.dc_flow(z, self.polarity * i)
        rate = 0.0
        if loop.closed and self.polarity:
            rate = (v - loop.resistance * i - self.polarity * self.threshold(z)) / loop.inductance
        return Flow(-i, (rate, *dc_rates), harvested, loss + loop.loss(i))

    def tied_voltage(self, z) -> None:
        return None

    def guard_units(self) -> tuple[str, ...]:
        return super().guard_units() if self.loop.closed else ()

    def guards(self, z, v, current) -> tuple[float, ...]:
        if not self.loop.closed:
            return ()
        if self.polarity:
            return (-self.polarity * z[0],)
        limit = self.threshold(z)
        return v - limit, -v - limit

    def fire(self, index, device, y) -> str:
        name = super().fire(index, device, y)
        if not self.polarity:
            y[device.shunt_at] = 0.0  # the root finder's remainder would otherwise flow for ever
        return name

    def release(self, device, y) -> Ledger:
        self.polarity = 0
        return super().release(device, y)


class SSDI(Circuit):
    """Switched L-R branch across the electrodes, with a source in series where there is one (SSDV)."""

    states = ("inductor_current",)

    def __init__(self, table, capacitance, frequency) -> None:
        super().__init__(table, capacitance, frequency)
        self.loop = SwitchedLoop(table, capacitance)
        self.timing = Timing(table, frequency)
        self.source = float(table.get("source_voltage", 0.0)) if table["kind"] == "ssdv" else 0.0
        self.kind = 0

    def flow(self, z, v, drift, elastance) -> Flow:
        (i,) = z
        if not self.loop.closed:
            return Flow(0.0, (0.0,))
        # At a maximum of x the open electrodes are at their lowest: a positive source carries the swing further up.
        emf = self.kind * self.source
        rate = (v - emf - self.loop.resistance * i) / self.loop.inductance
        return Flow(-i, (rate,), 0.0, self.loop.loss(i), -emf * i)

    def stored(self, z, v) -> float:
        return self.loop.energy(z[0])

    def sizes(self, charge, voltage, rate) -> list[float]:
        return [charge * self.loop.rate]

    def mode(self) -> dict:
        return {"closed": self.loop.closed, "kind": self.kind}

    def set_mode(self, mode) -> None:
        self.loop.closed, self.kind = mode["closed"], mode["kind"]

    def act(self, device, y, kind) -> Ledger:
        self.loop.closed, self.kind = True, kind
        return Ledger()

    release = ParallelSSHI.release


class SECE(Circuit):
    """Electrodes open but for the instants at which all their energy is taken; SSDS wastes what SECE harvests."""

    def __init__(self, table, capacitance, frequency) -> None:
        super().__init__(table, capacitance, frequency)
        self.timing = Timing(table, frequency)
        self.efficiency = 0.0 if table["kind"] == "ssds" else float(table.get("efficiency", 1.0))
        self.drop = 2 * float(table.get("diode_drop", 0.0))

    def act(self, device, y, kind) -> Ledger:
        charge = y[device.q_at]
        taken, hysteresis = charge_jump(device, y)
        harvested = self.efficiency * max(taken - self.drop * abs(y[device.q_at] - charge), 0.0)
        return Ledger(hysteresis, harvested, taken - harvested)


KINDS: dict[str, type[Circuit]] = {
    "open": Circuit,
    "short": Short,
    "resistor": Resistor,
    "series_rl": SeriesRL,
    "parallel_rl": ParallelRL,
    "series_rlc": SeriesRLC,
    "parallel_rlc": ParallelRLC,
    "rectifier": Rectifier,
    "parallel_sshi": ParallelSSHI,
    "series_sshi": SeriesSSHI,
    "sece": SECE,
    "ssds": SECE,
    "ssdi": SSDI,
    "ssdv": SSDI,
}


def build(table: dict, capacitance: float, frequency: float | None) -> Circuit:
    """Make the circuit of one ``[[shunts]]`` table.

    Parameters
    ----------
    table : dict
        Keys of INTERFACE.md section 2.
    capacitance : float
        Clamped capacitance, which sets the on time of a switch.
    frequency : float or None
        Drive frequency, if the excitation has one.

    Returns
    -------
    Circuit
    """
    kind = table["kind"]
    if kind == "negative_capacitance":
        parallel = table["topology"] == "parallel"
        return (ParallelNegativeCapacitance if parallel else SeriesNegativeCapacitance)(table, capacitance, frequency)
    if kind not in KINDS:
        raise NotImplementedError(f"the reference simulator has no shunt of kind {kind!r}")
    return KINDS[kind](table, capacitance, frequency)
