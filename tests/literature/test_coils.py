"""Real coils: admittances by formula, where the energy goes, and the netlist."""

import numpy as np
import pytest
from oracles.ngspice import needs_ngspice, run_netlist
from studies import BENCH, DRIVE

from piezoharvest import simulate
from piezoharvest.description.excitation import SineForce
from piezoharvest.description.shunts import ParallelRL, SeriesRL
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.linear import admittance, frequency_response
from piezoharvest.spice import export_spice

DEVICE = Transducer(**BENCH)
SINE = SineForce(amplitude=DRIVE["amplitude"], frequency=DRIVE["frequency"])
L, R, WINDING, CORE, RESONANCE = 220.0, 3e4, 8e3, 1e6, 180.0
FREQUENCIES = np.array([5.0, 50.6, 178.0, 900.0])
REAL = [
    {"winding_resistance": WINDING},
    {"core_resistance": CORE},
    {"winding_resistance": WINDING, "core_resistance": CORE},
    {"self_resonance": RESONANCE},
    {"winding_resistance": WINDING, "self_resonance": RESONANCE},
    {"core_resistance": CORE, "self_resonance": RESONANCE},
    {"winding_resistance": WINDING, "core_resistance": CORE, "self_resonance": RESONANCE},
]


def coil(s, winding_resistance=0.0, core_resistance=np.inf, self_resonance=np.inf):
    """Impedance of a coil: the capacitance of the winding is across all of it (Massarini & Kazimierczuk, 1997)."""
    stray = 1 / ((2 * np.pi * self_resonance) ** 2 * L)
    return 1 / (1 / wound(s, winding_resistance, core_resistance) + s * stray)


def wound(s, winding_resistance=0.0, core_resistance=np.inf):
    """Impedance of its inductance with core and winding."""
    return winding_resistance + 1 / (1 / (s * L) + 1 / core_resistance)


@pytest.mark.parametrize("keys", REAL)
def test_admittance_of_a_real_coil(keys):
    s = 2j * np.pi * FREQUENCIES
    series, parallel = (cls(inductance=L, resistance=R, **keys) for cls in (SeriesRL, ParallelRL))
    assert admittance(series, FREQUENCIES) == pytest.approx(1 / (R + coil(s, **keys)), rel=1e-10)
    assert admittance(parallel, FREQUENCIES) == pytest.approx(1 / R + 1 / coil(s, **keys), rel=1e-10)


@pytest.mark.parametrize("cls", [SeriesRL, ParallelRL])
def test_what_coil_and_core_take_is_no_harvest(cls):
    shunt = cls(inductance=L, resistance=R, **REAL[-1])
    response = simulate(System(DEVICE, shunt), SINE)
    s = 2j * np.pi * SINE.frequency
    voltage = SINE.amplitude * frequency_response(System(DEVICE, shunt), np.array([SINE.frequency])).voltage[0]
    current = voltage / (coil(s, **REAL[-1]) + (R if cls is SeriesRL else 0.0))
    across = current * coil(s, **REAL[-1])
    inner = across / wound(s, WINDING, CORE)
    lost = 0.5 * (abs(inner) ** 2 * WINDING + abs(across - inner * WINDING) ** 2 / CORE)
    assert response.energy["shunt_loss"] / response.period == pytest.approx(lost, rel=1e-8)
    harvested = abs(current) ** 2 * R if cls is SeriesRL else abs(voltage) ** 2 / R
    assert response.harvested_power == pytest.approx(0.5 * harvested, rel=1e-8)
    assert response.energy["closure"] < 1e-10


@needs_ngspice
@pytest.mark.parametrize("cls", [SeriesRL, ParallelRL])
def test_ngspice_has_the_same_coil(cls):
    shunt = cls(inductance=L, resistance=R, **REAL[-1])
    response, found = simulate(System(DEVICE, shunt), SINE), run_netlist(export_spice(DEVICE, shunt, SINE))
    assert found["harvested_power"] == pytest.approx(response.harvested_power, rel=3e-3)
    assert found["displacement_pp"] == pytest.approx(2 * response.displacement_amplitude, rel=2e-3)
