"""Campaigns of a SciPy simulation with noise as users make or have it: nothing is found where nothing is missing."""

import numpy as np
import pytest
from diagnose.swept import DURATION, RATE, TRUE, campaign

from piezoharvest.diagnose import diagnose

KINDS = ["white", "low-pass", "of the reading", "none"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_healthy_campaign_is_adequate_whatever_the_noise_of_its_records(kind):
    """With one noise for all, a law at the capacitor was found, friction without noise, structure behind filters."""
    found = diagnose(campaign(kind, 5))
    assert found.verdict == "adequate", found.effects
    for estimate in found.estimates:
        off = abs(estimate.value - TRUE[estimate.parameter.name])
        assert off < 4.5 * (estimate.std or 0.0) + 2e-5 * estimate.value


def hardening(x):
    return 3e8 * x**3


# In half a second the search goes from small drives on, too, in a third of the time.
CASES = [
    *((kind, DURATION) for kind in KINDS if kind != "of the reading"),
    pytest.param("of the reading", 0.5, marks=pytest.mark.recovery_long),
    pytest.param("of the reading", DURATION, marks=pytest.mark.slow),
]


@pytest.mark.parametrize(("kind", "duration"), CASES)
def test_a_stiffening_is_found_beside_any_noise(kind, duration):
    """Straight outputs of elements within a sample had made it 0.3 % too large: 20 standard errors.

    The resonance jumps in the largest record, where a fit from the linear model ended in the other stable motion:
    noise of the reading gave a law without a name, friction, or no answer in minutes.
    """
    found = diagnose(campaign(kind, 6, spring=hardening, duration=duration))
    assert [each.effect.name for each in found.effects] == ["stiffening"], found.verdict
    true = TRUE | {"cubic_stiffness": 3e8}
    cubic = ("cubic_stiffness", *found.effects[0].values["cubic_stiffness"][:2])
    for name, value, std in [cubic, *((each.parameter.name, each.value, each.std) for each in found.estimates)]:
        assert abs(value - true[name]) < 4.5 * (std or 0.0) + 2e-5 * value, name


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 4))])
def test_a_leakage_is_no_creep_where_records_have_their_own_noise(seed):
    """Beside one load it is the same as another load: both are named, with the values of one of them."""
    found = diagnose(campaign("white", 10 + seed, leakage=300e3, duration=1.5))
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
