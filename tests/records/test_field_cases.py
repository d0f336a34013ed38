"""Files that were refused in the field though nothing is wrong with them, and one that was not though something is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from piezoharvest.records import CampaignError, load_campaign

CASES = Path(__file__).parents[2].parent / "shared" / "field_cases"
pytestmark = pytest.mark.skipif(not CASES.is_dir(), reason="no field cases in shared beside the project")


@pytest.mark.parametrize(
    ("campaign", "samples", "rate"),
    [
        ("rows_outside/campaign.toml", 2000, 1000.0),
        ("time_rounding/campaign.toml", 4096, 64.0),
        ("preamble/siglent.toml", 192, 1000.0),
        ("preamble/tek_mso.toml", 188, 1000.0),
    ],
)
def test_records(campaign, samples, rate):
    (record,) = load_campaign(CASES / campaign).records
    assert len(record) == samples
    assert record.sample_rate == pytest.approx(rate, rel=1e-9)


@pytest.mark.parametrize(
    ("campaign", "lines"),
    [("frf_order/campaign.toml", 401), ("frf_order/campaign_overlap.toml", 402), ("preamble/i_e4990a.toml", 107)],
)
def test_sweeps(campaign, lines):
    loaded = load_campaign(CASES / campaign)
    (record,) = loaded.records
    assert len(record) == lines
    assert np.all(np.diff(record.frequency) >= 0)
    assert loaded.warnings == ()


@pytest.mark.parametrize("campaign", ["campaign.toml", "campaign2.toml"])
def test_two_channels_of_one_column(campaign):
    with pytest.raises(CampaignError, match="but each channel needs its own column"):
        load_campaign(CASES / "same_column" / campaign)
