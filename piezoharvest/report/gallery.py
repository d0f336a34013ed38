"""Which figures a report has, with what is written below them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from piezoharvest.engine import simulate
from piezoharvest.engine.response import Response, Waveforms
from piezoharvest.report.figures import bode, curves, hysteresis, ledger, waveforms
from piezoharvest.report.limits import Limit
from piezoharvest.report.spans import (
    dense,
    design_band,
    drive_frequency,
    frequency_range,
    large_signal,
    loads,
    sweep_span,
)
from piezoharvest.report.subjects import Subject
from piezoharvest.report.sweeps import Bench, Curve
from piezoharvest.report.units import engineering, pretty_unit
from piezoharvest.shunts import Open, Short
from piezoharvest.study import Study
from piezoharvest.system import System

MOST_CURVES = 6  # in one figure: as many as there are colours
_MOST_WAVEFORMS = 4
_LOADS, _FREQUENCIES, _FINE = 33, 121, 300
_SAMPLES = 4096  # of a period, to draw a switched current
_LAST_PERIODS = 4  # shown of a steady state that was not reached
_ZOOM_PERIODS = 8.0


class Picture(NamedTuple):
    """A figure with its name (of the file), section of the page, heading and caption."""

    name: str
    section: str
    heading: str
    caption: str
    figure: Figure


@dataclass
class Gallery:
    """Draws the figures of a design.

    Attributes
    ----------
    study : Study
    subjects : sequence of Subject
    limit : Limit or None
        Power that no interface can exceed.
    remarks : list of str
        What the figures leave out.
    """

    study: Study
    subjects: Sequence[Subject]
    limit: Limit | None = None
    remarks: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._bench = Bench(self.study)
        self._drawn = [s for s in self.subjects if not isinstance(s.shunt, Open | Short)][:MOST_CURVES]
        self._marks = {"drive": drive_frequency(self.study), "band": design_band(self.study)}
        left_out = len([s for s in self.subjects if not isinstance(s.shunt, Open | Short)]) - len(self._drawn)
        if left_out:
            self.remarks.append(
                f"curves are drawn for the {MOST_CURVES} best candidates; {left_out} more are in the table"
            )

    def pictures(self) -> Iterator[Picture]:
        """All figures that the study gives rise to, one after the other."""
        yield from self._ledger()
        yield from self._loads()
        yield from self._frequencies()
        yield from self._damping()
        yield from self._waveforms()
        yield from self._loops()
        yield from self._bode()
        if self._bench.cut_short:
            self.remarks.append("simulations take long here: some curves have fewer points than usual, or are left out")

    def _ledger(self) -> Iterator[Picture]:
        if any(ledger.shares(s) for s in self.subjects):
            caption = f"Per {'period' if self._periodic else 'run'}, by simulation; the sum closes to rounding."
            yield Picture("energy", "answer", "Where the energy goes", caption, ledger.ledger(self.subjects))

    @property
    def _periodic(self) -> bool:
        return self.study.excitation.period is not None

    def _loads(self) -> Iterator[Picture]:
        found = self._bench.along_loads(self._drawn, loads(self._drawn, self.study, _LOADS))
        level = [s for s in self._drawn if s.harvests and s.load_field is None and s.switched and s.candidate.converged]
        if not found:
            return
        band = design_band(self.study)
        caption = f"Mean over {frequency_range(band)}. " if band else ""
        caption += f"Everything but the load as tuned. {_origin(found)}{self._dropped(found)}"
        figure = curves.power_along_loads(found, level, self.limit.power if self.limit else None)
        yield Picture("power-load", "power", "Power and efficiency against the load", caption, figure)

    def _frequencies(self) -> Iterator[Picture]:
        self._swept: list[Curve] = []
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
        caption = f"Loads as tuned, amplitude of the drive unchanged. {_origin(powered)}{self._dropped(powered)}"
        figure = curves.power_along_frequencies(powered, span, self.limit.power if self.limit else None, self._marks)
        yield Picture("power-frequency", "power", "Power and efficiency against the frequency", caption, figure)

    def _damping(self) -> Iterator[Picture]:
        swept, span, per = self._swept, sweep_span(self.study), ""
        fine = dense(span, self.study.transducer, _FINE)
        if drive_frequency(self.study) is None:
            swept = self._bench.linear(self._drawn, fine)
            per = pretty_unit("m/s^2" if self.study.excitation.base else "N")
        if not swept:
            return
        short = fine, self._bench.two_port(Short(), fine)[2]
        if self.study.transducer.hysteresis is not None:
            short = swept[0].x, swept[0].displacement * 10 ** (-swept[0].attenuation / 20)
        caption = "Displacement amplitude, and in decibels against shorted electrodes at the same frequency. "
        caption += f"{_origin(swept)}{self._dropped(swept)}"
        figure = curves.damping(swept, short, span, self._marks, per)
        yield Picture("damping", "damping", "Vibration against the frequency", caption, figure)

    def _waveforms(self) -> Iterator[Picture]:
        able = [s for s in self.subjects if s.waveforms is not None]
        chosen = [s for s in able if s.rank == 0 or (s.switched and s.candidate.converged)][:_MOST_WAVEFORMS]
        for subject in chosen or able[:1]:
            response, signals = subject.response, self._signals(subject)
            assert response is not None
            windows = self._windows(signals, response)
            figure = waveforms.waveforms(signals, windows, self.study.excitation.base)
            words = "Steady state" if self._periodic else "From rest"
            if self._periodic and not response.converged:
                words = f"No steady state was found: the last {_LAST_PERIODS} periods of a long run"
            at = f" at {engineering(1 / response.period, 'Hz', 5, exact=True)}" if self._periodic else ""
            name = f"waveforms-{subject.rank + 1}-{subject.shunt.kind.replace('_', '-')}"
            yield Picture(name, "waveforms", f"Waveforms: {subject.label}", f"{words}{at}.", figure)

    def _signals(self, subject: Subject) -> Waveforms:
        """Signals to draw: in the steady state simulated once more, in fine steps."""
        response, signals = subject.response, subject.waveforms
        assert response is not None and signals is not None
        if not self._periodic:
            return signals
        if not response.converged:
            return waveforms.cut(signals, _LAST_PERIODS * response.period, True)
        if subject.switched and len(signals.time) < _SAMPLES:
            excitation = self.study.excitation
            if drive_frequency(self.study) is not None:
                excitation = dataclasses.replace(excitation, frequency=1 / response.period)
            again = simulate(System(self.study.transducer, subject.shunt), excitation, samples=_SAMPLES)
            signals = again.waveforms if again.converged and again.waveforms else signals
        return waveforms.cut(signals, response.period, True)

    def _windows(self, signals: Waveforms, response: Response) -> list[waveforms.Window]:
        """The whole; of a run without a period beside it some periods of the resonance where most moves."""
        begin, end = float(signals.time[0]), float(signals.time[-1])
        if self._periodic and response.converged:
            return [waveforms.Window(0.0, response.period, "")]
        if self._periodic:
            return [waveforms.Window(begin, end, "")]
        whole = waveforms.Window(begin, end, "")
        period = 1 / large_signal(self.study.transducer)[0].short_circuit
        spacing = (end - begin) / (len(signals.time) - 1)
        if spacing > period / 8 or end - begin < 3 * _ZOOM_PERIODS * period:
            return [whole]
        middle = float(signals.time[np.argmax(np.abs(signals.displacement))])
        left = min(max(middle - _ZOOM_PERIODS * period / 2, begin), end - _ZOOM_PERIODS * period)
        return [
            whole._replace(title="whole run"),
            waveforms.Window(left, left + _ZOOM_PERIODS * period, "around the largest displacement"),
        ]

    def _loops(self) -> Iterator[Picture]:
        able = [s for s in self._drawn if s.waveforms is not None and s.candidate.converged]
        if self.study.transducer.hysteresis is None or not able:
            return
        figure = hysteresis.loops(able[:_MOST_WAVEFORMS], self._periodic)
        per = " per period" if self._periodic else ""
        caption = f"Areas are energies{per}: on the left what hysteresis takes, on the right what the shunt gets."
        yield Picture("hysteresis", "damping", "Hysteresis loops", caption, figure)

    def _bode(self) -> Iterator[Picture]:
        amplitude = bode.charge_amplitude(self.study, self.subjects)
        figure = bode.bode(self.study, self.subjects, amplitude)
        caption = "Mechanical receptance of the two-port, exact."
        if amplitude is not None:
            at = f"at a charge amplitude of {engineering(amplitude, 'C')}"
            caption = f"Mechanical receptance of the two-port. Hysteresis enters by its describing function {at}."
        yield Picture("bode", "two-port", "Bode diagram", caption, figure)

    @staticmethod
    def _dropped(found: Sequence[Curve]) -> str:
        missing = sum(curve.missing for curve in found)
        return f" {missing} points without an answer to trust are left out." if missing else ""


def _origin(found: Sequence[Curve]) -> str:
    """Where the curves come from."""
    exact = [curve.subject.label for curve in found if curve.exact]
    if len(exact) == len(found):
        return "Lines: exact two-port."
    return f"Exact two-port: {', '.join(exact)}; by simulation: all others." if exact else "By simulation."
