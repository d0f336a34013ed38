"""Sparse regression of what is left: it finds the term that was put in."""

import numpy as np
import pytest
from diagnose_runs import SIGMA, campaign, fitted, reading

from piezoharvest.diagnose.residual_structure.residual_regression import SYMBOLS, Hint, hints
from piezoharvest.identify.fitting.data import RESPONSES
from piezoharvest.identify.fitting.output_error import fit
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.preparation import prepared
from piezoharvest.records.reading.channels import DRIVES


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    found = campaign(tmp_path_factory.mktemp("hints"))
    return prepared(found, "fit"), found.transducer


@pytest.mark.parametrize(("channel", "of", "term"), [("displacement", "force", "F³"), ("voltage", "voltage", "v²")])
def test_finds_the_term_that_was_put_in(records, channel, of, term):
    problem, found, _ = fitted(*records, seed=7)
    size = 3.0 * SIGMA[channel]
    largest = max(np.abs(data.record[of]).max() for data in problem.data)
    order = 3 if "³" in term else 2

    def bent(data):
        signal = (data.record[of] if of == "force" else data.values[:, data.channels.index(of)]) / largest
        return reading(data, channel, lambda values: values + size * signal**order)

    problem = Problem([bent(data) for data in problem.data], problem.nominal, problem.offset_channels)
    again = fit(problem, found.model, found.nuisance, found.noise, estimate_noise=False)
    first = hints(problem, again)[0]
    assert (first.channel, first.term) == (channel, term)
    assert first.size == pytest.approx(size, rel=0.2)


def test_white_noise_gives_no_hint(records):
    for seed in range(5):
        problem, found, _ = fitted(*records, seed=20 + seed)
        assert hints(problem, found) == []


def test_every_channel_that_is_fitted_has_a_symbol_of_its_own():
    assert set(SYMBOLS) == {*RESPONSES, *DRIVES}
    assert len(set(SYMBOLS.values())) == len(SYMBOLS)


@pytest.mark.parametrize(
    ("channel", "term", "higher"),
    [("displacement", "F", True), ("velocity", "dF/dt", True), ("velocity", "da/dt", True), ("velocity", "F", False),
     ("voltage", "F", False), ("displacement", "F³", False)],
)  # fmt: skip
def test_what_follows_the_drive_at_once_is_like_modes_above_the_band(channel, term, higher):
    assert Hint(channel, term, 1.0, 100.0).of_higher_modes is higher
