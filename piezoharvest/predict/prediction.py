"""What a transducer is predicted to do in a record, with the derivatives to its parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from piezoharvest.predict.drive import Drive, drive_of
from piezoharvest.predict.parameters import STEP, Parameter, stepped, value_at
from piezoharvest.predict.specimen import Matrices, Specimen
from piezoharvest.predict.steps import Step, step_of
from piezoharvest.shunts import Shunt
from piezoharvest.transducer import Transducer

# Steps of components are too small for what comes after their equations: squares of imaginary parts would underflow, which is slow.
MAGNIFIED = 1e-30
BLOCK = 1 << 16  # samples at a time: a record of millions of samples is never in memory with its derivatives
SLOW = 2.0  # samples: a state that lasts longer than this has a start of its own


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
    """

    drive: str
    shunt: Shunt | None
    sample_time: float
    first: float
    motion: Drive
    count: int


def setting_of(drive: str, shunt: Shunt | None, sample_time: float, values: np.ndarray) -> Setting:
    """Setting from the samples of the drive."""
    return Setting(drive, shunt, sample_time, float(values[0]), drive_of(values), len(values))


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


class Linearised(NamedTuple):
    """A step with its derivatives to the parameters as last axis."""

    step: Step
    slopes: Step


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
        self, transducer: Transducer, setting: Setting, parameters: Sequence[Parameter] = (), own: np.ndarray | None = None
    ) -> None:
        self.setting, self.transducer, self.parameters = setting, transducer, tuple(parameters)
        matrices = Specimen(transducer, setting.shunt, setting.drive, setting.sample_time).matrices()
        self.matrices = matrices
        h, share = setting.sample_time, 1.0 / max(setting.count - 1, 1)
        self.share = share
        self.step = step_of(matrices, h, share, setting.first)
        jumps = tuple(f"jump{j}" for j in setting.motion.jumps)
        self.free = self._free_states(None if own is None else len(own) - len(jumps))
        self.own_names = tuple(matrices.states[k] for k in self.free) + jumps
        self.own = np.zeros(len(self.own_names)) if own is None else own
        self.channels = matrices.channels
        # Mean slopes of the elements to their inputs, (elements, 2): those of relaxed operators that slip, until a march tells.
        self.local = np.zeros((len(matrices.kinds), 2))

    def _free_states(self, count: int | None) -> list[int]:
        """States whose start matters: those that outlast a few samples on their own, or so many that last longest.

        In a fit the number stays as it was at its start, wherever time constants go.
        """
        M, n = self.step.M, len(self.step.M)
        kept = np.abs(np.linalg.matrix_power(M[:, :n], int(SLOW))).max(axis=0)
        if count is None:
            count = int(np.sum(kept > 0.05))
        return sorted(np.argsort(-kept, kind="stable")[:count].tolist())

    @cached_property
    def slopes(self) -> Step:
        """Derivatives of the step to the parameters, by a complex step through all of its making."""
        setting, found = self.setting, []
        for parameter in self.parameters:
            inner = parameter.inner(value_at(self.transducer, parameter.path))
            device = stepped(self.transducer, parameter, inner)
            matrices = Specimen(device, setting.shunt, setting.drive, setting.sample_time).matrices()
            found.append(step_of(_magnified(matrices), setting.sample_time, self.share, setting.first))
        count = len(self.own_names)
        return Step(*(
            np.stack([*(np.imag(getattr(step, name)) / MAGNIFIED for step in found),
                      *[np.zeros(getattr(self.step, name).shape)] * count], axis=-1)
            if found or count else np.zeros((*getattr(self.step, name).shape, 0))
            for name in Step._fields
        ))  # fmt: skip

    def blocks(self, derivatives: bool = True, size: int = BLOCK) -> Iterator[Block]:
        """Predict, a block of samples at a time.

        Raises
        ------
        PredictionError
            The model's equations have no solution at a sample.
        """
        from piezoharvest.predict.march import march

        matrices, step, setting = self.matrices, self.step, self.setting
        nw, P = len(matrices.kinds), len(self.parameters) + len(self.own_names)
        slopes = self.slopes if derivatives else None
        if slopes is None:
            P = 0
            slopes = Step(*(np.zeros((*array.shape, 0)) for array in step))
        m = len(step.O) - len(matrices.channels)
        z, dz = step.start.copy(), slopes.start.copy()
        states, local = len(self.free), np.zeros((nw, 2))
        z[self.free] += self.own[:states] / matrices.scale[self.free]
        if P:
            for j, k in enumerate(self.free):
                dz[k, len(self.parameters) + j] = 1.0 / matrices.scale[k]
        w, inputs, dw, dinputs = np.zeros(nw), np.zeros(m), np.zeros((nw, P)), np.zeros((m, P))
        coefficients = setting.motion.coefficients.copy()
        jumps = setting.motion.jumps
        coefficients[jumps, 1] += 6.0 * self.own[states:]
        coefficients[jumps, 2] -= 6.0 * self.own[states:]
        arrays = [np.ascontiguousarray(a) for a in (step.M, step.H, step.O)]
        limits = np.ascontiguousarray(np.real(matrices.parameters))
        tangents = [_by_columns(array) for array in (slopes.M, slopes.H, slopes.O)]
        for begin in range(0, setting.count - 1, size):
            end = min(begin + size, setting.count - 1)
            Y, dY = np.empty((end - begin + 1, len(matrices.channels))), np.empty((end - begin + 1, len(matrices.channels), P))
            inside = np.flatnonzero((jumps >= begin) & (jumps < end)) if P else np.zeros(0, int)
            bumps = np.column_stack([jumps[inside] - begin, len(self.parameters) + states + inside]).astype(np.int64)
            failed = march(
                coefficients[begin:end], bumps, begin * self.share, self.share, begin == 0, setting.sample_time,
                *arrays, limits, matrices.kinds, matrices.places, *tangents, slopes.limits, z, w, inputs, dz, dw, dinputs, local, Y, dY,
            )  # fmt: skip
            if failed >= 0 or not np.all(np.isfinite(Y)):
                raise PredictionError(f"no solution at sample {begin + max(failed, 0) + 1}")
            first = 0 if begin == 0 else 1
            self.local = local / end
            yield Block(begin + first, Y[first:], dY[first:])


def _by_columns(slopes: np.ndarray) -> np.ndarray:
    """Column by column, the derivatives of all rows side by side: long loops in the march."""
    rows, columns, parameters = slopes.shape
    return np.ascontiguousarray(slopes.transpose(1, 0, 2)).reshape(columns, rows * parameters)


def _magnified(matrices: Matrices) -> Matrices:
    """Matrices with a complex step of another size."""

    def grown(array: np.ndarray) -> np.ndarray:
        return np.real(array) + 1j * (np.imag(array) * (MAGNIFIED / STEP))

    return replace(matrices, **{name: grown(getattr(matrices, name)) for name in ("A", "B", "W", "O", "parameters")})
