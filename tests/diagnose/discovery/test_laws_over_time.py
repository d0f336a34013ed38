"""Laws over the time since a record began, in s, whatever the length of the record or of the simulation."""

import numpy as np
import pytest
from nameless import BEAM, Drive, Laws, nameless_campaign

from piezoharvest import Resistor, StepForce, System, Transducer, simulate
from piezoharvest.description.effects import CouplingDrift
from piezoharvest.description.effects.nameless.forms import Line, Power
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.places import OverTime, Reading
from piezoharvest.diagnose.discovery.forms.known import known_effects
from piezoharvest.diagnose.discovery.law_fits import fitted
from piezoharvest.diagnose.discovery.visited import visited_inputs
from piezoharvest.identify.fitting.output_error import mean_square
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.identification import identify
from piezoharvest.identify.preparation import prepared
from piezoharvest.records import load_campaign

LOAD, RATE, DRIFT = 1e5, 1000.0, -0.3  # ohm, Hz, V over a second


def reading(true):
    return DRIFT * np.sqrt(true["time_s"])


def test_a_drift_is_the_same_in_records_of_different_lengths(tmp_path):
    """As a share of the record it was another one in each: half of it was left in the shorter records."""
    drives = [Drive((0.02,), (frequency,)) for frequency in (48.0, 52.0, 50.0)]
    nameless_campaign(
        tmp_path, "beam", Laws(reading={"voltage": reading}), [(each, LOAD) for each in drives], rate=RATE
    )
    lines = (tmp_path / "r1.csv").read_text().splitlines(keepends=True)
    (tmp_path / "r1.csv").write_text("".join(lines[: len(lines) // 3]))
    campaign = load_campaign(tmp_path / "campaign.toml")
    problem, base = Problem(prepared(campaign, "fit"), campaign.transducer, ()), identify(campaign).found
    visited = visited_inputs(problem, base)["time"]
    assert visited.max() == pytest.approx(2.0 - 1.0 / RATE)
    law = Law(place=Reading("voltage", "time"), form=Power(factor=-0.1, exponent=0.7, scale=1.0, odd=False))
    found = fitted(problem, base, law, visited)
    form = found.law.form
    assert form.factor / form.scale**form.exponent == pytest.approx(DRIFT, rel=0.01)
    assert form.exponent == pytest.approx(0.5, abs=0.01)
    assert mean_square(found.found) < 1.2 < 5.0 < mean_square(base)


@pytest.mark.parametrize("duration", [0.3, 0.6])
def test_a_simulation_takes_it_over_its_own_length(duration):
    """The known drift is told by what it comes to over a record."""
    rate = 0.4  # of the coupling, in a second
    law = Law(place=OverTime("coupling"), form=Line(factor=rate))
    known = CouplingDrift(relative_drift=rate * duration)
    assert list(known_effects(law, Transducer(**BEAM), duration)) == [known]
    waves = [
        simulate(
            System(Transducer(**BEAM, effects=(effect,)), Resistor(resistance=LOAD)),
            StepForce(amplitude=0.05, duration=duration), transient=duration, attenuation=False,
        ).waveforms
        for effect in (law, known)
    ]  # fmt: skip
    assert np.abs(waves[0].voltage - waves[1].voltage).max() < 1e-9 * np.abs(waves[1].voltage).max()
