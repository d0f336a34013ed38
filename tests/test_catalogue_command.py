"""`piezoharvest catalogue`: each entry by itself is as in the list, with the source that its file states."""

import json
from dataclasses import replace

import pytest

from piezoharvest.cli import main
from piezoharvest.description import catalogue
from piezoharvest.linear import coupling_factor
from piezoharvest.study import build_transducer


def shown(capsys, *arguments):
    assert main(["catalogue", *arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(("part", "name"), [("transducers", "NAC2125-H10"), ("materials", "PZT-5A")])
def test_an_entry_by_itself_is_that_of_the_list(part, name, capsys):
    (listed,) = [entry for entry in shown(capsys)[part] if entry["key"] == name]
    assert shown(capsys, name) == listed


def test_the_list_has_all_entries_and_their_values(capsys):
    found = shown(capsys)
    assert [entry["key"] for entry in found["transducers"]] == list(catalogue.names())
    assert [entry["key"] for entry in found["materials"]] == list(catalogue.materials())
    material = catalogue.material("PZT-5A")
    (listed,) = [entry for entry in found["materials"] if entry["key"] == "PZT-5A"]
    assert {key: row["value"] for key, row in listed["values"].items()} == material["material"]
    assert (listed["source"], listed["values"]["d33"]["unit"]) == (material["source"], "C/N")
    (stack,) = [entry for entry in found["transducers"] if entry["key"] == "NAC2125-H10"]
    device = build_transducer({"catalogue": "NAC2125-H10"})
    assert stack["values"]["capacitance"] == {"value": device.capacitance, "unit": "F"}
    factor = coupling_factor(replace(device, hysteresis=None)).material[0] ** 0.5
    assert stack["values"]["coupling_factor"]["value"] == pytest.approx(factor, rel=1e-9)


def test_the_table_names_every_entry_and_an_entry_its_source(capsys):
    assert main(["catalogue"]) == 0
    table = capsys.readouterr().out
    assert [name for name in (*catalogue.names(), *catalogue.materials()) if f" {name} " not in table] == []
    assert main(["catalogue", "PZT-4"]) == 0
    assert f"source: {catalogue.material('PZT-4')['source']}" in capsys.readouterr().out


def test_an_unknown_entry_is_refused_with_the_nearest_name(capsys):
    assert main(["catalogue", "PZT5A"]) == 2
    assert "found 'PZT5A' (did you mean 'PZT-5A'?)" in capsys.readouterr().err
