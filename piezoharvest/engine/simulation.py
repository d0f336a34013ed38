"""Public simulator: response of a system to an excitation."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.excitation import Excitation, Ramps
from piezoharvest.description.limits import check_length
from piezoharvest.description.parameters import check_kind
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.system import System
from piezoharvest.engine.batch_means import batch_edges, rms_error, standard_error
from piezoharvest.engine.lowering.lower import Lowered, lower, symmetric
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory.state import EngineState
from piezoharvest.engine.plausibility import (
    NO_BOUNDS,
    Bounds,
    bounds,
    closure,
    faults,
    uncertainty_message,
    without_rounding,
)
from piezoharvest.engine.response import FAILED, Response, Waveforms, figure_of_merit
from piezoharvest.engine.run import Machine
from piezoharvest.engine.steady_search import EngineError, Orbit, Shooting, check
from piezoharvest.engine.steady_state.shooting import ACCEPTED
from piezoharvest.engine.work_limit import Budget
from piezoharvest.linear.sampled import sampled_loop
from piezoharvest.progress import silent, watched

MAX_LOG = 100_000
MAX_SAMPLES = 1_000_000  # of a transient: no more samples than this are taken
STEADY_SPAN = 1e-3  # relative: what grows or dies away would change the averages by as much
UNSETTLED_PERIODS = 64  # periods of the average if there is no periodic steady state


@np.errstate(all="ignore")  # results that are not finite are reported in the response
def simulate(
    system: System,
    excitation: Excitation,
    *,
    transient: float | None = None,
    samples: int = 512,
    attenuation: bool = True,
    budget: Budget | None = None,
    progress: Callable[[str], object] = silent,
) -> Response:
    """Simulate a system exactly, event by event.

    Parameters
    ----------
    system : System
        Transducer and shunt.
    excitation : Excitation
    transient : float, optional
        Length in s of a run from rest. By default a periodic excitation gives the periodic steady state, which is found
        directly; any other excitation is run from rest over its length.
    samples : int
        Waveform samples in a period, or in the length of a non-periodic excitation.
    attenuation : bool
        Compare the displacement with that of the short circuit, which is simulated for it; without, `attenuation_db`
        is NaN.
    budget : Budget, optional
        Work limit, from which the work done is subtracted; default that of one simulation.
    progress : callable, optional
        Takes messages on how far long work is.

    Returns
    -------
    Response
        Averages over one period, or over the whole transient.

    Raises
    ------
    ParameterError
        An effect of the transducer takes a power that is no whole number, or acts on a shunt with which it cannot be
        simulated, or there is too much of something (`piezoharvest.description.limits`).

    Notes
    -----
    Piecewise linear models are propagated by matrix exponentials, so there is no time step to choose: events are
    located to 1e-12 s and energy closes to 1e-10. With effects that are nonlinear between events (a voltage-dependent
    capacitance, stiffening, nonlinear or drifting coupling) the same holds for the motion under their outputs, which
    are cubics of time; waveforms are then right to about 1e-8. A drift continues over the length of a transient, and is
    frozen in a steady state.
    """
    check_kind("system", system, System, "System(transducer, shunt) makes one")
    check_kind("excitation", excitation, Excitation, "such as SineForce(amplitude=0.02, frequency=50.0)")
    periodic = transient is None and excitation.period is not None
    length = None if periodic else _length(system, excitation, transient)
    lowered = lower(system, excitation, length)
    lowered = lowered._replace(budget=budget or lowered.budget)
    try:
        if length is None:
            most = bounds(system.transducer, excitation, lowered)
            with _watched_search(progress, system.shunt.kind, lowered.budget):
                response = _steady(lowered, excitation, samples, system.shunt, most)
            power, moved = response.harvested_power, response.displacement_amplitude
            merit = float(figure_of_merit(power, moved, system, excitation))
            response = _replaced(response, figure_of_merit=merit)
        else:
            response = _transient(lowered, system, excitation, length, samples, progress)
    except EngineError as error:
        return _replaced(_failed(system.shunt.kind, str(error)), exhausted=lowered.budget.left <= 0)
    if lowered.unfelt:
        response = _with_remark(
            response, f"{', '.join(lowered.unfelt)}: not part of a simulation, only of measured records"
        )
    if system.shunt.sampled and not (radius := sampled_loop(system).radius) < 1.0:
        response = _with_remark(response, f"the sampled loop is unstable, spectral radius {radius:.6g}")
    if response.waveforms is not None:
        remark = system.shunt.remark(response.waveforms.event_names, response.dc_voltage)
        response = _with_remark(response, remark)
    if response.waveforms is not None and response.harvested_power == 0:
        why = system.shunt.why_nothing(response.waveforms.event_names, response.voltage_amplitude)
        response = _with_remark(response, why)
    idle = [effect.name for effect in system.transducer.effects if _is_idle(effect, system.shunt)]
    if idle:
        response = _with_remark(response, f"{', '.join(idle)}: {system.shunt.kind} has no part that it changes")
    if system.shunt == system.shorted.shunt:
        return response
    if not attenuation:
        return _replaced(response, attenuation_db=np.nan)
    reference, reason = _short_circuit(system.shorted, excitation, transient)
    if not reason and not response.displacement_amplitude > 0:
        reason = "nothing moves"
    if reason:
        return _with_remark(_replaced(response, attenuation_db=np.nan), f"no attenuation: {reason}")
    return _replaced(response, attenuation_db=float(20 * np.log10(response.displacement_amplitude / reference)))


def _watched_search(progress: Callable[[str], object], kind: str, budget: Budget) -> AbstractContextManager[None]:
    """Tell how much a search has done of what it may: how near it is to its end is not known before the last steps."""
    allowed = budget.left
    return watched(progress, f"{kind}: seeking the steady state", lambda: 1.0 - budget.now / allowed, most=True)


def _is_idle(effect: Effect, shunt: Shunt) -> bool:
    """True if an effect is only one of the circuit, and not of this one."""
    return type(effect).act is Effect.act and not effect.acts_on(shunt)


@lru_cache(maxsize=64)
def _short_circuit(shorted: System, excitation: Excitation, transient: float | None) -> tuple[float, str]:
    """Displacement amplitude with shorted electrodes, the reference of attenuation, and a reason not to use it."""
    response = simulate(shorted, excitation, transient=transient, samples=1)
    if not response.converged:
        return np.nan, f"with shorted electrodes it is not to be trusted ({response.message})"
    moves = response.displacement_amplitude > 0
    return response.displacement_amplitude, "" if moves else "nothing moves with shorted electrodes"


def _with_remark(response: Response, what: str) -> Response:
    """The response with one more remark in its message."""
    return _replaced(response, message="; ".join(filter(None, (response.message, what))))


def _replaced(response: Response, **changes) -> Response:
    return replace(response, **changes)


def _steady(lowered: Lowered, excitation: Excitation, samples: int, shunt: Shunt, most: Bounds) -> Response:
    """Find the periodic steady state and record one period of it; a long run where there is none."""
    orbit, mirrored, message, evaluations, settles = search(lowered, excitation)
    if not settles:
        return _unsettled(lowered, excitation, samples, shunt, orbit, evaluations)
    period, begin = excitation.period, orbit.time
    assert period is not None
    # The section may be at any phase; samples are taken at the instants of a period that begins at phase zero.
    grid = np.arange(samples) * period / samples
    offset = np.mod(grid - begin, period)
    offset[offset >= period * (1 - 1e-12)] = 0.0  # by rounding; it would lie after the end
    order = np.argsort(offset, kind="stable")
    shooting = Shooting(Machine(lowered, ledger=True), period, mirrored)
    state = shooting.load(orbit, track=True, log=MAX_LOG, sample_time=begin + offset[order])
    before = _stored(shooting.machine, state)
    check(shooting.machine.run(state, begin + period))
    if not shooting.repeats(orbit, state):
        return _unsettled(lowered, excitation, samples, shunt, replace(orbit, residual=np.inf), evaluations)
    # Energy that a large smoothing capacitor gains or loses within the tolerance of the search is not an imbalance.
    change = _stored(shooting.machine, state) - before
    response = _response(lowered, state, shunt, period, begin, change, before, most)
    response.energy.pop("stored", None)
    response = _replaced(response, waveforms=_from_phase_zero(response.waveforms, grid, order, begin, period))
    return _finish(response, message, evaluations)


def search(lowered: Lowered, excitation: Excitation) -> tuple[Orbit, bool, str, float, bool]:
    """Find the steady state that a motion from rest reaches.

    Returns the orbit, True if the search was over half the period, a remark, the periods simulated, and True if motions
    do settle on the orbit.
    """
    period = excitation.period
    assert period is not None
    mirrored = symmetric(lowered, excitation)
    shooting = Shooting(Machine(lowered), period, mirrored)
    orbit = shooting.find()
    evaluations = orbit.evaluations
    if mirrored and not orbit.converged:
        # A symmetric orbit may be unstable where an asymmetric one is stable.
        mirrored = False
        shooting = Shooting(Machine(lowered), period, mirrored)
        orbit = shooting.find()
        evaluations += orbit.evaluations
    if not orbit.converged:
        return orbit, mirrored, "", evaluations, False
    codes = lowered.program.guard_code
    supplies = pg.TURN_ON in codes or pg.POWERED in codes
    # Whether a supply or a control is on depends on how its store was charged.
    arrives, here = shooting.from_rest(orbit, charged=not supplies)
    if arrives:
        empty = supplies or np.all(lowered.program.odd < 0) or shooting.from_rest(orbit, charged=False)[0]
        elsewhere = "a run that starts from rest with an empty smoothing capacitor does not reach this steady state"
        return orbit, mirrored, "" if empty else elsewhere, evaluations, True
    shooting = Shooting(Machine(lowered), period, False)
    reached = shooting.find(here)
    evaluations += reached.evaluations
    if not reached.converged or not shooting.near(reached, here):
        return orbit, mirrored, "", evaluations, False
    message = "several periodic steady states exist; this is the one that a run from rest reaches"
    return reached, False, message, evaluations, True


def _from_phase_zero(w: Waveforms | None, grid, order, begin: float, period: float) -> Waveforms:
    """Reorder the samples of a period so that it begins at phase zero."""
    assert w is not None
    back = np.argsort(order, kind="stable")
    signals = {name: getattr(w, name)[back] for name in pg.OUTPUTS}
    events = np.mod(w.event_times + begin, period)
    sequence = np.argsort(events, kind="stable")
    names = tuple(w.event_names[k] for k in sequence)
    return Waveforms(grid, **signals, event_times=events[sequence], event_names=names)


def _stored(machine: Machine, state: EngineState) -> float:
    """Stored energy, J."""
    # Outputs of smooth elements are consistent with the state only after a run has begun.
    check(machine.run(state, state.clock[st.NOW]))
    storage = machine.lowered.program.storage
    z = state.z[: len(storage)]
    return 0.5 * float(z @ storage @ z)


def _length(system: System, excitation: Excitation, transient: float | None) -> float:
    """Length of a transient, s."""
    length = transient if transient is not None else excitation.length
    if length is None:
        raise ValueError(f"{excitation.kind} has no length, a transient needs one")
    check_length(system.transducer, excitation, length)
    return length


def _transient(
    lowered: Lowered,
    system: System,
    excitation: Excitation,
    t_end: float,
    samples: int,
    progress: Callable[[str], object],
) -> Response:
    if excitation.period is not None:
        step = max(excitation.period / samples, t_end / MAX_SAMPLES)
        times = np.arange(int(np.floor(t_end / step * (1 + 1e-12))) + 1) * step
    else:
        times = np.linspace(0.0, t_end, 8 * samples + 1)
        if isinstance(lowered.signal, Ramps):
            count = int(np.searchsorted(lowered.signal.times, t_end, side="right"))
            inside = lowered.signal.times[: count : 1 + count // MAX_SAMPLES].copy()
            times = np.union1d(times, inside) if len(inside) < len(times) else inside
    machine = Machine(lowered, ledger=True)
    state = machine.state(track=True, log=MAX_LOG, sample_time=times)
    before = _stored(machine, state)
    # Of noise and of recorded signals averages are samples of what a longer run would give.
    edges = batch_edges(system, t_end) if excitation.samples else np.empty(0)
    harvested, place = [], lowered.categories.index("harvested")
    with watched(progress, system.shunt.kind, lambda: float(state.clock[st.NOW]) / t_end):
        for edge in (*edges, t_end):
            check(machine.run(state, float(edge)))
            harvested.append(float(state.energy[place]))
    change = _stored(machine, state) - before
    response = _finish(_response(lowered, state, system.shunt, t_end, 0.0, change, before), "", np.nan)
    return _with_errors(response, np.array(harvested[:-1]), edges) if len(edges) else response


def _with_errors(response: Response, harvested: np.ndarray, edges: np.ndarray) -> Response:
    """The response with standard errors, from the energy (n,) in J harvested up to each edge (n,) of batches."""
    w = response.waveforms
    assert w is not None
    rms, error = rms_error(w.time, w.displacement, edges)
    power = standard_error(np.diff(harvested) / np.diff(edges))
    errors = {"harvested_power": power, "displacement_rms": error}
    return _replaced(response, displacement_rms=rms, standard_error=errors)


def _unsettled(lowered, excitation, samples: int, shunt: Shunt, orbit: Orbit, evaluations: float) -> Response:
    """Averages of a long run from rest where no periodic steady state was found."""
    period, skipped = excitation.period, 10 * UNSETTLED_PERIODS
    machine = Machine(lowered, ledger=True)
    state = _after(machine, skipped * period, UNSETTLED_PERIODS * period)
    begin, window = skipped * period, UNSETTLED_PERIODS * period
    times = begin + np.arange(samples * UNSETTLED_PERIODS) * period / samples
    recorder = machine.state(track=True, log=MAX_LOG, sample_time=times)
    recorder.follow(state)
    before = _stored(machine, recorder)
    check(machine.run(recorder, begin + window))
    change = _stored(machine, recorder) - before
    response = _response(lowered, recorder, shunt, window, begin, change, before)
    energy = {key: value / UNSETTLED_PERIODS if key != "closure" else value for key, value in response.energy.items()}
    if orbit.converged:
        reason = "a periodic solution exists and is stable, but a run from rest does not reach it"
    elif orbit.residual <= ACCEPTED:
        reason = f"the periodic solution is unstable (multiplier {orbit.radius:.4g})"
    else:
        reason = f"no periodic solution was found (relative change over a period {orbit.residual:.1e})"
    message = f"no steady state: {reason}; averages are over {UNSETTLED_PERIODS} periods after {skipped}"
    if response.wakes_per_hour is not None:
        message += "; a transient shows how a supply turns on and off"
    events = response.events_per_period // UNSETTLED_PERIODS
    response = _replaced(response, period=period, energy=energy, events_per_period=events)
    spans = [float(each.extremes[0, 1] - each.extremes[0, 0]) for each in (state, recorder)]
    if response.converged and abs(spans[1] - spans[0]) <= STEADY_SPAN * spans[1]:
        message = (
            f"samples do not repeat with the period, or are rounded: averages are over {UNSETTLED_PERIODS} periods"
        )
        return _replaced(response, message=message, periods_evaluated=evaluations + skipped)
    return _replaced(response, converged=False, message=message, periods_evaluated=evaluations + skipped)


def _after(machine: Machine, time: float, window: float) -> EngineState:
    """State after a run from rest; under a controller's clock with the extremes in the last part of it (s)."""
    state = machine.state()
    if machine.lowered.program.switched != pg.CLOCKED:
        check(machine.run(state, time))
        return state
    check(machine.run(state, time - window))
    watched = machine.state(track=True)
    watched.follow(state)
    check(machine.run(watched, time))
    return watched


