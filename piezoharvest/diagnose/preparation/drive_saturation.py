"""Drives that saturate: samples after the saturation, where the true drive is unknown, are left out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from piezoharvest.description.effects import Clipping
from piezoharvest.diagnose import thresholds
from piezoharvest.diagnose.residual_structure.residual_tests import whitened_squares
from piezoharvest.diagnose.validation import validated
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.result import Identification
from piezoharvest.records.campaign import Campaign
from piezoharvest.records.finding import Finding, index_of
from piezoharvest.records.record import FrequencyRecord, Record


@dataclass(frozen=True, eq=False)
class SaturatedDrive:
    """Records whose drive saturated.

    Attributes
    ----------
    effect : Clipping
    records : tuple of str
        Their names.
    measured : Campaign
        All records as they are.
    campaign : Campaign
        All records, these up to the saturation.
    """

    effect: Clipping
    records: tuple[str, ...]
    measured: Campaign
    campaign: Campaign

    def harm(self, before: Identification, found: Fit) -> tuple[float, float]:
        """p-value of the residual of the whole records, and the share of its excess after the saturation.

        Parameters
        ----------
        before : Identification
        found : Fit
            Of the campaign up to the saturation.
        """
        squares, count = self._left(self.measured, before, found)
        kept, number = self._left(self.campaign, before, found)
        share = 1.0 - max(kept - number, 0.0) / max(squares - count, 1.0)
        return float(chi2.sf(squares, count)), float(np.clip(share, 0.0, 1.0))

    def _left(self, campaign: Campaign, before: Identification, found: Fit) -> tuple[float, float]:
        """Sum of squares of the residual of the saturated records, and the number of terms."""
        saturated = tuple(replace(each, role="validate") for each in campaign.records if each.name in self.records)
        if not saturated:
            return 0.0, 0.0
        problem, (check,) = validated(replace(campaign, records=saturated), before, [found])
        return whitened_squares(problem, check)


def find_saturated_drive(campaign: Campaign) -> SaturatedDrive | None:
    """Records with a saturated drive, as found by the checks; None if there are none, or nothing remains to fit."""
    kept, findings, cut = [], [], []
    limits: dict[str, list[float]] = {}  # by drive: their units differ
    for record, found in zip(campaign.records, campaign.findings, strict=True):
        first = _first_saturated(record, found)
        if first is None or isinstance(record, FrequencyRecord):
            kept.append(record)
            findings.append(found)
            continue
        cut.append(record)
        limits.setdefault(record.drive, []).append(abs(float(record[record.drive][first])))
        if first >= thresholds.MIN_SAMPLES:
            kept.append(record.beginning(first))
            findings.append(found)
    if not cut or not any(record.role == "fit" for record in kept):
        return None
    channel = max(limits, key=lambda drive: len(limits[drive]))
    effect = Clipping(limit=max(limits[channel]), channel=channel)
    names = tuple(record.name for record in cut)
    left = replace(campaign, records=tuple(kept), findings=tuple(findings))
    return SaturatedDrive(effect, names, campaign, left)


def _first_saturated(record: Record | FrequencyRecord, found: tuple[Finding, ...]) -> int | None:
    """The first sample at which a record's drive is saturated; None if it never is, or repeats with every period."""
    if isinstance(record, FrequencyRecord) or record.periodic:
        return None
    clipped = [each for each in found if each.check == "clipped" and each.channel == record.drive]
    first_row = record.signals[record.drive].first_row
    return min((index_of(first, first_row) for each in clipped for first, _ in each.rows), default=None)
