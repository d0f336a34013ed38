"""Integration of the reference simulator: smooth pieces between events, each solved to 1e-12.

The steppers are those behind ``scipy.integrate.solve_ivp``. They are driven step by step here because ``solve_ivp``
looks for events only at the ends of a step, where two crossings within one step cancel; here every step is searched at
several points of its dense output.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import DOP853, Radau
from scipy.optimize import brentq

from .reference_circuits import Ledger, build
from .reference_device import QUADRATURES, Device, Excitation

METHODS = {"DOP853": DOP853, "Radau": Radau}
LOOKS_PER_STEP = 8
# A guard counts as passed beyond this share of the largest value seen, so that one that starts on its limit, as after
# its own event, does not fire again from rounding alone.
SLACK = 1e-11
MAX_EVENTS_AT_ONCE = 100


class Run:
    """State, mode and clock of one simulation.

    Parameters
    ----------
    study : dict
        Tables ``transducer``, ``excitation``, ``shunts``.
    shunt_index : int
        Which shunt.
    method : str
        ``DOP853``, or ``Radau`` where the circuit is stiff.
    rtol : float
        Relative tolerance; the absolute one is as small a share of each state's typical size.
    z0 : dict or None
        ``final`` of an earlier result to go on from; by default the rest state.
    """

    def __init__(self, study: dict, shunt_index: int, method: str, rtol: float, z0: dict | None) -> None:
        self.excitation = Excitation(study["excitation"])
        self.device = device = Device(study["transducer"], self.excitation)
        shunt = study["shunts"][shunt_index]
        self.circuit = build(shunt, device.capacitance, self.excitation.frequency)
        self.circuit.check(device)
        self.quad_at = device.shunt_at + len(self.circuit.states)
        self.slip = [0] * device.stops
        self.open_at: float | None = None
        self.t = 0.0
        self.y = np.zeros(self.quad_at + len(QUADRATURES))
        self.y[: device.shunt_at] = device.rest(self.excitation.offset)
        if z0 is not None:
            self._resume(z0)
        self.solver, self.rtol = METHODS[method], rtol
        self.events: list[tuple[float, str]] = []
        self.crowded = 0
        self._set_sizes()

    # ---- set-up ------------------------------------------------------------------------------------------------

    def _set_sizes(self) -> None:
        """Typical size of every state, largest step, and the first guess of the guards' scales."""
        device, typical = self.device, self.device.typical(self.excitation)
        charge, voltage, rate = typical["charge"], typical["voltage"], typical["rate"]
        electrical = charge * voltage
        heat = sum(b * u * x for b, u, x in zip(device.damping, typical["u"], typical["x"], strict=True))
        mechanical = max(electrical, heat) or typical["energy"]
        sizes = [*typical["x"], *typical["u"], charge, *[min(charge, r) for r in device.threshold]]
        sizes += self.circuit.sizes(charge, voltage, rate)
        sizes += [mechanical, mechanical, *[electrical] * 4, voltage / rate]
        self.sizes = np.array(sizes)
        self.atol = np.maximum(self.rtol * self.sizes, 1e-200)
        fastest = max(math.sqrt(k / m) for k, m in zip(device.stiffness, device.mass, strict=True))
        self.fastest = max(fastest, rate, self.circuit.loop.rate if self.circuit.loop else 0.0)
        self.max_step = (self.excitation.period or 4.0 * math.pi / fastest) / 8.0
        strain = sum(abs(t) * u for t, u in zip(device.coupling, typical["u"], strict=True))
        self.peak = {"voltage": voltage, "current": charge * rate, "strain": strain}

    def _resume(self, z0: dict) -> None:
        device, y = self.device, self.y
        y[: device.shunt_at] = [*z0["x"], *z0["u"], z0["q"], *z0["stops"]]
        y[device.shunt_at : self.quad_at] = [z0["shunt"][name] for name in self.circuit.states]
        mode = z0["mode"]
        self.slip = list(mode["slip"])
        self.open_at = mode["open_in"]
        self.circuit.set_mode(mode["circuit"])
        if self.circuit.timing:
            self.circuit.timing.set_mode(mode["timing"])

    def snapshot(self) -> dict:
        """State and mode as a plain dict, times counted from now."""
        device, y, timing = self.device, self.y.tolist(), self.circuit.timing
        n = device.modes
        mode = {
            "slip": list(self.slip),
            "open_in": None if self.open_at is None else self.open_at - self.t,
            "circuit": self.circuit.mode(),
            "timing": timing.mode(self.t) if timing else None,
        }
        return {
            "t": self.t,
            "x": y[:n],
            "u": y[n : 2 * n],
            "q": y[device.q_at],
            "stops": y[device.q_at + 1 : device.shunt_at],
            "shunt": dict(zip(self.circuit.states, y[device.shunt_at : self.quad_at], strict=True)),
            "mode": mode,
        }

    def section(self) -> np.ndarray:
        """All that the future depends on, given the discrete mode: states, then times until planned switch actions."""
        times = [time - self.t for time, _ in self.circuit.timing.pending] if self.circuit.timing else []
        if self.open_at is not None:
            times.append(self.open_at - self.t)
        return np.concatenate([self.y[: self.quad_at], times])

    def stored(self) -> float:
        """Energy held by transducer and circuit."""
        y, z = self.y, self.y[self.device.shunt_at : self.quad_at]
        return self.device.stored(y) + self.circuit.stored(z, self.device.electrode_voltage(y))

    # ---- the equations -----------------------------------------------------------------------------------------

    def port(self, y) -> tuple[float, float]:
        """Electrode voltage and current i_p at a state, in the present mode."""
        device = self.device
        v = device.electrode_voltage(y)
        drift = -device.strain_current(y) / device.capacitance
        z = y[device.shunt_at : self.quad_at]
        return v, self.circuit.flow(z, v, drift, device.elastance(self.slip)).current

    def _equations(self, piece):
        """Return the right-hand side for the present mode, on plain floats (faster than short arrays)."""
        device, flow, dc_of = self.device, self.circuit.flow, self.circuit.dc
        n, q_at, shunt_at, quad_at = device.modes, device.q_at, device.shunt_at, self.quad_at
        elastance, slip = device.elastance(self.slip), tuple(self.slip)
        modes = list(zip(device.mass, device.damping, device.stiffness, device.coupling, device.gain, strict=True))
        weights, capacitance = device.weight, device.capacitance

        def rates(t, y):
            y = y.tolist()
            drive, z = piece(t), y[shunt_at:quad_at]
            v = device.electrode_voltage(y)
            v_t = v - sum(w * s for w, s in zip(weights, y[q_at + 1 : shunt_at], strict=True))
            drift = -device.strain_current(y) / capacitance
            current, z_rates, harvested, loss, source = flow(z, v, drift, elastance)
            power = heat = slipping = 0.0
            acceleration = []
            for i, (m, b, k, coupling, gain) in enumerate(modes):
                x, u, force = y[i], y[n + i], gain * drive
                acceleration.append((force + coupling * v_t - b * u - k * x) / m)
                power += force * u
                heat += b * u * u
            stop_rates = []
            for j, side in enumerate(slip):
                stop_rates.append(0.0 if side else current)
                if side:
                    slipping += weights[j] * y[q_at + 1 + j] * current
            ledger = (power, heat, slipping, harvested, loss, source, dc_of(z))
            return [*y[n : 2 * n], *acceleration, current, *stop_rates, *z_rates, *ledger]

        return rates

    # ---- guards ------------------------------------------------------------------------------------------------

    def _slack(self) -> float:
        """SLACK, or what a guard may change by between neighbouring floating-point times if that is more."""
        return SLACK + 16.0 * math.ulp(self.t) * self.fastest

    def _guard_units(self) -> list[str]:
        units = list(self.circuit.guard_units())
        if self.circuit.timing:
            units.append("strain")
        return units + ["current" if side else "stop" for side in self.slip]

    def _tolerances(self, units: list[str]) -> list[float]:
        stops_from = len(units) - self.device.stops
        sizes = [self.device.threshold[j - stops_from] if u == "stop" else self.peak[u] for j, u in enumerate(units)]
        return [self._slack() * size for size in sizes]

    def _guards(self, y) -> list[float]:
        """Values that are at or below zero while the present mode holds: circuit, extremum, stops."""
        device = self.device
        y = y.tolist()
        v, current = self.port(y)
        self.peak["voltage"] = max(self.peak["voltage"], abs(v))
        self.peak["current"] = max(self.peak["current"], abs(current))
        values = list(self.circuit.guards(y[device.shunt_at : self.quad_at], v, current))
        if self.circuit.timing:
            strain, side = device.strain_current(y), self.circuit.timing.side
            self.peak["strain"] = max(self.peak["strain"], abs(strain))
            values.append(-side * strain if side else abs(strain))
        for j, side in enumerate(self.slip):
            values.append(-side * current if side else abs(y[device.q_at + 1 + j]) - device.threshold[j])
        return values

    def _search(self, dense, start: float, end: float, levels: list[float]) -> tuple[float, int] | None:
        """First instant in a step at which a guard rises above its level, and which guard."""
        times = np.linspace(start, end, LOOKS_PER_STEP + 1)
        times[-1] = end
        before = start
        for time, y in zip(times, dense(times).T, strict=True):
            passed = [j for j, g in enumerate(self._guards(y)) if g > levels[j]]
            if passed:
                roots = [(self._root(dense, before, time, j, levels[j]), j) for j in passed]
                return min(roots)
            before = time
        return None

    def _root(self, dense, start, end, index, level) -> float:
        def excess(t):
            return self._guards(dense(t))[index] - level

        if excess(start) >= 0.0:
            return start
        return brentq(excess, start, end, xtol=1e-300, rtol=1e-15 * 4)

    # ---- events ------------------------------------------------------------------------------------------------

    def _note(self, name: str) -> None:
        if self.events and self.events[-1][0] == self.t:
            self.crowded += 1
            if self.crowded > MAX_EVENTS_AT_ONCE:
                raise RuntimeError(f"events without end at t = {self.t}: {self.events[-4:]}")
        else:
            self.crowded = 0
        self.events.append((self.t, name))

    def _fire(self, index: int) -> None:
        """Change the mode for the guard that was passed."""
        own, timing = len(self.circuit.guard_units()), self.circuit.timing
        if index < own:
            self._note(self.circuit.fire(index, self.device, self.y))
            return
        index -= own
        if timing and index == 0:
            if timing.side == 0:  # leaving rest is not an extremum
                timing.side = 1 if self.device.strain_current(self.y) > 0.0 else -1
                return
            self._note("maximum" if timing.side > 0 else "minimum")
            timing.extremum(self.t, timing.side)
            timing.side = -timing.side
            return
        j = index - (1 if timing else 0)
        at = self.device.q_at + 1 + j
        if self.slip[j]:
            self.slip[j] = 0
            self._note(f"stop_{j}_sticks")
        else:
            self.slip[j] = 1 if self.y[at] > 0.0 else -1
            self.y[at] = self.slip[j] * self.device.threshold[j]
            self._note(f"stop_{j}_slips")

    def _settle_stops(self) -> None:
        """Bring the stops in line with a current that jumped; its sign does not depend on which of them stick."""
        device = self.device
        _, current = self.port(self.y)
        if abs(current) <= self._slack() * self.peak["current"]:
            return
        for j, side in enumerate(self.slip):
            at, limit = device.q_at + 1 + j, device.threshold[j]
            if side and side * current < 0.0:
                self.slip[j] = 0
                self._note(f"stop_{j}_sticks")
            elif not side and abs(self.y[at]) >= limit * (1.0 - self._slack()) and self.y[at] * current > 0.0:
                self.slip[j] = 1 if current > 0.0 else -1
                self.y[at] = self.slip[j] * limit
                self._note(f"stop_{j}_slips")

    def _tie(self) -> None:
        """Put the charge exactly on the constraint of the present mode, which the integration only drifts along."""
        device = self.device
        target = self.circuit.tied_voltage(self.y[device.shunt_at : self.quad_at])
        if target is not None:
            self.y[device.q_at] += (target - device.electrode_voltage(self.y)) / device.elastance(self.slip)

    def _switch(self) -> None:
        """Carry out what is due now: openings first, then planned actions."""
        timing, circuit = self.circuit.timing, self.circuit
        if timing is None:
            return
        if self.open_at is not None and self.open_at <= self.t:
            self.open_at = None
            self._book(circuit.release(self.device, self.y))
            self._note("switch_opens")
        while timing.pending and timing.pending[0][0] <= self.t:
            _, kind = timing.pending.pop(0)
            if self.open_at is not None:
                continue  # still closed from the last action
            self._book(circuit.act(self.device, self.y, kind))
            if circuit.loop is None:
                self._note("discharge")
            else:
                self._note("switch_closes")
                self.open_at = self.t + circuit.loop.on_time

    def _book(self, ledger: Ledger) -> None:
        for name, energy in ledger._asdict().items():
            self.y[self.quad_at + QUADRATURES.index(name)] += energy

    # ---- integration -------------------------------------------------------------------------------------------

    def advance(self, end: float, recorder) -> None:
        """Integrate to ``end``; every step's dense output goes to ``recorder(run, dense, piece, t0, t1)``."""
        while True:
            self._switch()
            if self.t >= end:
                return
            stop = min([end, *(b for b in self.excitation.breaks if b > self.t)])
            timing = self.circuit.timing
            if timing:
                stop = min([stop, *(time for time, _ in timing.pending)])
                stop = stop if self.open_at is None else min(stop, self.open_at)
            self._smooth(stop, recorder)

    def _smooth(self, stop: float, recorder) -> None:
        """Integrate one mode until ``stop`` or its first event, whichever comes first."""
        self._tie()
        self._settle_stops()
        tolerances = self._tolerances(self._guard_units())
        start = self._guards(self.y)
        for j, (value, tolerance) in enumerate(zip(start, tolerances, strict=True)):
            if value > tolerance:
                self._fire(j)
                return
        levels = [tol if value >= -tol else 0.0 for value, tol in zip(start, tolerances, strict=True)]
        piece = self.excitation.piece(self.t, stop)
        options = {"rtol": self.rtol, "atol": self.atol, "max_step": self.max_step}
        solver = self.solver(self._equations(piece), self.t, self.y, stop, **options)
        while solver.status == "running":
            message = solver.step()
            if solver.status == "failed":
                raise RuntimeError(f"integration failed at t = {solver.t}: {message}")
            dense, before = solver.dense_output(), self.t
            hit = self._search(dense, before, solver.t, levels) if levels else None
            self.t = float(solver.t if hit is None else hit[0])
            self.y = solver.y.copy() if hit is None else dense(self.t)
            recorder(self, dense, piece, before, self.t)
            if hit is not None:
                self._fire(hit[1])
                return
