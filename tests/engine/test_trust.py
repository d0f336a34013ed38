"""What a result must obey to be trusted, tried on energies that no engine has made."""

from dataclasses import replace

import numpy as np
import pytest

from piezoharvest import SineForce, System, Transducer, simulate
from piezoharvest.description.shunts import Resistor
from piezoharvest.engine.lowering.lower import lower
from piezoharvest.engine.plausibility import (
    NO_BOUNDS,
    Bounds,
    bounds,
    closure,
    faults,
    uncertainty_message,
    without_rounding,
)

RIGHT = {"mechanical_in": 1.0, "damping": 0.7, "hysteresis": 0.0, "harvested": 0.25, "shunt_loss": 0.05}
MOST = Bounds(supplied=2.0, rounding=0.0)


def wrong(change=0.0, before=10.0, amplitude=1e-4, most=MOST, periodic=True, **energy):
    """Sentences that hold of these energies."""
    found = faults({**RIGHT, **energy}, change, before, amplitude, most, periodic)
    return [sentence for sentence, holds in found.items() if holds]


def test_a_result_that_is_right():
    assert wrong() == []


@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan])
@pytest.mark.parametrize("name", RIGHT)
def test_not_finite(name, value):
    assert "its energies are not finite" in wrong(**{name: value})


def test_what_is_unaccounted_for():
    assert wrong(damping=0.7 + 3e-8) == ["energy does not close"]
    assert wrong(damping=0.7 + 3e-9) == []


def test_a_store_that_fills_is_no_steady_state():
    assert wrong(change=0.3, damping=0.4) == ["the stored energy changes from period to period"]
    assert wrong(change=0.3, damping=0.4, periodic=False) == []


def test_more_than_the_drive_can_give():
    """A motion that has blown up closes its account and repeats itself."""
    grown = {name: 1e12 * value for name, value in RIGHT.items()}
    assert wrong(**grown, before=1e13) == ["more power comes in than the excitation can supply, sum F^2/(2 b)"]
    # A source in the circuit may drive the structure on.
    assert wrong(mechanical_in=3.0, source=1.0, damping=3.7) == []


def test_harvest_within_what_comes_in():
    said = ["the harvested power is negative, or larger than the power that comes in"]
    assert wrong(harvested=-0.1, damping=1.05) == said
    assert wrong(harvested=1.2, bias_current=-0.95, most=NO_BOUNDS) == []  # an effect gives what is missing
    assert wrong(harvested=1.5, damping=0.0, shunt_loss=0.0, change=-0.5, before=0.1, periodic=False) == said


def test_what_is_stored_makes_no_power_certain():
    """Of a preload's 4e12 J, 18 were gained in a period, and 0.4 supplied: that was called a steady state."""
    energy = {"mechanical_in": -0.4, "damping": -0.009, "harvested": 10.0}
    said = wrong(change=18.0, before=3.9e12, **energy)
    assert "energy does not close" in said and "the stored energy changes from period to period" in said
    assert "energy does not close" in wrong(harvested=0.2501, before=1e12)


def test_a_device_without_losses_has_no_power():
    rounding = {"mechanical_in": -2e-22, "damping": 0.0, "hysteresis": 0.0, "harvested": 3e-30, "shunt_loss": 6e-30}
    assert set(without_rounding(rounding, before=1.4e-7).values()) == {0.0}
    assert without_rounding(RIGHT, before=1e13) == RIGHT
    assert without_rounding(rounding, before=0.0) == rounding


def test_no_less_than_nothing_is_harvested():
    assert without_rounding({**RIGHT, "harvested": -1e-12}, 0.0)["harvested"] == 0.0
    assert without_rounding({**RIGHT, "harvested": -3e-7}, 0.0)["harvested"] == 0.0
    assert without_rounding({**RIGHT, "harvested": -1e-5}, 0.0)["harvested"] == -1e-5


def test_a_loss_that_gives():
    assert wrong(damping=-0.1, harvested=1.05, mechanical_in=1.0, before=0.0)[0] == "a loss is negative"


def test_bound_of_the_drive():
    device = Transducer(mass=0.01, damping=0.05, stiffness=1000.0, coupling=1e-3, capacitance=4e-8)
    excitation = SineForce(amplitude=0.3, frequency=50.0)
    system = System(device, Resistor(resistance=1e5))
    most = bounds(device, excitation, lower(system, excitation))
    assert most.supplied == pytest.approx(0.3**2 / (2 * 0.05) / 50.0, rel=1e-12)


def test_many_designs_at_once():
    energy = {name: np.array([value, value]) for name, value in RIGHT.items()}
    energy["damping"][1] += 1e-3
    share, _ = closure(energy, np.zeros(2))
    assert share == pytest.approx([0.0, 1e-3], abs=1e-15)
    found = faults(energy, np.zeros(2), 0.0, np.full(2, 1e-4), MOST, periodic=True)
    assert found["energy does not close"].tolist() == [False, True]


def test_digits_of_a_small_share_are_said():
    assert uncertainty_message(1e-9, off=1e-12).endswith("confirms only 3 of its digits")
    assert uncertainty_message(1e-9, off=1e-8).endswith("confirms none of its digits")
    assert uncertainty_message(-1e-8, off=1e-9).endswith("confirms none of its digits")
    assert uncertainty_message(0.25, off=1e-12) == ""
    assert uncertainty_message(0.0, off=1e-12) == ""


def test_results_are_compared_by_their_values():
    bench = Transducer(mass=0.010, damping=0.0628, stiffness=986.96, coupling=1.0e-3, capacitance=40e-9)
    system = System(bench, Resistor(resistance=97e3))
    drive = SineForce(amplitude=0.02, frequency=50.6)
    one, same = simulate(system, drive), simulate(system, drive)
    assert one == same
    assert one != simulate(system, replace(drive, amplitude=0.03))
    assert one.waveforms != "waveforms"
    assert type(one.attenuation_db) is float
