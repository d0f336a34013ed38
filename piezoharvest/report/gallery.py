"""The figures of a design's report, with their captions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.description.shunts import Open, Short
from piezoharvest.design.result import DesignResult
from piezoharvest.engine.response import Waveforms
from piezoharvest.progress import Stage, follower
from piezoharvest.report.figures import bode, curves, front, hysteresis, ledger, restrictions, schedule, waveforms
from piezoharvest.report.figures.bound_lines import BoundLines
from piezoharvest.report.figures.pictures import Picture
from piezoharvest.report.limits import Limit, hysteretic
from piezoharvest.report.signals import occasion, signals_of, windows
from piezoharvest.report.spans import dense, design_band, drive_frequency, frequency_range, loads, sweep_span
from piezoharvest.report.subjects import Subject, front_subject
from piezoharvest.report.sweeps import CandidateCurve, CurveTracer
from piezoharvest.report.units import engineering, pretty_unit
from piezoharvest.study import Study

MAX_CURVES = 6  # in one figure: the number of colours
_MAX_WAVEFORMS = 4
_LOADS, _FEWER_LOADS, _FREQUENCIES, _FINE = 33, 17, 121, 300


@dataclass
class Gallery:
    """Draws the figures of a design.

    Attributes
    ----------
    study : Study
    subjects : sequence of Subject
    limit : Limit or None
        Upper limit of power of any interface.
    bound : BoundLines or None
        Limits of passive linear shunts.
    result : DesignResult or None
        With the fronts of a trade-off.
    remarks : list of str
        Omissions in the figures.
    """

    study: Study
    subjects: Sequence[Subject]
    limit: Limit | None = None
    bound: BoundLines | None = None
    result: DesignResult | None = None
    remarks: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._bench = CurveTracer(self.study)
        self._ready: dict[Subject, Waveforms] = {}
        self._drawn = [s for s in self.subjects if not isinstance(s.shunt, Open | Short)][:MAX_CURVES]
        self._free = any(s.candidate.frequency for s in self.subjects)
        drive = None if self._free else drive_frequency(self.study)
        self._marks = {"drive": drive, "band": design_band(self.study)}
        left_out = len([s for s in self.subjects if not isinstance(s.shunt, Open | Short)]) - len(self._drawn)
        if left_out:
            self.remarks.append(f"curves are drawn for the {MAX_CURVES} best candidates, not for the other {left_out}")

    def pictures(self) -> Iterator[Picture]:
        """All figures of the study, one after the other."""
        kinds = (
            self._front, self._ledger, self._restrictions, self._loads, self._frequencies, self._schedule,
            self._damping, self._waveforms, self._loops, self._bode,
        )  # fmt: skip
        for drawn in Stage(follower(), "drawing", "kinds of figures").over(kinds):
            yield from drawn()
        if self._bench.cut_short:
            self.remarks.append(
                "simulations of this study are slow: some curves have fewer points than usual, or are omitted"
            )

    def _front(self) -> Iterator[Picture]:
        if self.result is None or not self.result.trade_off:
            return
        drawn = [(front_subject(self.subjects, one), one) for one in self.result.fronts]
        caption = (
            "None of these designs is better than another in both objectives. Every dot is a separate design with its "
            "parts as tuned; diamonds are circuits with nothing to tune."
        )
        figure = front.front(sorted(drawn, key=lambda pair: pair[0].rank), self.result.trade_off, self.result.bound)
        yield Picture("trade-off", "trade-off", "Front between harvested power and damping", caption, figure)

    def _ledger(self) -> Iterator[Picture]:
        if any(ledger.shares(s) for s in self.subjects):
            span = "period" if self._periodic else "run"
            caption = f"Per {span}, by simulation; the energies balance within rounding errors."
            yield Picture("energy", "answer", "Where the energy goes", caption, ledger.ledger(self.subjects))

    def _restrictions(self) -> Iterator[Picture]:
        rows = next((s.candidate.restrictions for s in self.subjects if s.candidate.restrictions), None)
        if rows:
            section = "power" if "harvested_power" in rows[0] else "damping"
            caption = "Best passive network found on the two-port, with one restriction after the other added."
            yield Picture(
                "restrictions", section, "What each restriction costs", caption, restrictions.restrictions(rows)
            )

    @property
    def _periodic(self) -> bool:
        return self.study.excitation.period is not None

    def _loads(self) -> Iterator[Picture]:
        band = design_band(self.study)
        count = _LOADS if self._periodic and band is None else _FEWER_LOADS
        found = self._bench.along_loads(self._drawn, loads(self._drawn, self.study, count))
        level = [s for s in self._drawn if s.harvests and s.load_field is None and s.switched and s.candidate.converged]
        if not found:
            return
        caption = f"Mean over {frequency_range(band)}. " if band else ""
        caption += "Each at its own best frequency. " if self._free else ""
        caption += f"Everything except the load as tuned. {_origin(found)}{self._dropped(found)}"
        bound = self.bound.power if self.bound else None
        figure = curves.power_along_loads(found, level, self.limit.power if self.limit else None, bound)
        yield Picture("power-load", "power", "Power and efficiency against the load", caption, figure)

    def _frequencies(self) -> Iterator[Picture]:
        self._swept: list[CandidateCurve] = []
        span, drive = sweep_span(self.study), drive_frequency(self.study)
        if drive is None:
            return
        grid = np.unique(np.append(span.points(_FREQUENCIES), drive))
        grid = grid[(grid >= span.low) & (grid <= span.high)]
        fine = np.unique(np.append(dense(span, self.study.transducer, _FINE), grid))
        self._swept = self._bench.along_frequencies(self._drawn, grid, fine)
        powered = [curve for curve in self._swept if curve.subject.harvests]
        if not powered:
            return
        caption = f"Loads as tuned, excitation amplitude constant. {_origin(powered)}{self._dropped(powered)}"
        limit, bound = self.limit.power if self.limit else None, self.bound and self.bound.most_power(fine)
        figure = curves.power_along_frequencies(powered, span, limit, bound, self._marks)
        yield Picture("power-frequency", "power", "Power and efficiency against the frequency", caption, figure)

    def _schedule(self) -> Iterator[Picture]:
        drawn, band = [s for s in self._drawn if s.candidate.schedule], design_band(self.study)
        if not drawn or band is None:
            return
        gains = [f"{s.label} {engineering(s.candidate.scheduled_power, 'W')}" for s in drawn]
        caption = "Best values at each frequency, for a controller that knows it, by simulation; dotted: the best "
        caption += f"fixed values. Mean power with the schedule: {', '.join(gains)}."
        figure = schedule.schedule(drawn, band)
        yield Picture("schedule", "power", "Lag and load as a schedule over the frequency", caption, figure)

    def _damping(self) -> Iterator[Picture]:
        swept, span, per = self._swept, sweep_span(self.study), ""
        fine = dense(span, self.study.transducer, _FINE)
        if drive_frequency(self.study) is None:
            swept = self._bench.linear(self._drawn, fine)
            per = pretty_unit("m/s^2" if self.study.excitation.base else "N")
        if not swept:
            return
        short, swept = self._bench.against_short(swept, fine)
        caption = "Displacement amplitude, also in decibels relative to shorted electrodes at the same frequency. "
        caption += f"{_origin(swept)}{self._dropped(swept)}"
        driven = drive_frequency(self.study) is not None
        bound = self.bound.least_displacement(fine) if self.bound is not None and driven else None
        figure = curves.damping(swept, short, span, self._marks, per, bound)
        yield Picture("damping", "damping", "Vibration against the frequency", caption, figure)

    def _waveforms(self) -> Iterator[Picture]:
        able = [s for s in self.subjects if s.waveforms is not None]
        chosen = [s for s in able if s.rank == 0 or (s.switched and s.candidate.converged)][:_MAX_WAVEFORMS]
        for subject in chosen or able[:1]:
            assert subject.response is not None
            drawn = self._signals(subject)
            shown = windows(self.study, drawn, subject.response)
            figure = waveforms.waveforms(drawn, shown, self.study.excitation.base)
            name = f"waveforms-{subject.rank + 1}-{subject.shunt.kind.replace('_', '-')}"
            caption = occasion(self.study, subject.response)
            yield Picture(name, "waveforms", f"Waveforms: {subject.label}", caption, figure)

    def _signals(self, subject: Subject) -> Waveforms:
        if subject not in self._ready:
            self._ready[subject] = signals_of(self.study, subject)
        return self._ready[subject]

    def _loops(self) -> Iterator[Picture]:
        able = [s for s in self._drawn if s.waveforms is not None and s.candidate.converged][:_MAX_WAVEFORMS]
        if not hysteretic(self.study.transducer) or not able:
            return
        drawn = [(s, self._signals(s), s.response) for s in able if s.response]
        parts = [(s, signals, windows(self.study, signals, response)[-1]) for s, signals, response in drawn]
        per = " per period" if self._periodic else ""
        caption = f"Areas are energies{per}: on the left lost to hysteresis, on the right delivered to the shunt."
        if parts[0][-1].title and not self._periodic:
            caption = f"Those {parts[0][-1].title}. {caption}"
        figure = hysteresis.loops(parts, self._periodic)
        yield Picture("hysteresis", "damping", "Hysteresis loops", caption, figure)

    def _bode(self) -> Iterator[Picture]:
        amplitude = bode.charge_amplitude(self.study, self.subjects)
        figure = bode.bode(self.study, self.subjects, amplitude)
        caption = "Mechanical receptance of the two-port, exact."
        if amplitude is not None:
            at = f"at a charge amplitude of {engineering(amplitude, 'C')}"
            caption = (
                f"Mechanical receptance of the two-port. Hysteresis is represented by its describing function {at}."
            )
        yield Picture("bode", "two-port", "Bode diagram", caption, figure)

    @staticmethod
    def _dropped(found: Sequence[CandidateCurve]) -> str:
        missing = sum(curve.missing for curve in found)
        return f" Omitted without a trustworthy result: {counted(missing, 'point')}." if missing else ""


def _origin(found: Sequence[CandidateCurve]) -> str:
    """Origin of the curves: two-port or simulation, in words."""
    exact = [curve.subject.label for curve in found if curve.exact]
    if len(exact) == len(found):
        return "Lines: exact two-port."
    return f"Exact two-port: {', '.join(exact)}; by simulation: all others." if exact else "By simulation."
