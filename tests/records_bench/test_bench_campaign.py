"""The bench as a user meets it: [bench] and its mistakes, the folder that `measure` writes, and that it is whole."""

import json
import os
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from bench_runs import LOAD, SINE, STACK, study, tables
from messages import is_sentence
from studies import BENCH, DRIVE, solve

import piezoharvest.bench.writing as writing
from piezoharvest import progress
from piezoharvest.bench import measure, write_campaign
from piezoharvest.bench.sensors import channels
from piezoharvest.cli import main
from piezoharvest.identify import identify
from piezoharvest.output import OutputError
from piezoharvest.records import load_campaign
from piezoharvest.records.power import analyse
from piezoharvest.study import build_transducer, load_study

PAPER = Path(__file__).parents[2] / "designs" / "paper_campaign" / "study.toml"


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Write a study into the working directory and measure it into `out`; status, stdout, stderr."""
    monkeypatch.chdir(tmp_path)

    def call(table, out="out"):
        (tmp_path / "study.toml").write_text(tomli_w.dumps(table))
        status = main(["measure", "study.toml", "--out", out])
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return status, captured.out, captured.err

    return call


def read(folder):
    return load_campaign(Path(folder) / "campaign.toml")


@pytest.mark.parametrize(
    "shunt",
    [
        {"kind": "network", "netlist": "R1 1 2 1k\nL1 2 0 10\nR2 1 0 50k load"},
        {"kind": "self_powered_ssdi", "inductance": 0.1, "quality": 6, "envelope_capacitance": 1e-9, "threshold": 0.6},
        {"kind": "spice", "netlist": "* rc\nR1 p a 1k\nC1 a 0 10n", "load": ["r1"]},
    ],
    ids=lambda table: table["kind"],
)
def test_a_record_has_the_circuit_that_was_measured(run, shunt):
    status, out, _ = run(tables(DRIVE, shunt, BENCH, duration=0.1, laser={"sensitivity": 1e4}))
    assert (status, out) == (0, "out/campaign.toml\n")
    (wanted,), (found,) = load_study("study.toml").shunts, read("out").records
    assert found.shunt == wanted


QUIET = {"sample_rate": 5e3, "load_cell": {"sensitivity": 100.0, "noise": 2e-5}, "laser": {"sensitivity": 1e4},
         "buffer": {"gain": 0.2}, "dc_meter": {"gain": 0.2}}  # fmt: skip
HARVESTERS = {
    "mppt": {"kind": "mppt", "fraction": 0.4, "diode_drop": 0.2},
    "spice": {
        "kind": "spice", "load": ["R1"], "netlist": "* half-wave\n.model d D(Ron=10 Roff=1g Vfwd=0.1)\nD1 p dc d\n"
        "D2 0 p d\nC1 dc 0 0.1u\nR1 dc 0 200k",
    },
}  # fmt: skip


@pytest.mark.parametrize("kind", HARVESTERS)
def test_a_record_of_a_tracker_or_of_a_netlist_is_identified(run, kind):
    channels = ["displacement", "voltage", "current", "dc_voltage"]
    records = [{}, {"excitation": {"frequency": 49.0}, "role": "validate"}]
    table = tables(
        DRIVE, HARVESTERS[kind], BENCH, duration=0.5, nominal_error=0.05, channels=channels, records=records, **QUIET
    )
    assert run(table)[0] == 0
    if kind == "mppt":
        shunt, wanted = read("out").records[0].shunt, solve(table).dc_voltage
        assert (shunt.kind, shunt.diode_drop) == ("rectifier", 0.2)
        assert shunt.dc_voltage == pytest.approx(wanted, rel=2e-7)  # the buffers take 1e-7 of it
    found = identify(read("out"))
    for each in found.estimates:
        wanted = BENCH[each.parameter.path[-1]]
        assert abs(each.value - wanted) < 4 * each.std < 0.02 * wanted


def test_a_circuit_of_which_no_campaign_has_a_record_is_warned_of(run):
    digital = {"kind": "digital", "numerator": [1.0], "denominator": [250.0, 1.6e4], "sample_time": 1e-4}
    status, _, err = run(tables(DRIVE, digital, BENCH, duration=0.1, laser={"sensitivity": 1e4}))
    assert status == 0
    assert "no campaign may have a record of digital, whose clock no record shows, allowed are circuits" in err


def test_a_long_record_tells_how_far_it_is(monkeypatch):
    monkeypatch.setattr(progress, "EVERY", 0.0)
    said = []
    measure(study(duration=0.01), said.append)
    steps = [step for step in said if step.startswith("record 1 of 1: sine_force, resistor: ")]
    assert any(0 < step.done < step.total and step.line.endswith(" left") for step in steps)


def test_what_is_written_is_what_was_measured(run, tmp_path):
    status, out, err = run(tables(duration=0.5, truth=True))
    assert (status, out) == (0, "out/campaign.toml\n")
    assert err == "record 1 of 1: sine_force, resistor\n"
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "campaign.toml", "truth.json", "01_sine_force_resistor.csv",
    }  # fmt: skip
    header = (tmp_path / "out" / "01_sine_force_resistor.csv").read_text().partition("\n")[0]
    assert header == "time_s,force_N,displacement_m,voltage_V,current_A"
    wanted = measure(load_study("study.toml")).records[0]
    found = np.loadtxt("out/01_sine_force_resistor.csv", delimiter=",", skiprows=1)
    assert np.array_equal(found.T, np.array(list(wanted.columns.values())))
    assert len(found) == 500

    table = tomllib.loads((tmp_path / "out" / "campaign.toml").read_text())
    assert {key: table["transducer"][key] for key in STACK} == STACK
    (entry,) = table["records"]
    assert entry["load_resistance"] == LOAD["resistance"]
    assert entry["drive"] == "force"
    assert set(table["channels"]) == {"force", "displacement", "voltage", "current"}
    truth = json.loads((tmp_path / "out" / "truth.json").read_text())
    assert truth["transducer"]["coupling"] == STACK["coupling"]
    assert truth["records"][0]["excitation"] == SINE


def test_a_campaign_reads_it_without_complaint(run):
    records = [
        {"load_resistance": 5e4, "role": "validate"},
        {"shunt": {"kind": "open"}, "excitation": {"frequency": 2.0}},
        {"shunt": {"kind": "rectifier", "smoothing_capacitance": 1e-5, "load_resistance": 1e5}},
        {"excitation": {"kind": "sine_base", "amplitude": 50.0, "frequency": 10.0}},
    ]
    assert run(tables(duration=2.0, records=records))[0] == 0
    campaign = read("out")
    assert [record.role for record in campaign.records] == ["validate", "fit", "fit", "fit"]
    assert [record.shunt.kind for record in campaign.records] == ["resistor", "open", "rectifier", "resistor"]
    assert not campaign.errors


def test_the_truth_is_told_on_request_only(run, tmp_path):
    effects = {"leakage": {"resistance": 3e5}}
    assert run(tables(duration=0.5, effects=effects, nominal_error=0.1))[0] == 0
    assert not (tmp_path / "out" / "truth.json").exists()
    text = (tmp_path / "out" / "campaign.toml").read_text()
    assert "leakage" not in text
    assert str(STACK["coupling"]) not in text
    nominal, true = read("out").transducer, build_transducer(STACK)
    for key in ("mass", "damping", "stiffness", "coupling", "capacitance"):
        assert 0 < abs(getattr(nominal, key) / getattr(true, key) - 1) < 0.5
    assert run(tables(duration=0.5, effects=effects, nominal_error=0.1, truth=True))[0] == 0
    assert json.loads((tmp_path / "out" / "truth.json").read_text())["effects"] == effects


def test_channels_of_a_circuit(run, tmp_path):
    """Those that it has; the shunt's table is what its label says, whatever is wrong with it."""
    bridge = {"kind": "parallel_sshi", "inductance": 0.1, "quality": 5.0, "smoothing_capacitance": 1e-6}
    names = ["displacement", "velocity", "acceleration", "voltage", "dc_voltage", "dc_current", "gate"]
    bench = {
        "sample_rate": 20000.0, "duration": 0.12, "channels": names, "effects": {"inversion_loss": {"quality": 3.0}},
        "converter": {"bits": 32, "range": 100.0}, "truth": True,
        "records": [{"shunt": {**bridge, "load_resistance": 1e6}}, {"load_resistance": 8e4}],
    }  # fmt: skip
    for device in ("laser", "buffer", "vibrometer", "moving_accelerometer", "dc_meter", "dc_sense"):
        bench[device] = {"noise": 0.0}
    bench["laser"]["resolution"] = 0.0
    assert run(tables(DRIVE, LOAD, BENCH, **bench))[0] == 0
    table = tomllib.loads((tmp_path / "out" / "campaign.toml").read_text())
    assert set(table["channels"]) == {"force", *names}
    assert table["channels"]["gate"] == {"column": "gate"}
    assert table["channels"]["acceleration"]["column"] == "acceleration_m_s2"
    first, second = table["records"]
    assert first["shunt"]["quality"] == 5.0
    truth = json.loads((tmp_path / "out" / "truth.json").read_text())
    assert truth["records"][0]["shunt"]["quality"] == 3.0
    files = [tmp_path / "out" / record["file"] for record in (first, second)]
    switched, resistor = (np.genfromtxt(path, delimiter=",", names=True) for path in files)
    assert set(resistor.dtype.names) == {
        "time_s", "force_N", "displacement_m", "voltage_V", "velocity_m_s", "acceleration_m_s2",
    }  # fmt: skip
    step = 1.0 / 20000.0
    for rate, value in (("velocity_m_s", "displacement_m"), ("acceleration_m_s2", "velocity_m_s")):
        central = (resistor[value][2:] - resistor[value][:-2]) / (2 * step)
        assert central == pytest.approx(resistor[rate][1:-1], abs=1e-3 * np.abs(resistor[rate]).max())
    assert switched["dc_current_A"] == pytest.approx(switched["dc_voltage_V"] / 1e6, abs=1e-9)
    # The switch closes where the velocity crosses zero.
    closing = np.flatnonzero(np.diff(switched["gate"]) > 0)
    assert len(closing) > 8
    assert np.all(switched["velocity_m_s"][closing] * switched["velocity_m_s"][closing + 1] <= 0)
    assert set(switched["gate"]) == {0.0, 1.0}


