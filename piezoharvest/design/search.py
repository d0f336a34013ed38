"""The design procedure: draft candidates, tune each, check it by simulation, rank them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import LinearShunt, Shunt
from piezoharvest.description.shunts.bridge import Bridge
from piezoharvest.design.bound import bound_of
from piezoharvest.design.drafts import Draft, Drafting, harvests
from piezoharvest.design.front import Front, FrontTracer
from piezoharvest.design.goal import Goal, largest_inductance
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.operation import is_sine, operation_of
from piezoharvest.design.parts.choice import PartsChoice, PartsChooser
from piezoharvest.design.places import lists_of, value_at
from piezoharvest.design.result import Bound, Candidate, DesignResult
from piezoharvest.design.robust.robustness import Robustness
from piezoharvest.design.robust.worst import RobustCase
from piezoharvest.design.synthesis.ladder import Ladder
from piezoharvest.design.synthesis.synthesis import Synthesis, bounded
from piezoharvest.design.synthesis.view import LadderView
from piezoharvest.design.trial import Trial
from piezoharvest.design.tuning.bridges import bridge_starts
from piezoharvest.design.tuning.minimax import Tuned, tune
from piezoharvest.design.tuning.phase import PhaseTuning, phase_start
from piezoharvest.design.tuning.refine import refine
from piezoharvest.design.tuning.region import Region
from piezoharvest.design.tuning.starts import Host, Start, starts
from piezoharvest.study import SYNTHESISED, DesignOptions, Study

LARGEST_COIL = 1.0  # H; beyond, "discrete inductors are limited" (Fleming, Behrens & Moheimani, SMS 12, 57-64, 2003)
_MAX_DISAGREEMENT = 5e-3  # e-folds; the simulation's mean over a band is good to 1e-3
_AMPLITUDE_ROUNDS = 3
_BEYOND = 2e-3  # relative, or dB: twice the error of a simulated mean over a band

Progress = Callable[[str], object]


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
    """
    options = study.design or DesignOptions()
    return _Design(study, options, progress or (lambda _: None)).run()


