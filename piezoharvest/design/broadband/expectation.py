"""Expected power and displacement of any shunt under stationary noise.

Switched shunts are simulated over realisations of the noise, each with a linear shunt beside it whose expectation is
known exactly: what the realisation happens to have more or less of is then seen, and taken off.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from piezoharvest.description.excitation import Excitation
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import LinearShunt, Shunt
from piezoharvest.description.shunts.linear.resistor import Resistor
from piezoharvest.description.shunts.linear.series_rl import SeriesRL
from piezoharvest.description.system import System
from piezoharvest.design.broadband.estimate import MeanEstimate, controlled_mean
from piezoharvest.design.linear_view import LinearView
from piezoharvest.engine.batch_means import batch_edges
from piezoharvest.engine.windows import Windows, window_averages
from piezoharvest.engine.work_limit import Budget

WANTED_ERROR = 0.01  # relative standard error of the objective at which no further realisation is simulated
_MOST_REALISATIONS = 32
# Loads beside the switched shunt, over the impedance of the capacitance: a resistor that draws about the most, one that
# leaves the motion as long as with open electrodes, and a resonant shunt that shortens it as switches do.
_LOADS = (1.0, 3.0)
_COIL_LOAD = 0.3


class Expectation(NamedTuple):
    """Expected figures under stationary noise.

    Attributes
    ----------
    harvested_power : MeanEstimate
        W; without error for linear shunts.
    displacement_square : MeanEstimate
        m^2.
    """

    harvested_power: MeanEstimate
    displacement_square: MeanEstimate


@dataclasses.dataclass(frozen=True)
class NoiseExpectation:
    """Expectations of shunts in an operation under noise.

    Attributes
    ----------
    view : LinearView
        The two-port under the noise.
    """

    view: LinearView

    @property
    def exact(self) -> bool:
        """True if linear shunts have an exact expectation: there is nothing nonlinear beside the shunt."""
        t = self.view.transducer
        return t.hysteresis is None and not t.effects

    def of(self, shunt: Shunt, budget: Budget) -> Expectation:
        """Expectation of a shunt, exact for a linear one; the work of simulations is taken from the budget."""
        if self.exact and isinstance(shunt, LinearShunt):
            power, square = self._linear(shunt)
            return Expectation(MeanEstimate(power, 0.0), MeanEstimate(square, 0.0))
        return self.estimated(shunt, budget)

    def estimated(self, shunt: Shunt, budget: Budget, wanted: float = WANTED_ERROR) -> Expectation:
        """Expectation of any shunt by simulation, until the objective's error is as wanted or half the work is done.

        Raises
        ------
        ParameterError
            Not one realisation could be simulated.
        """
        length = float(self.view.operation.excitation.length or 0.0)
        edges = batch_edges(System(self.view.transducer, shunt), length)
        controls = self._controls() if self.exact else []
        expected = np.array([value for control in controls for value in self._linear(control)])
        rows: list[np.ndarray] = []
        found = None
        for k in range(_MOST_REALISATIONS):
            begin, excitation = budget.left, self._realisation(k)
            runs = [self._run(s, excitation, edges, budget) for s in (shunt, *controls)]
            if not all(run.complete for run in runs):
                break
            columns = [column for run in runs for column in run[:2]]
            rows.append(np.column_stack(columns))
            table = np.concatenate(rows)
            found = Expectation(*(controlled_mean(table[:, n], table[:, 2:], expected) for n in range(2)))
            power, square = found
            # What the goal is about, or the motion where nothing is harvested: its amplitude, a root, errs by half.
            moves = self.view.goal.damping or not power.value
            judged, most = (square, 2 * wanted) if moves else (power, wanted)
            if judged.standard_error <= most * abs(judged.value) or begin - budget.left > budget.left:
                break
        if found is None:
            raise ParameterError("excitation.duration", f"{shunt.kind} cannot be simulated over it")
        return found

    def _linear(self, shunt: Shunt) -> tuple[float, float]:
        """Power (W) and mean square displacement (m^2), by quadrature over the spectrum."""
        op = self.view.operation
        found = self.view.response(shunt, op.frequencies)
        square = 0.5 * np.abs(found.displacement) ** 2 @ op.squares
        return float(found.harvested_power @ op.squares), float(square)

    def _controls(self) -> list[Shunt]:
        omega = 2 * np.pi * self.view.operation.centre(self.view.transducer)
        impedance = 1 / (omega * self.view.transducer.capacitance)
        coil = SeriesRL(inductance=impedance / omega, resistance=_COIL_LOAD * impedance)
        return [coil, *(Resistor(resistance=ratio * impedance) for ratio in _LOADS)]

    def _realisation(self, number: int) -> Excitation:
        """The study's own realisation first, then others of the same noise."""
        excitation = self.view.operation.excitation
        seed: int = excitation.seed  # pyright: ignore[reportAttributeAccessIssue]
        return dataclasses.replace(excitation, seed=seed + number)

    def _run(self, shunt: Shunt, excitation: Excitation, edges: np.ndarray, budget: Budget) -> Windows:
        return window_averages(System(self.view.transducer, shunt), excitation, edges, budget)
