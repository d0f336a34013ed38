"""The one place where shunts are judged by nonlinear simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.optimize import minimize_scalar

from piezoharvest.design.goal import Figures, Goal
from piezoharvest.design.operation import Operation, mean_nodes
from piezoharvest.engine import simulate
from piezoharvest.engine.response import Response
from piezoharvest.linear import poles
from piezoharvest.shunts import Open, Short, Shunt
from piezoharvest.system import System
from piezoharvest.transducer import Transducer

_MEAN_ERROR = 1e-3  # of a mean over a band: below what parts are worth being told apart by
_MOST_NODES = 41
_FEWEST, _MOST_POINTS = 9, 41  # of a search for the worst peak
_PEAK_STEPS = 8
_POINTS_PER_WIDTH = 2


@dataclass
class Trial:
    """Simulates shunts in an operation and sums up what they do.

    Attributes
    ----------
    transducer : Transducer
    operation : Operation
    goal : Goal
    simulations : int
        How many have been run.
    """

    transducer: Transducer
    operation: Operation
    goal: Goal
    simulations: int = 0
    _known: dict[Shunt, Figures] = field(default_factory=dict)

    def merit(self, shunt: Shunt) -> float:
        """What every tuning on the engine makes small."""
        return self.goal.merit(self.figures(shunt))

    def figures(self, shunt: Shunt) -> Figures:
        """Figures of a shunt, kept for the next time."""
        if shunt not in self._known:
            self._known[shunt] = self._over_band(shunt) if self.operation.band else self._alone(shunt)
        return self._known[shunt]

    def _simulate(self, shunt: Shunt, frequency: float | None = None) -> Response:
        self.simulations += 1
        excitation = self.operation.excitation if frequency is None else self.operation.at(frequency)
        return simulate(System(self.transducer, shunt), excitation)

    def _alone(self, shunt: Shunt) -> Figures:
        r = self._simulate(shunt)
        return Figures(r.harvested_power, r.displacement_amplitude, r.voltage_amplitude, r.attenuation_db, r.converged,
                       r.message, r)  # fmt: skip

    def _over_band(self, shunt: Shunt) -> Figures:
        """Mean power at the nodes of a quadrature; displacement at its worst peak where that counts."""
        power, responses = 0.0, []
        if self._power_counts:
            nodes, weights = self.nodes
            responses = [self._simulate(shunt, float(f)) for f in nodes]
            power = float(np.dot(weights, [r.harvested_power for r in responses]))
        if not self._power_counts or self.goal.limits_levels:
            responses += self._worst(shunt)
        worst = max(responses, key=lambda r: r.displacement_amplitude)
        if not self._power_counts:
            power = float(np.mean([r.harvested_power for r in responses[: len(self.points)]]))
        with np.errstate(all="ignore"):
            attenuation = 20 * float(np.log10(worst.displacement_amplitude / self.shorted))
        failed = [r for r in responses if not r.converged]
        told = next((r.message for r in (*failed, *responses) if r.message), "")
        return Figures(power, worst.displacement_amplitude, max(r.voltage_amplitude for r in responses), attenuation,
                       not failed, told, worst)  # fmt: skip

    @property
    def _power_counts(self) -> bool:
        return not self.goal.damping or self.goal.options.min_power is not None

    def _worst(self, shunt: Shunt) -> list[Response]:
        """Simulations over the band, the last ones closing in on the peak of the displacement."""
        points = self.points
        found = [self._simulate(shunt, float(f)) for f in points]
        n = int(np.argmax([r.displacement_amplitude for r in found]))

        def height(frequency: float) -> float:
            found.append(self._simulate(shunt, frequency))
            return -found[-1].displacement_amplitude

        bounds = (points[max(n - 1, 0)], points[min(n + 1, len(points) - 1)])
        minimize_scalar(height, bounds=bounds, method="bounded", options={"maxiter": _PEAK_STEPS})
        return found

    @cached_property
    def nodes(self) -> tuple[np.ndarray, np.ndarray]:
        """Nodes (Hz) and weights of the mean over the band."""
        assert self.operation.band is not None
        return mean_nodes(self.operation.band, self.transducer, _MEAN_ERROR, _MOST_NODES)

    @cached_property
    def points(self) -> np.ndarray:
        """Frequencies in Hz close enough to see every peak that the least damped pole can make, within reason."""
        low, high = self.operation.band or (0.0, 0.0)
        found = np.concatenate([poles(System(self.transducer, shunt)) for shunt in (Short(), Open())])
        width = np.min(-found[found.imag > 0].real, initial=np.inf) / np.pi
        count = _POINTS_PER_WIDTH * (high - low) / max(width, 1e-12 * high)
        return np.linspace(low, high, int(np.clip(np.ceil(count) + 1, _FEWEST, _MOST_POINTS)))

    @cached_property
    def shorted(self) -> float:
        """Worst displacement over the band with shorted electrodes, m."""
        return max(r.displacement_amplitude for r in self._worst(Short()))


def converged_all(responses: Sequence[Response]) -> bool:
    """Whether every simulation can be trusted."""
    return all(r.converged for r in responses)
