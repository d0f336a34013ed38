"""Lines: what is told of their frequency and their amplitude, against the Cramer-Rao bound."""

import numpy as np
import pytest
from diagnose_runs import SIGMA, campaign, fitted, reading

from piezoharvest.description.effects import Leakage, MainsHum
from piezoharvest.diagnose import diagnose
from piezoharvest.diagnose.selection.score_tests import effect_parameters, extended
from piezoharvest.identify.fitting.output_error import covariance, fit
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_model
from piezoharvest.identify.preparation import prepared

FREQUENCY, AMPLITUDE = 50.013, 2e-3  # Hz, V


def test_the_frequency_is_told_as_well_as_it_can_be(tmp_path):
    measured = campaign(tmp_path)
    problem, found, _ = fitted(prepared(measured, "fit"), measured.transducer)
    bound, humming = 0.0, []
    for n, data in enumerate(problem.data):
        time = np.arange(len(data)) * data.setting.sample_time
        hum = AMPLITUDE * np.sin(2 * np.pi * FREQUENCY * time + n)
        humming.append(reading(data, "voltage", lambda values, hum=hum: values + hum))
        bound += 0.5 * (2 * np.pi * AMPLITUDE / SIGMA["voltage"]) ** 2 * np.sum((time - time.mean()) ** 2)
    problem = Problem(humming, problem.nominal, problem.offset_channels)
    start = MainsHum(amplitude=0.0, frequency=50.1, channel="voltage")
    model = extended(found.model, [start], effect_parameters([start], 0))
    nuisance = nuisance_for_model(problem, found.model, found.nuisance, model)
    line = fit(problem, model, nuisance, found.noise, estimate_noise=False)
    assert line.converged
    (k,) = (k for k, parameter in enumerate(model.parameters) if parameter.path[0] == "effects")
    (hum,) = line.model.transducer.effects
    std = hum.frequency * np.sqrt(covariance(line)[k, k])  # the logarithm is varied
    assert std == pytest.approx(bound**-0.5, rel=0.05)
    assert abs(hum.frequency - FREQUENCY) < 4.0 * std


def test_the_amplitude_has_a_standard_error(tmp_path):
    table = {"amplitude": AMPLITUDE, "frequency": FREQUENCY, "channel": "voltage"}
    found = diagnose(campaign(tmp_path, {"mains_hum": table}), library=[Leakage, MainsHum])
    (named,) = found.effects
    value, std, _ = named.values["amplitude"]
    # The current, without the line, tells a part of what the drive's noise does to the voltage.
    white = np.sqrt(2.0 / sum(len(record) for record in found.campaign.of_role("fit")))
    assert SIGMA["voltage"] * white < std < found.validation_after.noise["voltage"] * white
    assert abs(value - AMPLITUDE) < 4.0 * std
