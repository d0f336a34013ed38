"""Campaigns of several specimens against specimens whose truth is known, in data that no code of the package made."""

import json

import numpy as np
import pytest
from specimen_files import drawn, write

from piezoharvest.cli import main
from piezoharvest.description.effects import Leakage
from piezoharvest.population import diagnose_specimens, identify_specimens
from piezoharvest.records import CampaignError
from piezoharvest.records.specimens import SpecimenSet, load
from piezoharvest.specimen.file import load_specimen

SHORT = 14  # samples, which tell the capacitance to 7 %, where specimens differ by 1 %


def loaded(path):
    found = load(path)
    assert isinstance(found, SpecimenSet)
    return found


def relative(estimate, truth):
    return estimate.value / truth[estimate.parameter.name] - 1.0


def test_the_specimen_with_least_data_borrows_and_one_of_another_kind_is_told(tmp_path):
    rng = np.random.default_rng(5)
    specimens = [drawn(rng, 0.01) for _ in range(5)]
    specimens[2]["capacitance"] *= 4.0
    found = identify_specimens(loaded(write(tmp_path, specimens, [[300]] * 4 + [[SHORT]])))
    assert found.pooled.odd == {2: ("capacitance",)}
    assert "film 3 is of another kind: it differs in capacitance" in found.warnings[0]
    assert found.each[2] is found.alone[2]
    for alone, each in zip(found.alone[4].estimates, found.each[4].estimates, strict=True):
        assert each.std is not None
        assert alone.std is not None
        assert each.std < alone.std
        assert abs(relative(each, specimens[4])) < 3.0 * each.std / each.value
    before, after = ([relative(e, specimens[4]) for e in kind[4].estimates] for kind in (found.alone, found.each))
    assert np.linalg.norm(after) < 0.7 * np.linalg.norm(before)
    kind = found.kind["capacitance"]
    others = np.mean([np.log(specimens[n]["capacitance"]) for n in (0, 1, 3, 4)])
    assert abs(np.log(kind.mean) - others) < 3.0 * kind.std / kind.mean


@pytest.mark.slow
def test_an_effect_is_shared_with_values_of_each_and_one_without_it_is_told(tmp_path, capsys):
    rng = np.random.default_rng(6)
    specimens, leakages = [drawn(rng, 0.01) for _ in range(4)], [3.0e6, 3.3e6, np.inf, 3.1e6]
    path = write(tmp_path, specimens, [[300, 300]] * 3 + [[SHORT]], leakages=leakages)
    found = diagnose_specimens(loaded(path), library=[Leakage])
    assert found.verdict == "effect"
    assert found.form.form == {"leakage"}
    assert [each.alike for each in found.each] == [True, True, False, True]
    assert found.differs(2) == ["leakage"]
    for n in (0, 1, 3):
        value, std, unit = found.each[n].values["leakage.resistance"]
        assert unit == "ohm"
        assert abs(1.0 / value - 1.0 / leakages[n]) < 3.0 * std / value**2
    assert found.gain > 0.99
    paths = found.save(tmp_path / "kind.toml")
    assert [path.name for path in paths] == ["kind.toml", *(f"kind_film_{n}.toml" for n in range(1, 5))]
    kind, one = (load_specimen(path) for path in paths[:2])
    assert kind.errors["capacitance"] > 3.0 * one.errors["capacitance"]  # the spread, not an error of measurement


def test_the_command_prints_specimens_and_population(tmp_path, capsys):
    specimens = [drawn(np.random.default_rng(7), 0.02)] * 2
    path = write(tmp_path, specimens, [[300]] * 2)
    assert main(["identify", str(path), "--json", "--save", str(tmp_path / "kind.toml")]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert [each["name"] for each in printed["specimens"]] == ["film 1", "film 2"]
    row = printed["population"]["capacitance"]
    assert row["unit"] == "F"
    assert row["mean"] == pytest.approx(specimens[0]["capacitance"], rel=0.03)
    assert printed["parameters"]["capacitance"]["value"] == row["mean"]
    assert {row["specimen"] for row in printed["records"]} == {"film 1", "film 2"}
    assert (tmp_path / "kind_film_2.toml").exists()
    assert main(["plan", str(path)]) == 2
    assert "found several specimens, which only identify" in capsys.readouterr().err


HEAD = "[transducer]\nquasi_static = true\nstiffness = 1e5\ncoupling = 5.5e-4\ncapacitance = 3.6e-9\n"
RECORD = '[[specimens.records]]\nfile = "s0_0.csv"\nload_resistance = 1e5\n'
ONE = f'[[specimens]]\nname = "a"\n{RECORD}'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("specimens = []\n" + HEAD, "specimens: found 0 tables, allowed are 2 to 1000"),
        (HEAD + ONE, "specimens: found 1 table, allowed are 2 to 1000"),
        (HEAD + ONE + ONE, "specimens.1.name: found 'a', which another specimen has"),
        (HEAD + ONE + "[[specimens]]\nname = 3\n" + RECORD, "specimens.1.name: found 3, must be a string"),
        (
            HEAD + '[specimens]\nname = "a"\n',
            "specimens: found {'name': 'a'}, must be a list of tables, written as [[specimens]], not [specimens]",
        ),
        (HEAD + ONE + "[[specimens]]\n", "specimens.1.records: missing, at least one table [[specimens.records]]"),
        (HEAD + ONE + "[[specimens]]\nmass = 3\n" + RECORD, "specimens.1.mass: unknown key, known keys are name"),
        (HEAD + ONE + "[[specimens]]\n" + RECORD.replace("1e5", "-1.0"), "specimens.1.records.0.load_resistance: "),
        (HEAD + ONE + "[[specimens]]\ntransducer = {stiffness = 0}\n" + RECORD, "specimens.1.transducer.stiffness: "),
        (HEAD + ONE + ONE.replace('"a"', '"b"') + "[[records]]\n", "records: unknown key, records are given in"),
    ],
)
def test_what_is_wrong_with_specimens_is_said_in_a_sentence(text, message, tmp_path):
    path = write(tmp_path, [drawn(np.random.default_rng(8), 0.01)], [[100]])
    path.write_text(text)
    with pytest.raises(CampaignError, match=r"campaign\.toml") as error:
        load(path)
    assert message in str(error.value)


def test_an_error_of_one_specimen_names_it(tmp_path):
    path = write(tmp_path, [drawn(np.random.default_rng(8), 0.01)], [[100]])
    path.write_text(HEAD + ONE + ONE.replace('"a"', '"b"').replace("load_res", 'role = "validate"\nload_res'))
    with pytest.raises(CampaignError, match="b: no record has"):
        identify_specimens(load(path))
