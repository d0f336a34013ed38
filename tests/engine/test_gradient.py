"""Gradients against differences of simulations, closed forms, and what units and symmetry demand of them."""

import dataclasses

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from random_studies import random_study
from selection import with_slow
from studies import BENCH, DRIVE, LOOP, SECOND, STOPS, bench, objects

from piezoharvest import Multisine, NoGradientError, StepForce, System, gradient, simulate

RESULTS = ("harvested_power", "displacement_amplitude", "voltage_amplitude")
SMOOTH = {"smoothing_capacitance": 1e-6, "load_resistance": 3e5}
COIL = {"inductance": 0.1, "quality": 5.0}
PARALLEL = {"kind": "parallel_sshi", **COIL, **SMOOTH}
SERIES = {"kind": "series_sshi", **COIL, **SMOOTH, "load_resistance": 3e4}
CIRCUITS = {
    "resistor": {"kind": "resistor", "resistance": 8e4},
    "series RL": {"kind": "series_rl", "inductance": 200.0, "resistance": 2e4},
    "parallel RLC": {"kind": "parallel_rlc", "inductance": 100.0, "resistance": 2e5, "capacitance": 40e-9},
    "series RLC": {"kind": "series_rlc", "inductance": 300.0, "resistance": 2e4, "capacitance": 80e-9},
    "negative capacitance": {
        "kind": "negative_capacitance", "capacitance": 20e-9, "resistance": 1e5, "topology": "parallel",
    },
    "rectifier": {"kind": "rectifier", **SMOOTH, "diode_drop": 0.3},
    "rectifier without drop": {"kind": "rectifier", **SMOOTH, "diode_leakage": 1e-7},
    "rectifier dc": {"kind": "rectifier", "dc_voltage": 3.0, "diode_drop": 0.3},
    "rectifier resistance": {"kind": "rectifier", **SMOOTH, "diode_drop": 0.3, "diode_resistance": 3e3},
    "half-wave": {"kind": "half_wave", **SMOOTH, "diode_drop": 0.1, "diode_leakage": 1e-7, "dc_leakage": 1e-7},
    "doubler": {"kind": "doubler", **SMOOTH, "diode_drop": 0.1, "diode_leakage": 1e-7, "diode_saturation": 1e-7},
    "battery": {"kind": "battery", "dc_voltage": 2.0, "diode_resistance": 1e3, "internal_resistance": 2e3},
    "mppt": {"kind": "mppt", "fraction": 0.4, "sampling_duty": 0.1, "diode_drop": 0.1},
    "supply": {
        "kind": "rectifier", **SMOOTH, "storage": {"turn_on": 1.0, "turn_off": 0.5, "power": 1e-5, "efficiency": 0.9},
    },
    "sshc": {"kind": "sshc", **SMOOTH, "flip_capacitances": [40e-9, 60e-9], "switch_resistance": 300.0},
    "sshc late": {
        "kind": "sshc", "dc_voltage": 3.0, "flip_capacitances": [50e-9], "switch_resistance": 300.0,
        "phase_time": 3e-5, "phase_lag": 0.1, "on_time_error": 0.1, "diode_resistance": 1e3,
    },
    "bias flip": {"kind": "bias_flip", **COIL, **SMOOTH, "bias_capacitance": 1e-6, "on_time_error": 0.1},
    "sece coil": {"kind": "sece", **COIL, "efficiency": 0.8, "diode_drop": 0.1, "diode_resistance": 50.0},
    "sice": {"kind": "sice", **COIL, "efficiency": 0.8, "phase_lag": 0.1},
    "sc-sece": {"kind": "sc_sece", **COIL, "short_time": 1e-3, "phase_lag": 0.1, "on_time_error": -0.1},
    "dssh": {"kind": "dssh", **COIL, "intermediate_capacitance": 120e-9, "efficiency": 0.8, "diode_drop": 0.1},
    "essh": {
        "kind": "essh", **COIL, "intermediate_capacitance": 120e-9, "second_inductance": 0.02, "second_quality": 9.0,
        "residual": 0.4, "efficiency": 0.8, "gate_energy": 1e-9, "phase_lag": 0.1,
    },
    "p-sshi": PARALLEL,
    "p-sshi late": {**PARALLEL, "phase_lag": 0.1, "diode_drop": 0.2, "on_time_error": 0.1, "diode_leakage": 1e-7},
    "p-sshi early": {**PARALLEL, "phase_lag": -0.1, "on_time_error": -0.1},
    "p-sshi time lag": {**PARALLEL, "time_lag": 2e-4},
    "p-sshi dc": {"kind": "parallel_sshi", **COIL, "dc_voltage": 3.0, "diode_drop": 0.2},
    "p-sshi flip time": {"kind": "parallel_sshi", "flip_time": 2e-4, "quality": 5.0, **SMOOTH},
    "s-sshi": SERIES,
    "s-sshi late": {**SERIES, "phase_lag": 0.1, "diode_drop": 0.1, "dc_leakage": 1e-7},
    "s-sshi early": {**SERIES, "phase_lag": -0.1, "on_time_error": -0.1},
    "sece": {"kind": "sece", "efficiency": 0.8, "diode_drop": 0.2},
    "sece late": {"kind": "sece", "phase_lag": 0.1},
    "sece early": {"kind": "sece", "phase_lag": -0.1},
    "ssds": {"kind": "ssds"},
    "ssds late": {"kind": "ssds", "phase_lag": 0.2},
    "ssdi": {"kind": "ssdi", **COIL},
    "ssdi late": {"kind": "ssdi", **COIL, "phase_lag": 0.1, "on_time_error": -0.1},
    "ssdv": {"kind": "ssdv", "source_voltage": 0.3, **COIL},
    "ssdv early": {"kind": "ssdv", "source_voltage": 0.3, **COIL, "phase_lag": -0.1},
}  # fmt: skip
LEAKY = {"leakage": {"resistance": 1e8}, "dielectric_relaxation": {"capacitance": 5e-9, "time_constant": 5e-3}}
DEVICES = {
    "plain": ({}, DRIVE),
    "hysteresis": ({"hysteresis": STOPS}, DRIVE),
    "effects": ({"effects": LEAKY, "hysteresis": STOPS}, DRIVE),
    "offset": ({}, {**DRIVE, "offset": 0.01}),
    "offset hysteresis": ({"hysteresis": STOPS}, {**DRIVE, "offset": 0.01}),
    "two modes": ({"modes": [SECOND]}, DRIVE),
    "base": (
        {"hysteresis": STOPS, "modes": [{**SECOND, "effective_mass": 0.011}], "effective_mass": 0.013},
        {"kind": "sine_base", "amplitude": 2.0, "frequency": 50.6},
    ),
}
FEW = ("resistor", "rectifier", "p-sshi late", "s-sshi", "sece late", "ssdi", "ssdv")
# Every circuit on one specimen, every specimen with one circuit of each kind of action.
PAIRS = [(circuit, "hysteresis") for circuit in CIRCUITS]
PAIRS += [(circuit, device) for device in DEVICES if device != "hysteresis" for circuit in FEW]


