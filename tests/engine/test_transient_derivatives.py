"""Derivatives of sampled runs through events, against central differences of the engine's own runs.

That the runs themselves are right is held against the independent integration elsewhere.
"""

import dataclasses

import numpy as np
import pytest
from studies import STOPS, bench, objects

from piezoharvest import (
    CouplingDrift,
    Creep,
    DielectricRelaxation,
    Leakage,
    NonlinearCoupling,
    Stiffening,
    VoltageDependentCapacitance,
)
from piezoharvest.engine.transient import variation
from piezoharvest.predict.circuit.circuit_prediction import CircuitPrediction
from piezoharvest.predict.circuit.measured_drive import straight_drive
from piezoharvest.predict.discrete_model import Setting
from piezoharvest.predict.parameters import parameter_of, parameters_of, put, value_at

SMOOTH = {"smoothing_capacitance": 1e-6, "load_resistance": 3e5}
COIL = {"inductance": 0.1, "quality": 5.0}
CIRCUITS = {
    "rectifier": {"kind": "rectifier", **SMOOTH, "diode_drop": 0.3},
    "parallel_sshi": {"kind": "parallel_sshi", **COIL, **SMOOTH, "diode_drop": 0.3},
    "parallel_sshi late": {"kind": "parallel_sshi", **COIL, **SMOOTH, "time_lag": 3e-4, "on_time_error": 0.1},
    "series_sshi": {"kind": "series_sshi", **COIL, **SMOOTH, "load_resistance": 3e4},
    "sece late": {"kind": "sece", "time_lag": 3e-4},
    "ssdi": {"kind": "ssdi", **COIL},
}
SIZES = {"x1": 1e-4, "u1": 0.03, "q": 1e-7, "dc": 3.0}
STEP = 2.5e-4  # s
# Central differences of runs that are right to 1e-12: most samples agree to this. Where an event of one run lies on the
# other side of a sample, the difference is wrong by the height of what jumps there.
TOLERANCE, SHARE = 5e-5, 0.93
# From null, SI: differences change the channels by some thousandths, above the error of runs with such effects.
STEPS_FROM_NULL = {
    "stiffening": 1e6, "coupling_drift": 1e-3, "nonlinear_coupling": 1e-2, "voltage_dependent_capacitance": 1e-5,
}  # fmt: skip


def setting_of(shunt, free, count=400):
    noise = np.random.default_rng(3).normal(size=count + 6)
    values = 0.05 * np.convolve(noise, np.ones(7) / 7, "valid")
    sizes = tuple(SIZES[name] for name in free)
    drive = straight_drive(values)
    return Setting("force", shunt, STEP, float(values[0]), drive, count, free=free, sizes=sizes)


def case(circuit, effects=(), **transducer):
    """Prediction of a record from a moving start, and the function that predicts it with other values."""
    system, _ = objects(bench(CIRCUITS[circuit], **transducer))
    device = dataclasses.replace(system.transducer, effects=effects)
    free = ("x1", "u1", "q", *(("dc",) if "smoothing_capacitance" in CIRCUITS[circuit] else ()))
    setting, parameters = setting_of(system.shunt, free), parameters_of(device, {"force"})
    for n, effect in enumerate(effects):
        fields = (field for field in dataclasses.fields(effect) if "unit" in field.metadata)
        parameters += [parameter_of(effect, field, ("effects", n, field.name)) for field in fields]
    stops = len(device.hysteresis.weights) if device.hysteresis else 0
    nuisance = np.abs(0.3 * np.random.default_rng(1).normal(size=len(free) + stops))
    channels = ("displacement", "velocity", "acceleration", "voltage", "current")
    if "dc" in free:
        channels += ("dc_voltage", "dc_current")

    def values(device=device, nuisance=nuisance):
        (block,) = CircuitPrediction(device, setting, (), nuisance).blocks(derivatives=False, channels=channels)
        return block.values

    (block,) = CircuitPrediction(device, setting, parameters, nuisance).blocks(channels=channels)
    return device, parameters, nuisance, values, block


