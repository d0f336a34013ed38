"""Whole diagnoses behind diodes and switches of data that SciPy made, and simulations with the laws that are saved."""

import gc
import json
import sys

import numpy as np
import pytest
from nameless import BEAM, Laws
from rectified import BRIDGE, DRIVES, DURATION, RATE, rectified, rectified_campaign
from switched import COIL, LABELS, switched, switched_campaign

from piezoharvest import Transducer
from piezoharvest.cli import main
from piezoharvest.description.effects.nameless.forms import Knee
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.places import Electrodes
from piezoharvest.description.shunts import SECE, SSDI, Open, SeriesSSHI
from piezoharvest.diagnose import diagnose
from piezoharvest.diagnose.discovery.effect_file import effect_text
from piezoharvest.diagnose.discovery.result import Discovery
from piezoharvest.diagnose.summary import sentence
from piezoharvest.predict.circuit.circuit_prediction import CircuitPrediction
from piezoharvest.predict.circuit.setting import circuit_setting

KNEE, SLOPE = 8.0, 2e-6
DENSE = 40000.0  # Hz, of a drive in a study, which has straight lines between samples


def conducts(v, knee=KNEE, slope=SLOPE):
    """A current beyond a voltage."""
    return slope * np.sign(v) * np.maximum(np.abs(v) - knee, 0.0)


@pytest.fixture(autouse=True)
def forgotten():
    """Forget the effects of files: the library of other tests is the package's."""
    yield
    for name in [name for name in sys.modules if name.startswith("piezoharvest_effects_")]:
        del sys.modules[name]
    gc.collect()


@pytest.mark.parametrize(("kind", "shunt"), [("ssdi", SSDI), ("series_sshi", SeriesSSHI), ("sece", SECE)])
def test_a_switched_circuit_of_scipy_is_that_of_predictions(kind, shunt):
    true, device = switched(kind, Laws(), DRIVES[0]), Transducer(**BEAM)
    setting = circuit_setting("force", shunt(**LABELS[kind]), 1.0 / RATE, true["force"], device)
    (block,) = CircuitPrediction(device, setting).blocks(False, channels=["displacement", "voltage"])
    for found, name in zip(block.values.T, ("displacement", "voltage"), strict=True):
        assert np.ptp(true[name]) > 0.0
        assert np.abs(found - true[name]).max() < 1e-5 * np.abs(true[name]).max()


def test_a_mixed_campaign_has_all_its_labels(tmp_path):
    campaign = switched_campaign(tmp_path, Laws(), ("open", "ssdi", "resistor"))
    assert isinstance(campaign.records[0].shunt, Open)
    assert campaign.records[1].shunt == SSDI(**COIL)
    assert campaign.records[2].shunt.resistance == 1e5


EXCITED = f"""
[excitation]
kind = "record"
file = "drive.csv"
column = "force_N"
sample_rate = {DENSE}
[[shunts]]
kind = "rectifier"
""" + "\n".join(f"{name} = {value}" for name, value in BRIDGE.items())


def simulated(folder, transducer, capsys, *options):
    """Displacement and voltage at the samples of a record, and the energy, of a study under the third drive."""
    times = np.arange(round(DURATION * DENSE)) / DENSE
    np.savetxt(folder / "drive.csv", DRIVES[2](times), header="force_N", comments="", fmt="%.12g")
    (folder / "study.toml").write_text(transducer + EXCITED)
    capsys.readouterr()
    end = str((round(DURATION * RATE) - 1) / RATE)
    study, waves = str(folder / "study.toml"), str(folder / "waves.csv")
    assert main(["simulate", study, "--json", "--transient", end, "--out", waves, *options]) == 0
    (result,) = json.loads(capsys.readouterr().out)["results"]
    found = np.genfromtxt(waves, delimiter=",", names=True, dtype=None, encoding=None)
    at = np.arange(round(DURATION * RATE)) / RATE
    return {name: np.interp(at, found["time_s"], found[column]) for name, column in
            (("displacement", "displacement_m"), ("voltage", "voltage_V"))}, result["energy"]  # fmt: skip


NOMINAL = "[transducer]\n" + "\n".join(f"{name} = {value}" for name, value in BEAM.items())
BY_PARTS = f"""
[transducer.effects."electrodes knee".place]
kind = "electrodes"
[transducer.effects."electrodes knee".form]
kind = "knee"
factor = {SLOPE}
knee = {KNEE}
"""


