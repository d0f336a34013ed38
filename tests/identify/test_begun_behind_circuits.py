"""States of effects that a record behind diodes finds under way, against an integration written by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from piezoharvest.description.effects import Creep
from piezoharvest.description.shunts import ParallelSSHI, Rectifier
from piezoharvest.description.transducer import Transducer
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.model import Model, begun_effects
from piezoharvest.identify.fitting.output_error import fit, standard_errors
from piezoharvest.identify.fitting.problem import Problem, prior_of, starting
from piezoharvest.identify.noise.noise_model import Noise
from piezoharvest.predict.circuit.circuit_prediction import CircuitPrediction
from piezoharvest.predict.circuit.measured_drive import straight_drive
from piezoharvest.predict.circuit.setting import circuit_setting
from piezoharvest.predict.parameters import Parameter, put
from piezoharvest.records.checks.unused import unused
from piezoharvest.records.record import Record, Signal

m, b, k, T, C = 0.010, 0.0628, 986.96, 1.0e-3, 40e-9
RATIO, RETARDATION, HELD = 0.05, 0.12, 2.0  # HELD: V, of the dc side
CREEP = Creep(compliance_ratio=RATIO, time_constant=RETARDATION)
DEVICE = Transducer(mass=m, damping=b, stiffness=k, coupling=T, capacitance=C, effects=(CREEP,))
STEP, COUNT, BEGUN = 1e-3, 300, 2e-5
TIME = STEP * np.arange(COUNT)
FORCE = 0.05 * np.sin(2 * np.pi * 47.0 * TIME)
LINES = straight_drive(FORCE).coefficients  # what stands for the samples: straight lines, a little larger
DRIVE = np.append(LINES[:, 0], LINES[-1].sum())
SHUNT = Rectifier(dc_voltage=HELD)
NAMES = ("displacement", "voltage")


def by_hand():
    """Displacement and voltage of x, u, q, y from rest but for the creep y: q stands, or v = (q - T x)/C is held."""

    def rates(side):
        def rate(time, z):
            x, u, q, y = z.tolist()
            v = (q - T * x) / C if side == 0 else side * HELD
            force = np.interp(time, TIME, DRIVE)
            charge = 0.0 if side == 0 else T * u
            return [u, (force - b * u - k * (x - y) + T * v) / m, charge, (RATIO * (x - y) - y) / RETARDATION]

        return rate

    def crossing(function, direction):
        function.terminal, function.direction = True, direction
        return function

    def excess(side):
        return crossing(lambda t, z: (z[2] - T * z[0]) / C - side * HELD, side)

    blocking = [excess(1), excess(-1)]
    time, z, side, found = 0.0, np.array([0.0, 0.0, 0.0, BEGUN]), 0, []
    while time < TIME[-1]:
        # While conducting, current -q' flows out where v is positive: it ends as u rises through zero.
        ends = blocking if side == 0 else [crossing(lambda t, z: z[1], side)]
        run = solve_ivp(rates(side), (time, TIME[-1]), z, "DOP853", rtol=1e-11, atol=1e-15, events=ends,
                        dense_output=True, max_step=STEP)  # fmt: skip
        inside = TIME[(time <= TIME) & (run.t[-1] >= TIME)][len(found) and 0 :]
        values = run.sol(inside)
        v = (values[2] - T * values[0]) / C if side == 0 else np.full(len(inside), side * HELD)
        found += [row for t, row in zip(inside, np.column_stack([values[0], v]), strict=True) if t > time or not found]
        time, z = run.t[-1], run.y[:, -1]
        side = 0 if side else next((s for s, hits in zip((1, -1), run.t_events, strict=True) if len(hits)), 0)
    return np.array(found)


@pytest.fixture(scope="module")
def truth():
    found = by_hand()
    assert found.shape == (COUNT, 2)
    assert np.ptp(found[:, 1]) == pytest.approx(2.0 * HELD, rel=1e-9)  # both diode pairs conduct
    return found


def setting():
    return replace(circuit_setting("force", SHUNT, STEP, FORCE, replace(DEVICE, effects=())), reach=np.sqrt(k) * 4e-5)


def predicted(nuisance, device=DEVICE, parameters=()):
    prediction = CircuitPrediction(device, setting(), parameters, nuisance, under_way=1)
    (block,) = prediction.blocks(bool(parameters), channels=NAMES)
    return block


def test_creep_under_way_behind_a_rectifier_is_that_of_the_integration(truth):
    prediction = CircuitPrediction(DEVICE, setting(), under_way=1)
    assert prediction.nuisance_names[-1] == "start effect1_creep_creep"
    assert prediction.begun == (0,)
    nuisance = np.zeros(len(prediction.nuisance_names))
    nuisance[-1] = BEGUN
    values = predicted(nuisance).values
    size = np.abs(truth).max(axis=0)
    # The integration's drive is straight between samples as well; its dense output is good to 1e-8.
    np.testing.assert_allclose(values / size, truth / size, rtol=0, atol=1e-6)
    still = predicted(np.zeros(len(nuisance))).values
    assert np.abs((still - truth) / size).max() > 0.02


def test_derivatives_by_a_state_that_is_under_way(truth):
    parameter = Parameter(("effects", 0, "time_constant"), "s", "log", -np.inf, np.inf)
    nuisance = np.zeros(4)
    nuisance[-1] = BEGUN
    block = predicted(nuisance, parameters=(parameter,))
    step = 1e-4 * BEGUN
    high, low = (predicted(nuisance + side * step * np.eye(4)[-1]).values for side in (1, -1))
    slope = (high - low) / (2 * step)
    np.testing.assert_allclose(block.derivatives[..., -1], slope, rtol=0, atol=1e-3 * np.abs(slope).max())


def test_an_effect_that_is_only_tried_begins_at_rest(truth):
    """Beside creep that is under way: values and derivatives by the creep's beginning are those without the other."""
    slow = Creep(compliance_ratio=0.0, time_constant=0.02)
    device = replace(DEVICE, effects=(CREEP, slow))
    tried = Parameter(("effects", 1, "compliance_ratio"), "", "linear", 0.0, np.inf)
    nuisance = np.array([0.0, 0.0, 0.0, BEGUN])
    prediction = CircuitPrediction(device, setting(), (tried,), nuisance, felt=1, under_way=1)
    (block,) = prediction.blocks(channels=NAMES)
    alone = predicted(nuisance, parameters=(Parameter(("stiffness",), "N/m", "log", -np.inf, np.inf),))
    np.testing.assert_allclose(block.values, alone.values, rtol=0, atol=1e-12 * np.abs(truth).max())
    np.testing.assert_allclose(block.derivatives[..., 1:], alone.derivatives[..., 1:], rtol=1e-9, atol=1e-9)
    assert np.abs(block.derivatives[..., 0]).max() > 0.0


