"""Laws as effect files: what is written loads back, acts as the law does, and bad files are told in a sentence."""

import gc
import subprocess
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from piezoharvest import Transducer
from piezoharvest.cli import main
from piezoharvest.cli.on_campaigns.law_files import save_laws
from piezoharvest.description.effects import DiodeDropError, registered
from piezoharvest.description.effects.nameless.circuit_places import DcLoad, Diode, SwitchLoop
from piezoharvest.description.effects.nameless.forms import (
    Bends,
    Corners,
    Hertz,
    Knee,
    Line,
    Monomial,
    Polynomial,
    Power,
)
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import Delay, LateBy, Play, Relaxation, Resonance
from piezoharvest.description.effects.nameless.places import (
    Coupling,
    Damper,
    GainOverTime,
    Load,
    LoadCurrent,
    OverTime,
    Reading,
    Spring,
)
from piezoharvest.description.effects.nameless.shapes import Bump, Shape, StepChange, Stribeck
from piezoharvest.description.shunts import ParallelSSHI, Resistor
from piezoharvest.diagnose.discovery.effect_file import effect_text
from piezoharvest.diagnose.discovery.effect_test import save_effect_test
from piezoharvest.diagnose.discovery.forms.wording import formula
from piezoharvest.diagnose.discovery.result import Discovery
from piezoharvest.effect_files import load_effects
from piezoharvest.input import InputError
from piezoharvest.predict.record_model import RecordModel

BEAM = {"mass": 0.010, "damping": 0.0628, "stiffness": 986.96, "coupling": 1e-3, "capacitance": 40e-9}
LAWS = [
    Law(place=Damper(), form=Polynomial(factor=6e-4, second=-8e-6, scale=0.1, exponents=(3, 5))),
    Law(place=Load(), form=Knee(factor=5e-5, knee=2.19)),
    Law(place=Damper(), form=Power(factor=2e-3, exponent=1.7, scale=0.2)),
    Law(place=Spring(), form=Monomial(factor=np.float64(0.05), scale=np.float64(1e-3), exponent=3)),
    Law(place=Coupling(), form=Bends(knots=(0.0, -0.0), kinks=(np.float64(0.5), 0.5))),
    Law(place=Reading("voltage", "displacement"), form=Corners(knots=(1e-4,), kinks=(3.0,))),
    Law(place=Spring(), form=Shape(factor=1e-3, scale=8e-4, curve="exponential", bent=True, knots=(0.0, 1e-3))),
    Law(place=Spring(), form=Hertz(factor=1e-3, scale=8e-4, odd=False, side=-1)),
    Law(place=Damper(), form=Stribeck(factor=1e-3, excess=0.5, speed=0.1, width=1e-3, knots=(0.0, 0.1, 0.2))),
    Law(place=OverTime("stiffness", "amplitude"), form=Line(factor=np.float64(0.3))),
    Law(place=Reading("displacement", "displacement"), form=Line(factor=-1.0), memory=Play(threshold=np.float64(1e-6))),
    Law(place=Spring(), form=Line(factor=-3.0), memory=Resonance(frequency=70.0, damping_ratio=0.1)),
    Law(place=Reading("voltage", "voltage"), form=Line(factor=1.0), memory=Delay(delay=1e-4)),
    Law(place=LoadCurrent(), form=Line(factor=1.0), memory=LateBy(delay=1e-3)),
    Law(place=Reading("displacement", "voltage"), form=Line(factor=1e-7), memory=LateBy(delay=1e-3, whole=True)),
    Law(place=LoadCurrent(), form=Line(factor=0.5), memory=Relaxation(time_constant=1e-3, behind=True)),
    Law(place=Diode(reach=1e-4), form=Power(factor=0.1, exponent=0.4, scale=1e-4, odd=False)),
    Law(place=DcLoad(reach=10.0), form=Knee(factor=1e-6, knee=4.0, sides=1)),
    Law(place=Reading("voltage", "time"), form=StepChange(factor=-0.3, at=0.6, width=0.01)),
    Law(place=Reading("voltage", "time"), form=Bump(factor=-0.3, at=0.6, width=0.1)),
    Law(place=GainOverTime("displacement"), form=StepChange(factor=-0.3, at=0.6, width=0.01, finest=1e-4)),
    Law(place=SwitchLoop(reach=1e-2), form=Corners(knots=(0.0, 1e-3), kinks=(100.0, np.float64(50.0)))),
    Law(
        place=SwitchLoop(reach=1e-2),
        form=Line(factor=np.float64(-300.0)),
        memory=Relaxation(time_constant=1e-4, behind=True),
    ),
]


