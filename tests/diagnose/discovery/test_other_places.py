"""Small known effects are held against laws at other places: what these make as likely, or likelier, is not certain."""

import pytest

from piezoharvest.description.effects import registered
from piezoharvest.description.effects.base import Effect
from reports.discovery import trials
from reports.discovery.campaigns import Trial


@pytest.mark.parametrize("name", [n for n, cls in registered().items() if ".effects.circuit." not in cls.__module__])
def test_each_effect_that_any_record_may_show_has_a_place(name):
    cls = registered()[name]
    assert cls.places or cls.acts_at is not Effect.acts_at


def answer(law, place, sigma, seed):
    """What a diagnosis says of a small law that is in no library, in data of SciPy."""
    result = trials.attempt(Trial("law", law, place, sigma, seed))
    assert "error" not in result
    return result


@pytest.mark.slow
def test_a_small_law_is_not_taken_for_hum():
    # Three of its lines are multiples of the drive's, which hum takes in.
    found = answer("fifth", "damper", 15.0, 1010025)
    assert (found["verdict"], found["outcome"]) == ("new_effect", "right")


@pytest.mark.slow
def test_a_small_law_of_a_sensor_is_not_told_from_an_error_of_the_load():
    found = answer("langevin", "reading", 8.0, 1000053)
    assert (found["verdict"], found["effects"]) == ("ambiguous", ["load_error"])
    assert ["reading.current table"] in found["alternatives"]
