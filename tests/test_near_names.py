"""Names that a misspelt one is likely to mean."""

import pytest

from piezoharvest.cli import main
from piezoharvest.description.catalogue import materials
from piezoharvest.description.catalogue.parts import parts, with_parts
from piezoharvest.description.figures import data_sheet
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import Rectifier, registered
from piezoharvest.near_names import did_you_mean, near_names
from piezoharvest.study import build_transducer
from piezoharvest.study.words import shortened


@pytest.mark.parametrize(
    ("given", "known", "meant"),
    [
        ("SSHI", ["parallel_sshi", "series_sshi", "sshc", "resistor"], ["series_sshi", "parallel_sshi"]),
        ("power", ["harvested_power", "efficiency", "mechanical_power"], ["harvested_power", "mechanical_power"]),
        ("maas", ["mass", "damping"], ["mass"]),
        ("Series-RL", ["series_rl", "series_rlc"], ["series_rl"]),
        ("x", ["maximum", "max"], []),
        (None, ["none"], []),
    ],
)
def test_what_is_likely_meant(given, known, meant):
    assert near_names(given, known) == meant


def test_several_names_are_offered_in_one_question():
    assert did_you_mean("SSHI", ["parallel_sshi", "series_sshi"]) == " (did you mean 'series_sshi' or 'parallel_sshi'?)"
    assert did_you_mean("resistor", ["bridge"]) == ""


@pytest.mark.parametrize("kind", sorted(registered()))
def test_each_kind_of_circuit_is_found_by_a_slip(kind):
    assert near_names(kind.upper() + "x", registered())[0].startswith(kind[:4])


def test_diodes_and_materials_are_suggested():
    with pytest.raises(ParameterError, match=r"diode: found 'bat54' \(did you mean 'BAT54'\?\), allowed are"):
        with_parts({"diode": "bat54"}, Rectifier)
    with pytest.raises(ParameterError, match=r"diode: found \['BAT54'\], allowed are"):
        with_parts({"diode": ["BAT54"]}, Rectifier)
    with pytest.raises(ParameterError, match=r"material: found 'pzt5a'.*allowed are"):
        data_sheet({"material": "pzt5a"})
    assert near_names("pzt 5a", materials()) == ["PZT-5A"]
    assert near_names("1N41", parts("diode")) == ["1N4148"]


@pytest.mark.parametrize("text", ["a list of words, " * 60, "word" * 200, "x" * 310 + " " + "y" * 300])
def test_a_long_message_is_cut_between_words(text):
    short = shortened(text)
    head, _, tail = short.partition(" ... ")
    assert len(short) <= 450 and text.startswith(head) and text.endswith(tail)
    if " " in text[:300]:
        assert text[len(head)] == " " == text[-len(tail) - 1]


def test_an_unknown_name_of_the_catalogue(capsys):
    with pytest.raises(ParameterError, match=r"'NAC2023'\?\), must be a name that `piezoharvest catalogue` lists"):
        build_transducer({"catalogue": "NAC2024"})
    assert main(["catalogue", "bat5"]) == 2
    assert "(did you mean 'BAT54'?), must be a name that" in capsys.readouterr().err


def test_a_misspelt_figure_of_a_data_sheet_is_named():
    with pytest.raises(ParameterError, match=r"datasheet\.free_strok: unknown key \(did you mean 'free_stroke'\?\)"):
        build_transducer({"datasheet": {"free_strok": 1e-6}})
    with pytest.raises(ParameterError, match=r"datasheet: missing key, one of blocking_force"):
        build_transducer({"datasheet": {}})
