"""The figure of a switch's schedule."""

import numpy as np
import pytest

from piezoharvest.description.shunts import SECE, ParallelSSHI
from piezoharvest.design.result import Candidate
from piezoharvest.report.figures.schedule import columns, schedule
from piezoharvest.report.subjects import subjects_of

LAGS = [1.4, 1.5, -1.6, -1.5]  # rad: the third is 1.54 half a turn later


def candidate(shunt, **more):
    rows = [
        {"frequency": 48.0 + n, "phase_lag": lag, "harvested_power": 1e-4 * (n + 1), **more}
        for n, lag in enumerate(LAGS)
    ]
    return Candidate(shunt=shunt, harvested_power=2e-4, attenuation_db=-1.0, displacement_amplitude=1e-4,
                     voltage_amplitude=1.0, converged=True, schedule=tuple(rows), scheduled_power=2.5e-4)  # fmt: skip


def test_lag_load_and_power_over_the_frequency():
    bridge = {"inductance": 0.1, "quality": 5.0}
    loaded = ParallelSSHI(smoothing_capacitance=1e-6, load_resistance=1e5, phase_lag=-1.5, **bridge)
    level = ParallelSSHI(dc_voltage=5.0, **bridge)
    subjects = subjects_of(
        [candidate(loaded, load_resistance=2e5), candidate(level, dc_voltage=4.0), candidate(SECE())]
    )
    wanted = [1.4, 1.5, np.pi - 1.6, np.pi - 1.5]
    for subject, load in zip(subjects, ([2e5] * 4, 16 / (1e-4 * np.arange(1, 5)), [np.nan] * 4), strict=True):
        frequency, lags, loads, power = columns(subject)
        assert frequency == pytest.approx([48, 49, 50, 51]) and lags == pytest.approx(wanted)
        assert loads == pytest.approx(load, nan_ok=True) and power == pytest.approx([1e-4, 2e-4, 3e-4, 4e-4])
    lag, load, _ = schedule(subjects, (48.0, 51.0)).axes
    assert lag.lines[0].get_ydata() == pytest.approx(np.degrees(wanted))
    assert lag.lines[1].get_ydata()[0] == pytest.approx(180 - np.degrees(1.5))  # the fixed one lies among them
    assert len(load.lines) == 3  # SECE has no load; that of a dc voltage is not fixed
