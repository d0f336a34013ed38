"""Checks of records of a hammer and an accelerometer: a blow near the beginning, and the response that follows it."""

import numpy as np
import pytest
import scipy.signal
from record_cases import BENCH, record, with_values

from piezoharvest.description.shunts import Resistor
from piezoharvest.records.checks import check
from piezoharvest.study import build_transducer

RATE, LOAD = 2000.0, 1e5


@pytest.fixture(scope="module")
def struck():
    """Two seconds of the specimen behind a resistor, struck for 5 ms after 20 ms; solved by scipy on a finer grid."""
    m, b, k, coupling, capacitance = (BENCH[key] for key in ("mass", "damping", "stiffness", "coupling", "capacitance"))
    a = np.array([[0, 1, 0], [-k / m, -b / m, coupling / m], [0, -coupling / capacitance, -1 / (LOAD * capacitance)]])
    time = np.arange(0.0, 2.0, 0.1 / RATE)
    inside = (time > 0.02) & (time < 0.025)
    force = np.where(inside, np.sin(np.pi * (time - 0.02) / 0.005) ** 2, 0.0)
    outputs = np.array([[1.0, 0, 0], [0, 1.0, 0], a[1], [0, 0, 1.0]])
    system = (a, [[0], [1 / m], [0]], outputs, [[0], [0], [1 / m], [0]])
    _, found, _ = scipy.signal.lsim(system, force, time)
    names = ("displacement", "velocity", "acceleration", "voltage")
    values = {"force": force, **dict(zip(names, found.T, strict=True))}
    rng = np.random.default_rng(1)
    values = {c: v[::10] + 1e-3 * np.max(np.abs(v)) * rng.standard_normal(len(v[::10])) for c, v in values.items()}
    return record(time[::10], values, "force", Resistor(resistance=LOAD)), build_transducer(BENCH)


def judged(of, device):
    return {(finding.check, finding.channel) for finding in check(of, device)}


def test_a_sound_record(struck):
    assert judged(*struck) == set()


@pytest.mark.parametrize("channel", ["displacement", "velocity", "acceleration"])
def test_a_wrong_sign_and_a_wrong_unit(struck, channel):
    of, device = struck
    assert judged(with_values(of, **{channel: -of[channel]}), device) == {("sign", channel)}
    assert judged(with_values(of, **{channel: 1e3 * of[channel]}), device) == {("unit", channel)}


def test_faults_of_voltage_and_force(struck):
    of, device = struck
    assert judged(with_values(of, voltage=1e3 * of["voltage"]), device) == {("unit", "voltage")}
    assert judged(with_values(of, voltage=-of["voltage"]), device) == {("sign", "voltage")}
    assert judged(with_values(of, force=-of["force"]), device) == {("sign", "force")}
    assert judged(with_values(of, force=1e3 * of["force"]), device) == {("unit", "force")}
