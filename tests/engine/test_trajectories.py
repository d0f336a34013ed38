"""Runs from rest against the oracle: every waveform, and the instant of every event."""

import numpy as np
import pytest
from oracles.reference import simulate as reference
from selection import with_slow
from studies import DRIVE, LOOP, SECOND, STOPS, bench, solve

SMOOTH = {"smoothing_capacitance": 1e-6, "load_resistance": 1e5}
FLIP = {"flip_time": 4e-4, "quality": 3.0}
RLC = {"resistance": 2e4, "inductance": 300.0, "capacitance": 80e-9}
CASES = {
    "open": {"kind": "open"},
    "short": {"kind": "short"},
    "resistor": {"kind": "resistor", "resistance": 8e4},
    "series_rl": {"kind": "series_rl", "inductance": 200.0, "resistance": 2e4},
    "parallel_rl": {"kind": "parallel_rl", "inductance": 200.0, "resistance": 2e5},
    "series_rlc": {"kind": "series_rlc", **RLC},
    "parallel_rlc": {"kind": "parallel_rlc", **RLC, "resistance": 2e5},
    "negative parallel": {
        "kind": "negative_capacitance", "capacitance": 20e-9, "resistance": 1e5, "topology": "parallel",
    },
    "negative series": {
        "kind": "negative_capacitance", "capacitance": 100e-9, "resistance": 1e5, "topology": "series",
    },
    "rectifier": {"kind": "rectifier", **SMOOTH},
    "rectifier drop": {"kind": "rectifier", **SMOOTH, "diode_drop": 0.3},
    "rectifier dc": {"kind": "rectifier", "dc_voltage": 2.0},
    "rectifier onto a short": {"kind": "rectifier", "dc_voltage": 0.0},
    "rectifier dc 0, drop": {"kind": "rectifier", "dc_voltage": 0.0, "diode_drop": 0.4},
    "rectifier, fast discharge": {"kind": "rectifier", "smoothing_capacitance": 1e-8, "load_resistance": 4e4},
    "p-sshi": {"kind": "parallel_sshi", **SMOOTH, **LOOP},
    "p-sshi dc drop": {"kind": "parallel_sshi", "dc_voltage": 3.0, "diode_drop": 0.2, **LOOP},
    "p-sshi dc 0": {"kind": "parallel_sshi", "dc_voltage": 0.0, **LOOP},
    "p-sshi late": {"kind": "parallel_sshi", **SMOOTH, "phase_lag": 0.3, **LOOP},
    "p-sshi early": {"kind": "parallel_sshi", **SMOOTH, "phase_lag": -0.3, **LOOP},
    "p-sshi short on-time": {"kind": "parallel_sshi", **SMOOTH, "on_time_error": -0.3, **LOOP},
    "p-sshi long on-time": {"kind": "parallel_sshi", **SMOOTH, "on_time_error": 0.4, "diode_drop": 0.1, **LOOP},
    "p-sshi slow flip, long, early": {
        "kind": "parallel_sshi", "dc_voltage": 1.0, "on_time_error": 0.9, "phase_lag": -0.4, **FLIP,
    },
    "p-sshi hold-off": {"kind": "parallel_sshi", **SMOOTH, "hold_off": 0.75 / 50.6, **LOOP},
    "s-sshi": {"kind": "series_sshi", **SMOOTH, **LOOP},
    "s-sshi dc drop": {"kind": "series_sshi", "dc_voltage": 0.5, "diode_drop": 0.1, **LOOP},
    "s-sshi dc 0": {"kind": "series_sshi", "dc_voltage": 0.0, **LOOP},
    "s-sshi late": {"kind": "series_sshi", **SMOOTH, "phase_lag": 0.3, **LOOP},
    "s-sshi early": {"kind": "series_sshi", **SMOOTH, "phase_lag": -0.3, **LOOP},
    "s-sshi short on-time": {"kind": "series_sshi", **SMOOTH, "on_time_error": -0.3, **LOOP},
    "s-sshi back through the bridge": {"kind": "series_sshi", "dc_voltage": 0.2, "on_time_error": 0.9, **LOOP},
    "s-sshi hold-off": {"kind": "series_sshi", "dc_voltage": 0.2, "hold_off": 0.75 / 50.6, **FLIP},
    "sece": {"kind": "sece", "efficiency": 0.8, "diode_drop": 0.2},
    "sece late": {"kind": "sece", "phase_lag": 0.25},
    "sece early": {"kind": "sece", "phase_lag": -0.25},
    "ssds": {"kind": "ssds"},
    "ssds early, hold-off": {"kind": "ssds", "phase_lag": -0.25, "hold_off": 0.9 / 50.6},
    "ssdi": {"kind": "ssdi", **LOOP},
    "ssdi late, short on-time": {"kind": "ssdi", "phase_lag": 0.4, "on_time_error": -0.4, **LOOP},
    "ssdi early, long on-time": {"kind": "ssdi", "phase_lag": -0.4, "on_time_error": 0.4, **LOOP},
    "ssdi hold-off": {"kind": "ssdi", "hold_off": 0.75 / 50.6, **FLIP},
    "ssdi time lag": {"kind": "ssdi", "time_lag": 1e-3, **LOOP},
    "ssdv": {"kind": "ssdv", "source_voltage": 0.5, **LOOP},
    "ssdv late, long on-time": {"kind": "ssdv", "source_voltage": 0.5, "phase_lag": 0.2, "on_time_error": 0.2, **FLIP},
}  # fmt: skip
FIRST_OF_EACH_KIND = {table["kind"]: case for case, table in reversed(CASES.items())}.values()
DEVICES = {"plain": {}, "hysteresis": {"hysteresis": STOPS}, "two modes": {"hysteresis": STOPS, "modes": [SECOND]}}
EVENTS = {
    "switch_closes": "switch closes",
    "switch_opens": "switch opens",
    "discharge": "voltage extracted",
    "bridge_conducts": "diodes conduct",
    "bridge_blocks": "diodes block",
}
WAVES = {
    "drive": "force",
    "displacement": "x",
    "velocity": "u",
    "voltage": "v",
    "current": "i",
    "charge": "q",
    "dc_voltage": "v_dc",
}


