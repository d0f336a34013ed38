"""Predictions of an identified model for the records, for comparison with the measurements."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.model import unexplained_blocks
from piezoharvest.identify.preparation import prepared
from piezoharvest.identify.result import Identification, RecordQuality
from piezoharvest.records.finding import Finding
from piezoharvest.records.record import FrequencyRecord, Record


class Predicted(NamedTuple):
    """Prediction of one record.

    Attributes
    ----------
    record : Record or FrequencyRecord
    findings : tuple of Finding
    judged : RecordQuality
    channels : tuple of str
        Channels of a record over time; empty for a frequency response.
    values : array
        (samples, channels), offsets of the sensors included; for a frequency response (f,), complex.
    """

    record: Record | FrequencyRecord
    findings: tuple[Finding, ...]
    judged: RecordQuality
    channels: tuple[str, ...]
    values: np.ndarray


def predictions(found: Identification) -> Iterator[Predicted]:
    """Predictions of all records, those fitted first."""
    judged, model = iter(found.records), replace(found.found.model, parameters=())
    for role in ("fit", "validate"):
        sources = found.campaign.of_role(role)
        for record, data in zip(sources, prepared(found.campaign, role), strict=True):
            one = next(judged)
            findings = found.campaign.findings[found.campaign.records.index(record)]
            if isinstance(data, FrequencyData):
                yield Predicted(record, findings, one, (), data.response(model)[0])
                continue
            nuisance = np.array(list(one.own.values()))
            residuals = [residual for _, _, residual in unexplained_blocks(model, data, nuisance)]
            yield Predicted(record, findings, one, data.channels, data.part(0, len(data)) - np.concatenate(residuals))
