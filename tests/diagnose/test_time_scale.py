"""Diagnosis knows no absolute time: the same readings a thousand times faster get the same verdict."""

import re
import shutil

import pytest
from diagnose_runs import campaign
from selection import with_slow

from piezoharvest.description.effects import registered
from piezoharvest.diagnose import diagnose
from piezoharvest.records import load_campaign

FASTER = 1e3
# Powers of time in the units of what changes: forces, displacements, charges and voltages stay as they are.
IN_FILE = {"mass": 2, "damping": 1, "load_resistance": 1, "start_time": 1}
OF_EFFECTS = {"time_constant": 1, "cubic_stiffness": 0, "compliance_ratio": 0}
OF_TRANSDUCER = {"mass": 2, "damping": 1}

CASES = {
    "healthy": ({}, None, "adequate"),
    "an effect": ({"creep": {"compliance_ratio": 4e-3, "time_constant": 0.2}}, None, "effect"),
    "an effect that is not in the library": (
        {"stiffening": {"cubic_stiffness": 1e18}}, "stiffening", "unexplained",
    ),
}  # fmt: skip


def faster(path):
    """Path of a copy of a campaign whose clock runs faster, and whose currents are larger for the same charges."""
    folder = shutil.copytree(path.parent, path.parent.with_name("faster"))
    text = path.read_text()
    for key, power in IN_FILE.items():
        text = re.sub(
            rf"^{key} = (.+)$",
            lambda m, p=power: f"{m[0].split('=')[0]}= {float(m[1]) / FASTER**p!r}",
            text,
            flags=re.M,
        )
    text = text.replace('unit = "A"', 'unit = "kA"').replace(
        "[[records]]", '[channels.time]\nunit = "ms"\n\n[[records]]', 1
    )
    (folder / path.name).write_text(text)
    return folder / path.name


@pytest.mark.parametrize(
    ("present", "withheld", "verdict"),
    with_slow(CASES.values(), slow=lambda present, withheld, verdict: verdict != "adequate"),
    ids=CASES,
)
def test_the_verdict_is_the_same_a_thousand_times_faster(tmp_path, present, withheld, verdict):
    slow = campaign(tmp_path, present)
    fast = load_campaign(faster(slow.path))
    for one, other in zip(slow.records, fast.records, strict=True):
        assert other.sample_rate == pytest.approx(FASTER * one.sample_rate)
        assert abs(other["current"]).max() == pytest.approx(FASTER * abs(one["current"]).max())
    assert [[found.check for found in some] for some in fast.findings] == [
        [found.check for found in some] for some in slow.findings
    ]
    library = [cls for name, cls in registered().items() if name != withheld]
    before, after = (diagnose(each, library=library) for each in (slow, fast))
    assert before.verdict == after.verdict == verdict
    assert [named.effect.name for named in before.effects] == [named.effect.name for named in after.effects]
    assert verdict != "effect" or [named.effect.name for named in after.effects] == list(present)
    for one, other in zip(before.effects, after.effects, strict=True):
        for name, (value, std, _) in one.values.items():
            changed = other.values[name][0] * FASTER ** OF_EFFECTS.get(name, 0)
            assert changed == pytest.approx(value, abs=0.05 * std), name
    for one, other in zip(before.estimates, after.estimates, strict=True):
        assert one.identifiable == other.identifiable, one.parameter.name
        changed = other.value * FASTER ** OF_TRANSDUCER.get(one.parameter.name, 0)
        assert changed == pytest.approx(one.value, abs=0.05 * (one.std or one.value)), one.parameter.name
