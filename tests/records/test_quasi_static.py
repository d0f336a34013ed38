"""A campaign of a specimen whose mass and damping nobody knows."""

import numpy as np
import pytest

from piezoharvest.records import load_campaign
from piezoharvest.records.errors import CampaignError
from piezoharvest.study import StudyError, load_study


def campaign(folder, lines, drive="force"):
    time = np.arange(400) / 1000.0
    imposed, voltage = 5.0 + np.sin(40.0 * time), -0.3 * np.cos(40.0 * time)
    unit = {"force": "force_N", "base_acceleration": "base_acceleration_m_per_s2"}[drive]
    np.savetxt(
        folder / "r.csv", np.column_stack([time, imposed, voltage]), delimiter=",",
        header=f"time_s,{unit},voltage_V", comments="",
    )  # fmt: skip
    text = f"""[transducer]
{lines}
stiffness = 1e5
coupling = 5.5e-4
capacitance = 3.6e-9
[[records]]
file = "r.csv"
load_resistance = 3e5
drive = "{drive}"
"""
    (folder / "campaign.toml").write_text(text)
    return folder / "campaign.toml"


@pytest.mark.parametrize(
    ("lines", "unknown"),
    [
        ('mass = "unknown"', ("mass", "damping")),
        ('mass = "unknown"\ndamping = 1.0', ("mass",)),
        ("quasi_static = true", ("mass", "damping")),
        ("quasi_static = true\nmass = 1e-6\ndamping = 1.0", ()),
    ],
)
def test_mass_and_damping_may_be_left_out(lines, unknown, tmp_path):
    read = load_campaign(campaign(tmp_path, lines))
    assert read.transducer.quasi_static
    assert read.unknown == unknown


def test_they_are_needed_else(tmp_path):
    with pytest.raises(CampaignError, match=r"transducer\.mass|transducer\.damping"):
        load_campaign(campaign(tmp_path, ""))


def test_a_base_acceleration_needs_a_mass(tmp_path):
    with pytest.raises(CampaignError, match=r"transducer\.mass: missing key"):
        load_campaign(campaign(tmp_path, 'mass = "unknown"', drive="base_acceleration"))


def test_a_study_has_a_mass(tmp_path):
    study = tmp_path / "study.toml"
    study.write_text(
        """[transducer]
quasi_static = true
mass = 1e-6
damping = 1.0
stiffness = 1e5
coupling = 5.5e-4
capacitance = 3.6e-9
[excitation]
kind = "sine_force"
amplitude = 1.0
frequency = 10.0
[[shunts]]
kind = "open"
"""
    )
    with pytest.raises(
        StudyError,
        match=r"transducer\.quasi_static: found true, which is allowed only in a campaign of measured records",
    ):
        load_study(study)