def replaced(part, path, value):
    """A component with the quantity at a path replaced."""
    name, _, rest = path.partition(".")
    found = getattr(part, name)
    if not rest:
        return dataclasses.replace(part, **{name: value})
    if not isinstance(found, tuple):
        return dataclasses.replace(part, **{name: replaced(found, rest, value)})
    key, _, rest = rest.partition(".")
    names = [getattr(item, "name", str(n)) for n, item in enumerate(found)]
    k = names.index(key) if key in names else int(key)
    item = replaced(found[k], rest, value) if rest else value
    return dataclasses.replace(part, **{name: (*found[:k], item, *found[k + 1 :])})


def metadata(part, path):
    """Bounds of the quantity at a path."""
    name, _, rest = path.partition(".")
    field = next(f for f in dataclasses.fields(part) if f.name == name)
    found = getattr(part, name)
    if isinstance(found, tuple):
        key, _, rest = rest.partition(".")
        names = [getattr(item, "name", str(n)) for n, item in enumerate(found)]
        found = found[names.index(key) if key in names else int(key)]
    return metadata(found, rest) if rest else field.metadata


def at(system, excitation, path, value):
    """RESULTS with one quantity at another value."""
    home, _, rest = path.partition(".")
    if home == "excitation":
        excitation = replaced(excitation, rest, value)
    else:
        system = dataclasses.replace(system, **{home: replaced(getattr(system, home), rest, value)})
    found = simulate(system, excitation, samples=1)
    assert found.converged, f"{path} = {value}: {found.message}"
    return np.array([getattr(found, name) for name in RESULTS])


