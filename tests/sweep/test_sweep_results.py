"""What a sweep writes: the same numbers as `simulate`, null where there is no answer."""

import json

import numpy as np
import pytest
from pyarrow import csv, parquet
from sweep_studies import BENCH, EVERYTHING, NOISE, RESISTOR, SINE, SSHI, parameter, study_of, sweep_table

from piezoharvest.engine import simulate
from piezoharvest.sweep import sweep
from piezoharvest.sweep.place import place

READ = {"parquet": parquet.read_table, "csv": csv.read_csv}
LOAD = parameter("shunts.0.load_resistance", 1e5, 1e6, "log", 3)
FREQUENCY = parameter("excitation.frequency", 49.0, 52.0, "linear", 2)


def swept(folder, *texts, suffix="parquet"):
    """Study, result and rows of a sweep."""
    study = study_of(folder, *texts)
    result = sweep(study, folder / f"out.{suffix}")
    return study, result, READ[suffix](result.out)


def direct(study, row, paths, shunt=0):
    """Response to the design of a row, simulated by itself."""
    return simulate(*place(study, shunt, paths, [row[path] for path in paths]))


@pytest.mark.parametrize("suffix", ["parquet", "csv"])
def test_rows_are_what_simulate_gives(tmp_path, suffix):
    outputs = [
        "harvested_power", "mechanical_power", "efficiency", "displacement_amplitude", "voltage_amplitude",
        "dc_voltage", "attenuation_db", "closure", "events_per_period", "energy.mechanical_in", "energy.harvested",
        "energy.damping", "energy.hysteresis", "energy.shunt_loss", "energy.source", "energy.leakage",
    ]  # fmt: skip
    table = sweep_table(LOAD.replace("shunts.0", "shunts.1"), FREQUENCY, outputs=outputs)
    study, result, rows = swept(tmp_path, EVERYTHING, table, suffix=suffix)
    paths = ["shunts.1.load_resistance", "excitation.frequency"]
    assert rows.column_names == ["design", *paths, "shunt", "kind", "converged", *outputs]
    assert rows["design"].to_pylist() == [n for n in range(6) for _ in range(2)]
    assert rows["shunt"].to_pylist() == [0, 1] * 6
    assert rows["kind"].to_pylist() == ["resistor", "parallel_sshi"] * 6
    for row in rows.to_pylist():
        alone = direct(study, row, paths, row["shunt"])
        assert row["converged"] is alone.converged is True
        assert row["closure"] < 1e-9
        assert row["events_per_period"] == alone.events_per_period
        for name in set(outputs) - {"closure", "events_per_period"}:
            wanted = alone.energy.get(name[7:], 0.0) if name.startswith("energy.") else getattr(alone, name)
            assert row[name] == pytest.approx(wanted, rel=1e-7, abs=1e-12 * alone.energy["mechanical_in"]), name
    assert (result.designs, result.rows, result.converged, result.incomplete) == (6, 12, 12, 0)


def test_both_formats_hold_the_same_numbers(tmp_path):
    table = sweep_table(LOAD, FREQUENCY)
    _, _, binary = swept(tmp_path, BENCH, SINE, SSHI, table)
    _, _, text = swept(tmp_path, BENCH, SINE, SSHI, table, suffix="csv")
    assert text.to_pydict() == binary.to_pydict()


def test_types_and_units(tmp_path):
    table = sweep_table(LOAD, outputs=["attenuation_db", "events_per_period"])
    _, _, rows = swept(tmp_path, BENCH, SINE, SSHI, table)
    assert [str(field.type) for field in rows.schema] == [
        "int64", "double", "int64", "string", "bool", "double", "int64",
    ]  # fmt: skip
    assert rows.field("shunts.0.load_resistance").metadata == {b"unit": b"ohm"}
    assert rows.field("attenuation_db").metadata == {b"unit": b"dB"}


def test_default_outputs(tmp_path):
    _, _, rows = swept(tmp_path, BENCH, SINE, SSHI, sweep_table(LOAD))
    assert rows.column_names[5:] == [
        "harvested_power", "mechanical_power", "efficiency", "displacement_amplitude", "voltage_amplitude",
        "dc_voltage", "attenuation_db", "closure", "figure_of_merit",
    ]  # fmt: skip


def test_best_row_harvests_most(tmp_path):
    _, result, rows = swept(tmp_path, BENCH, SINE, SSHI, sweep_table(LOAD, FREQUENCY))
    assert result.best == max(rows.to_pylist(), key=lambda row: row["harvested_power"])


def test_best_row_moves_least_where_power_is_not_asked_for(tmp_path):
    _, result, rows = swept(tmp_path, BENCH, SINE, SSHI, sweep_table(LOAD, FREQUENCY, outputs=["attenuation_db"]))
    assert result.best == min(rows.to_pylist(), key=lambda row: row["attenuation_db"])


def test_designs_that_are_not_allowed_are_null(tmp_path):
    """Where the second threshold is not above the first; they stand between others in every chunk."""
    thresholds = [parameter(f"transducer.hysteresis.thresholds.{n}", 1e-7, 4e-7, count=4) for n in (0, 1)]
    table = sweep_table(*thresholds, outputs=["harvested_power", "events_per_period"])
    _, result, rows = swept(tmp_path, EVERYTHING, table)
    assert result.rows == 32
    for row in rows.to_pylist():
        one, two = (row[f"transducer.hysteresis.thresholds.{n}"] for n in (0, 1))
        assert row["converged"] is (one < two)
        assert (row["harvested_power"] is None) is (row["events_per_period"] is None) is (one >= two)
    assert (result.converged, result.failed) == (12, 20)


