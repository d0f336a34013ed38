"""The command line: exit status, what goes to stdout and to stderr, files that are whole or not there."""

from __future__ import annotations

import csv
import json
import os
import resource
import signal
import subprocess
import sys
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import psutil
import pytest
from pages import figures_on_the_page_only
from pyarrow import parquet

import piezoharvest.cli
import piezoharvest.demo.page
import piezoharvest.demo.story
import piezoharvest.design
import piezoharvest.engine
import piezoharvest.progress
import piezoharvest.report
import piezoharvest.spice
from piezoharvest import __version__
from piezoharvest.cli import main
from piezoharvest.cli.tables import Column, _print_table
from piezoharvest.description.parameters import ParameterError
from piezoharvest.engine.response import Response, Waveforms
from piezoharvest.output import TABLE_SUFFIXES, WAVEFORM_COLUMNS, OutputError, atomic, check_file, write_text

STUDY = """\
title = "bench harvester"

[transducer]
mass = 0.010
damping = 0.0628
stiffness = 986.96
coupling = 1.0e-3
capacitance = 40e-9

[excitation]
kind = "sine_force"
amplitude = 0.02
frequency = 50.6

[[shunts]]
kind = "resistor"
resistance = 8e4

[[shunts]]
kind = "parallel_sshi"
dc_voltage = 5
inductance = 0.1
quality = 6

[design]
candidates = ["resistor"]
"""

RESULT = {
    "shunt", "converged", "period", "harvested_power", "mechanical_power", "efficiency", "displacement_amplitude",
    "voltage_amplitude", "dc_voltage", "attenuation_db", "energy", "events_per_period",
}  # fmt: skip
ENERGY = {"mechanical_in", "harvested", "damping", "hysteresis", "shunt_loss", "closure"}
COLUMNS = ["shunt", "kind", *WAVEFORM_COLUMNS]


