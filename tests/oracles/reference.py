"""Reference simulator of piezoharvest's tests: the equations of INTERFACE.md sections 1 and 2, solved by brute force.

It waits for the steady state instead of finding it, integrates with an adaptive high-order method instead of matrix
exponentials, and carries every energy as one more state. Slow, plain and independent: use it as an oracle only.

Covered: sine_force, sine_base, step_force and multisine excitation; any number of modes; hysteresis; all shunt kinds
but ``network``. Not covered: effects, catalogue entries, random and recorded excitation.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import minimize_scalar

from .reference_device import QUADRATURES
from .reference_engine import Run

LOOKS_FOR_PEAK = 12
ANDERSON_DEPTH = 10


class _Section:
    """State at both ends of the window, scaled to be of order one."""

    def __init__(self, start: np.ndarray, end: np.ndarray, largest: np.ndarray, span: float) -> None:
        self.scale = np.concatenate([np.maximum(largest, 1e-200), np.full(len(end) - len(largest), span)])
        # Another number of planned actions at the end than at the start: not periodic, whatever the states.
        self.comparable = len(start) == len(end)
        self.end = end / self.scale
        self.start = start / self.scale if self.comparable else None
        self.change = float(np.abs(self.end - self.start).max()) if self.comparable else 1.0


@dataclass
class ReferenceResult:
    """Outcome of one run; all averages and amplitudes are over ``window``.

    Attributes
    ----------
    final : dict
        End state: x, u (one per mode), q, stops, shunt states by name, and the discrete mode; accepted as ``z0``.
    events : list of (time, name)
        In order; names: maximum, minimum, switch_closes, switch_opens, discharge, bridge_conducts, bridge_blocks,
        stop_<j>_slips, stop_<j>_sticks. Extrema are noted for switched shunts only.
    t, force, x, u, v, i, q, v_dc : ndarray
        Samples; ``force`` is the base acceleration for base excitation, ``x`` and ``u`` are weighted by participation,
        ``i`` is the load current. At a jump the value is the one after it.
    modes_x : ndarray
        Displacement of each mode, one row per mode.
    window : tuple of float
        Last period of a sine, the whole run for other excitations.
    energy : dict
        Over the window, J: mechanical_in, damping, hysteresis, harvested, shunt_loss, source, stored (change of), and
        closure (relative).
    half_ranges : dict of functions
        By which the amplitudes are found when they are asked for: of all periods of ``steady`` those of the last only.
    change : float
        Largest change of any state over the window, relative to that state's largest value in it.
    periods, converged
        Set by ``steady``: periods simulated in all, and whether ``change`` fell below its tolerance.
    """

    final: dict
    events: list[tuple[float, str]]
    t: np.ndarray
    force: np.ndarray
    x: np.ndarray
    u: np.ndarray
    v: np.ndarray
    i: np.ndarray
    q: np.ndarray
    v_dc: np.ndarray
    modes_x: np.ndarray
    window: tuple[float, float]
    harvested_power: float
    mechanical_power: float
    half_ranges: dict[str, Callable[[], float]]
    dc_voltage: float
    energy: dict[str, float]
    change: float
    periods: int = 0
    converged: bool = False
    section: _Section | None = None

    @cached_property
    def displacement_amplitude(self) -> float:
        """Half of peak to peak."""
        return self.half_ranges["displacement"]()

    @cached_property
    def voltage_amplitude(self) -> float:
        """Half of peak to peak."""
        return self.half_ranges["voltage"]()

    @property
    def closure(self) -> float:
        """Energy that no entry accounts for, relative."""
        return self.energy["closure"]

    def count(self, name: str) -> int:
        """Count the events of one name within the window."""
        return sum(1 for time, event in self.events if event == name and time >= self.window[0])


class _Recorder:
    """Samples at requested times, and the dense steps of the window for its extremes."""

    def __init__(self, times: np.ndarray) -> None:
        self.times, self.next = times, 0
        self.rows: list[tuple[float, ...]] = []
        self.steps: list[tuple] | None = None
        self.largest: np.ndarray | None = None

    def open_window(self, run: Run) -> None:
        self.steps = []
        self.largest = np.maximum(np.abs(run.y), 1e-9 * run.sizes)

    def __call__(self, run: Run, dense, piece, start: float, end: float) -> None:
        while self.next < len(self.times) and self.times[self.next] < end:
            time = self.times[self.next]
            self.sample(run, dense(time), piece, time)
        if self.steps is not None and end > start:
            self.steps.append((dense, start, end))
            self.largest = np.maximum(self.largest, np.abs(dense(np.array([0.5 * (start + end), end]))).max(axis=1))

    def sample(self, run: Run, y, piece, time: float) -> None:
        device, n = run.device, run.device.modes
        v, current = run.port(y)
        x = device.displacement(y)
        u = sum(weight * y[n + i] for i, weight in enumerate(device.participation))
        v_dc = run.circuit.dc(y[device.shunt_at : run.quad_at])
        self.rows.append((time, piece(time), x, u, v, -current, y[device.q_at], v_dc, *y[:n]))
        self.next += 1

    def half_range(self, value) -> float:
        """Half of peak-to-peak of ``value(y)`` in the window, extremes refined on the dense output."""
        return 0.5 * (self._top(value, 1.0) + self._top(value, -1.0))

    def _top(self, value, sign: float) -> float:
        grids = [np.linspace(start, end, LOOKS_FOR_PEAK + 1) for _, start, end in self.steps]
        tops = [sign * value(dense(grid)) for (dense, *_), grid in zip(self.steps, grids, strict=True)]
        best, least = max(top.max() for top in tops), min(top.min() for top in tops)
        for (dense, *_), grid, top in zip(self.steps, grids, tops, strict=True):
            if top.max() < best - 1e-2 * (best - least):
                continue
            k = int(top.argmax())
            bounds = (grid[max(k - 1, 0)], grid[min(k + 1, LOOKS_FOR_PEAK)])
            if bounds[1] <= bounds[0]:
                continue
            options = {"xatol": 1e-9 * (bounds[1] - bounds[0])}
            peak = minimize_scalar(
                lambda t, d=dense: -sign * value(d(t)), bounds=bounds, method="bounded", options=options
            )
            best = max(best, -peak.fun)
        return best


def _total(run: Run, periods: int | None, duration: float | None) -> tuple[float, float]:
    """End of the run and start of its window."""
    period = run.excitation.period
    if duration is None:
        if period is None:
            duration = 2.0 * run.excitation.duration if run.excitation.kind == "step_force" else run.excitation.duration
        else:
            # Whole periods by multiplication: adding them up would move the section.
            return (periods or 1) * period, ((periods or 1) - 1) * period
    start = 0.0 if period is None else max(0.0, duration - period)
    return float(duration), start


def _energy(run: Run, before: np.ndarray, stored_before: float) -> dict[str, float]:
    change = run.y[run.quad_at :] - before
    energy = dict(zip(QUADRATURES[:-1], change[:-1].tolist(), strict=True))
    energy["stored"] = run.stored() - stored_before
    spent = [energy[name] for name in ("damping", "hysteresis", "harvested", "shunt_loss")]
    missing = energy["mechanical_in"] + energy["source"] - sum(spent) - energy["stored"]
    scale = max(abs(energy["mechanical_in"]), abs(energy["source"]), *map(abs, spent), abs(energy["stored"]))
    energy["closure"] = missing / scale if scale > 0.0 else 0.0
    return energy


def simulate(
    study: dict,
    shunt_index: int,
    periods: int | None = None,
    duration: float | None = None,
    samples_per_period: int = 64,
    z0: dict | None = None,
    *,
    times=None,
    method: str = "DOP853",
    rtol: float = 1e-12,
) -> ReferenceResult:
    """Integrate a study from rest, or from ``z0``, for a number of periods or a duration.

    Parameters
    ----------
    study : dict
        As parsed by ``tomllib``.
    shunt_index : int
        Which of ``study["shunts"]``.
    periods : int, optional
        Drive periods (sine only); default 1.
    duration : float, optional
        Seconds, instead of ``periods``. Default without a period: the multisine's duration, twice that of a step.
    samples_per_period : int
        Density of the samples; without a period, their number over the whole run. 0: end point only.
    z0 : dict, optional
        ``final`` of an earlier result. Time starts at 0 again, so continue from whole periods.
    times : array_like, optional
        Ascending sample times, instead of ``samples_per_period``.
    method : {"DOP853", "Radau"}
        Radau for stiff circuits (fast RC); slower otherwise.
    rtol : float
        Relative tolerance of the integration.

    Returns
    -------
    ReferenceResult
    """
    run = Run(study, shunt_index, method, rtol, z0)
    end, start = _total(run, periods, duration)
    if times is None:
        count = samples_per_period * (max(1, round(end / run.excitation.period)) if run.excitation.period else 1)
        times = np.linspace(0.0, end, count + 1) if count else np.array([end])
    recorder = _Recorder(np.asarray(times, dtype=float))
    run.advance(start, recorder)
    recorder.open_window(run)
    before, stored_before, section = run.y.copy(), run.stored(), run.section()
    run.advance(end, recorder)
    while recorder.next < len(recorder.times) and recorder.times[recorder.next] <= end * (1.0 + 1e-12):
        recorder.sample(run, run.y, run.excitation.piece(end, end), recorder.times[recorder.next])
    energy, device, span = _energy(run, before[run.quad_at :], stored_before), run.device, end - start
    columns = np.array(recorder.rows).T.reshape(-1, len(recorder.rows))
    section = _Section(section, run.section(), recorder.largest[: run.quad_at], span)
    return ReferenceResult(
        run.snapshot(),
        run.events,
        *columns[:8],
        modes_x=columns[8:],
        window=(start, end),
        harvested_power=energy["harvested"] / span,
        mechanical_power=energy["mechanical_in"] / span,
        half_ranges={
            "displacement": lambda: recorder.half_range(device.displacement),
            "voltage": lambda: recorder.half_range(device.electrode_voltage),
        },
        dc_voltage=(run.y[-1] - before[-1]) / span,
        energy=energy,
        change=section.change,
        section=section,
    )


def steady(
    study: dict,
    index: int,
    tol: float = 1e-9,
    max_periods: int = 2000,
    *,
    accelerate: bool = True,
    samples_per_period: int = 64,
    z0: dict | None = None,
    method: str = "DOP853",
    rtol: float = 1e-12,
) -> ReferenceResult:
    """Integrate period by period until the state repeats.

    Parameters
    ----------
    study, index, samples_per_period, z0, method, rtol
        As for ``simulate``; the excitation must be a sine.
    tol : float
        On ``change``. Without acceleration the distance left is larger, by 1/(1 - contraction per period).
    max_periods : int
        After these it returns what it has, with ``converged`` False.
    accelerate : bool
        Anderson extrapolation of the state at the section, given up whenever it makes things worse. Where the
        steady state is not unique (stops that never slip in it) it may find another one than waiting from rest would.

    Returns
    -------
    ReferenceResult
        Of the last period; it has been integrated, never extrapolated.
    """
    history = _Anderson(Run(study, index, method, rtol, None))
    best, waited, patience = math.inf, 0, 1
    state = z0
    for done in range(1, max_periods + 1):
        result = simulate(study, index, 1, None, samples_per_period, state, method=method, rtol=rtol)
        result.periods, result.converged = done, result.change < tol
        if result.converged:
            return result
        state = result.final
        if not accelerate:
            continue
        if waited:
            waited -= 1
        elif result.change > 3.0 * best:
            # Let the transient that the bad guess has caused die down, for longer after each failure.
            history.forget()
            best, waited, patience = math.inf, patience, 2 * patience
        else:
            best = min(best, result.change)
            state = history.extrapolate(result)
    return result


class _Anderson:
    """Anderson acceleration of the period map, while the mode at the section stays the same."""

    def __init__(self, run: Run) -> None:
        self.device, self.names = run.device, run.circuit.states
        self.forget()

    def forget(self) -> None:
        self.starts, self.ends, self.mode = [], [], None

    def extrapolate(self, result: ReferenceResult) -> dict:
        """State to try the next period from: the plain end of this one while there is too little to go by."""
        mode, section = result.final["mode"], result.section
        pending = len(mode["timing"]["pending"]) if mode["timing"] else 0
        key = (tuple(mode["slip"]), mode["open_in"] is None, str(mode["circuit"]), pending, len(result.events))
        if key != self.mode or not section.comparable:
            self.forget()
            self.mode = key
        if not section.comparable:
            return result.final
        self.starts.append(section.start * section.scale)
        self.ends.append(section.end * section.scale)
        del self.starts[:-ANDERSON_DEPTH], self.ends[:-ANDERSON_DEPTH]
        if len(self.ends) < 3:
            return result.final
        ends = np.array(self.ends) / section.scale
        residuals = ends - np.array(self.starts) / section.scale
        weights = np.linalg.lstsq(np.diff(residuals, axis=0).T, residuals[-1], rcond=1e-12)[0]
        guess = (ends[-1] - weights @ np.diff(ends, axis=0)) * section.scale
        return self._unpack(guess, result.final)

    def _unpack(self, section: np.ndarray, final: dict) -> dict:
        """Turn an extrapolated section into a state that the mode allows."""
        device, n = self.device, self.device.modes
        y, times = section[: device.shunt_at + len(self.names)], section[device.shunt_at + len(self.names) :]
        limits = np.array(device.threshold)
        stops = np.clip(y[device.q_at + 1 : device.shunt_at], -limits, limits)
        mode = dict(final["mode"])
        stops = [float(side * r if side else s) for s, r, side in zip(stops, limits, mode["slip"], strict=True)]
        shunt = dict(zip(self.names, y[device.shunt_at :].tolist(), strict=True))
        if "dc_voltage" in shunt:
            shunt["dc_voltage"] = max(shunt["dc_voltage"], 0.0)
        if mode["circuit"].get("closed") is False:
            shunt["inductor_current"] = 0.0
        if mode["timing"]:
            pending = mode["timing"]["pending"]
            moved = [(max(0.0, float(time)), kind) for time, (_, kind) in zip(times, pending, strict=False)]
            mode["timing"] = {**mode["timing"], "pending": moved}
        if mode["open_in"] is not None:
            mode["open_in"] = max(0.0, float(times[-1]))
        x, u, q = y[:n].tolist(), y[n : 2 * n].tolist(), float(y[device.q_at])
        return {**final, "x": x, "u": u, "q": q, "stops": stops, "shunt": shunt, "mode": mode}
