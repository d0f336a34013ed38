"""Discrete-time model of a transducer in a record: its equations and the steps from sample to sample."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from piezoharvest.description.effects.nameless.sizes import RecordSizes
from piezoharvest.description.shunts import Shunt
from piezoharvest.description.transducer import Transducer
from piezoharvest.predict.drive import JUMP_PARTS, PolynomialDrive, drive_of, size_of
from piezoharvest.predict.parameters import STEP, Parameter, stepped_in_each
from piezoharvest.predict.record_model import VARYING, Matrices, RecordModel
from piezoharvest.predict.sample_step import SampleStep, inverse_of, step_of
from piezoharvest.records.gate import Edges
from piezoharvest.records.harmonics import Harmonics

# Complex steps of components are too small for later operations: squares of imaginary parts would underflow, which is
# slow.
MAGNIFIED = 1e-30
MIN_SLOW_SAMPLES = 2.0  # samples: a state that takes longer to decay has a free initial value,
DECAYED_SHARE = 0.05  # remaining share of a state that has decayed
STEPS_AFTER_JUMP, PARTS_AFTER_JUMP = 16, 64  # steps after a jump that are divided, and the number of their parts


@dataclass(frozen=True, eq=False)
class Setting:
    """Properties of a record that a prediction depends on.

    Attributes
    ----------
    drive : str
        The imposed channel.
    shunt : Shunt or None
    sample_time, first : float
        s; first value of the drive.
    motion : PolynomialDrive
    count : int
        Samples.
    free : tuple of str
        States with a free initial value.
    sizes : tuple of float
        Behind a circuit with events: units of these values, SI.
    fixed : tuple of (str, float)
        Behind a circuit with events: initial states that are known, SI.
    harmonics : Harmonics or None
        Drive of a record in steady state, of which `motion` is the part in the record.
    gate : Edges or None
        When the switch of the circuit is told to act; None where the displacement tells.
    swift : tuple of str
        Fast states, which have come to rest relative to the free ones before the record.
    reach : float
        Root of twice the largest energy that spring or capacitance stores in the record, sqrt(J): an effect's state has
        hardly more, whatever came before.
    abrupt : bool
        The drive jumps to its first value at the first sample, from a free value.
    fine, fine_straight : int
        Steps per sample for models with elements, whose outputs are cubics within a step; where the rate of an input is
        not known they are straight lines.
    size : (float, float) or None
        Amplitude and frequency (Hz) of the drive, which laws of a parameter may be functions of.
    acted : float
        Time (s) up to which the switch does not act: it has done so already, just before the record or at its very
        beginning, and its loop is still closed. What it makes of the states until then, they have from the beginning.
    """

    drive: str
    shunt: Shunt | None
    sample_time: float
    first: float
    motion: PolynomialDrive
    count: int
    free: tuple[str, ...] = ()
    swift: tuple[str, ...] = ()
    abrupt: bool = False
    fine: int = 1
    fine_straight: int = 1
    sizes: tuple[float, ...] = ()
    reach: float = 0.0
    fixed: tuple[tuple[str, float], ...] = ()
    harmonics: Harmonics | None = None
    gate: Edges | None = None
    size: RecordSizes | None = None
    acted: float = 0.0

    @property
    def jumps(self) -> np.ndarray:
        """Steps in which the drive jumps, including the first one if the record begins abruptly."""
        return np.concatenate([np.zeros(int(self.abrupt), int), self.motion.jumps])

    @cached_property
    def parts(self) -> dict[int, int]:
        """Number of parts of divided steps: those with a jump and those soon after, in which operators slip fast."""
        jumps = self.jumps.tolist()
        found = {
            **{jump + k: PARTS_AFTER_JUMP for jump in jumps for k in range(STEPS_AFTER_JUMP)},
            **dict.fromkeys(jumps, JUMP_PARTS),
        }
        return {step: parts for step, parts in found.items() if step < self.count - 1}


def setting_of(
    drive: str,
    shunt: Shunt | None,
    sample_time: float,
    values: np.ndarray,
    transducer: Transducer | None = None,
    *,
    abrupt: bool = False,
) -> Setting:
    """Setting from the samples of the drive; with a transducer, slow states have free initial values.

    States of effects begin at rest: a preload has acted long before the record.
    """
    motion = drive_of(values)
    setting = Setting(drive, shunt, sample_time, float(values[0]), motion, len(values), abrupt=abrupt)
    setting = replace(setting, size=size_of(values, sample_time))
    if transducer is None:
        return setting
    bare = DiscreteModel(replace(transducer, effects=()), setting, ())
    M, n = bare.step.M, len(bare.step.M)
    kept = np.abs(np.linalg.matrix_power(M[:, :n], int(MIN_SLOW_SAMPLES))).max(axis=0)
    free = tuple(name for name, k in zip(bare.matrices.states, kept, strict=True) if k > DECAYED_SHARE)
    return replace(setting, free=free, swift=tuple(name for name in bare.matrices.states if name not in free))


class DiscreteModel:
    """A transducer's equations for all records that differ in their drive only.

    Parameters
    ----------
    transducer : Transducer
    setting : Setting
        One of the records.
    parameters : sequence of Parameter
        Variables of the derivatives.
    """

    def __init__(self, transducer: Transducer, setting: Setting, parameters: Sequence[Parameter]) -> None:
        self.transducer, self.setting, self.parameters = transducer, setting, tuple(parameters)
        self.matrices = self._matrices(transducer)
        self.share = 1.0 / max(setting.count - 1, 1)
        self.shared: dict[Hashable, Any] = {}  # results that depend on the equations alone
        self._steps: dict[int, SampleStep] = {}
        self._tangent_steps: dict[int, SampleStep] = {}

    @property
    def step(self) -> SampleStep:
        """Step over a sample; not made for a model of which only the names of states are asked."""
        return self.step_by(1)

    @cached_property
    def inverse(self) -> np.ndarray:
        """As of `inverse_of`."""
        return inverse_of(self.matrices)

    @staticmethod
    def key(setting: Setting, transducer: Transducer) -> tuple:
        """Properties that the records of one model have in common."""
        size = setting.size if any(effect.of_drive for effect in transducer.effects) else None
        return setting.shunt, setting.drive, setting.sample_time, setting.count, size

    def _matrices(self, transducer: Transducer) -> Matrices:
        setting = self.setting
        return RecordModel(transducer, setting.shunt, setting.drive, setting.sample_time, setting.size).matrices()

    @cached_property
    def tangents(self) -> Matrices:
        """Equations of several specimens: each with a complex step in one of the parameters."""
        found, count = self._matrices(stepped_in_each(self.transducer, self.parameters)), len(self.parameters)

        def magnified(name: str) -> np.ndarray:
            value = getattr(self.matrices, name)
            steps = np.broadcast_to(np.imag(getattr(found, name)), (count, *value.shape))
            return value + 1j * (steps * (MAGNIFIED / STEP))

        return replace(self.matrices, **{name: magnified(name) for name in VARYING})

    @cached_property
    def influential(self) -> np.ndarray:
        """States on which channels or inputs of elements depend at some time, (states,) of bool.

        Derivatives of others make none of what is predicted: such as those of a memory whose law has the factor zero.
        """
        follows = np.real(self.matrices.A) != 0.0
        found = np.any(self.matrices.O[:, : len(follows)] != 0.0, axis=0)
        while np.any(more := np.any(follows[found], axis=0) & ~found):
            found = found | more
        return found

    def acts(self, derivatives: bool) -> np.ndarray:
        """Elements whose outputs act on states or inputs, or would by a parameter, (elements,) of bool."""
        acting = np.any(self.matrices.W != 0.0, axis=0) | np.any(self._reaching(derivatives), axis=0)
        return acting | np.any(np.imag(self.tangents.W) != 0.0, axis=(0, 1)) if derivatives else acting

    def reached(self, derivatives: bool) -> np.ndarray:
        """Inputs that outputs of elements reach directly, or with derivatives would by a parameter, (inputs,) of bool.

        Only those of which the other part's rate is known.
        """
        return np.any(self._reaching(derivatives), axis=1)

    def _reaching(self, derivatives: bool) -> np.ndarray:
        """Which outputs reach which inputs, (inputs, elements) of bool."""
        matrices, m, n = self.matrices, len(self.matrices.rated), len(self.matrices.states)
        outputs = slice(n, n + len(matrices.kinds))
        reaching = matrices.O[:m, outputs] != 0.0
        if derivatives:
            reaching = reaching | np.any(np.imag(self.tangents.O[:, :m, outputs]) != 0.0, axis=0)
        return reaching & matrices.rated[:, None]

    def steps_per_sample(self, derivatives: bool) -> int:
        """Steps within a sample that the elements' outputs need."""
        matrices, setting = self.matrices, self.setting
        if not len(matrices.kinds):
            return 1
        known = np.all((matrices.rated | matrices.straight)[matrices.places], axis=1)
        return setting.fine if np.all(known | ~self.acts(derivatives)) else setting.fine_straight

    def step_by(self, parts: int) -> SampleStep:
        """Step over one of `parts` parts of a sample."""
        if parts not in self._steps:
            self._steps[parts] = self._discretised(self.matrices, parts)
        return self._steps[parts]

    def tangent_steps(self, parts: int) -> SampleStep:
        """As `step_by`, of `tangents`."""
        if parts not in self._tangent_steps:
            self._tangent_steps[parts] = self._discretised(self.tangents, parts)
        return self._tangent_steps[parts]

    def _discretised(self, matrices: Matrices, parts: int) -> SampleStep:
        return step_of(matrices, self.setting.sample_time / parts, self.share / parts)
