"""Changes that come at once: an offset that comes on in each record, a glue joint that cracks within a campaign."""

import numpy as np
import pytest
from diagnose.swept import DURATION, RATE, campaign
from hypothesis import given, settings
from hypothesis import strategies as st

from piezoharvest.description.effects.nameless.shapes import Bump, StepChange
from piezoharvest.diagnose import diagnose

OFFSET, AT, WIDTH = -0.4, 0.8, 0.02  # V; s into a record of 1.5 s


def switched_on(voltage):
    time = np.arange(round(RATE * DURATION)) / RATE
    return voltage + OFFSET * 0.5 * (1.0 + np.tanh((time - AT) / WIDTH))


@pytest.mark.parametrize("seed", [7, pytest.param(8, marks=pytest.mark.slow)])
def test_an_offset_that_comes_on(seed):
    """A table with a corner in each tenth of a record made a ramp of it, which unseen records denied."""
    found = diagnose(campaign("white", seed, read=switched_on))
    assert found.verdict == "new_effect", (found.verdict, found.effects)
    (discovery,) = found.discovery
    law = discovery.law
    assert (law.place.name, law.place.input) == ("reading.voltage", "time")
    assert isinstance(law.form, StepChange)
    assert law.form.factor == pytest.approx(OFFSET, rel=0.03)
    assert law.form.at == pytest.approx(AT, rel=2e-3)
    assert law.form.width == pytest.approx(WIDTH, rel=0.2)
    assert discovery.gain > 0.95


def test_a_disturbance_that_comes_and_goes():
    """A lamp that warmed the sensor for a while: a table of a tenth of a record says little of other records' times."""

    def warmed(voltage):
        time = np.arange(round(RATE * DURATION)) / RATE
        return voltage + OFFSET * np.exp(-(((time - AT) / 0.2) ** 2))

    found = diagnose(campaign("white", 7, read=warmed))
    assert found.verdict == "new_effect", (found.verdict, found.effects)
    (discovery,) = found.discovery
    law = discovery.law
    assert (law.place.name, law.place.input) == ("reading.voltage", "time")
    assert isinstance(law.form, Bump)
    assert (law.form.factor, law.form.at, law.form.width) == (
        pytest.approx(OFFSET, rel=0.03), pytest.approx(AT, rel=0.01), pytest.approx(0.2, rel=0.03),
    )  # fmt: skip
    assert discovery.gain > 0.95


@settings(deadline=None)
@given(st.floats(-3.0, 3.0), st.floats(0.1, 0.9), st.floats(1e-4, 0.3))
def test_a_step_is_zero_at_zero_and_comes_where_it_is_said(factor, at, width):
    step = StepChange(factor=factor, at=at, width=width)
    zero, half, end = step.values(np.array([0.0, at, at + 20.0 * width]))
    assert zero == pytest.approx(0.0, abs=1e-12)
    assert end - half == pytest.approx(0.5 * factor, rel=1e-9, abs=1e-12)
