"""Parameters of specimens on the virtual bench come out within their standard errors."""

from __future__ import annotations

import re

import numpy as np
import pytest
from identify.identify_runs import STACK, campaign_file

from piezoharvest.identify import identify
from piezoharvest.identify.fitting.likelihood import by_code, spectra_of
from piezoharvest.identify.noise.drive_denoising import denoised, high_frequency_noise
from piezoharvest.identify.noise.noise_model import rounding
from piezoharvest.output import write_table
from piezoharvest.predict.parameters import value_at
from piezoharvest.records import CampaignError, load_campaign


def by_name(found):
    return {estimate.parameter.name: estimate for estimate in found.estimates}


def within(found, truth, limit=3.0, leave=("mass",)):
    """Every parameter that is determined lies within so many standard errors."""
    for name, estimate in by_name(found).items():
        if estimate.identifiable and name not in leave:
            true = value_at(truth, estimate.parameter.path)
            assert abs(estimate.value - true) < limit * estimate.std, (name, estimate.value, true, estimate.std)


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))])
def test_specimens_up_to_30_percent_off_are_found(tmp_path, seed):
    path, truth = campaign_file(tmp_path, seed)
    steps: list[str] = []
    found = identify(load_campaign(path), steps.append)
    assert found.converged
    assert len(steps) <= 15, "the records tell where to start"
    parameters = by_name(found)
    assert not parameters["mass"].identifiable  # its resonance is at 22 kHz
    assert parameters["mass"].value == STACK["mass"]
    names = (
        "stiffness",
        "coupling",
        "capacitance",
        *(f"hysteresis.{w}.{j}" for w in ("weights", "thresholds") for j in range(3)),
    )
    assert all(parameters[name].identifiable for name in names)
    assert parameters["coupling"].std < 1e-3 * parameters["coupling"].value
    within(found, truth, 3.5)  # of 27 numbers
    for quality in (found.fit, found.validation):
        for channel, rms in quality.rms.items():
            assert rms == pytest.approx(quality.noise[channel], rel=0.06)


@pytest.mark.slow
def test_records_without_noise_give_the_specimen_itself(tmp_path):
    """As of a simulation; residuals are then what the sampled drive leaves open between its samples."""
    path, truth = campaign_file(tmp_path, 4, perfect=True)
    path.write_text(re.sub(r"sigma = .+\n", "", path.read_text()))
    found = identify(load_campaign(path))
    for name, estimate in by_name(found).items():
        if name not in ("mass", "damping"):  # whose time constants are microseconds
            assert estimate.value == pytest.approx(value_at(truth, estimate.parameter.path), rel=2e-3), name
    for name in ("stiffness", "coupling", "capacitance"):
        estimate = by_name(found)[name]
        assert estimate.value == pytest.approx(value_at(truth, estimate.parameter.path), rel=1e-5), name


def test_without_displacement_coupling_and_stiffness_are_known_together_only(tmp_path):
    path, truth = campaign_file(tmp_path, 1)
    _without(path, "displacement")
    found = identify(load_campaign(path))
    parameters = by_name(found)
    lost = [name for name in ("coupling", "stiffness") if not parameters[name].identifiable]
    assert len(lost) == 1
    estimate = parameters[lost[0]]
    assert estimate.std is None
    assert estimate.value == STACK[lost[0]]
    assert "coupling" in estimate.combination
    assert "stiffness" in estimate.combination
    assert "displacement" in parameters["stiffness"].experiment or lost == ["coupling"]
    kept = parameters["coupling" if lost == ["stiffness"] else "stiffness"]
    assert kept.assumes == (lost[0],)  # its standard error says nothing of how far off the nominal value is
    # T/k is known: what the other one became is in the ratio to what was kept.
    ratio = parameters["coupling"].value / parameters["stiffness"].value
    assert ratio == pytest.approx(truth.coupling / truth.stiffness, rel=0.05)


def _without(path, channel):
    """Take a channel's column out of all records, and out of the campaign."""
    for file in path.parent.glob("*.csv"):
        lines = file.read_text().splitlines()
        place = next(n for n, name in enumerate(lines[0].split(",")) if name.startswith(channel))
        kept = [",".join(cell for n, cell in enumerate(line.split(",")) if n != place) for line in lines]
        file.write_text("\n".join(kept) + "\n")
    text = re.sub(rf"\[channels\.{channel}\]\n(?:.+\n)+", "", path.read_text())
    path.write_text(text)


