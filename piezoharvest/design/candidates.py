"""One candidate of a design: a draft is tuned, rounded to parts, checked by simulation, and remarked upon."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import LinearShunt, Shunt
from piezoharvest.description.shunts.bridge import Bridge
from piezoharvest.design.added_damping import added_damping
from piezoharvest.design.drafts import Draft, any_harvests
from piezoharvest.design.goal import Goal, largest_inductance
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.parts.choice import PartsChoice, PartsChooser, RobustChoice
from piezoharvest.design.parts.rounding import Judge
from piezoharvest.design.parts.series import Series
from piezoharvest.design.places import lists_of
from piezoharvest.design.result import Candidate
from piezoharvest.design.robust.robustness import Robustness
from piezoharvest.design.robust.worst import RobustCase
from piezoharvest.design.synthesis.ladder import Ladder
from piezoharvest.design.synthesis.synthesis import Synthesis
from piezoharvest.design.synthesis.view import LadderView
from piezoharvest.design.trial import Trial
from piezoharvest.design.tuning.bridges import bridge_starts
from piezoharvest.design.tuning.joint import joint_starts
from piezoharvest.design.tuning.late import tune_late, tune_time_lag
from piezoharvest.design.tuning.minimax import Tuned, tune
from piezoharvest.design.tuning.phase import PhaseTuning, phase_start
from piezoharvest.design.tuning.refine import refine
from piezoharvest.design.tuning.region import Region
from piezoharvest.design.tuning.settled import settled_starts
from piezoharvest.design.tuning.starts import Host, Start
from piezoharvest.progress import Stage, Step

LARGEST_COIL = 1.0  # H; beyond, "discrete inductors are limited" (Fleming, Behrens & Moheimani, SMS 12, 57-64, 2003)
_MAX_DISAGREEMENT = 5e-3  # e-folds; the simulation's mean over a band is good to 1e-3
_AMPLITUDE_ROUNDS = 3

Progress = Callable[[str], object]


@dataclass
class CandidateMaker:
    """Makes candidates of drafts, for one transducer in its operation.

    Attributes
    ----------
    view : LinearView
        The transducer as a two-port, its operation and the goal; with hysteresis at the amplitude of a matched load.
    trial : Trial
    host : Host
    progress : callable
    robust : Robustness or None
        Where the study has a tolerance.
    synthesis : Synthesis or None
        Where a network is asked for.
    notes : list of str
        Remarks on the candidates so far.
    tuned : list of (Draft, Shunt)
        Drafts so far, with their shunts as tuned and not rounded.
    """

    view: LinearView
    trial: Trial
    host: Host
    progress: Progress
    robust: Robustness | None
    synthesis: Synthesis | None
    notes: list[str] = field(default_factory=list)
    tuned: list[tuple[Draft, Shunt]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.goal, self.operation = self.view.goal, self.view.operation
        self.options, self.capacitance = self.goal.options, self.view.transducer.capacitance

    def candidate(self, draft: Draft) -> Candidate:
        """Tune a draft and check it."""
        self.progress(Step(f"{draft.kind}: {'tuning ' + ', '.join(draft.free) if draft.free else 'nothing to tune'}"))
        phase = self._phase(draft) if "phase_lag" in draft.free else None
        tuned = phase.fixed() if phase else self._tuned(draft)
        if draft.late and not isinstance(draft.shunt, LinearShunt):
            tuned = self._tuned_late(draft, tuned)
            draft = replace(draft, shunt=tuned.shunt, smoothing=_kept(draft))
            phase = self._phase(draft) if phase else None  # a schedule is that of the circuit as tuned
        self.tuned.append((draft, tuned.shunt))
        nominal, tuned = tuned.shunt, self._hardened(draft, tuned)
        schedule = phase.schedule() if phase and self.options.band and not self.goal.damping else None
        parts = self._parts(draft, tuned.shunt)
        shunt = as_network(parts.shunt if parts else tuned.shunt)
        figures = self.trial.figures(shunt, complete=True)
        violates = self.goal.violated(figures, shunt, self.capacitance)
        worst_case = self._worst_case(shunt, as_network(nominal))
        if self.options.worst_case and worst_case:
            violates = tuple(dict.fromkeys((*violates, *worst_case.violates)))
        found = Candidate(
            shunt=shunt, parts=parts, harvested_power=figures.harvested_power, attenuation_db=figures.attenuation_db,
            displacement_amplitude=figures.displacement_amplitude, voltage_amplitude=figures.voltage_amplitude,
            added_damping=added_damping(figures.response, self.view.transducer, self.operation.excitation),
            converged=figures.converged, standard_error=figures.standard_error, violates=violates,
            start=tuned.start, method=tuned.method,
            iterations=tuned.iterations, response=figures.response,
            schedule=schedule and schedule.table, scheduled_power=schedule and schedule.power, worst_case=worst_case,
            restrictions=self.synthesis.restrictions() if self.synthesis and isinstance(draft.shunt, Ladder) else None,
        )  # fmt: skip
        self._add_notes(draft, found, tuned.shunt, figures.message)
        return found

    def _tuned(self, draft: Draft) -> Tuned:
        if not draft.free:
            return Tuned(draft.shunt, np.nan, "as given", "nothing to tune", 0)
        if isinstance(draft.shunt, LinearShunt):
            return self._linear(draft)
        found = bridge_starts(self.view, draft) if isinstance(draft.shunt, Bridge) else []
        found = found or settled_starts(self.view, draft, self.host) or [Start("as given", draft.first())]
        return _best(refine(self.trial, draft, start) for start in found)

    def _tuned_late(self, draft: Draft, tuned: Tuned) -> Tuned:
        """The draft with its late fields tuned, too."""
        trial = self._trial_of(draft)
        self.progress(Step(f"{draft.kind}: tuning {', '.join(draft.late)}"))
        if draft.late != ("time_lag",):
            tuned = tune_late(trial, draft, tuned, self.host)
            draft = replace(draft, shunt=tuned.shunt, smoothing=_kept(draft))
        if "time_lag" not in draft.late:
            return tuned
        found = tune_time_lag(trial, draft, tuned, self.host)
        if found is None:
            self.notes.append(f"{draft.kind}: its time lag is not tuned, as that many simulations take too long")
        return found or tuned

    def _hardened(self, draft: Draft, tuned: Tuned) -> Tuned:
        """The draft tuned for its worst case, where that is asked for."""
        if self.robust is None or not self.options.worst_case:
            return tuned
        self.progress(Step(f"{draft.kind}: tuning for the worst case"))
        try:
            exact = self._on_two_port(tuned.shunt)
            found = joint_starts(self._view(draft), draft, self.host) if exact else []
            return self.robust.hardened(draft, tuned, self._region(draft), exact, found, self.progress)
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
        return isinstance(shunt, LinearShunt) and self.is_exact(self.view.working(shunt), shunt)

    def _phase(self, draft: Draft) -> PhaseTuning:
        loads = isinstance(draft.shunt, Bridge) and draft.shunt.tuned_side in draft.free and len(draft.free) > 1
        found = bridge_starts(self.view, draft) if loads else []
        return PhaseTuning(self._trial_of(draft), draft, phase_start(draft, found), self._region(draft))

    def _trial_of(self, draft: Draft) -> Trial:
        """The trial in which a draft is tuned: for damping where power counts and it harvests none."""
        if self.goal.damping or any_harvests(draft.shunt, self.view.transducer, 2 * np.pi / self.host.omega):
            return self.trial
        return Trial(replace(self.view, goal=Goal(replace(self.options, objective="damping"))), left=self.trial.left)

    def _linear(self, draft: Draft) -> Tuned:
        """Tune on the two-port, and on by simulation from there if that disagrees."""
        view, region = self._view(draft), self._region(draft)
        found = joint_starts(view, draft, self.host)
        if lists_of(type(draft.shunt)):  # a branch for each mode: with so many parts one tuning takes seconds
            found = [min(found, key=lambda start: view.merit(draft.with_values(start.values)))]
        names = [f"tuning, start {n + 1} of {len(found)}" if len(found) > 1 else "tuning" for n in range(len(found))]
        each = zip(found, names, strict=True)
        best = _best(tune(view, draft, start, region, self._stage(draft, name)) for start, name in each)
        for _ in range(_AMPLITUDE_ROUNDS if view.amplitude else 0):
            # The describing function at the amplitude with the tuned shunt, not at a guessed one.
            view = view.working(best.shunt)
            stage = self._stage(draft, "tuning at the amplitude found")
            best = tune(view, draft, _start_at(draft, best), region, stage)._replace(start=best.start)
        if self.is_exact(view, best.shunt):
            return best
        refined = refine(self.trial, draft, _start_at(draft, best), region, self._stage(draft, "tuning by simulation"))
        steps = best.iterations + refined.iterations
        return refined._replace(method=f"{best.method}, {refined.method}", iterations=steps)

    def is_exact(self, view: LinearView, shunt: Shunt) -> bool:
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
        view, exact, region = None, False, None
        if isinstance(tuned, LinearShunt):
            view, region = self._view(draft).working(tuned), self._region(draft)
            exact = self.is_exact(view, tuned)
        robust = self._robust_parts(tuned, region) if self.robust and self.options.worst_case else None
        return PartsChooser(self.trial, self.goal, view, exact, region, self.progress, robust).choose(draft, tuned)

    def _robust_parts(self, tuned: Shunt, region: Region | None) -> RobustChoice:
        """What chooses parts for their worst case; those that are best without a tolerance where there is none."""
        exact = self._on_two_port(tuned)

        def choose(
            draft: Draft, series: Series, known: dict[str, float]
        ) -> tuple[dict[str, float], Judge | None, bool]:
            assert self.robust is not None
            try:
                return self.robust.rounded(draft, series, known, region, exact, self.progress)
            except ParameterError as error:
                note = f"its parts of {series.name} are chosen for the nominal values, not for the worst case"
                self.notes.append(f"{tuned.kind}: {note}: {error.message}")
                return known, None, True

        return choose

    def _stage(self, draft: Draft, name: str) -> Stage:
        """What tells how far a tuning is, which ends as soon as it has converged."""
        return Stage(self.progress, f"{draft.kind}: {name}", "steps", most=True)

    def _view(self, draft: Draft) -> LinearView:
        """The two-port, for a synthesised network in its faster form."""
        return LadderView.of(self.view) if isinstance(draft.shunt, Ladder) else self.view

    def _region(self, draft: Draft) -> Region:
        return Region.of(draft, self.host, self.options.max_inductance)

    def _add_notes(self, draft: Draft, found: Candidate, tuned: Shunt, message: str) -> None:
        """Add notes on a candidate: assumptions, unavailable parts, optima at their bounds, limits."""
        kind, note = found.shunt.kind, self.notes.append
        self.progress(Step(f"{kind}: {found.harvested_power:.4g} W, {found.attenuation_db:.2f} dB"))
        for text in draft.assumed:
            note(f"{kind}: assumed {text}")
        inductance = largest_inductance(found.shunt, self.capacitance)
        if inductance > LARGEST_COIL:
            size = f"{inductance:.3g}" if inductance < 1e3 else f"{inductance:.0f}"
            note(f"{kind}: {size} H needs a synthetic inductor (coils reach about {LARGEST_COIL:g} H)")
        if draft.free and isinstance(found.shunt, LinearShunt):
            region = self._region(draft)
            for text in region.remarks(np.log(list(draft.values_of(tuned).values()))):
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
            note(f"{kind}: does not meet {', '.join(found.violates)}")


def _kept(draft: Draft) -> float | None:
    """Time constant of a smoothing that still follows the load: none where it is tuned by itself."""
    return None if "smoothing_capacitance" in draft.late else draft.smoothing


def as_network(shunt: Shunt) -> Shunt:
    """The shunt, a synthesised one as the netlist that is simulated."""
    return shunt.network() if isinstance(shunt, Ladder) else shunt


def _best(tried: Iterable[Tuned]) -> Tuned:
    """The best; of those that end in the same optimum the first, named after the better known formula."""
    return min(tried, key=lambda tuned: round(tuned.merit, 5))


def _start_at(draft: Draft, tuned: Tuned) -> Start:
    return Start(tuned.start, draft.values_of(tuned.shunt))
