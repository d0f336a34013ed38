"""Effects outside what records can show are none: one question to every effect."""

import pytest

from piezoharvest.description.effects import (
    ChannelSkew,
    Clipping,
    Creep,
    DielectricRelaxation,
    DisplacementLag,
    Friction,
    MainsHum,
)
from piezoharvest.diagnose.selection.start_values import CampaignScales

SCENE = CampaignScales(
    drives=("force",), channels=("voltage",), loaded=True, has_tension=False, displacement=1e-6, capacitance=1e-9,
    sample_time=1e-3, times=(), loads=(), peaks={}, mains={}, longest=0.5, jitter=1e-8, ends={"voltage": (1.1, 1.3)},
    harmonics={"voltage": ((10.0, 2.0),), "force": ((20.0, 2.0),)},
)  # fmt: skip

CASES = [
    (Creep(compliance_ratio=0.1, time_constant=0.2), True),
    (Creep(compliance_ratio=0.1, time_constant=295.0), False),
    (DielectricRelaxation(capacitance=1e-10, time_constant=0.2), True),
    (DielectricRelaxation(capacitance=1e-10, time_constant=1e-4), False),
    (DisplacementLag(time_constant=2.0), False),
    (ChannelSkew(delay=1e-4), True),
    (ChannelSkew(delay=1.0), False),
    (Friction(stiffness=1e4, threshold=5e-7), True),
    (Friction(stiffness=1e4, threshold=3e-6), False),
    (Friction(stiffness=1e4, threshold=5e-9), False),
    (Clipping(limit=1.19, channel="voltage"), True),
    (Clipping(limit=0.82, channel="voltage"), False),
    (MainsHum(amplitude=0.1, frequency=50.02, channel="force"), True),
    (MainsHum(amplitude=0.1, frequency=50.02, channel="voltage"), False),  # the fifth harmonic of the drive
    (MainsHum(amplitude=0.1, frequency=61.5, channel="force"), False),
]


@pytest.mark.parametrize(("effect", "shown"), CASES, ids=lambda case: str(case)[:60])
def test_only_what_records_can_show_is_an_effect(effect, shown):
    assert effect.shown(SCENE) is shown
