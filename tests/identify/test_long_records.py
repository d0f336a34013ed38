"""Records too long to be fitted as a whole at once, and the parts that make that possible."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from identify.identify_runs import campaign_file
from identify.test_identify import within
from scipy.interpolate import CubicSpline

from piezoharvest.identify import identification, identify
from piezoharvest.predict import drive
from piezoharvest.records import load_campaign


@settings(max_examples=60, deadline=None)
@example(count=417, seed=27341)  # has a corner
@given(count=st.integers(2, 700), seed=st.integers(0, 10**6))
def test_a_spline_in_pieces_is_the_spline_of_the_whole(count, seed):
    values = np.cumsum(np.random.default_rng(seed).normal(size=count))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drive, "SPLINE_PIECE", 64)
        found = drive.drive_of(values)
    wanted = drive.drive_of(values).coefficients
    assert np.abs(found.coefficients - wanted).max() <= 1e-12 * np.abs(wanted).max()
    # A random walk may jump, or have a corner, where the spline is broken.
    if not len(found.jumps) and not len(drive.corners_of(values)) and count >= 4:
        wanted = CubicSpline(np.arange(count, dtype=float), values).c[::-1].T
        assert np.abs(found.coefficients - wanted).max() <= 1e-12 * np.abs(wanted).max()


def test_the_beginning_of_a_record_has_all_of_its_channels(tmp_path):
    record = load_campaign(campaign_file(tmp_path, 1)[0]).records[0]
    part = record.beginning(100)
    assert len(part) == 100
    assert part.responses == record.responses
    assert part.sample_rate == pytest.approx(record.sample_rate)
    for channel in (*record.signals, "time"):
        assert np.array_equal(part[channel], record[channel][:100])


@pytest.mark.slow
def test_records_whose_beginning_is_fitted_first_give_the_same(tmp_path, monkeypatch):
    path, truth = campaign_file(tmp_path, 2)
    whole = identify(load_campaign(path))
    told: list[str] = []
    monkeypatch.setattr(identification, "INITIAL_SAMPLES", 6000)
    parts = identify(load_campaign(path), told.append)
    assert parts.converged
    within(parts, truth, 3.5)
    for one, other in zip(whole.estimates, parts.estimates, strict=True):
        assert one.identifiable == other.identifiable
        if one.identifiable:
            assert abs(one.value - other.value) < 0.2 * one.std, one.parameter.name
            assert other.std == pytest.approx(one.std, rel=0.1)
