"""Specimen files: what comes back, what is refused, draws against closed forms, and intervals by the delta method."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from piezoharvest import progress
from piezoharvest.cli import main
from piezoharvest.description.effects import Clipping, Leakage
from piezoharvest.description.excitation import SineForce, StepForce
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.shunts import ParallelSSHI, Resistor
from piezoharvest.description.transducer import Mode, Transducer
from piezoharvest.engine import simulate
from piezoharvest.specimen import Specimen, intervals, load_specimen, write_specimen
from piezoharvest.specimen.draws import drawn
from piezoharvest.study import StudyError, load_study

VALUES = {"mass": 0.01, "damping": 0.0628, "stiffness": 986.96, "coupling": 1e-3, "capacitance": 40e-9}
FORCE, FREQUENCY, RESISTANCE = 0.02, 49.0, 8e4
NAMES = ("stiffness", "coupling", "capacitance", "damping")
CORRELATION = np.array([[1.0, 0.5, 0.0, 0.2], [0.5, 1.0, -0.3, 0.0], [0.0, -0.3, 1.0, 0.0], [0.2, 0.0, 0.0, 1.0]])


def specimen(relative=1e-3, **more):
    values = np.array([VALUES[name] for name in NAMES])
    covariance = CORRELATION * np.outer(values, values) * relative**2
    scaling = ("log", "linear", "log", "log")
    return Specimen(dict(zip(NAMES, values.tolist(), strict=True)), covariance, scaling, Transducer(**VALUES), **more)


def rich():
    """A specimen with everything that a file can have."""
    transducer = Transducer(
        **VALUES, modes=(Mode(mass=0.02, damping=0.1, stiffness=5e4, coupling=-1e-4),),
        hysteresis=Hysteresis(thresholds=(1e-9, 3e-9), weights=(1e6, 2e6)), effects=(Leakage(resistance=6e5),),
    )  # fmt: skip
    values = {
        "stiffness": 986.96, "modes.0.coupling": -1e-4, "hysteresis.thresholds.0": 1e-9,
        "hysteresis.thresholds.1": 3e-9, "hysteresis.weights.1": 2e6, "effects.leakage.resistance": 6e5,
    }  # fmt: skip
    errors = np.array([1.0, 1e-5, 1e-9, 1e-9, 3e6, 3e5])
    scaling = ("log", "linear", "log", "log", "linear", "reciprocal")
    return Specimen(
        values, np.diag(errors**2), scaling, transducer, {"mass": "a record"}, source={"campaign": "c.toml"}
    )


def test_round_trip(tmp_path):
    path = tmp_path / "specimen.toml"
    write_specimen(rich(), path, "bender")
    found = load_specimen(path)
    assert found.transducer == rich().transducer and found.scaling == rich().scaling
    assert found.values == rich().values and found.lacking == {"mass": "a record"}
    assert found.covariance == pytest.approx(rich().covariance, rel=1e-15)
    assert found.source == {"campaign": "c.toml"}
    assert found.errors["modes.0.coupling"] == pytest.approx(1e-5)


def test_a_film_has_neither_mass_nor_damping(tmp_path):
    path = tmp_path / "film.toml"
    device = Transducer(**{**VALUES, "mass": 1.0, "damping": 1.0})
    write_specimen(Specimen({}, np.empty((0, 0)), (), device, unknown=("mass", "damping")), path)
    assert "mass" not in path.read_text()
    assert load_specimen(path).unknown == ("mass", "damping")
    study = tmp_path / "study.toml"
    study.write_text(STUDY.format(file="film.toml"))
    with pytest.raises(StudyError, match=r"film.toml: transducer.quasi_static: .*give both there"):
        load_study(study)


def test_errors_of_sensors_are_kept_apart(tmp_path):
    path = tmp_path / "specimen.toml"
    faults = (Clipping(limit=2.0, channel="voltage"), Clipping(limit=1e-6, channel="displacement"))
    write_specimen(specimen(measurement=faults), path)
    found = load_specimen(path)
    assert found.measurement == faults and found.transducer is not None and found.transducer.effects == ()
    path.write_text(path.read_text().replace('name = "clipping"', 'name = "cliping"', 1))
    with pytest.raises(StudyError, match=r"measurement.0.name: .*did you mean 'clipping'"):
        load_specimen(path)


def text_of(tmp_path, **more):
    path = tmp_path / "specimen.toml"
    write_specimen(specimen(**more), path)
    return path, path.read_text()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.replace("[covariance]", "[covarianze]"), "covarianze: unknown key.*covariance"),
        (lambda t: t.replace("stiffness = 986.96", "stifness = 986.96"), "transducer.stifness: unknown key"),
        (lambda t: t[: len(t) // 2], "not a valid TOML file"),
        (lambda t: t.replace("[transducer]", "[source]"), "transducer: missing table"),
        (lambda t: re.sub(r"(\[standard_errors\]\nstiffness = )", r"\1-", t), "standard_errors.stiffness: found -"),
        (lambda t: t.replace("[standard_errors]\n", "[standard_errors]\nsize = 1.0\n"), "standard_errors.size: the"),
        (lambda t: t.replace('"log",\n', '"root",\n', 1), "covariance.scaling: allowed are 4 of linear, log"),
        (lambda t: t.replace("matrix = [\n", "matrix = [\n[1.0, 2.0],\n"), "covariance.matrix: allowed are 4 rows"),
        (lambda t: re.sub(r"(matrix = \[\n *\[\n *)", r"\g<1>-", t), "covariance.matrix: this is not a covariance"),
    ],
)  # fmt: skip
def test_damaged_files_say_what_is_wrong(tmp_path, change, words):
    path, text = text_of(tmp_path)
    assert change(text) != text
    path.write_text(change(text))
    with pytest.raises(StudyError, match=words):
        load_specimen(path)


def test_draws_have_the_covariance(tmp_path):
    found = drawn(specimen(0.02), 200_000, seed=2)
    columns = np.hstack([getattr(found, name) for name in NAMES])
    relative = np.cov(columns.T) / np.outer(*2 * [[VALUES[name] for name in NAMES]])
    assert relative / 0.02**2 == pytest.approx(CORRELATION, abs=0.015)
    assert found.mass == VALUES["mass"]


def test_draws_are_physical():
    found = drawn(rich(), 5000, seed=1)
    assert found.hysteresis is not None
    low, high = found.hysteresis.thresholds
    assert np.all(high > low) and np.all(low > 0)
    assert found.hysteresis.weights[1].min() == 0.0  # a third of the Gaussian is below zero
    resistance = found.effects[0].resistance
    assert np.all(resistance > 0) and np.median(resistance) == pytest.approx(6e5, rel=0.03)


def power(values):
    """Mean power in a resistor in closed form."""
    w = 2 * np.pi * FREQUENCY
    k, coupling, c, b = (values[name] for name in NAMES)
    moving = (k - VALUES["mass"] * w**2 + 1j * w * b) * (1 + 1j * w * RESISTANCE * c)
    voltage = FORCE * w * coupling * RESISTANCE / abs(moving + 1j * w * RESISTANCE * coupling**2)
    return 0.5 * voltage**2 / RESISTANCE


def test_intervals_are_those_of_the_delta_method(monkeypatch):
    monkeypatch.setattr(progress, "EVERY", 0.0)
    given, drive, said = specimen(2e-4), SineForce(amplitude=FORCE, frequency=FREQUENCY), []
    found = intervals(given, Resistor(resistance=RESISTANCE), drive, 4000, progress=said.append)
    for kind in ("resistor", "short"):  # that of the attenuation
        assert any(step.startswith(f"{kind}: steady states: ") and step.line.endswith(" left") for step in said)
    slopes = []
    for name in NAMES:
        ahead, behind = ({**VALUES, name: VALUES[name] * (1 + sign * 1e-6)} for sign in (1, -1))
        slopes.append((power(ahead) - power(behind)) / (2e-6 * VALUES[name]))
    std = float(np.sqrt(np.array(slopes) @ given.covariance @ np.array(slopes)))
    figures = found["harvested_power"]
    assert found["samples"] == found["converged"] == 4000
    # Five standard errors of each statistic.
    assert figures["mean"] == pytest.approx(power(VALUES), abs=5 * std / np.sqrt(4000))
    assert figures["std"] == pytest.approx(std, rel=5 / np.sqrt(2 * 4000))
    assert figures["p95"] - figures["p5"] == pytest.approx(2 * 1.6449 * std, rel=0.06)
    assert figures["p5"] < figures["p50"] < figures["p95"]


def test_a_switched_loop_keeps_its_coil():
    """Its draws are simulations with the coil and on time that were made for the identified capacitance."""
    drive = SineForce(amplitude=FORCE, frequency=FREQUENCY)
    shunt = ParallelSSHI(flip_time=1e-4, quality=5.0, smoothing_capacitance=1e-6, load_resistance=1e6)
    given = Specimen({"capacitance": 40e-9}, np.array([[4e-9**2]]), ("log",), Transducer(**VALUES))
    found = intervals(given, shunt, drive, 3)["harvested_power"]["p50"]
    one = sorted(drawn(given, 3, seed=1).capacitance[:, 0])[1]
    inductance, _ = shunt.loop(40e-9)
    moved = shunt.beside(40e-9, one)
    assert moved.inductance == inductance and moved.on_time(one) == pytest.approx(shunt.on_time(40e-9), rel=1e-12)
    wanted = simulate(_system(one, moved), drive).harvested_power
    assert found == pytest.approx(wanted, rel=1e-6)


def _system(capacitance, shunt):
    from piezoharvest.description.system import System

    return System(Transducer(**{**VALUES, "capacitance": capacitance}), shunt)


def test_transients_are_drawn_one_by_one():
    drive = StepForce(amplitude=0.02, duration=0.2)
    found = intervals(specimen(1e-3), Resistor(resistance=RESISTANCE), drive, 4)
    assert found["converged"] == 4 and found["displacement_amplitude"]["std"] > 0


STUDY = """
transducer = "{file}"
[excitation]
kind = "sine_force"
amplitude = 0.02
frequency = 49.0
[[shunts]]
kind = "resistor"
resistance = 8e4
"""


class TestStudies:
    def study(self, tmp_path, file="specimen.toml", more=""):
        write_specimen(specimen(), tmp_path / "specimen.toml")
        path = tmp_path / "study.toml"
        path.write_text(STUDY.format(file=file) + more)
        return path

    def test_a_study_takes_it(self, tmp_path):
        study = load_study(self.study(tmp_path))
        assert study.transducer == Transducer(**VALUES) and study.specimen == tmp_path / "specimen.toml"

    def test_simulate_with_uncertainty(self, tmp_path, capsys):
        path = str(self.study(tmp_path))
        assert main(["simulate", path, "--uncertainty", "50", "--json"]) == 0
        (result,) = json.loads(capsys.readouterr().out)["results"]
        spread = result["uncertainty"]
        assert spread["samples"] == 50
        assert spread["harvested_power"]["p5"] < result["harvested_power"] < spread["harvested_power"]["p95"]
        assert main(["simulate", path, "--uncertainty", "50"]) == 0
        out = capsys.readouterr().out
        assert "50 draws of the specimen" in out and "resistor 95 %" in out

    @pytest.mark.parametrize(
        ("file", "more", "words"),
        [
            ("absent.toml", "", "transducer: absent.toml: the file cannot be read"),
            ("study.toml", "", "transducer: study.toml: found a study, for simulate"),
            ("specimen.toml", "[transducer]\nmass = 1.0\n", "a key or table is given twice"),
        ],
    )
    def test_wrong_files(self, tmp_path, capsys, file, more, words):
        assert main(["simulate", str(self.study(tmp_path, file, more))]) == 2
        assert words in capsys.readouterr().err

    def test_uncertainty_needs_a_specimen(self, tmp_path, capsys):
        path = self.study(tmp_path)
        table = "\n".join(f"{name} = {value}" for name, value in VALUES.items())
        text = path.read_text().replace('transducer = "specimen.toml"', "")
        path.write_text(f"{text}\n[transducer]\n{table}\n")
        assert main(["simulate", str(path), "--uncertainty", "50"]) == 2
        assert "found a table, but --uncertainty needs the name of a specimen file" in capsys.readouterr().err

    def test_all_commands_take_it(self, tmp_path, capsys):
        more = '[design]\ncandidates = ["resistor"]\n[sweep]\nmethod = "grid"\nparameters = '
        more += '[{ path = "transducer.stiffness", from = 900.0, to = 1000.0, count = 3 }]\n'
        more += "[bench]\nduration = 0.2\nlaser = { sensitivity = 1e3 }\n"
        path = str(self.study(tmp_path, more=more))
        for command in (
            ["design", path], ["sweep", path, "--out", str(tmp_path / "table.csv")],
            ["export", path, "--out", str(tmp_path / "deck.cir")], ["measure", path, "--out", str(tmp_path / "bench")],
        ):  # fmt: skip
            assert main(command) == 0, capsys.readouterr().err
        assert (tmp_path / "bench" / "campaign.toml").exists()


def test_nothing_is_left_of_a_failed_write(tmp_path):
    folder = tmp_path / "closed"
    with pytest.raises(ValueError, match="files cannot be written"):
        write_specimen(specimen(), folder / "specimen.toml")
    assert not folder.exists() and list(Path(tmp_path).iterdir()) == []
