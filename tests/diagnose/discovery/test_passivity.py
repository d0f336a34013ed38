"""Energy tells a port from a sensor: what gives energy is no law of a port, however well it fits."""

from types import SimpleNamespace

import numpy as np
import pytest
from nameless import Drive, Laws, nameless_campaign
from remembering import searched

from piezoharvest.description.effects.nameless.circuit_places import Diode, SwitchLoop
from piezoharvest.description.effects.nameless.forms import Corners
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import Play, Relaxation
from piezoharvest.description.effects.nameless.places import Capacitor, Damper, Electrodes, Load, Reading, Spring
from piezoharvest.diagnose.discovery.passivity import _distance, price_of_passivity


def table(place, kinks, knots=(1.0, -1.0), information=None, visited=(-2.0, 2.0), memory=None):
    """A fitted table, with the information of its kinks and no prior."""
    inside = np.eye(len(kinks)) * 4.0 if information is None else information
    form = Corners(knots=knots, kinks=kinks)
    return SimpleNamespace(
        law=Law(place=place, form=form, memory=memory), place=place, form=form, visited=np.linspace(*visited, 11),
        tabled=[0, 1],
        normal=(inside, inside @ np.array(kinks)), found=SimpleNamespace(prior=np.zeros((2, 2))),
    )  # fmt: skip


@pytest.mark.parametrize("place", [Load(), Electrodes(), Damper()])
def test_a_law_that_takes_energy_costs_nothing(place):
    assert price_of_passivity(table(place, (0.5, -0.5)), 0.0, 0.0) == 0.0


def test_a_law_that_gives_energy_costs_what_its_kinks_are_away_from_none():
    # The closest table without energy has no kinks: 4 k^2 for each of two.
    assert price_of_passivity(table(Load(), (-0.5, 0.5)), 0.0, 0.0) == pytest.approx(2.0, rel=1e-6)
    # Beside a conductance of 0.2 at 2 V it may take 0.4 of the 0.5 back: kinks of 0.4 remain.
    assert price_of_passivity(table(Load(), (-0.5, 0.5)), 0.0, 0.2) == pytest.approx(2 * 4 * 0.1**2, rel=1e-6)
    assert price_of_passivity(table(Load(), (-0.5, 0.5)), 0.0, 0.3) == 0.0


def test_springs_and_sensors_may_have_any_law():
    assert price_of_passivity(table(Spring(), (-0.5, 0.5)), 0.0, 0.0) == 0.0
    assert price_of_passivity(table(Reading("current", "current"), (-0.5, 0.5)), 0.0, 0.0) == 0.0


def test_diodes_and_a_loop_may_take_back_what_the_label_says():
    """Of two amperes' worth of voltage: a diode has its drop at any current, a loop what goes with the current."""
    falling = {"kinks": (-0.5, 0.0), "knots": (1.0, 1.5)}
    for place, own in ((Diode(reach=2.0), (0.5, 0.0)), (SwitchLoop(reach=2.0), (0.0, 0.25))):
        assert price_of_passivity(table(place, **falling, visited=(0.0, 2.0)), *own) == 0.0
        assert price_of_passivity(table(place, **falling, visited=(0.0, 2.0)), 0.0, 0.0) > 0.9


STOP = Play(threshold=2.0)


@pytest.mark.parametrize(
    ("place", "memory", "kinks", "free"),
    [
        # A force over what a Maxwell element's spring is behind by is against it.
        (Spring(), Relaxation(time_constant=1.0, behind=True), (-0.5, 0.5), True),
        (Spring(), Relaxation(time_constant=1.0, behind=True), (0.5, -0.5), False),
        # A charge over a lagging voltage rises.
        (Capacitor(), Relaxation(time_constant=1.0), (0.5, -0.5), True),
        (Capacitor(), Relaxation(time_constant=1.0), (-0.5, 0.5), False),
        (Electrodes(), Relaxation(time_constant=1.0), (0.5, -0.5), True),
        (Electrodes(), Relaxation(time_constant=1.0), (-0.5, 0.5), False),
        # Of a stop only the ends matter.
        (Spring(), STOP, (0.5, -0.5), True),
        (Spring(), STOP, (-0.5, 0.5), False),
    ],
)
def test_a_function_of_a_memory_costs_something_where_it_gives_energy(place, memory, kinks, free):
    price = price_of_passivity(table(place, kinks, memory=memory), 0.0, 0.0)
    assert price == 0.0 if free else price == pytest.approx(2.0, rel=1e-6)


def test_within_a_stop_a_function_of_it_may_have_any_sign():
    falling_first = {"kinks": (-0.5, 3.0), "knots": (0.0, 1.0), "visited": (0.0, 2.0)}
    assert price_of_passivity(table(Spring(), **falling_first, memory=STOP), 0.0, 0.0) == 0.0
    relaxing = Relaxation(time_constant=1.0)
    assert price_of_passivity(table(Electrodes(), **falling_first, memory=relaxing), 0.0, 0.0) > 0.1


@pytest.mark.slow
def test_a_reading_that_turns_back_is_not_named_a_law_of_the_load(tmp_path):
    """A current sensor falls, beyond a level, three times as fast as it should rise: no load does so."""
    level = 2.2e-5
    records = [
        (Drive((450.0,), (4.0,), 550.0), 97780.0),
        (Drive((300.0, 150.0), (3.0, 7.3), 500.0), 97780.0),
        (Drive((350.0,), (5.0,), 450.0), 97780.0),
    ]

    def turns_back(true):
        i = true["current"]
        return -4.0 * np.sign(i) * np.maximum(np.abs(i) - level, 0.0)

    laws = Laws(reading={"current": turns_back})
    found = searched(nameless_campaign(tmp_path, "stack", laws, records, rate=400.0, duration=1.0))
    assert found.best.place.name == "reading.current"
    assert not {"load", "electrodes"} & {rival.place.name for rival in found.close}


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e9])
def test_the_price_of_passivity_scales_with_the_squares(size):
    """A table that was 1e9 standard errors from a passive one ended a diagnosis with an error of the solver."""
    rng = np.random.default_rng(3)
    root, found, power = rng.standard_normal((6, 6)), rng.standard_normal(6), rng.standard_normal((40, 6))
    power[:20] = -found / np.linalg.norm(found) + 0.1 * power[:20]  # far from what gives no energy
    price = _distance(size * root, found, power, np.full(40, 1e-3))
    assert price == pytest.approx(size**2 * _distance(root, found, power, np.full(40, 1e-3)), rel=1e-5)
    assert 0.0 < price <= size**2 * np.sum((root @ found) ** 2)