@pytest.fixture
def study(tmp_path, monkeypatch):
    """A study in the working directory, named as a user would."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study.toml").write_text(STUDY)
    return "study.toml"


@pytest.fixture
def run(capsys):
    """Run the command line; gives exit status, stdout and stderr."""

    def call(*arguments: str) -> tuple[int, str, str]:
        status = main(arguments)
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return status, captured.out, captured.err

    return call


@pytest.fixture
def refused(run):
    """Run the command line, which must refuse: status 2, nothing on stdout, one line on stderr, which is returned."""

    def call(*arguments: str) -> str:
        status, out, err = run(*arguments)
        assert (status, out) == (2, "")
        assert err.startswith("piezoharvest: ")
        assert err.count("\n") == 1
        return err

    return call


def strict(text: str) -> dict:
    """Parse JSON that must hold neither NaN nor Infinity."""

    def refuse(name: str):
        raise AssertionError(name)

    return json.loads(text, parse_constant=refuse)


def response(kind: str = "resistor", samples: int = 4, **changes) -> Response:
    """Stand-in for what the engine gives."""
    time = np.linspace(0.0, 0.02, samples)
    signals = {name: time + n for n, name in enumerate(WAVEFORM_COLUMNS.values())} | {"time": time}
    waveforms = Waveforms(**signals, event_times=np.empty(0), event_names=())
    plain = Response(
        shunt=kind,
        converged=True,
        message="",
        period=0.02,
        harvested_power=4.6e-4,
        mechanical_power=7.2e-4,
        displacement_amplitude=2.35e-4,
        voltage_amplitude=11.8,
        dc_voltage=0.0,
        attenuation_db=-8.7,
        energy={"mechanical_in": 1.4e-5, "closure": 1e-13},
        events_per_period=0,
        periods_evaluated=3,
        waveforms=waveforms,
    )
    return replace(plain, **changes)


@pytest.fixture
def engine(monkeypatch):
    """Replace the engine by a stand-in; gives the function that sets what comes back for each shunt."""

    def answer(*responses: Response | BaseException):
        queue = list(responses)

        def simulate(system, excitation, *, transient=None, samples=512, progress=None):
            result = queue.pop(0)
            if isinstance(result, BaseException):
                raise result
            return result

        monkeypatch.setattr(piezoharvest.engine, "simulate", simulate, raising=False)

    return answer


def test_powers_of_a_row_have_one_prefix(capsys):
    """Where four digits show both: 754 uW of 1227 uW, but 1.2 W of 754 uW."""
    for mechanical, units in ((1.227e-3, ["uW", "uW"]), (1.2, ["uW", "W"])):
        columns = [Column("harvested", "W", [7.542e-4]), Column("mech.", "W", [mechanical]), Column("V", "V", [19.0])]
        _print_table("", "shunt", ["sece"], columns, [True])
        header, *_ = [line for line in capsys.readouterr().out.splitlines() if line.startswith("shunt")]
        assert header.split()[1:] == [*units, "V"]


class TestSimulate:
    def test_json_is_the_interface(self, study, run):
        status, out, _ = run("simulate", study, "--json")
        assert status == 0
        data = strict(out)
        assert data["title"] == "bench harvester"
        assert [result["shunt"] for result in data["results"]] == ["resistor", "parallel_sshi"]
        for result in data["results"]:
            assert set(result) >= RESULT
            assert set(result["energy"]) >= ENERGY
            assert result["converged"] is True
            assert result["period"] == pytest.approx(1 / 50.6)
            assert result["harvested_power"] == pytest.approx(result["efficiency"] * result["mechanical_power"])
        linear = data["results"][0]
        assert linear["events_per_period"] == 0
        assert linear["harvested_power"] == pytest.approx(linear["voltage_amplitude"] ** 2 / (2 * 8e4), rel=1e-4)

    def test_table_names_shunts_and_units(self, study, run):
        status, out, _ = run("simulate", study)
        assert status == 0
        for word in ("bench harvester", "resistor", "parallel_sshi", "harvested", "dB", "W", "%"):
            assert word in out

    def test_transient(self, study, run):
        status, out, _ = run("simulate", study, "--json", "--transient", "0.05")
        assert status == 0
        assert [result["period"] for result in strict(out)["results"]] == [0.05, 0.05]

    @pytest.mark.parametrize("suffix", TABLE_SUFFIXES)
    def test_waveforms_of_the_engine(self, study, run, tmp_path, suffix):
        status, out, _ = run("simulate", study, "--json", "--out", f"waves{suffix}")
        assert status == 0
        table = read(tmp_path / f"waves{suffix}")
        assert list(table) == COLUMNS
        for n, result in enumerate(strict(out)["results"]):
            mine = table["shunt"] == n
            assert set(table["kind"][mine]) == {result["shunt"]}
            half = 0.5 * np.ptp(table["displacement_m"][mine])
            assert half == pytest.approx(result["displacement_amplitude"], rel=1e-3)

    def test_shunts_are_counted(self, study, run, monkeypatch):
        monkeypatch.setattr(piezoharvest.progress, "EVERY", 0.0)
        status, _, err = run("simulate", study, "--json")
        assert status == 0
        assert any(line.startswith("simulating: 1 of 2 shunts, about ") for line in err.splitlines())

    def test_not_converged(self, study, run, engine):
        engine(response(converged=False, message="no steady state within 50 iterations"), response("parallel_sshi"))
        status, out, err = run("simulate", study, "--json")
        assert status == 1
        assert [result["converged"] for result in strict(out)["results"]] == [False, True]
        assert "shunts.0 (resistor): not to be trusted: no steady state within 50 iterations" in err

    def test_not_converged_in_the_table(self, study, run, engine):
        engine(response(converged=False), response("parallel_sshi"))
        status, out, err = run("simulate", study)
        assert status == 1
        assert "(not trusted)" in out
        assert "did not converge" in err

    def test_message_of_a_good_answer_is_a_warning(self, study, run, engine):
        engine(response(message="the steady state is unstable"), response("parallel_sshi"))
        status, out, err = run("simulate", study, "--json")
        assert status == 0
        assert "unstable" in err
        assert strict(out)["results"][0]["message"] == "the steady state is unstable"

    def test_what_is_not_finite_is_null(self, study, run, engine):
        odd = response(attenuation_db=-np.inf, dc_voltage=np.float64("nan"), energy={"closure": np.nan})
        engine(odd, response("parallel_sshi", events_per_period=np.int64(8)))
        status, out, _ = run("simulate", study, "--json")
        first, second = strict(out)["results"]
        assert status == 0
        assert (first["attenuation_db"], first["dc_voltage"], first["energy"]) == (None, None, {"closure": None})
        assert second["events_per_period"] == 8
        engine(odd, response("parallel_sshi"))
        assert run("simulate", study)[0] == 0

    def test_what_only_the_engine_finds_is_bad_input(self, study, refused, engine):
        engine(ParameterError("phase_lag", "found 1, must be 0"))
        assert "study.toml: shunts.0 (resistor): phase_lag: found 1, must be 0" in refused("simulate", study)

    def test_table_has_one_prefix_in_a_column(self, study, run, engine):
        drawn = {"mechanical_power": 2e-3}
        engine(response(harvested_power=2.5e-6, **drawn), response("parallel_sshi", harvested_power=1.25e-3, **drawn))
        _, out, _ = run("simulate", study)
        assert "0.002500" in out
        assert "1.250" in out
        assert "mW" in out

    def test_rounding_up_takes_the_next_prefix(self, study, run, engine):
        drawn = {"mechanical_power": 2e-3}
        engine(response(harvested_power=9.99996e-4, **drawn), response("parallel_sshi", harvested_power=0.0, **drawn))
        _, out, _ = run("simulate", study)
        assert "1.000" in out
        assert "mW" in out

    def test_title_is_text_whatever_it_looks_like(self, study, run, engine, tmp_path):
        engine(response())
        text = STUDY[: STUDY.rindex("[[shunts]]")].replace("bench harvester", "[red]bench[/] [x")
        (tmp_path / study).write_text(text)
        assert "[red]bench[/] [x" in run("simulate", study)[1]


def read(path) -> dict[str, np.ndarray]:
    """Columns of a waveform file."""
    if path.suffix == ".csv":
        with path.open(newline="") as stream:
            header, *rows = csv.reader(stream)
        columns = dict(zip(header, map(np.array, zip(*rows, strict=True)), strict=True))
        return {name: values if name == "kind" else values.astype(float) for name, values in columns.items()}
    if path.suffix == ".npz":
        with np.load(path) as file:
            return {name: file[name] for name in file}
    if path.suffix == ".h5":
        with h5py.File(path) as file:
            # HDF5 lists its members by name
            return {
                name: file[name].asstr()[:] if name == "kind" else file[name][:] for name in COLUMNS if name in file
            }
    table = parquet.read_table(path)
    return {name: table[name].to_numpy(zero_copy_only=False) for name in table.column_names}


class TestOut:
    @pytest.mark.parametrize("suffix", TABLE_SUFFIXES)
    def test_long_format(self, study, run, engine, tmp_path, suffix):
        engine(response(samples=4), response("parallel_sshi", samples=7))
        (tmp_path / f"w{suffix}").write_text("old")
        status, _, err = run("simulate", study, "--out", f"w{suffix}")
        assert status == 0
        assert f"waveforms: w{suffix}" in err
        table = read(tmp_path / f"w{suffix}")
        assert list(table) == COLUMNS
        assert list(table["shunt"]) == [0] * 4 + [1] * 7
        assert list(table["kind"]) == ["resistor"] * 4 + ["parallel_sshi"] * 7
        np.testing.assert_array_equal(table["time_s"][4:], np.linspace(0, 0.02, 7))
        np.testing.assert_array_equal(table["dc_voltage_V"][:4], np.linspace(0, 0.02, 4) + 8)
        assert sorted(os.listdir(tmp_path)) == sorted(["study.toml", f"w{suffix}"])

    @pytest.mark.parametrize(("suffix", "smaller"), [(".csv", "; .parquet, .npz and .h5 take less"), (".npz", "")])
    def test_a_large_file_is_told(self, study, run, engine, monkeypatch, tmp_path, suffix, smaller):
        """A transient of 200 s wrote 376 MB without a word."""
        monkeypatch.setattr("piezoharvest.cli.commands._LARGE_FILE", 1e6)
        engine(response(samples=20_000), response(samples=20_000))
        _, _, err = run("simulate", study, "--out", f"w{suffix}")
        size = round((tmp_path / f"w{suffix}").stat().st_size / 1e6)
        assert size > 0 and f"waveforms: w{suffix} ({size} MB, 40,000 rows{smaller})\n" in err

    @pytest.mark.parametrize("name", ["w.xls", "w", ".csv", "w.csv.gz"])
    def test_unknown_suffix_before_simulating(self, study, refused, engine, name):
        engine()
        assert "allowed are names ending in .csv, .npz, .h5, .parquet" in refused("simulate", study, "--out", name)

    @pytest.mark.parametrize("name", ["nowhere/w.csv", "study.toml/w.csv", "/proc/w.csv"])
    def test_directory_that_cannot_be_written_to_before_simulating(self, study, refused, engine, name):
        engine()
        assert "files cannot be written to this directory" in refused("simulate", study, "--out", name)

    def test_not_a_file(self, study, refused, engine, tmp_path):
        engine()
        (tmp_path / "w.csv").mkdir()
        assert "not a file" in refused("simulate", study, "--out", "w.csv")

    def test_results_are_printed_even_if_the_file_fails(self, study, run, engine, monkeypatch):
        def full(columns, stream):
            stream.write(b"half")
            raise OSError(28, "No space left on device")

        monkeypatch.setitem(piezoharvest.output._WRITERS, ".csv", full)
        engine(response(), response("parallel_sshi"))
        status, out, err = run("simulate", study, "--json", "--out", "w.csv")
        assert status == 2
        assert len(strict(out)["results"]) == 2
        assert "w.csv: cannot be written (No space left on device)" in err
        assert os.listdir() == ["study.toml"]

    def test_simulation_without_waveforms(self, study, run, engine, tmp_path):
        engine(response(), response("parallel_sshi", converged=False, waveforms=None))
        assert run("simulate", study, "--out", "w.parquet")[0] == 1
        assert set(read(tmp_path / "w.parquet")["shunt"]) == {0}


class TestAtomic:
    def test_failure_leaves_the_old_file(self, tmp_path):
        path = tmp_path / "file.txt"
        path.write_text("old")
        with pytest.raises(RuntimeError), atomic(path) as temporary:
            temporary.write_text("half of the new")
            raise RuntimeError
        assert path.read_text() == "old"
        assert os.listdir(tmp_path) == ["file.txt"]

    def test_link_stays_a_link(self, tmp_path):
        (tmp_path / "file.txt").write_text("old")
        (tmp_path / "link.txt").symlink_to("file.txt")
        write_text("new", tmp_path / "link.txt")
        assert (tmp_path / "link.txt").is_symlink()
        assert (tmp_path / "file.txt").read_text() == "new"

    def test_devices_are_left_alone(self):
        with pytest.raises(OutputError, match="not a file"):
            check_file("/dev/null")

    def test_rights_follow_the_umask(self, tmp_path):
        write_text("new", tmp_path / "file.txt")
        (tmp_path / "other.txt").write_text("")
        assert (tmp_path / "file.txt").stat().st_mode == (tmp_path / "other.txt").stat().st_mode


class TestBadInput:
    @pytest.mark.parametrize("command", ["simulate", "design", "export"])
    @pytest.mark.parametrize(
        "change", [("0.010", "-1"), ('"resistor"', '"resister"'), ("50.6", "0"), ("[excitation]", "[[[")]
    )
    def test_study(self, study, refused, tmp_path, command, change):
        (tmp_path / study).write_text(STUDY.replace(*change))
        out = ("--out", "x.cir") if command == "export" else ()
        assert refused(command, study, *out).startswith("piezoharvest: error: study.toml: ")

    @pytest.mark.parametrize(
        "arguments",
        [
            (),
            ("simulat", "study.toml"),
            ("simulate",),
            ("simulate", "study.toml", "more"),
            ("simulate", "study.toml", "--jsn"),
            ("simulate", "study.toml", "--transient"),
            ("simulate", "study.toml", "--transient", "soon"),
            ("simulate", "study.toml", "--transient", "0"),
            ("simulate", "study.toml", "--transient", "-1"),
            ("simulate", "study.toml", "--transient", "nan"),
            ("simulate", "study.toml", "--transient", "inf"),
            ("simulate", "nowhere.toml"),
            ("simulate", "."),
            ("export", "study.toml"),
            ("export", "study.toml", "--format", "ltspice", "--out", "x.cir"),
            ("export", "study.toml", "--out", "nowhere/x.cir"),
            ("design", "study.toml", "--report", "study.toml"),
            ("design", "study.toml", "--report", "study.toml/below"),
            ("design", "nowhere.toml", "--report", "new/report"),
            ("identify", "nowhere.toml", "--report", "new/report"),
            ("diagnose", "study.toml", "--report", "new/report"),
            ("demo", "--out", "study.toml"),
        ],
    )
    def test_usage(self, study, refused, arguments):
        refused(*arguments)
        assert os.listdir() == ["study.toml"]

    def test_simulating_needs_shunts(self, study, refused, tmp_path):
        (tmp_path / study).write_text(STUDY[: STUDY.index("[[shunts]]")] + "[design]\n")
        assert "shunts: missing tables [[shunts]]" in refused("simulate", study)
        assert "shunts: missing tables [[shunts]]" in refused("export", study, "--out", "x.cir")


def heed_interrupts():
    """In a child: tests that run in the background hand on that Ctrl-C is ignored."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.parametrize("place", [0, 2, 4])