def _response(
    lowered: Lowered,
    state: EngineState,
    shunt: Shunt,
    length: float,
    begin: float,
    change: float,
    before: float,
    most: Bounds | None = None,
) -> Response:
    """Response from the state at the end of a run.

    The run began at `begin` (s) with the stored energy `before` (J), lasted `length` (s) and changed it by `change`.
    For a steady state the bounds of its energies are given.
    """
    energy = {name: float(e) for name, e in zip(lowered.categories, state.energy, strict=True)}
    dc_time = energy.pop(pg.MEAN_DC)
    if energy["source"] == 0.0:
        del energy["source"]
    half = 0.5 * (state.extremes[:, 1] - state.extremes[:, 0])
    stored = 0.0 if most is not None else before  # in a steady state only flows count
    computed, energy = energy, without_rounding(energy, before if most is not None else 0.0)
    if not any(energy.values()) and most is not None:
        computed, change = energy, 0.0
    share, largest = (float(value) for value in closure(computed, change, stored))
    wrong = faults(computed, change, before, half[0], most or NO_BOUNDS, periodic=most is not None)
    found = next((sentence for sentence, holds in wrong.items() if holds), "")
    if change != 0.0:
        energy["stored"] = change
    energy["closure"] = share
    count = min(int(state.D[st.LOGGED]), len(state.log_time))
    drawn = slice(0, int(state.D[st.SAMPLED]))
    waveforms = Waveforms(
        state.sample_time[drawn] - begin,
        *np.ascontiguousarray(state.samples[drawn].T),
        event_times=state.log_time[:count] - begin,
        event_names=tuple(map(pg.EVENT_NAMES.__getitem__, state.log_code[:count].tolist())),
    )
    return Response(
        shunt=shunt.kind,
        converged=not found,
        message=found if found else uncertainty_message(computed["harvested"], share * largest),
        period=length,
        harvested_power=energy["harvested"] / length,
        mechanical_power=energy["mechanical_in"] / length,
        displacement_amplitude=float(half[0]),
        voltage_amplitude=float(half[1]),
        dc_voltage=dc_time / length,
        attenuation_db=0.0,
        energy=energy,
        events_per_period=int(state.D[st.LOGGED]),
        periods_evaluated=0,
        waveforms=waveforms,
        **shunt.figures(_states_of(lowered, state)),
        **_of_the_store(lowered, state, length, from_rest=begin == 0.0 and most is None),
    )


