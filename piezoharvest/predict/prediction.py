"""Predicted response of a transducer in a record, with derivatives with respect to its parameters."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple, TypeVar

import numpy as np

from piezoharvest.description.transducer import Transducer
from piezoharvest.predict.discrete_model import MAGNIFIED, DiscreteModel, Setting
from piezoharvest.predict.drive import JUMP_PARTS, RISE_PARTS, divided, rise_steps
from piezoharvest.predict.pace import Pace, pace_of, padded
from piezoharvest.predict.parameters import Parameter
from piezoharvest.predict.propagation.element_kinds import STOP
from piezoharvest.predict.record_model import VARYING, Matrices
from piezoharvest.predict.sample_step import SampleStep, equilibria
from piezoharvest.predict.segments import NO_RISE, Propagation

_T = TypeVar("_T")
MAX_SHARED = 4  # results of the equations alone that are kept: for whole blocks and the last one of a record
RATES = ("velocity", "acceleration")
BLOCK = 1 << 16  # samples at a time: the derivatives of a record of millions of samples do not fit into memory


class PredictionError(ArithmeticError):
    """The model cannot be propagated through a record: the message says where."""


class Block(NamedTuple):
    """Consecutive samples of a prediction.

    Attributes
    ----------
    begin : int
        First sample.
    values : (samples, channels) array
    derivatives : (samples, channels, parameters) array
        With respect to the parameters' variables, then to its nuisance parameters, `Prediction.nuisance_names`.
    between : ((samples - 1) * parts + 1, channels) array or None
        Values between the samples, too, if requested; they are meaningless within steps over which the drive jumps.
    """

    begin: int
    values: np.ndarray
    derivatives: np.ndarray
    between: np.ndarray | None


class Prediction:
    """A transducer in a setting.

    Parameters
    ----------
    transducer : Transducer
    setting : Setting
    parameters : sequence of Parameter
        Variables of the derivatives.
    nuisance : (n,) array, optional
        Named in `nuisance_names`: initial deviations of the states from equilibrium (SI units), then those of the
        states of effects;
        the value of the drive before a record that begins abruptly; the initial output of every stop as fraction of its
        threshold, which depends on the history before the record; the delay of every jump from the middle of its step,
        as integral in the drive's unit times the time of a small step, and the logarithm of its duration over
        `RISE_PARTS` of these. `nuisance_limits` are bounds of their magnitudes.
    lowered : DiscreteModel, optional
        The equations, if already computed.
    relaxed : bool
        Stops begin at zero.
    at_rest : bool
        States of effects, such as creep, begin in equilibrium.
    """

    def __init__(
        self,
        transducer: Transducer,
        setting: Setting,
        parameters: Sequence[Parameter] = (),
        nuisance: np.ndarray | None = None,
        lowered: DiscreteModel | None = None,
        *,
        relaxed: bool = False,
        at_rest: bool = True,
    ) -> None:
        self.setting, self.transducer, self.parameters = setting, transducer, tuple(parameters)
        self._lowered = lowered = lowered or DiscreteModel(transducer, setting, parameters)
        self.matrices = matrices = lowered.matrices
        self.share = lowered.share
        self.free, self.swift = (
            [matrices.states.index(name) for name in some] for some in (setting.free, setting.swift)
        )
        # Effect whose state each of the nuisance parameters behind those of the specimen's own states begins.
        self.begun = () if at_rest else tuple(effect for effect, _ in matrices.own)
        names = [matrices.states[k] for k in self.free]
        if self.begun:
            names += [f"start {matrices.states[k]}" for _, k in matrices.own]
            self.free = [*self.free, *(k for _, k in matrices.own)]
        before = ("drive before",) * setting.abrupt
        # If the drive begins on a specimen at rest, its first jump overrides the history before.
        relaxed = relaxed or setting.abrupt
        self.stops = np.flatnonzero((matrices.kinds == STOP) & (not relaxed))
        memories = () if relaxed else matrices.memories
        jumps = tuple(f"{name}{j}" for j in setting.motion.jumps for name in ("jump", "rise"))
        self.nuisance_names = (*names, *before, *memories, *jumps)
        self.nuisance = np.zeros(len(self.nuisance_names)) if nuisance is None else nuisance
        # A jump lies between its samples.
        far = 0.5 * JUMP_PARTS * np.abs(setting.motion.coefficients[setting.motion.jumps, 1])
        limits = np.column_stack([far, np.full(len(far), np.log(JUMP_PARTS / RISE_PARTS))]).ravel()
        self.nuisance_limits = np.concatenate(
            [np.full(len(self.free) + len(before), np.inf), np.ones(len(self.stops)), limits]
        )
        # What is predicted by default.
        self.channels = tuple(channel for channel in matrices.channels if channel not in RATES)
        # Mean slopes of the elements with respect to their inputs, (elements, 2): those of relaxed operators that slip,
        # until they are measured in a run.
        self.local = np.zeros((len(matrices.kinds), 2))

    @property
    def step(self) -> SampleStep:
        """Step over a sample."""
        return self._lowered.step

    @property
    def begun_from(self) -> int:
        """Place of the first state of an effect among the nuisance parameters."""
        return len(self.free) - len(self.begun)

    @property
    def reach(self) -> np.ndarray:
        """Largest initial values, SI units, that the states of effects could have, in the order of `begun`."""
        return self.setting.reach * self.matrices.scale[[k for _, k in self.matrices.own[: len(self.begun)]]]

    @property
    def nonlinear(self) -> bool:
        """True if the model has elements."""
        return len(self.matrices.kinds) > 0

    @property
    def bends(self) -> bool:
        """True if channels have corners between samples."""
        return self.nonlinear

    @property
    def linear(self) -> Prediction:
        """Prediction for small noise of the drive: this one, with its elements at their mean slopes."""
        return self

    @cached_property
    def slopes(self) -> SampleStep:
        """Derivatives of the step with respect to the parameters and the nuisance parameters, by a complex step."""
        return self._slopes(self.step, self._lowered.tangent_steps(1))

    @np.errstate(over="ignore")  # as in `step_of`
    def _slopes(self, step: SampleStep, tangents: SampleStep) -> SampleStep:
        count = len(self.parameters)

        def slopes(name: str) -> np.ndarray:
            found = np.zeros((*getattr(step, name).shape, count + len(self.nuisance_names)))
            found[..., :count] = np.moveaxis(np.imag(getattr(tangents, name)), 0, -1) / MAGNIFIED
            return found

        return SampleStep(*map(slopes, SampleStep._fields))

    def steps(self, parts: int, derivatives: bool) -> tuple[SampleStep, SampleStep]:
        """Step over a part of a sample, and its derivatives, which are empty unless requested."""
        step = self._lowered.step_by(parts)
        if not derivatives:
            return step, SampleStep(*(np.zeros((*array.shape, 0)) for array in step))
        return step, self.slopes if parts == 1 else self._slopes(step, self._lowered.tangent_steps(parts))

    @property
    def influential(self) -> np.ndarray:
        """As of `DiscreteModel`."""
        return self._lowered.influential

    def steps_per_sample(self, derivatives: bool) -> int:
        """As of `DiscreteModel`."""
        return self._lowered.steps_per_sample(derivatives)

    def _start(self, derivatives: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Initial scaled states and their derivatives; initial outputs of the elements and theirs."""
        further, count = (self._lowered.tangents, len(self.parameters)) if derivatives else (None, 0)
        several = _several(self.matrices, further, len(self.nuisance) * derivatives)
        nuisance = np.tile(self.nuisance.astype(complex), (len(several.A), 1))
        steps = nuisance[1 + count :]
        steps += 1j * MAGNIFIED * np.eye(len(steps), len(self.nuisance))
        start = self._begun(several, nuisance)
        slopes = np.imag(start[1:]).T / MAGNIFIED
        (z, w), (dz, dw) = (np.split(some, [len(self.matrices.states)]) for some in (np.real(start[0]), slopes))
        return z, dz, w, dw

    def _begun(self, several: Matrices, nuisance: np.ndarray) -> np.ndarray:
        """Initial scaled states and outputs of the elements, (k, n + elements), of k equations."""
        count, matrices = len(several.A), self.matrices
        off, w = np.zeros((count, len(matrices.states)), complex), np.zeros((count, len(matrices.kinds)), complex)
        states, rest = np.split(nuisance, [len(self.free)], axis=1)
        off[:, self.free] = states / matrices.scale[self.free]
        if self.free and self.swift:
            A = several.A[:, self.swift]
            pushed = A[:, :, self.free] @ off[:, self.free, None]
            off[:, self.swift] = -np.linalg.solve(A[:, :, self.swift], pushed)[:, :, 0]
        first = np.full(count, self.setting.first, complex)
        if self.setting.abrupt:
            first, rest = rest[:, 0], rest[:, 1:]
        w[:, self.stops] = rest[:, : len(self.stops)] * several.parameters[:, self.stops]
        z = equilibria(several, self._lowered.inverse, first, w) + (several.follow @ off[:, :, None])[:, :, 0]
        return np.hstack([z, w])

    def shared(self, key: Hashable, made: Callable[[], _T]) -> _T:
        """A result that depends on the equations alone, made once for all records that have these.

        With elements it is made for each record, as their mean slopes differ. Of several keys the last few are kept.
        """
        if len(self.matrices.kinds):
            return made()
        known = self._lowered.shared
        if key not in known:
            found = made()
            for old in list(known)[: max(len(known) - MAX_SHARED + 1, 0)]:
                known.pop(old, None)  # another thread may have been faster
            known[key] = found
            return found
        return known[key]

    def settle(self) -> None:
        """Propagate through the record unless already done, so that `local` holds the mean slopes of its elements."""
        if not self.local.any():
            for _ in self.blocks(derivatives=False):
                pass

    def blocks(
        self, derivatives: bool = True, size: int = BLOCK, channels: Sequence[str] | None = None, parts: int = 1
    ) -> Iterator[Block]:
        """Predict the record, a block of samples at a time.

        Parameters
        ----------
        derivatives : bool
            Compute derivatives, too.
        size : int
            Samples in a block.
        channels : sequence of str, optional
            Channels to predict; default `channels`, all but velocity and acceleration.
        parts : int
            Parts of a sample at whose ends values are computed.

        Raises
        ------
        PredictionError
            The model's equations have no solution at a sample.
        """
        wanted = self.channels if channels is None else channels
        setting, inputs = self.setting, len(self.matrices.O) - len(self.matrices.channels)
        rows = [*range(inputs), *(inputs + self.matrices.channels.index(channel) for channel in wanted)]
        count = len(self.parameters) + len(self.nuisance_names) if derivatives else 0
        z, dz, w, dw = self._start(derivatives)
        acting = self._lowered.acts(derivatives), self._lowered.reached(derivatives)
        moving = Propagation(self.matrices, *acting, z, padded(dz), w, padded(dw))
        run = _Propagation(self, moving, derivatives, rows)
        # Values between the samples come from a separate run: their derivatives would take most of the time.
        plain = Propagation(self.matrices, *acting, z.copy(), padded(dz[:, :0]), w.copy(), padded(dw[:, :0]))
        finer = _Propagation(self, plain, False, rows, parts) if parts > 1 else None
        for begin, end in pairwise([0, *range(size - 1, setting.count - 1, size), setting.count - 1]):
            Y, dY = run.through(begin, end)
            between = None if finer is None else finer.through(begin, end)[0]
            first = 0 if begin == 0 else 1  # the sample before a block is not written again
            self.local = run.local / end
            yield Block(
                begin + first, Y[first:], dY[first:, :, :count], None if between is None else between[first * parts :]
            )


