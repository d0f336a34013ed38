"""Nominal mass and damping of a stack far below its resonance, of which the records show neither.

Its charge lags by w b/k = 1e-4 rad, which is below the noise; without that a fit takes it for charge that leaks.
Records by a matrix exponential, exact for sines.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from piezoharvest import Campaign, Transducer
from piezoharvest.description.effects.electrical.dielectric_relaxation import DielectricRelaxation
from piezoharvest.identify.fitting.output_error import fit
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_model
from piezoharvest.identify.identification import identify
from piezoharvest.identify.preparation import prepared
from piezoharvest.identify.start_values.quasi_static import as_quasi_static, is_better_left_out

MASS, DAMPING, STIFFNESS, COUPLING, CAPACITANCE = 0.0165, 1290.0, 3.13e8, 7.69, 3.22e-6
NOMINAL = Transducer(mass=0.0158, damping=1250.0, stiffness=3.1e8, coupling=7.8, capacitance=3.2e-6)
RATE, COUNT = 500.0, 750
COLUMNS = {"force": "force_N", "displacement": "displacement_m", "voltage": "voltage_V", "current": "current_A"}
NOISE = {"displacement": 1.2e-8, "voltage": 1.5e-3, "current": 2e-8}
DRIVES = ((550.0, 440.0, 4.0, 1e5), (500.0, 400.0, 7.0, 5e4))  # offset and amplitude (N), frequency (Hz), load (ohm)


def shown(offset, amplitude, frequency, load, rng):
    """Channels of a record that begins at rest, with noise."""
    w = 2.0 * np.pi * frequency
    A = np.zeros((6, 6))  # of x, x', v, sine, cosine, 1
    A[0, 1], A[3, 4], A[4, 3] = 1.0, w, -w
    A[1, [0, 1, 2, 3, 5]] = np.array([-STIFFNESS, -DAMPING, COUPLING, amplitude, offset]) / MASS
    A[2, 1], A[2, 2] = -COUPLING / CAPACITANCE, -1.0 / (load * CAPACITANCE)
    scale = np.array([1e-6, 1e-4, 1.0, 1.0, 1.0, 1.0])
    step = expm(A * scale / scale[:, None] / RATE)
    states = [np.array([offset / STIFFNESS, 0.0, 0.0, 0.0, 1.0, 1.0]) / scale]
    for _ in range(COUNT - 1):
        states.append(step @ states[-1])
    x, _, v, sine, _, _ = (np.array(states) * scale).T
    true = {"force": offset + amplitude * sine, "displacement": x, "voltage": v, "current": v / load}
    noisy = {COLUMNS[name]: value + NOISE.get(name, 0.0) * rng.standard_normal(COUNT) for name, value in true.items()}
    return {"time_s": np.arange(COUNT) / RATE, **noisy}


def campaign(nominal, rng):
    records = [{"data": shown(*drive, rng), "load_resistance": drive[-1]} for drive in DRIVES]
    return Campaign.from_arrays(nominal, records)


def test_nominal_mass_and_damping_are_kept_where_the_records_do_not_contradict_them():
    found = identify(campaign(NOMINAL, np.random.default_rng(2)))
    device = found.transducer
    assert not device.quasi_static
    assert (device.mass, device.damping) == (NOMINAL.mass, NOMINAL.damping)
    told = {estimate.parameter.name: estimate for estimate in found.estimates}
    assert not told["mass"].identifiable
    assert not told["damping"].identifiable
    for name, true in (("stiffness", STIFFNESS), ("coupling", COUPLING), ("capacitance", CAPACITANCE)):
        assert abs(told[name].value - true) < 3.0 * told[name].std


@pytest.mark.parametrize("factor", [3.0, 100.0])
def test_a_nominal_damping_that_they_contradict_is_fitted(factor):
    wrong = replace(NOMINAL, damping=factor * DAMPING)
    told = {each.parameter.name: each for each in identify(campaign(wrong, np.random.default_rng(2))).estimates}
    for name, true in (("damping", DAMPING), ("coupling", COUPLING), ("capacitance", CAPACITANCE)):
        assert abs(told[name].value - true) < 3.0 * told[name].std


def test_a_mode_that_would_ring_from_sample_to_sample_is_left_out():
    ringing = replace(NOMINAL, damping=1e-3 * DAMPING)
    assert identify(campaign(ringing, np.random.default_rng(7))).campaign.transducer.quasi_static


def test_a_fit_with_states_that_begin_anywhere_is_held_against_the_quasi_static_specimen():
    """A branch of the electrodes may be charged when a record begins: its start is one more value of the record."""
    before = identify(campaign(NOMINAL, np.random.default_rng(2)))
    fitted, device = before.campaign, before.campaign.transducer
    problem = Problem(prepared(fitted, "fit"), device, before.offsets)
    branch = DielectricRelaxation(capacitance=1e-13, time_constant=0.1)  # too small to be seen
    model = replace(
        before.found.model, transducer=replace(before.found.model.transducer, effects=(branch,)), at_rest=False
    )
    nuisance = nuisance_for_model(problem, before.found.model, before.found.nuisance, model)
    assert sum(map(len, nuisance)) > sum(map(len, before.found.nuisance))
    found = fit(problem, model, nuisance, before.found.noise, estimate_noise=False)
    still = as_quasi_static(device)
    quasi_static = Problem(prepared(replace(fitted, transducer=still), "fit"), still, before.offsets)
    assert not is_better_left_out(problem, quasi_static, found)
