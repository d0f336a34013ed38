"""Steady states from a cold start: in a few periods, whatever the smoothing capacitor, and the right ones."""

import numpy as np
import pytest
from oracles.reference import steady
from random_studies import random_study
from selection import with_slow
from studies import BENCH, DRIVE, LOOP, STOPS, bench, objects, solve

from piezoharvest.engine import simulate
from piezoharvest.engine.lowering.lower import lower
from piezoharvest.engine.run import Machine
from piezoharvest.engine.simulation import search
from piezoharvest.engine.steady_search import Shooting, check
from piezoharvest.linear import frequency_response

CAPACITANCES = np.logspace(-9, -3, 13)
LOADS = np.logspace(5, 7, 5)
PERIODS = 300
MOST = 30


def continued(study):
    """Relative distances that PERIODS periods lead away from the steady state: of the state, and of the dc voltage.

    Of a capacitor that discharges for 1e6 periods, 300 show little. The distance that the dc voltage has from its fixed
    point is at most its change over the share of a discharge that they are, for the bridge only makes it faster.
    """
    system, excitation = objects(study)
    lowered = lower(system, excitation)
    orbit, mirrored, _, _, settles = search(lowered, excitation)
    assert settles
    shooting = Shooting(Machine(lowered), excitation.period, mirrored)
    state, span = shooting.load(orbit), PERIODS * excitation.period
    before = state.z[: len(lowered.states)].copy()
    check(shooting.machine.run(state, orbit.time + span))
    change, dc, shunt = state.z[: len(lowered.states)] - before, lowered.states.index("dc"), system.shunt
    shown = -np.expm1(-span / (shunt.load_resistance * shunt.smoothing_capacitance))
    return np.linalg.norm(change) / np.linalg.norm(before), abs(change[dc] / before[dc]) / shown


@pytest.mark.parametrize(
    "hysteresis", [pytest.param(None, id="plain", marks=pytest.mark.slow), pytest.param(STOPS, id="hysteresis")]
)
@pytest.mark.parametrize(
    "kind", with_slow(["rectifier", "parallel_sshi", "series_sshi"], slow=lambda kind: "par" not in kind)
)
def test_few_periods_for_every_capacitor_and_load(kind, hysteresis):
    loop = LOOP if kind != "rectifier" else {}
    device = {"hysteresis": hysteresis} if hysteresis else {}
    wrong = []
    for capacitance in CAPACITANCES:
        for load in LOADS:
            shunt = {"kind": kind, "smoothing_capacitance": capacitance, "load_resistance": load, **loop}
            study = bench(shunt, **device)
            found = solve(study, samples=1)
            where = f"{capacitance:.1e} F, {load:.1e} ohm"
            if not (found.converged and found.energy["closure"] < 1e-10):
                wrong.append(f"{where}: {found.message or found.energy['closure']}")
                continue
            if found.periods_evaluated > MOST:
                wrong.append(f"{where}: {found.periods_evaluated:.1f} periods")
            whole, dc = continued(study)
            if not (whole <= 1e-6 and dc <= 1e-6):
                wrong.append(f"{where}: {PERIODS} more periods lead away by {whole:.1e}, dc from its end by {dc:.1e}")
    assert not wrong, "\n".join(wrong)


def against_waiting(study, relative=1e-6, **options):
    """The steady state is that which the oracle's own long run ends in; `options` as in the oracle."""
    options = {"tol": 1e-10, "max_periods": 400, "samples_per_period": 0, **options}
    found, wanted = solve(study), steady(study, 0, **options)
    assert wanted.converged and found.converged, found.message
    size = abs(wanted.mechanical_power)
    assert abs(found.harvested_power - wanted.harvested_power) <= relative * max(wanted.harvested_power, 1e-3 * size)
    assert found.displacement_amplitude == pytest.approx(wanted.displacement_amplitude, rel=relative)
    assert found.voltage_amplitude == pytest.approx(wanted.voltage_amplitude, rel=relative)
    return found, wanted


