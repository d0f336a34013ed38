"""Parts by name: what a study gets from data sheets, and what it is told where there is no such part."""

import math
from pathlib import Path

import pytest
from messages import is_sentence
from studies import BENCH, DRIVE

from piezoharvest import simulate
from piezoharvest.cli import main
from piezoharvest.description.catalogue.parts import SORTS, UNITS, parts
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import registered
from piezoharvest.description.system import System
from piezoharvest.study import build_shunt
from piezoharvest.study.studies import study_from

EVERY = [(sort, name) for sort in SORTS for name in parts(sort)]
SIDE = {"capacitor": "TAJB106K016", "load_resistance": 5e5}
BOUGHT = {"coil": "SDR0503-103JL", "switch": "2N7002W", "comparator": "MCP6541"}


def study(*shunts, **transducer):
    table = {"transducer": {**BENCH, **transducer}, "excitation": {"kind": "sine_force", **DRIVE}, "shunts": [*shunts]}
    return study_from(table, Path("study.toml"))


@pytest.mark.parametrize(("sort", "name"), EVERY)
def test_every_part_says_where_it_is_from(sort, name):
    part = parts(sort)[name]
    assert len(part["source"]) > 20
    assert part["note"]
    assert set(part) - {"source", "note"} <= set(UNITS)
    assert all(value > 0 for key, value in part.items() if key in UNITS)


def test_names_are_of_one_part():
    assert len({name for _, name in EVERY}) == len(EVERY)
    assert all(len(parts(sort)) >= 4 for sort in SORTS)


def test_a_circuit_of_bought_parts():
    (shunt,) = study({"kind": "parallel_sshi", **BOUGHT, **SIDE, "comparator_supply": 2.0}).shunts
    coil = parts("coil")["SDR0503-103JL"]
    assert (shunt.inductance, shunt.self_resonance) == (10e-3, 1e6)
    assert shunt.quality == pytest.approx(math.sqrt(10e-3 / BENCH["capacitance"]) / coil["winding_resistance"])
    assert shunt.real_coil(BENCH["capacitance"]).resistance == pytest.approx(110.0, rel=1e-12)
    # Two transistors with opposite body diodes, each with 0.7 nC at 4.5 V.
    assert shunt.switch_resistance == pytest.approx(2 * 1.33)
    assert shunt.gate_energy == pytest.approx(2 * 0.7e-9 * 4.5)
    assert (shunt.time_lag, shunt.control_power) == (4e-6, pytest.approx(1.2e-6))
    assert (shunt.smoothing_capacitance, shunt.smoothing_resistance) == (10e-6, 2.8)
    assert shunt.dc_leakage == pytest.approx(1.6e-6 / 16.0)


def test_a_coil_at_further_electrodes_has_their_capacitance():
    electrodes = [{"capacitance": 90e-9, "coupling": [6e-4]}]
    ssdi = {"kind": "ssdi", "electrode": 1, **BOUGHT}
    (shunt,) = study(ssdi, electrodes=electrodes).shunts
    assert shunt.quality == pytest.approx(math.sqrt(10e-3 / 90e-9) / 110.0)


def test_a_coil_of_a_linear_circuit_keeps_its_resistance():
    shunt = build_shunt({"kind": "series_rl", "resistance": 1e4, "coil": "SDR0503-153JL"})
    assert (shunt.inductance, shunt.winding_resistance, shunt.self_resonance) == (15e-3, 168.0, 1e6)


def test_capacitors_in_series_leak_less():
    one, two = (build_shunt({"kind": kind, **SIDE}) for kind in ("rectifier", "doubler"))
    assert two.dc_leakage == pytest.approx(0.5 * one.dc_leakage)


@pytest.mark.parametrize("name", parts("coil"))
def test_every_coil_can_be_simulated(name):
    """A few pF behind some ohm, 1e9 times faster than the period."""
    found = study({"kind": "parallel_sshi", **BOUGHT, "coil": name, **SIDE, "diode": "BAT54"})
    response = simulate(System(found.transducer, found.shunts[0]), found.excitation)
    assert response.converged
    assert abs(response.energy["closure"]) < 1e-10
    assert response.harvested_power > 0


