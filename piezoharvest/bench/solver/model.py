"""The specimen's equations, written from docs/equations.md independently of the engine and of identification.

    m x'' + b x' + k x = F + F_t        F_t = (dq_t/dx) v_t        q_p = q_c(v_t) + q_t        v_p = v_t + v_h(q_p)
    q_t = T x (+ T2 x^2)                q_p' = -(load current + what else is drawn)

They are evaluated for many instants at once. If they are linear between events the solver finds their matrices from
unit vectors; if an effect makes them nonlinear it iterates.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import SimpleNamespace

import numpy as np

from piezoharvest.bench.solver.loads.circuits import Circuit
from piezoharvest.bench.solver.stops import Stop
from piezoharvest.description.transducer import Transducer

# A quantity at some instants, as a function of all quantities there; see `Model.moment`.
Term = Callable[[SimpleNamespace], np.ndarray]


# Moves of charge in a discharge: one for each stop that sticks or slips, and a few of Newton's; share of the voltage
# that counts as zero.
MAX_MOVES, ZERO_VOLTAGE = 200, 1e-14


class SolverError(RuntimeError):
    """The equations could not be solved; the message states when and why."""


def _line(weights: Sequence[float], stops: Sequence[Stop]) -> tuple[float, float]:
    """Slope and level of the weighted sum of stops as a function of their coordinate."""
    lines = [(w * slope, w * level) for w, (slope, level) in zip(weights, (stop.line for stop in stops), strict=True)]
    return sum(slope for slope, _ in lines), sum(level for _, level in lines)


class Model:
    """Equations of transducer, load and effects.

    States are x_1.., u_1.., q, those of effects, and the circuit's. Effects modify the attributes below.

    Parameters
    ----------
    transducer : Transducer
        Its effects are ignored.
    circuit : Circuit
    base : bool
        The drive is base acceleration (m/s^2), not force (N).

    Attributes
    ----------
    forces : list of Term
        Additional forces on the first mode, N.
    drawn : list of Term
        Currents in A that leave the node beside the load.
    slow_charges : list of int
        States that are charges beside q_c, C.
    dielectric : callable
        v_t and dv_t/dq_c from q_c.
    beside : float
        Capacitance beside the clamped one, of a linear dielectric only, F.
    coupling_rate : float
        Relative change of T in 1/s.
    quadratic_coupling : float
        T2 in N/(V m).
    sensed : Term
        Displacement at the sensor's input, m.
    reading : int or None
        State that is the sensor's reading, if different.
    smooth : bool
        An equation is nonlinear between events, or changes with time.
    """

    def __init__(self, transducer: Transducer, circuit: Circuit, *, base: bool) -> None:
        modes = transducer.all_modes
        self.transducer, self.circuit, self.base = transducer, circuit, base
        circuit.meet(transducer.capacitance)
        self.count = n = len(modes)

        def column(key: str) -> np.ndarray:
            return np.array([[getattr(mode, key)] for mode in modes])

        self.mass, self.damping, self.stiffness = column("mass"), column("damping"), column("stiffness")
        self.coupling, self.participation = column("coupling"), column("force_participation")
        self.gain = -column("base_mass") if base else self.participation
        self.seen = column("seen")
        self.q_row, self.own_rows = 2 * n, slice(2 * n + 1, 2 * n + 1)
        self.sizes = [*np.sqrt(self.stiffness[:, 0]), *np.sqrt(self.mass[:, 0]), transducer.capacitance**-0.5]
        pairs = transducer.hysteresis
        self.stops = [Stop(self.q_row, r) for r in pairs.thresholds] if pairs else []
        self.weights = list(pairs.weights) if pairs else []
        self.friction: list[Stop] = []
        self.friction_stiffness: list[float] = []
        self.first = np.eye(n)[:, :1]
        self.forces: list[Term] = []
        self.drawn: list[Term] = []
        self.slow_charges: list[int] = []
        self.own_rates: list[Term] = []
        self.at_rest: list[Term] = []
        self.dielectric = self.linear_dielectric
        self.beside = 0.0
        self.coupling_rate = self.quadratic_coupling = 0.0
        self.sensed: Term = self.displacement
        self.reading: int | None = None
        self.smooth = circuit.smooth

    def add_state(self, storage: float, rate: Term, at_rest: Term) -> int:
        """Add a state whose energy is about storage z^2/2; return its row."""
        self.sizes.append(storage**0.5)
        self.own_rates.append(rate)
        self.at_rest.append(at_rest)
        self.own_rows = slice(2 * self.count + 1, len(self.sizes))
        return len(self.sizes) - 1

    def add_friction(self, stiffness: float, threshold: float) -> None:
        """Add a stop operator of the first displacement, parallel to the spring."""
        self.friction.append(Stop(0, threshold))
        self.friction_stiffness.append(stiffness)

    @property
    def all_stops(self) -> list[Stop]:
        """All stops, electrical ones, then mechanical ones."""
        return [*self.stops, *self.friction]

    @property
    def scale(self) -> np.ndarray:
        """Factor of each state that scales it to sqrt(J)."""
        return np.array([*self.sizes, *(value**0.5 for value in self.circuit.storage)])

    @property
    def branches(self) -> tuple:
        """Branches of all stops and of the circuit."""
        return (self.circuit.branch, *(stop.branch for stop in self.all_stops))

    @branches.setter
    def branches(self, values: tuple) -> None:
        self.circuit.branch = values[0]
        for stop, branch in zip(self.all_stops, values[1:], strict=True):
            stop.branch = branch

    def moment(self, t: np.ndarray, drive: np.ndarray, y: np.ndarray, rates: np.ndarray) -> SimpleNamespace:
        """All quantities at instants `t`, of shape (instants,), with the states `y`, of shape (states, instants).

        The rates of the states are written into `rates`, of the shape of `y`.
        """
        n, own, T2 = self.count, self.own_rows, self.quadratic_coupling
        m = SimpleNamespace(t=t, drive=drive, y=y, x=y[:n], u=y[n : 2 * n], q=y[self.q_row], rates=rates)
        coupling = m.charge_slope = (
            self.coupling * (1.0 + self.coupling_rate * t) if self.coupling_rate else self.coupling
        )
        strain_charge, strain_current = (coupling * m.x).sum(axis=0), (coupling * m.u).sum(axis=0)
        if self.coupling_rate:
            strain_current += self.coupling_rate * (self.coupling * m.x).sum(axis=0)
        if T2:
            m.charge_slope = coupling + 2.0 * T2 * m.x * self.first
            strain_charge += T2 * m.x[0] ** 2
            strain_current += 2.0 * T2 * m.x[0] * m.u[0]
        m.v_t, softness = self.dielectric(m.q - strain_charge - sum(y[row] for row in self.slow_charges))
        slope, level = _line(self.weights, self.stops)
        m.v, m.elastance = m.v_t + slope * m.q + level, softness + slope
        self.circuit.voltage = m.v
        for row, rate in enumerate(self.own_rates, own.start):
            rates[row] = rate(m)
        m.turning = self.circuit.turning = (self.coupling * m.u).sum(axis=0)  # what a switch watches
        m.drawn = sum(term(m) for term in self.drawn)
        free = -softness * (strain_current + sum(rates[row] for row in self.slow_charges)) - m.elastance * m.drawn
        m.i, circuit_rates = self.circuit.flow(y[own.stop :], m.v, free, m.elastance)
        for row, rate in enumerate(circuit_rates, own.stop):
            rates[row] = rate
        force = self.gain * drive - self.damping * m.u - self.stiffness * m.x + m.charge_slope * m.v_t
        for term in self.forces:
            force[0] += term(m)
        if self.friction:
            slope, level = _line(self.friction_stiffness, self.friction)
            force[0] -= slope * m.x[0] + level
        rates[:n], rates[n : 2 * n], rates[self.q_row] = m.u, force / self.mass, -(m.i + m.drawn)
        return m

    def displacement(self, m: SimpleNamespace) -> np.ndarray:
        """Participation-weighted sum of the modes, m."""
        return (self.seen * m.x).sum(axis=0)

    def values(self, t: np.ndarray, drive: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Rates of the states, then guards that are below zero while the branches hold; (states + guards, instants).

        Guards are those of the circuit, two of each stop, and two of the switch.
        """
        n, stops, switch = len(y), self.all_stops, self.circuit.switch
        out = np.empty((n + self.circuit.guard_count + 2 * len(stops) + (2 if switch else 0), y.shape[1]))
        m = self.moment(t, drive, y, out[:n])
        for row, guard in enumerate(self.circuit.guards(y[self.own_rows.stop :], m.v, m.i), n):
            out[row] = guard
        for row, stop in enumerate(stops):
            first = n + self.circuit.guard_count + 2 * row
            out[first], out[first + 1] = stop.guards(y[stop.row], out[stop.row])
        if switch:
            out[-2], out[-1] = switch.guards(m.turning)
        return out

    def signals(self, t: np.ndarray, drive: np.ndarray, y: np.ndarray) -> dict[str, np.ndarray]:
        """Measurable signals, by name, in SI units."""
        m, z = self.moment(t, drive, y, np.empty_like(y)), y[self.own_rows.stop :]
        dc, through = self.circuit.dc(z), self.circuit.dc_current(z, m.v, m.i)
        return {
            "acceleration": (self.seen * m.rates[self.count : 2 * self.count]).sum(axis=0),
            "dc_voltage": np.nan * t if dc is None else dc,
            "dc_current": np.nan * t if through is None else through,
            "displacement": self.displacement(m),
            "velocity": (self.seen * m.u).sum(axis=0),
            "reading": self.sensed(m) if self.reading is None else y[self.reading],
            "voltage": m.v,
            "current": m.i,
        }

    def linear_dielectric(self, charge: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """v_t and dv_t/dq_c of the clamped capacitance and what stands beside it."""
        capacitance = self.transducer.capacitance + self.beside
        return charge / capacitance, 1.0 / capacitance + 0.0 * charge

    def discharge(self, t: float, y: np.ndarray) -> None:
        """Take the electrode voltage to zero by moving charge at once, and the stops with it.

        v is a straight line of the charge until a stop slips, or nearly one with a bent dielectric (Newton's method).
        """
        before = None
        for _ in range(MAX_MOVES):
            m = self.moment(np.array([t]), np.zeros(1), y[:, None], np.empty((len(y), 1)))
            v, elastance = float(m.v[0]), float(m.elastance[0])
            before = before or abs(v)
            if abs(v) <= ZERO_VOLTAGE * before:
                return
            direction, q = -int(np.sign(v)), float(y[self.q_row])
            turned = [stop for stop in self.stops if stop.side == -direction]
            for stop in turned:  # the charge reverses: they stick
                stop.fire(0, y)
            if turned:
                continue
            room = {stop: stop.threshold - direction * (q - stop.origin) for stop in self.stops if not stop.side}
            first = min(room, key=lambda stop: room[stop], default=None)
            move = abs(v) / elastance
            if first is not None and room[first] < move:
                move, first.side = max(room[first], 0.0), direction
            y[self.q_row] += direction * move

    def tie(self, t: float, y: np.ndarray) -> None:
        """Set the charge of the state `y` so that a constraint holds exactly: it began, or rounding added up."""
        voltage = self.circuit.tied(y[self.own_rows.stop :, None])
        if voltage is not None:
            m = self.moment(np.array([t]), np.zeros(1), y[:, None], np.empty((len(y), 1)))
            y[self.q_row] += ((voltage - m.v) / m.elastance)[0]