def difference(system, excitation, path, value, wide=False):
    """Difference quotient of RESULTS: central, or one-sided at a bound or where the action becomes late.

    The wide one, of four points, is less exact where the results bend, and hardly sees that a steady state is found to
    1e-9 only.
    """
    home, _, rest = path.partition(".")
    bounds = metadata(excitation if home == "excitation" else getattr(system, home), rest)
    # A conductance is felt beside that of a load, some 1e-5 S.
    at_zero = {"time_lag": 3e-8, "offset": 1e-6, "diode_leakage": 1e-8, "dc_leakage": 1e-8, "diode_saturation": 1e-8}
    h = 1e-5 * abs(value) if value else at_zero.get(rest, 1e-5)
    kinked = system.shunt.kind in ("sece", "ssds") and rest in ("phase_lag", "time_lag")
    lags = [getattr(system.shunt, name, 0.0) for name in ("phase_lag", "time_lag")]
    side = 0.0
    if (kinked and not any(lags)) or bounds["at_least"] == value:
        side = 1.0
    elif bounds["at_most"] == value:
        side = -1.0
    if side:
        three = [at(system, excitation, path, value + side * k * h) for k in range(3)]
        return side * (-3 * three[0] + 4 * three[1] - three[2]) / (2 * h)
    steps = {1: 0.5} if not wide else {1: 8 / 12, 2: -1 / 12}
    h = 20 * h if wide else h
    ends = {k: [at(system, excitation, path, value + side * k * h) for side in (-1, 1)] for k in steps}
    return sum(weight * (ends[k][1] - ends[k][0]) for k, weight in steps.items()) / h


def check_all(system, excitation, relative=2e-5):
    """Every derivative is the difference quotient, and the values are those of `simulate`."""
    found, plain = gradient(system, excitation), simulate(system, excitation, samples=1)
    values = np.array([getattr(plain, name) for name in RESULTS])
    assert [getattr(found, name) for name in RESULTS] == pytest.approx(values, rel=1e-9, abs=1e-18)
    wrong = []
    for k, (path, value) in enumerate(zip(found.quantities, found.values, strict=True)):
        if path == "shunt.diode_leakage" and value == 0.0 and system.transducer.hysteresis:
            continue  # a corner: while the bridge blocks, stops rest at their thresholds, and the least leak turns them
        ours = np.array([found.by[name][k] for name in RESULTS])
        sizes = np.abs(values) / (abs(value) or {"shunt.time_lag": 3e-3}.get(path, 1.0))
        for wide in (False, True):
            wanted = difference(system, excitation, path, value, wide)
            bad = ~(np.abs(ours - wanted) <= relative * np.abs(wanted) + 1e-6 * sizes)
            if not bad.any():
                break
        for m in np.flatnonzero(bad):
            wrong.append(f"d {RESULTS[m]} / d {path}: {ours[m]:.9g}, differences give {wanted[m]:.9g}")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    ("circuit", "device"),
    with_slow(PAIRS, slow=lambda circuit, device: circuit not in FEW if device == "hysteresis" else device != "base"),
)
def test_differences_of_simulations(circuit, device):
    keys, drive = DEVICES[device]
    check_all(*objects(bench(CIRCUITS[circuit], drive, **keys)))