@pytest.mark.parametrize("way", ["parts", "file"])
def test_a_saved_law_moves_a_rectifier_as_in_another_integrator(way, tmp_path, capsys):
    law = Law(place=Electrodes(), form=Knee(factor=SLOPE, knee=KNEE))
    curve = np.linspace(-1.0, 1.0, 5)
    found = Discovery(law, "knee", "knee", {}, curve, curve, curve, 1.0, 0.0, ())
    (tmp_path / "law.py").write_text(effect_text(found, "campaign.toml"))
    text = BY_PARTS if way == "parts" else "\n[transducer.effects.electrodes_knee]\n"
    effects = [] if way == "parts" else ["--effects", str(tmp_path / "law.py")]
    moved, energy = simulated(tmp_path, NOMINAL + text, capsys, *effects)
    true, without = rectified(Laws(electrodes=conducts), DRIVES[2]), rectified(Laws(), DRIVES[2])
    for name in moved:
        off = np.abs(moved[name] - true[name]).max()
        assert off < 0.01 * np.abs(without[name] - true[name]).max(), name
    assert abs(energy["closure"]) < 1e-9
    assert energy["electrodes knee" if way == "parts" else "electrodes_knee"] > 0.0


@pytest.mark.slow
def test_a_load_that_conducts_beyond_a_voltage_is_found_saved_and_simulated_behind_a_rectifier(tmp_path, capsys):
    campaign = rectified_campaign(tmp_path, Laws(electrodes=conducts))
    saved, file = tmp_path / "specimen.toml", tmp_path / "law.py"
    command = ["diagnose", str(campaign.path), "--json", "--save", str(saved), "--save-effect", str(file)]
    assert main(command) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["verdict"], told["effects"], told["alternatives"]) == ("new_effect", [], [])
    (law,) = told["discovery"]
    assert (law["place"], law["input"], law["form"]) == ("electrodes", "voltage", "knee")
    assert law["gain"] > 0.95
    curve = {name: np.array(values) for name, values in law["curve"].items()}
    off, rounding = np.abs(curve["value"] - conducts(curve["input"])), 1e-3 * conducts(curve["input"]).max()
    assert np.mean(off < 3.0 * curve["std"] + rounding) > 0.95
    true = rectified(Laws(electrodes=conducts), DRIVES[2])
    moved, energy = simulated(tmp_path, 'transducer = "specimen.toml"\n', capsys)
    assert abs(energy["closure"]) < 1e-9
    for name, noise in (("displacement", 3e-7), ("voltage", 0.02)):
        assert np.sqrt(np.mean((moved[name] - true[name]) ** 2)) < 0.3 * noise, name
    values = {name: told["parameters"][name]["value"] for name in BEAM}
    text = "[transducer]\n" + "\n".join(f"{name} = {value!r}" for name, value in values.items())
    text += "\n[transducer.effects.electrodes_knee]\n"
    again, energy = simulated(tmp_path, text, capsys, "--effects", str(file))
    assert abs(energy["closure"]) < 1e-9
    for name in moved:
        assert again[name] == pytest.approx(moved[name], abs=1e-6 * np.abs(moved[name]).max())


@pytest.mark.slow
@pytest.mark.parametrize("kinds", [("sece",) * 3, ("open", "rectifier", "resistor")], ids="-".join)
def test_nothing_is_missing_from_healthy_records(kinds, tmp_path):
    found = diagnose(switched_campaign(tmp_path, Laws(), kinds))
    assert (found.verdict, found.discovery) == ("adequate", ()), sentence(found)


@pytest.mark.slow
def test_a_damper_by_the_square_of_the_velocity_is_found_behind_a_switch(tmp_path):
    def square(u):
        return 0.08 * np.abs(u) * u

    found = diagnose(switched_campaign(tmp_path, Laws(damper=square), ("ssdi",) * 3, seed=5))
    assert (found.verdict, found.effects) == ("new_effect", ()), sentence(found)
    (law,) = found.discovery
    assert (law.place, law.law.place.input, law.form) == ("damper", "velocity", "power")
    assert law.gain > 0.9
    exponent, std, _ = law.parameters["exponent"]
    assert std is not None
    assert abs(exponent - 2.0) < 3.0 * std + 0.05  # a broken line stands for it