def check(device, parameters, nuisance, values, block, *, relative=1e-6, error=1e-12, tolerance=TOLERANCE):
    assert np.allclose(values(), block.values, rtol=1e-9, atol=error * np.abs(block.values).max(axis=0))
    for k in range(len(parameters) + len(nuisance)):
        step = relative
        if k < len(parameters):
            parameter = parameters[k]
            inner = parameter.inner(value_at(device, parameter.path))
            step *= 1.0 if parameter.scaling == "log" else 1e2 * abs(inner)  # an effect changes little
            upper, lower = (
                values(put(device, parameter.path, float(np.real(parameter.outer(inner + sign * step)))))
                for sign in (1.0, -1.0)
            )
        else:
            moved = step * (np.arange(len(nuisance)) == k - len(parameters))
            upper, lower = values(nuisance=nuisance + moved), values(nuisance=nuisance - moved)
        wanted, found = (upper - lower) / (2.0 * step), block.derivatives[:, :, k]
        # What a parameter hardly changes is a difference of rounding errors.
        size = np.abs(wanted).max(axis=0) + 1e-9 * np.abs(block.values).max(axis=0) * 1e-6 / step + 1e-300
        close = np.abs(found - wanted) <= tolerance * size
        assert np.all(close.mean(axis=0) > SHARE), (k, close.mean(axis=0))


@pytest.mark.parametrize("circuit", CIRCUITS)
@pytest.mark.parametrize("hysteresis", [None, STOPS], ids=["linear", "hysteresis"])
def test_derivatives_through_events(circuit, hysteresis):
    check(*case(circuit, **({"hysteresis": hysteresis} if hysteresis else {})))


def test_effects_that_are_linear():
    effects = (
        Leakage(resistance=3e6), DielectricRelaxation(capacitance=4e-9, time_constant=5e-3),
        Creep(compliance_ratio=0.05, time_constant=0.02),
    )  # fmt: skip
    check(*case("parallel_sshi", effects))


BENT = {
    "stiffening": Stiffening(cubic_stiffness=3e9), "drift": CouplingDrift(relative_drift=0.1),
    "coupling": NonlinearCoupling(quadratic_coupling=3.0), "capacitance": VoltageDependentCapacitance(beta=1e-4),
}  # fmt: skip
BENT_TOLERANCE = 2e-4  # the outputs' derivatives are corrected once in a step; twice, they come within 5e-6
QUICK = [("rectifier", "stiffening"), ("parallel_sshi late", "coupling"), ("sece late", "drift")]


@pytest.mark.parametrize(
    ("circuit", "name"),
    [
        pytest.param(circuit, name, marks=() if (circuit, name) in QUICK else pytest.mark.slow)
        for circuit in CIRCUITS
        for name in BENT
    ],
)
@pytest.mark.parametrize("hysteresis", [None, STOPS], ids=["linear", "hysteresis"])
def test_effects_that_are_nonlinear_between_events(circuit, name, hysteresis, monkeypatch):
    """Their runs are right to about 1e-8, so that differences are of better ones, and need wide steps."""
    found = case(circuit, (BENT[name],), **({"hysteresis": hysteresis} if hysteresis else {}))
    monkeypatch.setattr(variation, "TOLERANCE", 1e-11)
    check(*found, relative=1e-5, error=1e-5, tolerance=BENT_TOLERANCE)


@pytest.mark.parametrize("circuit", ["rectifier", "parallel_sshi late", "sece late"])
@pytest.mark.parametrize(
    "effect",
    [
        Stiffening(cubic_stiffness=0.0), CouplingDrift(relative_drift=0.0), NonlinearCoupling(quadratic_coupling=0.0),
        VoltageDependentCapacitance(beta=0.0),
    ],
    ids=lambda effect: effect.name,
)  # fmt: skip
def test_effects_that_are_nonlinear_at_their_null(circuit, effect):
    """Their outputs force the derivatives of a motion that is still linear; runs with them are right to about 1e-8."""
    device, parameters, _, values, block = case(circuit, (effect,))
    (path,), step = [p.path for p in parameters if p.path[0] == "effects"], STEPS_FROM_NULL[effect.name]
    upper, lower = (values(put(device, path, sign * step)) for sign in (1.0, -1.0))
    wanted, found = (upper - lower) / (2.0 * step), block.derivatives[:, :, len(parameters) - 1]
    close = np.abs(found - wanted) <= TOLERANCE * np.abs(wanted).max(axis=0)
    assert np.all(np.abs(wanted).max(axis=0)[:2] > 0.0)
    assert np.all(close.mean(axis=0) > SHARE), close.mean(axis=0)


