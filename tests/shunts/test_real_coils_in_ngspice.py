"""Netlists of switched coils with core, winding capacitance and switch resistance, run by ngspice."""

import pytest
from oracles.ngspice import needs_ngspice
from studies import BENCH

from piezoharvest import SineForce, System, Transducer
from piezoharvest.description.shunts import (
    DSSH,
    ESSH,
    SCSECE,
    SECE,
    SICE,
    SSDI,
    SSDS,
    SSDV,
    BiasFlip,
    ParallelSSHI,
    SelfPoweredSECE,
    SelfPoweredSeriesSSHI,
    SelfPoweredSSDI,
    SelfPoweredSSHI,
    SeriesSSHI,
)
from piezoharvest.spice.simulators.comparison import compare

SIDE = {"smoothing_capacitance": 1e-7, "load_resistance": 5e5}
BETWEEN = {"intermediate_capacitance": 120e-9}
SECOND = {"second_inductance": 0.02, "second_quality": 20.0, "residual": 0.5}
FIRES = {"envelope_capacitance": 1e-9, "threshold": 0.6, "diode_drop": 0.3}
DIODES = {"diode_drop": 0.05, "diode_resistance": 50.0}
PLAIN = {"inductance": 0.1, "quality": 5.0}
CORED = {**PLAIN, "core_resistance": 1e4}
WOUND = {**PLAIN, "switch_resistance": 20.0, "self_resonance": 20e3}
CIRCUITS = {
    "ssds core": SSDS(**CORED),
    "ssds winding": SSDS(**WOUND),
    "ssdi winding": SSDI(**WOUND),
    "ssdv winding": SSDV(**WOUND, source_voltage=1.0),
    "parallel_sshi both": ParallelSSHI(**WOUND, **SIDE, phase_lag=0.3, core_resistance=1e4),
    "series_sshi core": SeriesSSHI(**CORED, **SIDE, diode_drop=0.1),
    "series_sshi winding": SeriesSSHI(**WOUND, **SIDE, diode_drop=0.1, on_time_error=0.3),
    "bias_flip core": BiasFlip(**CORED, **SIDE, steps=3, bias_capacitance=4e-7),
    "bias_flip winding": BiasFlip(**WOUND, **SIDE, steps=3, bias_capacitance=4e-7),
    "sece core": SECE(**CORED, efficiency=0.9, **DIODES),
    "sece winding": SECE(**WOUND, efficiency=0.9, **DIODES),
    "sece both": SECE(**WOUND, core_resistance=1e4),
    "sc_sece core": SCSECE(**CORED, short_time=2e-3),
    "sc_sece winding": SCSECE(**WOUND, short_time=2e-3),
    "sice core": SICE(**CORED),
    "sice winding": SICE(**WOUND),
    "dssh core": DSSH(**CORED, **BETWEEN, **DIODES),
    "dssh winding": DSSH(**WOUND, **BETWEEN, diode_drop=0.05),
    # With 1e4 ohm, as all others, ngspice ends with "timestep too small".
    "essh core": ESSH(**PLAIN, core_resistance=3e4, **BETWEEN, **SECOND),
    "essh winding": ESSH(**WOUND, **BETWEEN, **SECOND, second_switch_resistance=10.0, second_self_resonance=30e3),
    "self_powered_ssdi winding": SelfPoweredSSDI(**WOUND, **FIRES),
    "self_powered_sshi winding": SelfPoweredSSHI(**WOUND, **FIRES, dc_voltage=5.0),
    "self_powered_series_sshi winding": SelfPoweredSeriesSSHI(**WOUND, **FIRES, dc_voltage=3.0),
    "self_powered_sece winding": SelfPoweredSECE(**WOUND, **FIRES),
}


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize("kind", CIRCUITS)
def test_all_figures_agree(kind):
    figures, trusted = compare(System(Transducer(**BENCH), CIRCUITS[kind]), SineForce(amplitude=0.02, frequency=50.6))
    assert trusted
    for figure in figures:
        assert abs(figure.difference) < 0.01, figure
