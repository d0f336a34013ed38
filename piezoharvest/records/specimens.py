"""Campaigns of several specimens of one kind: `[[specimens]]`, each with records of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from piezoharvest.counting import counted
from piezoharvest.description.parameters import ParameterError
from piezoharvest.records.finding import Finding
from piezoharvest.records.loading import Campaign, campaign_of, checked, reading
from piezoharvest.study import read_toml
from piezoharvest.study.words import typed

SPECIMENS = "specimens"
MIN_SPECIMENS, MAX_SPECIMENS = 2, 1000  # fewer are a campaign of one; more are a mistake, at seconds each at least
_COMMON = ("title", "transducer", "channels", "experiment", SPECIMENS)
_OWN = ("name", "transducer", "channels", "records")


@dataclass(frozen=True, eq=False)
class SpecimenSet:
    """Measured records of several specimens of one kind.

    Attributes
    ----------
    title : str
    path : Path
        The campaign's file.
    campaigns : tuple of Campaign
        One for each specimen, with its name as the title.
    """

    title: str
    path: Path
    campaigns: tuple[Campaign, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the specimens, all different."""
        return tuple(campaign.title for campaign in self.campaigns)

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """Findings of all records that are warnings."""
        return tuple(finding for campaign in self.campaigns for finding in campaign.warnings)


def load(path: str | Path) -> Campaign | SpecimenSet:
    """Read a campaign of one specimen, or of several where the file has `[[specimens]]`, with all records checked.

    Raises
    ------
    CampaignError
        As `load_campaign`.

    Notes
    -----
    A table `[[specimens]]` has a `name` (default "specimen 1" and so on), its `[[specimens.records]]`, and where they
    differ from those of the file its own `[specimens.transducer]` and `[specimens.channels]`, whose keys stand in the
    place of the common ones.
    """
    path = Path(path)
    with reading(path):
        table = read_toml(path)
        found = _specimens(table, path) if SPECIMENS in table else campaign_of(table, path)
    for campaign in found.campaigns if isinstance(found, SpecimenSet) else (found,):
        checked(campaign)
    return found


def _specimens(table: Mapping[str, Any], path: Path) -> SpecimenSet:
    """Specimens from the tables of a file; raises `ParameterError` and `CampaignError`."""
    for key in table:
        if key not in _COMMON:
            allowed = f"known keys together with {SPECIMENS} are {', '.join(_COMMON[:-1])}"
            more = "records are given in [[specimens.records]]" if key == "records" else allowed
            raise ParameterError(key, f"unknown key, {more}")
    entries = typed(list, table[SPECIMENS], SPECIMENS)
    if not MIN_SPECIMENS <= len(entries) <= MAX_SPECIMENS:
        allowed = f"allowed are {MIN_SPECIMENS} to {MAX_SPECIMENS} tables [[specimens]]"
        raise ParameterError(SPECIMENS, f"found {counted(len(entries), 'table')}, {allowed}")
    title = table.get("title", path.stem)
    if not isinstance(title, str):
        raise ParameterError("title", f"found {repr(title)[:80]}, must be a string")
    campaigns, count = list[Campaign](), 0
    for n, entry in enumerate(entries):
        merged = _merged(table, entry, n)
        try:
            campaigns.append(campaign_of(merged, path, f"{SPECIMENS}.{n}.", count))
        except ParameterError as error:
            its_own = error.key.partition(".")[0] in entry  # else the table is the common one, or the key complete
            raise (error.within(f"{SPECIMENS}.{n}") if its_own else error) from None
        count += sum(record.numbers for record in campaigns[-1].records)
        names = [campaign.title for campaign in campaigns]
        if names[-1] in names[:-1]:
            raise ParameterError(f"{SPECIMENS}.{n}.name", f"found {names[-1]!r}, which another specimen has")
    return SpecimenSet(title, path, tuple(campaigns))


def _merged(common: Mapping[str, Any], entry: Any, n: int) -> dict[str, Any]:
    """Tables of a campaign of one specimen: its own keys instead of the common ones."""
    where = f"{SPECIMENS}.{n}"
    if not isinstance(entry, Mapping):
        raise ParameterError(where, f"found {repr(entry)[:60]}, must be a table")
    for key in entry:
        if key not in _OWN:
            raise ParameterError(f"{where}.{key}", f"unknown key, known keys are {', '.join(_OWN)}")
    name = entry.get("name", f"specimen {n + 1}")
    if not isinstance(name, str) or not name.strip():
        raise ParameterError(f"{where}.name", f"found {repr(name)[:80]}, must be a string that is not empty")
    found: dict[str, Any] = {"title": name}
    for key in ("transducer", "channels"):
        tables = [table[key] for table in (common, entry) if key in table]
        for table in tables:
            if not isinstance(table, Mapping):
                raise ParameterError(f"{where}.{key}", f"found {repr(table)[:60]}, must be a table")
        if tables:
            found[key] = {name: value for table in tables for name, value in table.items()}
    return {**found, **_part(common, "experiment"), **_part(entry, "records")}


def _part(table: Mapping[str, Any], key: str) -> dict[str, Any]:
    """The key with its value, if the table has it."""
    return {key: table[key]} if key in table else {}
