"""A drive whose range is too small: what its records hold after it was cut off cannot be told, and is left out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from piezoharvest.description.effects import Clipping
from piezoharvest.diagnose.residual_tests import share_above_noise
from piezoharvest.diagnose.validation import validated
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.identification import Identification
from piezoharvest.records.campaign import Campaign
from piezoharvest.records.finding import Finding, index_of
from piezoharvest.records.record import FrequencyRecord, Record

LEAST = 64  # samples before the cut that are worth a fit
CHANCE = 1e-5  # of what is left behind the cut, below which it did harm


@dataclass(frozen=True, eq=False)
class CutDrive:
    """Records whose drive was cut off.

    Attributes
    ----------
    effect : Clipping
    records : tuple of str
        Their names.
    measured : Campaign
        All records as they are.
    campaign : Campaign
        All records, these up to where they were cut off.
    """

    effect: Clipping
    records: tuple[str, ...]
    measured: Campaign
    campaign: Campaign

    def harm(self, before: Identification, found: Fit) -> tuple[float, float]:
        """Probability that what a model leaves of the whole records is noise, and the share of it behind the cut.

        Parameters
        ----------
        before : Identification
        found : Fit
            Of what is left of the campaign.
        """
        squares, count = self._left(self.measured, before, found)
        kept, number = self._left(self.campaign, before, found)
        share = 1.0 - max(kept - number, 0.0) / max(squares - count, 1.0)
        return float(chi2.sf(squares, count)), float(np.clip(share, 0.0, 1.0))

    def _left(self, campaign: Campaign, before: Identification, found: Fit) -> tuple[float, float]:
        """Sum of squares that a model leaves of the records that were cut off, and their number."""
        mine = tuple(replace(each, role="validate") for each in campaign.records if each.name in self.records)
        if not mine:
            return 0.0, 0.0
        problem, (held,) = validated(replace(campaign, records=mine), before, [found])
        return share_above_noise(problem, held)


def cut_off(campaign: Campaign) -> CutDrive | None:
    """Records with a drive that was cut off, as the checks found; None where there are none, or nothing is left."""
    kept, findings, cut = [], [], []
    limits: dict[str, list[float]] = {}  # by drive: their units differ
    for record, found in zip(campaign.records, campaign.findings, strict=True):
        first = _first_cut(record, found)
        if first is None or isinstance(record, FrequencyRecord):
            kept.append(record)
            findings.append(found)
            continue
        cut.append(record)
        limits.setdefault(record.drive, []).append(abs(float(record[record.drive][first])))
        if first >= LEAST:
            kept.append(record.beginning(first))
            findings.append(found)
    if not cut or not any(record.role == "fit" for record in kept):
        return None
    channel = max(limits, key=lambda drive: len(limits[drive]))
    effect = Clipping(limit=max(limits[channel]), channel=channel)
    names = tuple(record.name for record in cut)
    left = replace(campaign, records=tuple(kept), findings=tuple(findings))
    return CutDrive(effect, names, campaign, left)


def _first_cut(record: Record | FrequencyRecord, found: tuple[Finding, ...]) -> int | None:
    """The first sample at which a record's drive is cut off."""
    if isinstance(record, FrequencyRecord):
        return None
    clipped = [each for each in found if each.check == "clipped" and each.channel == record.drive]
    first_row = record.signals[record.drive].first_row
    return min((index_of(first, first_row) for each in clipped for first, _ in each.rows), default=None)
