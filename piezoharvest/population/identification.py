"""Identification of several specimens of one kind: parameters of each, and mean and spread of the kind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.identification import identification_of, identify
from piezoharvest.identify.preparation import prepared
from piezoharvest.identify.residual_quality import combined_quality
from piezoharvest.identify.result import Identification, Quality
from piezoharvest.population.naming import errors_of, named_progress
from piezoharvest.population.pooling import Member, Pooled, pooled
from piezoharvest.population.results import OfKind, estimates_of, of_kind
from piezoharvest.population.saving import save_all
from piezoharvest.progress import Step, log, silent
from piezoharvest.records.specimens import SpecimenSet

Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class SpecimensIdentification:
    """Parameters of several specimens.

    Attributes
    ----------
    specimens : SpecimenSet
    alone : tuple of Identification
        Of each specimen by itself.
    each : tuple of Identification
        Of each with its kind; `alone` for one of another kind.
    pooled : Pooled
    """

    specimens: SpecimenSet
    alone: tuple[Identification, ...]
    each: tuple[Identification, ...]
    pooled: Pooled

    @cached_property
    def kind(self) -> dict[str, OfKind]:
        """Mean and spread of the shared parameters, by name."""
        return of_kind(self.pooled)

    @property
    def fit(self) -> Quality:
        """Residuals of the fitted records of all specimens."""
        return self._quality("fit")

    @property
    def validation(self) -> Quality:
        """Residuals of the validation records of all specimens."""
        return self._quality("validate")

    def _quality(self, role: str) -> Quality:
        return combined_quality([row for each in self.each for row in each.records if row.role == role])

    @property
    def doubts(self) -> tuple[str, ...]:
        """Reasons not to trust the result."""
        return tuple(f"{name}: {doubt}" for name, each in self._named() for doubt in each.doubts)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the result, in addition to the doubts: specimens of another kind are told here."""
        own = tuple(f"{name}: {text}" for name, each in self._named() for text in each.warnings)
        return (*(odd_sentence(self.specimens.names[n], what) for n, what in self.pooled.odd.items()), *own)

    def save(self, path: str | Path) -> list[Path]:
        """Write the specimen files of the kind and of each specimen; raises `OutputError`."""
        estimates = [each.estimates for each in self.each]
        return save_all(self.pooled, estimates, self.specimens, path, command="identify", trusted=not self.doubts)

    def _named(self):
        return zip(self.specimens.names, self.each, strict=True)


def odd_sentence(name: str, what: tuple[str, ...]) -> str:
    """That a specimen is of another kind, in words."""
    return f"{name} is of another kind: it differs in {' and '.join(what)}, and is left out of mean and spread"


def identify_specimens(specimens: SpecimenSet, progress: Progress = log) -> SpecimensIdentification:
    """Identify several specimens: each by itself, then all with the mean and spread that they have as a kind.

    Raises
    ------
    CampaignError
        As `identify`, for any of them.
    """
    alone, members = [], []
    for n, (name, campaign) in enumerate(zip(specimens.names, specimens.campaigns, strict=True)):
        progress(Step(f"{name}: by itself", n, len(specimens.names)))
        with errors_of(name):
            found = identify(campaign, named_progress(progress, name))
        problem = Problem(prepared(found.campaign, "fit"), found.campaign.transducer, found.offsets)
        alone.append(found)
        members.append(Member(name, problem, found.found))
    together = pooled(members, (), progress)
    each = tuple(_with_kind(together, n, found, members[n].problem) for n, found in enumerate(alone))
    return SpecimensIdentification(specimens, tuple(alone), each, together)


def _with_kind(together: Pooled, n: int, found: Identification, problem: Problem) -> Identification:
    """Identification of a specimen in the fit with its kind."""
    if n in together.odd:
        return found
    estimates = estimates_of(together, n, found.estimates)
    return identification_of(found.campaign, problem, together.fits[n], estimates, silent)