def test_a_preload_moves_the_derivative_of_a_null_stiffening():
    """Closed form: a static force F at rest displaces by F/k, and by -k3 (F/k)^3/k more with a cubic stiffness k3."""
    system, _ = objects(bench(CIRCUITS["rectifier"]))
    device = dataclasses.replace(system.transducer, effects=(Stiffening(cubic_stiffness=0.0),))
    setting = Setting("force", system.shunt, STEP, 0.02, straight_drive(np.full(50, 0.02)), 50)
    (field,) = (field for field in dataclasses.fields(Stiffening) if "unit" in field.metadata)
    parameter = parameter_of(device.effects[0], field, ("effects", 0, field.name))
    (block,) = CircuitPrediction(device, setting, (parameter,)).blocks(channels=("displacement",))
    wanted = -((0.02 / device.stiffness) ** 3) / device.stiffness
    np.testing.assert_allclose(block.derivatives[:, 0, 0], wanted, rtol=1e-9)


def test_predictions_of_one_model_share_their_matrices():
    """The second of two records with other drives is predicted as it is alone."""
    system, _ = objects(bench(CIRCUITS["parallel_sshi"]))
    device, parameters, known = system.transducer, parameters_of(system.transducer, {"force"}), {}
    setting = setting_of(system.shunt, ("x1", "u1", "q", "dc"))
    other = dataclasses.replace(setting, motion=straight_drive(0.03 + 0.02 * np.sin(np.arange(setting.count))))
    start = np.array([0.2, 0.1, -0.1, 0.3])
    for each in (setting, other):
        (shared,) = CircuitPrediction(device, each, parameters, start, systems=known).blocks()
        (alone,) = CircuitPrediction(device, each, parameters, start).blocks()
        np.testing.assert_array_equal(shared.values, alone.values)
        np.testing.assert_array_equal(shared.derivatives, alone.derivatives)
    assert len(known) == 1


def test_effects_without_influence_a_few_at_a_time():
    """Derivatives are those of all effects in one system."""
    effects = tuple(Creep(compliance_ratio=0.0, time_constant=0.01 * n) for n in range(1, 7))
    system, _ = objects(bench(CIRCUITS["parallel_sshi"]))
    device = dataclasses.replace(system.transducer, effects=effects)
    fields = {field.name: field for field in dataclasses.fields(Creep)}
    parameters = parameters_of(device, {"force"})
    parameters += [parameter_of(e, fields["compliance_ratio"], ("effects", n, "compliance_ratio"))
                   for n, e in enumerate(effects)]  # fmt: skip
    setting = setting_of(system.shunt, ("x1", "u1", "q", "dc"))
    (together,), (apart,) = (
        tuple(CircuitPrediction(device, setting, parameters, felt=felt).blocks(channels=("voltage", "displacement")))
        for felt in (None, 0)
    )
    size = np.abs(together.derivatives).max(axis=(0, 2), keepdims=True)
    assert np.abs(together.derivatives - apart.derivatives).max() < 1e-9 * size.max()
    assert np.allclose(together.values, apart.values, rtol=1e-12)


def test_straight_lines_act_as_the_smooth_curve():
    """Displacement under a sine of forty samples a period: closed form to 1e-5, where joined samples lose 2e-3."""
    system, _ = objects(bench({"kind": "ssds", "time_lag": 1e-3}))
    device = dataclasses.replace(system.transducer, coupling=1e-12)
    time, omega = np.arange(40001) * 5e-4, 2.0 * np.pi * 50.0
    values = 0.02 * np.sin(omega * time)
    setting = Setting("force", system.shunt, 5e-4, 0.0, straight_drive(values), len(values))
    (block,) = CircuitPrediction(device, setting).blocks(derivatives=False, size=1 << 20, channels=("displacement",))
    gain = 1.0 / (device.stiffness - device.mass * omega**2 + 1j * omega * device.damping)
    late = slice(30000, None)
    wanted = 0.02 * np.imag(gain * np.exp(1j * omega * time[late]))
    assert np.abs(block.values[late, 0] - wanted).max() < 1e-5 * np.abs(wanted).max()
