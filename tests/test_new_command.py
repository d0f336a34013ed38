"""`piezoharvest new`: what it writes runs as it is, and says of the user's files what they tell."""

from __future__ import annotations

import subprocess
import tomllib

import h5py
import numpy as np
import pyarrow as pa
import pytest
from messages import is_sentence
from pyarrow import parquet
from scipy.io import savemat, wavfile
from scipy.signal import StateSpace, butter, chirp, lsim, sosfilt

from piezoharvest import System, load_study, simulate
from piezoharvest.cli import main
from piezoharvest.identify.identification import identify
from piezoharvest.readers import registered
from piezoharvest.records import load_campaign
from piezoharvest.records.recognition.files import look_into
from piezoharvest.records.recognition.rough_values import rough_values, rough_values_of_response

MASS, DAMPING, STIFFNESS, COUPLING, CAPACITANCE, LOAD = 0.01, 0.19, 986.96, 1e-3, 40e-9, 1e5
TRUE = {"mass": MASS, "damping": DAMPING, "stiffness": STIFFNESS, "coupling": COUPLING, "capacitance": CAPACITANCE}
RATE, COUNT = 2000.0, 6000


@pytest.fixture(scope="module")
def measured():
    """Force, displacement, voltage and current on a resistor under noise, by SciPy, with 0.1 % of noise in each."""
    rng = np.random.default_rng(11)
    time = np.arange(COUNT) / RATE
    force = 0.02 * sosfilt(butter(4, [20, 200], "bandpass", fs=RATE, output="sos"), rng.normal(size=COUNT))
    A = [[0, 1, 0], [-STIFFNESS / MASS, -DAMPING / MASS, COUPLING / MASS],
         [0, -COUPLING / CAPACITANCE, -1 / (LOAD * CAPACITANCE)]]  # fmt: skip
    _, states, _ = lsim(StateSpace(A, [[0], [1 / MASS], [0]], np.eye(3), np.zeros((3, 1))), force, time)
    exact = {"force": force, "displacement": states[:, 0], "voltage": states[:, 2], "current": states[:, 2] / LOAD}
    noisy = {name: values + 1e-3 * values.std() * rng.normal(size=COUNT) for name, values in exact.items()}
    return {"time": time, **noisy}


def written(path, measured):
    """As a logger would write it, with units of its own."""
    rows = zip(measured["time"], 1e3 * measured["force"], 1e6 * measured["displacement"], measured["voltage"],
               1e6 * measured["current"], strict=True)  # fmt: skip
    lines = ["Logger,X1", "Zeit (s);Kraft (mN);Laser [\u00b5m];Piezo / V;I (uA);Temperature"]
    lines += [";".join(f"{x:.9g}" for x in row) + ";20.5" for row in rows]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def run(*arguments) -> int:
    return main([str(argument) for argument in arguments])


@pytest.mark.parametrize("kind", ["harvest", "damping"])
def test_a_study_is_simulated_as_it_is(tmp_path, kind, capsys):
    study = tmp_path / "study.toml"
    assert run("new", kind, "--out", study) == 0
    assert capsys.readouterr().out.strip() == str(study)
    assert run("simulate", study) == 0
    assert len(tomllib.loads(study.read_text())["shunts"]) == 3


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["harvest", "damping"])
def test_a_study_is_designed_as_it_is(tmp_path, kind):
    assert run("new", kind, "--out", tmp_path / "study.toml") == 0
    assert run("design", tmp_path / "study.toml") == 0


