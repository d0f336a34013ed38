"""Records of a campaign, prepared for a fit."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from piezoharvest.description.parameters import ParameterError
from piezoharvest.identify.fitting.data import Data, data_of
from piezoharvest.identify.fitting.evaluation import map_records
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.noise.noise_levels import levels_of
from piezoharvest.records.campaign import Campaign
from piezoharvest.records.errors import CampaignError
from piezoharvest.records.record import FrequencyRecord, Record


def prepared(campaign: Campaign, role: str) -> tuple[Data | FrequencyData, ...]:
    """Records of a role, prepared for a fit.

    Raises
    ------
    CampaignError
        The model cannot be driven by a record.
    """
    levels = levels_of([record for record in campaign.records if isinstance(record, Record)])
    return map_records(partial(_prepared, campaign, levels), campaign.of_role(role))


def _prepared(
    campaign: Campaign, levels: Mapping[str, Mapping[str, float]], record: Record | FrequencyRecord
) -> Data | FrequencyData:
    try:
        if isinstance(record, Record):
            return data_of(record, campaign.transducer, levels[record.name])
        data = FrequencyData(record)
        data.matrices(campaign.transducer)
        return data
    except ParameterError as error:
        raise CampaignError(campaign.path, f"{record.key}.{error.key}", error.message) from None