def _several(matrices: Matrices, tangents: Matrices | None, copies: int) -> Matrices:
    """Equations of several specimens: a specimen, it with complex steps in each parameter, and so many copies of it."""

    def stacked(name: str) -> np.ndarray:
        value = getattr(matrices, name)
        steps = [] if tangents is None else [getattr(tangents, name)]
        return np.concatenate([value[None], *steps, np.broadcast_to(value, (copies, *value.shape))])

    return replace(matrices, **{name: stacked(name) for name in VARYING})


class _Propagation:
    """A run through a record and its steps.

    Parameters
    ----------
    prediction : Prediction
    run : Propagation
    derivatives : bool
        The run has derivatives.
    rows : sequence of int
        Rows of the outputs, those of the elements' inputs first.
    written : int
        Values written per sample.
    """

    def __init__(
        self, prediction: Prediction, run: Propagation, derivatives: bool, rows: Sequence[int], written: int = 1
    ) -> None:
        self._of, self._run, self._derivatives, self._rows, self._written = prediction, run, derivatives, rows, written
        fine = prediction.steps_per_sample(derivatives)
        self._fine = written * -(-fine // written)
        self._paces: dict[int, Pace] = {}

    @property
    def local(self) -> np.ndarray:
        """Average slopes of the elements over the samples so far."""
        return self._run.local / self._fine

    def through(self, begin: int, end: int) -> tuple[np.ndarray, np.ndarray]:
        """Values and derivatives from one sample to another.

        Raises
        ------
        PredictionError
            The model's equations have no solution at a sample.
        """
        setting, run, fine, written = self._of.setting, self._run, self._fine, self._written
        outputs = len(self._rows) - run.inputs
        Y, dY = (np.empty(((end - begin) * written + 1, outputs, *lanes)) for lanes in ((), (run.lanes,)))
        inside = [step for step in setting.parts if begin <= step < end]
        for a, b in pairwise(sorted({begin, *inside, *(step + 1 for step in inside), end})):
            part = slice((a - begin) * written, (b - begin) * written + 1)
            if a in setting.parts:
                failed = self._small(a, Y[part], dY[part])
            else:
                motion, time = divided(setting.motion.coefficients[a:b], fine), a * self._of.share
                failed = run.go(self._pace(fine), motion, time, a == 0, Y[part], dY[part], every=fine // written)
            if failed >= 0 or not np.all(np.isfinite(Y[part][1:])):
                raise PredictionError(f"no solution at sample {a + max(failed, 0) // fine + 1}")
        return Y, dY

    def _pace(self, parts: int) -> Pace:
        """Pace of steps over a part of a sample."""
        if parts not in self._paces:
            setting, (step, slopes) = self._of.setting, self._of.steps(parts, self._derivatives)
            step, slopes = (each._replace(O=each.O[self._rows]) for each in (step, slopes))
            h, share = setting.sample_time / parts, self._of.share / parts
            inputs, reached = self._run.inputs, self._run.reached
            self._paces[parts] = pace_of(h, share, step, slopes, inputs, reached, self._of.influential)
        return self._paces[parts]

    def _small(self, begin: int, Y: np.ndarray, dY: np.ndarray) -> int:
        """Propagate over one step by small steps, within which the drive may jump; return 0 if it failed, else -1."""
        of, run = self._of, self._run
        motion, parts, rise = of.setting.motion, of.setting.parts[begin], NO_RISE
        line = motion.coefficients[begin]
        if begin in motion.jumps:
            k = len(of.nuisance_names) - 2 * (len(motion.jumps) - int(np.searchsorted(motion.jumps, begin)))
            coefficients, slopes = rise_steps(line, -of.nuisance[k] / line[1], of.nuisance[k + 1])
            if run.lanes:
                rise = len(of.parameters) + k, slopes
        else:
            coefficients = divided(line[None], parts)
        pace, time, every = self._pace(parts), begin * of.share, len(coefficients) // (len(Y) - 1)
        failed = run.go(pace, coefficients, time, begin == 0, Y, dY, every=every, rise=rise, small=True)
        return min(failed, 0)