def test_a_fit_finds_where_the_creep_was_and_its_number_stays_where_the_effect_is_gone(truth):
    rng, sigma = np.random.default_rng(1), {"displacement": 2e-7, "voltage": 1e-2}
    noisy = truth + rng.standard_normal(truth.shape) * list(sigma.values())
    signals = {name: Signal(noisy[:, n], sigma[name], "r.csv", name, 1) for n, name in enumerate(NAMES)}
    signals["force"] = Signal(FORCE, 1e-9, "r.csv", "force", 1)
    record = Record("r.csv", "records.0", "fit", "force", SHUNT, 0.0, Signal(TIME, None, "r.csv", "t", 1), signals)
    data = Data("r.csv", "fit", record, setting(), np.zeros(COUNT), NAMES, sigma, dict.fromkeys(NAMES, 0.0))
    problem = Problem([data], replace(DEVICE, effects=()), ())
    free = Model(DEVICE, (Parameter(("stiffness",), "N/m", "log", -np.inf, np.inf),), (), at_rest=False)
    found = fit(problem, free, noise=Noise({**sigma, "force": 1e-9}), estimate_noise=False)
    value, error = found.nuisance[0][3], standard_errors(found)[4]
    assert error < 0.1 * BEGUN
    assert abs(value - BEGUN) < 3.5 * error
    still = fit(problem, replace(free, at_rest=True), noise=found.noise, white=found.white, estimate_noise=False)
    assert still.cost > found.cost + 100.0
    assert begun_effects(free, data) == (0,)
    means, precision = prior_of(problem, free)
    assert means[4] == 0.0
    assert precision[4] ** -0.5 == pytest.approx(4e-5)  # as much energy as the record's motion has
    assert not starting(problem, free)[0][3]
    gone = put(DEVICE, ("effects", 0, "compliance_ratio"), 0.0)
    assert (
        CircuitPrediction(gone, setting(), under_way=1).nuisance_names
        == CircuitPrediction(DEVICE, setting(), under_way=1).nuisance_names
    )
    same = predicted(found.nuisance[0], gone).values
    np.testing.assert_array_equal(same, predicted(found.nuisance[0] * [1, 1, 1, 0], gone).values)


def test_a_gate_in_steady_state_is_not_used_and_the_record_says_so():
    signals = {
        name: Signal(np.sign(FORCE) if name == "gate" else FORCE, None, "r.csv", name, 1) for name in ("force", "gate")
    }
    shunt = ParallelSSHI(inductance=0.1, quality=5.0, smoothing_capacitance=1e-6, load_resistance=1e6)
    time = Signal(TIME, None, "r.csv", "time", 1)
    record = Record("r.csv", "records.0", "fit", "force", shunt, 0.0, time, signals, periodic=True)
    (finding,) = unused(record)
    assert (finding.severity, finding.channel) == ("warning", "gate")
    assert (
        finding.message
        == "found a gate, but in steady state the displacement determines when the switch acts; it is not used"
    )
    assert record.gate is None
