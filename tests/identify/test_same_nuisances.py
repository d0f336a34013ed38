"""A start and an offset that are the same behind open electrodes leave what is known of the parameters as it is."""

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim

from piezoharvest import identify, load_campaign
from piezoharvest.identify.fitting.output_error import posterior

TRUE = {"mass": 6.687e-3, "damping": 2.206e-2, "stiffness": 89.46, "coupling": 1.824e-3, "capacitance": 1.182e-6}
NOMINAL = {"mass": 6.618e-3, "damping": 2.381e-2, "stiffness": 100.5, "coupling": 1.809e-3, "capacitance": 1.187e-6}
SAMPLE, COUNT = 1.3e-3, 6000
FINER = 16  # steps in a sample, between which the force of the simulation is straight


@pytest.mark.parametrize("seed", range(20))
def test_variances_of_parameters_are_those_without_the_pair(seed):
    rng = np.random.default_rng(seed)
    slopes = rng.standard_normal((60, 12)) * 10.0 ** rng.uniform(-6, 8, 12)
    twin = np.column_stack([slopes, slopes[:, -1] * 10.0 ** rng.uniform(-6, 6)])  # the last two are one
    prior = np.diag([1e-2] * 5 + [0.0] * 8)
    with_pair, without = posterior(twin.T @ twin, prior), posterior(slopes.T @ slopes, prior[:12, :12])
    np.testing.assert_allclose(np.diag(with_pair)[:11], np.diag(without)[:11], rtol=1e-6)
    assert np.all(np.diag(with_pair)[11:] > 1e6 * np.diag(without)[11])


def motion(load):
    """State space of a transducer with a load resistance (ohm), of force; displacement and voltage; `lsim` of SciPy."""
    m, d, k, t, c = TRUE.values()
    a = [[0, 1, 0], [-k / m, -d / m, t / m], [0, -t / c, -1 / (load * c)]]
    return StateSpace(a, [[0], [1 / m], [0]], [[1, 0, 0], [0, 0, 1]], [[0], [0]])


def test_a_record_with_open_electrodes_beside_others(tmp_path):
    """Once nothing was determined, and values stayed nominal with residuals of 80 times the noise."""
    rng, fine = np.random.default_rng(5), SAMPLE / FINER * np.arange(COUNT * FINER)
    frequency = np.sqrt(TRUE["stiffness"] / TRUE["mass"]) / (2 * np.pi)
    lines = [f"{name} = {value}" for name, value in NOMINAL.items()]
    text = "\n".join(["[transducer]", *lines, '[channels]\ndisplacement = {column = "x"}\nvoltage = {column = "v"}'])
    for number, load in enumerate((7820.0, 40200.0, 12900.0, np.inf)):
        tones = frequency * rng.uniform(0.6, 1.4, 12)
        force = 0.03 * np.sin(2 * np.pi * fine[:, None] * tones + rng.uniform(0, 2 * np.pi, 12)).sum(axis=1)
        waves = lsim(motion(load), force, fine)[1][::FINER]
        waves += 1e-3 * waves.std(axis=0) * rng.standard_normal(waves.shape)
        table = np.column_stack([fine[::FINER], force[::FINER], waves])
        np.savetxt(tmp_path / f"{number}.csv", table, delimiter=",", header="time_s,force_N,x,v", comments="")
        load_text = f"load_resistance = {load}" if np.isfinite(load) else 'shunt = {kind = "open"}'
        text += f'\n[[records]]\nfile = "{number}.csv"\nrole = "fit"\ndrive = "force"\n{load_text}\n'
    (tmp_path / "campaign.toml").write_text(text)
    found = identify(load_campaign(tmp_path / "campaign.toml"))
    assert all(each.identifiable for each in found.estimates)
    for each in found.estimates:
        assert each.value == pytest.approx(TRUE[each.parameter.name], rel=2e-3), each
