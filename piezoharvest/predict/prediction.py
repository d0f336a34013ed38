"""What a transducer is predicted to do in a record, with the derivatives to its parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from piezoharvest.predict.drive import FINE, divided, jumping
from piezoharvest.predict.lowered import MAGNIFIED, Lowered, Setting
from piezoharvest.predict.parameters import Parameter
from piezoharvest.predict.run import Pace, Run, pace_of, padded
from piezoharvest.predict.steps import Step, equilibrium
from piezoharvest.transducer import Transducer

BLOCK = 1 << 16  # samples at a time: a record of millions of samples is never in memory with its derivatives


class PredictionError(ArithmeticError):
    """The model cannot follow a record: the message says where."""


class Block(NamedTuple):
    """Part of a prediction.

    Attributes
    ----------
    begin : int
        First sample.
    values : (samples, channels) array
    derivatives : (samples, channels, parameters) array
        To what is varied of the parameters, then to the record's own, as in `Prediction.own_names`.
    """

    begin: int
    values: np.ndarray
    derivatives: np.ndarray


class Prediction:
    """A transducer in a setting.

    Parameters
    ----------
    transducer : Transducer
    setting : Setting
    parameters : sequence of Parameter
        What derivatives are wanted to.
    own : (n,) array, optional
        The record's own numbers, as `own_names` names them: by how much the states at the start are off equilibrium
        (SI units); the value of the drive before a record that begins abruptly; by how much every jump is off the
        middle of its step, as integral in the drive's unit times the time of a small step. `own_limits` are their
        largest sizes.
    """

    def __init__(
        self,
        transducer: Transducer,
        setting: Setting,
        parameters: Sequence[Parameter] = (),
        own: np.ndarray | None = None,
        lowered: Lowered | None = None,
    ) -> None:
        self.setting, self.transducer, self.parameters = setting, transducer, tuple(parameters)
        self._lowered = lowered = lowered or Lowered(transducer, setting, parameters)
        self.matrices = matrices = lowered.matrices
        self.share, self.step = lowered.share, lowered.step
        self.free = [matrices.states.index(name) for name in setting.free]
        before = ("drive before",) * setting.abrupt
        jumps = tuple(f"jump{j}" for j in setting.motion.jumps)
        self.own_names = (*(matrices.states[k] for k in self.free), *before, *jumps)
        self.own = np.zeros(len(self.own_names)) if own is None else own
        # A jump lies between its samples.
        far = 0.5 * FINE * np.abs(setting.motion.coefficients[setting.motion.jumps, 1])
        self.own_limits = np.concatenate([np.full(len(self.own_names) - len(far), np.inf), far])
        self.channels = matrices.channels
        # Mean slopes of the elements to their inputs, (elements, 2): those of relaxed operators that slip, until a
        # march tells.
        self.local = np.zeros((len(matrices.kinds), 2))

    @cached_property
    def slopes(self) -> Step:
        """Derivatives of the step to the parameters, then to the record's own numbers, by a complex step."""
        return self._slopes(self.step, self._lowered.tangent_steps(1))

    @np.errstate(over="ignore")  # as in `step_of`
    def _slopes(self, step: Step, found: Sequence[Step]) -> Step:
        count = len(self.own_names)
        return Step(*(
            np.stack([*(np.imag(getattr(varied, name)) / MAGNIFIED for varied in found),
                      *[np.zeros(getattr(step, name).shape)] * count], axis=-1)
            if found or count else np.zeros((*getattr(step, name).shape, 0))
            for name in Step._fields
        ))  # fmt: skip

    def _start(self, derivatives: bool) -> tuple[np.ndarray, np.ndarray]:
        """Scaled states at the start, and their derivatives."""
        states, inverse, scale = len(self.free), self._lowered.inverse, self.matrices.scale[self.free]
        first = self.own[states] if self.setting.abrupt else self.setting.first
        off = np.zeros(len(self.matrices.states))
        off[self.free] = self.own[:states] / scale
        z = equilibrium(self.matrices, inverse, first) + self.matrices.follow @ off
        if not derivatives:
            return z, np.zeros((len(z), 0))
        count = len(self.parameters)
        dz = np.zeros((len(z), count + len(self.own_names)))
        for k, tangent in enumerate(self._lowered.tangents):
            dz[:, k] = np.imag(equilibrium(tangent, inverse, first) + tangent.follow @ off) / MAGNIFIED
        dz[:, count : count + states] = self.matrices.follow[:, self.free] / scale
        if self.setting.abrupt:
            dz[:, count + states] = np.imag(equilibrium(self.matrices, inverse, first + 1j * MAGNIFIED)) / MAGNIFIED
        return z, dz

    def _pace(self, parts: int, derivatives: bool, rows: Sequence[int]) -> Pace:
        """Pace of steps that are a part of a sample's, with some rows of the outputs."""
        step = self._lowered.step_by(parts)
        if not derivatives:
            slopes = Step(*(np.zeros((*array.shape, 0)) for array in step))
        else:
            slopes = self.slopes if parts == 1 else self._slopes(step, self._lowered.tangent_steps(parts))
        step, slopes = (each._replace(O=each.O[rows]) for each in (step, slopes))
        return pace_of(self.setting.sample_time / parts, self.share / parts, step, slopes)

    def blocks(
        self, derivatives: bool = True, size: int = BLOCK, channels: Sequence[str] | None = None
    ) -> Iterator[Block]:
        """Predict, a block of samples at a time.

        Parameters
        ----------
        derivatives : bool
            Whether they are wanted, too.
        size : int
            Samples in a block.
        channels : sequence of str, optional
            Which; default all.

        Raises
        ------
        PredictionError
            The model's equations have no solution at a sample.
        """
        wanted = self.channels if channels is None else channels
        setting, outputs, inputs = self.setting, len(wanted), len(self.matrices.O) - len(self.channels)
        rows = [*range(inputs), *(inputs + self.channels.index(channel) for channel in wanted)]
        count = len(self.parameters) + len(self.own_names) if derivatives else 0
        z, dz = self._start(derivatives)
        run = Run(self.matrices, z, padded(dz))
        fine = setting.fine if len(self.matrices.kinds) else 1
        paces = {parts: self._pace(parts, derivatives, rows) for parts in {fine, *setting.parts.values()}}
        for begin, end in pairwise([0, *range(size - 1, setting.count - 1, size), setting.count - 1]):
            Y, dY = np.empty((end - begin + 1, outputs)), np.empty((end - begin + 1, outputs, run.lanes))
            inside = [step for step in setting.parts if begin <= step < end]
            for a, b in pairwise(sorted({begin, *inside, *(step + 1 for step in inside), end})):
                part = slice(a - begin, b - begin + 1)
                if a in setting.parts:
                    failed = self._small(run, paces[setting.parts[a]], a, Y[part], dY[part])
                else:
                    motion = divided(setting.motion.coefficients[a:b], fine)
                    failed = run.go(paces[fine], motion, a * self.share, a == 0, Y[part], dY[part], every=fine)
                if failed >= 0 or not np.all(np.isfinite(Y[part][1:])):
                    raise PredictionError(f"no solution at sample {a + max(failed, 0) // fine + 1}")
            first = 0 if begin == 0 else 1  # the sample before a block is not written again
            self.local = run.local / (end * fine)
            yield Block(begin + first, Y[first:], dY[first:, :, :count])

    def _small(self, run: Run, pace: Pace, begin: int, Y: np.ndarray, dY: np.ndarray) -> int:
        """March by small steps over one, within which the drive may jump; 0 if it failed, else -1."""
        motion, jump = self.setting.motion, (-1, -1)
        line = motion.coefficients[begin]
        if begin in motion.jumps:
            k = len(self.own_names) - len(motion.jumps) + int(np.searchsorted(motion.jumps, begin))
            coefficients, place = jumping(line, -self.own[k] / line[1])
            if run.lanes:
                jump = place, len(self.parameters) + k
        else:
            coefficients = divided(line[None], self.setting.parts[begin])
        count = len(coefficients) + 1
        fine, dfine = np.empty((count, Y.shape[1])), np.empty((count, *dY.shape[1:]))
        failed = run.go(pace, coefficients, begin * self.share, begin == 0, fine, dfine, jump=jump, small=True)
        first = 0 if begin == 0 else 1
        Y[first:], dY[first:] = fine[[0, -1]][first:], dfine[[0, -1]][first:]
        return min(failed, 0)
