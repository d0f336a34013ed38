"""Linear shunts on the exact two-port: figures and their slopes, exact peaks, and levels for the minimax tuning."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.description.shunts import Shunt
from piezoharvest.description.shunts.linear.resistor import Resistor
from piezoharvest.description.shunts.linear.short import Short
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.design.goal import SMALLEST_FIGURE, DesignFigures, Goal, Slopes
from piezoharvest.design.operation import Operation
from piezoharvest.design.places import value_at, with_values
from piezoharvest.linear import hysteresis_slope, poles
from piezoharvest.linear.assembly import LinearModel, assemble
from piezoharvest.linear.response import FrequencyResponse, response_of

_GRID_POINTS = 61  # points of a band, besides those at the poles
_ZOOMS, _ZOOM_POINTS = 7, 11  # a peak's frequency to 1e-5 of the grid's spacing, its height to the square of that
_AMPLITUDE_STEPS = 60
_BESIDE = 1e-12  # relative: moves a frequency off a pole by some thousand roundings
_STEP = 1e-5  # of central differences, in e-folds: the error of a slope is 1e-10


class Levels(NamedTuple):
    """Power (...) in W, displacement (..., g) in m and voltage (..., g) in V.

    Amplitudes on a grid of frequencies; for lines that act together, that of a sine with the same mean square.
    """

    power: np.ndarray
    displacement: np.ndarray
    voltage: np.ndarray


@dataclass(frozen=True, eq=False)
class LinearView:
    """A transducer in its operation, seen as a two-port.

    Attributes
    ----------
    transducer : Transducer
    operation : Operation
    goal : Goal
    amplitude : float or None
        Charge amplitude in C for the describing function of the hysteresis.
    reference : float or None
        Displacement in m that attenuation is counted from; default this transducer's with shorted electrodes.
    taken : tuple of int
        Numbers of the electrodes that have a shunt, 0 first; they are shorted for that.
    """

    transducer: Transducer
    operation: Operation
    goal: Goal
    amplitude: float | None = None
    reference: float | None = None
    taken: tuple[int, ...] = (0,)
    _last: dict[str, tuple[Shunt, LinearModel]] = field(default_factory=dict, init=False, repr=False)

    @property
    def short(self) -> Short:
        """Shorts of all electrodes that have a shunt."""
        return Short(others=tuple(Short(electrode=number) for number in self.taken[1:]))

    @property
    def capacitance(self) -> float:
        """Clamped capacitance in F at the electrodes: in series with that of the hysteresis at this amplitude."""
        slope = hysteresis_slope(self.transducer, amplitude=self.amplitude) if self.amplitude else 0.0
        return float(1 / (1 / self.transducer.capacitance + np.real(slope)))

    def response(self, shunt: Shunt, frequencies: Any) -> FrequencyResponse:
        """Response to a unit drive."""
        model, base = self._assembled(shunt), self.operation.base
        try:
            return response_of(model, frequencies, base=base)
        except np.linalg.LinAlgError:  # at a pole without damping: beside it the peak is as high as can be told
            return response_of(model, np.asarray(frequencies) * (1 + _BESIDE), base=base)

    def _assembled(self, shunt: Shunt) -> LinearModel:
        """Equations with a shunt, kept for its next frequencies: a peak is looked for at ten sets of them."""
        of, model = self._last.get("last", (None, None))
        if of is not shunt or model is None:
            slope = hysteresis_slope(self.transducer, amplitude=self.amplitude)
            model = assemble(self.transducer, shunt, slope=slope, base=self.operation.base)
            self._last["last"] = shunt, model  # at once: threads may share a view
        return model

    def levels(self, shunt: Shunt, grid: np.ndarray, *, power: bool = True) -> Levels:
        """Levels of a shunt, or of a batch of designs; `grid` in Hz is used where lines act one at a time.

        A mean power over a band takes hundreds of frequencies, its levels a few: without `power` it is not a number.
        """
        op = self.operation
        if op.apart and not power:
            found = self.response(shunt, grid)
            unknown = np.full(found.displacement.shape[:-1], np.nan)
            return Levels(unknown, *(op.amplitude * np.abs(x) for x in (found.displacement, found.voltage)))
        if op.apart:
            nodes = len(op.frequencies)
            found = self.response(shunt, np.concatenate((op.frequencies, grid)))
            mean = found.harvested_power[..., :nodes] @ op.squares
            return Levels(mean, *(op.amplitude * np.abs(x[..., nodes:]) for x in (found.displacement, found.voltage)))
        found = self.response(shunt, op.frequencies)
        both = (np.sqrt(np.abs(x) ** 2 @ op.squares)[..., None] for x in (found.displacement, found.voltage))
        return Levels(found.harvested_power @ op.squares, *both)

    def peaks(self, shunt: Shunt, of: Callable[[FrequencyResponse], np.ndarray]) -> np.ndarray:
        """Frequencies in Hz of all local maxima in the band, its edges included, found by repeated refinement."""
        band = self.operation.band
        if band is None:
            return self.operation.frequencies if self.operation.apart else np.empty(0)
        grid = self._first_grid(shunt, band)
        height = np.abs(of(self.response(shunt, grid)))
        padded = np.concatenate(([-np.inf], height, [-np.inf]))
        tops = np.flatnonzero((height >= padded[:-2]) & (height > padded[2:]))
        left, right = grid[np.maximum(tops - 1, 0)], grid[np.minimum(tops + 1, len(grid) - 1)]
        for _ in range(_ZOOMS):
            # All brackets together: each shrinks to the neighbours of its highest point.
            places = left[:, None] + (right - left)[:, None] * np.linspace(0, 1, _ZOOM_POINTS)
            heights = np.abs(of(self.response(shunt, places.ravel()))).reshape(places.shape)
            rows, n = np.arange(len(places)), np.argmax(heights, axis=1)
            left, right = places[rows, np.maximum(n - 1, 0)], places[rows, np.minimum(n + 1, _ZOOM_POINTS - 1)]
        return places[rows, n]

    def _first_grid(self, shunt: Shunt, band: tuple[float, float]) -> np.ndarray:
        return np.unique(np.concatenate((np.linspace(*band, _GRID_POINTS), self._near_poles(shunt, band))))

    def _near_poles(self, shunt: Shunt, band: tuple[float, float]) -> np.ndarray:
        """Frequencies around the poles, spaced by their damping."""
        found = poles(System(self.transducer, shunt))
        found = found[np.imag(found) > 0]
        spread = np.array([-2, -1, -0.5, 0, 0.5, 1, 2])
        places = (np.imag(found)[:, None] + np.real(found)[:, None] * spread).ravel() / (2 * np.pi)
        return places[(places > band[0]) & (places < band[1])]

    def grid(self, shunt: Shunt) -> np.ndarray:
        """Frequencies in Hz at which levels are largest: peaks of displacement, and of voltage where it is limited."""
        found = [self.peaks(shunt, lambda r: r.displacement)]
        if self.goal.options.max_voltage is not None and self.operation.band is not None:
            found.append(self.peaks(shunt, lambda r: r.voltage))
        return np.unique(np.concatenate(found))

    @property
    def shorted(self) -> float:
        """Displacement in m that attenuation is counted from: with shorted electrodes, the worst in a band."""
        return self._shorted if self.reference is None else self.reference

    @cached_property
    def _shorted(self) -> float:
        """Displacement in m with shorted electrodes; infinite where it is unbounded."""
        try:
            with np.errstate(all="ignore"):
                grid = self.peaks(self.short, lambda r: r.displacement)
                found = float(np.max(self.levels(self.short, grid, power=False).displacement))
        except np.linalg.LinAlgError:
            return float("inf")
        return found if np.isfinite(found) else float("inf")

    def merit(self, shunt: Shunt) -> float:
        """Merit of the figures."""
        return self.goal.merit(self.figures(shunt, power=self.goal.counts_power))

    def figures(self, shunt: Shunt, *, power: bool = True) -> DesignFigures:
        """Figures by the linear two-port, with exact peaks."""
        levels = self.levels(shunt, self.grid(shunt), power=power)
        return self._figures(levels.power, np.max(levels.displacement), np.max(levels.voltage))

    def _figures(self, power: Any, displacement: Any, voltage: Any) -> DesignFigures:
        with np.errstate(divide="ignore"):
            attenuation = 20 * float(np.log10(displacement / self.shorted))
        return DesignFigures(float(power), float(displacement), float(voltage), attenuation)

    def survey(self, shunt: Shunt) -> np.ndarray:
        """Frequencies in Hz at which shunts that resemble one are compared: all over the band, dense at its peaks."""
        band = self.operation.band
        if band is None or not (self.goal.damping or self.goal.limits_levels):
            return self.operation.frequencies[:1]
        return np.unique(np.concatenate((self._first_grid(shunt, band), self.grid(shunt))))

    def sampled(self, batch: Shunt, grid: np.ndarray) -> list[DesignFigures]:
        """Figures of each of a batch of designs, its peaks as high as they are at the frequencies of a grid (Hz)."""
        power, displacement, voltage = self.levels(batch, grid)
        return [self._figures(*each) for each in zip(power, displacement.max(-1), voltage.max(-1), strict=True)]

    def tangent(self, shunt: Shunt, parts: Sequence[str]) -> tuple[DesignFigures, Slopes]:
        """Figures of a shunt and their derivatives by the logarithms of its parts, where the peaks are.

        A peak's height changes as the response at its frequency does.
        """
        n = len(parts)
        steps = np.exp(_STEP * np.concatenate((np.zeros((1, n)), np.eye(n), -np.eye(n))))
        values = {name: value_at(shunt, name) * steps[:, k : k + 1] for k, name in enumerate(parts)}
        power, *levels = self.levels(with_values(shunt, values), self.grid(shunt))
        heights = [power, *(x[:, np.argmax(x[0])] for x in levels)]
        logs = [np.log(np.maximum(x, SMALLEST_FIGURE)) for x in heights]
        slopes = Slopes(*((x[1 : n + 1] - x[n + 1 :]) / (2 * _STEP) for x in logs))
        return self._figures(*(x[0] for x in heights)), slopes

    def working(self, shunt: Shunt | None = None) -> LinearView:
        """The view at the charge amplitude that the drive causes with a shunt: a damped fixed-point iteration.

        Without a shunt, the resistance equal to the capacitance's impedance is used. Without hysteresis: self.
        """
        if self.transducer.hysteresis is None:
            return self
        frequency = self.operation.centre(self.transducer)
        matched = Resistor(resistance=1 / (2 * np.pi * frequency * self.transducer.capacitance))
        load = matched if shunt is None else shunt
        view, lines = self, self.operation.frequencies
        for _ in range(_AMPLITUDE_STEPS):
            charge = np.abs(view.response(load, lines).charge)
            op = self.operation
            new = op.amplitude * np.max(charge) if op.apart else np.sqrt(charge**2 @ op.squares)
            old = view.amplitude or new
            view = replace(view, amplitude=float(np.sqrt(new * old)))
            if abs(new / old - 1) < 1e-4 and view.amplitude:
                break
        return view
