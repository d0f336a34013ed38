"""Records too long to be fitted as a whole at once, and the parts that make that possible."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from identify.identify_runs import campaign_file
from identify.test_identify import within
from scipy.interpolate import CubicSpline

from piezoharvest.identify import growing_fit, identify
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
    # A random walk may jump, or have a corner, where the spline is broken, or be fast, which is no spline.
    if not found.fast and not len(found.jumps) and not len(drive.corners_of(values)) and count >= 4:
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
    monkeypatch.setattr(growing_fit, "INITIAL_SAMPLES", 6000)
    parts = identify(load_campaign(path), told.append)
    assert parts.converged
    within(parts, truth, 3.5)
    for one, other in zip(whole.estimates, parts.estimates, strict=True):
        assert one.identifiable == other.identifiable
        if one.identifiable:
            assert abs(one.value - other.value) < 0.2 * one.std, one.parameter.name
            assert other.std == pytest.approx(one.std, rel=0.1)


MASS, DAMPING, STIFFNESS, COUPLING, CAPACITANCE = BENDER = 0.010, 0.0628, 986.96, -1e-3, 40e-9
NAMES = ("mass", "damping", "stiffness", "coupling", "capacitance")


NOISE = 2e-6, 3e-8, 2e-3  # N, m, V


def many_records(folder, count=8, samples=500):
    """Campaign of sines on a bender from rest behind two loads: matrix exponentials, the sine being two more states."""
    rng, time = np.random.default_rng(7), np.arange(samples) / 2000.0
    text = ["[transducer]", *(f"{name} = {1.02 * value}" for name, value in zip(NAMES, BENDER, strict=True))]
    for k in range(count):
        load, omega, force = (1e5, 1e6)[k % 2], 2.0 * np.pi * rng.uniform(40.0, 60.0), rng.uniform(0.01, 0.05)
        moving = np.array([
            [0.0, 1.0, 0.0, 0.0, 0.0],
            [-STIFFNESS / MASS, -DAMPING / MASS, COUPLING / MASS, 1.0 / MASS, 0.0],
            [0.0, -COUPLING / CAPACITANCE, -1.0 / (load * CAPACITANCE), 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, omega],
            [0.0, 0.0, 0.0, -omega, 0.0],
        ])  # fmt: skip
        rates, shapes = np.linalg.eig(moving)
        start = np.linalg.solve(shapes, np.array([0.0, 0.0, 0.0, 0.0, force], complex))
        states = np.real((np.exp(np.outer(time, rates)) * start) @ shapes.T)
        noise = rng.normal(size=(samples, 3)) * NOISE
        table = np.column_stack([time, states[:, [3, 0, 2]] + noise])
        header = "time_s,force_N,displacement_m,voltage_V"
        np.savetxt(folder / f"{k}.csv", table, delimiter=",", header=header, comments="")
        text += ["[[records]]", f'file = "{k}.csv"', f"load_resistance = {load}"]
    path = folder / "campaign.toml"
    path.write_text("\n".join(text))
    return load_campaign(path)


def test_of_many_records_some_of_each_load_are_fitted_first(tmp_path, monkeypatch):
    campaign, counts, started = many_records(tmp_path), [], growing_fit.fit_past_jumps

    def seen(problem, *rest):
        counts.append(sorted(each.setting.shunt.resistance for each in problem.data))
        return started(problem, *rest)

    monkeypatch.setattr(growing_fit, "fit_past_jumps", seen)
    monkeypatch.setattr(growing_fit, "SOME_RECORDS", 1)
    found = identify(campaign)
    assert counts == [[1e5, 1e6]]
    assert found.converged and len(found.found.nuisance) == 8
    for estimate, true in zip(found.estimates, BENDER, strict=True):
        assert estimate.std is not None and estimate.std < 1e-2 * abs(true)
        assert abs(estimate.value - true) < 4.0 * estimate.std, estimate.parameter.name
    # Of thousands of samples the noise is known to a few per cent.
    assert found.noise.sigma["displacement"] == pytest.approx(NOISE[1], rel=0.1)
    assert found.noise.sigma["voltage"] == pytest.approx(NOISE[2], rel=0.1)
