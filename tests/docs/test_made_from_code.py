"""Reference and schemas that are made from the code: nothing is left out, and what a study may be they allow."""

import copy
import dataclasses
import re
import tomllib
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from made_from_code import cards, effect_figures, equations, figures, reference, schema

from piezoharvest.bench.effects import registered as bench_effects
from piezoharvest.bench.settings import Bench
from piezoharvest.description import effects, excitation, shunts
from piezoharvest.description.figures import DATA_SHEETS, Modal
from piezoharvest.description.transducer import Transducer
from piezoharvest.records.reading.entries import ENTRIES
from piezoharvest.study import DesignOptions, SweepOptions

ROOT = Path(__file__).parents[2]
PAGES = reference.pages()
STUDY = jsonschema.Draft7Validator(schema.study())
CAMPAIGN = jsonschema.Draft7Validator(schema.campaign())
STUDIES = [*ROOT.glob("designs/*/*.toml"), ROOT / "piezoharvest/demo/study.toml"]


def keys(cls):
    return {field.name.removesuffix("_") for field in dataclasses.fields(cls) if field.init}


def listed(page):
    return set(re.findall(r"^\| `(\w+)` \|", page, flags=re.MULTILINE))


@pytest.mark.parametrize("cls", [Transducer, DesignOptions, SweepOptions, Modal, *DATA_SHEETS.values(),
                                 *excitation.registered().values()])  # fmt: skip
def test_keys_of_a_study_are_listed(cls):
    assert keys(cls) <= listed(PAGES["reference/study.md"])


@pytest.mark.parametrize("cls", [Bench, *bench_effects().values()])
def test_keys_of_the_bench_are_listed(cls):
    assert keys(cls) <= listed(PAGES["reference/bench.md"])


@pytest.mark.parametrize("cls", ENTRIES.values())
def test_keys_of_a_campaign_are_listed(cls):
    assert keys(cls) <= listed(PAGES["reference/campaign.md"])


@pytest.mark.parametrize(("folder", "known"), [("shunts", shunts.registered()), ("effects", effects.registered())])
def test_every_component_has_a_page_with_its_keys_and_source(folder, known):
    for name, cls in known.items():
        if not cls.__module__.startswith("piezoharvest."):  # that of a test
            continue
        page = PAGES[f"{folder}/{name}.md"]
        assert keys(cls) <= listed(page)
        assert f"Source: {reference.plain(cls.source)}" in page
        assert f"({name}.md)" in PAGES[f"{folder}/index.md"]


def test_every_key_has_a_description():
    rows = [line for page in PAGES.values() for line in page.splitlines() if re.match(r"\| `\w+` \|.*\|.*\|.*\|", line)]
    assert len(rows) > 300
    assert [row for row in rows if row.rstrip("| ").endswith("||") or not row.split("|")[-2].strip()] == []


def test_schemas_are_valid():
    for validator in (STUDY, CAMPAIGN):
        jsonschema.Draft7Validator.check_schema(validator.schema)


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.parent.name + path.stem)
def test_the_schema_accepts_studies(path):
    STUDY.validate(tomllib.loads(path.read_text()))


def documented():
    """The study of the README."""
    text = (ROOT / "README.md").read_text()
    return tomllib.loads(
        next(block for block in re.findall(r"```toml[^\n]*\n(.*?)```", text, re.DOTALL) if "[[shunts]]" in block)
    )


def test_the_schema_accepts_the_study_of_the_readme_and_units():
    study = documented()
    study["transducer"]["capacitance"] = "40 nF"
    study["excitation"]["frequency"] = "free"
    STUDY.validate(study)


@pytest.mark.parametrize(("path", "value"), [
    ("transducer.stifness", 1.0), ("excitation.amplitud", 1.0), ("shunts.0.resistanse", 1.0), ("sweeps", {}),
    ("design.parts", "E25"), ("excitation.frequency", -1.0), ("shunts.0.kind", "sshi"), ("bench", {"sample_rat": 1.0}),
    ("transducer.effects", {"leakage": {"resistance": 0.0}}),
])  # fmt: skip
def test_the_schema_refuses_what_the_programme_refuses(path, value):
    study = copy.deepcopy(documented())
    *way, last = path.split(".")
    place = study
    for step in way:
        place = place[int(step)] if step.isdigit() else place.setdefault(step, {})
    place[last] = value
    assert not STUDY.is_valid(study)


