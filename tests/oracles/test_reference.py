"""Tests of the oracle itself, against closed forms (REFERENCE.md) and exact phasors."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

from .reference import simulate, steady

# Heavily damped, driven far below resonance and hardly coupled: the displacement is as good as prescribed, and the
# mechanical transient is over within a period.
FREQUENCY, CAPACITANCE = 20.0, 40e-9
OMEGA = 2.0 * math.pi * FREQUENCY
Q_LOOP = 6.0
FLIP_TIME = 1.0 / FREQUENCY / 5000.0
# Exact inversion factor of the loop; exp(-pi/(2 Q)) is its limit for large Q.
INVERSION = math.exp(-math.pi / math.sqrt(4.0 * Q_LOOP**2 - 1.0))

BENCH = {"mass": 0.010, "damping": 0.0628, "stiffness": 986.96, "coupling": 1.0e-3, "capacitance": 40e-9}
STOPS = {"thresholds": [1e-7, 3e-7], "weights": [5e5, 1.5e6]}
SECOND = {"mass": 0.01, "damping": 0.6, "stiffness": 8e3, "coupling": 5e-4, "force_participation": 0.7}
BENCH_DRIVE = {"kind": "sine_force", "amplitude": 0.02, "frequency": 50.6}
LOOP = {"inductance": 0.01, "quality": Q_LOOP}


def prescribed(shunt: dict, coupling: float = 2e-4) -> dict:
    """Study with k_e^2 = 1e-6 (or weaker) whose displacement does not depend on the shunt."""
    stiffness, mass = 1e6, 1e6 / (2.0 * math.pi * 200.0) ** 2
    damping = 2.0 * 0.3 * math.sqrt(stiffness * mass)
    transducer = {
        "mass": mass,
        "damping": damping,
        "stiffness": stiffness,
        "coupling": coupling,
        "capacitance": CAPACITANCE,
    }
    excitation = {"kind": "sine_force", "amplitude": 100.0, "frequency": FREQUENCY}
    return {"transducer": transducer, "excitation": excitation, "shunts": [shunt]}


def bench(shunt: dict, **extra) -> dict:
    """Strongly coupled study near resonance."""
    return {"transducer": {**BENCH, **extra}, "excitation": dict(BENCH_DRIVE), "shunts": [shunt]}


def open_voltage(study: dict) -> float:
    """V_oc = T U/C."""
    transducer = study["transducer"]
    k, m, b = transducer["stiffness"], transducer["mass"], transducer["damping"]
    displacement = study["excitation"]["amplitude"] / abs(k - m * OMEGA**2 + 1j * b * OMEGA)
    return transducer["coupling"] * displacement / CAPACITANCE


def table_power(kind: str, resistance: float, current: float) -> float:
    """Power of REFERENCE.md section 1 for ``current`` = T w U."""
    rcw, q = resistance * CAPACITANCE * OMEGA, INVERSION
    if kind == "resistor":
        return resistance * current**2 / (2.0 * (1.0 + rcw**2))
    if kind == "rectifier":
        return resistance * current**2 / (rcw + math.pi / 2.0) ** 2
    if kind == "parallel_sshi":
        return 4.0 * resistance * current**2 / (rcw * (1.0 - q) + math.pi) ** 2
    if kind == "series_sshi":
        return 4.0 * resistance * (1.0 + q) ** 2 * current**2 / (2.0 * rcw * (1.0 + q) + math.pi * (1.0 - q)) ** 2
    return 2.0 * current**2 / (math.pi * CAPACITANCE * OMEGA)


# Where a formula is good to a thousandth only.
ROUGH = {"tol": 1e-7, "rtol": 1e-10, "samples_per_period": 0}


# ---- closed forms, prescribed displacement -------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.3, pytest.param(0.6, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", ["rectifier", "parallel_sshi", "series_sshi"])
def test_bridge_rows_at_fixed_dc_voltage(kind, share):
    limit = {"rectifier": 1.0, "parallel_sshi": 2.0 / (1.0 - INVERSION), "series_sshi": 1.0}[kind]
    voltage = share * limit * open_voltage(prescribed({}))
    shunt = {"kind": kind, "dc_voltage": voltage, "quality": Q_LOOP, "flip_time": FLIP_TIME}
    study = prescribed(shunt)
    result = steady(study, 0, **ROUGH)
    assert result.converged
    current = study["transducer"]["coupling"] * OMEGA * result.displacement_amplitude
    equivalent = voltage**2 / result.harvested_power
    assert result.harvested_power == pytest.approx(table_power(kind, equivalent, current), rel=1e-3)
    assert abs(result.closure) < 1e-8


@pytest.mark.parametrize("kind", ["rectifier", pytest.param("parallel_sshi", marks=pytest.mark.slow), "series_sshi"])
def test_bridge_rows_with_smoothing_capacitor_and_load(kind):
    rcw = {
        "rectifier": math.pi / 2.0,
        "parallel_sshi": math.pi / (1.0 - INVERSION),
        "series_sshi": math.pi * (1.0 - INVERSION) / (2.0 * (1.0 + INVERSION)),
    }[kind]
    resistance = rcw / (CAPACITANCE * OMEGA)
    # The table is for a constant dc voltage; what the ripple takes falls as 1/smoothing (0.5 % at a tenth of this).
    smoothing = 1000.0 / (OMEGA * resistance)
    shunt = {
        "kind": kind,
        "smoothing_capacitance": smoothing,
        "load_resistance": resistance,
        "quality": Q_LOOP,
        "flip_time": FLIP_TIME,
    }
    study = prescribed(shunt)
    result = steady(study, 0, **ROUGH)
    assert result.converged
    current = study["transducer"]["coupling"] * OMEGA * result.displacement_amplitude
    assert result.harvested_power == pytest.approx(table_power(kind, resistance, current), rel=1e-3)
    assert abs(result.closure) < 1e-8


def test_rows_that_are_exact():
    """Rectifier and SECE act at once, so their rows hold to the last digit once the coupling has vanished."""
    weak = 2e-7
    resistor = {"kind": "resistor", "resistance": 1.3 / (CAPACITANCE * OMEGA)}
    voltage = 0.4 * open_voltage(prescribed({}, weak))
    for shunt in (resistor, {"kind": "rectifier", "dc_voltage": voltage}, {"kind": "sece"}):
        study = prescribed(shunt, weak)
        result = steady(study, 0)
        current = weak * OMEGA * result.displacement_amplitude
        resistance = shunt.get("resistance", voltage**2 / result.harvested_power)
        assert result.harvested_power == pytest.approx(table_power(shunt["kind"], resistance, current), rel=1e-8)
        assert abs(result.closure) < 1e-8


def best_power(lag: float) -> float:
    """Power of parallel SSHI at its best dc voltage; the mean current is linear in the voltage."""
    voltage = open_voltage(prescribed({})) / (1.0 - INVERSION)
    currents = []
    for share in (0.8, 1.0):
        shunt = {"kind": "parallel_sshi", "dc_voltage": share * voltage, "phase_lag": lag}
        result = steady(prescribed({**shunt, "quality": Q_LOOP, "flip_time": FLIP_TIME}), 0, **ROUGH)
        assert result.converged
        currents.append(result.harvested_power / (share * voltage))
    slope = (currents[0] - currents[1]) / (0.2 * voltage)
    return (currents[1] + slope * voltage) ** 2 / (4.0 * slope)


@pytest.mark.slow
def test_late_and_early_parallel_sshi():
    lag, in_time = 0.3, best_power(0.0)
    late = (((1.0 - INVERSION) + (1.0 + INVERSION) * math.cos(lag)) / 2.0) ** 2
    assert best_power(lag) / in_time == pytest.approx(late, rel=1e-2)
    assert best_power(-lag) / in_time == pytest.approx(math.cos(lag) ** 2, rel=1e-2)


# ---- exact phasors, strong coupling ----------------------------------------------------------------------------------

LINEAR = {
    "open": ({}, lambda s: None),
    "short": ({}, lambda s: 0.0),
    "resistor": ({"resistance": 8e4}, lambda s: 8e4),
    "series_rl": ({"inductance": 200.0, "resistance": 2e4}, lambda s: 2e4 + 200.0 * s),
    "parallel_rl": ({"inductance": 200.0, "resistance": 2e5}, lambda s: 1.0 / (1.0 / 2e5 + 1.0 / (200.0 * s))),
    "series_rlc": (
        {"inductance": 300.0, "resistance": 2e4, "capacitance": 80e-9},
        lambda s: 2e4 + 300.0 * s + 1.0 / (80e-9 * s),
    ),
    "parallel_rlc": (
        {"inductance": 100.0, "resistance": 2e5, "capacitance": 40e-9},
        lambda s: 1.0 / (1.0 / 2e5 + 1.0 / (100.0 * s) + 40e-9 * s),
    ),
    "parallel negative": (
        {"capacitance": 20e-9, "resistance": 1e5, "topology": "parallel"},
        lambda s: 1.0 / (1e-5 - 20e-9 * s),
    ),
    "series negative": (
        {"capacitance": 100e-9, "resistance": 1e5, "topology": "series"},
        lambda s: 1e5 - 1.0 / (100e-9 * s),
    ),
}


def phasors(study: dict, impedance) -> tuple[complex, complex]:
    """Displacement and voltage of a linear study; ``impedance`` None: open."""
    transducer, excitation = study["transducer"], study["excitation"]
    s = 2j * math.pi * excitation["frequency"]
    admittance_x = drive_x = drive_charge = coupling_charge = 0.0
    for mode in [transducer, *transducer.get("modes", [])]:
        share = mode.get("force_participation", 1.0)
        base = excitation["kind"] == "sine_base"
        gain = -mode.get("effective_mass", mode["mass"]) if base else share
        receptance = 1.0 / (mode["mass"] * s**2 + mode["damping"] * s + mode["stiffness"])
        force = gain * excitation["amplitude"] * receptance
        drive_x += share * force
        admittance_x += share * receptance * mode["coupling"]
        drive_charge += mode["coupling"] * force
        coupling_charge += mode["coupling"] ** 2 * receptance
    # q = C v + sum T x, s q = -v/Z
    if impedance is None:
        voltage = -drive_charge / (transducer["capacitance"] + coupling_charge)
    elif impedance == 0.0:
        voltage = 0.0
    else:
        voltage = -drive_charge / (transducer["capacitance"] + coupling_charge + 1.0 / (impedance * s))
    return drive_x + admittance_x * voltage, voltage


@pytest.mark.parametrize("name", LINEAR)
def test_linear_shunts_against_phasors(name):
    keys, impedance = LINEAR[name]
    study = bench({"kind": "negative_capacitance" if "negative" in name else name, **keys}, modes=[SECOND])
    if name == "series_rl":
        study["transducer"] = {**study["transducer"], "effective_mass": 0.013}
        study["excitation"] = {"kind": "sine_base", "amplitude": 2.0, "frequency": 50.6}
    z = impedance(2j * math.pi * 50.6)
    result = steady(study, 0)
    displacement, voltage = phasors(study, z)
    assert result.converged
    assert result.displacement_amplitude == pytest.approx(abs(displacement), rel=1e-8)
    assert result.voltage_amplitude == pytest.approx(abs(voltage), rel=1e-8, abs=1e-9)
    power = 0.0 if not z else 0.5 * abs(voltage) ** 2 * (1.0 / z).real
    assert result.harvested_power == pytest.approx(power, rel=1e-8, abs=1e-15)
    at = 2.0 * math.pi * 50.6 * result.t
    assert np.allclose(result.x, np.imag(displacement * np.exp(1j * at)), atol=1e-8 * abs(displacement), rtol=0.0)
    assert abs(result.closure) < 1e-8


def test_radau_agrees_with_dop853():
    study = bench({"kind": "resistor", "resistance": 8e4})
    explicit, implicit = (simulate(study, 0, method=m, rtol=1e-11) for m in ("DOP853", "Radau"))
    assert np.allclose(explicit.v, implicit.v, rtol=0.0, atol=1e-9 * np.abs(explicit.v).max())


# ---- hysteresis, coupled switching -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_hysteresis_loss_of_a_slipping_stop():
    study = prescribed({"kind": "short"})
    study["excitation"]["frequency"] = 5.0
    weight, threshold = 2e6, 3e-9
    study["transducer"]["hysteresis"] = {"thresholds": [threshold], "weights": [weight]}
    result = simulate(study, 0, periods=2)
    # Shorted, C v_t + T x = q with v_t = -v_h, and v_h = w r at the peak.
    amplitude = study["transducer"]["coupling"] * result.displacement_amplitude - CAPACITANCE * weight * threshold
    assert result.energy["hysteresis"] == pytest.approx(4.0 * weight * threshold * (amplitude - threshold), rel=1e-8)
    assert result.count("stop_0_slips") == result.count("stop_0_sticks") == 2
    assert abs(result.closure) < 1e-8


CIRCUITS = [
    {"kind": "rectifier", "smoothing_capacitance": 1e-6, "load_resistance": 1e5, "diode_drop": 0.3},
    {"kind": "rectifier", "dc_voltage": 0.0},
    {"kind": "parallel_sshi", "smoothing_capacitance": 1e-6, "load_resistance": 3e5, "on_time_error": -0.2, **LOOP},
    {"kind": "parallel_sshi", "dc_voltage": 8.0, "diode_drop": 0.2, "phase_lag": -0.2, "on_time_error": 0.1, **LOOP},
    {"kind": "series_sshi", "smoothing_capacitance": 1e-6, "load_resistance": 3e4, "on_time_error": 0.6, **LOOP},
    {"kind": "series_sshi", "dc_voltage": 3.0, "diode_drop": 0.2, "phase_lag": 0.2, "on_time_error": -0.2, **LOOP},
    {"kind": "sece", "efficiency": 0.8, "phase_lag": 0.1, "diode_drop": 0.3},
    {"kind": "ssds", "phase_lag": -0.1},
    {"kind": "ssdi", **LOOP},
    {"kind": "ssdv", "source_voltage": 1.0, **LOOP},
]


@pytest.mark.parametrize("shunt", CIRCUITS, ids=lambda shunt: shunt["kind"])
def test_energy_closes(shunt):
    result = simulate(bench(shunt, hysteresis=STOPS, modes=[SECOND]), 0, periods=4)
    assert abs(result.closure) < 1e-8
    assert min(result.energy[name] for name in ("damping", "hysteresis", "harvested", "shunt_loss", "source")) >= 0.0


def test_ssdi_at_open_circuit_resonance():
    """x/x_0 = 1/(1 + (4/pi) k_e^2 Q_m (1+q)/(1-q)), with x_0 the short-circuit amplitude at resonance."""
    study = bench({"kind": "ssdi", "quality": Q_LOOP, "flip_time": 2e-5})
    k, m, b = BENCH["stiffness"], BENCH["mass"], BENCH["damping"]
    coupling = BENCH["coupling"] ** 2 / (k * BENCH["capacitance"])
    study["excitation"]["frequency"] = math.sqrt(k * (1.0 + coupling) / m) / (2.0 * math.pi)
    result = steady(study, 0, max_periods=300, **ROUGH)
    ratio = 1.0 + 4.0 / math.pi * coupling * math.sqrt(k * m) / b * (1.0 + INVERSION) / (1.0 - INVERSION)
    x_0 = study["excitation"]["amplitude"] / (b * math.sqrt(k / m))
    assert result.converged
    assert 20.0 * math.log10(result.displacement_amplitude / x_0 * ratio) == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("lag", [-0.4, 0.0, 0.4])
def test_instants_of_the_switch(lag):
    shunt = {"kind": "ssdi", "phase_lag": lag, "on_time_error": 0.25, **LOOP}
    result = simulate(bench(shunt), 0, periods=8)
    period = 1.0 / 50.6
    times = {name: [t for t, event in result.events if event == name] for name in ("switch_closes", "switch_opens")}
    extrema = [t for t, event in result.events if event in ("maximum", "minimum")]
    shift = lag / (2.0 * math.pi * 50.6) + (0.5 * period if lag < 0.0 else 0.0)
    on_time = 1.25 * math.pi * math.sqrt(0.01 * 40e-9 / (1.0 - 0.25 / Q_LOOP**2))
    assert len(times["switch_opens"]) >= 12
    for closed, opened in zip(times["switch_closes"], times["switch_opens"], strict=False):
        assert opened - closed == pytest.approx(on_time, rel=1e-9)
        assert min(abs(closed - shift - t) for t in extrema) < 1e-12 * period * 100


def test_hold_off_skips_and_cut_current_is_lost():
    shunt = {"kind": "ssdi", "hold_off": 0.75 / 50.6, **LOOP}
    result = simulate(bench(shunt), 0, periods=6)
    assert result.count("maximum") == result.count("minimum") == result.count("switch_closes") == 1
    # A loop without resistance to speak of, cut at half its swing: all that the electrodes held is in the inductor.
    shunt = {"kind": "ssdi", "inductance": 1e-4, "quality": 1e6, "on_time_error": -0.5}
    result = simulate(prescribed(shunt, 2e-7), 0, periods=1, samples_per_period=20000)
    closings = [t for t, event in result.events if event == "switch_closes"]
    openings = [t for t, event in result.events if event == "switch_opens"]
    held = [0.5 * CAPACITANCE * result.v[result.t < closed][-1] ** 2 for closed in closings]
    assert len(held) == len(openings) == 2
    assert result.energy["shunt_loss"] == pytest.approx(sum(held), rel=1e-5)
    assert abs(result.v[result.t > openings[0]][0]) < 1e-5 * result.voltage_amplitude


def test_ssdv_source_increases_the_inverted_voltage():
    plain = simulate(bench({"kind": "ssdi", **LOOP}), 0, periods=3)
    driven = simulate(bench({"kind": "ssdv", "source_voltage": 1.0, **LOOP}), 0, periods=3)
    assert driven.energy["source"] > 0.0 == plain.energy["source"]
    assert driven.voltage_amplitude > plain.voltage_amplitude
    assert driven.displacement_amplitude < plain.displacement_amplitude


# ---- other excitations -----------------------------------------------------------------------------------------------


def test_step_ends_at_its_static_states():
    study = prescribed({"kind": "short"}, 2e-4)
    study["excitation"] = {"kind": "step_force", "amplitude": 30.0, "duration": 0.2, "rise_time": 0.01, "offset": 10.0}
    stiffness = study["transducer"]["stiffness"]
    result = simulate(study, 0, duration=0.5, times=[0.0, 0.005, 0.2, 0.205, 0.5])
    assert result.force == pytest.approx([10.0, 25.0, 40.0, 25.0, 10.0], rel=1e-12)
    assert result.x[[0, 2, 4]] * stiffness == pytest.approx([10.0, 40.0, 10.0], rel=1e-9)
    study["excitation"]["rise_time"] = 0.0
    jump = simulate(study, 0, duration=0.5, times=[0.0, 0.2, 0.5])
    assert jump.force == pytest.approx([40.0, 10.0, 10.0], rel=1e-12)
    assert jump.energy["mechanical_in"] == pytest.approx(30.0**2 / stiffness, rel=1e-9)


def test_multisine_of_one_line_is_a_sine():
    shunt = {"kind": "parallel_sshi", "dc_voltage": 2.0, "hold_off": 0.25 / 50.6, **LOOP}
    study = bench(shunt)
    sine = simulate(study, 0, periods=3)
    study["excitation"] = {
        "kind": "multisine",
        "amplitudes": [0.02],
        "frequencies": [50.6],
        "phases": [0.0],
        "duration": 1.0,
    }
    many = simulate(study, 0, duration=3 / 50.6, times=sine.t)
    assert np.allclose(many.x, sine.x, rtol=0.0, atol=1e-9 * np.abs(sine.x).max())
    assert [name for _, name in many.events] == [name for _, name in sine.events]


def test_resuming_changes_nothing():
    study = bench(CIRCUITS[3], hysteresis=STOPS)
    whole = simulate(study, 0, periods=6)
    half = simulate(study, 0, periods=3, z0=simulate(study, 0, periods=3).final)
    assert half.harvested_power == pytest.approx(whole.harvested_power, rel=1e-9)
    assert half.final["q"] == pytest.approx(whole.final["q"], rel=1e-9)


def test_acceleration_finds_what_waiting_finds():
    study = bench({"kind": "resistor", "resistance": 8e4}, damping=1.0)
    fast, slow = steady(study, 0), steady(study, 0, accelerate=False)
    assert fast.periods < slow.periods
    assert fast.harvested_power == pytest.approx(slow.harvested_power, rel=1e-8)
    assert cmath.isclose(fast.displacement_amplitude, abs(phasors(study, 8e4)[0]), rel_tol=1e-8)


def test_parallel_negative_capacitance_beyond_its_limit_is_refused():
    shunt = {"kind": "negative_capacitance", "capacitance": 41e-9, "resistance": 1e5, "topology": "parallel"}
    with pytest.raises(ValueError, match="C_n must stay below"):
        simulate(bench(shunt), 0)
