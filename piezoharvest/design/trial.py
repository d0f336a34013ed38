"""Evaluation of shunts by nonlinear simulation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from piezoharvest.description.excitation import Excitation
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import LinearShunt, Shunt
from piezoharvest.description.system import System
from piezoharvest.design.broadband.expectation import NoiseExpectation
from piezoharvest.design.drafts import ANGLES
from piezoharvest.design.goal import SMALLEST_FIGURE, DesignFigures, Slopes
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.operation import mean_nodes, narrowest_width
from piezoharvest.engine import Gradient, NoGradientError, gradient, simulate, simulate_many
from piezoharvest.engine.response import Response
from piezoharvest.engine.work_limit import MAX_WORK, Budget

_MEAN_ERROR = 1e-3  # of a mean over a band: below differences between parts that matter
_TUNING_NODES, _FINAL_NODES = 41, 121  # at most
_MIN_POINTS = 9  # in search of the worst peak of circuits without switches: the two-port gives further places
_TUNING_POINTS, _FINAL_POINTS = 17, 41  # of switched circuits
_PEAK_STEPS = 8
# Of all simulations of a design together, in units of `engine.work_limit`: about 10 s, twice the largest of designs/.
DESIGN_WORK = MAX_WORK * 5 // 4
_NOISE_SHARE = 0.08  # of that for the expectation of one candidate: most of twelve, with their tuning, are within it
# Two peaks of a tuned circuit are equally high: of those that differ by less than figures show, the first is shown, not
# the one that rounding makes the higher.
SAME_HEIGHT = 1e-4
_TUNING_SAMPLES = 16  # waveforms are not used while tuning; amplitudes do not depend on their number


Tangent = tuple[DesignFigures, Slopes]


@dataclass
class Trial:
    """Simulates shunts in an operation and summarises the results.

    Attributes
    ----------
    view : LinearView
        The transducer, its operation and the goal.
    simulations : int
        Number of steady states or transients computed, with or without a gradient.
    left : int
        Remaining work in the units of `engine.work_limit`.
    """

    view: LinearView
    simulations: int = 0
    left: int = DESIGN_WORK
    _known: dict[tuple[Shunt, bool], DesignFigures] = field(default_factory=dict)
    _tangents: dict[tuple, Tangent] = field(default_factory=dict)

    def merit(self, shunt: Shunt) -> float:
        """The merit that every tuning by simulation minimises."""
        return self.view.goal.merit(self.figures(shunt))

    def figures(self, shunt: Shunt, *, complete: bool = False) -> DesignFigures:
        """Figures of a shunt, cached; without `complete` only those that the goal needs."""
        key = (shunt, complete)
        if key not in self._known:
            judge = self._over_band if self.view.operation.band else self._alone
            self._known[key] = judge(shunt, complete)
        return self._known[key]

    def many(self, shunt: Shunt, frequencies: np.ndarray, *, thorough: bool = True) -> Mapping[str, np.ndarray]:
        """Results of `simulate_many` for shunts with columns of values, each with a sine of its own frequency, Hz."""
        count, operation = len(frequencies), self.view.operation
        self.simulations += count
        budget = Budget(self.left)
        sines = operation.at(frequencies[:, None])
        system = System(self.view.transducer, shunt)
        found = simulate_many(system, sines, count, attenuation=False, budget=budget, thorough=thorough)
        self.left = budget.left
        self._check_left()
        return found

    def tangent(self, shunt: Shunt, parts: tuple[str, ...], tied: Mapping[str, str] = MappingProxyType({})) -> Tangent:
        """Figures of a shunt and their derivatives by the logarithms of its parts (by angles themselves), cached.

        `tied` names fields that fall in proportion as a part rises.

        Raises
        ------
        NoGradientError
            There is no periodic steady state, the excitation is not a sine, or the worst peak of a band counts, which
            jumps between frequencies.
        """
        key = (shunt, parts, *tied)
        if key not in self._tangents:
            self._tangents[key] = self.along(shunt, lambda at: _steps(at, parts, tied))
        return self._tangents[key]

    def along(self, shunt: Shunt, moves: Callable[[Gradient], np.ndarray]) -> Tangent:
        """Figures of a shunt and their derivatives along given changes (p, q) of all q quantities of a gradient.

        Raises `NoGradientError` as `tangent` does.
        """
        op, goal = self.view.operation, self.view.goal
        if not op.apart or (op.band and (goal.damping or goal.limits_levels)):
            raise NoGradientError("only a sine, and the mean power over a band, are derived")
        nodes, weights = self._nodes[False] if op.band else (op.frequencies, np.ones(1))
        self.simulations += len(nodes)
        system = System(self.view.transducer, shunt)
        found = [self._gradient(system, op.at(float(f))) for f in nodes]
        return self._sum_up(found, weights, moves(found[0]))

    def _sum_up(self, found: list[Gradient], weights: np.ndarray, steps: np.ndarray) -> Tangent:
        """Mean power and largest amplitudes over sines one at a time, and their derivatives along `steps`."""
        levels, slopes = {}, {}
        for name in Slopes._fields:
            each = np.array([getattr(g, name) for g in found])
            share = weights if name == "harvested_power" else np.eye(len(found))[np.argmax(each)]
            levels[name] = float(share @ each)
            slopes[name] = steps @ (share @ [g.by[name] for g in found]) / max(levels[name], SMALLEST_FIGURE)
        attenuation = self._attenuation(levels["displacement_amplitude"], complete=False)
        return DesignFigures(**levels, attenuation_db=attenuation), Slopes(**slopes)

    def _attenuation(self, displacement: float, *, complete: bool) -> float:
        """Attenuation against the short circuit in dB, where it is asked for."""
        if not complete and self.view.goal.options.min_attenuation_db is None:
            return float("nan")
        with np.errstate(all="ignore"):
            return 20 * float(np.log10(displacement / self.shorted))

    def _simulate(self, shunt: Shunt, complete: bool, frequency: float | None = None) -> Response:
        self.simulations += 1
        operation = self.view.operation
        excitation = operation.excitation if frequency is None else operation.at(frequency)
        samples: dict[str, Any] = {} if complete else {"samples": _TUNING_SAMPLES}
        system, alone = System(self.view.transducer, shunt), operation.band is None
        with self._counted() as budget:
            # Over a band worst peaks are compared: the short circuit need not be simulated at each frequency.
            response = simulate(system, excitation, attenuation=alone, budget=budget, **samples)
        self._check_left()
        if response.exhausted:  # as many others would be
            raise self._impossible(response)
        return response

    def _check_left(self) -> None:
        """Raise `ParameterError` if no work is left."""
        if self.left <= 0:
            what = "this is more to simulate than a design may take"
            raise ParameterError("design", f"{what}, take fewer candidates, a narrower band or fewer tones")

    def _gradient(self, system: System, excitation: Excitation) -> Gradient:
        with self._counted() as budget:
            return gradient(system, excitation, budget)

    @contextmanager
    def _counted(self) -> Iterator[Budget]:
        """Work budget of one more simulation, deducted from that of the design."""
        budget = Budget(min(MAX_WORK, self.left))
        allowed = budget.left
        try:
            yield budget
        finally:
            self.left -= allowed - budget.left

    def _alone(self, shunt: Shunt, complete: bool) -> DesignFigures:
        r = self._simulate(shunt, complete)
        found = DesignFigures(r.harvested_power, r.displacement_amplitude, r.voltage_amplitude, float(r.attenuation_db),
                        r.converged, r.message, r)  # fmt: skip
        return self._expected(shunt, found) if complete and self._noise else found

    @property
    def _noise(self) -> bool:
        """True under stationary noise: expectations count, not what one realisation happens to be."""
        return hasattr(self.view.operation.excitation, "psd")

    def _expected(self, shunt: Shunt, found: DesignFigures) -> DesignFigures:
        """Figures of a realisation with the expectations under noise in their place, as far as there are any."""
        noise = NoiseExpectation(self.view)
        allowed = max(min(self.left, int(DESIGN_WORK * _NOISE_SHARE)), 0)
        budget = Budget(allowed)
        power, square = noise.of(shunt, budget)
        self.left -= allowed - budget.left
        found = found._replace(harvested_power=power.value, standard_error=power.standard_error)
        if not noise.exact:
            return found
        level = float(np.sqrt(2 * square.value))
        attenuation = 20 * float(np.log10(level / self.shorted))
        return found._replace(displacement_amplitude=level, attenuation_db=attenuation)

    def _over_band(self, shunt: Shunt, complete: bool) -> DesignFigures:
        """Mean power at the nodes of a quadrature; displacement at its worst peak."""
        goal, power, found = self.view.goal, 0.0, {}
        if complete or not goal.damping or goal.options.min_power is not None:
            nodes, weights = self._nodes[complete]
            found = {float(f): self._simulate(shunt, complete, float(f)) for f in nodes}
            power = float(np.dot(weights, [r.harvested_power for r in found.values()]))
        if complete or goal.damping or goal.limits_levels:
            self._close_in(shunt, complete, found)
        responses = [found[f] for f in sorted(found)]
        highest = max(r.displacement_amplitude for r in responses)
        worst = next(r for r in responses if r.displacement_amplitude >= (1.0 - SAME_HEIGHT) * highest)
        attenuation = self._attenuation(highest, complete=complete)
        failed = [r for r in responses if not r.converged]
        told = next((r.message for r in (*failed, *responses) if r.message), "")
        voltage = max(r.voltage_amplitude for r in responses)
        return DesignFigures(power, highest, voltage, attenuation, not failed, told, worst)

    def _close_in(self, shunt: Shunt, complete: bool, found: dict[float, Response]) -> None:
        """Add simulations over the band that converge on the peaks of the goal's quantities."""
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
        """Frequencies (Hz) at which the worst peak is sought, besides those of the power if these are too few."""
        low, high = self.view.operation.band or (0.0, 0.0)
        if isinstance(shunt, LinearShunt):
            return sorted({*map(float, np.linspace(low, high, _MIN_POINTS)), *map(float, self.view.grid(shunt))})
        if not complete and known >= _TUNING_POINTS:
            return []
        most = _FINAL_POINTS if complete else _TUNING_POINTS
        wanted = 2 * np.ceil((high - low) / narrowest_width(self.view.transducer)) + 1
        count = int(np.clip(wanted, _MIN_POINTS, most))
        return [float(f) for f in np.linspace(low, high, count)]

    @property
    def nodes(self) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies (n,) in Hz and weights (n,) of the mean over the band; without a band the one frequency."""
        op = self.view.operation
        return self._nodes[True] if op.band is not None else (op.frequencies, np.ones(1))

    @property
    def unresolved(self) -> bool:
        """True if resonances may be sharper than the mean over the band resolves."""
        return self.view.operation.band is not None and len(self._nodes[True][0]) == _FINAL_NODES

    @cached_property
    def _nodes(self) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        """Nodes (Hz) and weights of the mean over the band, for tuning and for the final figures."""
        assert self.view.operation.band is not None
        most = (_TUNING_NODES, _FINAL_NODES)
        return tuple(mean_nodes(self.view.operation.band, self.view.transducer, _MEAN_ERROR, n) for n in most)

    @cached_property
    def shorted(self) -> float:
        """Displacement with shorted electrodes, over a band the worst, m.

        Raises
        ------
        ParameterError
            The transducer cannot be simulated under this excitation.
        """
        if self.view.reference is not None:
            return self.view.reference
        found: dict[float, Response] = {}
        if self.view.operation.band is None:
            found[0.0] = self._simulate(self.view.short, False)
        else:
            self._close_in(self.view.short, False, found)
        worst = max(found.values(), key=lambda response: response.displacement_amplitude)
        if not worst.displacement_amplitude > 0:
            raise self._impossible(worst)
        exact = self._noise and NoiseExpectation(self.view).exact
        return self.view.shorted if exact else worst.displacement_amplitude

    @staticmethod
    def _impossible(response: Response) -> ParameterError:
        found = f"cannot be simulated with {response.shunt}: {response.message or 'nothing moves'}"
        return ParameterError("excitation", found)


def _steps(at: Gradient, parts: tuple[str, ...], tied: Mapping[str, str]) -> np.ndarray:
    """Changes (p, q) of all q quantities of a gradient with each coordinate of the tuning."""
    steps = np.zeros((len(parts), len(at.quantities)))
    for row, name in zip(steps, parts, strict=True):
        place = at.quantities.index(f"shunt.{name}")
        row[place] = 1.0 if name in ANGLES else at.values[place]
        if name in tied:
            place = at.quantities.index(f"shunt.{tied[name]}")
            row[place] = -at.values[place]
    return steps
