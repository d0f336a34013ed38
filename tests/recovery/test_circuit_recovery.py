"""Random campaigns behind diodes and switches with effects of their circuits: a selection of `--circuits`."""

import numpy as np
import pytest
from selection import with_slow

from reports.diagnosis import circuits
from reports.diagnosis.circuits import DRAWS, bench_of, effects_of, held_out, specimen_of
from reports.diagnosis.plan import circuits as plan
from reports.diagnosis.trials import Trial, library_of, run

SIZED = [name for name in DRAWS if name != "missed_switching"]


@pytest.mark.parametrize("name", with_slow(SIZED, slow=lambda name: name not in ("switch_delay", "reverse_leakage")))
def test_sizes_are_what_no_parameter_takes(name, monkeypatch):
    """By least squares, whose residual is the size aimed at."""
    monkeypatch.setattr(circuits, "DURATION", 0.05)
    trial = Trial("single", (name,), 20.0, 70)
    on = specimen_of(trial)
    tables = effects_of(trial, on)
    healthy, slopes = on.predicted({}, derivatives=True)
    change = on.predicted(tables, derivatives=False)[0] - healthy
    scale = np.maximum(np.linalg.norm(slopes, axis=0), 1e-300)
    taken = slopes / scale @ np.linalg.lstsq(slopes / scale, change, rcond=None)[0]
    assert np.linalg.norm(change - taken) == pytest.approx(20.0, rel=0.05)


def test_held_out_trials_are_not_those_that_code_was_changed_for():
    first, other = ({trial.seed for trial in plan(held_out=flag)} for flag in (False, True))
    assert not first & other
    assert {trial.names for trial in plan(held_out=True) if trial.kind == "single"} == {(name,) for name in DRAWS}


def test_a_law_with_two_names_is_withheld_under_both():
    names = {cls.name for cls in library_of(Trial("withheld", ("probe_loading",), 60.0, 1))}
    assert not {"probe_loading", "leakage"} & names
    assert "reverse_leakage" in names


def test_of_a_held_out_trial_only_whether_it_is_right_is_kept(monkeypatch):
    told = {"key": "a", "right": True, "found": ["creep"], "left": [], "verdict": "effect"}
    monkeypatch.setattr(circuits, "attempt", lambda trial: told)
    assert held_out(Trial("healthy", (), 0.0, 1)) == {"key": "a", "right": True}


@pytest.mark.slow
@pytest.mark.parametrize("name", DRAWS)
def test_names_a_single_effect_of_the_circuit(name):
    result = run(Trial("single", (name,), 50.0, 500 + list(DRAWS).index(name)), bench_of)
    assert result["right"], result


@pytest.mark.slow
def test_healthy_circuits_raise_no_alarm():
    result = run(Trial("healthy", (), 0.0, 520), bench_of)
    assert result["verdict"] == "adequate", result


# Development trials that once ended wrongly, and why.
ONCE_WRONG = {
    "starts beside rest let a voltage source switch at once": Trial("healthy", (), 0.0, 1010001),
    "so did those of a fit without the effect": Trial("single", ("diode_drop_error",), 72.0, 1000003),
    "an effect of second order was never tried": Trial("single", ("on_time_offset",), 27.8, 1000104),
    "one that had taken another's place hid that they are alike": Trial(
        "pair", ("probe_loading", "creep"), 60.0, 1020001
    ),
}


@pytest.mark.parametrize("why", with_slow(list(ONCE_WRONG), slow=lambda why: "at once" not in why))
def test_what_once_went_wrong(why):
    result = run(ONCE_WRONG[why], bench_of)
    assert result["right"], result
