"""Expected figures under noise: exact for linear shunts, with a standard error for switched ones."""

import numpy as np
import pytest

from piezoharvest.description.excitation import RandomBase, RandomForce
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import SECE, SSDI, Open, ParallelSSHI, Resistor, SeriesRL
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Mode
from piezoharvest.design import Bound
from piezoharvest.design.broadband.estimate import controlled_mean
from piezoharvest.design.broadband.expectation import NoiseExpectation
from piezoharvest.design.goal import Goal
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.operation import operation_of
from piezoharvest.engine.simulation import simulate
from piezoharvest.engine.windows import window_averages
from piezoharvest.engine.work_limit import MAX_WORK, Budget
from piezoharvest.linear import white_noise_response
from piezoharvest.study import DesignOptions

PSD = 1e-4
NOISE = RandomForce(psd=PSD, band=(20.0, 100.0), duration=10.0, seed=1)
LOAD = Resistor(resistance=8e4)


def expectation(transducer, excitation=NOISE, objective="harvest"):
    goal = Goal(DesignOptions(objective=objective))
    return NoiseExpectation(LinearView(transducer, operation_of(excitation, None, transducer), goal))


@pytest.mark.parametrize("shunt", [LOAD, SeriesRL(inductance=250.0, resistance=2e4)])
@pytest.mark.parametrize("base", [False, True])
def test_lyapunov_is_the_limit_of_quadrature(host, shunt, base):
    """For a band that holds all of the response, also with a second mode."""
    transducer = host(0.05, 60, modes=(Mode(mass=0.01, stiffness=4e4, damping=0.2, coupling=5e-4),))
    kind = RandomBase if base else RandomForce
    power, square = expectation(transducer, kind(psd=PSD, band=(1e-2, 1e4), duration=1.0, seed=1))._linear(shunt)
    found = white_noise_response(System(transducer, shunt), PSD, base=base)
    # The rest above the band falls as its third power; of base motion below it nothing is left.
    assert found.harvested_power == pytest.approx(power, rel=1e-5)
    assert found.displacement == pytest.approx(square, rel=1e-4)


def test_power_of_white_noise_is_all_accounted_for(host):
    """S/(4 m) comes in whatever the load; without damping it can only go to the load."""
    found = white_noise_response(System(host(0.05), LOAD), PSD)
    assert found.harvested_power == pytest.approx(PSD / (4 * 0.01), rel=1e-9)


def test_what_does_not_die_out_has_no_mean_square(host):
    for system in (System(host(0.05, 60), Open()), System(host(0.0), LOAD)):
        with pytest.raises(ParameterError, match="does not decay"):
            white_noise_response(system, PSD)


def test_simulated_and_exact_expectation_of_a_resistor_agree(host):
    """Within two standard errors, which are below 0.1 %, though the realisation itself is several per cent off."""
    transducer = host(0.05, 60)
    noise = expectation(transducer)
    power, square = noise._linear(LOAD)
    found = noise.estimated(LOAD, Budget(MAX_WORK))
    for estimate, exact in zip(found, (power, square), strict=True):
        assert estimate.standard_error < 1e-3 * exact
        assert abs(estimate.value - exact) < 2 * estimate.standard_error
    assert abs(simulate(System(transducer, LOAD), NOISE).harvested_power / power - 1) > 0.02


def test_windows_make_up_the_run(host):
    system = System(host(0.05, 60), SECE())
    found = window_averages(system, NOISE, np.linspace(0, 10, 5))
    assert found.complete
    assert np.mean(found.harvested_power) == pytest.approx(simulate(system, NOISE).harvested_power, rel=1e-9)


@pytest.mark.parametrize("shunt", [SECE(), ParallelSSHI(dc_voltage=10.0, inductance=0.2, quality=6.0)])
def test_one_per_cent_of_a_switched_shunt(host, shunt):
    """Reached with a tenth of the work of ten seconds, and other realisations agree."""
    transducer = host(0.05, 60)
    budget = Budget(MAX_WORK // 10)
    first = expectation(transducer).of(shunt, budget).harvested_power
    assert budget.left > 0
    assert 0 < first.standard_error < 0.0101 * first.value
    others = RandomForce(psd=PSD, band=(20.0, 100.0), duration=40.0, seed=1000)
    second = expectation(transducer, others).of(shunt, Budget(MAX_WORK // 5)).harvested_power
    assert abs(first.value - second.value) < 3 * np.hypot(first.standard_error, second.standard_error)


def test_motion_is_what_counts_for_damping(host):
    found = expectation(host(0.05, 60), objective="damping").of(SSDI(inductance=0.2, quality=6.0), Budget(MAX_WORK))
    square = found.displacement_square
    assert 0 < square.standard_error < 0.0202 * square.value  # the root errs by half
    assert found.harvested_power.value == 0.0


def test_with_hysteresis_there_is_no_exact_expectation(host):
    transducer = host(0.05, 60, hysteresis=Hysteresis(thresholds=(1e-7,), weights=(1e5,)))
    noise = expectation(transducer)
    assert not noise.exact
    found = noise.of(LOAD, Budget(MAX_WORK // 10)).harvested_power
    assert found.standard_error > 0


def test_error_of_a_controlled_mean_is_what_it_says():
    """Over many trials the deviations have the size of the standard error, and controls make it small."""
    rng = np.random.default_rng(2)
    deviations, errors, plain = [], [], []
    for _ in range(300):
        controls = 5.0 + rng.normal(size=(20, 2))
        samples = 3.0 + controls @ [2.0, -1.0] - 5.0 + 0.1 * rng.normal(size=20)
        found = controlled_mean(samples, controls, np.array([5.0, 5.0]))
        deviations.append(found.value - 3.0)
        errors.append(found.standard_error)
        plain.append(controlled_mean(samples, np.empty((20, 0)), np.empty(0)).standard_error)
    # Three standard deviations of a standard deviation from 300 trials.
    assert np.std(deviations) == pytest.approx(np.sqrt(np.mean(np.square(errors))), rel=0.13)
    assert np.mean(plain) > 10 * np.mean(errors)


def test_design_reports_expectations(host, run, monkeypatch):
    """Exact ones for what is linear, with an error for what is switched; without the bound, which takes longer."""
    monkeypatch.setattr("piezoharvest.design.search.bound_of", lambda view: Bound())
    transducer = host(0.05, 60)
    result = run(transducer, excitation=NOISE, candidates=("resistor", "sece"), shunts=[LOAD], hold=("resistance",))
    by_kind = {c.shunt.kind: c for c in result.candidates}
    power, square = expectation(transducer)._linear(LOAD)
    resistor = by_kind["resistor"]
    assert resistor.harvested_power == pytest.approx(power, rel=1e-12) and resistor.standard_error == 0.0
    assert resistor.displacement_amplitude == pytest.approx(np.sqrt(2 * square), rel=1e-9)
    error = by_kind["sece"].as_json()["harvested_power_standard_error"]
    assert 0 < error < 0.0101 * by_kind["sece"].harvested_power
