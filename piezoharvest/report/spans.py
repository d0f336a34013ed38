"""Ranges of the curves in a report: frequencies and loads."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.description.transducer import Transducer
from piezoharvest.design.result import DesignResult
from piezoharvest.linear import resonances
from piezoharvest.report.limits import ModeFigures, mode_figures
from piezoharvest.report.subjects import Subject
from piezoharvest.report.units import engineering
from piezoharvest.study import Study

_WIDTHS = 4.0  # half-power widths, or distances of the two resonances, on each side
_DECADE = 10.0
_WIDE = 4.0  # ratio of the ends of a range, two octaves, above which its axis is logarithmic
_MAX_LOAD_RATIO = 1e3  # of a load against the impedance of the capacitance


class Span(NamedTuple):
    """Range of frequencies in Hz."""

    low: float
    high: float
    logarithmic: bool

    def points(self, count: int) -> np.ndarray:
        """Frequencies that are evenly spaced on the axis, Hz."""
        return np.geomspace(self.low, self.high, count) if self.logarithmic else np.linspace(self.low, self.high, count)


def at_best_frequency(study: Study, result: DesignResult) -> Study:
    """The study at the frequency that was found for its best candidate, where it was free."""
    if not study.free_frequency or study.design is None:
        return study
    found: dict[str, Any] = {"frequency": result.best.frequency}
    excitation, design = dataclasses.replace(study.excitation, **found), dataclasses.replace(study.design, band=None)
    return dataclasses.replace(study, excitation=excitation, design=design, free_frequency=False)


def design_band(study: Study) -> tuple[float, float] | None:
    """Band in Hz that the design is optimised for; None for a single excitation."""
    band = study.design.band if study.design else None
    return band if band is not None and drive_frequency(study) is not None else None


def drive_frequency(study: Study) -> float | None:
    """Frequency in Hz of a sinusoidal excitation; None for any other."""
    return getattr(study.excitation, "frequency", None)


def frequency_range(band: tuple[float, float]) -> str:
    """Band in words."""
    return " to ".join(engineering(edge, "Hz", 5, exact=True) for edge in band)


def large_signal(transducer: Transducer) -> tuple[ModeFigures, ...]:
    """Figures of all modes, with the hysteresis, if any, slipping."""
    return mode_figures(transducer, "slip")


def resonance_span(study: Study) -> Span:
    """Range around the driven mode, or the first; includes the design's band and a nearby drive frequency."""
    modes = large_signal(study.transducer)
    wanted = [f for f in (drive_frequency(study), *(design_band(study) or ())) if f is not None]
    at = float(np.sqrt(wanted[0] * wanted[-1])) if wanted else modes[0].short_circuit
    mode = min(modes, key=lambda m: abs(np.log(m.short_circuit / at)))
    half = _WIDTHS * max(mode.short_circuit / mode.quality, mode.open_circuit - mode.short_circuit)
    half = max(half, 0.02 * mode.short_circuit)
    low = max(mode.short_circuit - half, 0.4 * mode.short_circuit)
    high = min(mode.open_circuit + half, 2 * mode.open_circuit)
    near = [f for f in wanted if 0.4 * mode.short_circuit <= f <= 2.5 * mode.open_circuit]
    return Span(min([low, *(0.98 * f for f in near)]), max([high, *(1.02 * f for f in near)]), False)


def sweep_span(study: Study) -> Span:
    """Range for sweeping a sine: around the resonance or a drive that is far from it, with all of a design's band."""
    drive, around = drive_frequency(study), resonance_span(study)
    band = design_band(study)
    if band is not None and not around.low <= band[0] < band[1] <= around.high:  # it holds several modes
        low, high = min(around.low, 0.98 * band[0]), max(around.high, 1.02 * band[1])
        return Span(low, high, high > _WIDE * low)
    if drive is None or around.low <= drive <= around.high or band is not None:
        return around
    return Span(drive / _DECADE, drive * _DECADE, True)


def wide_span(transducer: Transducer) -> Span:
    """Range from the static line below the first mode to the mass line above the last."""
    modes = large_signal(transducer)
    return Span(modes[0].short_circuit / 5, 5 * modes[-1].open_circuit, True)


def dense(span: Span, transducer: Transducer, count: int = 400) -> np.ndarray:
    """Frequencies in Hz for a smooth curve through every resonance within a span."""
    found = [span.points(count)]
    for point in ("stick", "slip"):
        for resonance in resonances(transducer, operating_point=point):
            for natural, damping in zip(resonance.natural, resonance.damping_ratio, strict=True):
                reach = np.sinh(np.linspace(-5, 5, 60)) * natural * max(damping, 1e-6)
                found.append(natural + reach)
    merged = np.unique(np.concatenate(found))
    return merged[(merged >= span.low) & (merged <= span.high)]


def loads(subjects: Sequence[Subject], study: Study, count: int) -> np.ndarray:
    """Load resistances in ohm on a logarithmic grid that includes every tuned one and the capacitance's impedance."""
    frequency = drive_frequency(study) or large_signal(study.transducer)[0].short_circuit
    scale = 1 / (2 * np.pi * frequency * study.transducer.capacitance)
    tuned = [getattr(s.shunt, s.load_field) for s in subjects if s.load_field not in (None, "dc_voltage")]
    inside = [scale, *(value for value in tuned if scale / _MAX_LOAD_RATIO <= value <= scale * _MAX_LOAD_RATIO)]
    return np.geomspace(min(inside) / 20, max(inside) * 20, count)
