"""Steady states where shooting is easily led astray, against the last period of a long run of the same engine."""

import numpy as np
import pytest
from studies import BENCH, DRIVE, LOOP, STOPS, bench, distance, one_period, solve

PERIOD = 1 / 50.6
TWO_PI = 2 * np.pi
SHORT_CIRCUIT = np.sqrt(BENCH["stiffness"] / BENCH["mass"]) / TWO_PI
OPEN_CIRCUIT = np.sqrt((BENCH["stiffness"] + BENCH["coupling"] ** 2 / 40e-9) / BENCH["mass"]) / TWO_PI
RESISTIVE = {"load_resistance": 1e5, "smoothing_capacitance": 1e-6}


def check_against_waiting(study, periods, tolerance=1e-7):
    """The direct steady state is what a run from rest ends in."""
    period = 1 / study["excitation"]["frequency"]
    steady = solve(study, samples=64)
    assert steady.waveforms.time[0] == pytest.approx(0.0, abs=1e-12 * period)
    assert steady.converged, steady.message
    assert abs(steady.energy["closure"]) < 1e-10
    wait = solve(study, transient=periods * period, samples=64)
    assert wait.converged, wait.message
    last = np.flatnonzero(wait.waveforms.time > (periods - 1 - 1e-9) * period)[:64]
    one = one_period(steady.waveforms, period)
    for name in ("displacement", "voltage", "charge", "dc_voltage"):
        found, wanted = getattr(steady.waveforms, name)[one], getattr(wait.waveforms, name)[last]
        # What is zero by nature (the voltage of a bridge onto a short) is so to rounding.
        strained = study["transducer"]["coupling"] * np.abs(wait.waveforms.displacement[last]).max()
        floor = 1e-3 * {"voltage": strained / study["transducer"]["capacitance"], "charge": strained}.get(name, 0.0)
        error, size = np.abs(found - wanted).max(), max(np.abs(wanted).max(), floor)
        assert error <= tolerance * size, f"{name} off by {error / size:.1e} of its size"
    return steady


@pytest.mark.parametrize("resistance", [3e3, 3e4, 3e5, 3e7])
@pytest.mark.parametrize("kind", ["rectifier", "parallel_sshi", "series_sshi"])
def test_discontinuous_conduction(kind, resistance):
    """A small capacitor that empties within the period: the bridge conducts in several pieces, or never lets go."""
    loop = LOOP if kind != "rectifier" else {}
    shunt = {"kind": kind, "smoothing_capacitance": 2e-8, "load_resistance": resistance, **loop}
    check_against_waiting(bench(shunt), 500)


@pytest.mark.parametrize("diode_drop", [0.0, 0.3])
@pytest.mark.parametrize("kind", ["rectifier", "parallel_sshi", "series_sshi"])
def test_dc_side_shorted(kind, diode_drop):
    """Several events fall on one instant: the bridge changes sides at once where the current changes sign."""
    loop = LOOP if kind != "rectifier" else {}
    check_against_waiting(bench({"kind": kind, "dc_voltage": 0.0, "diode_drop": diode_drop, **loop}), 500)


def test_rectifier_onto_a_short_is_the_short_circuit():
    found, wanted = solve(bench({"kind": "rectifier", "dc_voltage": 0.0})), solve(bench({"kind": "short"}))
    assert found.displacement_amplitude == pytest.approx(wanted.displacement_amplitude, rel=1e-9)
    assert found.attenuation_db == pytest.approx(0.0, abs=1e-8)
    assert found.harvested_power == 0.0


@pytest.mark.parametrize("kind", ["rectifier", "parallel_sshi", "series_sshi"])
def test_bridge_that_never_conducts(kind):
    """Beyond the open voltage nothing is rectified; the switched loop goes on."""
    loop = LOOP if kind != "rectifier" else {}
    found = check_against_waiting(bench({"kind": kind, "dc_voltage": 1e3, **loop}), 500)
    like = {"rectifier": {"kind": "open"}, "series_sshi": {"kind": "open"}, "parallel_sshi": {"kind": "ssdi", **LOOP}}
    assert found.harvested_power == 0.0
    assert found.displacement_amplitude == pytest.approx(solve(bench(like[kind])).displacement_amplitude, rel=1e-9)