def test_a_campaign_is_identified_as_it_is(tmp_path, measured, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").mkdir()
    written(tmp_path / "data" / "shaker.csv", measured)
    assert run("new", "campaign", "data/shaker.csv") == 0
    campaign = load_campaign("campaign.toml")
    (record,) = campaign.records
    assert record.sample_rate == pytest.approx(RATE, rel=1e-9)
    assert record.shunt.resistance == pytest.approx(LOAD, rel=1e-3)
    for channel in ("force", "displacement", "voltage", "current"):
        np.testing.assert_allclose(record[channel], measured[channel], rtol=1e-8)
    for name, value in TRUE.items():  # the damping is biased by the window
        assert getattr(campaign.transducer, name) == pytest.approx(value, rel=0.2 if name == "damping" else 0.05)
    found = identify(campaign).transducer
    for name, value in TRUE.items():
        assert getattr(found, name) == pytest.approx(value, rel=0.02), name


def test_rough_values_say_nothing_where_they_know_nothing(measured):
    sine = np.sin(2 * np.pi * 50.0 * measured["time"])
    assert rough_values({"force": sine, "displacement": 1e-3 * sine}, RATE) == {}
    assert rough_values({"voltage": sine, "displacement": sine}, RATE) == {}
    assert rough_values({"force": 0 * sine, "displacement": 0 * sine}, RATE) == {}
    gap = np.where(np.arange(COUNT) == 40, np.nan, measured["displacement"])
    assert rough_values({"force": measured["force"], "displacement": gap}, RATE) == {}
    noise = np.random.default_rng(0).normal(size=COUNT)
    assert rough_values({"force": noise, "displacement": measured["displacement"]}, RATE) == {}
    assert set(rough_values({"force": measured["force"], "displacement": measured["displacement"]}, RATE)) == {
        "mass", "damping", "stiffness"}  # fmt: skip


FILES = {
    "scope.csv": ("CH1 (V),CH2 (V)\n1,2\n2,3\n3,1\n", ["# sample_rate = ", "not recognised (?): "]),
    "volts.csv": ("time_s,force (V),x (um)\n0,1,1\n0.001,2,3\n0.002,1,2\n",
                  ["# force = ", "gain, in N for one V, is missing", "# drive = "]),
    "letters.csv": ("t,F,x\n0,1,1\n0.001,2,3\n0.002,1,2\n", ['force = { column = "F" }', "no unit", 'drive = "force"']),
    "odd.csv": ('t,"F ""quoted"" \u00fc",x\n0,1,1\n0.5,2,3\n1,1,2\n', ["at 2 Hz", "not recognised (?): "]),
    "frf.csv": ("frequency_Hz,H (g/kN),phase_deg\n1,2,3\n2,3,4\n3,4,5\n", ['kind = "frf"', 'output = "acceleration"']),
    "z.csv": ("FREQ[Hz],Z[ohm],PHASE[deg]\n1e3,2,3\n2e3,3,4\n3e3,4,5\n", ['kind = "impedance"']),
    "z.s1p": ("# Hz S RI R 50\n1e3 0.1 0.2\n2e3 0.2 0.2\n", ['kind = "impedance"']),
    "PROFILE.csv": ("t,F,FILE $x\n0,1,1\n0.001,2,3\n0.002,1,2\n", ['"FILE $x"', "identify campaign.toml"]),
    "german.csv": ("Messung;1\nFrequenz;Betrag;Phase;Koh\u00e4renz\nHz;(mm/s)/N;\u00b0;\n1;2,5;3;1\n2;3;4;1\n3;4;5;1\n",
                   ['output = "velocity"', 'magnitude = { column = "Betrag" }    # (mm/s)/N', '"Koh\u00e4renz"']),
    "levels.txt": ("Freq\tH1 Magnitude\tPhase\n[Hz]\t[dB re 1 g/N]\t[deg]\n1\t-2\t3\n2\t-3\t4\n3\t-4\t5\n",
                   ['output = "acceleration"', 'magnitude = { column = "H1 Magnitude" }', "[transducer.modal]"]),
    "bode.csv": ("Frequency (Hz),TR1: Impedance (Ohm),TR2: Impedance (Degree)\n1,2,3\n2,3,4\n3,4,5\n",
                 ['kind = "impedance"']),
    "strain.csv": ("Time (s),Force (N),Strain (\u00b5m/m)\n0,1,1\n0.001,2,3\n0.002,1,2\n",
                   ["in m for one \u00b5m/m, is missing (the mode shape", '# displacement = { column = "Strain']),
    "gauge.csv": ("Time,Force,Dehnung,Flow\ns,N,microstrain,furlongs\n0,1,1,1\n0.001,2,3,1\n0.002,1,2,1\n",
                  ['force = { column = "Force" }    # N', "in m for one microstrain"]),
    "laser.csv": ("t,Laser velocity (mm/s),Laser 2 (g)\n0,1,1\n0.001,2,3\n0.002,1,2\n",
                  ['velocity = { column = "Laser velocity (mm/s)" }', 'acceleration = { column = "Laser 2 (g)" }']),
    "numbered.csv": ("X,CH1\n0,1.5\n1,2.5\n2,1.5\n3,1\n", ['not recognised (?): "X", "CH1"']),
    "shaker.csv": ("t,acc,tip_um,U\n0,1,1,2\n0.001,2,3,4\n0.002,1,2,2\n",
                   ['base_acceleration = { column = "acc" }', 'displacement = { column = "tip_um" }    # um',
                    'drive = "base_acceleration"', "taken for that of the base"]),
    "mso5000.csv": ("CH1V,CH2A,t0 =-2.5e-03, tInc = 5.0e-04,\n1,2,,\n2,3,,\n1,2,,\n",
                    ['voltage = { column = "CH1V" }    # V', 'current = { column = "CH2A" }    # A', "at 2000 Hz"]),
    "ds1000e.csv": ("X,CH1,\nSecond,Volt,\n-1.0e-03,1,\n-5.0e-04,2,\n0,1,\n",
                    ['time = { column = "X" }', 'voltage = { column = "CH1" }    # Volt', "at 2000 Hz"]),
    "tds.csv": ("Record Length,3.0e+00,,  -0.000500,0.04000,\nSource,CH1,,0,1,\nVertical Units,V,,0.0005,2,\n",
                ['time = { column = "Time" }', 'voltage = { column = "CH1" }    # V', "at 2000 Hz"]),
    "bode_de.csv": ("Frequenz (Hz);Trace 1: Impedanz: Betrag (\u03a9);Trace 2: Impedanz: Phase (\u00b0)\n"
                    "1;2,5;3\n2;3;4\n3;4;5\n", ['kind = "impedance"']),
    "gain_de.csv": ("Frequenz (Hz);Trace 1: Verst\u00e4rkung: Betrag (dB);Trace 1: Verst\u00e4rkung: Phase (\u00b0)\n"
                    "1;2,5;3\n2;3;4\n3;4;5\n", ['magnitude = { column = "Trace 1: Verst\u00e4rkung: Betrag (dB)"']),
    "below.csv": ("Sensors\nchannel,gain\n1,2.0\n2,3.0\n3,1.0\nend\nTime (s),Force (N)\n0,1\n0.1,2\n0.2,1\n0.3,1\n",
                  ["skip_rows = 7", 'force = { column = "Force (N)" }    # N', "4 samples at 10 Hz"]),
    "remarks.csv": ("Time (s),Force (N)\n0,1\n0.1,2\n0.2,1\nlimits\nlow,3,4\n",
                    ['force = { column = "Force (N)" }    # N', "3 samples at 10 Hz"]),
    "two.csv": ("t,x,Weg (mm)\n0,1,1\n1,2,3\n2,1,2\n", ['displacement = { column = "Weg (mm)" }', '"x"']),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_what_a_file_tells_and_what_not(tmp_path, name, capsys):
    content, words = FILES[name]
    (tmp_path / name).write_text(content, encoding="utf-8")
    out = tmp_path / "campaign.toml"
    assert run("new", "campaign", tmp_path / name, "--out", out) == 0
    text = out.read_text(encoding="utf-8")
    assert [word for word in words if word not in text] == [], text
    assert tomllib.loads(text)["records"][0]["file"] == name
    assert "still to be completed: " in capsys.readouterr().err  # the nominal values, at least


def test_an_array_too_large_to_be_listed_does_no_harm(tmp_path):
    columns = {"time_s": np.arange(400) / RATE, "force_N": np.arange(400.0) ** 2, "video": np.zeros((400, 300))}
    np.savez(tmp_path / "run.npz", empty=np.full(400, np.nan), **columns, displacement_m=np.full(400, np.nan))
    assert run("new", "campaign", tmp_path / "run.npz", "--out", tmp_path / "campaign.toml") == 0
    text = (tmp_path / "campaign.toml").read_text()
    assert 'force = { column = "force_N" }' in text
    assert "looked like displacement, but holds no numbers" in text


def test_records_of_several_files(tmp_path, measured):
    one, other = written(tmp_path / "one.csv", measured), tmp_path / "other.csv"
    other.write_text(one.read_text().replace("Kraft", "Force"))
    assert run("new", "campaign", one, other, "--out", tmp_path / "campaign.toml") == 0
    assert [record["force"].std() for record in load_campaign(tmp_path / "campaign.toml").records] == pytest.approx(
        [measured["force"].std()] * 2
    )


BEAM = (1.87510407, 4.69409113, 7.85475744)  # roots of cos x cosh x = -1


def universal_beam(path):
    """Modes of an aluminium cantilever, 200 x 20 x 2 mm, written by pyuff with shapes of any size; its flexibility."""
    pyuff = pytest.importorskip("pyuff")
    length, stiffness, mass, x = 0.2, 0.93, 0.0216, np.linspace(0, 1, 6)[1:]
    for n, root in enumerate(BEAM, 1):
        ratio = (np.cosh(root) + np.cos(root)) / (np.sinh(root) + np.sin(root))
        z = root * x
        shape = 3.0 * (np.cosh(z) - np.cos(z) - ratio * (np.sinh(z) - np.sin(z)))
        mode = {
            "type": 55, "model_type": 1, **{f"id{k}": "NONE" for k in range(1, 6)}, "analysis_type": 2, "data_ch": 2,
            "spec_data_type": 8, "data_type": 2, "n_data_per_node": 3, "load_case": 1, "mode_n": n,
            "freq": root**2 / (2 * np.pi * length**2) * np.sqrt(stiffness * length / mass), "modal_m": 9.0 * mass,
            "modal_damp_vis": 0.005, "modal_damp_his": 0.0, "node_nums": np.arange(1, 6), "r1": 0 * x, "r2": 0 * x,
            "r3": -shape,
        }  # fmt: skip
        pyuff.UFF(str(path)).write_sets(mode, "add")
    return length**3 / (3 * stiffness)


@pytest.mark.parametrize("kind", ["damping", "harvest"])
def test_a_study_of_a_host_in_a_universal_file(tmp_path, monkeypatch, capsys, kind):
    """It runs as it is; far below its resonances the beam's end gives way as statics says, L^3/(3 E I)."""
    monkeypatch.chdir(tmp_path)
    flexibility = universal_beam(tmp_path / "host.unv")
    assert run("new", kind, "host.unv") == 0
    text = (tmp_path / f"{kind}.toml").read_text()
    assert 'force = "5-Z"' in text and text.count("(?)") == 4
    study = load_study(tmp_path / f"{kind}.toml")
    assert study.excitation.frequency == pytest.approx(study.transducer.short_circuit_frequency, rel=1e-3)
    assert study.design.band is None or np.mean(study.design.band) == pytest.approx(
        study.excitation.frequency, rel=1e-3
    )
    assert run("simulate", f"{kind}.toml") == 0
    static = sum(mode.force_participation**2 / mode.stiffness for mode in study.transducer.all_modes)
    assert static == pytest.approx(flexibility, rel=2e-3)  # the other modes, 12/root^4 of it each
    assert run("new", "campaign", "host.unv") == 2
    assert "found no function (data set 58) but 3 modes (data sets 55)" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [(["campaign"], "at least one is needed"), (["campaign", "nothing.csv"], "nothing.csv: the file cannot be read"),
     (["harvest", "run.csv"], "only a campaign takes data files"), (["nonsense"], "is not one of"),
     (["damping", "host.unv"], "found host.unv, which is no existing file"),
     (["harvest", "--out", "study.txt"], "allowed are names ending in .toml"),
     (["harvest", "--out", "there.toml"], "exists and is not overwritten"),
     (["campaign", "there.toml"], "allowed are names ending in")],
)  # fmt: skip
def test_bad_input(tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.toml").write_text("precious")
    assert run("new", *arguments) == 2
    message = capsys.readouterr().err
    assert words in message
    assert is_sentence(message.strip())
    assert (tmp_path / "there.toml").read_text() == "precious"
    assert [path.name for path in tmp_path.iterdir()] == ["there.toml"]


def test_a_file_that_may_be_cut_off_is_told(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cut.csv").write_text("time_s,force_N\n0.0,1.0\n0.1,2.0\n")
    assert main(["new", "campaign", "cut.csv"]) == 0
    assert "warning: cut.csv: found only 2 rows of numbers; is the file cut off?" in capsys.readouterr().err


NO_ROWS = {"time_s": np.empty(0), "force_N": np.empty(0), "displacement_m": np.empty(0)}
NO_LINES = {"frequency_Hz": np.empty(0), "real": np.empty(0), "imaginary": np.empty(0)}


def _hdf5(path, columns):
    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file[name] = values


def _tdms(path, columns):
    tdms = pytest.importorskip("nptdms")
    with tdms.TdmsWriter(path) as writer:
        writer.write_segment([tdms.ChannelObject("group", name, values) for name, values in columns.items()])


def _text(path, columns):
    path.write_text(",".join(columns) + "\n")


def _ltspice(path, columns):
    names = "".join(f"\t{n}\t{name}\tvoltage\n" for n, name in enumerate(columns))
    head = f"Title: x\nPlotname: Transient Analysis\nFlags: real\nNo. Variables: {len(columns)}\nNo. Points: 0\n"
    path.write_text(f"{head}Variables:\n{names}Values:\n")


EMPTY = {
    ".csv": _text, ".txt": _text, ".tsv": _text, ".dat": _text,
    ".mat": savemat, ".npz": lambda path, columns: np.savez(path, **columns),
    ".npy": lambda path, columns: np.save(path, np.empty((0, len(columns)))),
    ".h5": _hdf5, ".tdms": _tdms, ".raw": _ltspice,
    ".parquet": lambda path, columns: parquet.write_table(pa.table(columns), path),
    ".wav": lambda path, columns: wavfile.write(path, 1000, np.zeros((0, len(columns)), np.int16)),
    ".s1p": lambda path, columns: path.write_text("# Hz S RI R 50\n"),
    ".uff": lambda path, columns: path.write_text("    -1\n    58\n    -1\n"),
    ".lvm": lambda path, columns: path.write_text("LabVIEW Measurement\n***End_of_Header***\n"),
}  # fmt: skip


def test_every_reader_is_tried_with_an_empty_file():
    """A universal file of another suffix, and further suffixes, have the same readers."""
    own = {cls for cls in registered().values() if cls.__module__.startswith("piezoharvest")}
    assert own == {registered()[suffix] for suffix in EMPTY}


@pytest.mark.parametrize("columns", [NO_ROWS, NO_LINES, {"force_N": np.empty(0)}], ids=["signals", "response", "one"])
@pytest.mark.parametrize("suffix", EMPTY)
def test_a_file_without_samples_is_an_error(tmp_path, monkeypatch, capsys, suffix, columns):
    monkeypatch.chdir(tmp_path)
    EMPTY[suffix](tmp_path / f"empty{suffix}", columns)
    assert main(["new", "campaign", f"empty{suffix}"]) == 2
    message = capsys.readouterr().err
    assert f"empty{suffix}: " in message and is_sentence(message.strip())
    assert [path.name for path in tmp_path.iterdir()] == [f"empty{suffix}"]


@pytest.mark.parametrize("suffix", [".mat", ".npz", ".h5"])
def test_a_file_without_arrays_is_an_error(tmp_path, monkeypatch, capsys, suffix):
    monkeypatch.chdir(tmp_path)
    EMPTY[suffix](tmp_path / f"none{suffix}", {})
    assert main(["new", "campaign", f"none{suffix}"]) == 2
    assert f"none{suffix}: found no rows of numbers, at least one is needed" in capsys.readouterr().err
    assert not (tmp_path / "campaign.toml").exists()


def test_the_columns_of_an_empty_file_are_named(tmp_path, monkeypatch, capsys):
    """Beside a file that is whole, whose campaign is not written either."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run.csv").write_text("time_s,force_N\n" + "".join(f"{n / 100},{n % 7}\n" for n in range(50)))
    EMPTY[".parquet"](tmp_path / "empty.parquet", NO_ROWS)
    assert main(["new", "campaign", "run.csv", "empty.parquet"]) == 2
    told = "empty.parquet: found no rows of numbers in its columns time_s, force_N, displacement_m, at least one"
    assert told in capsys.readouterr().err
    assert not (tmp_path / "campaign.toml").exists()


def test_values_that_no_transducer_has_are_told(tmp_path, measured):
    """Volts that are millivolts and amperes that are nanoamperes: a capacitance a millionth of what a film has."""
    columns = {"time": 1.0, "force": 1.0, "displacement": 1.0, "voltage": 1e3, "current": 1e-3}
    rows = np.column_stack([factor * measured[name] for name, factor in columns.items()])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="t,force,displacement,voltage,current", comments="")
    assert main(["new", "campaign", str(tmp_path / "run.csv"), "--out", str(tmp_path / "campaign.toml")]) == 0
    lines = (tmp_path / "campaign.toml").read_text().splitlines()
    told = {line.split()[0]: "implausible: are the units of the channels right?" in line for line in lines if line}
    assert told["capacitance"] is True
    assert told["mass"] is False


def test_fields_of_a_structure_are_known_by_their_own_names(tmp_path):
    time = np.arange(100) / 1000.0
    fields = {"t": time[:, None], "kraft": np.sin(time)[:, None], "x_um": np.cos(time)[:, None]}
    savemat(tmp_path / "run.mat", {"data": fields, "note": "run 1"})
    found = look_into(tmp_path / "run.mat")
    assert found.columns == {"time": "data.t", "force": "data.kraft", "displacement": "data.x_um"}
    np.testing.assert_allclose(found.values["displacement"], 1e-6 * np.cos(time))


@pytest.mark.parametrize("motion", ["velocity", "acceleration"])
def test_rough_values_from_any_motion(measured, motion):
    x = np.fft.rfft(measured["displacement"])
    s = 2j * np.pi * np.fft.rfftfreq(COUNT, 1.0 / RATE)
    order = {"velocity": 1, "acceleration": 2}[motion]
    rates = np.fft.irfft(np.where(s.imag < 2 * np.pi * 250.0, s**order * x, 0), COUNT)
    channels = {name: measured[name] for name in ("force", "voltage", "current")}
    found = rough_values({**channels, motion: rates}, RATE)
    for name, value in TRUE.items():
        assert found[name] == pytest.approx(value, rel=0.2 if name == "damping" else 0.05)


@pytest.mark.parametrize(
    ("names", "channels"),
    [
        (("V(acc)", "V(tip_disp)", "V(out)", "I(Rload)"),
         ("base_acceleration", "displacement", "voltage", "current")),
        (("V(n003)", "I(V1)"), ("voltage", "current")),
        (("V(n001)", "V(piezo)"), ("", "voltage")),
    ],
)  # fmt: skip
def test_nodes_of_a_simulator_are_known_by_their_names(tmp_path, names, channels):
    time = np.arange(100) / 1000.0
    rows = np.column_stack([time, *(np.sin(time + n) for n in range(len(names)))])
    np.savetxt(tmp_path / "run.txt", rows, delimiter="\t", header="\t".join(["time", *names]), comments="")
    found = {str(column): channel for channel, column in look_into(tmp_path / "run.txt").columns.items()}
    assert [found.get(name, "") for name in names] == list(channels)


@pytest.mark.parametrize("motion", ["displacement", "velocity"])
def test_rough_damping_of_a_resonance_that_is_narrower_than_a_line(motion):
    """Quality 500, and a record that ends before the resonance has rung down: what it ends with is not lost."""
    damping, time = 0.0063, np.arange(4000) / RATE
    force = 0.02 * chirp(time, 30.0, time[-1], 80.0)
    A = [[0, 1], [-STIFFNESS / MASS, -damping / MASS]]
    _, states, _ = lsim(StateSpace(A, [[0], [1 / MASS]], np.eye(2), np.zeros((2, 1))), force, time)
    found = rough_values({"force": force, motion: states[:, 0 if motion == "displacement" else 1]}, RATE, resonant=True)
    assert found["damping"] == pytest.approx(damping, rel=0.1)
    assert found["mass"] == pytest.approx(MASS, rel=0.01)


def test_mass_and_damping_come_from_the_file_that_has_the_resonance(tmp_path, measured):
    """A slow record tells stiffness, coupling and capacitance, a mobility beside it the resonance at 50 Hz."""
    slow = sosfilt(butter(4, [1, 5], "bandpass", fs=RATE, output="sos"), np.random.default_rng(5).normal(size=COUNT))
    A = [[0, 1, 0], [-STIFFNESS / MASS, -DAMPING / MASS, COUPLING / MASS],
         [0, -COUPLING / CAPACITANCE, -1 / (LOAD * CAPACITANCE)]]  # fmt: skip
    _, states, _ = lsim(StateSpace(A, [[0], [1 / MASS], [0]], np.eye(3), np.zeros((3, 1))), slow, measured["time"])
    noise = 1.0 + 1e-2 * np.random.default_rng(6).normal(size=COUNT)
    slowly = {"time": measured["time"], "force": slow, "displacement": noise * states[:, 0], "voltage": states[:, 2],
              "current": states[:, 2] / LOAD}  # fmt: skip
    assert rough_values({k: v for k, v in slowly.items() if k != "time"}, RATE, resonant=True) == {}
    s = 2j * np.pi * np.linspace(40.0, 60.0, 81)
    mobility = s / (STIFFNESS + DAMPING * s + MASS * s**2)
    rows = [
        f"{f:.9g},{m:.9g},{p:.9g}"
        for f, m, p in zip(s.imag / 2 / np.pi, abs(mobility), np.angle(mobility), strict=True)
    ]
    (tmp_path / "frf.csv").write_text("\n".join(["Frequency (Hz),Mobility Magnitude [m/s/N],Phase (rad)", *rows]))
    assert (
        run(
            "new",
            "campaign",
            written(tmp_path / "slow.csv", slowly),
            tmp_path / "frf.csv",
            "--out",
            tmp_path / "c.toml",
        )
        == 0
    )
    nominal = tomllib.loads((tmp_path / "c.toml").read_text())["transducer"]
    for name, value in TRUE.items():
        assert nominal[name] == pytest.approx(value, rel=0.05), name


@pytest.mark.parametrize("header", ["Magnitude (dB)", "magnitude_dB", "Mobility Magnitude [dB]", "|mobility| (dB)"])
def test_levels_whose_zero_the_file_does_not_state_are_marked(tmp_path, header):
    s = 2j * np.pi * np.linspace(40.0, 60.0, 81)
    mobility = s / (STIFFNESS + DAMPING * s + MASS * s**2)
    columns = [s.imag / (2 * np.pi), 20 * np.log10(abs(mobility)), np.angle(mobility, deg=True)]
    names = f"Frequency (Hz),{header},Phase (deg)"
    np.savetxt(tmp_path / "frf.csv", np.column_stack(columns), delimiter=",", header=names, comments="")
    assert run("new", "campaign", tmp_path / "frf.csv", "--out", tmp_path / "c.toml") == 0
    (line,) = [line for line in (tmp_path / "c.toml").read_text().splitlines() if line.startswith("magnitude = ")]
    assert 'unit = "dB" }' in line and "(?) 0 dB taken for the SI unit" in line


@pytest.mark.parametrize(("output", "order"), [("displacement", 0), ("velocity", 1), ("acceleration", 2)])
def test_rough_values_of_a_response(output, order):
    s = 2j * np.pi * np.linspace(40.0, 60.0, 81)
    rng = np.random.default_rng(3)
    noise = 1.0 + 1e-3 * (rng.normal(size=81) + 1j * rng.normal(size=81))
    response = noise * s**order / (STIFFNESS + DAMPING * s + MASS * s**2)
    found = rough_values_of_response(s.imag / (2 * np.pi), response, output)
    for name in ("mass", "damping", "stiffness"):
        assert found[name] == pytest.approx(TRUE[name], rel=0.02)
    assert rough_values_of_response(s.imag / (2 * np.pi), response, "voltage") == {}
    assert rough_values_of_response(s.imag / (2 * np.pi), rng.normal(size=81) + 0j, output) == {}


@pytest.mark.parametrize("lines", [200, 481])
@pytest.mark.parametrize("share", [1.0, 0.1, -0.5])
def test_rough_values_of_a_response_with_two_modes_are_those_of_the_strongest(lines, share):
    """The mass was up to 47 times too small: all lines were taken for those of one mode."""
    s = 2j * np.pi * np.linspace(5.0, 400.0, lines)
    noise = 1.0 + 1e-3 * np.random.default_rng(3).normal(size=lines)
    second = share / (9 * STIFFNESS + 4 * DAMPING * s + MASS * s**2)
    response = noise * s**2 * (1.0 / (STIFFNESS + DAMPING * s + MASS * s**2) + second)
    found = rough_values_of_response(s.imag / (2 * np.pi), response, "acceleration")
    for name in ("mass", "damping", "stiffness"):
        assert found[name] == pytest.approx(TRUE[name], rel=0.02)


@pytest.mark.spice
@pytest.mark.parametrize(("kind", "drive"), [("sine_force", "force"), ("sine_base", "base_acceleration")])
def test_waveforms_of_an_exported_netlist_are_known(tmp_path, kind, drive):
    """Ngspice runs what `export` has written; its readings are the channels, in SI units."""
    study = tmp_path / "study.toml"
    assert run("new", "harvest", "--out", study) == 0
    text = study.read_text()
    assert 'kind = "sine_force"' in text
    study.write_text(text.replace('kind = "sine_force"', f'kind = "{kind}"').replace('"20 mN"', "0.02"))
    assert run("export", study, "--shunt", 1, "--out", tmp_path / "run.cir") == 0
    command = ["ngspice", "-b", "run.cir", "-r", "run.raw"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, timeout=120)
    found = look_into(tmp_path / "run.raw")
    expected = {"time", drive, "displacement", "voltage", "current"}
    assert expected <= set(found.columns) <= expected | {"dc_voltage"}
    system = load_study(study)
    response = simulate(System(system.transducer, system.shunts[1]), system.excitation)
    peak = np.ptp(found.values["displacement"]) / 2
    assert peak == pytest.approx(response.displacement_amplitude, rel=0.01)


LABORATORIES = {
    "voltage": ["v_piezo", "Vpiezo", "V_p", "Vp", "u_pzt", "PZT", "pvdf1", "V_oc", "Vout", "v_load", "uR", "V_mfc (V)",
                "piezo_v"],
    "current": ["i_piezo", "iL", "I_load", "i_p"],
    "velocity": ["v_tip", "vLaser", "vel_tip", "V_beam", "LDV_velocity", "vel"],
    "displacement": ["x_tip", "w_tip", "tip_x", "disp_um", "laser displacement", "x_beam"],
    "acceleration": ["a_tip", "acc_tip", "acc1"],
    "base_acceleration": ["a_base", "acc_base", "base_acc", "shaker acceleration"],
    "force": ["f_shaker", "F_ext", "shaker_force", "Fin", "hammer"],
    "dc_voltage": ["v_rect", "V_DC", "vstore"],
    None: ["ch1", "y", "temp", "v_base", "x_base", "index", "Ip_address"],
}  # fmt: skip


@pytest.mark.parametrize(("channel", "name"), [(c, name) for c, names in LABORATORIES.items() for name in names])
def test_names_that_laboratories_use(tmp_path, channel, name):
    """A letter alone says little: v_tip is a velocity, v_piezo a voltage."""
    other = "F" if channel == "acceleration" else "other"  # without a force it would be that of the base
    (tmp_path / "run.csv").write_text(f't,{other},"{name}"\n0,1,1\n0.001,2,3\n0.002,1,2\n', encoding="utf-8")
    found = look_into(tmp_path / "run.csv")
    assert {c for c, column in found.columns.items() if column == name} == ({channel} if channel else set())
