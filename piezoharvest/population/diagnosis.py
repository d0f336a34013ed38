"""Diagnosis of several specimens of one kind: one set of effects or law for all, coefficients for each."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from scipy.stats import chi2

from piezoharvest.counting import counted
from piezoharvest.description.effects import Effect
from piezoharvest.diagnose.diagnosis import diagnose
from piezoharvest.diagnose.residual_structure.residual_tests import ResidualTest, failed_tests, whitened_squares
from piezoharvest.diagnose.result import Diagnosis
from piezoharvest.diagnose.validation import validated
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.residual_quality import combined_quality, judged
from piezoharvest.identify.result import Estimate, Quality
from piezoharvest.population.forms import JointForm, joint_form
from piezoharvest.population.identification import odd_sentence
from piezoharvest.population.naming import errors_of, kind_of, named_progress
from piezoharvest.population.pooling import Member, Pooled, pooled
from piezoharvest.population.results import OfKind, Value, estimates_of, of_kind, values_of
from piezoharvest.population.saving import save_all
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.progress import Step, log
from piezoharvest.records.specimens import SpecimenSet

Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class OfSpecimen:
    """A specimen within the diagnosis of its kind.

    Attributes
    ----------
    alone : Diagnosis
        By itself.
    alike : bool
        It is of the kind: the same effects explain it, with values within their spread.
    effects : tuple of Effect
        Those of the kind with this specimen's values; its own if it is of another kind.
    values : mapping of str to (value, std, unit)
        Of all parameters, those of effects included, by the names that specimens share.
    estimates : tuple of Estimate
    before, after : Quality
        Of records that were not fitted, without effects and with them.
    squares : tuple of float
        Sums of whitened squares of these records before and after, and what noise would leave.
    left : tuple of ResidualTest
        Residual tests that fail in the end.
    """

    alone: Diagnosis
    alike: bool
    effects: tuple[Effect, ...]
    values: Mapping[str, Value]
    estimates: tuple[Estimate, ...]
    before: Quality
    after: Quality
    squares: tuple[float, float, float]
    left: tuple[ResidualTest, ...]


@dataclass(frozen=True, eq=False)
class SpecimensDiagnosis:
    """Diagnosis of several specimens.

    Attributes
    ----------
    specimens : SpecimenSet
    form : JointForm
    pooled : Pooled
    each : tuple of OfSpecimen
    """

    specimens: SpecimenSet
    form: JointForm
    pooled: Pooled
    each: tuple[OfSpecimen, ...]

    @cached_property
    def kind(self) -> dict[str, OfKind]:
        """Mean and spread of the shared parameters, by name."""
        return of_kind(self.pooled)

    @property
    def of_kind(self) -> list[OfSpecimen]:
        """The specimens of the kind."""
        return [each for each in self.each if each.alike]

    @property
    def verdict(self) -> str:
        """Of the kind: "adequate", "effect", "new_effect", "ambiguous" or "unexplained"."""
        if any(each.left for each in self.of_kind):
            return "unexplained"
        if not self.form.form:
            return "adequate"
        if self.form.rivals:
            return "ambiguous"
        return "new_effect" if any(each.alone.discovery for each in self.of_kind) else "effect"

    @property
    def p_value(self) -> float:
        """p-value of the kind's effects together, over all specimens; 1 where there are none.

        Corrected for the sets that were tried by the corrections of the specimens' own searches, which come first.
        """
        own = [name for name in self.pooled.variables if self._is_of_effect(name)]
        return float(chi2.sf(self.form.gain, max(len(own), 1) * len(self.of_kind))) if self.form.form else 1.0

    def _is_of_effect(self, name: str) -> bool:
        return self.pooled.variables[name].path[0] == "effects"

    @property
    def gain(self) -> float:
        """Share of the squares above the noise, in records that were not fitted, that the effects remove."""
        first, last, count = (sum(each.squares[k] for each in self.of_kind) for k in range(3))
        return min(1.0, max(-1.0, (first - last) / (first - min(last, count)))) if first > min(last, count) else 0.0

    @property
    def unexplained(self) -> float:
        """Share of the residual variance above the noise, in records that were not fitted."""
        last, count = (sum(each.squares[k] for each in self.of_kind) for k in (1, 2))
        return max(0.0, (last - count) / last)

    @property
    def experiment(self) -> str | None:
        """The measurement that would tell most; that of the first specimen that has one, if something is open."""
        if self.verdict not in ("ambiguous", "unexplained"):
            return None
        return next((each.alone.experiment for each in self.of_kind if each.alone.experiment), None)

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        shared = " and ".join(sorted(self.form.form)) or "no effect"
        count = len(self.of_kind)
        text = f"{count} of {counted(len(self.each), 'specimen')} {'is' if count == 1 else 'are'} of one kind"
        text = f"{text}, with {shared}"
        others = [*(odd_sentence(self.specimens.names[n], what) for n, what in self.pooled.odd.items())]
        for n in self.form.apart:
            own = " and ".join(map(kind_of, self.each[n].effects)) or "no effect"
            others.append(f"{self.specimens.names[n]} is of another kind: it has {own}")
        rivals = [f"as likely with {' and '.join(sorted(form))}" for form in self.form.rivals]
        return "; ".join([text, *rivals, *others]) + "."

    def differs(self, n: int) -> list[str]:
        """Where a specimen of another kind differs: names of values, or of effects that only it or the kind has."""
        if n in self.form.apart:
            return sorted(self.form.form ^ {kind_of(effect) for effect in self.each[n].effects})
        return list(self.pooled.odd.get(n, ()))

    def save(self, path: str | Path) -> list[Path]:
        """Write the specimen files of the kind and of each specimen; raises `OutputError`."""
        source = {"command": "diagnose", "verdict": self.verdict, "trusted": not self.doubts}
        return save_all(self.pooled, [each.estimates for each in self.each], self.specimens, path, **source)

    def quality(self, which: str) -> Quality:
        """Residuals of records that were not fitted, "before" or "after", of all specimens of the kind."""
        rows: dict[str, list[dict[str, float]]] = {"rms": [], "noise": [], "weighted": []}
        for each in self.of_kind:
            for name, some in rows.items():
                some.append(dict(getattr(getattr(each, which), name)))
        return Quality(*(_root_mean_square(some) for some in rows.values()))

    @property
    def doubts(self) -> tuple[str, ...]:
        """Reasons not to trust the result."""
        ends = zip(self.specimens.names, self.pooled.fits, strict=True)
        return tuple(f"{name}: {last.message}" for name, last in ends if not last.converged)


def _root_mean_square(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    names = dict.fromkeys(name for row in rows for name in row)
    each = {name: [row[name] ** 2 for row in rows if name in row] for name in names}
    return {name: (sum(some) / len(some)) ** 0.5 for name, some in each.items()}


def diagnose_specimens(
    specimens: SpecimenSet,
    progress: Progress = log,
    library: Sequence[type[Effect]] | None = None,
) -> SpecimensDiagnosis:
    """Diagnose several specimens: each by itself, then all with the set of effects that explains them together.

    Parameters
    ----------
    specimens : SpecimenSet
    progress : callable
        Called with messages on the progress; default: the logger `piezoharvest`, level INFO.
    library : sequence of Effect classes, optional
        As in `diagnose`.

    Raises
    ------
    CampaignError
        As `diagnose`, for any of them.
    """
    found = []
    for n, (name, campaign) in enumerate(zip(specimens.names, specimens.campaigns, strict=True)):
        progress(Step(f"{name}: by itself", n, len(specimens.names)))
        with errors_of(name):
            found.append(diagnose(campaign, named_progress(progress, name), library))
    form = joint_form(found, specimens.names, progress)
    members = [Member(*row) for row in zip(specimens.names, (each.problem for each in found), form.fits, strict=True)]
    together = pooled(members, form.apart, progress)
    each = tuple(_of_specimen(n, one, members[n], form, together) for n, one in enumerate(found))
    return SpecimensDiagnosis(specimens, form, together, each)


def _of_specimen(n: int, alone: Diagnosis, member: Member, form: JointForm, together: Pooled) -> OfSpecimen:
    """What the joint fit says of a specimen, judged by its records that were not fitted."""
    last: Fit = together.fits[n]
    alike = n not in together.apart
    same = alone.search.final.model.transducer.effects[alone.search.given_effects :]
    unchanged = {kind_of(effect) for effect in same} == form.form
    estimates = estimates_of(together, n, alone.estimates)
    try:
        unseen, checks = validated(alone.campaign, alone.before, [alone.before.found, last])
    except PredictionError:  # behind circuits with events a model may not follow a record that it was not fitted to
        unseen, checks = validated(alone.campaign, alone.before, [alone.search.final, alone.search.final])
    (first, count), (after, _) = (whitened_squares(unseen, each) for each in checks)
    before, after_all = (combined_quality(judged(unseen.data, each)) for each in checks)
    effects = last.model.transducer.effects[alone.search.given_effects :]
    # Of a set that was its own the specimen's search has tested what is left, with the noise estimated anew.
    left = alone.left if unchanged or not alike else failed_tests(member.problem, last)
    values = values_of(together, n)
    return OfSpecimen(alone, alike, effects, values, estimates, before, after_all, (first, after, count), left)
