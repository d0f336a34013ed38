"""What the runs of one system through sampled signals have in common, computed once for all of them."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from piezoharvest.description.excitation import Excitation
from piezoharvest.engine.lowering.lower import Lowered
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.run import Machine
from piezoharvest.engine.sensitivity.dual_modes import dual
from piezoharvest.engine.transient.along_tape import Switching
from piezoharvest.engine.transient.forcing import moving
from piezoharvest.engine.transient.mode_steps import ModeArrays, ModeSteps, mode_steps
from piezoharvest.engine.work_limit import Budget


class SampledSystem:
    """A system that was lowered from complex steps, and tables of it; runs in several threads may use them.

    Parameters
    ----------
    lowered : Lowered
        From complex steps of the quantities, or without these.
    count : int
        Number of quantities.
    """

    def __init__(self, lowered: Lowered, count: int) -> None:
        self.lowered, self.count = lowered, count
        self.plain = lowered._replace(program=moving(lowered.program))
        self._machine = Machine(self.plain)
        self._modes: dict[tuple, ModeArrays] = {}
        self._steps: dict[tuple, ModeSteps] = {}

    @property
    def is_linear(self) -> bool:
        """True without smooth elements, so that its equilibrium is proportional to the static part of a signal."""
        return not len(self.lowered.program.element_power)

    @property
    def is_bent(self) -> bool:
        """True if the nominal motion between events is not linear, so that derivatives along it are not known."""
        return len(self.plain.program.element_power) > 0

    def under(self, excitation: Excitation) -> SampledSystem:
        """The system under samples of another signal, without smooth elements, from that under a unit at rest."""
        found, signal, rest = copy.copy(self), excitation.signal(), excitation.rest
        found.lowered, found.plain = (
            each._replace(
                program=each.program._replace(equilibrium=rest * each.program.equilibrium), signal=signal, budget=budget
            )
            for budget in (Budget(),)
            for each in (self.lowered, self.plain)
        )
        return found

    def machine(self, *, timed: bool = False) -> Machine:
        """Machine of the nominal system; where the switch is timed no extremum lets it act."""
        found = self._machine.copied(self.plain)
        at = found.L[pg.EQUILIBRIUM]
        found.P[at : at + found.L[pg.N]] = self.plain.program.equilibrium
        if timed:
            found.P[found.L[pg.THRESHOLD]] = np.inf
        return found

    def steps(self, modes: Sequence[tuple[int, np.ndarray]], h: float, rows: Sequence[int]) -> ModeSteps:
        """Tables of modes, as `mode_steps`."""
        keys = tuple((configuration, slip.tobytes(), h, tuple(rows)) for configuration, slip in modes)
        if keys not in self._steps:
            program = self.lowered.program
            for key, each in zip(keys, modes, strict=True):
                if key not in self._modes:
                    self._modes[key] = ModeArrays(program, self.count, *each, h, rows)
            self._steps[keys] = mode_steps(program, self.count, [self._modes[key] for key in keys])
        return self._steps[keys]

    @cached_property
    def switching(self) -> Switching:
        """Tables of the events."""
        program, count = self.lowered.program, self.count

        def change(value: np.ndarray | float, rank: int) -> np.ndarray:
            """Derivatives with respect to the quantities, these as last axis."""
            found = dual(np.asarray(value), rank).change
            # A copy: of what only may be read, and of what may be written, code would be compiled twice.
            return np.moveaxis(np.broadcast_to(found, (count, *found.shape[1:])), 0, -1).copy()

        stops = np.asarray(program.stop_state, np.int64)
        times = np.asarray(program.on_time)[..., None] * program.stage
        return Switching(
            program.rate.shape[-2], program.guard_target.shape[1], int(program.switched), int(program.charge),
            float(dual(np.asarray(program.lag), 0).value), 0, np.asarray(program.opened, np.int64),
            np.asarray(program.guard_cut, np.int64), np.asarray(program.cut, np.int64), stops,
            np.ascontiguousarray(dual(program.voltage_row, 1).value), change(program.lag, 0), change(times, 1),
            change(program.voltage_row, 1), change(program.stop_limit, 1),
        )  # fmt: skip