def both(study, length, samples=64):
    found = solve(study, transient=length, samples=samples)
    assert found.converged, found.message
    return found, reference(study, 0, duration=length, times=found.waveforms.time)


def instants(names, times):
    """Times of the events by name."""
    return {name: sorted(t for t, n in zip(times, names, strict=True) if n == name) for name in set(names)}


def check(study, length, tolerance=1e-8, jumps=()):
    found, wanted = both(study, length)
    # At a jump of the force the value before and the value after are both right.
    smooth = np.all(np.abs(np.subtract.outer(wanted.t, [-1.0, *jumps])) > 1e-12, axis=1)
    strained = np.abs(wanted.x).max() * study["transducer"]["coupling"]
    for ours, theirs in WAVES.items():
        signal, oracle = getattr(found.waveforms, ours)[smooth], getattr(wanted, theirs)[smooth]
        # What is zero by nature (the voltage of a short, the current of open electrodes) is so to rounding.
        floor = {"voltage": strained / study["transducer"]["capacitance"], "charge": strained}.get(ours, 0.0)
        size = max(np.abs(oracle).max(), 1e-3 * floor)
        error = np.abs(signal - oracle).max()
        where = wanted.t[smooth][np.abs(signal - oracle).argmax()]
        assert error <= tolerance * size, f"{ours} off by {error / size:.2e} of its size, at {where} s"
    # A bridge onto a short opens again quadratically in time: the oracle's slack on the voltage delays it by its root.
    blunt = 1e3 if study["shunts"][0].get("dc_voltage") == 0.0 else 1.0
    compare_events(study, found, wanted, blunt * tolerance * length)
    return found, wanted


def compare_events(study, found, wanted, tolerance):
    # Where no current flows but at an extraction, the oracle notes no slip.
    at_once = study["shunts"][0]["kind"] in ("sece", "ssds")
    names = [*EVENTS.values(), *([] if at_once else ["hysteresis slips", "hysteresis sticks"])]
    ours = instants(found.waveforms.event_names, found.waveforms.event_times)
    theirs = instants([oracle_name(name) for _, name in wanted.events], [t for t, _ in wanted.events])
    # How long after the start a discharged bridge is said to conduct is a matter of rounding.
    start = 1e-3 * wanted.t[-1]
    for name in names:
        mine, other = (np.array([t for t in group.get(name, []) if t > start]) for group in (ours, theirs))
        assert len(mine) == len(other), f"{name}: {mine} but {other}"
        error = np.abs(mine - other).max(initial=0.0)
        assert error <= tolerance, f"{name} off by {error:.2e} s, at {mine[np.abs(mine - other).argmax()]} s"