@pytest.mark.parametrize("capacitance", [1e-9, 1e-7, 1e-5, 1e-3])
@pytest.mark.parametrize("kind", ["rectifier", "parallel_sshi", "series_sshi"])
def test_smoothing_capacitor_from_nanofarad_to_millifarad(kind, capacitance):
    """Charge balance: what the load takes is what the bridge gives, whatever the time constant; large ones agree."""
    loop = LOOP if kind != "rectifier" else {}
    found = solve(bench({"kind": kind, "smoothing_capacitance": capacitance, "load_resistance": 1e5, **loop}))
    assert found.converged, found.message
    assert abs(found.energy["closure"]) < 1e-10
    assert found.periods_evaluated < 1000
    if capacitance < 1e-5:
        return
    constant = solve(bench({"kind": kind, "dc_voltage": found.dc_voltage, **loop}))
    ripple = PERIOD / (1e5 * capacitance)
    assert found.harvested_power == pytest.approx(found.dc_voltage**2 / 1e5, rel=ripple)
    assert constant.harvested_power == pytest.approx(found.harvested_power, rel=3 * ripple)


@pytest.mark.parametrize("kind", ["rectifier", "parallel_sshi", "series_sshi"])
def test_millifarad_against_waiting(kind):
    loop = LOOP if kind != "rectifier" else {}
    shunt = {"kind": kind, "smoothing_capacitance": 1e-3, "load_resistance": 2e3, **loop}
    check_against_waiting(bench(shunt), 3500)


WEAK = {"coupling": 1e-9}
SWITCHED = {
    "parallel_sshi": {"kind": "parallel_sshi", **LOOP, "smoothing_capacitance": 4e-8, "load_resistance": 1e5},
    "series_sshi": {"kind": "series_sshi", **LOOP, "smoothing_capacitance": 4e-8, "load_resistance": 1e5},
    "sece": {"kind": "sece"},
    "ssds": {"kind": "ssds"},
    "ssdi": {"kind": "ssdi", **LOOP},
    "ssdv": {"kind": "ssdv", "source_voltage": 0.2, **LOOP},
}


@pytest.mark.parametrize("lag", [0.0, 0.2, -0.2])
@pytest.mark.parametrize("kind", SWITCHED)
def test_extremum_at_the_section(kind, lag):
    """At resonance and hardly coupled the velocity is in phase with the force: zero where the period begins."""
    voltage = {"source_voltage": 1e-7} if kind == "ssdv" else {}
    shunt = {**SWITCHED[kind], **voltage, "phase_lag": lag}
    # The electrical part is a 1e-7 of the whole, on which the steady state's residual is judged.
    check_against_waiting(bench(shunt, {**DRIVE, "frequency": float(SHORT_CIRCUIT)}, **WEAK), 700, 1e-6)


@pytest.mark.parametrize("frequency", [SHORT_CIRCUIT, OPEN_CIRCUIT])
@pytest.mark.parametrize("kind", [*SWITCHED, "rectifier"])
def test_drive_at_the_resonances(kind, frequency):
    shunt = SWITCHED.get(kind, {"kind": "rectifier", **RESISTIVE})
    check_against_waiting(bench(shunt, {**DRIVE, "frequency": float(frequency)}), 700)


@pytest.mark.parametrize("share", [-0.5, -0.25, 0.25, 0.5])
def test_switch_acts_at_the_section(share):
    """The force's zero crossing is a quarter period from the extremum at resonance, or with a lag on it."""
    at = {**DRIVE, "frequency": float(SHORT_CIRCUIT)}
    study = bench({"kind": "ssdi", **LOOP, "phase_lag": share * np.pi * (1 - 1e-15)}, at, **WEAK)
    check_against_waiting(study, 700, 1e-6)


@pytest.mark.parametrize("kind", SWITCHED)
def test_hysteresis_that_slips_a_little_or_not_at_all(kind):
    for thresholds in ([1e-7, 3e-7], [1e-9, 2e-9], [1e-3, 2e-3]):
        study = bench(SWITCHED[kind], hysteresis={**STOPS, "thresholds": thresholds})
        found = solve(study)
        assert found.converged, found.message
        assert abs(found.energy["closure"]) < 1e-10


