"""Steady states found by shooting against those that the oracle waits for."""

from itertools import product

import pytest
from oracles.reference import steady
from random_studies import random_study
from selection import with_slow
from studies import DRIVE, LOOP, SECOND, STOPS, bench, solve

# Seeds for which the oracle settles within seconds.
DEFAULT = [0, 2, 3, 4, 5, 8, 11, 13, 15, 16, 19, 27]
MORE = [1, 7, 9, 10, 12, 14, 17, 20, 21, 24, 25, 26, 29, 30, 33, 34, 37, 42, 45, 50, 54, 57, 59, 65, 74, 77, 90]


# Of the oracle. Against a hundredth of each, which takes twice as long, the least damped results change by 2e-8.
PRECISE = {"tol": 1e-9, "rtol": 1e-10}


def check(study, relative=1e-6, **options):
    wanted = steady(study, 0, max_periods=300, samples_per_period=0, **PRECISE, **options)
    assert wanted.converged
    found = solve(study)
    assert found.converged, found.message
    size = max(wanted.harvested_power, 1e-3 * abs(wanted.mechanical_power))
    assert found.harvested_power == pytest.approx(wanted.harvested_power, abs=relative * size)
    assert found.mechanical_power == pytest.approx(wanted.mechanical_power, rel=relative)
    assert found.displacement_amplitude == pytest.approx(wanted.displacement_amplitude, rel=relative)
    assert found.voltage_amplitude == pytest.approx(wanted.voltage_amplitude, rel=relative)
    assert found.dc_voltage == pytest.approx(wanted.dc_voltage, rel=relative, abs=1e-12)
    for name in ("damping", "hysteresis", "shunt_loss", "source"):
        error = abs(found.energy.get(name, 0.0) - wanted.energy[name])
        assert error <= relative * wanted.energy["mechanical_in"], name
    assert abs(found.energy["closure"]) < 1e-10
    return found, wanted


@pytest.mark.parametrize("seed", DEFAULT)
def test_random_study(seed):
    check(random_study(seed))


@pytest.mark.slow
@pytest.mark.parametrize("seed", MORE)
def test_more_random_studies(seed):
    check(random_study(seed))


SMOOTH = {"smoothing_capacitance": 1e-6, "load_resistance": 1e5}
CASES = {
    "rectifier": {"kind": "rectifier", **SMOOTH, "diode_drop": 0.3},
    "parallel_sshi": {"kind": "parallel_sshi", **SMOOTH, "load_resistance": 3e5, "phase_lag": 0.1, **LOOP},
    "series_sshi": {"kind": "series_sshi", **SMOOTH, "load_resistance": 3e4, "diode_drop": 0.1, **LOOP},
    "sece": {"kind": "sece", "efficiency": 0.8, "phase_lag": -0.1},
    "ssds": {"kind": "ssds"},
    "ssdi": {"kind": "ssdi", **LOOP},
    "ssdv": {"kind": "ssdv", "source_voltage": 0.5, **LOOP},
    "resistor": {"kind": "resistor", "resistance": 8e4},
}


@pytest.mark.parametrize(
    "case",
    with_slow(["rectifier", "parallel_sshi", "sece", "ssdi"], slow=lambda case: case in ("parallel_sshi", "ssdi")),
)
def test_two_modes_with_hysteresis_on_a_moving_base(case):
    base = {"kind": "sine_base", "amplitude": 2.0, "frequency": 50.6}
    check(bench(CASES[case], base, hysteresis=STOPS, modes=[SECOND], effective_mass=0.012))


@pytest.mark.parametrize("case", with_slow(CASES, slow=lambda case: case in ("ssdi", "ssdv")))
def test_sine_with_offset(case):
    check(bench(CASES[case], {**DRIVE, "offset": 0.03}))


@pytest.mark.parametrize(
    ("case", "frequency"),
    with_slow(
        product(["rectifier", "series_sshi", "sece"], [35.0, 45.0, 50.0, 55.0, 200.0]),
        slow=lambda case, frequency: frequency in (50.0, 55.0) or (case, frequency) == ("series_sshi", 200.0),
    ),
)
def test_away_from_the_resonances(case, frequency):
    check(bench(CASES[case], {**DRIVE, "frequency": frequency, "amplitude": 0.1}))


@pytest.mark.parametrize(
    "case", with_slow(["rectifier", "parallel_sshi", "series_sshi"], slow=lambda case: "sshi" in case)
)
def test_large_smoothing_capacitor_from_a_charged_start(case):
    """The oracle need not charge 100 uF (a time constant of 500 periods) when it starts where the engine ends."""
    shunt = {**CASES[case], "smoothing_capacitance": 1e-4}
    found = solve(bench(shunt))
    start = steady(bench(CASES[case]), 0, tol=1e-6, max_periods=300).final
    start["shunt"] = {**start["shunt"], "dc_voltage": found.dc_voltage}
    check(bench(shunt), z0=start)


def test_a_motion_from_rest_that_stays_away_from_an_orbit_does_not_reach_it():
    """Open electrodes with a large charge repeat for ever; distances from there shrink by rounding alone."""
    shunt = {"kind": "self_powered_ssdi", "inductance": 0.0855, "quality": 17.7, "envelope_capacitance": 16.3e-9,
             "threshold": 0.1227, "diode_drop": 0.0749}  # fmt: skip
    device = {"mass": 0.007819, "damping": 0.03761, "stiffness": 569.42, "coupling": 4.0536e-3, "capacitance": 210.7e-9}
    drive = {"kind": "sine_force", "amplitude": 0.01447, "frequency": 43.676}
    study = {"transducer": device, "excitation": drive, "shunts": [shunt]}
    found = solve(study)
    run = solve(study, transient=300 / drive["frequency"]).waveforms
    last = run.displacement[run.time > run.time[-1] - 2 / drive["frequency"]]
    assert found.converged, found.message
    assert found.displacement_amplitude == pytest.approx(0.5 * (last.max() - last.min()), rel=2e-3)  # of samples
