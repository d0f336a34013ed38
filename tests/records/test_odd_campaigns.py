"""What nobody would write into a campaign on purpose: wrong types, sizes and names are one sentence each."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from datetime import date

import numpy as np
import pytest
import tomli_w
from messages import is_sentence
from record_cases import stack_sine

from piezoharvest.cli.on_campaigns.running import on_campaign
from piezoharvest.output import write_table
from piezoharvest.readers.conversion import unit_factor
from piezoharvest.records import CampaignError, load_campaign
from piezoharvest.study import StudyError

NAMES = {"time": "time_s", "force": "force_N", "displacement": "displacement_m", "voltage": "voltage_V",
         "current": "current_A"}  # fmt: skip
STACK = {"mass": 0.0158, "damping": 1250.0, "stiffness": 3.125e8, "capacitance": 3.2e-6, "coupling": 7.822}


@pytest.fixture
def columns():
    of, _ = stack_sine()
    return {name: of[channel] for channel, name in NAMES.items()}


def rich(**record):
    """A campaign with nearly every key, as tables."""
    return {
        "title": "bench",
        "transducer": {**STACK, "hysteresis": {"thresholds": [1e-7, 3e-7], "weights": [5e5, 1.5e6]}},
        "channels": {
            "time": {"column": "time_s", "unit": "s"},
            "displacement": {"column": "displacement_m", "unit": "m", "sigma": 1.2e-8},
            "voltage": {"column": 4, "gain": 1.0, "offset": 0.0, "file": "run.csv"},
        },
        "records": [
            {"file": "run.csv", "role": "fit", "drive": "force", "load_resistance": 97780.0, "sample_rate": 1000.0,
             "start_time": 0.0, "rows": [2, 1001], "channels": {"force": {"column": "force_N"}}, **record},
            {"file": "run.csv", "role": "validate", "shunt": {"kind": "resistor", "resistance": 97780.0}},
        ],
    }  # fmt: skip


def failure(folder, tables):
    """What is said of a campaign; None where it is accepted."""
    (folder / "campaign.toml").write_text(tomli_w.dumps(tables), encoding="utf-8")
    try:
        load_campaign(folder / "campaign.toml")
    except CampaignError as error:
        text = str(error)
        assert text.startswith(str(folder))
        assert is_sentence(text)
        assert "\n" not in text
        assert len(text) < 1500
        return text
    return None


def places(table, path=()):
    """Paths of all values of a table."""
    for key, value in table.items() if isinstance(table, dict) else enumerate(table):
        yield (*path, key)
        if isinstance(value, dict | list):
            yield from places(value, (*path, key))


WRONG = [[], True, 10**400, float("nan"), date(2026, 1, 1), [[1], "a", {}], "x" * 100_000, "a\0b"]


@pytest.mark.parametrize("wrong", WRONG, ids=lambda wrong: repr(wrong)[:12])
def test_a_wrong_value_at_any_key(tmp_path, columns, wrong):
    """Each is accepted or refused in one sentence; of a value that is no table, no number and no text, most are."""
    write_table({name: values[:1000] for name, values in columns.items()}, tmp_path / "run.csv")
    refused = 0
    paths = list(places(rich()))
    for path in paths:
        tables = rich()
        table = tables
        for key in path[:-1]:
            table = table[key]
        table[path[-1]] = wrong
        refused += failure(tmp_path, tables) is not None
    assert refused >= 0.8 * len(paths)


class TestPaths:
    """Only ordinary files are read: others may never end, or keep their reader waiting."""

    @pytest.mark.parametrize(
        ("name", "found"),
        [("pipe.csv", "a pipe"), ("endless.csv", "a device"), ("folder.csv", "found a directory"),
         ("loop.csv", "symbolic"), ("a\0b.csv", "not a file name"), ("a" * 300 + ".csv", "too long"),
         ("gone.csv", "No such file")],
    )  # fmt: skip
    def test_data_files(self, tmp_path, name, found):
        os.mkfifo(tmp_path / "pipe.csv")
        (tmp_path / "endless.csv").symlink_to("/dev/zero")
        (tmp_path / "folder.csv").mkdir()
        (tmp_path / "loop.csv").symlink_to("loop.csv")
        assert found in failure(tmp_path, rich(file=name))

    @pytest.mark.parametrize("command", ["identify", "simulate"])
    def test_commands(self, tmp_path, command):
        os.mkfifo(tmp_path / "pipe.toml")
        run = [sys.executable, "-m", "piezoharvest", command, "pipe.toml"]
        found = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, timeout=60)
        assert found.returncode == 2
        assert found.stderr == "piezoharvest: error: pipe.toml: found a pipe, not a file\n"

    def test_a_key_of_very_many_parts(self, tmp_path):
        (tmp_path / "campaign.toml").write_text("a" + ".a" * 20_000 + " = 1\n")
        begin = time.monotonic()
        with pytest.raises(CampaignError, match="a key of more than 100 parts"):
            load_campaign(tmp_path / "campaign.toml")
        assert time.monotonic() - begin < 5


class TestSizes:
    @pytest.mark.parametrize("channel", NAMES)
    @pytest.mark.parametrize("size", [1e300, 1e200, -1e38, 1e-200])
    def test_samples(self, tmp_path, columns, channel, size):
        """Float32 and many instruments write their largest number for none."""
        name = NAMES[channel]
        columns[name] = columns[name] * size / np.max(np.abs(columns[name]))
        write_table(columns, tmp_path / "run.npz")
        text = failure(tmp_path, {"transducer": STACK, "records": [{"file": "run.npz", "load_resistance": 97780.0}]})
        assert f"run.npz: {channel}, rows" in text
        assert "allowed are 0, or sizes from 1e-30 to 1e+30" in text

    def test_one_sample(self, tmp_path, columns):
        columns["voltage_V"] = columns["voltage_V"].copy()
        columns["voltage_V"][7] = 9.9e37  # what SCPI instruments say of an overload
        write_table(columns, tmp_path / "run.csv")
        text = failure(tmp_path, {"transducer": STACK, "records": [{"file": "run.csv", "load_resistance": 97780.0}]})
        assert "run.csv: voltage, row 9: found 1 value such as 9.9e+37, allowed are 0, or sizes" in text

    @pytest.mark.parametrize(
        ("key", "size"),
        [*((key, size) for key in STACK for size in (1e308, 1e200)), *((key, 5e-324) for key in ("mass", "stiffness"))],
    )
    def test_nominal_values(self, tmp_path, key, size):
        text = failure(tmp_path, {"transducer": {**STACK, key: size}, "records": [{"file": "run.csv"}]})
        assert f"transducer.{key}: found {size:g}, must have a magnitude " in text

    @pytest.mark.parametrize("error", [np.linalg.LinAlgError("no eigenvalues"), OverflowError("too large")])
    def test_nominal_values_that_no_arithmetic_stands(self, tmp_path, columns, error):
        def run(campaign, tell):
            raise error

        write_table(columns, tmp_path / "run.csv")
        tables = {"transducer": STACK, "records": [{"file": "run.csv", "load_resistance": 97780.0}]}
        assert failure(tmp_path, tables) is None
        with pytest.raises(
            StudyError, match=r"transducer: the records cannot be computed with these nominal values \(.*\), check"
        ):
            on_campaign(tmp_path / "campaign.toml", None, None, run)

    @pytest.mark.parametrize("key", ["gain", "offset", "sigma"])
    def test_channels(self, tmp_path, key):
        text = failure(tmp_path, {**rich(), "channels": {"voltage": {key: 1e308}}})
        assert f"channels.voltage.{key}: found 1e+308, must have a magnitude " in text


class TestUnits:
    @pytest.mark.parametrize(
        ("unit", "si", "factor"),
        [("kN", "N", 1e3), ("lbf", "N", 4.4482216152605), ("µm", "m", 1e-6), ("m/s**2", "m/s^2", 1), ("%", "", 0.01),
         ("mm s^-2", "m/s^2", 1e-3), ("m·s⁻²", "m/s^2", 1), ("g_0", "m/s^2", 9.80665), ("rpm", "Hz", 1 / 60),
         ("(um)/(kN)", "(m)/(N)", 1e-9), ("kg*m/s²", "N", 1), ("meter per second ** 2", "m/s^2", 1), ("1/s", "Hz", 1)],
    )  # fmt: skip
    def test_what_is_a_unit(self, unit, si, factor):
        assert unit_factor(unit, si) == pytest.approx(factor, rel=1e-12)

    @pytest.mark.parametrize(
        "unit",
        ["10**1000000000 N", "N**9**9**9**9", "2**9**9**9**9 N", "(((9 N)**9)**9)**9", "N" + " squared" * 6, "N" * 100,
         "N*" * 30, "a" * 60 + "]", "(1)" * 20 + "]", "1e-3000 N", "nan", "inf N", "0 N", "N\0", "__import__('os')"],
    )  # fmt: skip
    def test_what_is_none_is_said_at_once(self, tmp_path, unit):
        unit_factor("kN", "N")  # pint is there
        begin = time.monotonic()
        text = failure(tmp_path, {**rich(), "channels": {"force": {"unit": unit}}})
        assert "channels.force.unit: found " in text
        assert time.monotonic() - begin < 2

    @pytest.mark.parametrize("unit", ["dB", "nan", "degC"])
    def test_of_pure_numbers(self, unit):
        with pytest.raises(ValueError, match="must be a unit"):
            unit_factor(unit, "rad")
