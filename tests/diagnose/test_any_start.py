"""Records that begin before anything has settled, made by the bench: each cause is named right, or none where none is.

The bench begins at rest; what is under way at the first sample comes from the part of a run that is thrown away.
"""

from pathlib import Path

import numpy as np
import pytest

from piezoharvest.bench import measure, write_campaign
from piezoharvest.description.effects import BiasCurrent, Creep, DielectricRelaxation, Leakage
from piezoharvest.diagnose import diagnose
from piezoharvest.identify.fitting.output_error import excess_of
from piezoharvest.records import load_campaign
from piezoharvest.study import study_from

LIBRARY = [BiasCurrent, Creep, DielectricRelaxation, Leakage]
TRUE = {"stiffness": 3.125e8, "coupling": 7.822, "capacitance": 3.2e-6}
STACK = {"mass": 0.0158, "damping": 1250.0, **TRUE}
HYSTERESIS = {"thresholds": [0.1e-6, 0.3e-6, 0.7e-6], "weights": [0.5e6, 1.5e6, 0.5e6]}
BEFORE = 600  # samples that are thrown away
MOST_AWAY = 3.0  # times its nominal value: what no parameter of a first fit may come to


def _waves(frequency, amplitude, phase):
    """A sine on a slow one, which keeps creep and polarisation from ever coming to rest."""
    return {
        "kind": "multisine", "amplitudes": [amplitude, 400.0], "frequencies": [frequency, 0.45],
        "phases": [0.3, phase], "duration": 40.0,
    }  # fmt: skip


STEP = {"kind": "step_force", "amplitude": 900.0, "offset": 100.0, "duration": 1.0, "rise_time": 0.05}
RECORDS = [
    {"load_resistance": 97.78e3, "excitation": _waves(4.0, 300.0, 0.0)},
    {"load_resistance": 51.43e3, "excitation": _waves(3.0, 400.0, 2.0)},
    {"load_resistance": 143.8e3, "excitation": STEP},
    {"load_resistance": 97.78e3, "excitation": _waves(5.0, 300.0, -1.5), "role": "validate"},
]


def campaign(folder, effects, seed, hysteresis=False, before=BEFORE, released=False):
    """Campaign of the bench without the first samples of its records, `released`: up to where the voltage is zero.

    Electrodes that are released from a short at the first sample begin just so: no voltage, whatever is polarised.
    """
    tables = {
        "transducer": {**STACK, **({"hysteresis": HYSTERESIS} if hysteresis else {})},
        "excitation": {"kind": "sine_force", "amplitude": 450.0, "offset": 550.0, "frequency": 4.0},
        "shunts": [{"kind": "resistor", "resistance": 97.78e3}],
        "bench": {"duration": 2.0 + 1e-3 * before, "seed": seed, "nominal_error": 0.05, "records": RECORDS,
                  "effects": effects},
    }  # fmt: skip
    path = write_campaign(measure(study_from(tables, Path("study.toml"))), Path(folder) / "campaign")
    for file in path.parent.glob("*.csv"):
        head, *rows = file.read_text().splitlines(keepends=True)
        place = head.strip().split(",").index("voltage_V")
        voltage = np.convolve([float(row.split(",")[place]) for row in rows], np.ones(5) / 5, "same")
        zeros = np.flatnonzero(np.diff(np.sign(voltage[before:])))
        file.write_text(head + "".join(rows[before + (int(zeros[0]) if released and len(zeros) else 0) :]))
    return load_campaign(path)


def check(found, effects):
    """The effect alone, by name, its parameters and the specimen's within three standard errors; a sane first fit."""
    assert found.verdict == ("effect" if effects else "adequate")
    assert [named.effect.name for named in found.effects] == list(effects)
    for named in found.effects:
        for name, (value, std, _) in named.values.items():
            assert abs(value - effects[named.effect.name][name]) < 3.0 * std, (name, value, std)
    for estimate in found.estimates:
        if estimate.parameter.name in TRUE:
            assert estimate.std is not None
            assert abs(estimate.value - TRUE[estimate.parameter.name]) < 3.0 * estimate.std, estimate
    for estimate in found.before.estimates:
        if estimate.parameter.name in TRUE:
            assert 1.0 / MOST_AWAY < estimate.value / estimate.nominal < MOST_AWAY, estimate


BIAS = {"bias_current": {"current": 5e-7}}
RELAXATION = {"dielectric_relaxation": {"capacitance": 1.6e-7, "time_constant": 0.6}}
CREEP = {"creep": {"compliance_ratio": 0.02, "time_constant": 0.8}}


@pytest.mark.parametrize(
    "effects, before, released",
    [
        pytest.param(BIAS, 0, False, id="a current switched on, electrodes released from a short"),
        pytest.param(
            RELAXATION,
            BEFORE,
            True,
            marks=pytest.mark.slow,
            id="electrodes released from a short while a relaxation is under way",
        ),
        pytest.param(CREEP, BEFORE, False, id="creep under way", marks=pytest.mark.slow),
        pytest.param({}, BEFORE, True, id="healthy, electrodes released from a short"),
    ],
)
def test_a_record_may_begin_at_any_time(effects, before, released, tmp_path):
    check(diagnose(campaign(tmp_path, effects, 1, before=before, released=released), library=LIBRARY), effects)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [21, 22])
@pytest.mark.parametrize("effects", [BIAS, RELAXATION, CREEP, {}], ids=lambda some: next(iter(some), "healthy"))
def test_with_hysteresis_and_all_effects_to_choose_from(effects, seed, tmp_path):
    before, released = (0, False) if effects is BIAS else (BEFORE, effects is not CREEP)
    check(diagnose(campaign(tmp_path, effects, seed, True, before, released)), effects)


@pytest.mark.slow
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_misfit_of_a_billion_overflows_nothing(tmp_path):
    """And takes no parameter away: without the current in the model, the coupling was 3.6 times its nominal value."""
    effects = {"bias_current": {"current": 2e-5}}
    found = diagnose(campaign(tmp_path, effects, 3, before=0), library=[BiasCurrent, Creep])
    assert excess_of(found.search.base) > 1e8
    check(found, effects)
    assert found.before.held