@pytest.mark.parametrize(
    "hysteresis", [pytest.param(None, id="plain"), pytest.param(STOPS, id="hysteresis", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("kind", ["rectifier", "parallel_sshi", "series_sshi"])
def test_a_cold_start_against_the_oracle(kind, hysteresis):
    loop = LOOP if kind != "rectifier" else {}
    device = {"hysteresis": hysteresis} if hysteresis else {}
    shunt = {"kind": kind, "smoothing_capacitance": 1e-7, "load_resistance": 1e5, **loop}
    against_waiting(bench(shunt, **device))


OPEN = float(abs(frequency_response(objects(bench({"kind": "open"}))[0], [DRIVE["frequency"]]).voltage[0]))
OPEN_AMPLITUDE = OPEN * DRIVE["amplitude"]


@pytest.mark.parametrize("share", [1e-2, 1e-3, 1e-4, 1e-6, 1e-7, 1e-8, 1e-9])
def test_diodes_that_just_conduct(share):
    """A dc voltage hardly below the open one: conduction begins and ends within a small part of the period.

    Power grows from zero with the share as its first power, for so does the charge that is let through.
    """
    below = solve(bench({"kind": "rectifier", "dc_voltage": OPEN_AMPLITUDE * (1 - share)}))
    half = solve(bench({"kind": "rectifier", "dc_voltage": OPEN_AMPLITUDE * (1 - share / 2)}))
    above = solve(bench({"kind": "rectifier", "dc_voltage": OPEN_AMPLITUDE * (1 + share)}))
    for found in (below, half, above):
        assert found.converged, found.message
        assert found.energy["closure"] < 1e-10
    assert above.harvested_power == 0.0 and "diodes conduct" not in above.waveforms.event_names
    assert below.waveforms.event_names.count("diodes conduct") == 2
    assert 0.0 < half.harvested_power < below.harvested_power
    assert below.harvested_power / half.harvested_power == pytest.approx(2.0, abs=0.02 + 30 * share)


@pytest.mark.slow
@pytest.mark.parametrize("share", [1e-2, 1e-4])
def test_grazing_diodes_against_the_oracle(share):
    against_waiting(bench({"kind": "rectifier", "dc_voltage": OPEN_AMPLITUDE * (1 - share)}))
    drop = 0.5 * OPEN_AMPLITUDE * (1 - share) - 1.0
    against_waiting(bench({"kind": "rectifier", "dc_voltage": 2.0, "diode_drop": drop}))


@pytest.mark.parametrize("kind", ["parallel_sshi", "rectifier"])
@pytest.mark.parametrize("capacitance", [1e-9, pytest.param(1e-8, marks=pytest.mark.slow)])
def test_discontinuous_conduction_against_the_oracle(kind, capacitance):
    """The capacitor empties within the period: the bridge conducts again and again, or never lets go."""
    loop = LOOP if kind != "rectifier" else {}
    shunt = {"kind": kind, "smoothing_capacitance": capacitance, "load_resistance": 1e5, **loop}
    found, wanted = against_waiting(bench(shunt))
    assert found.waveforms.event_names.count("diodes conduct") == wanted.count("bridge_conducts")


# A piezoelectric stack, linear: 24 kHz beside a drive at 1 Hz.
STACK = {"mass": 0.0158, "damping": 1250.0, "stiffness": 3.607e8, "coupling": 11.436, "capacitance": 1.85e-6}
CYCLE = {"kind": "sine_force", "amplitude": 500.0, "offset": 625.0, "frequency": 1.0}
COIL = {"inductance": 47e-3, "quality": 6.0}
BEHIND = [
    {"dc_voltage": 1.0}, {"dc_voltage": 5.0}, {"dc_voltage": 3.0, "diode_drop": 0.3},
    {"smoothing_capacitance": 1e-5, "load_resistance": 1e6},
]  # fmt: skip


def on_stack(kind, behind):
    return {"transducer": STACK, "excitation": CYCLE, "shunts": [{"kind": kind, **COIL, **behind}]}


@pytest.mark.parametrize("behind", BEHIND, ids=str)
@pytest.mark.parametrize("kind", ["parallel_sshi", "series_sshi"])
def test_slow_drive_of_a_stiff_stack(kind, behind):
    """Events where the velocity all but vanishes, and a voltage that the bridge holds for millions of fast periods."""
    found = solve(on_stack(kind, behind), samples=8)
    assert found.converged, found.message
    assert found.energy["closure"] < 1e-9
    assert found.waveforms.event_names.count("switch closes") == 2


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "voltage"), [("parallel_sshi", 20.0), ("series_sshi", 5.0)])
def test_slow_drive_of_a_stiff_stack_against_the_oracle(kind, voltage):
    against_waiting(on_stack(kind, {"dc_voltage": voltage}), 1e-8, tol=1e-7, max_periods=12, method="Radau", rtol=1e-9)


def test_bridge_blocks_and_switch_closes_at_one_instant():
    """Into a constant voltage the bridge's current ends with the velocity, at the extremum at which the switch acts."""
    found, _ = against_waiting(bench({"kind": "parallel_sshi", "dc_voltage": 3.0, **LOOP}))
    waves = found.waveforms
    times = {
        name: np.array([t for t, n in zip(waves.event_times, waves.event_names, strict=True) if n == name])
        for name in ("diodes block", "switch closes")
    }
    assert len(times["switch closes"]) == 2
    gap = np.abs(np.subtract.outer(times["switch closes"], times["diodes block"])).min(axis=1)
    assert np.all(gap <= 1e-11)


def test_stops_that_slip_together():
    """Two thresholds a rounding error apart are one stop of both weights."""
    shunt = {"kind": "parallel_sshi", **LOOP, "smoothing_capacitance": 1e-6, "load_resistance": 1e5}
    r = 2e-7
    one = solve(bench(shunt, hysteresis={"thresholds": [r], "weights": [2e6]}))
    two = solve(bench(shunt, hysteresis={"thresholds": [r, r * (1 + 1e-15)], "weights": [5e5, 1.5e6]}))
    assert one.converged and two.converged, two.message
    assert two.harvested_power == pytest.approx(one.harvested_power, rel=1e-9)
    assert two.energy["hysteresis"] == pytest.approx(one.energy["hysteresis"], rel=1e-9)


# Seeds of random studies in which a motion from rest stays away from the steady state.
CHARGED = (41, 225)


@pytest.mark.parametrize("seed", CHARGED)
def test_steady_state_that_a_motion_from_rest_does_not_come_to_is_said(seed):
    study = random_study(seed)
    found = solve(study, samples=64)
    assert found.converged
    assert "from rest" in found.message
    system, excitation = objects(study)
    # Forty time constants of the smoothing capacitor, but not for ever.
    shunt = study["shunts"][0]
    wait = min(40 * shunt["smoothing_capacitance"] * shunt["load_resistance"], 1500 * excitation.period)
    rest = simulate(system, excitation, transient=np.ceil(wait / excitation.period) * excitation.period, samples=64)
    last = rest.waveforms.dc_voltage[-65:]
    assert abs(last.mean() / found.dc_voltage - 1) > 1e-2
    # Both are said truly: started on it, the motion stays.
    whole, dc = continued(study)
    assert whole <= 1e-6 and dc <= 1e-6


def test_several_steady_states_are_said():
    """With an offset this one has two: the message says so, and a run from rest ends in the one that is reported."""
    stops = {"thresholds": [2.6454982646211537e-07, 5.161161201166332e-07], "weights": [21701712.0, 6228507.5]}
    drive = {**DRIVE, "frequency": 52.9635, "offset": 0.02}
    shunt = {"kind": "parallel_sshi", "phase_lag": -0.5, "inductance": 0.01, "quality": 3.0}
    study = bench({**shunt, "dc_voltage": 18.0}, drive, hysteresis=stops)
    found = solve(study, samples=64)
    assert found.converged and "several" in found.message
    rest = solve(study, transient=2000 / drive["frequency"], samples=64)
    one, last = slice(None, 64), slice(-65, -1)
    for name in ("displacement", "voltage"):
        steady_wave, end = getattr(found.waveforms, name)[one], getattr(rest.waveforms, name)[last]
        assert np.abs(steady_wave - end).max() <= 1e-5 * np.abs(end).max(), name


def test_solutions_of_a_symmetric_system_do_not_depend_on_the_sign_of_the_coupling():
    shunt = {"kind": "parallel_sshi", **LOOP, "smoothing_capacitance": 1e-5, "load_resistance": 1e6}
    plus = solve(bench(shunt, hysteresis=STOPS))
    minus = solve(bench(shunt, hysteresis=STOPS, coupling=-BENCH["coupling"]))
    assert minus.harvested_power == pytest.approx(plus.harvested_power, rel=1e-9)
    assert minus.periods_evaluated == pytest.approx(plus.periods_evaluated, abs=1.0)
