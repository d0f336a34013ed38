"""Error of a campaign, in one sentence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from piezoharvest.records.campaign import Campaign
from piezoharvest.records.finding import Rows, in_words
from piezoharvest.study import StudyError


class CampaignError(StudyError):
    """Error of a campaign: file, key or channel and rows, what was found, what is allowed.

    Attributes
    ----------
    path, key, message : str
        As in `StudyError`: the campaign's file and a key in it, or a data file with channel and rows as text.
    channel : str
        Channel of a data file; empty if a key or the whole file is meant.
    rows : tuple of (first, last)
        Rows of the data file.
    campaign : Campaign or None
        The campaign with all findings, if the data could be read but a check found an error.
    """

    def __init__(
        self,
        path: str | Path,
        key: str,
        message: str,
        *,
        channel: str = "",
        rows: Rows = (),
        campaign: Campaign | None = None,
    ):
        place: Any = ", ".join(part for part in (key or channel, in_words(rows)) if part)
        super().__init__(path, place, message)
        self.channel, self.rows, self.campaign = channel, rows, campaign