def test_nominal_errors_have_the_spread_that_was_asked_for():
    true = build_transducer(STACK)
    draws = [measure(study(duration=0.01, nominal_error=0.1, seed=seed)).nominal for seed in range(60)]
    logs = np.log([[d.mass / true.mass, d.coupling / true.coupling, d.hysteresis.weights[1] / 1.5e6] for d in draws])
    assert logs.std(axis=0) == pytest.approx(0.1, rel=0.3)
    assert np.abs(np.corrcoef(logs.T) - np.eye(3)).max() < 0.4


def test_effects_of_the_study_are_known_to_the_campaign(run):
    leaky = {**STACK, "effects": {"leakage": {"resistance": 3e5}}}
    assert run(tables(SINE, LOAD, leaky, duration=0.5))[0] == 0
    assert read("out").transducer.effects[0].resistance == 3e5
    hidden = measure(study(duration=0.5, effects=leaky["effects"]))
    known = measure(study(SINE, LOAD, leaky, duration=0.5))
    assert np.array_equal(hidden.records[0].columns["voltage_V"], known.records[0].columns["voltage_V"])


@pytest.fixture(scope="module")
def paper():
    """The paper's campaign and the seconds that it took."""
    start = time.process_time()
    return measure(load_study(PAPER)), time.process_time() - start


