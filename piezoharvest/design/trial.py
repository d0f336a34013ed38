"""The one place where shunts are judged by nonlinear simulation."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.optimize import minimize_scalar

from piezoharvest.design.goal import Figures
from piezoharvest.design.operation import mean_nodes
from piezoharvest.design.twoport import LinearView
from piezoharvest.engine import simulate
from piezoharvest.engine.response import Response
from piezoharvest.linear import poles
from piezoharvest.shunts import LinearShunt, Shunt
from piezoharvest.shunts.open import Open
from piezoharvest.shunts.short import Short
from piezoharvest.system import System

_MEAN_ERROR = 1e-3  # of a mean over a band: below what parts are worth being told apart by
_TUNING_NODES, _FINAL_NODES = 41, 121  # at most
_FEWEST_POINTS = 9  # in search of the worst peak of what does not switch: the two-port tells where else to look
_TUNING_POINTS, _FINAL_POINTS = 17, 41  # of what does
_PEAK_STEPS = 8
_TUNING_SAMPLES = 16  # waveforms are not looked at while tuning; amplitudes do not depend on them


@dataclass
class Trial:
    """Simulates shunts in an operation and sums up what they do.

    Attributes
    ----------
    view : LinearView
        The transducer, its operation and the goal.
    simulations : int
        How many have been run.
    """

    view: LinearView
    simulations: int = 0
    _known: dict[tuple[Shunt, bool], Figures] = field(default_factory=dict)

    def merit(self, shunt: Shunt) -> float:
        """What every tuning on the engine makes small."""
        return self.view.goal.merit(self.figures(shunt))

    def figures(self, shunt: Shunt, *, complete: bool = False) -> Figures:
        """Figures of a shunt, kept for the next time; without `complete` only those that count for the goal."""
        key = (shunt, complete)
        if key not in self._known:
            judge = self._over_band if self.view.operation.band else self._alone
            self._known[key] = judge(shunt, complete)
        return self._known[key]

    def _simulate(self, shunt: Shunt, complete: bool, frequency: float | None = None) -> Response:
        self.simulations += 1
        operation = self.view.operation
        excitation = operation.excitation if frequency is None else operation.at(frequency)
        samples = {} if complete else {"samples": _TUNING_SAMPLES}
        return simulate(System(self.view.transducer, shunt), excitation, **samples)

    def _alone(self, shunt: Shunt, complete: bool) -> Figures:
        r = self._simulate(shunt, complete)
        return Figures(r.harvested_power, r.displacement_amplitude, r.voltage_amplitude, float(r.attenuation_db),
                       r.converged, r.message, r)  # fmt: skip

    def _over_band(self, shunt: Shunt, complete: bool) -> Figures:
        """Mean power at the nodes of a quadrature; displacement at its worst peak."""
        goal, power, found = self.view.goal, 0.0, {}
        if complete or not goal.damping or goal.options.min_power is not None:
            nodes, weights = self._nodes[complete]
            found = {float(f): self._simulate(shunt, complete, float(f)) for f in nodes}
            power = float(np.dot(weights, [r.harvested_power for r in found.values()]))
        if complete or goal.damping or goal.limits_levels:
            self._close_in(shunt, complete, found)
        responses = [found[f] for f in sorted(found)]
        worst = max(responses, key=lambda r: r.displacement_amplitude)
        attenuation = float("nan")
        if complete or goal.options.min_attenuation_db is not None:
            with np.errstate(all="ignore"):
                attenuation = 20 * float(np.log10(worst.displacement_amplitude / self._shorted))
        failed = [r for r in responses if not r.converged]
        told = next((r.message for r in (*failed, *responses) if r.message), "")
        voltage = max(r.voltage_amplitude for r in responses)
        return Figures(power, worst.displacement_amplitude, voltage, attenuation, not failed, told, worst)

    def _close_in(self, shunt: Shunt, complete: bool, found: dict[float, Response]) -> None:
        """Add simulations over the band, the last of them closing in on the peaks of what is asked for."""
        for frequency in self._points(shunt, complete, len(found)):
            if frequency not in found:
                found[frequency] = self._simulate(shunt, complete, frequency)
        if isinstance(shunt, LinearShunt) and self.view.amplitude is None:
            return  # the two-port's peaks are exact
        band = self.view.operation.band
        for name in ("displacement_amplitude", "voltage_amplitude")[: 2 if self.view.goal.options.max_voltage else 1]:

            def height(frequency: float, name: str = name) -> float:
                found[frequency] = self._simulate(shunt, complete, frequency)
                return -getattr(found[frequency], name)

            near = sorted({*found, *(band or ())})
            n = near.index(max(found, key=lambda f: getattr(found[f], name)))
            bounds = (near[max(n - 1, 0)], near[min(n + 1, len(near) - 1)])
            minimize_scalar(height, bounds=bounds, method="bounded", options={"maxiter": _PEAK_STEPS})

    def _points(self, shunt: Shunt, complete: bool, known: int) -> list[float]:
        """Frequencies (Hz) in search of the worst peak, beside those of the power if these are enough to see it."""
        low, high = self.view.operation.band or (0.0, 0.0)
        if isinstance(shunt, LinearShunt):
            return sorted({*map(float, np.linspace(low, high, _FEWEST_POINTS)), *map(float, self.view.grid(shunt))})
        if not complete and known >= _TUNING_POINTS:
            return []
        most = _FINAL_POINTS if complete else _TUNING_POINTS
        count = int(np.clip(2 * np.ceil((high - low) / self._width) + 1, _FEWEST_POINTS, most))
        return [float(f) for f in np.linspace(low, high, count)]

    @cached_property
    def _width(self) -> float:
        """Half-power width in Hz of the least damped resonance, shorted or open."""
        transducer = self.view.transducer
        found = np.concatenate([poles(System(transducer, shunt)) for shunt in (Short(), Open())])
        damping = float(np.min(-np.real(found[np.imag(found) > 0]), initial=np.inf))
        return max(damping / np.pi, 1e-6 * transducer.short_circuit_frequency)

    @property
    def unresolved(self) -> bool:
        """Whether resonances are sharper than the mean over the band is sure to see."""
        return self.view.operation.band is not None and len(self._nodes[True][0]) == _FINAL_NODES

    @cached_property
    def _nodes(self) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        """Nodes (Hz) and weights of the mean over the band, for tuning and for the final figures."""
        assert self.view.operation.band is not None
        most = (_TUNING_NODES, _FINAL_NODES)
        return tuple(mean_nodes(self.view.operation.band, self.view.transducer, _MEAN_ERROR, n) for n in most)

    @cached_property
    def _shorted(self) -> float:
        """Worst displacement over the band with shorted electrodes, m."""
        found: dict[float, Response] = {}
        self._close_in(Short(), False, found)
        return max(r.displacement_amplitude for r in found.values())
