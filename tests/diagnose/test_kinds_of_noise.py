"""Campaigns of a SciPy simulation with noise as users make or have it: nothing is found where nothing is missing."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import butter, lfilter
from sweeps import linear_sweep

from piezoharvest import Campaign
from piezoharvest.diagnose import diagnose

TRUE = {"mass": 0.0123, "damping": 0.21, "stiffness": 4200.0, "coupling": 2.1e-3, "capacitance": 62e-9}
NOMINAL = {"mass": 0.0123, "damping": 0.23, "stiffness": 4284.0, "coupling": 2.04e-3, "capacitance": 60e-9}
RATE, DURATION, LOAD = 4000.0, 1.5, 150e3  # Hz, s, ohm
SWEEPS = [(40.0, 160.0), (60.0, 130.0), (160.0, 50.0)]  # Hz


def motion(amplitude, sweep, leakage=np.inf, cubic=0.0):
    """Force, displacement and voltage by an explicit Runge-Kutta method of order 8."""
    m, b, k, coupling, c = TRUE.values()
    time, ohm = np.arange(round(RATE * DURATION)) / RATE, 1.0 / (1.0 / LOAD + 1.0 / leakage)
    shape = linear_sweep(sweep[0], DURATION, sweep[1])

    def force(t):
        return amplitude * shape(t)

    def rates(t, y):
        x, v, u = y
        return [v, (force(t) - b * v - k * x - cubic * x**3 + coupling * u) / m, (-coupling * v - u / ohm) / c]

    options = {"method": "DOP853", "rtol": 1e-9, "atol": [1e-12, 1e-10, 1e-8], "max_step": 1e-3}
    x, _, u = solve_ivp(rates, (0.0, DURATION), [0, 0, 0], t_eval=time, **options).y
    return time, {"force_N": force(time), "displacement_m": x, "voltage_V": u}


def noisy(values, share, rng, kind):
    """Values with noise of a share of their own standard deviation."""
    size, white = share * values.std(), rng.standard_normal(len(values))
    if kind == "none":
        return values
    if kind == "low-pass":
        slow = lfilter(*butter(4, 0.4), white)
        return values + size * slow / slow.std()
    if kind == "of the reading":
        return values + share * np.abs(values) * white + 0.1 * size * white[::-1]
    return values + size * white


def campaign(kind, seed, amplitudes=(0.1, 0.5, 0.25), read=lambda voltage: voltage, **faults):
    rng, records = np.random.default_rng(seed), []
    shares = {"force_N": 0.0 if kind == "of the reading" else 1e-3, "displacement_m": 5e-3, "voltage_V": 5e-3}
    for n, (amplitude, sweep) in enumerate(zip(amplitudes, SWEEPS, strict=True)):
        time, exact = motion(amplitude, sweep, **faults)
        exact["voltage_V"] = read(exact["voltage_V"])
        measured = {name: noisy(values, shares[name], rng, kind) for name, values in exact.items()}
        role = "validate" if n == len(amplitudes) - 1 else "fit"
        records.append({"data": {"time_s": time, **measured}, "load_resistance": LOAD, "role": role})
    return Campaign.from_arrays(NOMINAL, records)


KINDS = ["white", "low-pass", "of the reading", "none"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_healthy_campaign_is_adequate_whatever_the_noise_of_its_records(kind):
    """With one noise for all, a law at the capacitor was found, friction without noise, structure behind filters."""
    found = diagnose(campaign(kind, 5))
    assert found.verdict == "adequate", found.effects
    for estimate in found.estimates:
        off = abs(estimate.value - TRUE[estimate.parameter.name])
        assert off < 4.5 * (estimate.std or 0.0) + 2e-5 * estimate.value


@pytest.mark.parametrize("kind", KINDS)
def test_a_stiffening_is_found_beside_any_noise(kind):
    """Straight outputs of elements within a sample had made it 0.3 % too large: 20 standard errors.

    The resonance jumps in the largest record, where a fit from the linear model ended in the other stable motion:
    noise of the reading gave a law without a name, friction, or no answer in minutes.
    """
    found = diagnose(campaign(kind, 6, cubic=3e8))
    assert [each.effect.name for each in found.effects] == ["stiffening"], found.verdict
    true = TRUE | {"cubic_stiffness": 3e8}
    cubic = ("cubic_stiffness", *found.effects[0].values["cubic_stiffness"][:2])
    for name, value, std in [cubic, *((each.parameter.name, each.value, each.std) for each in found.estimates)]:
        assert abs(value - true[name]) < 4.5 * (std or 0.0) + 2e-5 * value, name


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 4))])
def test_a_leakage_is_no_creep_where_records_have_their_own_noise(seed):
    """Beside one load it is the same as another load: both are named, with the values of one of them."""
    found = diagnose(campaign("white", 10 + seed, leakage=300e3))
    names = {each.effect.name for each in found.effects} | {name for names in found.alternatives for name in names}
    assert found.verdict in ("effect", "ambiguous")
    assert found.effects[0].effect.name in ("leakage", "load_error"), found.effects
    assert {"leakage", "load_error"} <= names


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_an_amplifier_that_saturates_is_found_though_its_gain_is_all_but_that_of_the_coupling(seed):
    """A table had taken a part of the coupling, from where no curve was near it: the coupling all but vanished."""
    found = diagnose(campaign("white", 20 + seed, read=lambda voltage: 25.0 * np.tanh(voltage / 25.0)))
    assert found.verdict == "new_effect"
    (discovery,) = found.discovery
    law, form = discovery.law, discovery.law.form
    assert (law.place.name, law.place.input) == ("reading.voltage", "voltage")
    assert (form.curve, form.bent) == ("tanh", True)
    assert [form.factor, form.scale] == pytest.approx([25.0, 25.0], rel=2e-3)
    for estimate in found.estimates:
        assert abs(estimate.value - TRUE[estimate.parameter.name]) < 4.5 * (estimate.std or 0.0)


def test_errors_of_a_simulator_are_nothing_that_is_missing():
    """They are not random: as noise of that size, a line of them would be far above all others."""
    line = np.sin(2 * np.pi * 900.0 * np.arange(round(RATE * DURATION)) / RATE)
    found = diagnose(campaign("none", 0, read=lambda voltage: voltage + 6e-6 * np.ptp(voltage) * line))
    assert found.verdict == "adequate"
