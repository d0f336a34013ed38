"""Laws over the time since a record began, in s, whatever the length of the record or of the simulation."""

import numpy as np
import pytest
from nameless import BEAM, Drive, Laws, nameless_campaign

from piezoharvest import Resistor, StepForce, System, Transducer, simulate
from piezoharvest.description.effects import CouplingDrift
from piezoharvest.description.effects.nameless.forms import Line, Power
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.places import OverTime, Reading
from piezoharvest.description.effects.nameless.shapes import StepChange
from piezoharvest.diagnose.discovery.forms.known import known_effects
from piezoharvest.diagnose.discovery.law_fits import fitted
from piezoharvest.diagnose.discovery.tables.visited import visited_inputs
from piezoharvest.identify.fitting.output_error import mean_square
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.identification import identify
from piezoharvest.identify.preparation import prepared
from piezoharvest.records import load_campaign

LOAD, RATE, DRIFT = 1e5, 1000.0, -0.3  # ohm, Hz, V over a second


def reading(true):
    return DRIFT * np.sqrt(true["time_s"])


@pytest.fixture(scope="module")
def drifting(tmp_path_factory):
    """Problem, fit without a law, and times of two records of different lengths in which a reading drifts."""
    folder = tmp_path_factory.mktemp("drifting")
    drives = [Drive((0.02,), (frequency,)) for frequency in (48.0, 52.0, 50.0)]
    nameless_campaign(folder, "beam", Laws(reading={"voltage": reading}), [(each, LOAD) for each in drives], rate=RATE)
    lines = (folder / "r1.csv").read_text().splitlines(keepends=True)
    (folder / "r1.csv").write_text("".join(lines[: len(lines) // 3]))
    campaign = load_campaign(folder / "campaign.toml")
    problem, base = Problem(prepared(campaign, "fit"), campaign.transducer, ()), identify(campaign).found
    return problem, base, visited_inputs(problem, base)["time"]


def test_a_drift_is_the_same_in_records_of_different_lengths(drifting):
    """As a share of the record it was another one in each: half of it was left in the shorter records."""
    problem, base, visited = drifting
    assert visited.max() == pytest.approx(2.0 - 1.0 / RATE)
    law = Law(place=Reading("voltage", "time"), form=Power(factor=-0.1, exponent=0.7, scale=1.0, odd=False))
    found = fitted(problem, base, law, visited)
    form = found.law.form
    assert form.factor / form.scale**form.exponent == pytest.approx(DRIFT, rel=0.01)
    assert form.exponent == pytest.approx(0.5, abs=0.01)
    assert mean_square(found.found) < 1.2 < 5.0 < mean_square(base)


def test_a_step_comes_while_something_is_recorded(drifting):
    """Outside of all records it is a constant; a fit that went there ended a diagnosis with "at: found -1.87e+90"."""
    problem, base, visited = drifting
    law = Law(place=Reading("voltage", "time"), form=StepChange(factor=0.1, at=1.9, width=0.01, finest=1e-3))
    found = fitted(problem, base, law, visited).found.model
    (moment,) = (p for p in found.parameters if p.path[-1] == "at")
    assert (moment.lower, moment.upper) == (0.0, visited.max())
    assert 0.0 <= found.transducer.effects[-1].form.at <= visited.max()


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