CHANNELS = ("displacement", "voltage", "current")
SSHI = ParallelSSHI(inductance=0.5, quality=8.0, smoothing_capacitance=1e-6, load_resistance=1e5)


@pytest.fixture(autouse=True)
def forgotten():
    """Forget the effects of a test: the library of the others is the package's."""
    before = set(registered())  # another test's may still be referred to by a cache of the process that ran it
    yield
    for name in [name for name in sys.modules if name.startswith("piezoharvest_effects_")]:
        del sys.modules[name]
    gc.collect()
    assert set(registered()) <= before


def discovered(law):
    curve = np.linspace(-1.0, 1.0, 5)
    return Discovery(law, formula(law), law.form.word, {}, curve, curve, curve, 1.0, 0.0, ())


def equations(effect):
    device = Transducer(**BEAM, effects=(effect,))
    return RecordModel(device, Resistor(resistance=1e5), "force", 1e-3, (0.02, 50.0)).matrices()


def test_a_file_says_what_its_law_was_found_beside(tmp_path):
    path = tmp_path / "law.py"
    path.write_text(effect_text(discovered(LAWS[0]), "campaign.toml", [DiodeDropError(diode_drop=0.25)]))
    (name,) = load_effects(path)
    assert "found beside diode_drop_error (diode_drop = 0.25)." in registered()[name].__doc__


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_a_file_acts_as_the_law_that_it_is_of(law, tmp_path):
    path = tmp_path / "law.py"
    path.write_text(effect_text(discovered(law), "campaign.toml"))
    (name,) = load_effects(path)
    made = registered()[name]()
    assert made.of_specimen == law.of_specimen
    assert not made.absent
    assert [made.late(channel) for channel in CHANNELS] == [law.late(channel) for channel in CHANNELS]
    assert made.changes_circuit == law.changes_circuit
    assert made.connect(SSHI) == law.connect(SSHI)
    assert (made.connect(SSHI) == SSHI) != law.changes_circuit
    assert [made.delays(channel) for channel in CHANNELS] == [law.delays(channel) for channel in CHANNELS]
    wanted, found = equations(law), equations(made)
    for part in ("A", "B", "W", "O", "parameters"):
        assert np.allclose(getattr(found, part), getattr(wanted, part), rtol=1e-12), part
    assert load_effects(path) == [name]  # the second time nothing runs


STUDY = """
title = "a load that conducts beyond a voltage"
[transducer]
mass = 0.010
damping = 0.0628
stiffness = 986.96
coupling = 1.0e-3
capacitance = 40e-9
[transducer.effects.NAME]
[excitation]
kind = "sine_force"
amplitude = 0.02
frequency = 50.6
[[shunts]]
kind = "resistor"
resistance = 1e5
"""


def test_a_study_takes_the_effect_of_a_file_by_its_name(tmp_path):
    law = Law(place=Reading("displacement", "force"), form=Monomial(factor=1e-6, scale=0.02))
    (tmp_path / "law.py").write_text(effect_text(discovered(law), "campaign.toml"))
    (tmp_path / "study.toml").write_text(STUDY.replace("NAME", "reading_displacement_polynomial"))
    # In a process of its own: a study's model of its tables, once made, keeps the class.
    command = [sys.executable, "-m", "piezoharvest", "simulate", "study.toml"]
    run = partial(subprocess.run, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run(command).returncode == 2  # the package has no such effect
    done = run([*command, "--effects", "law.py"])
    assert (done.returncode, "resistor" in done.stdout.lower()) == (0, True), done.stderr


def written(law, folder):
    """An effect file with its test."""
    (folder / "law.py").write_text(effect_text(discovered(law), "campaign.toml"))
    return save_effect_test(folder / "law.py")


def test_the_command_writes_each_law_with_its_test_and_says_so(tmp_path, capsys):
    laws, campaign = [discovered(law) for law in LAWS[:2]], SimpleNamespace(path=Path("campaign.toml"))
    found = SimpleNamespace(effects=(), discovery=laws, campaign=campaign)
    save_laws(found, tmp_path / "law.py")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["law.py", "law_2.py", "test_law.py", "test_law_2.py"]
    assert "law_2.py" in (tmp_path / "test_law_2.py").read_text()
    assert str(tmp_path / "test_law.py") in capsys.readouterr().err


def passed(test):
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", test.name]
    return subprocess.run(command, cwd=test.parent, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("law", [LAWS[0], *(pytest.param(law, marks=pytest.mark.slow) for law in LAWS[1:])],
                         ids=lambda law: law.name)  # fmt: skip
def test_the_test_beside_an_effect_file_passes(law, tmp_path):
    test = written(law, tmp_path)
    assert test.name == "test_law.py"
    done = passed(test)
    assert "4 passed" in done.stdout, done.stdout


def test_the_test_beside_an_effect_file_finds_what_is_there_at_its_null_value(tmp_path):
    test = written(LAWS[0], tmp_path)
    text = (tmp_path / "law.py").read_text()
    wrong = text.replace(
        "        self.law.act(specimen)", "        specimen.draw(1e-6 * specimen.v)\n        self.law.act(specimen)"
    )
    assert wrong != text
    (tmp_path / "law.py").write_text(wrong)
    done = passed(test)
    assert done.returncode == 1, done.stdout
    assert "test_it_changes_nothing_at_its_null_value" in done.stdout


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [("law.txt", "", "ends with .py"), ("law.py", "1 +", "cannot be run (SyntaxError"),
     ("empty.py", "", "found no effect"), ("raises.py", "raise OSError('x')", "cannot be run (OSError: x)"),
     ("exits.py", "raise SystemExit(3)", "cannot be run (SystemExit: 3)")],
)  # fmt: skip
def test_a_bad_file_is_told_in_a_sentence(name, text, message, tmp_path, capsys):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError, match=name):
        load_effects(path)
    (tmp_path / "study.toml").write_text(STUDY.replace("[transducer.effects.NAME]", ""))
    assert main(["simulate", str(tmp_path / "study.toml"), "--effects", str(path)]) == 2
    assert message in capsys.readouterr().err