def resistor_power(mass, damping, stiffness, coupling, capacitance, resistance, amplitude, frequency):
    """Power, and displacement and voltage amplitude squared, with a resistor: analytic in every quantity."""
    w = 2 * np.pi * frequency
    loaded = 1 + (w * resistance * capacitance) ** 2
    real = stiffness - mass * w**2 + coupling**2 * (w * resistance) ** 2 * capacitance / loaded
    imaginary = w * damping + coupling**2 * w * resistance / loaded
    displacement = amplitude**2 / (real**2 + imaginary**2)
    voltage = (w * coupling * resistance) ** 2 * displacement / loaded
    return voltage / (2 * resistance), displacement, voltage


@settings(max_examples=25, deadline=None)
@given(st.floats(2.5, 6.5), st.floats(40.0, 60.0), st.floats(-4, -2.5))
def test_resistor_against_its_closed_form(resistance, frequency, coupling):
    """Harvested power of the two-port, derived by a complex step through the formula."""
    quantities = {**BENCH, "coupling": 10**coupling, "resistance": 10**resistance}
    quantities |= {"amplitude": 0.02, "frequency": frequency}
    study = bench(
        {"kind": "resistor", "resistance": 10**resistance}, {**DRIVE, "frequency": frequency}, coupling=10**coupling
    )
    found = gradient(*objects(study))
    power, x2, v2 = resistor_power(**quantities)
    assert found.harvested_power == pytest.approx(power, rel=1e-10)
    for path, value in zip(found.quantities, found.values, strict=True):
        name = path.rpartition(".")[2]
        if name not in quantities:
            continue
        step = resistor_power(**{**quantities, name: value * (1 + 1e-40j)})
        change = [each.imag / (1e-40 * value) for each in step]
        wanted = change[0], change[1] / (2 * np.sqrt(x2)), change[2] / (2 * np.sqrt(v2))
        sizes = power / value, np.sqrt(x2) / value, np.sqrt(v2) / value
        for result, derivative, size in zip(RESULTS, wanted, sizes, strict=True):
            error = abs(found.by[result][found.quantities.index(path)] - derivative)
            # At the resonance derivatives vanish beside others that are Q times as large, which rounding knows of.
            quality = np.sqrt(quantities["stiffness"] * quantities["mass"]) / quantities["damping"]
            assert error <= 1e-8 * abs(derivative) + 1e-9 * (1 + quality) * size, (result, path)


# Exponents of kg, m, s, A.
UNITS = {
    "mass": (1, 0, 0, 0), "effective_mass": (1, 0, 0, 0), "damping": (1, 0, -1, 0), "stiffness": (1, 0, -2, 0),
    "coupling": (0, -1, 1, 1), "capacitance": (-1, -2, 4, 2), "smoothing_capacitance": (-1, -2, 4, 2),
    "resistance": (1, 2, -3, -2), "load_resistance": (1, 2, -3, -2), "inductance": (1, 2, -2, -2),
    "thresholds": (0, 0, 1, 1), "weights": (1, 2, -4, -2), "frequency": (0, 0, -1, 0), "time_lag": (0, 0, 1, 0),
    "diode_resistance": (1, 2, -3, -2), "internal_resistance": (1, 2, -3, -2), "switch_resistance": (1, 2, -3, -2),
    "phase_time": (0, 0, 1, 0), "short_time": (0, 0, 1, 0), "intermediate_capacitance": (-1, -2, 4, 2),
    "bias_capacitance": (-1, -2, 4, 2), "flip_capacitances": (-1, -2, 4, 2),
    "flip_time": (0, 0, 1, 0), "time_constant": (0, 0, 1, 0), "source_voltage": (1, 2, -3, -1),
    "dc_voltage": (1, 2, -3, -1), "diode_drop": (1, 2, -3, -1), "saturation_voltage": (1, 2, -3, -1),
    "force_participation": (0, 0, 0, 0),
    **dict.fromkeys(("initial_dc_voltage", "turn_on", "turn_off", "max_voltage"), (1, 2, -3, -1)),
    **dict.fromkeys(("start_voltage", "stop_voltage"), (1, 2, -3, -1)),
    "gate_energy": (1, 2, -2, 0), "smoothing_resistance": (1, 2, -3, -2), "second_inductance": (1, 2, -2, -2),
    **dict.fromkeys(("power", "control_power"), (1, 2, -3, 0)),
    **dict.fromkeys(("fraction", "sampling_duty"), (0, 0, 0, 0)),
    "diode_leakage": (-1, -2, 3, 2), "dc_leakage": (-1, -2, 3, 2), "diode_saturation": (0, 0, 0, 1),
    "detector_threshold": (1, 2, -3, -1),
    "phase_lag": (0, 0, 0, 0), **dict.fromkeys(("quality", "second_quality", "residual"), (0, 0, 0, 0)),
    "efficiency": (0, 0, 0, 0), "on_time_error": (0, 0, 0, 0),
}  # fmt: skip
RESULT_UNITS = {
    "harvested_power": (1, 2, -3, 0), "displacement_amplitude": (0, 1, 0, 0), "voltage_amplitude": (1, 2, -3, -1),
}  # fmt: skip


