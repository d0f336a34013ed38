"""Records that begin in motion behind circuits that remember: flip capacitors, envelopes, filters, amplifiers.

The records are of the bench's solver, from rest; what is given to the fit is their end alone.
"""

import numpy as np
import pytest
from conformance.examples import SPICE
from scipy.signal import butter, lfilter
from studies import BENCH, STOPS

from piezoharvest import Campaign, Hysteresis, Transducer, identify
from piezoharvest.bench.solver import CIRCUITS, Model, integrate
from piezoharvest.description.shunts import (
    SSHC,
    NegativeCapacitance,
    OpAmpNegativeCapacitance,
    ParallelRLC,
    SelfPoweredSSDI,
    SelfPoweredSSHI,
    SpiceCircuit,
)
from piezoharvest.predict.circuit.measured_drive import MeasuredDrive, straight_drive
from piezoharvest.predict.circuit.setting import begins_anywhere

RATE, COUNT, NOISE = 5000.0, 2000, 1e-3
COIL = {"inductance": 0.01, "quality": 6.0}
BREAKER = {**COIL, "envelope_capacitance": 1e-9, "threshold": 0.6}
# Circuits, and the samples at which records begin: with the envelope of a breaker above the voltage, and the amplifier
# at the limit of its output.
CASES = {
    "flip capacitors": (SSHC(dc_voltage=1.0, flip_capacitances=(40e-9, 60e-9), switch_resistance=100.0), 940),
    "envelopes": (SelfPoweredSSDI(diode_drop=0.2, **BREAKER), 1003),
    "envelopes beside a bridge": (SelfPoweredSSHI(dc_voltage=1.0, diode_drop=0.2, **BREAKER), 1003),
    "amplifier": (
        OpAmpNegativeCapacitance(capacitance=24e-9, resistance=8e4, gain_bandwidth=1e5, saturation=2.0), 1003,
    ),
    "filter": (SpiceCircuit(netlist=SPICE, load=("Rload",)), 940),
    "capacitor across the leads": (ParallelRLC(inductance=250.0, resistance=8e4, capacitance=24e-9), 1003),
}  # fmt: skip


def force():
    """Random force (N) between 30 and 80 Hz that comes on slowly."""
    narrow = butter(2, np.array([30.0, 80.0]) / (RATE / 2.0), "band")
    found = lfilter(*narrow, np.random.default_rng(3).normal(size=COUNT))
    return 0.02 * found / found.std() * np.minimum(np.arange(COUNT) / 200.0, 1.0)


def identified(device, shunt, first):
    """Identification from the samples from one on, and the noise of both channels."""
    drive, rng = force(), np.random.default_rng(5)
    lines = straight_drive(drive).coefficients  # what stands for the samples in a fit: straight lines, a little larger
    excitation = MeasuredDrive(values=np.append(lines[:, 0], lines[-1].sum()), size=None, sample_rate=RATE)
    waves = integrate(Model(device, CIRCUITS[shunt.kind](shunt), base=False), excitation, np.arange(COUNT) / RATE)
    columns, noise = {"force_N": drive[first:]}, {}
    for name, unit in (("displacement", "m"), ("voltage", "V")):
        values = getattr(waves, name)[first:]
        noise[name] = NOISE * values.std()
        columns[f"{name}_{unit}"] = values + noise[name] * rng.normal(size=len(values))
    return identify(Campaign.from_arrays(device, [{"data": columns, "sample_rate": RATE, "shunt": shunt}])), noise


SLOW = ("envelopes beside a bridge", "filter")


@pytest.mark.parametrize("case", [pytest.param(case, marks=[pytest.mark.slow] * (case in SLOW)) for case in CASES])
def test_nothing_is_left_but_noise(case):
    shunt, first = CASES[case]
    found, noise = identified(Transducer(**BENCH), shunt, first)
    assert found.converged
    for name, sigma in noise.items():
        assert found.noise.sigma[name] < 1.1 * sigma  # 5 standard errors of the fewest samples
    for estimate in found.estimates:
        assert abs(estimate.value - BENCH[estimate.parameter.path[-1]]) < 4.0 * estimate.std


def test_a_capacitor_across_the_leads_beside_hysteresis():
    device = Transducer(**BENCH, hysteresis=Hysteresis(**STOPS))
    shunt = NegativeCapacitance(capacitance=24e-9, resistance=8e4)
    found, noise = identified(device, shunt, 0)
    assert found.noise.sigma["voltage"] < 1.1 * noise["voltage"]


def test_what_the_engine_predicts():
    across = CASES["capacitor across the leads"][0]
    assert begins_anywhere(across, "force") and not begins_anywhere(across, "voltage")
    assert not begins_anywhere(NegativeCapacitance(capacitance=1e-7, resistance=8e4, topology="series"), "force")
