"""What only records show that were not to be fitted: these are fitted then, and the diagnosis says so."""

import numpy as np
import pytest
from diagnose_runs import STEP, campaign

from piezoharvest.description.effects import Clipping, Leakage
from piezoharvest.diagnose import diagnose
from piezoharvest.diagnose.summary import sentence

LIBRARY = [Clipping, Leakage]
SMALL = {"amplitude": 200.0, "offset": 300.0}
LARGE = {"amplitude": 600.0, "offset": 700.0, "frequency": 2.0}
RECORDS = [
    {"load_resistance": 97.78e3, "excitation": STEP},
    {"load_resistance": 51.43e3, "excitation": SMALL},
    {"load_resistance": 97.78e3, "excitation": {**STEP, "amplitude": 1300.0}, "role": "validate"},
    {"load_resistance": 143.8e3, "excitation": LARGE, "role": "validate"},
]
REACHED = 3.7e-6  # m: by the records that are not to be fitted alone


def test_a_range_that_only_they_come_to_is_named_and_validated_with_the_other(tmp_path):
    told = []
    clipped = campaign(tmp_path, {"clipping": {"limit": REACHED, "channel": "displacement"}}, RECORDS)
    found = diagnose(clipped, told.append, library=LIBRARY)
    # It overshadows all else: no search is made without it.
    assert next(text for text in told if "so it is fitted too" in text) == told[1]
    assert told.count("scoring the effects") == 1
    assert found.verdict == "effect"
    (named,) = found.effects
    assert isinstance(named.effect, Clipping)
    assert named.effect.limit == pytest.approx(REACHED, rel=2e-3)
    assert found.also_fitted == ("03_step_force_resistor.csv",)
    assert [record.name for record in found.campaign.of_role("validate")] == ["04_sine_force_resistor.csv"]
    assert named.gain > 0.95
    assert sentence(found).endswith(
        "The residuals of 03_step_force_resistor.csv are larger than those of the records fitted first, "
        "so it was fitted too."
    )


@pytest.mark.slow
def test_healthy_records_that_are_not_fitted_overshadow_nothing(tmp_path):
    plain = diagnose(campaign(tmp_path, records=RECORDS), library=LIBRARY)
    assert (plain.verdict, plain.also_fitted) == ("adequate", ())


# So large that it overshadows what is fitted, and so small that it only shows beside what a search leaves.
@pytest.mark.parametrize(("size", "searches"), [pytest.param(0.02, 1, marks=pytest.mark.slow), (0.002, 2)])
def test_what_has_no_name_is_unexplained_though_no_fitted_record_shows_it(size, searches, tmp_path):
    told, disturbed = [], campaign(tmp_path, records=RECORDS)
    for record in disturbed.of_role("validate"):
        record["voltage"][:] += size * np.sin(2 * np.pi * 181.3 * record["time"])
    found = diagnose(disturbed, told.append, library=LIBRARY)
    assert told.count("scoring the effects") == searches
    assert found.verdict == "unexplained"
    assert len(found.also_fitted) == 1
    assert found.left