def check_units(system, excitation, relative):
    """Euler's theorem for every base unit: no result knows which units it is computed in."""
    found = gradient(system, excitation)
    drive = (0, 1, -2, 0) if excitation.base else (1, 1, -2, 0)
    units = {**UNITS, "amplitude": drive, "offset": drive}
    names = [next(part for part in reversed(path.split(".")) if not part.isdigit()) for path in found.quantities]
    exponents = np.array([units[name] for name in names])
    for name, unit in RESULT_UNITS.items():
        terms = exponents.T * found.values * found.by[name]
        wanted = getattr(found, name) * np.array(unit)
        # Rounding against the largest term: at resonance those of mass and stiffness are much larger than their sum.
        sizes = np.abs(terms).max(axis=1) + abs(getattr(found, name))
        assert np.all(np.abs(terms.sum(axis=1) - wanted) <= relative * sizes), name
    return found


@pytest.mark.parametrize(("circuit", "device"), PAIRS)
def test_homogeneous_in_the_units(circuit, device):
    keys, drive = DEVICES[device]
    check_units(*objects(bench(CIRCUITS[circuit], drive, **keys)), relative=1e-8)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2000))
@example(0)
@example(9)
@example(494)  # a voltage that turns within nanoseconds of the switch
def test_random_studies_are_homogeneous_in_the_units(seed):
    system, excitation = objects(random_study(seed))
    try:
        check_units(system, excitation, relative=1e-6)
    except NoGradientError:
        assume(False)


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(["resistor", "p-sshi", "s-sshi", "sece late", "ssdi"]), st.floats(-6.0, 4.0))
def test_power_grows_with_the_square_of_the_amplitude(circuit, exponent):
    """Without thresholds of any kind: amplitude dP/d amplitude = 2 P, and amplitudes are proportional."""
    found = gradient(*objects(bench(CIRCUITS[circuit], {**DRIVE, "amplitude": 10**exponent})))
    k = found.quantities.index("excitation.amplitude")
    for name, power in zip(RESULTS, (2, 1, 1), strict=True):
        wanted = power * getattr(found, name)
        assert found.values[k] * found.by[name][k] == pytest.approx(wanted, rel=1e-8, abs=1e-300), name


@pytest.mark.parametrize("circuit", FEW)
def test_symmetry_of_the_offset(circuit):
    """Nothing depends on the offset's sign: derivatives by it vanish at zero and change sign with it."""
    by = {}
    for offset in (-2e-3, 0.0, 2e-3):
        found = gradient(*objects(bench(CIRCUITS[circuit], {**DRIVE, "offset": offset}, hysteresis=STOPS)))
        by[offset] = np.array([found.by[name][found.quantities.index("excitation.offset")] for name in RESULTS])
        scale = np.array([getattr(found, name) for name in RESULTS]) / DRIVE["amplitude"]
    assert np.all(by[0.0] == 0.0)
    assert np.all(np.abs(by[2e-3] + by[-2e-3]) <= 1e-6 * scale)