@dataclass
class _Design:
    study: Study
    options: DesignOptions
    progress: Progress
    notes: list[str] = field(default_factory=list)
    tuned: list[tuple[Draft, Shunt]] = field(default_factory=list)

    def run(self) -> DesignResult:
        study, options = self.study, self.options
        if options.band is not None and not is_sine(study.excitation):
            self.notes.append(f"design.band is not used: {study.excitation.kind} has a spectrum of its own")
        self.operation = operation_of(study.excitation, options.band, study.transducer)
        self.goal = Goal(options)
        self.view = LinearView(study.transducer, self.operation, self.goal).working()
        self.trial = Trial(self.view)
        self.host = Host.of(self.view)
        drafting = Drafting(study.transducer, study.shunts, options, self.operation)
        drafts = [*drafting.drafts(), *self._synthesised()]
        if drafting.left_out:
            self.notes.append(f"left out: {'; '.join(drafting.left_out)}")
        self.notes += drafting.unlike
        if self.trial.unresolved:
            self.notes.append("resonances are sharper than the simulated mean power over the band is sure to see")
        reference = self.trial.shorted  # of all figures: computed first, as a design is impossible without it
        self.robust = Robustness(self.view, reference, options.tolerance) if options.tolerance else None
        candidates = tuple(sorted(self._candidates(drafts), key=self._rank))
        if not any(candidate.feasible for candidate in candidates):
            self.notes.insert(0, "no candidate keeps all limits")
        fronts = self._fronts() if options.objective == "trade_off" else ()
        bound = self._bound(candidates)
        gaps = [bound.gap(c.harvested_power, c.attenuation_db, damping=self.goal.damping) for c in candidates]
        candidates = tuple(
            replace(c, gap_to_bound=gap, restrictions=bounded(c.restrictions, bound))
            for c, gap in zip(candidates, gaps, strict=True)
        )
        return DesignResult(candidates=candidates, bound=bound, fronts=fronts, notes=tuple(self.notes))

    def _fronts(self) -> tuple[Front, ...]:
        """Fronts between power and damping, with parts as tuned, not as bought."""
        tracer = FrontTracer(self.view, self.host, self._is_exact)
        found = []
        for draft, best in self.tuned:
            self.progress(f"{draft.kind}: front between power and damping")
            front = tracer.front(draft, best)
            points = tuple(replace(point, shunt=_as_network(point.shunt)) for point in front.points)
            found.append(replace(front, points=points))
        self.notes += tracer.notes
        return tuple(front for front in found if front.points)

    def _synthesised(self) -> list[Draft]:
        """Draft of a synthesised network, where it is asked for."""
        if SYNTHESISED not in (self.options.candidates or ()):
            return []
        self.progress(f"{SYNTHESISED}: growing a network")
        self.synthesis = Synthesis(self.view, self.host)
        return [self.synthesis.draft]

    def _bound(self, candidates: tuple[Candidate, ...]) -> Bound:
        """Bound of passive linear shunts, with hysteresis at the amplitude with the best of the linear candidates."""
        self.progress("bound of passive linear shunts")
        linear = [c.shunt for c in candidates if isinstance(c.shunt, LinearShunt)]
        bound = bound_of(self.view.working(linear[0] if linear else None))
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

    def _rank(self, candidate: Candidate) -> tuple:
        figures = candidate.worst_case.figures if self.options.worst_case and candidate.worst_case else candidate
        value = figures.displacement_amplitude if self.goal.damping else -figures.harvested_power
        return not candidate.converged, not candidate.feasible, value if np.isfinite(value) else np.inf

    def _candidates(self, drafts: Iterable[Draft]) -> list[Candidate]:
        """Tune and check the drafts; those that exceed the budget are left out, unless no other is left."""
        found, refused = [], None
        for draft in drafts:
            try:
                found.append(self._candidate(draft))
            except ParameterError as error:
                refused = error
                self.notes.append(f"left out: {draft.kind}: {error.message}")
        if refused and not found:
            raise refused
        return found

    def _candidate(self, draft: Draft) -> Candidate:
        """Tune a draft and check it."""
        self.progress(f"{draft.kind}: tuning {', '.join(draft.free) or 'nothing'}")
        phase = self._phase(draft) if "phase_lag" in draft.free else None
        tuned = phase.fixed() if phase else self._tuned(draft)
        self.tuned.append((draft, tuned.shunt))
        nominal, tuned = tuned.shunt, self._hardened(draft, tuned)
        schedule = phase.schedule() if phase and self.options.band and not self.goal.damping else None
        parts = self._parts(draft, tuned.shunt)
        shunt = _as_network(parts.shunt if parts else tuned.shunt)
        figures = self.trial.figures(shunt, complete=True)
        violates = self.goal.violated(figures, shunt, self.study.transducer.capacitance)
        worst_case = self._worst_case(shunt, _as_network(nominal))
        if self.options.worst_case and worst_case:
            violates = tuple(dict.fromkeys((*violates, *worst_case.violates)))
        found = Candidate(
            shunt=shunt, parts=parts, harvested_power=figures.harvested_power, attenuation_db=figures.attenuation_db,
            displacement_amplitude=figures.displacement_amplitude, voltage_amplitude=figures.voltage_amplitude,
            converged=figures.converged, standard_error=figures.standard_error, violates=violates,
            start=tuned.start, method=tuned.method,
            iterations=tuned.iterations, response=figures.response,
            schedule=schedule and schedule.table, scheduled_power=schedule and schedule.power, worst_case=worst_case,
            restrictions=self.synthesis.restrictions() if isinstance(draft.shunt, Ladder) else None,
        )  # fmt: skip
        self._add_notes(draft, found, tuned.shunt, figures.message)
        return found

    def _tuned(self, draft: Draft) -> Tuned:
        if not draft.free:
            return Tuned(draft.shunt, np.nan, "as given", "nothing to tune", 0)
        if isinstance(draft.shunt, LinearShunt):
            return self._linear(draft)
        assert isinstance(draft.shunt, Bridge)
        found = bridge_starts(self.view, draft) or [Start("as given", draft.first())]
        return _best(refine(self.trial, draft, start) for start in found)

    def _hardened(self, draft: Draft, tuned: Tuned) -> Tuned:
        """The draft tuned for its worst case, where that is asked for."""
        if self.robust is None or not self.options.worst_case:
            return tuned
        self.progress(f"{draft.kind}: tuning for the worst case")
        try:
            return self.robust.hardened(draft, tuned, self._region(draft), self._on_two_port(tuned.shunt))
        except ParameterError as error:
            self.notes.append(f"{draft.kind}: not tuned for its worst case: {error.message}")
            return tuned

    def _worst_case(self, shunt: Shunt, nominal: Shunt) -> RobustCase | None:
        """Worst case of a candidate, where a tolerance is given."""
        if self.robust is None:
            return None
        before = nominal if self.options.worst_case else shunt
        try:
            return self.robust.case(shunt, before, self._on_two_port(shunt))
        except ParameterError as error:
            self.notes.append(f"{shunt.kind}: its worst case was not found: {error.message}")
            return None

    def _on_two_port(self, shunt: Shunt) -> bool:
        return isinstance(shunt, LinearShunt) and self._is_exact(self.view.working(shunt), shunt)

    def _phase(self, draft: Draft) -> PhaseTuning:
        loads = isinstance(draft.shunt, Bridge) and len(draft.free) > 1
        found = bridge_starts(self.view, draft) if loads else []
        return PhaseTuning(self._trial_of(draft), draft, phase_start(draft, found), self._region(draft))

    def _trial_of(self, draft: Draft) -> Trial:
        """The trial in which a draft is tuned: for damping where power counts and it harvests none."""
        if self.goal.damping or harvests(draft.shunt, self.study.transducer.capacitance, 2 * np.pi / self.host.omega):
            return self.trial
        return Trial(replace(self.view, goal=Goal(replace(self.options, objective="damping"))), left=self.trial.left)

    def _linear(self, draft: Draft) -> Tuned:
        """Tune on the two-port, and on by simulation from there if that disagrees."""
        view, region = self._view(draft), self._region(draft)
        found = starts(draft, self.host)
        if lists_of(type(draft.shunt)):  # a branch for each mode: with so many parts one tuning takes seconds
            found = [min(found, key=lambda start: view.goal.merit(view.figures(draft.with_values(start.values))))]
        best = _best(tune(view, draft, start, region) for start in found)
        for _ in range(_AMPLITUDE_ROUNDS if view.amplitude else 0):
            # The describing function at the amplitude with the tuned shunt, not at a guessed one.
            view = view.working(best.shunt)
            best = tune(view, draft, _start_at(draft, best), region)._replace(start=best.start)
        if self._is_exact(view, best.shunt):
            return best
        refined = refine(self.trial, draft, _start_at(draft, best), region)
        steps = best.iterations + refined.iterations
        return refined._replace(method=f"{best.method}, {refined.method}", iterations=steps)

    def _is_exact(self, view: LinearView, shunt: Shunt) -> bool:
        """True if the two-port tells as much of a linear shunt as the simulation."""
        if view.amplitude is not None:
            return False
        # A random signal: its expectation counts, not this realisation.
        return not self.operation.periodic or self.goal.agree(
            view.figures(shunt), self.trial.figures(shunt), _MAX_DISAGREEMENT
        )

    def _parts(self, draft: Draft, tuned: Shunt) -> PartsChoice | None:
        """The tuned parts as they can be bought, where a series is asked for."""
        if self.options.parts is None or not draft.free:
            return None
        if not isinstance(tuned, LinearShunt):
            return PartsChooser(self.trial, self.goal, None, False, None).choose(draft, tuned)
        view = self._view(draft).working(tuned)
        exact = self._is_exact(view, tuned)
        return PartsChooser(self.trial, self.goal, view, exact, self._region(draft)).choose(draft, tuned)

    def _view(self, draft: Draft) -> LinearView:
        """The two-port, for a synthesised network in its faster form."""
        return LadderView.of(self.view) if isinstance(draft.shunt, Ladder) else self.view

    def _region(self, draft: Draft) -> Region:
        return Region.of(draft, self.host, self.options.max_inductance)

    def _add_notes(self, draft: Draft, found: Candidate, tuned: Shunt, message: str) -> None:
        """Add notes on a candidate: assumptions, unavailable parts, optima at their bounds, limits."""
        kind, note = found.shunt.kind, self.notes.append
        self.progress(f"{kind}: {found.harvested_power:.4g} W, {found.attenuation_db:.2f} dB")
        for text in draft.assumed:
            note(f"{kind}: assumed {text}")
        inductance = largest_inductance(found.shunt, self.study.transducer.capacitance)
        if inductance > LARGEST_COIL:
            note(f"{kind}: {inductance:.3g} H needs a synthetic inductor (coils end at about {LARGEST_COIL:g} H)")
        if draft.free and isinstance(found.shunt, LinearShunt):
            region = self._region(draft)
            for text in region.remarks(np.log([value_at(tuned, n) for n in draft.free])):
                note(f"{kind}: {'before rounding, ' if found.parts else ''}{text}")
        if found.parts and found.parts.remark:
            note(f"{kind}: {found.parts.remark}")
        if found.worst_case:
            for text in found.worst_case.remarks:
                note(f"{kind}: {text}")
        if not found.converged:
            note(f"{kind}: not to be trusted: {message or 'a simulation did not converge'}")
        elif message:
            note(f"{kind}: {message}")
        if found.violates:
            note(f"{kind}: does not keep {', '.join(found.violates)}")


def _as_network(shunt: Shunt) -> Shunt:
    """The shunt, a synthesised one as the netlist that is simulated."""
    return shunt.network() if isinstance(shunt, Ladder) else shunt


def _best(tried: Iterable[Tuned]) -> Tuned:
    """The best; of those that end in the same optimum the first, named after the better known formula."""
    return min(tried, key=lambda tuned: round(tuned.merit, 5))


def _beyond(candidate: Candidate, bound: Bound) -> str:
    """Remark on a candidate that passes the bound of passive linear shunts."""
    active = isinstance(candidate.shunt, LinearShunt)
    why = "it is not passive" if active else "it is switched"
    limit = "" if bound.any_interface is None else f"; no circuit passes {bound.any_interface:.4g} W (F^2/(8 b))"
    return f"{candidate.shunt.kind}: passes the bound of passive linear shunts, as {why}{limit}"


def _start_at(draft: Draft, tuned: Tuned) -> Start:
    return Start(tuned.start, {name: value_at(tuned.shunt, name) for name in draft.free})
