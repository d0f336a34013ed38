"""What a transducer is predicted to do in a record, with the derivatives to its parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from piezoharvest.predict.drive import BUMP, Drive, drive_of
from piezoharvest.predict.parameters import STEP, Parameter, stepped, value_at
from piezoharvest.predict.specimen import Matrices, Specimen
from piezoharvest.predict.steps import Step, equilibrium, inverse_of, step_of
from piezoharvest.shunts import Shunt
from piezoharvest.transducer import Transducer

# Steps of components are too small for what comes after their equations: squares of imaginary parts would underflow,
# which is slow.
MAGNIFIED = 1e-30
BLOCK = 1 << 16  # samples at a time: a record of millions of samples is never in memory with its derivatives
LANES = 8  # derivatives are padded to full vector registers
SLOW = 2.0  # samples: a state that lasts longer than this has a start of its own,
LASTS = 0.05  # which means that so much of it is left


class PredictionError(ArithmeticError):
    """The model cannot follow a record: the message says where."""


@dataclass(frozen=True, eq=False)
class Setting:
    """What a prediction needs of a record.

    Attributes
    ----------
    drive : str
        The imposed channel.
    shunt : Shunt or None
    sample_time, first : float
        s; first value of the drive.
    motion : Drive
    count : int
        Samples.
    free : tuple of str
        States whose start is free.
    """

    drive: str
    shunt: Shunt | None
    sample_time: float
    first: float
    motion: Drive
    count: int
    free: tuple[str, ...] = ()


def setting_of(
    drive: str, shunt: Shunt | None, sample_time: float, values: np.ndarray, transducer: Transducer | None = None
) -> Setting:
    """Setting from the samples of the drive; with a transducer, states that outlast a few samples have free starts.

    What effects add begins at rest: a preload has acted long before the record.
    """
    setting = Setting(drive, shunt, sample_time, float(values[0]), drive_of(values), len(values))
    if transducer is None:
        return setting
    bare = Prediction(replace(transducer, effects=()), setting)
    M, n = bare.step.M, len(bare.step.M)
    kept = np.abs(np.linalg.matrix_power(M[:, :n], int(SLOW))).max(axis=0)
    return replace(setting, free=tuple(name for name, k in zip(bare.matrices.states, kept, strict=True) if k > LASTS))


class Block(NamedTuple):
    """Part of a prediction.

    Attributes
    ----------
    begin : int
        First sample.
    values : (samples, channels) array
    derivatives : (samples, channels, parameters) array
        To what is varied of the parameters, then to the record's own: states at the start, then jumps.
    """

    begin: int
    values: np.ndarray
    derivatives: np.ndarray


class Lowered:
    """A transducer's equations for all records that differ in their drive alone.

    Parameters
    ----------
    transducer : Transducer
    setting : Setting
        One of the records.
    parameters : sequence of Parameter
        What derivatives are wanted to.
    """

    def __init__(self, transducer: Transducer, setting: Setting, parameters: Sequence[Parameter]) -> None:
        self.transducer, self.setting, self.parameters = transducer, setting, tuple(parameters)
        self.matrices = self._matrices(transducer)
        self.share = 1.0 / max(setting.count - 1, 1)
        self.step = step_of(self.matrices, setting.sample_time, self.share)
        self.inverse = inverse_of(self.matrices)

    @staticmethod
    def key(setting: Setting) -> tuple:
        """What the records have to have in common."""
        return setting.shunt, setting.drive, setting.sample_time, setting.count

    def _matrices(self, transducer: Transducer) -> Matrices:
        setting = self.setting
        return Specimen(transducer, setting.shunt, setting.drive, setting.sample_time).matrices()

    @cached_property
    def tangents(self) -> list[Matrices]:
        """Equations with a complex step in each parameter."""
        found = []
        for parameter in self.parameters:
            inner = parameter.inner(value_at(self.transducer, parameter.path))
            found.append(_magnified(self._matrices(stepped(self.transducer, parameter, inner))))
        return found

    @cached_property
    def steps(self) -> list[Step]:
        """Steps with a complex step in each parameter."""
        return [step_of(tangent, self.setting.sample_time, self.share) for tangent in self.tangents]


class Prediction:
    """A transducer in a setting.

    Parameters
    ----------
    transducer : Transducer
    setting : Setting
    parameters : sequence of Parameter
        What derivatives are wanted to.
    starts : mapping of str to float, optional
        What the states at the start are off equilibrium, in SI units, by name.
    shifts : (jumps,) array, optional
        By how much of the drive's unit the mean over each step with a jump is off the straight line.
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
        jumps = tuple(f"jump{j}" for j in setting.motion.jumps)
        self.free = [matrices.states.index(name) for name in setting.free]
        self.own_names = tuple(matrices.states[k] for k in self.free) + jumps
        self.own = np.zeros(len(self.own_names)) if own is None else own
        self.channels = matrices.channels
        # Mean slopes of the elements to their inputs, (elements, 2): those of relaxed operators that slip, until a
        # march tells.
        self.local = np.zeros((len(matrices.kinds), 2))

    @cached_property
    @np.errstate(over="ignore")  # as in `step_of`
    def slopes(self) -> Step:
        """Derivatives of the step to the parameters, then to the record's own numbers, by a complex step."""
        found, count = self._lowered.steps, len(self.own_names)
        return Step(*(
            np.stack([*(np.imag(getattr(step, name)) / MAGNIFIED for step in found),
                      *[np.zeros(getattr(self.step, name).shape)] * count], axis=-1)
            if found or count else np.zeros((*getattr(self.step, name).shape, 0))
            for name in Step._fields
        ))  # fmt: skip

    def _start(self, derivatives: bool) -> tuple[np.ndarray, np.ndarray]:
        """Scaled states at the start, and their derivatives."""
        first, scale = self.setting.first, self.matrices.scale[self.free]
        z = equilibrium(self.matrices, self._lowered.inverse, first)
        z[self.free] += self.own[: len(self.free)] / scale
        if not derivatives:
            return z, np.zeros((len(z), 0))
        count = len(self.parameters)
        dz = np.zeros((len(z), count + len(self.own_names)))
        for k, tangent in enumerate(self._lowered.tangents):
            dz[:, k] = np.imag(equilibrium(tangent, self._lowered.inverse, first)) / MAGNIFIED
        dz[self.free, count + np.arange(len(self.free))] = 1.0 / scale
        return z, dz

    def blocks(self, derivatives: bool = True, size: int = BLOCK) -> Iterator[Block]:
        """Predict, a block of samples at a time.

        Raises
        ------
        PredictionError
            The model's equations have no solution at a sample.
        """
        from piezoharvest.predict.march import march

        matrices, step, setting = self.matrices, self.step, self.setting
        nw, count = len(matrices.kinds), len(self.parameters) + len(self.own_names)
        slopes = self.slopes if derivatives else None
        if slopes is None:
            count = 0
            slopes = Step(*(np.zeros((*array.shape, 0)) for array in step))
        m = len(step.O) - len(matrices.channels)
        P = -(-count // LANES) * LANES
        z, dz = self._start(derivatives)
        dz, dlimits = (np.pad(array, ((0, 0), (0, P - count))) for array in (dz, slopes.limits))
        states, local, sizes = len(self.free), np.zeros((nw, 2)), np.zeros(m)
        w, inputs, dw, dinputs = np.zeros(nw), np.zeros(m), np.zeros((nw, P)), np.zeros((m, P))
        jumps = setting.motion.jumps
        arrays = [np.ascontiguousarray(a) for a in (step.M, step.H, step.O)]
        limits = np.ascontiguousarray(np.real(matrices.parameters))
        moving = [np.any(array, axis=(0, 1)) for array in (slopes.M, slopes.H, slopes.O)]
        some = int(np.max(np.flatnonzero(np.any(moving, axis=0)), initial=-1)) + 1
        tangents = [_by_columns(array[:, :, :some]) for array in (slopes.M, slopes.H, slopes.O)]
        for begin, end in pairwise([0, *range(size - 1, setting.count - 1, size), setting.count - 1]):
            Y, dY = (
                np.empty((end - begin + 1, len(matrices.channels))),
                np.empty((end - begin + 1, len(matrices.channels), P)),
            )
            inside = np.flatnonzero((jumps >= begin) & (jumps < end))
            # A copy of the block alone: that of a long record would take as much memory as its channels.
            coefficients = setting.motion.coefficients[begin:end].copy()
            coefficients[jumps[inside] - begin] += self.own[states + inside, None] * BUMP
            inside = inside if P else inside[:0]
            bumps = np.column_stack([jumps[inside] - begin, len(self.parameters) + states + inside]).astype(np.int64)
            failed = march(
                coefficients, bumps, begin * self.share, self.share, begin == 0, setting.sample_time,
                arrays[0], arrays[1], arrays[2], limits, matrices.kinds, matrices.places,
                tangents[0], tangents[1], tangents[2], dlimits,
                z, w, inputs, dz, dw, dinputs, local, sizes, Y, dY,
            )  # fmt: skip
            first = 0 if begin == 0 else 1  # the sample before a block is not written again
            if failed >= 0 or not np.all(np.isfinite(Y[first:])):
                raise PredictionError(f"no solution at sample {begin + max(failed, 0) + 1}")
            self.local = local / end
            yield Block(begin + first, Y[first:], dY[first:, :, :count])


def _by_columns(slopes: np.ndarray) -> np.ndarray:
    """Column by column, the derivatives of all rows side by side: long loops in the march."""
    rows, columns, parameters = slopes.shape
    return np.ascontiguousarray(slopes.transpose(1, 0, 2)).reshape(columns, rows * parameters)


def _magnified(matrices: Matrices) -> Matrices:
    """Matrices with a complex step of another size."""

    def grown(array: np.ndarray) -> np.ndarray:
        return np.real(array) + 1j * (np.imag(array) * (MAGNIFIED / STEP))

    return replace(matrices, **{name: grown(getattr(matrices, name)) for name in ("A", "B", "W", "O", "parameters")})