@pytest.mark.parametrize("circuit", CIRCUITS)
def test_half_and_whole_period_agree(circuit):
    """An offset too small to matter forbids the search on half the period; the derivatives must not notice."""
    half = gradient(*objects(bench(CIRCUITS[circuit])))
    whole = gradient(*objects(bench(CIRCUITS[circuit], {**DRIVE, "offset": 1e-9})))
    for name in RESULTS:
        keep = [k for k, path in enumerate(half.quantities) if path != "excitation.offset"]
        sizes = getattr(half, name) / np.where(half.values == 0, 1.0, np.abs(half.values)) + np.abs(half.by[name])
        assert np.all(np.abs(half.by[name] - whole.by[name])[keep] <= 1e-6 * sizes[keep]), name


@pytest.mark.parametrize("circuit", ["resistor", "rectifier", "p-sshi"])
def test_multisine_by_its_amplitudes_and_phases(circuit):
    tones = {"amplitudes": (0.02, 0.01), "frequencies": (50.0, 75.0), "phases": (0.4, -1.0), "duration": 0.2}
    system, _ = objects(bench(CIRCUITS[circuit], damping=0.3))
    excitation = Multisine(**tones)
    found = gradient(system, excitation)
    for k, path in enumerate(found.quantities):
        if not path.startswith(("excitation.amplitudes", "excitation.phases")):
            continue
        wanted = difference(system, excitation, path, found.values[k])
        for name, derivative in zip(RESULTS, wanted, strict=True):
            size = getattr(found, name) / abs(found.values[k])
            assert abs(found.by[name][k] - derivative) <= 2e-5 * abs(derivative) + 1e-6 * size, (name, path)


@pytest.mark.parametrize("circuit", ["rectifier", "p-sshi dc", "p-sshi", "s-sshi late"])
def test_an_offset_too_small_to_matter_does_not(circuit):
    """The constant term's scale must not come from the offset where a diode drop or a dc voltage is as constant."""
    system, excitation = objects(bench(CIRCUITS[circuit]))
    plain = simulate(system, excitation, samples=1)
    for offset in (1e-14, 1e-12):
        found = simulate(system, dataclasses.replace(excitation, offset=offset), samples=1)
        assert found.converged, found.message
        assert found.harvested_power == pytest.approx(plain.harvested_power, rel=1e-8)


def test_an_early_action_that_waits_at_the_section():
    """Its cause lies in the span before the one that is followed: said, and not made up from another event."""
    with pytest.raises(NoGradientError, match="was decided before the span"):
        gradient(*objects(random_study(633)))


def test_no_gradient_without_a_period():
    system, _ = objects(bench(CIRCUITS["resistor"]))
    with pytest.raises(NoGradientError, match="period"):
        gradient(system, StepForce(amplitude=0.1, duration=0.1))


def test_no_gradient_where_nothing_settles():
    shunt = {"kind": "ssdi", "inductance": 0.01, "quality": 42.0, "phase_lag": -0.3}
    system, excitation = objects(bench(shunt))
    assert not simulate(system, excitation, samples=1).converged
    with pytest.raises(NoGradientError, match="steady state"):
        gradient(system, excitation)


def test_quantities_and_values_are_those_of_the_model():
    shunt = {**PARALLEL, **LOOP}
    system, excitation = objects(bench(shunt, hysteresis=STOPS))
    found = gradient(System(system.transducer, system.shunt), excitation)
    values = dict(zip(found.quantities, found.values, strict=True))
    assert values["transducer.mass"] == BENCH["mass"]
    assert values["transducer.hysteresis.thresholds.1"] == STOPS["thresholds"][1]
    assert values["shunt.quality"] == LOOP["quality"]
    assert values["excitation.frequency"] == DRIVE["frequency"]
    assert all(np.all(np.isfinite(change)) and len(change) == len(values) for change in found.by.values())
