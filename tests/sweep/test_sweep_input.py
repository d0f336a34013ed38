"""Whatever is wrong with a sweep is said in one sentence before anything is simulated, and leaves nothing behind."""

import os

import pytest
from sweep_studies import BENCH, RESISTOR, SINE, SSHI, parameter, sweep_table, write

from piezoharvest.study import StudyError, load_study
from piezoharvest.sweep import sweep

STUDY = BENCH + SINE + SSHI
LOAD = parameter("shunts.0.load_resistance", 1e4, 1e6, "log", 3)


@pytest.fixture
def refused(run, tmp_path, monkeypatch):
    """Run the command, which must refuse with status 2 and one line on stderr, which is returned."""

    def simulate(*_):
        raise AssertionError("simulated")

    monkeypatch.setattr("piezoharvest.sweep.run.evaluate", simulate)

    def call(text, *arguments):
        status, out, err = run(text, *(arguments or ("--out", "out.parquet")))
        assert (status, out) == (2, "")
        assert err.startswith("piezoharvest: ")
        assert err.count("\n") == 1
        assert os.listdir(tmp_path) == ["study.toml"]
        return err.removeprefix("piezoharvest: error: ").rstrip("\n")

    return call


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (sweep_table(), "sweep.parameters: found an empty list, at least one table [[sweep.parameters]] is needed"),
        ("[sweep]", "sweep.parameters: missing key, must be a list of tables"),
        ("[sweep]\nparameters = [1]", "sweep.parameters.0: found 1, must be a table"),
        (sweep_table(LOAD, method="sobel"), "sweep.method: found 'sobel', must be 'grid' or 'random' or 'sobol'"),
        (sweep_table(LOAD, methods="grid"), "sweep.methods: unknown key (did you mean 'method'?)"),
        (sweep_table(LOAD, method="sobol"), "sweep.samples: missing key, method = 'sobol' needs a whole number"),
        (sweep_table(LOAD, method="random", samples=0), "sweep.samples: found 0, must be"),
        (sweep_table(LOAD, method="random", samples=1.5), "sweep.samples: found 1.5, must be a whole number"),
        (sweep_table(LOAD, method="random", samples=2**30 + 1), "sweep.samples: found 1073741825, must be"),
        (sweep_table(LOAD, seed=-1), "sweep.seed: found -1, must be"),
        (sweep_table(LOAD, outputs=[]), "sweep.outputs: found an empty list, at least one output is needed"),
        (
            sweep_table(LOAD, outputs=["harvested_power", "harvested"]),
            "sweep.outputs.1: found 'harvested' (did you mean 'harvested_power' or 'energy.harvested'?), allowed are ",
        ),
        (
            sweep_table(LOAD, outputs=["energy.leakage"]),  # a loss that this transducer has not
            "sweep.outputs.0: found 'energy.leakage' (did you mean 'energy.damping'?)",
        ),
        (sweep_table(LOAD, outputs=["closure"] * 2), "sweep.outputs.1: found 'closure' a second time"),
        (sweep_table(LOAD, LOAD), "sweep.parameters.1.path: found 'shunts.0.load_resistance' a second time"),
        (
            sweep_table(*(parameter(f"transducer.{name}", 1.0, 2.0, count=2**16) for name in ("mass", "damping"))),
            "sweep.parameters: found 4294967296 designs, allowed are up to 1073741824",
        ),
    ],
)
def test_table(refused, table, message):
    assert refused(STUDY + table).startswith(f"study.toml: {message}")


@pytest.mark.parametrize(
    ("arguments", "key", "message"),
    [
        (("shunts.0.load_resistance", 1e4, 1e6), "count", "missing key, method = 'grid' needs a whole number"),
        (("shunts.0.load_resistance", 1e4, 1e6, "linear", 0), "count", "found 0, must be"),
        (("shunts.0.load_resistance", 1e4, 1e4, "linear", 3), "to", "found 10000, which is the value of from as well"),
        (("shunts.0.load_resistance", 1e4, 1e6, "log10", 3), "scale", "found 'log10', must be 'linear' or 'log'"),
        (("transducer.coupling", 0.0, 1e-3, "log", 3), "from", "found 0 with scale = 'log', must be a number grea"),
        (("transducer.coupling", 1e-3, -1e-3, "log", 3), "to", "found -0.001 with scale = 'log'"),
        (("shunts.0.load_resistance", float("nan"), 1e6, "log", 3), "from", "found nan, must be a finite number"),
        (("shunts.0.load_resistance", "1e4", 1e6, "log", 3), "from", "found '1e4' without its unit, must be"),
        (("shunts.0.load_resistance", -1.0, 1e6, "linear", 3), "from", "found -1.0, must be a finite number great"),
        (("shunts.0.quality", 5.0, 0.5, "linear", 3), "to", "found 0.5, must be a finite number greater than 0.5"),
        (
            ("shunts.0.load_resistence", 1e4, 1e6, "log", 3),
            "path",
            "found 'shunts.0.load_resistence' (did you mean 'shunts.0.load_resistance'?), allowed are",
        ),
        (
            ("load_resistance", 1e4, 1e6, "log", 3),
            "path",
            "found 'load_resistance' (did you mean 'shunts.0.load_resistance'?), allowed are excitation.amplitude",
        ),
        (("shunts.1.load_resistance", 1e4, 1e6, "log", 3), "path", "found 'shunts.1.load_resistance' (did you mean"),
        (("transducer.hysteresis.weights.0", 1.0, 2.0, "log", 3), "path", "found 'transducer.hysteresis.weights.0'"),
        (("shunts.0.kind", 1.0, 2.0, "log", 3), "path", "found 'shunts.0.kind'"),
        (("title", 1.0, 2.0, "log", 3), "path", "found 'title'"),
    ],
)
def test_parameter(refused, arguments, key, message):
    table = sweep_table(
        LOAD.replace("load_resistance", "diode_drop").replace('"log"', '"linear"'), parameter(*arguments)
    )
    assert refused(STUDY + table).startswith(f"study.toml: sweep.parameters.1.{key}: {message}")