@pytest.mark.slow
def test_an_offset_of_a_sensor_is_a_number_of_the_record(tmp_path):
    path, truth = campaign_file(tmp_path, 2)
    file = sorted(path.parent.glob("*.csv"))[0]
    head, *lines = file.read_text().splitlines()
    place = head.split(",").index("current_A")
    rows = [line.split(",") for line in lines]
    for row in rows:
        row[place] = repr(float(row[place]) + 2e-6)
    file.write_text("\n".join([head, *(",".join(row) for row in rows)]) + "\n")
    found = identify(load_campaign(path))
    within(found, truth, 3.5)
    assert found.records[0].own["current offset"] == pytest.approx(2e-6, abs=2e-8)
    assert found.records[1].own["current offset"] == pytest.approx(0.0, abs=2e-8)


@pytest.mark.slow
def test_an_impedance_beside_time_records(tmp_path):
    """A precise impedance of the free leads tells the capacitance better than the records of a single load."""
    path, truth = campaign_file(tmp_path, 1, linear=True)
    alone = by_name(identify(load_campaign(path)))
    _add_impedance(path, truth, 1e-5)
    found = identify(load_campaign(path))
    within(found, truth, 3.5)
    assert by_name(found)["capacitance"].std < 0.7 * alone["capacitance"].std
    assert found.records[-1].quality.rms.keys() == {"voltage/current"} or "voltage/current" in found.fit.rms


def _add_impedance(path, truth, error):
    frequency, rng = np.geomspace(50.0, 2000.0, 60), np.random.default_rng(5)
    omega = 2 * np.pi * frequency
    mechanical = truth.stiffness - omega**2 * truth.mass + 1j * omega * truth.damping
    impedance = 1.0 / (1j * omega * (truth.capacitance + truth.coupling**2 / mechanical))
    impedance = impedance * (1 + error * (rng.standard_normal(60) + 1j * rng.standard_normal(60)))
    columns = {"frequency_Hz": frequency, "resistance_ohm": impedance.real, "reactance_ohm": impedance.imag}
    write_table(columns, path.parent / "impedance.csv")
    entry = '\n[[records]]\nkind = "impedance"\nfile = "impedance.csv"\nmechanical = "free"\n'
    path.write_text(path.read_text() + entry)


def test_a_frequency_response_alone_finds_the_resonance(tmp_path):
    """Displacement over force of the shorted beam: mass, damping and stiffness; the coupling does not show."""
    truth = {"mass": 0.010, "damping": 0.0628, "stiffness": 986.96, "coupling": 1.0e-3, "capacitance": 40e-9}
    frequency, rng = np.linspace(30.0, 70.0, 161), np.random.default_rng(4)
    omega = 2 * np.pi * frequency
    response = 1.0 / (truth["stiffness"] - omega**2 * truth["mass"] + 1j * omega * truth["damping"])
    response = response * (1 + 0.01 * (rng.standard_normal(161) + 1j * rng.standard_normal(161)))
    write_table({"frequency_Hz": frequency, "real": response.real, "imaginary": response.imag}, tmp_path / "frf.csv")
    nominal = {**truth, "mass": 0.011, "damping": 0.09, "stiffness": 900.0}
    lines = ["[transducer]", *(f"{key} = {value!r}" for key, value in nominal.items()), "[[records]]", 'kind = "frf"',
             'file = "frf.csv"', 'output = "displacement"', "[records.shunt]", 'kind = "short"']  # fmt: skip
    (tmp_path / "campaign.toml").write_text("\n".join(lines) + "\n")
    found = by_name(identify(load_campaign(tmp_path / "campaign.toml")))
    for name in ("mass", "damping", "stiffness"):
        assert abs(found[name].value - truth[name]) < 3.5 * found[name].std
        assert found[name].std < 0.01 * truth[name]
    assert not found["coupling"].identifiable
    assert not found["capacitance"].identifiable


def test_nothing_to_fit_is_an_error(tmp_path):
    path, _ = campaign_file(tmp_path, 1)
    path.write_text(path.read_text().replace('role = "fit"', 'role = "validate"'))
    with pytest.raises(CampaignError, match='records: no record has role = "fit"'):
        identify(load_campaign(path))


def test_an_imposed_displacement_behind_a_switch_that_it_times_is_an_error(tmp_path):
    path, _ = campaign_file(tmp_path, 1)
    shunt = 'shunt = { kind = "parallel_sshi", inductance = 0.1, quality = 8.0, dc_voltage = 1.0 }'
    text = path.read_text().replace("load_resistance = 51430.0", shunt)
    path.write_text(text.replace('drive = "force"', 'drive = "displacement"'))
    wrong = r"records\.1\.drive: found an imposed displacement behind parallel_sshi, whose switch would act"
    with pytest.raises(CampaignError, match=wrong):
        identify(load_campaign(path))


