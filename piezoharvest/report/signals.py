"""Waveforms for figures: resolved switching, closed periods, and windows of interest."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from piezoharvest.description.system import System
from piezoharvest.engine import simulate
from piezoharvest.engine.response import Response, Waveforms
from piezoharvest.report.spans import drive_frequency, large_signal
from piezoharvest.report.subjects import Subject
from piezoharvest.report.units import engineering
from piezoharvest.study import Study

_SAMPLES = 4096  # of a period, to resolve a switched current
_SAMPLES_PER_RESONANCE = 200  # samples in a period of the first resonance, to resolve a switched voltage in a run
_MAX_SAMPLES = 200_000
_LAST_PERIODS = 4  # shown of a steady state that was not reached
_ZOOM_PERIODS = 8.0
_SIGNALS = ("drive", "displacement", "velocity", "voltage", "current", "charge", "hysteresis_voltage", "dc_voltage",
            "acceleration")  # fmt: skip


class Window(NamedTuple):
    """Part of a run to draw, in s, and its heading."""

    begin: float
    end: float
    title: str


def signals_of(study: Study, subject: Subject) -> Waveforms:
    """Signals of a candidate to draw; switched circuits are simulated again in fine steps."""
    response, signals = subject.response, subject.waveforms
    assert response is not None and signals is not None
    periodic = study.excitation.period is not None
    if not response.converged:
        return cut(signals, _LAST_PERIODS * response.period) if periodic else signals
    if subject.switched:
        signals = _finer(study, subject, response, signals)
    return cut(signals, response.period) if periodic else signals


def _finer(study: Study, subject: Subject, response: Response, signals: Waveforms) -> Waveforms:
    excitation, length = study.excitation, float(signals.time[-1] - signals.time[0])
    if excitation.period is not None:
        wanted = samples = _SAMPLES
    else:
        wanted = int(_SAMPLES_PER_RESONANCE * length * large_signal(study.transducer)[0].short_circuit)
        samples = wanted // 8 + 1  # the engine takes eight times as many without a period
    if len(signals.time) >= wanted or wanted > _MAX_SAMPLES:
        return signals
    if drive_frequency(study) is not None:
        excitation = dataclasses.replace(excitation, frequency=1 / response.period)
    again = simulate(System(study.transducer, subject.shunt), excitation, samples=samples)
    return again.waveforms if again.converged and again.waveforms is not None else signals


def cut(signals: Waveforms, length: float) -> Waveforms:
    """Signals of one period of `length` (s), padded periodically on both sides; of a longer run its last part."""
    values = {name: np.broadcast_to(getattr(signals, name), signals.time.shape) for name in _SIGNALS}
    times, end = signals.time, float(signals.time[-1])
    if end < length:
        values = {name: np.concatenate((one[-1:], one, one[:1])) for name, one in values.items()}
        times = np.concatenate(([end - length], times, [times[0] + length]))
        return Waveforms(times, **values, event_times=signals.event_times, event_names=signals.event_names)
    keep, late = times >= end - length, signals.event_times >= end - length
    events = tuple(name for name, kept in zip(signals.event_names, late, strict=True) if kept)
    values = {name: one[keep] for name, one in values.items()}
    return Waveforms(times[keep], **values, event_times=signals.event_times[late], event_names=events)


def windows(study: Study, signals: Waveforms, response: Response) -> list[Window]:
    """The whole run; without a period also some periods of the resonance at the largest motion."""
    begin, end = float(signals.time[0]), float(signals.time[-1])
    if study.excitation.period is not None:
        return [Window(0.0, response.period, "") if response.converged else Window(begin, end, "")]
    period = 1 / large_signal(study.transducer)[0].short_circuit
    spacing, reach = (end - begin) / (len(signals.time) - 1), _ZOOM_PERIODS * period
    if spacing > period / 8 or end - begin < 3 * reach:
        return [Window(begin, end, "")]
    middle = float(signals.time[np.argmax(np.abs(signals.displacement))])
    left = min(max(middle - reach / 2, begin), end - reach)
    return [Window(begin, end, "whole run"), Window(left, left + reach, "around the largest displacement")]


def occasion(study: Study, response: Response) -> str:
    """The situation that the waveforms show, in words."""
    if study.excitation.period is None:
        return "From rest."
    if not response.converged:
        return f"No steady state was found: the last {_LAST_PERIODS} periods of a long run."
    if drive_frequency(study) is None:
        return f"Steady state, one period of {engineering(response.period, 's')}."
    return f"Steady state at {engineering(1 / response.period, 'Hz', 5, exact=True)}."