@pytest.mark.parametrize("kind", SWITCHED)
def test_multisine(kind):
    tones = {"amplitudes": [0.02, 0.01], "frequencies": [50.0, 75.0], "phases": [0.4, -1.0], "duration": 0.2}
    study = bench(SWITCHED[kind], {"kind": "multisine", **tones}, damping=0.3)
    found = solve(study, samples=256)
    assert found.converged, found.message
    assert found.period == pytest.approx(0.04)
    wait = solve(study, transient=200 * 0.04, samples=256)
    one = one_period(found.waveforms, 0.04)
    last = np.flatnonzero(wait.waveforms.time > (199 - 1e-9) * 0.04)[:256]
    assert distance(found.waveforms.displacement[one], wait.waveforms.displacement[last]) < 1e-8
    assert distance(found.waveforms.charge[one], wait.waveforms.charge[last]) < 1e-8


def test_periods_needed_do_not_depend_on_the_capacitor():
    shunt = {"kind": "parallel_sshi", **LOOP, "load_resistance": 3e5}
    capacitors = [{**shunt, "smoothing_capacitance": c} for c in (1e-7, 1e-6, 1e-5, 1e-4, 1e-3)]
    periods = [solve(bench(capacitor)).periods_evaluated for capacitor in capacitors]
    assert max(periods) < 100, periods


def test_steady_waveforms_begin_at_phase_zero():
    for shunt in (SWITCHED["parallel_sshi"], {"kind": "resistor", "resistance": 1e5}):
        found = solve(bench(shunt), samples=100)
        assert np.allclose(found.waveforms.time, np.arange(100) * PERIOD / 100, rtol=0, atol=1e-12 * PERIOD)
        assert distance(found.waveforms.drive, 0.02 * np.sin(TWO_PI * np.arange(100) / 100)) < 1e-12


def test_no_drive_no_motion():
    for shunt in (SWITCHED["parallel_sshi"], {"kind": "resistor", "resistance": 1e5}):
        found = solve(bench(shunt, {**DRIVE, "amplitude": 0.0}))
        assert found.converged, found.message
        assert found.harvested_power == found.mechanical_power == found.displacement_amplitude == 0.0


@pytest.mark.parametrize("amplitude", [1e-9, 1e6])
def test_amplitude_does_not_matter_without_thresholds(amplitude):
    shunt = {**SWITCHED["parallel_sshi"]}
    found, plain = solve(bench(shunt, {**DRIVE, "amplitude": amplitude})), solve(bench(shunt))
    assert found.harvested_power == pytest.approx(plain.harvested_power * (amplitude / 0.02) ** 2, rel=1e-9)


@pytest.mark.parametrize(
    "shunt",
    [
        {"kind": "ssdv", "source_voltage": 2.45, **LOOP},
        {"kind": "ssdv", "source_voltage": 5.0, **LOOP},
        {"kind": "ssdi", "inductance": 0.01, "quality": 42.0, "phase_lag": -0.3},
    ],
    ids=lambda shunt: shunt["kind"],
)
def test_motion_that_never_repeats_is_not_passed_off_as_steady(shunt):
    """The oracle, run for hundreds of periods, wanders for ever."""
    found = solve(bench(shunt))
    assert not found.converged
    assert found.message


@pytest.mark.parametrize("transient", [pytest.param(0.5, marks=pytest.mark.slow), None])
@pytest.mark.parametrize(
    "effects",
    [{"voltage_dependent_capacitance": {"beta": -0.1}}, {"stiffening": {"cubic_stiffness": -1e10}}],
    ids=lambda effects: next(iter(effects)),
)
def test_no_solution_is_said(effects, transient):
    """A charge C v (1 + beta v^2) that folds back at 1.8 V, a spring that pushes away beyond 0.31 mm."""
    drive = {**DRIVE, "amplitude": 0.2}
    found = solve(bench({"kind": "resistor", "resistance": 1e5}, drive, effects=effects), transient=transient)
    assert not found.converged
    assert found.message == "simulation failed: the state grows without bound, or has no solution"
    assert np.isfinite([found.displacement_amplitude, found.voltage_amplitude, found.harvested_power]).all()


@pytest.mark.parametrize("transient", [0.5, None])
@pytest.mark.parametrize(("periods", "followed"), [(1.9, True), (2.6, False)])
def test_a_lag_of_many_extrema_is_followed_or_refused(periods, followed, transient):
    """Two extrema a period: four actions wait within two periods, five or six within 2.6."""
    found = solve(bench({"kind": "ssdi", **LOOP, "time_lag": periods * PERIOD}), transient=transient)
    assert found.converged == followed
    assert ("more than 4 actions of the switch are pending" in found.message) != followed
