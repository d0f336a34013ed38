"""A design anywhere in the box of a tolerance: its figures, their slopes along the axes, and many points at once."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from piezoharvest.description.shunts import Shunt
from piezoharvest.description.system import System
from piezoharvest.design.goal import SMALLEST_FIGURE, DesignFigures, Slopes
from piezoharvest.design.linear_view import Levels, LinearView
from piezoharvest.design.operation import mean_nodes, operation_of
from piezoharvest.design.robust.box import Box
from piezoharvest.design.trial import Trial
from piezoharvest.engine.work_limit import Budget
from piezoharvest.linear import frequency_response

_STEP = 1e-5  # of central differences, in half-widths: the error of a slope is 1e-10 of it
_STEP_SIMULATED = 1e-3  # the same by simulation, whose steady states are found to 1e-9 or so
_MOST, _MOST_SIMULATED, _SIMULATIONS = 256, 9, 2000  # points of a first look, and simulations that they may take
_MEAN_ERROR, _MOST_NODES = 1e-3, 41  # of simulated means over a band, as in tuning
_LEVEL_POINTS = 17  # frequencies over the band at which displacement and voltage are looked at in a batch
_AT_ONCE = 100_000  # systems of equations of a batch on the two-port, some 50 MB


@dataclass
class ToleranceSpace:
    """Points of a box about one design.

    Attributes
    ----------
    box : Box
    nominal : LinearView
        The study's transducer in its operation, with the reference of attenuations.
    shunt : Shunt
        The design.
    exact : bool
        True if the two-port is as good as the simulation, and is used.
    work : Budget
        Work that simulations may still take, shared by the spaces of all designs.
    """

    box: Box
    nominal: LinearView
    shunt: Shunt
    exact: bool
    work: Budget

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Smallest and largest coordinate on each axis."""
        return self.box.bounds

    @property
    def batched(self) -> bool:
        """True if many points are sampled at once."""
        return self.exact or self.nominal.operation.apart

    @property
    def most(self) -> int:
        """Points of a first look at the box."""
        return _MOST if self.exact else max(_MOST_SIMULATED, min(_MOST, _SIMULATIONS // self.cost))

    @property
    def _swept(self) -> bool:
        """True if all of a band is simulated: figures are those of a batch, in a tenth of the time that each takes."""
        return not self.exact and self.nominal.operation.band is not None

    def with_shunt(self, shunt: Shunt) -> ToleranceSpace:
        """The space of another design."""
        return replace(self, shunt=shunt)

    def view(self, point: np.ndarray) -> LinearView:
        """The transducer in its operation at a point."""
        nominal, box = self.nominal, self.box
        transducer = box.transducer(nominal.transducer, point)
        operation = nominal.operation
        if "frequency" in box.names or hasattr(operation.excitation, "psd"):
            # The lines of noise are dense where the resonances are.
            operation = operation_of(box.excitation(operation.excitation, point), operation.band, transducer)
        return replace(nominal, transducer=transducer, operation=operation)

    def shunt_at(self, point: np.ndarray, shunt: Shunt | None = None) -> Shunt:
        """The design, or another shunt, at a point."""
        return self.box.shunt(self.shunt if shunt is None else shunt, point, self.nominal.transducer.capacitance)

    def figures(self, point: np.ndarray) -> DesignFigures:
        """Figures at a point (d,)."""
        if self.exact:
            return self.view(point).figures(self.shunt_at(point))
        if self._swept:
            return self.many(self.shunt, point[None])[0]
        return self._simulated(point, complete=False)

    def expected(self, point: np.ndarray) -> DesignFigures:
        """Figures at a point as they are reported: under noise expectations, not those of the realisation searched."""
        noisy = not self.exact and hasattr(self.nominal.operation.excitation, "psd")
        return self._simulated(point, complete=True) if noisy else self.figures(point)

    def _simulated(self, point: np.ndarray, *, complete: bool) -> DesignFigures:
        trial = Trial(self.view(point), left=self.work.left)
        try:
            found = trial.figures(self.shunt_at(point), complete=complete)
        finally:
            self.work.left = trial.left
        return found._replace(attenuation_db=self._attenuation(found.displacement_amplitude))

    def tangent(self, point: np.ndarray) -> tuple[DesignFigures, Slopes]:
        """Figures at a point and the slopes (d,) of their logarithms along the axes."""
        if self.exact:
            return self._two_port_tangent(point)
        if self._swept:
            return self._swept_tangent(point)
        trial, nominal = Trial(self.view(point), left=self.work.left), self.nominal.transducer.capacitance
        try:
            return trial.along(
                self.shunt_at(point), lambda at: self.box.moves(at.quantities, at.values, self.shunt, point, nominal)
            )
        finally:
            self.work.left = trial.left

    def sampled(self, points: np.ndarray) -> list[DesignFigures]:
        """Figures at points (n, d); over a band peaks are as high as they are on a grid."""
        if not self.exact:
            return self.many(self.shunt, points)
        grid, found = self.nominal.survey(self.shunt), []
        step = max(_AT_ONCE // self.cost, 1)
        for first in range(0, len(points), step):
            found += self._peaks(self._levels(self.nominal, points[first : first + step], grid))
        return found

    def many(self, shunt: Shunt, points: np.ndarray) -> list[DesignFigures]:
        """Figures at points (n, d) by a batch of simulations; `shunt` may be a batch (n, 1) of designs.

        Over a band: mean power at the nodes of a quadrature, and levels on a grid.
        """
        frequencies, weights = self._judged()
        count = len(frequencies)
        rows = np.repeat(points, count, axis=0)
        shunt = self.shunt_at(rows, _repeated(shunt, count))
        base = np.tile(frequencies, len(points))
        drive = base * np.ravel(self.box.factors(rows)["frequency"])
        view = replace(self.nominal, transducer=self.box.transducer(self.nominal.transducer, rows))
        trial = Trial(view, left=self.work.left)
        try:
            columns = trial.many(shunt, drive)
        finally:
            self.work.left = trial.left
        names = ("harvested_power", "displacement_amplitude", "voltage_amplitude", "converged")
        power, displacement, voltage, converged = (columns[n].reshape(len(points), count) for n in names)
        each = zip(power @ weights, displacement.max(1), voltage.max(1), converged, strict=True)
        return [
            DesignFigures(float(p), float(x), float(v), self._attenuation(x), bool(np.all(c))) for p, x, v, c in each
        ]

    def _judged(self) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies in Hz and the weights of their powers in the mean; weight zero where levels are looked at."""
        operation, goal = self.nominal.operation, self.nominal.goal
        if operation.band is None:
            return operation.frequencies, np.ones(1)
        nodes, weights = mean_nodes(operation.band, self.nominal.transducer, _MEAN_ERROR, _MOST_NODES)
        if not (goal.damping or goal.limits_levels):
            return nodes, weights
        return np.append(nodes, np.linspace(*operation.band, _LEVEL_POINTS)), np.append(
            weights, np.zeros(_LEVEL_POINTS)
        )

    @property
    def cost(self) -> int:
        """Simulations, or frequencies on the two-port, that one point of a batch takes."""
        if self.exact:
            return len(self.nominal.operation.frequencies) + len(self.nominal.survey(self.shunt))
        return len(self._judged()[0]) if self.nominal.operation.apart else 1

    def _swept_tangent(self, point: np.ndarray) -> tuple[DesignFigures, Slopes]:
        """Figures and slopes by differences within one batch, which takes less time than gradients over a band do."""
        size = len(point)
        # Within the box, as an effect or a switch may not allow what is beyond.
        steps = np.clip(point + _STEP_SIMULATED * np.diag(self.box.widths), -self.box.widths, self.box.widths)
        back = np.clip(point - _STEP_SIMULATED * np.diag(self.box.widths), -self.box.widths, self.box.widths)
        found = self.many(self.shunt, np.concatenate((point[None], steps, back)))
        logs = [np.log(np.maximum([getattr(f, n) for f in found], SMALLEST_FIGURE)) for n in Slopes._fields]
        spans = np.diag(steps - back)
        return found[0], Slopes(*((x[1 : size + 1] - x[size + 1 :]) / spans for x in logs))

    def _two_port_tangent(self, point: np.ndarray) -> tuple[DesignFigures, Slopes]:
        view, count = self.view(point), len(point)
        steps = _STEP * np.diag(self.box.widths)
        points = point + np.concatenate((np.zeros((1, count)), steps, -steps))
        power, *levels = self._levels(view, points, view.grid(self.shunt_at(point)))
        heights = [power, *(x[:, np.argmax(x[0])] for x in levels)]
        logs = [np.log(np.maximum(x, SMALLEST_FIGURE)) for x in heights]
        slopes = Slopes(*((x[1 : count + 1] - x[count + 1 :]) / (2 * _STEP * self.box.widths) for x in logs))
        return self._peaks(Levels(power, *levels))[0], slopes

    def _levels(self, view: LinearView, points: np.ndarray, grid: np.ndarray) -> Levels:
        """Levels at points (n, d), of lines as they are in a view of one of them."""
        nominal, op = self.nominal, view.operation
        transducer, shunt = self.box.transducer(nominal.transducer, points), self.shunt_at(points)
        if "frequency" not in self.box.names:
            found = replace(view, transducer=transducer).levels(shunt, grid)
            return found._replace(power=np.broadcast_to(found.power, len(points)))  # one zero where nothing harvests
        frequencies = nominal.operation.frequencies * self.box.factors(points)["frequency"]
        system = System(transducer, shunt)
        found = frequency_response(system, frequencies, base=op.base, amplitude=view.amplitude)
        amplitudes = (op.amplitude * np.abs(x) for x in (found.displacement, found.voltage))
        power = np.broadcast_to(op.amplitude**2 * found.harvested_power, frequencies.shape)
        return Levels(power[:, 0], *amplitudes)

    def _peaks(self, levels: Levels) -> list[DesignFigures]:
        each = zip(levels.power, levels.displacement.max(-1), levels.voltage.max(-1), strict=True)
        return [DesignFigures(float(p), float(x), float(v), self._attenuation(x)) for p, x, v in each]

    def _attenuation(self, displacement: Any) -> float:
        """Attenuation in dB against the nominal transducer with shorted electrodes."""
        with np.errstate(all="ignore"):
            return 20 * float(np.log10(displacement / self.nominal.shorted))


def worst_of(figures: Iterable[DesignFigures]) -> DesignFigures:
    """The least power and the largest levels of several figures, which is what every limit is held against."""
    each: Sequence[DesignFigures] = list(figures)
    return DesignFigures(
        min(f.harvested_power for f in each), max(f.displacement_amplitude for f in each),
        max(f.voltage_amplitude for f in each), max(f.attenuation_db for f in each), all(f.converged for f in each),
        next((f.message for f in each if f.message), ""),
    )  # fmt: skip


def _repeated(shunt: Shunt, count: int) -> Shunt:
    """A batch (n, 1) of shunts, each several times; a single one as it is."""
    columns = {f.name: getattr(shunt, f.name) for f in dataclasses.fields(shunt)}
    batch = {n: np.repeat(x, count, axis=0) for n, x in columns.items() if isinstance(x, np.ndarray) and x.ndim == 2}
    return replace(shunt, **batch)