def _states_of(lowered: Lowered, state: EngineState) -> dict[str, float]:
    """States in SI units, by name."""
    scale = lowered.program.scale
    return {name: float(z) for name, z in zip(lowered.states, state.z[: len(scale)] * scale, strict=True)}


def _of_the_store(lowered: Lowered, state: EngineState, length: float, from_rest: bool) -> dict[str, Any]:
    """Figures of a smoothing capacitor and of the supply that it feeds, after a run of this length (s)."""
    if "dc" not in lowered.states:
        return {}
    k, program = lowered.states.index("dc"), lowered.program
    figures = {"energy_stored": 0.5 * float(program.storage[k, k] * state.z[k] ** 2)}
    if pg.POWERED in program.guard_code and state.counts[pg.POWERED] and from_rest:
        figures["time_to_start"] = float(state.first_times[pg.POWERED])
    if pg.TURN_ON not in program.guard_code:
        return figures
    wakes, hours = int(state.counts[pg.TURN_ON]), length / 3600.0
    figures["wakes_per_hour"] = wakes / hours
    if pg.SENT in program.guard_code:
        figures["packets_per_hour"] = int(state.counts[pg.SENT]) / hours
    return figures | ({"time_to_turn_on": float(state.first_times[pg.TURN_ON])} if wakes and from_rest else {})


def _finish(response: Response, message: str, evaluations: float) -> Response:
    if not response.converged:
        message = f"{response.message}: {response.energy['closure']:.1e} of the energy is unaccounted for"
    elif response.message:
        message = "; ".join(filter(None, (message, response.message)))
    return _replaced(response, message=message, periods_evaluated=evaluations)


def _failed(kind: str, reason: str) -> Response:
    """Response without results, with the reason in its message."""
    entries = ("mechanical_in", "harvested", "damping", "hysteresis", "shunt_loss")
    nothing: dict[str, float] = {**dict.fromkeys(entries, 0.0), "closure": 1.0}
    return Response(kind, False, f"{FAILED} {reason}", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, np.nan, nothing, 0, 0)
