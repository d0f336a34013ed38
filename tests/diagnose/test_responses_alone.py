"""Campaigns of an impedance alone, from its closed form: sizes of motions, which effects may need, are not known."""

import numpy as np
import pytest

from piezoharvest import load_campaign
from piezoharvest.diagnose import diagnose

MASS, DAMPING, STIFFNESS, COUPLING, CAPACITANCE = 0.0100, 0.0628, 986.96, 1e-3, 40e-9
NOISE = 1e-3  # of the impedance, real and imaginary part


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
    path.write_text(
        f"[transducer]\nmass = {MASS}\ndamping = 0.065\nstiffness = 960.0\ncoupling = 0.98e-3\ncapacitance = 41e-9\n"
        '[[records]]\nkind = "impedance"\nfile = "impedance.csv"\n'
        '[records.channels]\nphase = { column = "phase_deg", unit = "deg" }\n'
    )
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
