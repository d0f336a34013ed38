"""Springs without a name whose resonance has two motions under large drives: found as under small ones."""

import numpy as np
import pytest
from diagnose.swept import TRUE
from diagnose.swept import campaign as campaign_of

from piezoharvest import identify
from piezoharvest.description.effects.nameless.forms import TwoKnees
from piezoharvest.diagnose import diagnose
from piezoharvest.diagnose.discovery.growing_search import search_growing
from piezoharvest.identify.fitting.output_error import mean_square
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.preparation import prepared


def campaign(*args, **options):
    return campaign_of(*args, duration=1.5, **options)  # s, so long that small drives tell more than one bend


def found_in(seed, spring, amplitudes=(0.1, 0.5, 0.25)):
    """The form of the only law that a diagnosis finds; with the stiffness beside it, it is the spring's force."""
    found = diagnose(campaign("white", seed, amplitudes, spring=spring))
    assert found.verdict == "new_effect", (found.verdict, found.effects)
    (discovery,) = found.discovery
    assert (discovery.law.place.name, discovery.law.place.input) == ("spring", "displacement")
    assert discovery.gain > 0.95
    values = {each.parameter.name: each for each in found.estimates}
    for name in set(TRUE) - {"stiffness"}:  # a straight line of the law is a part of it
        assert abs(values[name].value - TRUE[name]) < 4.5 * values[name].std, name
    x = np.linspace(-1e-3, 1e-3, 101)
    wanted = TRUE["stiffness"] * x + spring(x)
    force = values["stiffness"].value * x + discovery.law.form.values(x)
    assert force == pytest.approx(wanted, abs=1e-3 * np.abs(wanted).max())
    return discovery.law.form


def saturating(x):
    return 0.6 * np.tanh(x / 4e-4)


@pytest.mark.recovery_long
def test_what_small_drives_show_is_fitted_to_all_records():
    """0.6 N tanh(x/0.4 mm): the model without it was in the other motion, and a table at the capacitor did best."""
    before = identify(campaign("white", 1, spring=saturating))
    problem = Problem(prepared(before.campaign, "fit"), before.campaign.transducer, before.offsets)
    found = search_growing(problem, before.found, lambda text: None)
    assert found is not None
    law = found.best.law
    assert (law.place.name, law.form.curve) == ("spring", "tanh")
    assert [law.form.factor, law.form.scale] == pytest.approx([0.6, 4e-4], rel=5e-3)
    assert mean_square(found.final) < 1.2
    assert search_growing(of_largest(problem), before.found, lambda text: None) is None  # no smaller drives


def of_largest(problem):
    """The problem with the record of the largest drive alone."""
    return Problem(problem.data[1:], problem.nominal, problem.offset_channels)


@pytest.mark.slow
def test_two_end_stops_that_are_not_alike():
    def stops(x):
        return 900.0 * np.maximum(x - 2e-4, 0.0) + 300.0 * np.minimum(x + 1.2e-4, 0.0)

    form = found_in(1, stops, (0.1, 0.3, 0.2))
    assert isinstance(form, TwoKnees)
    assert [form.factor, form.second] == pytest.approx([900.0, 300.0], rel=2e-3)
    assert [form.upper, form.lower] == pytest.approx([2e-4, -1.2e-4], rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_spring_that_saturates(seed):
    form = found_in(seed, saturating)
    assert (form.curve, form.bent) == ("tanh", True)
    assert [form.factor, form.scale] == pytest.approx([0.6, 4e-4], rel=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_spring_that_hardens_exponentially(seed):
    """Where drives are small it is any of seven formulas: all of them are fitted to all records."""
    form = found_in(seed, lambda x: 0.84 * np.sinh(x / 8e-4))
    assert (form.curve, form.bent) == ("sinh", True)
    assert [form.factor, form.scale] == pytest.approx([0.84, 8e-4], rel=1e-2)


@pytest.mark.slow
def test_a_spring_that_softens_with_the_square():
    assert found_in(1, lambda x: -1.2e6 * x * np.abs(x)).exponent == pytest.approx(2.0, abs=0.05)


def test_a_named_spring_keeps_its_name_beside_a_law():
    """It explains all but a little, and without it no law of a reading can be fitted."""
    found = diagnose(
        campaign_of(
            "white", 1, duration=0.4, spring=lambda x: 3e8 * x**3,
            read=lambda voltage: voltage + 0.3 * np.sin(2.0 * np.pi * voltage / 90.0),
        )
    )  # fmt: skip
    assert found.verdict == "new_effect", found.verdict
    (named,), (discovery,) = found.effects, found.discovery
    assert named.effect.name == "stiffening"
    assert named.effect.cubic_stiffness == pytest.approx(3e8, rel=0.01)
    assert (discovery.law.place.name, discovery.law.place.input) == ("reading.voltage", "voltage")
    assert discovery.gain > 0.95
