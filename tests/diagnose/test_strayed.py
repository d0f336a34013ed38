"""Parameters that the data wants far from their nominal values are said: they may stand in for what has no name."""

from dataclasses import replace

from diagnose_runs import STACK, campaign

from piezoharvest.diagnose import diagnose
from piezoharvest.diagnose.account import sentence
from piezoharvest.effects import Leakage


def test_what_is_far_from_its_nominal_value_is_said(tmp_path):
    measured = campaign(tmp_path)
    told = diagnose(
        replace(measured, transducer=replace(measured.transducer, stiffness=0.5 * STACK["stiffness"])),
        library=[Leakage],
    )
    (far,) = told.strayed
    assert far.parameter.name == "stiffness"
    assert "The fit wants stiffness at 2 times its nominal value, which may stand in" in sentence(told)


def test_nothing_is_said_of_what_is_near(tmp_path):
    near = diagnose(campaign(tmp_path), library=[Leakage])
    assert near.strayed == ()
    assert "nominal" not in sentence(near)
