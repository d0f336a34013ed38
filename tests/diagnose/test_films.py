"""Films and other quasi-static specimens: no verdict depends on a mass and a damping that nobody can know."""

import films
import pytest
from selection import with_slow

from piezoharvest.description.effects import BiasCurrent, Leakage
from piezoharvest.diagnose import diagnose
from piezoharvest.diagnose.preparation.voltage_offset import voltage_is_off
from piezoharvest.diagnose.summary import sentence
from piezoharvest.records import load_campaign

METER = 1.0e6  # ohm
# A hundredth and a hundred times what would be 50 kHz and a time constant of 10 us; and a ringing resonance.
NOMINAL = [
    'mass = "unknown"\ndamping = "unknown"',
    "quasi_static = true",
    "mass = 1e-8\ndamping = 100.0",
    "mass = 1e-4\ndamping = 0.01",
    "mass = 1e-3\ndamping = 1.0",
]


@pytest.mark.parametrize(
    ("nominal", "kind"),
    with_slow(
        [(NOMINAL[0], "impacts"), (NOMINAL[2], "sine"), (NOMINAL[3], "random"), (NOMINAL[4], "impacts")],
        slow=lambda nominal, kind: kind != "sine",
    ),
)
def test_a_meter_across_a_film_is_a_leakage_whatever_mass_and_damping_are_said_to_be(nominal, kind, tmp_path):
    told = diagnose(load_campaign(films.write(tmp_path, nominal, kind=kind, leakage=METER)))
    assert told.verdict == "effect"
    (named,) = told.effects
    assert named.effect.name == "leakage"
    value, std, _ = named.values["resistance"]
    assert abs(value - METER) < 4.0 * std < 0.2 * METER
    assert named.gain > 0.95


@pytest.mark.parametrize(
    ("nominal", "kind"),
    with_slow(
        zip(NOMINAL, ["sine", "impacts", "random", "sine", "random"], strict=True),
        slow=lambda nominal, kind: kind == "random" or nominal == NOMINAL[3],
    ),
)
def test_nothing_is_missing_where_nothing_is(nominal, kind, tmp_path):
    told = diagnose(load_campaign(films.write(tmp_path, nominal, kind=kind, seed=1)))
    assert told.verdict == "adequate"
    assert told.effects == ()
    inert = [estimate for estimate in told.estimates if estimate.parameter.name in ("mass", "damping")]
    assert not any(estimate.identifiable for estimate in inert)
    assert bool(inert) == ("mass = 1" in nominal)  # what the file does not tell is no parameter


@pytest.mark.slow
def test_a_coarse_meter_is_no_effect(tmp_path):
    told = diagnose(load_campaign(films.write(tmp_path, NOMINAL[0], bits=9, leakage=METER)))
    assert [named.effect.name for named in told.effects] == ["leakage"]


def test_the_zero_of_a_meter_is_no_current(tmp_path):
    """A mean that is larger on a smaller resistor: no current into the node does that."""
    off = (-0.03, -0.02, -0.01, -0.02)
    measured = load_campaign(films.write(tmp_path, NOMINAL[0], leakage=METER, offsets=off))
    assert voltage_is_off(measured)
    told = diagnose(measured, library=[Leakage, BiasCurrent])
    assert [named.effect.name for named in told.effects] == ["leakage"]
    assert told.before.offsets == ("displacement", "voltage")


@pytest.mark.slow
def test_a_current_into_the_node_is_no_zero_of_the_meter(tmp_path):
    current = 1e-8
    off = tuple(current / (1.0 / load + 1.0 / METER) for load in films.LOADS)
    measured = load_campaign(films.write(tmp_path, NOMINAL[0], leakage=METER, offsets=off))
    assert not voltage_is_off(measured)
    told = diagnose(measured, library=[Leakage, BiasCurrent])
    assert {named.effect.name for named in told.effects} == {"leakage", "bias_current"}


def test_effects_that_a_campaign_names_are_no_finding(tmp_path):
    table = f"{NOMINAL[0]}\neffects = {{ leakage = {{ resistance = {METER} }} }}"
    measured = load_campaign(films.write(tmp_path, table, leakage=METER))
    told = diagnose(measured)
    assert told.verdict == "adequate"
    assert told.effects == ()
    assert "Nothing is missing" in sentence(told)