@pytest.mark.parametrize(
    ("swept", "message"),
    [
        (
            parameter("shunts.0.flip_time", 1e-4, 2e-4, "linear", 9),
            "none of the designs tried is possible, for instance shunts.0.flip_time = 0.0001 "
            "(shunts.0.inductance: found both",
        ),
        (
            parameter("shunts.0.time_lag", -0.5, -0.2, "linear", 9),
            "none of the designs tried is possible, for instance shunts.0.time_lag = -0.5 "
            "(shunts.0.time_lag: found -0.5 s",
        ),
    ],
)
def test_designs_that_are_all_refused(refused, swept, message):
    assert refused(STUDY + sweep_table(swept)).startswith(f"study.toml: sweep.parameters: {message}")


def test_a_wrong_path_is_told_before_the_unit_of_its_ends(refused):
    """Of "10 kohm" at a misspelt path it was said that there must be no unit."""
    table = sweep_table('{ path = "shunts.0.load_resistence", from = "10 kohm", to = "1 Mohm", count = 3 }')
    said = refused(STUDY + table)
    assert said.startswith(
        "study.toml: sweep.parameters.0.path: found 'shunts.0.load_resistence' (did you mean 'shunts.0"
    )


def test_ends_of_an_optional_value_that_the_study_does_not_give_have_units(tmp_path):
    """Only values that the study gives had."""
    table = sweep_table('{ path = "shunts.0.hold_off", from = "1 ms", to = "2 ms", count = 3 }')
    (tmp_path / "study.toml").write_text(STUDY + table)
    (parameter,) = load_study(tmp_path / "study.toml").sweep.parameters
    assert (parameter.from_, parameter.to) == (1e-3, 2e-3)


def test_no_table(refused):
    assert refused(STUDY) == "study.toml: sweep: missing table [sweep]"


def test_no_shunts(refused):
    swept = sweep_table(parameter("transducer.mass", 1.0, 2.0, "log", 3))
    assert refused(BENCH + SINE + "[design]\n" + swept) == (
        "study.toml: shunts: missing tables [[shunts]], at least one is needed"
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--out", "out.txt"), "out.txt: found '.txt', allowed are names ending in .parquet, .csv"),
        (("--out", "no/out.csv"), "no: files cannot be written to this directory"),
        (("--out", "out.csv", "--scheduler", "nonsense"), "--scheduler: no Dask scheduler answers at 'nonsense'"),
        (("--out", "out.csv", "--scheduler", "tls://127.0.0.1:1"), "--scheduler: no Dask scheduler answers at"),
    ],
)
def test_arguments(refused, arguments, message):
    assert message in refused(STUDY + sweep_table(LOAD), *arguments)


def test_workers_and_scheduler_are_one_or_the_other(refused):
    arguments = ("--out", "out.csv", "--workers", "2", "--scheduler", "tcp://127.0.0.1:8786")
    assert "--workers is given too, but only one of the two may be" in refused(STUDY + sweep_table(LOAD), *arguments)


def test_no_scheduler_at_the_address(refused, monkeypatch):
    monkeypatch.setattr("piezoharvest.workers.cluster._TIMEOUT", 0.2)
    address = "tcp://127.0.0.1:9"  # the discard service, which nobody runs
    found = f"--scheduler: no Dask scheduler answers at {address!r}, give the address of a running one"
    assert found in refused(STUDY + sweep_table(LOAD), "--out", "out.csv", "--scheduler", address)


def test_a_wrong_table_is_refused_by_every_command(tmp_path):
    with pytest.raises(StudyError, match=r"sweep\.parameters: missing key"):
        load_study(write(tmp_path, BENCH + SINE + RESISTOR + "[sweep]"))


def test_from_python(tmp_path):
    study = load_study(write(tmp_path, BENCH + SINE + RESISTOR))
    with pytest.raises(StudyError, match=r"sweep: missing table \[sweep\]"):
        sweep(study, tmp_path / "out.csv")
