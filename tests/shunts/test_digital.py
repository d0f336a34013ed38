"""Synthetic impedances: the engine against an independent recursion, stability against closed forms."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from messages import is_sentence
from oracles.ngspice import needs_ngspice, run_netlist
from scipy.linalg import expm
from scipy.signal import bilinear
from studies import BENCH, DRIVE

from piezoharvest import design, simulate, simulate_many
from piezoharvest.bench.solver import CIRCUITS, Model, integrate
from piezoharvest.description.excitation import SineForce
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import Digital, Resistor, SeriesRL
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Electrode, Transducer
from piezoharvest.linear import anticipating, frequency_response, poles, sampled_loop, stability_limit
from piezoharvest.spice import export_spice
from piezoharvest.study import study_from

DEVICE = Transducer(**BENCH)
SINE = SineForce(amplitude=DRIVE["amplitude"], frequency=DRIVE["frequency"])
PERIOD = 1 / SINE.frequency
OMEGA = 2 * np.pi * SINE.frequency
PARTS = {"inductance": 247.0, "resistance": 17.5e3}
RL = Digital(numerator=(1.0,), denominator=(PARTS["inductance"], PARTS["resistance"]), sample_time=PERIOD / 50)


def recursion(shunt, times):
    """Displacement (n,) at times, from rest: exponentials from instant to instant, the filter of scipy."""
    mass, damping, stiffness, coupling, capacitance = (
        BENCH[name] for name in ("mass", "damping", "stiffness", "coupling", "capacitance")
    )
    # States x, u, q, sine, cosine, and the current.
    generator = np.zeros((6, 6))
    generator[0, 1] = 1
    generator[1, :4] = [-(stiffness + coupling**2 / capacitance), -damping, coupling / capacitance, SINE.amplitude]
    generator[1, :4] /= mass
    generator[2, 5] = -1
    generator[3, 4], generator[4, 3] = OMEGA, -OMEGA
    above, below = map(np.array, bilinear(shunt.numerator, shunt.denominator, 1 / shunt.sample_time))
    above = np.pad(above, (len(below) - len(above), 0))
    rest = shunt.delay / shunt.sample_time % 1.0
    begin = 0.5 * (1 - rest) if rest <= 0.5 else 1 - 0.5 * rest
    samples = shunt.sample_time * (begin + np.arange(int(times[-1] / shunt.sample_time) + 1))
    instants = [*((t, "sample") for t in samples), *((t + shunt.delay, "drive") for t in samples)]
    # At one instant a sample is taken before the current that it leads to is driven, if these are so without a delay.
    looks = ((t, "look") for t in times)
    wanted = sorted([*instants, *looks], key=lambda pair: (round(pair[0], 12), "sdl".index(pair[1][0])))
    state, now = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.0]), 0.0
    inputs, outputs, waiting, seen = np.zeros(len(above)), np.zeros(len(below)), [], []
    for time, what in wanted:
        state, now = expm(generator * (time - now)) @ state, time
        if what == "look":
            seen.append(state[0])
        elif what == "drive":
            state[5] = waiting.pop(0)
        else:
            voltage = (state[2] - coupling * state[0]) / capacitance
            if shunt.resolution:
                voltage = shunt.resolution * np.floor(voltage / shunt.resolution + 0.5)
            inputs = np.append(voltage, inputs[:-1])
            outputs = np.append(above @ inputs - below[1:] @ outputs[: len(below) - 1], outputs[:-1])
            limit = shunt.saturation or np.inf
            waiting.append(min(max(outputs[0], -limit), limit))
    return np.array(seen)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"delay": 1.3 * RL.sample_time},
        {"delay": 2.0 * RL.sample_time, "resolution": 0.05},
        {"delay": 0.7 * RL.sample_time, "saturation": 2e-5},
        {"numerator": (2e-8, 0.0), "denominator": (2e-8 * 500.0, 2e-8 * 2e4, 1.0)},
    ],
    ids=["plain", "late", "coarse", "weak", "second order"],
)
def test_agrees_with_a_recursion(changes):
    shunt = dataclasses.replace(RL, **changes)
    response = simulate(System(DEVICE, shunt), SINE, transient=8 * PERIOD, samples=10, attenuation=False)
    assert response.converged and response.energy["closure"] < 1e-10
    found = response.waveforms
    wanted = recursion(shunt, found.time[1:])
    assert found.displacement[1:] == pytest.approx(wanted, abs=1e-9 * np.max(np.abs(wanted)))


@pytest.mark.parametrize(
    "changes",
    [{"delay": 1.3 * RL.sample_time, "resolution": 0.05}, {"saturation": 2e-5}],
    ids=["late and coarse", "weak"],
)
def test_bench_has_the_same_recursion(changes):
    shunt, times = dataclasses.replace(RL, **changes), np.arange(81) * PERIOD / 10
    model = Model(DEVICE, CIRCUITS[shunt.kind](shunt), base=False)
    found, wanted = integrate(model, SINE, times), recursion(shunt, times[1:])
    assert found.displacement[1:] == pytest.approx(wanted, abs=1e-7 * np.max(np.abs(wanted)))


def test_tends_to_the_circuit_that_it_stands_for():
    wanted = SINE.amplitude * abs(
        frequency_response(System(DEVICE, SeriesRL(**PARTS)), np.array([SINE.frequency])).displacement[0]
    )
    errors = []
    for samples in (200, 400):
        shunt = dataclasses.replace(RL, sample_time=PERIOD / samples)
        response = simulate(System(DEVICE, shunt), SINE)
        assert response.converged and not response.message
        errors.append(abs(response.displacement_amplitude / wanted - 1))
    # The current that is held is half a sample late: an error of the first order.
    assert errors[1] < 0.04 and errors[0] / errors[1] == pytest.approx(2, rel=0.1)


def test_steady_where_samples_do_not_repeat_with_the_period():
    whole, broken = (dataclasses.replace(RL, sample_time=PERIOD / n) for n in (100, 100.37))
    plain, found = (simulate(System(DEVICE, shunt), SINE) for shunt in (whole, broken))
    assert found.converged and "samples do not repeat" in found.message
    many = simulate_many(System(DEVICE, broken), SINE, 1)
    assert many["converged"][0]
    assert many["displacement_amplitude"][0] == pytest.approx(found.displacement_amplitude, rel=2e-3)
    assert found.displacement_amplitude == pytest.approx(plain.displacement_amplitude, rel=5e-3)
    assert found.attenuation_db == pytest.approx(plain.attenuation_db, abs=0.05)


@pytest.mark.parametrize("late", [0, 1, 2, 5])
def test_limit_of_a_resistance_across_a_capacitor(late):
    """v+ = v - g v_(k - d), g = T/(R C): stable for g < 2 sin(pi/(4 d + 2)) (Levin & May, Math. Biosci. 32, 1976)."""
    resistance, share = 1e4, 2 * np.sin(np.pi / (4 * late + 2))
    wanted = share * resistance * DEVICE.capacitance
    clamped = dataclasses.replace(DEVICE, coupling=0.0)
    shunt = Digital(numerator=(1.0,), denominator=(resistance,), sample_time=1e-5, delay=late * 1e-5)
    assert stability_limit(System(clamped, shunt), "sample_time") == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("late", [1, 2, 33, 1000])
def test_limit_of_the_delay_of_a_resistance_across_a_capacitor(late):
    """Of the same loop with g = 2 sin(pi/(4 d + 2)): d whole sample times, however many these are."""
    resistance = 1e-5 / (DEVICE.capacitance * 2 * np.sin(np.pi / (4 * late + 2)))
    clamped = dataclasses.replace(DEVICE, coupling=0.0)
    shunt = Digital(numerator=(1.0,), denominator=(resistance,), sample_time=1e-5)
    assert stability_limit(System(clamped, shunt)) == pytest.approx(late * 1e-5, rel=1e-9)


def test_no_delay_is_too_long_for_a_loop_of_little_gain():
    """A weak branch without a path for charge that stays: its gain is below one at every frequency."""
    shunt = Digital(numerator=(1e-8, 0.0), denominator=(1e-9 * 3e5, 1.0), sample_time=PERIOD / 50)
    assert np.isinf(stability_limit(System(DEVICE, shunt)))
    for delay in (0.5, 7.3, 31.9):
        late = dataclasses.replace(shunt, delay=delay * shunt.sample_time)
        assert sampled_loop(System(DEVICE, late)).radius < 1
    strong = dataclasses.replace(shunt, numerator=(4e-8, 0.0))
    limit = stability_limit(System(DEVICE, strong))
    late = [dataclasses.replace(strong, delay=share * limit) for share in (1 - 1e-6, 1 + 1e-6)]
    assert [sampled_loop(System(DEVICE, each)).radius < 1 for each in late] == [True, False]


def test_the_limit_is_where_simulated_motions_begin_to_grow():
    limit = stability_limit(System(DEVICE, RL))
    assert RL.sample_time < limit < 2 * RL.sample_time
    for share, grows in ((0.97, False), (1.03, True)):
        system = System(DEVICE, dataclasses.replace(RL, delay=share * limit))
        radius = sampled_loop(system).radius
        assert (radius > 1) == grows
        # Off its resonance the drive leaves the free motion to be seen: it grows by the radius from sample to sample.
        drive = dataclasses.replace(SINE, frequency=3 * SINE.frequency)
        w = simulate(system, drive, transient=60 * PERIOD, samples=20, attenuation=False).waveforms
        early, later = (np.ptp(w.displacement[(w.time > t * PERIOD) & (w.time < (t + 6) * PERIOD)]) for t in (4, 54))
        assert (later > early) == grows


def test_without_samples_the_limit_is_that_of_the_delay_alone():
    # The current is late by the delay and, as it is held, by half a sample time on average.
    rates = (100, 400, 10000)
    found = [stability_limit(System(DEVICE, dataclasses.replace(RL, sample_time=PERIOD / n))) for n in rates]
    late = [limit + 0.5 * PERIOD / n for limit, n in zip(found, rates, strict=True)]
    assert late[0] == pytest.approx(late[1], rel=2e-3)
    assert late[1] == pytest.approx(late[2], rel=2e-4)


@pytest.mark.parametrize("share", [0.5, 3.0])
def test_an_anticipating_admittance_is_stable_again(share):
    late = dataclasses.replace(RL, delay=share * stability_limit(System(DEVICE, RL)))
    found = anticipating(System(DEVICE, late))
    wanted = np.exp(poles(System(DEVICE, SeriesRL(**PARTS))) * RL.sample_time)
    wanted = wanted[np.abs(wanted - 1) > 1e-9]
    assert (sampled_loop(System(DEVICE, late)).radius > 1) == (share > 1)
    assert sampled_loop(System(DEVICE, found)).radius == pytest.approx(np.abs(wanted).max(), abs=3e-4)
    response = simulate(System(DEVICE, found), SINE)
    analogue = frequency_response(System(DEVICE, SeriesRL(**PARTS)), np.array([SINE.frequency])).displacement[0]
    assert response.converged
    assert 20 * np.log10(response.displacement_amplitude / abs(SINE.amplitude * analogue)) == pytest.approx(0, abs=0.5)


def test_acts_at_further_electrodes_beside_others():
    two = dataclasses.replace(DEVICE, electrodes=(Electrode(capacitance=30e-9, coupling=6e-4),))
    shunt = dataclasses.replace(RL, electrode=1, sample_time=PERIOD / 2000, others=(Resistor(resistance=1e5),))
    circuit = SeriesRL(**PARTS, electrode=1, others=shunt.others)
    response = simulate(System(two, shunt), SINE)
    wanted = frequency_response(System(two, circuit), np.array([SINE.frequency])).displacement[0]
    assert response.displacement_amplitude == pytest.approx(SINE.amplitude * abs(wanted), rel=5e-3)
    assert sampled_loop(System(two, shunt)).radius < 1


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"numerator": (1.0, 2.0, 3.0)}, "numerator"),
        ({"denominator": (0.0, 1.0)}, "denominator"),
        ({"denominator": ()}, "denominator"),
        ({"delay": 40 * RL.sample_time}, "delay"),
        ({"denominator": (1.0, -2 / RL.sample_time)}, "denominator"),
        ({"sample_time": 0.0}, "sample_time"),
    ],
)
def test_what_no_controller_can_do_is_told(changes, key):
    with pytest.raises(ParameterError) as caught:
        dataclasses.replace(RL, **changes)
    assert caught.value.key == key and is_sentence(caught.value.message)


def test_a_clock_too_slow_for_the_drive_is_refused():
    slow = Digital(numerator=(1e-5,), denominator=(1.0,), sample_time=0.6 / 50.6)
    with pytest.raises(ParameterError, match=r"sample_time: found 0\.0118577 s, must be less than half a period"):
        simulate(System(DEVICE, slow), SineForce(amplitude=0.02, frequency=50.6))


@needs_ngspice
@pytest.mark.parametrize(
    "changes",
    [
        {},
        pytest.param({"delay": 1.3 * RL.sample_time}, marks=pytest.mark.slow),
        pytest.param({"delay": 2.0 * RL.sample_time, "resolution": 0.05}, marks=pytest.mark.slow),
        pytest.param({"delay": 0.7 * RL.sample_time, "saturation": 2e-5}, marks=pytest.mark.slow),
        pytest.param(
            {"numerator": (2e-8, 0.0), "denominator": (2e-8 * 500.0, 2e-8 * 2e4, 1.0)}, marks=pytest.mark.slow
        ),
    ],
    ids=["plain", "late", "coarse", "weak", "second order"],
)
def test_netlist_samples_and_holds(changes):
    """From rest, over 20 periods; two of these loops are unstable, and their differences grow with them."""
    shunt, periods = dataclasses.replace(RL, **changes), 20
    found = simulate(System(DEVICE, shunt), SINE, transient=periods * PERIOD, attenuation=False)
    text = export_spice(DEVICE, shunt, SINE, periods=periods, measured_periods=periods)
    wanted = run_netlist(text, timeout=300)
    assert found.mechanical_power == pytest.approx(wanted["mechanical_power"], rel=0.01)
    assert 2 * found.displacement_amplitude == pytest.approx(wanted["displacement_pp"], rel=0.01)
    assert 2 * found.voltage_amplitude == pytest.approx(wanted["voltage_pp"], rel=0.01)


def test_design_tunes_its_coefficients():
    """To more damping than as given; there is no gradient, and the result says how it was found."""
    shunt = {"kind": "digital", "numerator": [1.0], "denominator": [247.0, 4e4], "sample_time": PERIOD / 100}
    study = {
        "transducer": {**BENCH, "damping": 0.6}, "excitation": DRIVE, "shunts": [shunt],
        "design": {"objective": "damping", "candidates": ["digital"]},
    }  # fmt: skip
    found = design(study_from(study, Path("study.toml"))).candidates[0]
    plain = Digital(numerator=(1.0,), denominator=(247.0, 4e4), sample_time=PERIOD / 100)
    given = simulate(System(Transducer(**study["transducer"]), plain), SINE)
    assert "simplex search" in found.method
    assert found.attenuation_db < given.attenuation_db - 3.0
