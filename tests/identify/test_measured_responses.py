"""Impedances and frequency responses by closed forms, their resonance far from the nominal one: found, or said."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from selection import with_slow

from piezoharvest.cli import main
from piezoharvest.identify.identification import identify
from piezoharvest.records import load_campaign

FIELD_CASE = Path(__file__).parents[2].parent / "shared" / "field_cases" / "impedance_false_minimum_silent"
# Quality of the resonance, and by how much the nominal one is off.
OFF = [(300, 0.1), (300, -0.1), (1000, 0.05), (1000, -0.05), (50_000, 0.003), (50_000, -0.003)]


@dataclass
class Specimen:
    """One mode with electrodes: resonance of 20 Hz to 50 kHz, k_e^2 of 1e-3 to 0.1."""

    seed: int
    quality: float

    def __post_init__(self):
        self.rng = np.random.default_rng(self.seed)
        self.resonance = 10 ** self.rng.uniform(1.3, 4.7)
        self.mass, self.capacitance = 10 ** self.rng.uniform(-6, 0), 10 ** self.rng.uniform(-12, -6)
        w = 2 * np.pi * self.resonance
        self.stiffness, self.damping = self.mass * w**2, self.mass * w / self.quality
        self.coupling = np.sqrt(10 ** self.rng.uniform(-3, -1) * self.stiffness * self.capacitance)
        self.frequency = self.resonance * np.linspace(0.9, 1.2, 401)

    def compliance(self, stiffness):
        w = 2 * np.pi * self.frequency
        return 1 / (stiffness - self.mass * w**2 + 1j * w * self.damping)

    def impedance(self):
        """Of the free leads."""
        admittance = self.capacitance + self.coupling**2 * self.compliance(self.stiffness)
        return 1 / (2j * np.pi * self.frequency * admittance)

    def displacement(self):
        """For a force, electrodes open."""
        return self.compliance(self.stiffness + self.coupling**2 / self.capacitance)

    def campaign(self, directory, response, head, off, noise=1e-3):
        """Campaign of one response, with so much relative noise, whose nominal resonance is off."""
        count = len(response)
        magnitude = np.abs(response) * (1 + noise * self.rng.standard_normal(count))
        phase = np.angle(response) + noise * self.rng.standard_normal(count)
        rows = np.column_stack([self.frequency, magnitude, np.degrees(phase)])
        np.savetxt(directory / "response.csv", rows, delimiter=",", fmt="%.12g")
        nominal = {
            "mass": self.mass, "damping": 1.5 * self.damping, "stiffness": self.stiffness * (1 + off) ** 2,
            "coupling": 1.1 * self.coupling, "capacitance": 0.92 * self.capacitance,
        }  # fmt: skip
        text = ["[transducer]", *(f"{key} = {float(value)!r}" for key, value in nominal.items()), "[[records]]", *head]
        text += [
            'file = "response.csv"',
            "[records.channels]",
            "frequency = { column = 1 }",
            "magnitude = { column = 2 }",
        ]
        text += ['phase = { column = 3, unit = "deg" }']
        path = directory / "campaign.toml"
        path.write_text("\n".join(text) + "\n")
        return path


IMPEDANCE = ['kind = "impedance"']
DISPLACEMENT = ['kind = "frf"', 'input = "force"', 'output = "displacement"', 'shunt = { kind = "open" }']


def found(path):
    result = identify(load_campaign(path))
    return result, {estimate.parameter.name: estimate for estimate in result.estimates}


@pytest.mark.parametrize(("quality", "off"), OFF)
@pytest.mark.parametrize("seed", [7100, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (7101, 7102))])
def test_an_impedance_finds_its_resonance(tmp_path, quality, off, seed):
    true = Specimen(seed, quality)
    result, estimates = found(true.campaign(tmp_path, true.impedance(), IMPEDANCE, off))
    assert result.converged and not result.doubts
    capacitance = estimates["capacitance"]
    assert capacitance.identifiable
    assert abs(capacitance.value - true.capacitance) < 4 * capacitance.std
    assert capacitance.std < 1e-3 * true.capacitance
    device = result.transducer
    resonance = np.sqrt(device.stiffness / device.mass) / (2 * np.pi)
    assert resonance == pytest.approx(true.resonance, rel=0.1 / true.quality)
    assert np.sqrt(device.stiffness * device.mass) / device.damping == pytest.approx(true.quality, rel=0.1)
    assert device.coupling**2 / device.mass == pytest.approx(true.coupling**2 / true.mass, rel=0.02)


@pytest.mark.parametrize(("quality", "off"), OFF)
def test_a_frequency_response_finds_its_resonance(tmp_path, quality, off):
    true = Specimen(7200, quality)
    result, estimates = found(true.campaign(tmp_path, true.displacement(), DISPLACEMENT, off))
    assert result.converged and not result.doubts
    device, opened = result.transducer, true.stiffness + true.coupling**2 / true.capacitance
    stiffness = device.stiffness + device.coupling**2 / device.capacitance
    assert np.sqrt(stiffness / device.mass) == pytest.approx(np.sqrt(opened / true.mass), rel=0.1 / quality)
    assert device.mass == pytest.approx(true.mass, rel=0.01)
    assert device.damping == pytest.approx(true.damping, rel=0.1)
    assert not estimates["capacitance"].identifiable  # the open electrodes are not seen


@pytest.mark.parametrize(("output", "rate"), [("velocity", 1), ("acceleration", 2)])
def test_a_mobility_or_an_accelerance_tells_what_the_receptance_does(tmp_path, output, rate):
    """The same relative noise on (jw)^n times the same response, with the nominal resonance 5 % off."""
    results = []
    for name, times in (("displacement", 0), (output, rate)):
        true = Specimen(7200, 1000)
        response = true.displacement() * (2j * np.pi * true.frequency) ** times
        (tmp_path / name).mkdir()
        head = [line.replace("displacement", name) for line in DISPLACEMENT]
        results.append(found(true.campaign(tmp_path / name, response, head, 0.05))[1])
    for key in ("mass", "damping", "stiffness"):
        receptance, other = (estimates[key] for estimates in results)
        # A fit ends where -2 ln L would fall by less than 0.01: within a tenth of a standard error, in each of the two.
        assert other.value == pytest.approx(receptance.value, abs=0.2 * receptance.std)
        assert other.std == pytest.approx(receptance.std, rel=0.02)


@pytest.mark.slow
def test_standard_errors_hold(tmp_path):
    """Errors of the capacitance in units of their standard error, of 30 specimens: as of a normal distribution."""
    off = []
    for seed in range(7300, 7330):
        true = Specimen(seed, quality=100 if seed % 2 else 1000)
        _, estimates = found(true.campaign(tmp_path, true.impedance(), IMPEDANCE, 0.03, noise=3e-3))
        off.append((estimates["capacitance"].value - true.capacitance) / estimates["capacitance"].std)
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.4  # 3 standard deviations of it
    assert np.abs(off).max() < 4.5


def test_a_resonance_that_the_model_has_not_is_said(tmp_path, capsys):
    """Two modes in the sweep, one in the model: the residual is not taken for noise."""
    true, other = Specimen(7400, 200), Specimen(7400, 300)
    other.stiffness *= 1.1**2
    w = 2j * np.pi * true.frequency
    charge = 1 / (w * true.impedance()) + other.coupling**2 * other.compliance(other.stiffness)
    path = true.campaign(tmp_path, 1 / (w * charge), IMPEDANCE, 0.01)
    assert main(["identify", str(path), "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert not told["trusted"]
    near = 1.1 * true.resonance
    place = float(told["warnings"][0].split("near ")[1].split(" Hz")[0])
    assert place == pytest.approx(true.resonance, rel=0.02) or place == pytest.approx(near, rel=0.02)
    assert "misses a resonance" in told["warnings"][0]


@pytest.mark.parametrize("seed", with_slow(range(7500, 7508), slow=lambda seed: seed > 7503))
def test_what_is_called_determined_is_known_to_half_its_value(tmp_path, seed):
    """Below the resonance, far above it or beside it: no parameter is determined by a vague standard error."""
    true = Specimen(seed, 50)
    begin = 10 ** true.rng.uniform(-2, 0.5)
    true.frequency = true.resonance * np.linspace(begin, 1.3 * begin, 60)
    _, estimates = found(true.campaign(tmp_path, true.impedance(), IMPEDANCE, 0.02, noise=0.01))
    for name, estimate in estimates.items():
        if estimate.identifiable:
            assert estimate.std < 0.5 * abs(estimate.value), name
            if not estimate.assumes:
                assert abs(estimate.value - getattr(true, name)) < 5 * estimate.std, name
        else:
            assert estimate.experiment, name
    assert not estimates["mass"].identifiable  # an impedance alone tells ratios


@pytest.mark.skipif(not FIELD_CASE.exists(), reason="../shared is absent")
def test_a_sweep_of_a_user():
    """Quality 1000, the nominal resonance 5 % off: the capacitance was 15 standard errors off, exit 0."""
    result, estimates = found(FIELD_CASE / "campaign.toml")
    device = result.transducer
    assert not result.doubts
    assert np.sqrt(device.stiffness * device.mass) / device.damping == pytest.approx(1000, rel=5e-3)
    assert estimates["capacitance"].value == pytest.approx(1.5e-12, abs=3 * estimates["capacitance"].std)
