"""Parameters that the data wants far from their nominal values are said: they may stand in for what has no name."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from diagnose_runs import RECORDS, STACK, campaign

from piezoharvest.description.effects import Leakage
from piezoharvest.diagnose import diagnose
from piezoharvest.diagnose.selection.stepwise_selection import Searcher
from piezoharvest.diagnose.summary import sentence
from piezoharvest.diagnose.thresholds import CLOSE_COST


def test_what_is_far_from_its_nominal_value_is_said(tmp_path):
    measured = campaign(tmp_path)
    told = diagnose(
        replace(measured, transducer=replace(measured.transducer, stiffness=0.5 * STACK["stiffness"])),
        library=[Leakage],
    )
    (far,) = told.deviating
    assert far.parameter.name == "stiffness"
    assert "The fit puts stiffness at 2 times its nominal value, which may compensate" in sentence(told)


@pytest.mark.slow
@pytest.mark.parametrize(("times", "verdict"), [(5, "effect"), (30, "unexplained")])
def test_no_verdict_rests_on_a_parameter_beyond_belief(times, verdict, tmp_path):
    """Damping makes a displacement late as a lag of its sensor does: once it took that in, 38 times its own value."""
    quick = {"load_resistance": 97.78e3, "excitation": {"frequency": 100.0}}
    measured = campaign(tmp_path, {"leakage": {"resistance": 3e6}}, [*RECORDS, quick])
    nominal = replace(measured.transducer, damping=STACK["damping"] / times)
    told = diagnose(replace(measured, transducer=nominal), library=[Leakage])
    assert [named.effect.name for named in told.effects] == ["leakage"]
    assert told.verdict == verdict
    (far,) = told.deviating
    assert far.value / far.nominal == pytest.approx(times, rel=0.2)
    assert "times its nominal value, which may compensate" in sentence(told)


def test_nothing_is_said_of_what_is_near(tmp_path):
    near = diagnose(campaign(tmp_path), library=[Leakage])
    assert near.deviating == ()
    assert "nominal" not in sentence(near)


class Fits:
    """Trials of one model with strayed parameters, which are not where they are held or freed again."""

    def __init__(self, cost_when_held: float) -> None:
        self.held_fit = SimpleNamespace(cost=cost_when_held)
        self.freed_fit = SimpleNamespace(cost=cost_when_held, effects=("leakage",))

    def at_nominal(self, now):
        return None if now is self.freed_fit else self.held_fit

    def with_freed_parameters(self, held, now):
        return self.freed_fit

    def redetermine(self, now):
        return now

    def deviating(self, now):
        return [] if now is self.freed_fit else ["mass"]


@pytest.mark.parametrize("more, back", [(-2 * CLOSE_COST, True), (0.5 * CLOSE_COST, True), (2 * CLOSE_COST, False)])
def test_what_has_strayed_for_nothing_comes_back(more, back):
    """A mass of seven times its nominal value once had a standard error of half a percent, and the same likelihood."""
    now, fits = SimpleNamespace(cost=1000.0, effects=("leakage",)), Fits(1000.0 + more)
    found, held = Searcher(fits)._with_nominal_values(now)
    assert (found, held) == ((fits.freed_fit, None) if back else (now, fits.held_fit))