def test_the_schema_of_campaigns():
    table = {"kind": "parallel_sshi", "inductance": 0.1, "quality": 5.0, "load_resistance": 1e5, "fit": ["quality"],
             "smoothing_capacitance": 1e-6}  # fmt: skip
    campaign = {
        "transducer": {"catalogue": "NAC2125-H10", "mass": "unknown", "quasi_static": True},
        "channels": {"displacement": {"column": ["left", 3], "unit": "um"}},
        "records": [
            {"file": "a.csv", "shunt": table},
            {"file": "b.csv", "kind": "frf", "output": "displacement", "load_resistance": 1e5,
             "channels": {"magnitude": {"column": "H"}}},
        ],
    }  # fmt: skip
    CAMPAIGN.validate(campaign)
    CAMPAIGN.validate({**campaign, "transducer": "specimen.toml"})
    for wrong in ({"file": "a.csv", "fil": 1}, {"kind": "frf", "file": "a.csv"}, {"file": "a.csv", "drive": "heat"}):
        assert not CAMPAIGN.is_valid({**campaign, "records": [wrong]})


def test_figure_of_a_shunt():
    example = shunts.registered()["resistor"](resistance=8e4)
    ((kind, caption, picture),) = figures.figures({"resistor": example})
    assert kind == "resistor" and picture.startswith(b"\x89PNG")
    assert "R = 80 kΩ" in caption.replace("\u202f", " ") and "It harvests" in caption


def test_there_is_an_example_of_every_shunt_for_its_figure():
    own = {kind for kind, cls in shunts.registered().items() if cls.__module__.startswith("piezoharvest.")}
    assert figures.examples().keys() == own


def test_equations_of_shunts_are_those_of_the_circuits():
    """By hand: Kirchhoff's laws of an RL shunt, of a bridge that conducts, and of a switched loop with its quality."""
    pytest.importorskip("sympy", reason="the extra docs is not installed")
    examples = figures.examples()
    found = dict(equations.equations(examples))
    assert set(found) == set(examples)
    assert "averaging_time mean' - i_L i_T + mean = 0" in found["adaptive_rl"].split("shortest")[0]
    assert "L i_L' + R i_L - v = 0" in found["series_rl"]
    assert "open      i = 0" not in found["series_rl"]
    bridge = found["rectifier"].split("open+")[1]
    assert "v' - v_dc' = 0" in bridge
    assert "C_s v_dc' - i + v_dc/R_load = 0" in bridge
    assert "L i_L' - v + sqrt(L) i_L/(sqrt(C) Q_i) = 0" in found["parallel_sshi"].split("closed")[1]
    assert "reversed polarity" in found["rectifier"]


def test_cells_of_tables_of_keys_know_their_columns():
    table = "<table><thead><tr>{}</tr></thead><tbody><tr>\n{}</tr></tbody></table>"
    three = table.format("<th>key</th><th>unit</th><th></th>", "<td><code>a</code></td><td>m</td><td>x</td>")
    found = cards.with_headings(three)
    assert found.startswith("<table data-cards><thead><tr><th>key</th>")
    assert '<td data-heading="unit">m</td><td data-heading="">x</td>' in found
    two = table.format("<th>a</th><th>b</th>", "<td>1</td><td>2</td>")
    assert cards.with_headings(two) == two


def test_every_effect_has_a_figure_in_which_it_shows(monkeypatch):
    shown = {}
    monkeypatch.setattr(effect_figures, "_drawn", lambda *records: records)
    monkeypatch.setattr(effect_figures.style, "write_png", lambda records, stream: shown.update({len(shown): records}))
    names = [name for name, _, _ in effect_figures.figures()]
    own = {name for name, cls in effects.registered().items() if cls.__module__.startswith("piezoharvest.")}
    assert set(names) == own
    for name, (with_it, without, channel) in zip(names, shown.values(), strict=True):
        column = effect_figures._COLUMNS[channel]
        change = np.abs(with_it[column] - without[column]).max() / np.abs(without[column]).max()
        assert 0.05 < change < 3.0, name
        assert np.unique(without[column]).size > 100, name  # no sensor of the bench is saturated