CARELESS = """
from dataclasses import dataclass
from typing import ClassVar

from piezoharvest import Effect, quantity


@dataclass(frozen=True, kw_only=True)
class Careless(Effect):
    name: ClassVar[str] = "careless"
    source: ClassVar[str] = "none"
    looks: ClassVar[str] = "none"
    told_by: ClassVar[str] = "none"
    size: float = quantity("N/m", "size", at_least=0, null=0.0)

    def act(self, specimen):
        specimen.state("stretch", "m")

    @classmethod
    def starts(cls, scales):
        yield cls(size=0.0)
"""


def test_an_effect_whose_equations_fail_is_told_with_its_file_and_line(tmp_path):
    path, study = tmp_path / "careless.py", tmp_path / "study.toml"
    path.write_text(CARELESS)
    study.write_text(STUDY.replace("[transducer.effects.NAME]", "[transducer.effects.careless]\nsize = 1.0"))
    line_of_command = [sys.executable, "-m", "piezoharvest", "simulate", str(study), "--effects", str(path)]
    done = subprocess.run(line_of_command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    said = done.stderr
    line = next(n for n, text in enumerate(CARELESS.splitlines(), 1) if "specimen.state(" in text)
    assert f"{path}: line {line}, in Careless.act: this effect cannot be used (" in said
    assert "internal error" not in said


@pytest.mark.parametrize(
    ("lacks", "without", "message"),
    [("name", 'name: ClassVar[str] = "nobody_NAME"', "class Nobody: found no name, an effect needs one (name: ClassV"),
     ("source", 'source: ClassVar[str] = "none"', "class Nobody: found no source, an effect needs one"),
     ("null", ", null=0.0", "class Nobody: found no null value, an effect needs a field with the value at which it"),
     ("dataclass", "@dataclass(frozen=True, kw_only=True)\n", "class Nobody: found no null value")],
)  # fmt: skip
def test_what_the_class_of_an_effect_lacks_is_told_before_anything_is_computed(lacks, without, message, tmp_path):
    """Without a null value a diagnosis ended, after its fits, in an internal error: StopIteration."""
    text = CARELESS.replace("Careless", "Nobody").replace('"careless"', '"nobody_NAME"')
    assert without in text
    (tmp_path / "nobody.py").write_text(text.replace(without, "").replace("NAME", lacks))
    with pytest.raises(InputError) as caught:
        load_effects(tmp_path / "nobody.py")
    assert str(caught.value).startswith(f"{tmp_path / 'nobody.py'}: {message}")
    gc.collect()


def test_an_unknown_effect_is_told_how_one_of_a_file_is_read(tmp_path, capsys):
    (tmp_path / "study.toml").write_text(STUDY.replace("[transducer.effects.NAME]", "[transducer.effects.own]"))
    assert main(["simulate", str(tmp_path / "study.toml")]) == 2
    assert "voltage_reversion; one of your own is read from its file by --effects" in capsys.readouterr().err


def test_a_missing_file_is_told_in_a_sentence(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        load_effects(tmp_path / "none.py")
