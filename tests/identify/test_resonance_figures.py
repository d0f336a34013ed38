"""Resonances and coupling that follow from identified parameters, with their standard errors."""

import math

import numpy as np
import pytest

from piezoharvest import Campaign, Mode, Transducer, identify
from piezoharvest.cli.on_campaigns.identification_output import identification_json
from piezoharvest.description.figures.base import POSITIVE_COUPLING
from piezoharvest.identify.resonance_figures import resonance_figures
from piezoharvest.identify.saving import specimen_of

M, B, K, T, C = 0.118, 2.9, 1.52e5, 0.031, 62e-9
ONE = Transducer(mass=M, damping=B, stiffness=K, coupling=T, capacitance=C)
NAMES = ("mass", "damping", "stiffness", "coupling", "capacitance")
SHORT, OPENED = math.sqrt(K / M) / (2 * math.pi), math.sqrt((K + T**2 / C) / M) / (2 * math.pi)


def figures(transducer, covariance, unknown=()):
    found = resonance_figures(transducer, [(name,) for name in NAMES], covariance, [n not in unknown for n in NAMES])
    return {figure.name: figure for figure in found}


def test_closed_form():
    """Of correlated errors of T and C that leave T^2/C alone, nothing is left in the coupling."""
    relative = np.diag([1e-3, 1e-2, 2e-3, 5e-2, 0.1]) ** 2
    relative[0, 2] = relative[2, 0] = 0.5 * 1e-3 * 2e-3
    relative[3, 4] = relative[4, 3] = 5e-2 * 0.1
    values = np.array([M, B, K, T, C])
    found = figures(ONE, relative * np.outer(values, values))
    assert [found[name].value for name in found] == pytest.approx([SHORT, OPENED, T**2 / (K * C)], rel=1e-12)
    assert found["short_circuit_frequency"].std == pytest.approx(SHORT / 2 * math.sqrt(1e-6 + 4e-6 - 2e-6), rel=1e-6)
    assert found["coupling_squared"].std == pytest.approx(2e-3 * T**2 / (K * C), rel=1e-6)


def test_what_depends_on_a_parameter_that_is_not_known_is_left_out():
    covariance = np.zeros((5, 5))
    assert list(figures(ONE, covariance, ("damping",))) == list(figures(ONE, covariance))
    assert list(figures(ONE, covariance, ("capacitance",))) == ["short_circuit_frequency"]
    assert figures(ONE, covariance, ("stiffness",)) == {}


def test_several_modes_have_numbers():
    two = Transducer(
        mass=M, damping=B, stiffness=K, coupling=T, capacitance=C,
        modes=(Mode(mass=M, damping=B, stiffness=9 * K, coupling=T),),
    )  # fmt: skip
    paths = [(name,) for name in NAMES] + [("modes", 0, name) for name in ("mass", "stiffness", "coupling")]
    found = {figure.name: figure for figure in resonance_figures(two, paths, np.zeros((8, 8)), [True] * 8)}
    assert len(found) == 6
    assert found["short_circuit_frequency.1"].value == pytest.approx(3 * SHORT, rel=1e-12)


def test_from_mobilities_the_coupling_is_known_better_than_what_it_is_made_of():
    """Of two responses on a dense grid with noise of 0.4 %: the true values lie within four standard errors."""
    rng = np.random.default_rng(7)
    f = np.linspace(150, 215, 300)
    s = 2j * np.pi * f
    records = []
    for load in (1.0, 1e7):
        mobility = s / (K + B * s + M * s**2 + T**2 * s / (s * C + 1 / load))
        mobility *= 1 + 0.004 * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size))
        data = {"frequency_Hz": f, "response": mobility}
        records.append({"data": data, "kind": "frf", "output": "velocity", "load_resistance": load})
    nominal = Transducer(mass=0.12, damping=3.0, stiffness=1.54e5, coupling=0.0315, capacitance=63e-9)
    found = identify(Campaign.from_arrays(nominal, records))
    known = {figure.name: figure for figure in found.resonances}
    for name, true in zip(known, (SHORT, OPENED, T**2 / (K * C)), strict=True):
        assert abs(known[name].value - true) < 4 * known[name].std
    coupling = next(e for e in found.estimates if e.parameter.name == "coupling")
    share = known["coupling_squared"].std / known["coupling_squared"].value
    assert coupling.std is not None and share < 0.02 * coupling.std / coupling.value
    table = identification_json(found)["resonances"]["open_circuit_frequency"]
    assert table == {"value": known["open_circuit_frequency"].value, "std": known["open_circuit_frequency"].std,
                     "unit": "Hz"}  # fmt: skip


@pytest.mark.parametrize("sensed", ["velocity", "voltage"])
def test_a_specimen_that_is_known_as_a_whole_assumes_nothing_but_a_sign(sensed):
    """What a modal test assumes is behind nominal values: only the sign of T stays one that no record tells."""
    f = np.linspace(150, 215, 300)
    s, rng = 2j * np.pi * f, np.random.default_rng(8)
    records = []
    for load in (1e3, 2e5):
        v = s / (K + B * s + M * s**2 + T**2 * s / (s * C + 1 / load))
        response = v if sensed == "velocity" else -T * v / (s * C + 1 / load)
        response = response * (1 + 0.002 * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size)))
        data = {"frequency_Hz": f, "response": response}
        records.append({"data": data, "kind": "frf", "output": sensed, "load_resistance": load})
    nominal = Transducer.from_modal(
        short_circuit_frequency=180.0, open_circuit_frequency=189.0, quality=45.0, modal_mass=M, capacitance=69e-9,
        capacitance_is="free",
    )  # fmt: skip
    assert len(nominal.assumptions) == 2
    found = identify(Campaign.from_arrays(nominal, records))
    assert all(estimate.identifiable for estimate in found.estimates)
    kept = specimen_of(found.found, found.estimates, found.campaign).transducer.assumptions
    assert kept == ((POSITIVE_COUPLING,) if sensed == "velocity" else ())