def test_quiet_says_warnings_alone(study, run, engine, place):
    rough = replace(response(), message="rough")
    engine(*[rough] * 4)
    arguments = ["simulate", study, "--out", "w.csv"]
    _, out, told = run(*arguments)
    status, same, err = run(*arguments[:place], "--quiet", *arguments[place:])
    assert (status, same) == (0, out)
    warnings = "warning: shunts.0 (resistor): rough\nwarning: shunts.1 (resistor): rough\n"
    assert (told, err) == (warnings + "waveforms: w.csv\n", warnings)


class TestProgram:
    """What only a process of its own shows."""

    @staticmethod
    def start(*arguments: str, closed: int | None = None, **options) -> subprocess.Popen:
        command = [sys.executable, "-m", "piezoharvest", *arguments]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        prepared = heed_interrupts if closed is None else partial(os.close, closed)
        return subprocess.Popen(command, preexec_fn=prepared, **pipes, **options)

    def test_help_loads_nothing_heavy(self):
        code = (
            "import sys\nfrom piezoharvest.cli import main\nassert main(['--help']) == 0\n"
            "heavy = {'control', 'h5py', 'matplotlib', 'numba', 'numpy', 'pyarrow', 'pydantic', 'scipy'}\n"
            "print(sorted(heavy & set(sys.modules)), file=sys.stderr)"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        assert done.stderr == "[]\n"
        for command in ("simulate", "design", "export", "demo", "--version"):
            assert command in done.stdout

    def test_version(self):
        process = self.start("--version")
        assert (process.communicate()[0], process.returncode) == (f"piezoharvest {__version__}\n", 0)

    @pytest.mark.parametrize(
        ("typed", "place", "completed"),
        [("si", "1", "simulate\n"), ("catalogue P-885.5", "2", "P-885.51\n"), ("catalogue PVD", "2", "PVDF\n")],
    )
    def test_a_shell_completes_commands_and_the_names_of_the_catalogue(self, typed, place, completed):
        words = {"_PIEZOHARVEST_COMPLETE": "complete_bash", "COMP_WORDS": f"piezoharvest {typed}", "COMP_CWORD": place}
        process = self.start(env={**os.environ, **words})
        assert (process.communicate(), process.returncode) == ((completed, ""), 0)

    def test_status_reaches_the_shell(self, tmp_path):
        process = self.start("simulate", "nowhere.toml", cwd=tmp_path)
        out, err = process.communicate()
        assert (process.returncode, out) == (2, "")
        assert err.startswith("piezoharvest: error: nowhere.toml: the file cannot be read (No such file or directory)")
        assert err.count("\n") == 1

    def test_reader_that_leaves(self, study):
        process = self.start("simulate", study, "--json")
        process.stdout.close()
        assert process.wait(timeout=300) == 141
        assert process.stderr.read() == ""
        process.stderr.close()

    @pytest.mark.parametrize("closed", [1, 2])
    def test_a_closed_stream_is_nothing_to_say(self, study, tmp_path, closed):
        process = self.start("simulate", study, "--out", "waves.csv", closed=closed)
        out, err = process.communicate()
        assert (process.returncode, out == "") == (0, closed == 1)
        assert err == ("" if closed == 2 else "waveforms: waves.csv\n")
        assert Path("waves.csv").read_text().startswith("shunt,kind,time_s")

    def test_interrupt(self, tmp_path):
        """Ctrl-C while compiled code runs: in the second of two long simulations, once the first has been told of."""
        skew = "[transducer.effects.channel_skew]\ndelay = 1e-3\n"
        # The first is its own reference for the attenuation, and so takes half as long.
        short = STUDY.replace('kind = "resistor"\nresistance = 8e4', 'kind = "short"')
        (tmp_path / "study.toml").write_text(short.replace("[excitation]", f"{skew}[excitation]"))
        ended = resource.getrusage(resource.RUSAGE_CHILDREN)
        process = self.start("simulate", "study.toml", "--transient", "5e3", cwd=tmp_path)
        assert process.stderr.readline().startswith("warning: shunts.0 (short): channel_skew: not part of a simulation")
        before = psutil.Process(process.pid).cpu_times()
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        # Processor time, of which a busy machine takes no more: the rest would have taken twice that.
        used = after.ru_utime - ended.ru_utime + after.ru_stime - ended.ru_stime
        assert used - before.user - before.system < 2.0
        assert (process.returncode, out, err) == (130, "", "piezoharvest: interrupted\n")

    def test_interrupt_while_arguments_are_read(self, run, monkeypatch):
        monkeypatch.setattr(piezoharvest.cli, "app", lambda *_, **__: 130)  # as typer has it
        assert run("simulate", "study.toml") == (130, "", "piezoharvest: interrupted\n")

    def test_interrupt_within_a_simulation(self, study, run, engine):
        engine(response(), KeyboardInterrupt())
        assert run("simulate", study, "--json", "--out", "w.csv") == (130, "", "piezoharvest: interrupted\n")
        assert os.listdir() == ["study.toml"]

    def test_own_failure_is_one_line(self, study, run, engine, monkeypatch):
        monkeypatch.delenv("PIEZOHARVEST_TRACEBACK", raising=False)
        engine(ZeroDivisionError("float division\nby zero"))
        status, out, err = run("simulate", study)
        assert (status, out) == (1, "")
        assert err.startswith(
            "piezoharvest: internal error, please report it: ZeroDivisionError: float division by zero"
        )
        monkeypatch.setenv("PIEZOHARVEST_TRACEBACK", "1")
        engine(ZeroDivisionError())
        with pytest.raises(ZeroDivisionError):
            main(["simulate", study])


@dataclass
class Designed:
    """Stand-in for a design's result."""

    converged: bool = True
    feasible: bool = True
    notes: list[str] = field(default_factory=list)

    def as_json(self):
        shunt = {"kind": "parallel_sshi", "dc_voltage": 5.0, "inductance": 0.1, "quality": 6.0, "diode_drop": None}
        values = {
            "harvested_power": 4.6e-4,
            "attenuation_db": -8.7,
            "gap_to_bound": np.nan,
            "converged": self.converged,
        }
        bound = {"harvested_power": 8e-4, "attenuation_db": None}
        return {"bound": bound, "candidates": [{"shunt": shunt, **values}], "best": 0, "trade_off": []}


class TestDesign:
    def test_json_is_the_interface(self, study, run):
        status, out, _ = run("design", study, "--json")
        data = strict(out)
        assert status == 0
        assert set(data) >= {"bound", "candidates", "best", "trade_off"}
        assert set(data["bound"]) >= {"harvested_power", "attenuation_db"}
        (candidate,) = data["candidates"]
        assert candidate["shunt"]["kind"] == "resistor"
        assert set(candidate) >= {"shunt", "harvested_power", "attenuation_db", "gap_to_bound", "converged"}
        # No interface draws more than F^2/(8 b).
        assert 0 < candidate["harvested_power"] <= 0.02**2 / (8 * 0.0628) * 1.001

    def test_report(self, study, run, tmp_path):
        with figures_on_the_page_only():
            status, out, _ = run("design", study, "--report", "report/here")
        assert status == 0
        assert "resistor" in out
        page = tmp_path / out.splitlines()[-1]
        assert page.suffix == ".html"
        assert page.is_relative_to(tmp_path / "report" / "here")
        assert "<html" in page.read_text().lower()

    def test_without_a_design_table_the_defaults_hold(self, study, run, tmp_path, monkeypatch):
        seen = []

        def design(study, progress=None):
            progress("tuning")
            seen.append(study.design)
            return Designed(notes=["needs a synthetic inductor"])

        monkeypatch.setattr(piezoharvest.design, "design", design, raising=False)
        (tmp_path / study).write_text(STUDY[: STUDY.index("[design]")])
        status, out, err = run("design", study)
        assert status == 0
        assert seen[0].objective == "harvest"
        assert err == "tuning\nwarning: needs a synthetic inductor\n"
        assert "inductance = 100.0 mH" in out
        assert "bound" in out
        assert "diode_drop" not in out

    @pytest.mark.parametrize("notes", [[], ["not converged at 51 Hz"]])
    def test_not_converged(self, study, run, monkeypatch, notes):
        result = Designed(converged=False, notes=notes)
        monkeypatch.setattr(piezoharvest.design, "design", lambda study, progress=None: result, raising=False)
        status, out, err = run("design", study, "--json")
        assert status == 1
        assert "converge" in err
        assert strict(out)["candidates"][0]["gap_to_bound"] is None

    def test_no_candidate_keeps_the_limits(self, study, run, monkeypatch):
        result = Designed(feasible=False, notes=["no candidate meets all limits"])
        monkeypatch.setattr(piezoharvest.design, "design", lambda study, progress=None: result, raising=False)
        status, out, err = run("design", study, "--json")
        assert (status, strict(out)["best"]) == (1, 0)
        assert err == "warning: no candidate meets all limits\n"

    def test_results_are_printed_even_if_the_report_fails(self, study, run, monkeypatch):
        def fail(study, result, folder):
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(piezoharvest.design, "design", lambda study, progress=None: Designed(), raising=False)
        monkeypatch.setattr(piezoharvest.report, "write_report", fail, raising=False)
        status, out, err = run("design", study, "--json", "--report", "r")
        assert (status, strict(out)["best"]) == (2, 0)
        assert err.startswith("piezoharvest: error: ")
        assert "No space left" in err

    def test_json_stays_alone_on_stdout_with_a_report(self, study, run, tmp_path, monkeypatch):
        monkeypatch.setattr(piezoharvest.design, "design", lambda study, progress=None: Designed(), raising=False)
        page = tmp_path / "r" / "index.html"
        monkeypatch.setattr(piezoharvest.report, "write_report", lambda study, result, folder: page, raising=False)
        status, out, err = run("design", study, "--json", "--report", "r")
        assert status == 0
        assert strict(out)["best"] == 0
        assert str(page) in err


class TestExport:
    def test_netlist(self, study, run, tmp_path):
        status, out, err = run("export", study, "--format", "spice", "--out", "study.cir")
        assert (status, out) == (0, "study.cir\n")
        assert "only shunts.0 (resistor) of 2 shunts is written" in err
        text = (tmp_path / "study.cir").read_text()
        assert text.rstrip().lower().endswith(".end")
        assert "bench harvester" in text.splitlines()[0]
        assert sorted(os.listdir(tmp_path)) == ["study.cir", "study.toml"]

    def test_another_shunt(self, study, run, refused, tmp_path):
        assert run("export", study, "--out", "first.cir", "--shunt", "0") == (0, "first.cir\n", "")
        assert run("export", study, "--out", "second.cir", "--shunt", "1") == (0, "second.cir\n", "")
        assert (tmp_path / "first.cir").read_text() != (tmp_path / "second.cir").read_text()
        assert "shunts.2: the study has no such shunt, --shunt may be 0 to 1" in refused(
            "export", study, "--out", "x", "--shunt", "2"
        )
        refused("export", study, "--out", "x", "--shunt", "-1")

    def test_a_run_from_rest_is_told(self, study, run, tmp_path):
        """A supply begins with an empty store, and at the end of the run it is not what `simulate` finds."""
        shunt = 'kind = "rectifier"\nsmoothing_capacitance = 1e-6\nload_resistance = 1e5\n'
        store = "storage = { turn_on = 5.0, turn_off = 3.6, power = 1e-6 }\n"
        head = STUDY[: STUDY.index("[[shunts]]")]
        (tmp_path / study).write_text(f"{head}[[shunts]]\n{shunt}{store}[[shunts]]\n{shunt}")
        status, out, err = run("export", study, "--out", "first.cir", "--shunt", "0")
        assert (status, out) == (0, "first.cir\n")
        assert "shunts.0 (rectifier): the netlist starts from rest, not in the steady state" in err
        assert run("export", study, "--out", "second.cir", "--shunt", "1") == (0, "second.cir\n", "")

    def test_schematic(self, study, run, refused, tmp_path):
        """The name says for which program it is; read back, it is told from a netlist."""
        assert run("export", study, "--out", "s.asc", "--shunt", "1", "--dialect", "ltspice")[0] == 0
        assert run("export", study, "--out", "t.ASC", "--shunt", "1")[0] == 0
        assert (tmp_path / "s.asc").read_text() == (tmp_path / "t.ASC").read_text()
        assert (tmp_path / "s.asc").read_text().startswith("Version 4\nSHEET 1 ")
        wrong = refused("export", study, "--out", "x.asc", "--dialect", "ngspice")
        assert "--dialect: found ngspice, but a schematic (.asc) is for LTspice" in wrong.replace("'", "")
        told = "s.asc: found a schematic of LTspice, must be a netlist: export its netlist from LTspice"
        assert told in refused("import", "s.asc")
        (tmp_path / "u.asc").write_bytes((tmp_path / "s.asc").read_text().replace("\n", "\r\n").encode("utf-16"))
        assert "u.asc: found a schematic of LTspice" in refused("import", "u.asc")

    def test_without_ngspice_nothing_is_checked(self, study, run, monkeypatch):
        monkeypatch.setenv("PATH", "/nowhere")
        status, out, err = run("export", study, "--out", "s.cir", "--shunt", "0", "--check")
        assert (status, out) == (1, "s.cir\n")
        assert "shunts.0 (resistor): not checked: ngspice is not on the PATH" in err

    def test_what_cannot_be_exported_leaves_the_old_file(self, study, refused, tmp_path, monkeypatch):
        def export(transducer, shunt, excitation, **options):
            raise ParameterError("excitation.kind", "found 'record', must be a periodic one")

        monkeypatch.setattr(piezoharvest.spice, "export_spice", export, raising=False)
        (tmp_path / "study.cir").write_text("old")
        assert "found 'record', must be a periodic one" in refused("export", study, "--out", "study.cir")
        assert (tmp_path / "study.cir").read_text() == "old"


class TestDemo:
    def test_default_directory(self, run, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        folders = []
        result, story = Designed(), SimpleNamespace(converged=True)
        monkeypatch.setattr(piezoharvest.design, "design", lambda study, progress=None: result, raising=False)
        monkeypatch.setattr(piezoharvest.demo.story, "tell", lambda study, bench, first, folder, progress: story)
        monkeypatch.setattr(piezoharvest.demo.page, "answer", lambda told: "what it says")

        def report(*what):
            folders.append(str(what[-1]))
            return what[-1] / "report.html"

        monkeypatch.setattr(piezoharvest.report, "write_report", report, raising=False)
        monkeypatch.setattr(piezoharvest.demo.page, "write_story", report)
        status, out, _ = run("demo")
        base = "piezoharvest-demo"
        assert (status, out.splitlines()[-2:]) == (0, ["what it says", os.path.join(base, "report.html")])
        assert folders == [os.path.join(base, "design"), base]
        story.converged = False
        assert run("demo")[0] == 1
