"""Standard errors of values identified behind a switch, which acts earlier or later by the noise of the drive."""

from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from scipy.stats import chi2

from piezoharvest import load_campaign, load_study
from piezoharvest.bench import measure, measuring, write_campaign
from piezoharvest.identify import identify


@pytest.fixture(autouse=True)
def moved_once(monkeypatch):
    """Integrate the record of each circuit once: only what its sensors add depends on the seed."""
    known, integrate = {}, measuring.integrate

    def once(model, excitation, times, stage):
        circuit = type(model.circuit)
        if circuit not in known:
            known[circuit] = integrate(model, excitation, times, stage)
        return known[circuit]

    monkeypatch.setattr(measuring, "integrate", once)


def _deviations(path, seed):
    """Deviations of the identified values from the true ones, in their standard errors."""
    study = load_study(path)
    study = replace(study, bench={**study.bench, "seed": seed})
    directory = path.parent / str(seed)
    write_campaign(measure(study), directory)
    found = identify(load_campaign(directory / "campaign.toml"))
    assert all(each.identifiable for each in found.estimates)
    true = study.systems[0].transducer
    return [(each.value - getattr(true, each.parameter.name)) / each.std for each in found.estimates]


@pytest.mark.parametrize(
    "seeds",
    [
        pytest.param(range(100, 103), marks=pytest.mark.recovery_long),
        pytest.param(range(110, 140), marks=pytest.mark.slow),
    ],
)
def test_values_lie_within_their_standard_errors(seeds, tmp_path):
    path = tmp_path / "harvest.toml"
    path.write_text(files("piezoharvest.cli").joinpath("templates", "harvest.toml").read_text())
    squares = np.array([_deviations(path, seed) for seed in seeds]) ** 2
    # The records of one sine and its beginning leave no value far better known than said, and none far worse.
    assert np.all(squares.sum(axis=0) < chi2.ppf(0.999, len(seeds)))
    assert np.all(squares.sum(axis=0) > chi2.ppf(0.001, len(seeds)))
