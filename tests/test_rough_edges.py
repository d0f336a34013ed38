"""What commands say where something is rough: results that are none, p-values of zero, units in a sweep."""

import math
from types import SimpleNamespace

import pytest

from piezoharvest.cli import main
from piezoharvest.cli.on_campaigns.diagnose_command import _p_value
from piezoharvest.cli.tables import _FIGURES, _without_zeros_of_failures
from piezoharvest.diagnose import summary
from piezoharvest.diagnose.summary import judged_error
from piezoharvest.engine.simulation import _failed
from piezoharvest.study import StudyError, load_study

STUDY = """[transducer]
mass = 0.010
damping = 0.0628
stiffness = 986.96
coupling = 1.0e-3
capacitance = 40e-9
[excitation]
kind = "sine_base"
amplitude = "1 g"
frequency = 50.6
[[shunts]]
kind = "rectifier"
smoothing_capacitance = 1e-6
load_resistance = 1e6
"""
SWEEP = """[sweep]
outputs = ["harvested_power"]
parameters = [{ path = "PATH", from = "FROM", to = "TO", count = 3 }]
"""


def study(tmp_path, more="", **changes):
    text = STUDY + more
    for old, new in changes.items():
        text = text.replace(old, new)
    (tmp_path / "study.toml").write_text(text)
    return tmp_path / "study.toml"


def test_figures_of_a_failed_simulation_are_none():
    found = _without_zeros_of_failures(_failed("rectifier", "no end"))
    assert all(math.isnan(getattr(found, name)) for name in _FIGURES)


@pytest.mark.parametrize(("value", "text"), [(0.0, "< 1e-300"), (1e-299, "1e-299"), (0.0123, "0.012")])
def test_a_p_value_is_never_zero(value, text):
    assert _p_value(value) == text


@pytest.mark.parametrize(("kept", "words"), [((), "the error of the fitted records"), ((1,), "the validation error")])
def test_what_an_effect_is_judged_by(kept, words):
    assert judged_error(SimpleNamespace(campaign=SimpleNamespace(of_role=lambda role: kept))) == words


@pytest.mark.parametrize(
    ("path", "ends", "wanted"),
    [
        ("shunts.0.load_resistance", ("10 kOhm", "1 Mohm"), (1e4, 1e6)),
        ("excitation.amplitude", ("1 g", "2 g"), (9.80665, 19.6133)),
        ("transducer.capacitance", ("10 nF", "20 nF"), (10e-9, 20e-9)),
    ],
)
def test_ends_of_a_sweep_have_the_unit_of_what_is_swept(tmp_path, path, ends, wanted):
    found = load_study(study(tmp_path, SWEEP, PATH=path, FROM=ends[0], TO=ends[1])).sweep.parameters[0]
    assert (found.from_, found.to) == pytest.approx(wanted)


def test_another_unit_in_a_sweep_is_refused(tmp_path):
    path = study(tmp_path, SWEEP, PATH="shunts.0.load_resistance", FROM="1 kg", TO="2 kg")
    with pytest.raises(StudyError, match=r"parameters\.0\.from: found the unit .kg., must be .* converts to ohm"):
        load_study(path)


def test_a_capacitor_does_not_begin_at_any_voltage(tmp_path):
    with pytest.raises(StudyError, match=r"initial_dc_voltage: found 1e\+30, must be .* at most 1e\+06 V"):
        load_study(study(tmp_path, "initial_dc_voltage = 1e30\n"))


def test_an_unknown_beginning(capsys):
    assert main(["new", "foo"]) == 2
    said = capsys.readouterr().err
    assert "'foo' is not one of" in said and "Value error" not in said


@pytest.mark.parametrize(("seconds", "told"), [(1.0, False), (3.0, True)])
def test_a_rate_of_one_event_is_said_to_be_one(tmp_path, capsys, seconds, told):
    """A supply that turns on once in three seconds does not do so 1200 times an hour."""
    store = "[shunts.storage]\nturn_on = 4.0\nturn_off = 2.0\npower = 0.0\n"
    path = study(tmp_path, store, **{"load_resistance = 1e6\n": "", "= 1e-6": "= 1e-5"})
    assert main(["simulate", str(path), "--transient", str(seconds)]) == 0
    assert ("the supply turns on once in 3 s, which the figures per hour" in capsys.readouterr().err) == told


@pytest.mark.parametrize(("gain", "shown"), [(-1e-9, "0 %"), (0.5, "50 %"), (0.99996, "99.996 %"), (-0.02, "-2 %")])
def test_a_share_that_rounds_to_nothing_has_no_sign(gain, shown):
    """An effect that changed nothing had a gain of -0 %."""
    assert summary._share(gain) == shown


@pytest.mark.parametrize("cell", ["nan", "NaN", ""])
def test_a_cell_of_a_modes_file_that_is_nan_is_not_said_to_be_empty(tmp_path, cell):
    (tmp_path / "modes.csv").write_text(f"frequency_Hz,damping_ratio,force,coupling_0\n10,0.01,1.0,{cell}\n")
    path = tmp_path / "study.toml"
    path.write_text(
        '[transducer]\nmodes_file = "modes.csv"\ncapacitance = 4e-8\n[excitation]\nkind = "sine_force"\n'
        'amplitude = 1.0\nfrequency = 10.0\n[[shunts]]\nkind = "open"\n'
    )
    with pytest.raises(StudyError, match="row 2: found nan or an empty cell in column 'coupling_0'"):
        load_study(path)