def test_a_held_drive_is_freed_of_its_noise():
    rng, time = np.random.default_rng(0), np.arange(4000) / 1000.0
    held = np.where(time < 2, 1000.0, 100.0)
    clean = denoised(held + 0.5 * rng.standard_normal(4000), 0.5)
    calm = (np.abs(time - 2) > 0.2) & (time > 0.2) & (time < 3.8)
    assert np.abs(clean - held)[calm].max() < 0.06


@pytest.mark.parametrize(("lines", "share"), [([2.0], 0.4), ([0.7, 3.1, 47.3], 0.9)])
def test_a_moving_drive_loses_the_noise_of_frequencies_at_which_it_does_not_move(lines, share):
    """A record that does not end as it began has its motion at higher frequencies than its lines, too."""
    rng, time = np.random.default_rng(0), np.arange(10000) / 1000.0
    clean = sum(200.0 * np.sin(2 * np.pi * line * time + line) for line in lines)
    noise = 0.5 * rng.standard_normal(10000)
    left = denoised(clean + noise, 0.5) - clean
    assert np.std(left) < share * 0.5
    # What is taken is noise alone: nothing of the lines, but for the noise at their own frequencies.
    for line in lines:
        wave = np.exp(-2j * np.pi * line * time)
        assert abs(np.mean((left - noise) * wave)) < 1.5e-3
    assert np.array_equal(denoised(clean, 0.0), clean)


def test_the_noise_of_a_slow_drive_is_read_off_its_highest_frequencies():
    rng, time = np.random.default_rng(2), np.arange(10000) / 1000.0
    sigma, count = high_frequency_noise(450.0 * np.sin(2 * np.pi * 2 * time) + 0.5 * rng.standard_normal(10000))
    assert count > 8000
    assert abs(sigma / 0.5 - 1.0) < 4.0 / np.sqrt(2.0 * count)


def test_a_drive_that_fills_the_band_or_jumps_shows_no_noise():
    rng, time = np.random.default_rng(1), np.arange(10000) / 1000.0
    assert high_frequency_noise(np.cumsum(rng.standard_normal(10000))) is None
    assert high_frequency_noise(np.where(time < 5, 0.0, 100.0) + 0.5 * rng.standard_normal(10000)) is None
    assert high_frequency_noise(np.sin(2 * np.pi * 2.0 * time)) is None
    broad = 30.0 * rng.standard_normal(10000)
    assert np.abs(denoised(broad, 0.5) - broad).max() == 0.0


def test_the_step_of_a_sensor_is_read_off_its_values():
    rng = np.random.default_rng(1)
    values = 3e-8 * np.round((1e-6 + 1.2e-8 * rng.standard_normal(20000)) / 3e-8)
    found = rounding(values, 1.48e-8)
    assert found.step == pytest.approx(3e-8)
    assert found.second < 1e-12
    # The mean over all places within a step, by simulation.
    places = np.linspace(0, 3e-8, 24, endpoint=False)
    means = [np.mean(3e-8 * np.round((x + 1.2e-8 * rng.standard_normal(40000)) / 3e-8)) - x for x in places]
    assert found.size == pytest.approx(np.sqrt(2) * np.std(means), rel=0.15)
    assert rounding(rng.standard_normal(1000), 1.0).size == pytest.approx(0.0, abs=1e-12)
    # Fifty samples a period, one of them at the turning point: the least that it moves by is no step of a sensor.
    fast = 2000.0 * np.cos(2 * np.pi * 0.02 * np.arange(10_000)) + rng.standard_normal(10_000)
    assert np.abs(np.diff(fast)).min() > 9.0
    assert max(rounding(fast, 1.0)[1:]) < 1e-3


def test_codes_that_do_not_occur_take_no_memory():
    turns, slopes = np.array([0.2, -1e12, 0.4, 3.0, -1e12]), np.arange(10.0).reshape(5, 2)
    np.testing.assert_allclose(by_code(turns, slopes), [[10.0, 4.0, 6.0], [12.0, 6.0, 7.0]])


def test_spectra_keep_the_sum_of_squares():
    for count in (10, 11):
        values = np.random.default_rng(count).standard_normal((count, 2))
        np.testing.assert_allclose((np.abs(spectra_of(values)) ** 2).sum(axis=0), (values**2).sum(axis=0))