def oracle_name(name):
    if name.startswith("stop_"):
        return "hysteresis slips" if name.endswith("_slips") else "hysteresis sticks"
    return EVENTS.get(name, name)


@pytest.mark.parametrize(
    ("case", "device"),
    with_slow(
        [*((case, "hysteresis") for case in CASES), *((case, "plain") for case in FIRST_OF_EACH_KIND)],
        slow=lambda case, device: device == "plain" or any(m in case for m in ("early", "on-time", "hold-off", "dc 0")),
    ),
)
def test_against_the_oracle(case, device):
    """Every circuit with a specimen that has hysteresis, every kind of circuit with one that has none."""
    check(bench(CASES[case], **DEVICES[device]), 5.3 / 50.6)


@pytest.mark.parametrize("case", ["resistor", "rectifier drop", "p-sshi late", "s-sshi", "sece", "ssdi"])
def test_base_excitation_of_two_modes(case):
    base = {"kind": "sine_base", "amplitude": 2.0, "frequency": 50.6}
    check(bench(CASES[case], base, effective_mass=0.012, **DEVICES["two modes"]), 4.2 / 50.6)


@pytest.mark.parametrize("case", ["resistor", "rectifier", "p-sshi", "s-sshi late", "sece", "ssdi"])
def test_sine_with_offset(case):
    check(bench(CASES[case], {**DRIVE, "offset": 0.03}, hysteresis=STOPS), 4.2 / 50.6)


TONES = {"amplitudes": [0.02, 0.01], "frequencies": [50.0, 75.0], "phases": [0.4, -1.0], "duration": 0.2}


@pytest.mark.parametrize(
    "case",
    with_slow(["resistor", "rectifier drop", "p-sshi", "s-sshi", "sece", "ssdv"], slow=lambda case: "sshi" in case),
)
def test_multisine(case):
    # hold_off is given because its default differs: the oracle does not look for a period in a multisine.
    hold = {} if case in ("resistor", "rectifier drop") else {"hold_off": 4e-3}
    check(bench({**CASES[case], **hold}, {"kind": "multisine", **TONES}, hysteresis=STOPS), 0.2)


@pytest.mark.parametrize("rise_time", [0.0, pytest.param(3e-3, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "case", ["resistor", "series_rl", "rectifier drop", "p-sshi", "s-sshi", "sece", "ssdi time lag"]
)
def test_step(case, rise_time):
    step = {"kind": "step_force", "amplitude": 0.5, "duration": 0.06, "rise_time": rise_time, "offset": 0.1}
    check(bench(CASES[case], step, hysteresis=STOPS, modes=[SECOND]), 0.12, jumps=() if rise_time else (0.0, 0.06))


@pytest.mark.parametrize(
    "case",
    with_slow(
        ["rectifier drop", "p-sshi dc drop", "s-sshi back through the bridge", "ssdv"],
        slow=lambda case: "p-sshi" in case,
    ),
)
def test_energy_of_a_run_from_rest(case):
    # The multisine's window is the whole run in the oracle too.
    hold = {} if "rectifier" in case else {"hold_off": 4e-3}
    study = bench({**CASES[case], **hold}, {"kind": "multisine", **TONES}, hysteresis=STOPS)
    found, wanted = both(study, 0.2)
    assert abs(found.energy["closure"]) < 1e-10
    for name in ("mechanical_in", "harvested", "damping", "hysteresis", "shunt_loss", "stored", "source"):
        error = abs(found.energy.get(name, 0.0) - wanted.energy[name])
        assert error <= 1e-8 * wanted.energy["mechanical_in"], name
    assert found.harvested_power == pytest.approx(wanted.harvested_power, rel=1e-8, abs=1e-15)
    assert found.displacement_amplitude == pytest.approx(wanted.displacement_amplitude, rel=1e-7)
    assert found.voltage_amplitude == pytest.approx(wanted.voltage_amplitude, rel=1e-7)