@pytest.mark.slow
def test_the_papers_campaign_is_one_study(paper):
    """Three loads, steps and sines of 1 to 5 Hz, 0.5 to 1.25 kN, eight records of ten seconds at 1 kHz."""
    campaign, seconds = paper
    assert seconds < 20.0
    assert len(campaign.records) == 8
    assert all(len(record.columns["time_s"]) == 10_000 for record in campaign.records)
    assert not any(record.warnings for record in campaign.records)
    assert {record.setup.shunt.resistance for record in campaign.records} == {51.43e3, 97.78e3, 143.8e3}
    assert {record.setup.role for record in campaign.records} == {"fit", "validate"}
    sines = [record.setup.excitation for record in campaign.records if record.setup.excitation.kind == "sine_force"]
    assert [sine.frequency for sine in sines] == [1.0, 2.0, 3.0, 4.0, 5.0]
    peaks = {round(record.waves.drive.max()) for record in campaign.records}
    assert peaks == {500, 750, 1000, 1250}
    assert all(record.waves.drive.min() > 99.999 for record in campaign.records)


@pytest.mark.parametrize("frequency", [1.0, 5.0])
def test_the_papers_readme_says_what_comes_out(paper, frequency):
    """Energies of its table; and what the paper's table IV has is what goes in and out over the whole record."""
    text = (PAPER.parent / "README.md").read_text(encoding="utf-8")
    assert "piezoharvest measure designs/paper_campaign/study.toml" in text
    (record,) = [r for r in paper[0].records if getattr(r.setup.excitation, "frequency", 0) == frequency]
    sigma = {name: line.sigma(paper[0].bench.converter) for name, line in channels(paper[0].bench, base=False).items()}
    found = analyse(*record.columns.values(), frequency=frequency, sigma=sigma)
    mechanical, electrical, count = found.mechanical, found.electrical, len(found.boundaries) - 1
    net, std = 1e6 * mechanical.record.net[0] / count, 1e6 * mechanical.record.net_std[0] / count
    swung = 1e3 * (mechanical.record.supplied + mechanical.record.returned)[0]
    wanted = {1.0: (f"{net:.0f} ± {std:.0f} µJ", 31.1), 5.0: (f"{net:.1f} ± {std:.1f} µJ", 155.6)}[frequency]
    harvested = 1e6 * electrical.cycles.net[1:].mean()
    for figure in (wanted[0], f"{harvested:#.3g} µJ", f"{1e3 * mechanical.cycles.supplied[1:].mean():.2f} mJ"):
        assert figure in text
    assert f"{swung:.0f} mJ" in text
    assert swung == pytest.approx(wanted[1], rel=0.05)


