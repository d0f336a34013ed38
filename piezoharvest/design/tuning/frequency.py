"""Search for the frequency of the drive, where it is free, at which a candidate tuned for it harvests most.

Power over the frequency has several maxima, even with the load tuned at each: near the short- and the open-circuit
resonance of every mode, where its coupling is strong (for a resistor: Kong, Ha, Erturk & Inman, J. Intell. Mater. Syst.
Struct. 21(13), 1293-1302, 2010). So the search looks all over the band, closer at the resonances, and goes on from its
best local maxima: on the two-port by a bounded search of the tuned value, by simulation with the frequency as one more
coordinate of the stencils that tune load and lag.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import minimize_scalar

from piezoharvest.description.shunts import LinearShunt
from piezoharvest.description.shunts.bridge import Bridge
from piezoharvest.design.drafts import Draft, any_harvests
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.operation import operation_of, widening_grid
from piezoharvest.design.trial import DESIGN_WORK, Trial
from piezoharvest.design.tuning.bridges import bridge_starts
from piezoharvest.design.tuning.joint import joint_starts
from piezoharvest.design.tuning.minimax import tune
from piezoharvest.design.tuning.phase import coarse_points, coarse_steps, merits_of, phase_start, simulated, zoom
from piezoharvest.design.tuning.region import Region
from piezoharvest.design.tuning.starts import Host

# Of the simulations of one candidate's search, in units of `engine.work_limit`: about 20 s. Most take a tenth of it;
# strong inversion and strong coupling together took 1.15 times what a design may take otherwise.
SEARCH_WORK = 2 * DESIGN_WORK
_MOST_MAXIMA = 4  # that are followed: two resonances of two modes
_ACCURACY = 1e-3  # of the grid's spacing, which is a share of a resonance's width: the power is then flat to 1e-6
_SAME = 1e-6  # of the merit: frequencies at which it is no worse are as good; the one nearest to the resonance is taken
_LOADS = np.array([1 / 3, 1.0, 3.0])  # factors of the closed form's load, which is right for a switch without lag
_MOST_PARTS = 3  # of a circuit whose parts and frequency are tuned by stencils: 81 simulations each


@dataclass(frozen=True, eq=False)
class FrequencySearch:
    """Search in a band.

    Attributes
    ----------
    trial : Trial
        Simulates sines; its view has the transducer and the goal.
    band : (float, float)
        Hz.
    """

    trial: Trial
    band: tuple[float, float]

    @cached_property
    def grid(self) -> np.ndarray:
        """Frequencies (n,) in Hz that are looked at first."""
        return widening_grid(self.band, self.trial.view.transducer)

    def view_at(self, frequency: float) -> LinearView:
        """The two-port at one frequency (Hz), with hysteresis at the amplitude of a matched load."""
        view = self.trial.view
        operation = operation_of(view.operation.at(frequency), None, view.transducer)
        return replace(view, operation=operation, amplitude=None).working()

    def best(self, draft: Draft) -> float:
        """The frequency in Hz at which a draft harvests most, with its free fields tuned.

        The resonance in the middle for one that harvests nothing at any.
        """
        if not any_harvests(draft.shunt, self.trial.view.transducer, 1 / self._centre):
            return self._centre
        if not isinstance(draft.shunt, LinearShunt):
            points, merits = self._coarse(draft)
            tops = self._maxima(np.min(merits, axis=1))
            return self._zoomed(draft, points[tops, np.argmin(merits[tops], axis=1)], tops)
        position = self._on_two_port(draft)
        view = self.view_at(self._frequency(position))
        if view.amplitude is None or len(draft.free) > _MOST_PARTS:
            return self._frequency(position)
        return self._zoomed(draft, self._tuned(draft, position)[1][None], np.array([position]))

    @property
    def _centre(self) -> float:
        return self.trial.view.operation.centre(self.trial.view.transducer)

    @cached_property
    def _track(self) -> PchipInterpolator:
        return PchipInterpolator(np.arange(len(self.grid)), self.grid)

    def _frequency(self, position: float) -> float:
        """Frequency in Hz from a position along the grid, in which maxima are about as wide everywhere."""
        return float(np.clip(self._track(position), *self.band))

    def _on_two_port(self, draft: Draft) -> float:
        """Position of the best frequency of a linear draft on the two-port."""

        def merit(position: float) -> float:
            return self._tuned(draft, position)[0]

        last = len(self.grid) - 1
        found = {float(n): merit(n) for n in range(last + 1)}
        for n in self._maxima(np.array(list(found.values()))):
            bounds = (max(n - 1, 0), min(n + 1, last))
            top: Any = minimize_scalar(merit, bounds=bounds, method="bounded", options={"xatol": _ACCURACY})
            found[float(top.x)] = float(top.fun)
        least = min(found.values())
        as_good = [position for position, value in found.items() if value <= least + _SAME]
        return min(as_good, key=lambda position: abs(self._frequency(position) - self._centre))

    def _tuned(self, draft: Draft, position: float) -> tuple[float, np.ndarray]:
        """Merit of a linear draft tuned on the two-port for one frequency, and the logarithms of its parts."""
        view = self.view_at(self._frequency(position))
        if not draft.free:
            return view.merit(draft.shunt), np.empty(0)
        host = Host.of(view)
        region = Region.of(draft, host, view.goal.options.max_inductance)
        first = min(
            joint_starts(view, draft, host),
            key=lambda start: view.merit(draft.with_values(start.values)),
        )
        tuned = tune(view, draft, first, region)
        return tuned.merit, region.logs(draft.values_of(tuned.shunt))

    def _coarse(self, draft: Draft) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates (n, k, d) of k points about the closed form at each frequency of the grid, and merits (n, k)."""
        loaded = isinstance(draft.shunt, Bridge) and {"load_resistance", "dc_voltage"} & set(draft.free)
        points = np.array([
            coarse_points(draft, phase_start(draft, bridge_starts(self.view_at(f), draft) if loaded else []), _LOADS)
            for f in self.grid
        ])  # fmt: skip
        count = points.shape[1]
        # Where a steady state is hard to find is seldom the best place, and there are others near it.
        flat, each = points.reshape(-1, points.shape[2]), np.repeat(self.grid, count)
        merits = self._merits(draft, flat, each, thorough=False)
        return points, merits.reshape(-1, count)

    def _merits(
        self, draft: Draft, points: np.ndarray, frequencies: np.ndarray, *, thorough: bool = True
    ) -> np.ndarray:
        """Merits (n,) of points (n, d), each at its frequency, by simulation."""
        values = simulated(self.trial, draft, points, frequencies[:, None], thorough=thorough)[:, 0]
        return merits_of(self.trial.view.goal, values, self._shorted(frequencies))

    def _shorted(self, frequencies: np.ndarray) -> np.ndarray:
        """Displacement (n,) in m with shorted electrodes at each frequency, where a limit refers to it."""
        if self.trial.view.goal.options.min_attenuation_db is None:
            return np.ones(len(frequencies))
        return np.array([self.view_at(f).shorted for f in frequencies])

    @staticmethod
    def _maxima(merits: np.ndarray) -> np.ndarray:
        """Places of the best local maxima of the goal along the grid."""
        padded = np.concatenate(([np.inf], merits, [np.inf]))
        found = np.flatnonzero((merits <= padded[:-2]) & (merits < padded[2:]))
        return found[np.argsort(merits[found])][:_MOST_MAXIMA]

    def _zoomed(self, draft: Draft, points: np.ndarray, positions: np.ndarray) -> float:
        """The best frequency near points (g, d) at positions (g,) along the grid, by simulation."""
        host = Host.of(self.view_at(self._frequency(float(positions[0]))))
        own = Region.of(draft, host, self.trial.view.goal.options.max_inductance)
        lower, upper = np.append(own.lower, 0.0), np.append(own.upper, len(self.grid) - 1.0)
        region = Region((*own.names, "position"), lower, upper, np.pad(own.coil, ((0, 0), (0, 1))), own.offset)

        def merits(p: np.ndarray, _: np.ndarray) -> np.ndarray:
            return self._merits(draft, p[:, :-1], np.clip(self._track(p[:, -1]), *self.band))

        widths = np.append(coarse_steps(draft), 1.0) / 2
        found, least = zoom(merits, np.column_stack((points, positions)).astype(float), widths, region)
        return self._frequency(float(found[np.argmin(least), -1]))
