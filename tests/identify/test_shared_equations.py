"""What depends on the equations alone is made once for all records that have these, and not where elements differ."""

import numpy as np
import pytest
from identify.identify_runs import LINEAR, STACK

from piezoharvest.description.shunts import Resistor
from piezoharvest.identify.fitting.data import data_of
from piezoharvest.identify.fitting.evaluation import whiteners
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.noise.noise_model import Noise
from piezoharvest.records.record import Record, Signal
from piezoharvest.study import build_transducer

SIGMA = {"force": 0.5, "voltage": 1e-3, "current": 3e-8}


def record(frequency, resistance, count=300):
    time = np.arange(count) / 1000.0
    wave = np.sin(2 * np.pi * frequency * time)
    columns = {"force": 400 * wave, "voltage": wave, "current": wave / resistance}
    signals = {name: Signal(values, SIGMA[name], "", "", 1) for name, values in columns.items()}
    clock, shunt = Signal(time, None, "", "", 1), Resistor(resistance=resistance)
    return Record(str(frequency), "records.0", "fit", "force", shunt, 0.0, clock, signals)


@pytest.mark.parametrize(("device", "shared"), [(LINEAR, True), (STACK, False)], ids=["linear", "hysteresis"])
def test_whitening(device, shared):
    transducer = build_transducer(device)
    records = [record(5.0, 1e5), record(9.0, 1e5), record(5.0, 5e4)]
    problem = Problem([data_of(each, transducer) for each in records], transducer, ())
    model = Model(transducer, (), ())
    nuisance = problem.start(model)
    first, second, other = whiteners(problem, model, nuisance, Noise(SIGMA))
    assert (first.of(300) is second.of(300)) == shared
    assert first.of(300) is not other.of(300)
    # Made for each record alone, they are the same.
    alone = Problem([problem.data[1]], transducer, ())
    fresh = Model(transducer, (), ())
    (again,) = whiteners(alone, fresh, nuisance[1:2], Noise(SIGMA))
    assert np.array_equal(again.of(300), second.of(300))
    (louder,) = whiteners(alone, model, nuisance[1:2], Noise({**SIGMA, "voltage": 2e-3}))
    assert not np.allclose(louder.of(300), second.of(300))