@pytest.mark.parametrize(
    ("table", "key"),
    [
        ({"kind": "ssdi", "coil": "SDR0503-103JL"}, "switch"),
        ({"kind": "ssdi", "coil": "SDR0503-103JL", "switch": "2N7002W"}, "coil"),  # of an unknown capacitance
        ({"kind": "ssdi", "coil": "SDR0503-103KL"}, "coil"),
        ({"kind": "resistor", "resistance": 1.0, "coil": "SDR0503-103JL"}, "coil"),
        ({"kind": "series_rl", "resistance": 1.0, "coil": "SDR0503-103JL", "inductance": 1.0}, "inductance"),
        ({"kind": "rectifier", "switch": "2N7002W", **SIDE}, "switch"),
        ({"kind": "rectifier", "capacitor": 7, "load_resistance": 1.0}, "capacitor"),
        ({"kind": "rectifier", **SIDE, "dc_leakage": 1e-9}, "dc_leakage"),
        ({"kind": "rectifier", **SIDE, "comparator": "MCP6541"}, "comparator"),
        ({"kind": "sece", "comparator": "MCP6541", "time_lag": 1e-6}, "time_lag"),
        ({"kind": "sece", "comparator": "MCP6541", "comparator_supply": 0.0}, "comparator_supply"),
        ({"kind": "sece", "comparator_supply": 3.0}, "comparator_supply"),
    ],
)
def test_a_part_that_cannot_be_is_told(table, key):
    with pytest.raises(ParameterError) as caught:
        build_shunt(table)
    assert caught.value.key == f"shunt.{key}"
    assert is_sentence(caught.value.message)


@pytest.mark.parametrize(
    ("kind", "wrong", "name", "right"),
    [
        ("rectifier", "smoothing_capacitance", "TAJB106K016", "capacitor"),
        ("rectifier", "diodes", "BAT54", "diode"),
        ("rectifier", "diode_drop", "BAT54", "diode"),
        ("parallel_sshi", "inductance", "SDR0503-103JL", "coil"),
        ("sece", "mosfet", "2N7002W", "switch"),
    ],
)
def test_the_key_that_names_a_part_is_told(kind, wrong, name, right):
    with pytest.raises(ParameterError, match=f"{right} = '{name}' names it") as caught:
        build_shunt({"kind": kind, wrong: name})
    assert caught.value.key == f"shunt.{wrong}"
    assert is_sentence(caught.value.message)


def test_keys_that_describe_another_part_are_told():
    with pytest.raises(ParameterError, match=r"found '10 uF'.*another one is described by smoothing_capacitance"):
        build_shunt({"kind": "rectifier", "capacitor": "10 uF", "load_resistance": 1.0})
    with pytest.raises(ParameterError, match=r"unknown key \(did you mean 'diode'\?\), known keys are capacitor"):
        build_shunt({"kind": "rectifier", "diodes": "1N5822", **SIDE})


def test_a_coil_that_does_not_swing_is_told():
    with pytest.raises(ParameterError, match="do not swing") as caught:
        study({"kind": "ssdi", **BOUGHT}, capacitance=5e-6)
    assert caught.value.key == "shunts.0.coil"
    assert is_sentence(caught.value.message)


def test_some_kind_has_each_sort():
    for sort in SORTS.values():
        having = [cls for cls in registered().values() if set(sort.needed) & set(cls.__dataclass_fields__)]
        assert len(having) > 3


def test_the_command_lists_parts_and_shows_one(capsys):
    assert main(["catalogue"]) == 0
    listed = capsys.readouterr().out
    assert [name for _, name in EVERY if f" {name} " not in listed] == []
    assert main(["catalogue", "2N7002W"]) == 0
    shown = capsys.readouterr().out
    assert f"source: {parts('switch')['2N7002W']['source']}" in shown
    assert "1.330 ohm" in shown
