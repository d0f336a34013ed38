"""The design procedure: draft candidates, tune each, check it by simulation, rank them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from piezoharvest.description.parameters import ParameterError, check_kind
from piezoharvest.description.shunts import LinearShunt
from piezoharvest.design.added_damping import why_none
from piezoharvest.design.bound import bound_in_band, bound_of, bound_of_several
from piezoharvest.design.candidates import CandidateMaker, Progress, as_network
from piezoharvest.design.drafts import Draft, Drafting, retuned
from piezoharvest.design.electrodes import about_places, check_places, front_back, moved, moved_back
from piezoharvest.design.front import Front, FrontTracer
from piezoharvest.design.goal import Goal
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.operation import is_sine, operation_of
from piezoharvest.design.result import Bound, Candidate, DesignResult
from piezoharvest.design.robust.robustness import Robustness
from piezoharvest.design.synthesis.synthesis import Synthesis, bounded
from piezoharvest.design.trial import DESIGN_WORK, Trial
from piezoharvest.design.tuning.frequency import SEARCH_WORK, FrequencySearch
from piezoharvest.design.tuning.starts import Host
from piezoharvest.progress import Step, log
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
        Called with short messages on the progress; default: the logger `piezoharvest`, level INFO.

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
    return _Design(study, options, progress or log).run()


@dataclass
class _Place:
    """The structure as shunts at some electrodes see it, with what tunes them there.

    Attributes
    ----------
    number : int
        Electrodes that have changed places with electrodes 0.
    view : LinearView
    trial : Trial
    maker : CandidateMaker or None
        None where each candidate has a frequency of its own.
    search : FrequencySearch or None
        Of that frequency.
    """

    number: int
    view: LinearView
    trial: Trial
    maker: CandidateMaker | None = None
    search: FrequencySearch | None = None


@dataclass
class _Design:
    study: Study
    options: DesignOptions
    progress: Progress
    notes: list[str] = field(default_factory=list)
    places: dict[tuple[int, ...], _Place] = field(default_factory=dict)
    left: int = DESIGN_WORK

    def run(self) -> DesignResult:
        study, options = self.study, self.options
        check_places(study.transducer, study.shunts, options)
        if options.band is not None and not is_sine(study.excitation):
            self.notes.append(f"design.band is not used: {study.excitation.kind} has a spectrum of its own")
        unused = [name for name in ("order", "coil_quality") if getattr(options, name) is not None]
        if unused and SYNTHESISED not in (options.candidates or ()):
            self.notes.append(f"design.{unused[0]} is not used: no candidate is {SYNTHESISED!r}")
        self.notes += _about_parts(options)
        self.operation = operation_of(study.excitation, options.band, study.transducer)
        if study.free_frequency:  # from here on the band is where it is sought, and not what counts
            self.options = options = replace(options, band=None)
        self.goal = Goal(options)
        drafting = Drafting(study.transducer, study.shunts, options, self.operation)
        drafts = drafting.drafts()
        self.notes += about_places(study.transducer, drafts, options)
        drafts += self._synthesised(drafting)
        if drafting.left_out:
            self.notes.append(f"left out: {'; '.join(drafting.left_out)}")
        self.notes += drafting.unlike + retuned(drafts, study.shunts, options.tune or (), options.hold or ())
        for draft in drafts:
            self._place(draft.shunt.taken)
        candidate = self._at_free_frequency if study.free_frequency else self._at_operation
        return self._result(tuple(sorted(self._candidates(drafts, candidate), key=self._rank)))

    def _synthesised(self, drafting: Drafting) -> list[Draft]:
        """Draft of a synthesised network, where it is asked for, with the place that has its synthesis."""
        if SYNTHESISED not in (self.options.candidates or ()):
            return []
        number = drafting.beside["electrode"]
        if drafting.beside["others"]:
            drafting.left_out.append(f"{SYNTHESISED}, as the study's first shunt has others beside it")
            return []
        self.progress(Step(f"{SYNTHESISED}: growing a network"))
        view = self._view((number,))
        synthesis = Synthesis(view, Host.of(view))
        self._place((number,), synthesis)
        return [replace(synthesis.draft, shunt=synthesis.draft.shunt.swapped(number))]

    def _view(self, taken: tuple[int, ...]) -> LinearView:
        """The structure as shunts at these electrodes see it: the first ones are electrodes 0."""
        renumbered = {0: taken[0], taken[0]: 0}
        places = tuple(renumbered.get(number, number) for number in taken)
        transducer = self.study.transducer.swapped(taken[0])
        return LinearView(transducer, self.operation, self.goal, taken=places).working()

    def _place(self, taken: tuple[int, ...], synthesis: Synthesis | None = None) -> _Place:
        """What tunes shunts at these electrodes, kept."""
        if taken not in self.places:
            view = synthesis.view if synthesis else self._view(taken)
            self.places[taken] = (self._sought if self.study.free_frequency else self._made)(taken[0], view, synthesis)
        return self.places[taken]

    def _made(self, number: int, view: LinearView, synthesis: Synthesis | None) -> _Place:
        """Place of candidates in the operation of the study."""
        trial = Trial(view)
        if self.places:  # what they have simulated is theirs together
            trial.left = self.left
        if trial.unresolved and not self.places:
            self.notes.append(
                "mean power over the band: the simulated frequencies may be too far apart for such sharp resonances"
            )
        place = _Place(number, view, trial, self._maker(trial, synthesis))
        self.left = trial.left
        return place

    def _sought(self, number: int, view: LinearView, _: Synthesis | None) -> _Place:
        """Place of candidates each at the frequency of the band that is best for it."""
        assert self.study.design is not None and self.study.design.band is not None
        whole = view.operation
        middle = operation_of(whole.at(whole.centre(view.transducer)), None, view.transducer)
        trial = Trial(replace(view, operation=middle))
        return _Place(number, trial.view, trial, search=FrequencySearch(trial, self.study.design.band))

    def _at_operation(self, draft: Draft) -> Candidate:
        """Candidate of a draft in the operation of the study."""
        place = self._place(draft.shunt.taken)
        assert place.maker is not None
        place.trial.left = self.left
        try:
            return moved_back(place.maker.candidate(moved(draft)), place.number)
        finally:
            self.left = place.trial.left

    def _at_free_frequency(self, draft: Draft) -> Candidate:
        """Candidate of a draft at the frequency of the band that is best for it."""
        place, draft = self._place(draft.shunt.taken), moved(draft)
        assert place.search is not None
        self.progress(Step(f"{draft.kind}: seeking the best frequency"))
        place.search.trial.left = SEARCH_WORK
        frequency = place.search.best(draft)
        self.progress(Step(f"{draft.kind}: {frequency:.6g} Hz"))
        trial = Trial(place.search.view_at(frequency), left=self.left)
        found = self._maker(trial).candidate(draft)
        self.left = trial.left
        return replace(moved_back(found, place.number), frequency=frequency)

    def _maker(self, trial: Trial, synthesis: Synthesis | None = None) -> CandidateMaker:
        """Maker of candidates in the operation of a trial."""
        reference = trial.shorted  # of all figures: computed first, as a design is impossible without it
        tolerance, view = self.options.tolerance, trial.view
        robust = Robustness(view, reference, tolerance) if tolerance else None
        return CandidateMaker(view, trial, Host.of(view), self.progress, robust, synthesis, self.notes)

    def _result(self, candidates: tuple[Candidate, ...]) -> DesignResult:
        """Result with the fronts, and with the distance of the ranked candidates from the bound."""
        if not any(candidate.feasible for candidate in candidates):
            self.notes.insert(0, "no candidate meets all limits")
        if self.goal.damping and all(candidate.added_damping is None for candidate in candidates):
            self.notes += why_none(self.study.transducer, self.study.excitation)
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
        found = []
        for place in self.places.values():
            assert place.maker is not None
            tracer = FrontTracer(place.view, place.maker.host, place.maker.is_exact, progress=self.progress)
            for draft, best in place.maker.tuned:
                self.progress(Step(f"{draft.kind}: front between power and damping"))
                front = tracer.front(draft, best)
                points = tuple(replace(point, shunt=as_network(point.shunt)) for point in front.points)
                found.append(front_back(replace(front, points=points), place.number))
            self.notes += tracer.notes
        return tuple(front for front in found if front.points)

    def _bound(self, candidates: tuple[Candidate, ...]) -> Bound:
        """Bound of passive linear shunts, with remarks on it and on candidates that pass it."""
        self.progress(Step("bound of passive linear shunts", self.parts - 1, self.parts))
        bound = self._bound_at_places(candidates)
        self.notes += bound.notes
        if bound.linearised:
            self.notes.append("the bound is that of the hysteresis linearised at the amplitude found")
        if not self.operation.periodic:  # a realisation may be above or below what is expected of it
            return bound
        for candidate in candidates:
            gap = bound.gap(candidate.harvested_power, candidate.attenuation_db, damping=self.goal.damping)
            if gap is not None and gap < -_BEYOND:
                self.notes.append(_beyond(candidate, bound))
        return bound

    def _bound_at_places(self, candidates: tuple[Candidate, ...]) -> Bound:
        """Bound at the electrodes of all candidates, with hysteresis at the amplitude with the best linear one."""
        taken = {number for places in self.places for number in places}
        if len(taken) > 1:
            transducer = self.study.transducer
            return bound_of_several(transducer, self.operation, self.goal, tuple(sorted(taken)), self._free_band)
        (place,) = self.places.values()
        linear = next((c for c in candidates if isinstance(c.shunt, LinearShunt)), None)
        shunt = linear.shunt.swapped(place.number) if linear else None
        if place.search is None:
            return bound_of(place.view.working(shunt))
        view = place.search.view_at((linear or candidates[0]).frequency or place.search.grid[0])
        return bound_in_band(view.working(shunt), place.search.grid)

    @property
    def _free_band(self) -> tuple[float, float] | None:
        """Band in which the frequency of the drive is sought, Hz; None where it is given."""
        return self.study.design.band if self.study.free_frequency and self.study.design else None

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


def _beyond(candidate: Candidate, bound: Bound) -> str:
    """Remark on a candidate that passes the bound of passive linear shunts."""
    active = isinstance(candidate.shunt, LinearShunt)
    why = "it is not passive" if active else "it is switched"
    limit = "" if bound.any_interface is None else f"; no circuit passes {bound.any_interface:.4g} W (F^2/(8 b))"
    return f"{candidate.shunt.kind}: passes the bound of passive linear shunts, as {why}{limit}"
