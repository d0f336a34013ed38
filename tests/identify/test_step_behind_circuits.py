"""A step of force that comes as a record begins, behind diodes: from rest under its first value nothing would move."""

import numpy as np
import pytest
from studies import BENCH

from piezoharvest import Campaign, Transducer, identify
from piezoharvest.bench.solver import CIRCUITS, Model, integrate
from piezoharvest.description.excitation import StepForce
from piezoharvest.description.shunts import Rectifier

RATE, COUNT, NOISE = 5000.0, 1000, 1e-3
CHANNELS = {"displacement": "m", "velocity": "m_s", "voltage": "V"}


def record(device, shunt, force, rng, noise):
    excitation = StepForce(amplitude=force, duration=1.0, rise_time=0.0)
    waves = integrate(Model(device, CIRCUITS[shunt.kind](shunt), base=False), excitation, np.arange(COUNT) / RATE)
    columns = {"force_N": force + 1e-5 * force * rng.normal(size=COUNT)}
    for channel, unit in CHANNELS.items():
        values = getattr(waves, channel)
        columns[f"{channel}_{unit}"] = values + NOISE * np.abs(values).max() * rng.normal(size=COUNT)
        noise[channel] = NOISE * np.abs(values).max()  # of the larger step in the end
    return {"data": columns, "sample_rate": RATE, "shunt": shunt}


def test_values_are_those_of_the_specimen():
    device, rng = Transducer(**BENCH), np.random.default_rng(4)
    shunt = Rectifier(smoothing_capacitance=40e-9, load_resistance=2e5)
    noise = dict[str, float]()
    records = [record(device, shunt, force, rng, noise) for force in (0.02, 0.06)]
    found = identify(Campaign.from_arrays(device, records))
    assert found.converged
    for channel in CHANNELS:
        assert found.noise.sigma[channel] < 1.1 * noise[channel]
    values = {estimate.parameter.path[-1]: estimate for estimate in found.estimates}
    for name in ("coupling", "capacitance"):  # steps tell the others but for a factor that they have in common
        assert values[name].value == pytest.approx(BENCH[name], rel=1e-3)
