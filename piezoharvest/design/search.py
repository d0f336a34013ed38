"""The design procedure: draft candidates, tune each, check it by simulation, rank them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from piezoharvest.description.parameters import ParameterError, check_kind
from piezoharvest.description.shunts import LinearShunt
from piezoharvest.design.bound import bound_in_band, bound_of
from piezoharvest.design.candidates import CandidateMaker, Progress, as_network
from piezoharvest.design.drafts import Draft, Drafting
from piezoharvest.design.front import Front, FrontTracer
from piezoharvest.design.goal import Goal
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.operation import is_sine, operation_of
from piezoharvest.design.result import Bound, Candidate, DesignResult
from piezoharvest.design.robust.robustness import Robustness
from piezoharvest.design.synthesis.synthesis import Synthesis, bounded
from piezoharvest.design.trial import Trial
from piezoharvest.design.tuning.frequency import SEARCH_WORK, FrequencySearch
from piezoharvest.design.tuning.starts import Host
from piezoharvest.progress import Step
from piezoharvest.study import SYNTHESISED, DesignOptions, Study
from piezoharvest.threads import single_threaded

_BEYOND = 2e-3  # relative, or dB: twice the error of a simulated mean over a band


@single_threaded
@np.errstate(all="ignore")  # results report figures that are not finite
def design(study: Study, progress: Progress | None = None) -> DesignResult:
    """Tune every candidate of a study, check it by nonlinear simulation and rank them.

    Parameters
    ----------
    study : Study
        `study.design` gives the goal; without it the defaults of `DesignOptions` hold. `study.shunts` are templates:
        their fields that are not tuned (diode drop, quality, smoothing capacitance, ...) are kept.
    progress : callable, optional
        Called with short messages on the progress.

    Returns
    -------
    DesignResult

    Raises
    ------
    ParameterError
        No candidate is left, or the excitation is zero or cannot be simulated.

    Notes
    -----
    Linear shunts are tuned on the exact two-port, starting from the closed forms of the literature (`starts`,
    `minimax`), and then by simulation if the two disagree (hysteresis, an excitation of several tones). Rectifying
    shunts are tuned by simulation from every optimum of their equivalent impedance (`bridges`, `refine`). Several parts
    are tuned by the gradient of the simulation where it has one. The lag of a switch is tuned together with the load
    (`phase`); over a band this gives the best fixed values, by which candidates are ranked, and a schedule. Over a band
    the drive is a sine of constant amplitude: harvested power is its mean, displacement the worst peak. With
    `options.tolerance` the worst case of each is found, and with `options.worst_case` tuned for (`robust`). With
    `options.parts` each tuned candidate is rounded to a series of preferred values (`parts`); what is ranked is what
    can be bought. The candidate "synthesised", only where it is named, is a network grown for the objective
    (`synthesis`). All is set against the bound of passive linear shunts (`bound`). For the trade-off the candidates
    are those that are best for harvest, ranked by power, and the front of each goes on from there (`front`).

    With `study.free_frequency` each candidate has the frequency of the band at which it harvests most when tuned for it
    (`frequency`); all else, its parts and its worst case too, is then as in a study with this frequency. The bound is
    the largest of the band.
    """
    check_kind("study", study, Study, 'load_study("study.toml") reads one')
    options = study.design or DesignOptions()
    return _Design(study, options, progress or (lambda _: None)).run()


@dataclass
class _Design:
    study: Study
    options: DesignOptions
    progress: Progress
    notes: list[str] = field(default_factory=list)

    def run(self) -> DesignResult:
        study, options = self.study, self.options
        for n, shunt in enumerate(study.shunts):
            if shunt.taken != (0,):
                found = f"found shunts at electrodes {', '.join(map(str, shunt.taken))}"
                allowed = "but a design has one at electrode 0 only, the transducer's own, with all others open"
                raise ParameterError(f"shunts.{n}", f"{found}, {allowed}")
        if options.band is not None and not is_sine(study.excitation):
            self.notes.append(f"design.band is not used: {study.excitation.kind} has a spectrum of its own")
        unused = [name for name in ("order", "coil_quality") if getattr(options, name) is not None]
        if unused and SYNTHESISED not in (options.candidates or ()):
            self.notes.append(f"design.{unused[0]} is not used: no candidate is {SYNTHESISED!r}")
        self.notes += _about_parts(options)
        operation = operation_of(study.excitation, options.band, study.transducer)
        if study.free_frequency:  # from here on the band is where it is sought, and not what counts
            self.options = options = replace(options, band=None)
        self.view = LinearView(study.transducer, operation, Goal(options)).working()
        self.goal, self.trial = self.view.goal, Trial(self.view)
        drafting = Drafting(study.transducer, study.shunts, options, operation)
        drafts = drafting.drafts()
        if drafting.left_out:
            self.notes.append(f"left out: {'; '.join(drafting.left_out)}")
        self.notes += drafting.unlike
        candidates = self._at_free_frequency(drafts) if study.free_frequency else self._at_operation(drafts)
        return self._result(tuple(sorted(candidates, key=self._rank)))

    def _at_operation(self, drafts: list[Draft]) -> list[Candidate]:
        """Candidates in the operation of the study."""
        self.host, synthesis = Host.of(self.view), self._synthesis(self.view)
        if self.trial.unresolved:
            self.notes.append("resonances are sharper than the simulated mean power over the band is sure to see")
        self.maker = self._maker(self.trial, synthesis)
        drafts = drafts + ([synthesis.draft] if synthesis else [])
        return self._candidates(drafts, self.maker.candidate)

    def _at_free_frequency(self, drafts: list[Draft]) -> list[Candidate]:
        """Candidates each at the frequency of the band that is best for it."""
        assert self.study.design is not None and self.study.design.band is not None
        transducer, whole = self.study.transducer, self.view.operation
        middle = operation_of(whole.at(whole.centre(transducer)), None, transducer)
        self.view = replace(self.view, operation=middle)
        self.search = FrequencySearch(Trial(self.view), self.study.design.band)

        def candidate(draft: Draft) -> Candidate:
            self.progress(Step(f"{draft.kind}: seeking the best frequency"))
            self.search.trial.left = SEARCH_WORK
            frequency = self.search.best(draft)
            self.progress(Step(f"{draft.kind}: {frequency:.6g} Hz"))
            trial = Trial(self.search.view_at(frequency), left=self.trial.left)
            found = self._maker(trial).candidate(draft)
            self.trial.left = trial.left
            return replace(found, frequency=frequency)

        return self._candidates(drafts, candidate)

    def _maker(self, trial: Trial, synthesis: Synthesis | None = None) -> CandidateMaker:
        """Maker of candidates in the operation of a trial."""
        reference = trial.shorted  # of all figures: computed first, as a design is impossible without it
        tolerance, view = self.options.tolerance, trial.view
        robust = Robustness(view, reference, tolerance) if tolerance else None
        return CandidateMaker(view, trial, Host.of(view), self.progress, robust, synthesis, self.notes)

    def _result(self, candidates: tuple[Candidate, ...]) -> DesignResult:
        """Result with the fronts, and with the distance of the ranked candidates from the bound."""
        if not any(candidate.feasible for candidate in candidates):
            self.notes.insert(0, "no candidate keeps all limits")
        fronts = self._fronts() if self.options.objective == "trade_off" else ()
        bound = self._bound(candidates)
        gaps = [bound.gap(c.harvested_power, c.attenuation_db, damping=self.goal.damping) for c in candidates]
        candidates = tuple(
            replace(c, gap_to_bound=gap, restrictions=bounded(c.restrictions, bound))
            for c, gap in zip(candidates, gaps, strict=True)
        )
        return DesignResult(candidates=candidates, bound=bound, fronts=fronts, notes=tuple(self.notes))

    def _fronts(self) -> tuple[Front, ...]:
        """Fronts between power and damping, with parts as tuned, not as bought."""
        tracer = FrontTracer(self.view, self.host, self.maker.is_exact)
        found = []
        for draft, best in self.maker.tuned:
            self.progress(Step(f"{draft.kind}: front between power and damping"))
            front = tracer.front(draft, best)
            points = tuple(replace(point, shunt=as_network(point.shunt)) for point in front.points)
            found.append(replace(front, points=points))
        self.notes += tracer.notes
        return tuple(front for front in found if front.points)

    def _synthesis(self, view: LinearView) -> Synthesis | None:
        """Synthesis of a network, where it is asked for."""
        if SYNTHESISED not in (self.options.candidates or ()):
            return None
        self.progress(Step(f"{SYNTHESISED}: growing a network"))
        return Synthesis(view, Host.of(view))

    def _bound(self, candidates: tuple[Candidate, ...]) -> Bound:
        """Bound of passive linear shunts, with hysteresis at the amplitude with the best of the linear candidates."""
        self.progress(Step("bound of passive linear shunts", self.parts - 1, self.parts))
        linear = next((c for c in candidates if isinstance(c.shunt, LinearShunt)), None)
        if self.study.free_frequency:
            view = self.search.view_at((linear or candidates[0]).frequency or self.search.grid[0])
            bound = bound_in_band(view.working(linear.shunt if linear else None), self.search.grid)
        else:
            bound = bound_of(self.view.working(linear.shunt if linear else None))
        self.notes += bound.notes
        if bound.linearised:
            self.notes.append("the bound is that of the hysteresis linearised at the amplitude found")
        if not self.view.operation.periodic:  # a realisation may be above or below what is expected of it
            return bound
        for candidate in candidates:
            gap = bound.gap(candidate.harvested_power, candidate.attenuation_db, damping=self.goal.damping)
            if gap is not None and gap < -_BEYOND:
                self.notes.append(_beyond(candidate, bound))
        return bound

    def _rank(self, candidate: Candidate) -> tuple:
        figures = candidate.worst_case.figures if self.options.worst_case and candidate.worst_case else candidate
        value = figures.displacement_amplitude if self.goal.damping else -figures.harvested_power
        return not candidate.converged, not candidate.feasible, value if np.isfinite(value) else np.inf

    def _candidates(self, drafts: Sequence[Draft], candidate: Callable[[Draft], Candidate]) -> list[Candidate]:
        """Tune and check the drafts; those that exceed the budget are left out, unless no other is left."""
        found, refused = [], None
        self.parts = len(drafts) + 1  # with the bound
        for n, draft in enumerate(drafts):
            self.progress(Step(draft.kind, n, self.parts))
            try:
                found.append(candidate(draft))
            except ParameterError as error:
                refused = error
                self.notes.append(f"left out: {draft.kind}: {error.message}")
        if refused and not found:
            raise refused
        return found


def _about_parts(options: DesignOptions) -> Iterator[str]:
    """Remarks on what parts of a series are not chosen for."""
    if options.parts is None:
        return
    if options.objective == "trade_off":
        yield f"the front is that of parts as tuned, not of parts of {options.parts}"
    if options.worst_case:
        yield (
            f"parts of {options.parts} are those of the best nominal figure beside what was tuned for the worst case; "
            "the worst case is that of these parts"
        )


def _beyond(candidate: Candidate, bound: Bound) -> str:
    """Remark on a candidate that passes the bound of passive linear shunts."""
    active = isinstance(candidate.shunt, LinearShunt)
    why = "it is not passive" if active else "it is switched"
    limit = "" if bound.any_interface is None else f"; no circuit passes {bound.any_interface:.4g} W (F^2/(8 b))"
    return f"{candidate.shunt.kind}: passes the bound of passive linear shunts, as {why}{limit}"
