"""Campaigns of an impedance alone, from its closed form: sizes of motions, which effects may need, are not known."""

import re

import numpy as np
import pytest
from pages import figures_on_the_page_only

from piezoharvest import load_campaign
from piezoharvest.description.effects import registered
from piezoharvest.diagnose import diagnose
from piezoharvest.identify import identify
from piezoharvest.report.diagnosis import write_diagnosis
from piezoharvest.report.identification import write_identification

MASS, DAMPING, STIFFNESS, COUPLING, CAPACITANCE = 0.0100, 0.0628, 986.96, 1e-3, 40e-9
NOISE = 1e-3  # of the impedance, real and imaginary part
TABLES = (
    f"[transducer]\nmass = {MASS}\ndamping = 0.065\nstiffness = 960.0\ncoupling = 0.98e-3\ncapacitance = 41e-9\n"
    '[[records]]\nkind = "impedance"\nfile = "impedance.csv"\n'
    '[records.channels]\nphase = { column = "phase_deg", unit = "deg" }\n'
)


def campaign(folder, conductance):
    """Impedance of the lumped transducer with a conductance beside its capacitance."""
    f = np.linspace(20.0, 120.0, 400)
    s, rng = 2j * np.pi * f, np.random.default_rng(7)
    motional = COUPLING**2 * s / (MASS * s**2 + DAMPING * s + STIFFNESS)
    noise = NOISE * (rng.normal(size=len(f)) + 1j * rng.normal(size=len(f)))
    z = (1.0 + noise) / (s * CAPACITANCE + motional + conductance)
    table = np.column_stack([f, np.abs(z), np.degrees(np.angle(z))])
    header = "frequency_Hz,impedance_ohm,phase_deg"
    np.savetxt(folder / "impedance.csv", table, delimiter=",", header=header, comments="")
    path = folder / "campaign.toml"
    path.write_text(TABLES)
    return load_campaign(path)


def test_nothing_is_missing(tmp_path):
    found = diagnose(campaign(tmp_path, 0.0))
    assert (found.verdict, found.effects) == ("adequate", ())


def test_a_leakage_is_found(tmp_path):
    found = diagnose(campaign(tmp_path, 1e-6))
    names = {named.effect.name for named in found.effects} | {name for names in found.alternatives for name in names}
    assert "leakage" in names
    (leakage,) = [named for named in found.effects if named.effect.name == "leakage"]
    value, std = leakage.values["resistance"][:2]
    assert std is not None and value is not None
    assert value == pytest.approx(1e6, abs=4.0 * std)
    assert std < 0.05e6


def test_standard_errors_are_those_of_the_closed_form(tmp_path):
    """Of a receptance of the open specimen and its impedance, which determine the coupling's square alone."""
    lines, rng = 1000, np.random.default_rng(8)
    f = np.linspace(20.0, 120.0, lines)
    s = 2j * np.pi * f
    truth = np.array([MASS, DAMPING, STIFFNESS, COUPLING, CAPACITANCE, 1e-6])

    def responses(values):
        m, b, k, coupling, c, g = values
        impedance = 1.0 / (s * c + g + coupling**2 * s / (m * s**2 + b * s + k))
        receptance = 1.0 / (m * s**2 + b * s + k + coupling**2 * s / (s * c + g))
        return np.array([receptance, impedance])

    exact = responses(truth)
    noise = NOISE * np.median(np.abs(exact), axis=1, keepdims=True)
    measured = exact + noise * (rng.normal(size=exact.shape) + 1j * rng.normal(size=exact.shape))
    for name, unit, response in zip(("receptance", "impedance"), ("m_N", "impedance_ohm"), measured, strict=True):
        table = np.column_stack([f, np.abs(response), np.degrees(np.angle(response))])
        header = f"frequency_Hz,{unit},phase_deg"
        np.savetxt(tmp_path / f"{name}.csv", table, delimiter=",", header=header, comments="")
    path = tmp_path / "campaign.toml"
    path.write_text(
        TABLES + '[[records]]\nkind = "frf"\nfile = "receptance.csv"\ninput = "force"\n'
        'output = "displacement"\nshunt = { kind = "open" }\n[records.channels]\n'
        'magnitude = { column = "m_N", unit = "m/N" }\nphase = { column = "phase_deg", unit = "deg" }\n'
    )
    estimates = {estimate.parameter.name: estimate for estimate in diagnose(load_campaign(path)).estimates}

    slopes = [(responses(truth + d) - responses(truth - d)) / 2e-6 / noise for d in 1e-6 * np.diag(truth)]
    jacobian = np.array([np.concatenate([slope.real.ravel(), slope.imag.ravel()]) for slope in slopes]).T
    errors = truth * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    names = ("mass", "damping", "stiffness", "coupling", "capacitance")
    for name, value, error in zip(names, truth, errors, strict=False):
        assert estimates[name].std == pytest.approx(error, rel=0.2), name
        assert estimates[name].value == pytest.approx(value, abs=4.0 * error), name


def test_reports_show_the_response_and_one_ratio_to_the_noise(tmp_path):
    """The ratio of the table and the answer is that of the warning: each line over its own noise."""
    measured = campaign(tmp_path, 1e-6)
    found = identify(measured)
    (told,) = re.findall(r"the residual is ([\d.]+) times the noise", found.warnings[0])
    with figures_on_the_page_only():
        page = write_identification(found, tmp_path / "identified").read_text(encoding="utf-8")
    assert f"relative to the noise: voltage/current {told}." in page
    assert f'<span class="bad">{told}</span>' in page
    with figures_on_the_page_only():
        page = write_diagnosis(diagnose(measured), tmp_path / "diagnosed").read_text(encoding="utf-8")
    assert 'id="figure-response_1"' in page and "impedance.csv (fitted)" in page
    for effect in registered():
        assert f'data-effect="{effect}"' in page
