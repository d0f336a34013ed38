"""Random campaigns of the virtual bench, whose cause the diagnosis is not told: a fast selection of `make recovery`.

Effect, size, parameters, specimen and noise are drawn from a seed. The seeds are fixed, so that what fails fails again.
"""

import dataclasses

import numpy as np
import pytest

from reports.diagnosis import trials
from reports.diagnosis.trials import DRAWS, Trial, run

# Of what a campaign like the paper's shows clearly; the others are tried by `make recovery`.
NAMES = [name for name in DRAWS if name not in ("clipping", "channel_skew", "mains_hum")]


def drawn(seed, count):
    """Names of effects, and a size in sigma."""
    rng = np.random.default_rng([seed, 17])
    return tuple(str(name) for name in rng.choice(NAMES, count, replace=False)), float(rng.uniform(20.0, 60.0))


def read_at(rate, monkeypatch):
    """Campaigns of the same motions, read less often: they take less time, and a size in sigma falls as its root."""
    load = trials._study

    def study(path):
        whole = load(path)
        return dataclasses.replace(whole, bench={**whole.bench, "sample_rate": rate})

    monkeypatch.setattr(trials, "_study", study)


@pytest.fixture
def half_the_samples(monkeypatch):
    read_at(500.0, monkeypatch)


QUICK = [(Trial("single", *drawn(0, 1), 300), "effect"), (Trial("withheld", ("mains_hum",), 60.0, 331), "unexplained")]


@pytest.mark.slow
@pytest.mark.parametrize(("trial", "verdict"), QUICK, ids=["single", "withheld"])
def test_a_fifth_of_the_samples_tells_what_is_large(trial, verdict, monkeypatch):
    read_at(200.0, monkeypatch)
    result = run(trial)
    assert result["right"], result
    assert result["verdict"] == verdict, result


@pytest.mark.slow
@pytest.mark.usefixtures("half_the_samples")
@pytest.mark.parametrize(("kind", "seed"), [("single", 0), ("ideal", 8)])
def test_names_a_single_effect(kind, seed):
    names, sigma = drawn(seed, 1)
    result = run(Trial(kind, names, sigma, 300 + seed))
    assert result["right"], result
    assert result["verdict"] == "effect", result
    assert result["reached"] > 10.0


@pytest.mark.slow
@pytest.mark.usefixtures("half_the_samples")
def test_names_two_effects_at_once():
    names, _ = drawn(18, 2)
    result = run(Trial("pair", names, 50.0, 318))
    assert result["right"], result


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seed"), [("healthy", 5010), ("ideal", 322)])
def test_a_healthy_specimen_raises_no_alarm(kind, seed):
    """In the first one the errors of rounding the displacement look like a contact of 5.8 sigma of the noise.

    In the second one steps have no rise, and loads come upon a specimen at rest at the first sample.
    """
    result = run(Trial(kind, (), 0.0, seed))
    assert result["verdict"] == "adequate", result
    assert not result["found"]


@pytest.mark.slow
@pytest.mark.usefixtures("half_the_samples")
def test_an_effect_that_is_not_in_the_library_is_not_named_after_another():
    result = run(Trial("withheld", ("mains_hum",), 60.0, 331))
    assert result["verdict"] in ("unexplained", "ambiguous"), result


@pytest.mark.slow
@pytest.mark.usefixtures("half_the_samples")
def test_a_fault_that_no_effect_has_gets_no_name():
    result = run(Trial("foreign", ("cubic sensor",), 120.0, 341))
    assert result["verdict"] == "unexplained", result
