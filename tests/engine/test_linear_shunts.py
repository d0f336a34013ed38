"""Linear circuits: the engine's steady state against the frequency response, which knows no time at all."""

import numpy as np
import pytest
from studies import BENCH, DRIVE, SECOND, STOPS, bench, distance, objects, one_period, phasor, solve

from piezoharvest.description.excitation import Multisine
from piezoharvest.description.parameters import ParameterError
from piezoharvest.engine import simulate
from piezoharvest.linear import check_stability, frequency_response

NEGATIVE = {"kind": "negative_capacitance", "resistance": 1e5}
CIRCUITS = {
    "open": {"kind": "open"},
    "short": {"kind": "short"},
    "resistor": {"kind": "resistor", "resistance": 8e4},
    "series RL": {"kind": "series_rl", "inductance": 200.0, "resistance": 2e4},
    "parallel RL": {"kind": "parallel_rl", "inductance": 200.0, "resistance": 2e5},
    "series RLC": {"kind": "series_rlc", "inductance": 300.0, "resistance": 2e4, "capacitance": 80e-9},
    "parallel RLC": {"kind": "parallel_rlc", "inductance": 100.0, "resistance": 2e5, "capacitance": 40e-9},
    "parallel negative": {**NEGATIVE, "capacitance": 20e-9, "topology": "parallel"},
    "series negative": {**NEGATIVE, "capacitance": 100e-9, "topology": "series"},
    "network": {
        "kind": "network",
        "netlist": "L1 1 2 150\nC1 2 0 30n\nR1 2 3 20k\nC2 3 0 100n\nR2 3 0 200k load\nR3 1 0 1meg",
    },
    "network with loops": {"kind": "network", "netlist": "C1 1 0 10n\nC2 1 2 20n\nC3 2 0 30n\nR1 2 0 90k load"},
}
LEAKY = {"leakage": {"resistance": 4e5}, "dielectric_relaxation": {"capacitance": 15e-9, "time_constant": 5e-3}}
FAST = {"mass": 0.002, "damping": 0.4, "stiffness": 3e5, "coupling": -3e-3, "force_participation": -0.4}
BASE = {"kind": "sine_base", "amplitude": 2.0, "frequency": 50.6}
DEVICES = {
    "one mode": ({}, DRIVE),
    "three modes": ({"modes": [SECOND, FAST]}, {**DRIVE, "frequency": 131.0}),
    "base": ({"modes": [SECOND], "effective_mass": 0.013}, BASE),
    "effects": ({"effects": LEAKY}, {**DRIVE, "frequency": 49.9}),
    "sticking hysteresis": ({"hysteresis": {"thresholds": [1.0, 2.0], "weights": STOPS["weights"]}}, DRIVE),
}
WAVES = ("displacement", "velocity", "voltage", "current", "charge")


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("circuit", CIRCUITS)
def test_steady_state_is_the_frequency_response(circuit, device):
    keys, drive = DEVICES[device]
    study = bench(CIRCUITS[circuit], drive, **keys)
    system, excitation = objects(study)
    amplitude = excitation.amplitude
    try:
        check_stability(system)
    except ParameterError:
        assert circuit == "series negative" and device == "effects"
        # A leakage discharges what floats, and the negative capacitance grows with it.
        assert not solve(study).converged
        return
    wanted = frequency_response(system, [excitation.frequency], base=excitation.base)
    found = solve(study)
    assert found.converged, found.message
    assert found.displacement_amplitude == pytest.approx(amplitude * abs(wanted.displacement[0]), rel=1e-9)
    assert found.voltage_amplitude == pytest.approx(amplitude * abs(wanted.voltage[0]), rel=1e-9, abs=1e-12)
    assert found.harvested_power == pytest.approx(amplitude**2 * wanted.harvested_power[0], rel=1e-9, abs=1e-16)
    assert found.mechanical_power == pytest.approx(amplitude**2 * wanted.mechanical_power[0], rel=1e-9)
    sizes = {name: amplitude * abs(getattr(wanted, name)[0]) for name in WAVES}
    # What is zero by nature (the voltage of a short, the current of open electrodes) is zero against what strain makes.
    strained = BENCH["coupling"] * sizes["displacement"]
    sizes["voltage"] = max(sizes["voltage"], 1e-3 * strained / BENCH["capacitance"])
    sizes["current"] = max(sizes["current"], 1e-3 * strained * 2 * np.pi * excitation.frequency)
    sizes["charge"] = max(sizes["charge"], 1e-3 * strained)
    for name in WAVES:
        line = phasor(found.waveforms, getattr(found.waveforms, name), found.period)
        assert abs(line - amplitude * getattr(wanted, name)[0]) <= 1e-9 * sizes[name], name


@pytest.mark.parametrize("circuit", ["short", "resistor", "series RL"])
def test_attenuation_is_against_the_short_circuit(circuit):
    study = bench(CIRCUITS[circuit])
    (system, excitation), (short, _) = objects(study), objects(bench({"kind": "short"}))
    ratio = frequency_response(system, [50.6]).displacement / frequency_response(short, [50.6]).displacement
    found = simulate(system, excitation)
    assert found.attenuation_db == pytest.approx(20 * np.log10(abs(ratio[0])), abs=1e-8)


@pytest.mark.parametrize("circuit", CIRCUITS)
def test_multisine_is_the_sum_of_its_lines(circuit):
    system, _ = objects(bench(CIRCUITS[circuit], modes=[SECOND]))
    tones = {"amplitudes": (0.02, 0.01, 0.015), "frequencies": (40.0, 50.0, 130.0), "phases": (0.3, -1.0, 2.0)}
    found = simulate(system, Multisine(**tones, duration=0.5))
    assert found.converged, found.message
    assert found.period == pytest.approx(0.1, rel=1e-12)
    wanted = frequency_response(system, tones["frequencies"])
    angles = 2 * np.pi * np.multiply.outer(found.waveforms.time, tones["frequencies"]) + np.array(tones["phases"])
    for name in ("displacement", "voltage"):
        lines = np.imag(np.exp(1j * angles) * getattr(wanted, name)) @ np.array(tones["amplitudes"])
        signal = getattr(found.waveforms, name)
        if name == "voltage" and circuit == "short":
            assert np.abs(signal).max() < 1e-9
            continue
        assert distance(signal, lines) < 1e-9, name
    power = np.dot(wanted.harvested_power, np.square(tones["amplitudes"]))
    assert found.harvested_power == pytest.approx(power, rel=1e-9, abs=1e-16)


def test_sine_with_offset_moves_about_the_preloaded_position():
    resistor = CIRCUITS["resistor"]
    plain, found = solve(bench(resistor)), solve(bench(resistor, {**DRIVE, "offset": 0.5}))
    assert found.converged, found.message
    static = 0.5 / BENCH["stiffness"]
    one = one_period(found.waveforms, found.period)
    assert np.mean(found.waveforms.displacement[one]) == pytest.approx(static, rel=1e-9)
    assert distance(found.waveforms.displacement - static, plain.waveforms.displacement) < 1e-8
    assert found.harvested_power == pytest.approx(plain.harvested_power, rel=1e-9)
