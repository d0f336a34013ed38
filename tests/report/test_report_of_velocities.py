"""A report of a diagnosis whose records have a velocity, as of a laser vibrometer, and no displacement."""

import numpy as np
import pytest
from pages import figures_on_the_page_only
from scipy.integrate import solve_ivp
from sweeps import linear_sweep

from piezoharvest import Campaign
from piezoharvest.diagnose import diagnose
from piezoharvest.report.diagnosis import write_diagnosis

TRUE = {"mass": 0.0123, "damping": 0.21, "stiffness": 4200.0, "coupling": 2.1e-3, "capacitance": 62e-9}
RATE, DURATION, LOAD, CUBIC = 2000.0, 0.5, 150e3, 6e8
SWEEP = linear_sweep(50.0, DURATION, 130.0)  # Hz


@pytest.fixture(scope="module")
def found():
    m, b, k, coupling, c = TRUE.values()
    time, records, rng = np.arange(round(RATE * DURATION)) / RATE, [], np.random.default_rng(3)
    for amplitude, role in ((0.2, "fit"), (0.6, "fit"), (0.4, "validate")):

        def force(t, amplitude=amplitude):
            return amplitude * SWEEP(t)

        def rates(t, y, force=force):
            x, v, u = y.tolist()
            return [v, (force(t) - b * v - k * x - CUBIC * x**3 + coupling * u) / m, (-coupling * v - u / LOAD) / c]

        options = {"method": "DOP853", "rtol": 1e-7, "atol": [1e-10, 1e-8, 1e-7]}
        _, v, u = solve_ivp(rates, (0.0, time[-1]), [0, 0, 0], t_eval=time, **options).y
        data = {"force_N": force(time), "velocity_m_s": v, "voltage_V": u}
        data = {name: values + 2e-3 * values.std() * rng.normal(size=len(time)) for name, values in data.items()}
        records.append({"data": {"time_s": time, **data}, "load_resistance": LOAD, "role": role})
    return diagnose(Campaign.from_arrays(TRUE, records))


def test_is_written(found, tmp_path):
    assert [each.effect.name for each in found.effects] == ["stiffening"]
    assert found.effects[0].effect.cubic_stiffness == pytest.approx(CUBIC, rel=0.01)
    with figures_on_the_page_only():
        page = write_diagnosis(found, tmp_path / "report").read_text()
    assert "Where it shows: velocity" in page