def test_an_unstable_design_does_not_converge(tmp_path):
    """Beyond the clamped capacitance a parallel negative one makes the loop grow."""
    shunt = '[[shunts]]\nkind = "negative_capacitance"\ncapacitance = 20e-9\nresistance = 1e5\n'
    table = sweep_table(parameter("shunts.0.capacitance", 20e-9, 60e-9, count=5))
    _, _, rows = swept(tmp_path, BENCH, SINE, shunt, table)
    assert rows["converged"].to_pylist() == [True, True, False, False, False]
    assert rows["harvested_power"].to_pylist()[3:] == [None, None]


@pytest.mark.parametrize(
    ("excitation", "path", "values"),
    [
        (NOISE, "excitation.psd", (1e-6, 4e-6)),
        (NOISE, "excitation.band.1", (150.0, 200.0)),
        (NOISE, "excitation.duration", (0.1, 0.2)),
        (
            '[excitation]\nkind = "step_force"\namplitude = 0.1\nduration = 0.2\nrise_time = 0.01\n',
            "excitation.rise_time",
            (0.0, 0.1),
        ),
        (
            '[excitation]\nkind = "multisine"\namplitudes = [0.01, 0.01]\nfrequencies = [45.0, 50.0]\n'
            "phases = [0.0, 1.0]\nduration = 0.2\n",
            "excitation.frequencies.1",
            (50.0, 55.0),
        ),
    ],
)
def test_excitations_other_than_a_sine(tmp_path, excitation, path, values):
    table = sweep_table(parameter(path, *values, count=2), parameter("shunts.0.resistance", 1e4, 1e5, count=2))
    study, _, rows = swept(tmp_path, BENCH, excitation, RESISTOR, table)
    for row in rows.to_pylist():
        alone = direct(study, row, [path, "shunts.0.resistance"])
        assert row["converged"]
        assert row["harvested_power"] == pytest.approx(alone.harvested_power, rel=1e-9)
    assert len(set(rows["harvested_power"].to_pylist())) == 4


class TestCommand:
    def test_json(self, run, tmp_path):
        status, out, err = run(BENCH + SINE + SSHI + sweep_table(LOAD, FREQUENCY), "--out", "out.parquet", "--json")
        found = json.loads(out)
        assert status == 0
        assert (found["title"], found["out"]) == ("bench harvester", "out.parquet")
        assert (found["designs"], found["rows"], found["converged"], found["failed"]) == (6, 6, 6, 0)
        assert found["designs_per_second"] == pytest.approx(6 / found["seconds"])
        assert found["best"] in parquet.read_table(tmp_path / "out.parquet").to_pylist()
        assert err.startswith("6 designs in ")
        assert err.count("\n") == 1

    def test_for_people(self, run):
        status, out, _ = run(BENCH + SINE + SSHI + sweep_table(LOAD), "--out", "out.csv")
        assert status == 0
        assert "bench harvester" in out
        assert "shunts.0 (parallel_sshi)" in out
        assert "shunts.0.load_resistance = " in out
        assert "harvested" in out
        assert "attenuation" in out and " db" not in out  # the unit is below the name, once

    def test_progress_on_a_terminal(self, run, monkeypatch):
        text = BENCH + SINE + SSHI + sweep_table(LOAD)
        assert "left" not in run(text, "--out", "out.csv")[2]
        monkeypatch.setenv("FORCE_COLOR", "1")  # which rich takes for a terminal
        _, _, err = run(text, "--out", "out.csv")
        assert "3/3" in err
        assert "designs/s" in err
        assert "left" in err

    def test_a_design_without_an_answer_is_counted(self, run, tmp_path):
        thresholds = [parameter(f"transducer.hysteresis.thresholds.{n}", 1e-7, 3e-7, count=2) for n in (0, 1)]
        status, out, err = run(EVERYTHING + sweep_table(*thresholds), "--out", "out.csv", "--json")
        assert status == 1
        assert "warning: 6 of 8 rows did not converge" in err
        assert json.loads(out)["failed"] == 6
        text = (tmp_path / "out.csv").read_text()
        assert "nan" not in text.lower()
        assert text.count("false,,,,,,,,") == 6

    def test_an_answer_that_is_not_complete_is_counted(self, run):
        """Without motion there is no attenuation."""
        table = sweep_table(LOAD, outputs=["harvested_power", "attenuation_db"])
        text = BENCH + SINE.replace("0.02", "0") + SSHI + table
        status, out, err = run(text, "--out", "out.csv", "--json")
        assert status == 1
        assert "warning: 3 of 3 rows converged, but have no value for some output (null)" in err
        assert json.loads(out)["incomplete"] == 3

    @pytest.mark.parametrize("flags", [(), ("--json",)])
    def test_nothing_converged(self, run, monkeypatch, flags):
        def evaluate(study, values):
            nothing = np.full((len(values), 1), np.nan)
            return {"converged": np.zeros((len(values), 1), bool), "harvested_power": nothing}

        monkeypatch.setattr("piezoharvest.sweep.run.evaluate", evaluate)
        text = BENCH + SINE + SSHI + sweep_table(LOAD, outputs=["harvested_power"])
        status, out, err = run(text, "--out", "out.csv", *flags)
        assert status == 1
        assert "3 of 3 rows did not converge" in err
        assert json.loads(out)["best"] is None if flags else out == "bench harvester\n"