def test_a_record_that_overrides_part_of_the_excitation(tmp_path, monkeypatch):
    """Keys of the study's excitation stay; its file is found wherever the program runs."""
    (tmp_path / "drive.csv").write_text("f\n" + "\n".join(str(v) for v in np.sin(np.arange(200) / 9.0) * 300))
    monkeypatch.chdir(tmp_path.parent)
    drive = {"kind": "record", "file": "drive.csv", "column": "f", "sample_rate": 100.0}
    path = tmp_path / "study.toml"
    path.write_text(tomli_w.dumps(tables(drive, records=[{"excitation": {"sample_rate": 200.0}}, {}])))
    fast, slow = measure(load_study(os.path.relpath(path))).records
    assert len(slow.columns["time_s"]) == 1990
    assert np.allclose(fast.waves.drive[::5], slow.waves.drive[::10], atol=1e-9)


RECORD = "bench.records.0"
WRONG = {
    "sample_rat": ({"sample_rat": 5.0}, "bench.sample_rat: unknown key (did you mean 'sample_rate'?)"),
    "negative rate": ({"sample_rate": -5.0}, "bench.sample_rate: found -5.0, must be a finite number greater "),
    "not a number": ({"sample_rate": "fast"}, "bench.sample_rate: found 'fast', must be a finite number"),
    "nan": ({"duration": float("nan")}, "bench.duration: found nan, must be a finite number"),
    "bits": ({"converter": {"bits": 16.5}}, "bench.converter.bits: found 16.5, must be a whole number at least 4"),
    "sensor": ({"laser": 5}, "bench.laser: found 5, must be a table"),
    "effect": ({"effects": {"leak": {}}}, "bench.effects.leak: unknown effect, known effects are bias_current, "),
    "effects": ({"effects": 3}, "bench.effects: found 3, must be a table for each effect"),
    "parameter": ({"effects": {"leakage": {}}}, "bench.effects.leakage.resistance: missing key"),
    "channel": (
        {"effects": {"clipping": {"limit": 1.0, "channel": "x"}}},
        "bench.effects.clipping.channel: found 'x', must be 'force' or ",
    ),
    "short": ({"duration": 0.001}, "shunts.0.duration: found 0.001 s at 1000 Hz, which is less than the three samples"),
    "long": ({"duration": 1e9}, "shunts.0.duration: found 1e+09 s at 1000 Hz, 1e+12 samples, allowed are up to 1000"),
    "twice": ({"records": [{"load_resistance": 1e4, "shunt": LOAD}]}, f"{RECORD}.shunt: load_resistance is given too"),
    "role": ({"records": [{"role": "test"}]}, f"{RECORD}.role: found 'test', must be 'fit' or 'validate'"),
    "kind": ({"records": [{"excitation": {"kind": "sine"}}]}, f"{RECORD}.excitation.kind: found 'sine'"),
    "small": ({"records": [{"load_resistance": 50.0}]}, f"{RECORD}.resistance: found 50 ohm, must be at least "),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_key_is_one_sentence(run, tmp_path, case):
    bench, message = WRONG[case]
    status, out, err = run(tables(**{"duration": 0.1, **bench}))
    assert (status, out) == (2, "")
    assert err.startswith(f"piezoharvest: error: study.toml: {message}")
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_effects_given_twice(run):
    effects = {"leakage": {"resistance": 1e5}}
    status, _, err = run(tables(SINE, LOAD, {**STACK, "effects": effects}, effects=effects))
    assert status == 2
    assert "bench.effects.leakage: transducer.effects.leakage is given too" in err


def test_what_cannot_be_solved_is_said_and_nothing_is_written(run, tmp_path):
    effects = {"voltage_dependent_capacitance": {"beta": -1.0}}
    status, out, err = run(tables(duration=0.5, effects=effects))
    assert (status, out) == (1, "")
    assert "record 1 (sine_force, resistor): no step is short enough at 0." in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("there", ["file", "other files", "no parent"])
def test_only_an_own_folder_is_replaced(run, tmp_path, there):
    out = tmp_path / "out"
    if there == "file":
        out.write_text("mine")
    elif there == "other files":
        out.mkdir()
        (out / "thesis.csv").write_text("mine")
    else:
        (tmp_path / "above").write_text("mine")
        out = tmp_path / "above" / "out"
    status, stdout, err = run(tables(duration=0.1), str(out))
    assert (status, stdout) == (2, "")
    assert is_sentence(err.strip())
    mine = {"file": out, "other files": out / "thesis.csv", "no parent": tmp_path / "above"}[there]
    assert mine.read_text() == "mine"


def test_an_earlier_campaign_is_replaced_as_a_whole(run, tmp_path):
    (tmp_path / "out").mkdir()  # an empty one will do
    assert run(tables(duration=0.1, truth=True, records=[{}, {}]))[0] == 0
    assert run(tables(duration=0.2))[0] == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"campaign.toml", "01_sine_force_resistor.csv"}
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_a_failed_run_leaves_what_was_there(tmp_path, monkeypatch):
    campaign = measure(study(duration=0.1, records=[{}, {}]))
    write_campaign(campaign, tmp_path / "out")
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    real = writing.write_table

    def full(columns, path):
        if path.name.startswith("02"):
            raise OSError(28, "No space left on device")
        real(columns, path)

    monkeypatch.setattr(writing, "write_table", full)
    for target in (tmp_path / "out", tmp_path / "new"):
        with pytest.raises(OutputError, match="cannot be written"):
            write_campaign(campaign, target)
    assert {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before
    assert {path.name for path in tmp_path.iterdir()} == {"out"}


@pytest.mark.parametrize("when", ["it integrates", pytest.param("it writes", marks=pytest.mark.slow)])
def test_a_killed_run_leaves_nothing_half_written(tmp_path, when):
    """There is no campaign, or the whole one."""
    seconds = 2.0 if when == "it integrates" else 8.0  # of which there is the more to write
    (tmp_path / "study.toml").write_text(tomli_w.dumps(tables(duration=seconds, records=[{}] * 6)))
    command = [sys.executable, "-m", "piezoharvest", "measure", "study.toml", "--out", "out"]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    last = "record 3" if when == "it integrates" else "record 6"
    while not process.stderr.readline().startswith(last):
        pass
    while when == "it writes" and not list(tmp_path.glob(".out.*/*.csv")) and process.poll() is None:
        time.sleep(0.001)
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stderr.close()
    if (tmp_path / "out").exists():
        assert when == "it writes"  # and was quicker than the signal
        assert len(read(tmp_path / "out").records) == 6
