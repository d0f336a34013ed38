"""A model as a fit has it: what varies of a transducer, each record's own numbers, and the residuals they leave."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from piezoharvest.description.transducer import Transducer
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.noise.noise_gain import small_response, specimen_gain
from piezoharvest.predict.discrete_model import DiscreteModel
from piezoharvest.predict.parameters import Parameter, put, value_at
from piezoharvest.predict.prediction import Prediction
from piezoharvest.predict.sensors import Course, late_somewhere, sensed

CORNERS = 4  # parts of a sample, by which corners of hysteresis are seen where a channel is delayed
KEPT, KEPT_RECORDS = 1 << 24, 16  # bytes of derivatives of a record that are kept, and of how many
LATEST = 2  # samples by which a channel may be late: so many after a jump may be read while it happens

_LAST: WeakKeyDictionary[Data, list] = WeakKeyDictionary()


@dataclass(frozen=True)
class Model:
    """A transducer with what varies of it, and for each record its own numbers.

    Attributes
    ----------
    transducer : Transducer
    parameters : tuple of Parameter
        What is varied for all records.
    offset_channels : tuple of str
        Channels whose offset is free in every record.
    relaxed : bool
        Whether every record begins with stops at zero, whatever came before it.
    """

    transducer: Transducer
    parameters: tuple[Parameter, ...]
    offset_channels: tuple[str, ...]
    relaxed: bool = False
    _lowered: dict = field(init=False, repr=False, compare=False, default_factory=dict)

    def prediction(self, data: Data, own: np.ndarray | None = None) -> Prediction:
        """Prediction of a record; `own` as its `own_names` name them."""
        lowered = self.lowered(data)
        return Prediction(self.transducer, data.setting, self.parameters, own, lowered, relaxed=self.relaxed)

    def lowered(self, data: Data) -> DiscreteModel:
        """Equations for a record, which others share."""
        key = DiscreteModel.key(data.setting)
        if key not in self._lowered:
            self._lowered[key] = DiscreteModel(self.transducer, data.setting, self.parameters)
        return self._lowered[key]


def inner_values(model: Model) -> np.ndarray:
    """What varies, on the scales on which it is fitted."""
    return np.array([p.inner(value_at(model.transducer, p.path)) for p in model.parameters])


def moved(model: Model, values: np.ndarray) -> Model:
    """Model with other values of what is varied."""
    if not model.parameters:
        return model  # with its equations, which take longer than a short record
    transducer = model.transducer
    for parameter, value in zip(model.parameters, values, strict=True):
        transducer = put(transducer, parameter.path, float(np.real(parameter.outer(float(value)))))
    return replace(model, transducer=transducer)


class Extra(NamedTuple):
    """An offset or a line in a record, whose size is one of the record's own numbers.

    Attributes
    ----------
    name : str
    gains : (channels,) complex array
        In which channels, and by how much.
    frequency : float
        Hz.
    effect : int or None
        The effect that it belongs to.
    """

    name: str
    gains: np.ndarray
    frequency: float
    effect: int | None

    def columns(self, time: np.ndarray) -> np.ndarray:
        """What a unit adds to the channels, (samples, channels), complex."""
        if self.frequency == 0.0:
            return np.broadcast_to(self.gains, (len(time), len(self.gains)))
        return np.exp(2j * np.pi * self.frequency * time)[:, None] * self.gains


def extras(model: Model, data: Data, prediction: Prediction) -> list[Extra]:
    """Offsets and lines of a record; a line has two, for its two phases."""
    eye = np.eye(len(data.channels))
    free = [c for c in data.channels if c in model.offset_channels]
    found = [Extra(f"{c} offset", eye[data.channels.index(c)], 0.0, None) for c in free]
    for n, effect in enumerate(model.transducer.effects):
        for channel in (*data.channels, data.drive):
            frequency = effect.line(channel)
            if frequency is None:
                continue
            # A line on the measured drive is not in the real one: the prediction has it in all channels.
            at = np.array([frequency])
            gains = (
                -specimen_gain(prediction, data.channels, at)[0]
                if channel == data.drive
                else eye[data.channels.index(channel)]
            )
            found += [
                Extra(f"{effect.name} {channel} {part}", gains * phase, frequency, n)
                for part, phase in (("cos", 1), ("sin", -1j))
            ]
    return found


def first_samples(data: Data) -> list[tuple[int, int]]:
    """Samples (and channels) after a jump: what a sensor reads there, between before and after, is a number of its own.

    By how much the reading without noise is above what was read. Where neighbouring steps jump, a sample after both is
    one number.
    """
    after = {int(jump) + 1 + k for jump in data.setting.motion.jumps for k in range(LATEST)}
    return [(sample, c) for sample in sorted(after) if sample < len(data) for c in range(len(data.channels))]


def own_names(model: Model, data: Data) -> tuple[str, ...]:
    """Names of a record's own numbers: states at the start, jumps, first samples after these, offsets, lines."""
    prediction = model.prediction(data)
    first = (f"{data.channels[c]} sample{sample}" for sample, c in first_samples(data))
    return (*prediction.own_names, *first, *(extra.name for extra in extras(model, data, prediction)))


def own_limits(model: Model, data: Data) -> np.ndarray:
    """The largest sizes of a record's own numbers."""
    limits = model.prediction(data).own_limits
    return np.pad(limits, (0, len(own_names(model, data)) - len(limits)), constant_values=np.inf)


def begun(model: Model, data: Data, own: np.ndarray) -> Prediction:
    """Prediction of a record that begins and jumps as its own numbers say."""
    return model.prediction(data, own[: len(model.prediction(data).own_names)])


def residual_blocks(
    model: Model, data: Data, own: np.ndarray, derivatives: bool
) -> Iterator[tuple[Prediction, int, np.ndarray, Any]]:
    """Blocks (prediction, begin, residuals, derivatives) of a record; `own` as `own_names` names it.

    Residuals of what the drive does without its noise.
    """
    first, more = first_samples(data), extras(model, data, model.prediction(data))
    states, read, added = np.split(own, [len(own) - len(first) - len(more), len(own) - len(more)])
    prediction = model.prediction(data, states)
    h, effects = data.setting.sample_time, model.transducer.effects
    parts = CORNERS if late_somewhere(effects, data.channels) and len(prediction.matrices.kinds) else 1
    for block in prediction.blocks(derivatives, channels=data.channels, parts=parts):
        end = block.begin + len(block.values)
        time = (np.arange(block.begin, end) - 0.5 * len(data)) * h
        predicted, slopes = block.values, None
        if derivatives:
            slopes = _widened(block.derivatives, len(model.parameters) + len(own))
        _add(model, more, added, time, predicted, slopes)
        abrupt = data.setting.abrupt and block.begin == 0
        course = Course(h, data.setting.jumps - block.begin, block.between, abrupt)
        predicted, slopes = sensed(effects, model.parameters, data.scatter, course, predicted, slopes)
        residual = data.part(block.begin, end) - predicted
        for k, (sample, c) in enumerate(first):
            if block.begin <= sample < end:
                # Whatever is predicted there, which depends on the jump's instant by leaps.
                residual[sample - block.begin, c] = -read[k]
                if slopes is not None:
                    slopes[sample - block.begin, c] = 0.0
                    slopes[sample - block.begin, c, k - len(first) - len(more)] = 1.0
        yield prediction, block.begin, residual, slopes


def evaluated(model: Model, data: Data, own: np.ndarray) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Blocks (begin, residuals, derivatives) of a record, not to be written to.

    Those of the last two models are kept if they are small: where one descent ends, with residuals whitened anew, the
    next one begins, and a step beyond it may have been tried in vain.
    """
    what = model.transducer, model.parameters, model.offset_channels, model.relaxed, own.tobytes()
    for known, blocks in _LAST.get(data, ()):
        if known == what:
            yield from blocks
            return
    blocks, room = [], KEPT if data in _LAST or len(_LAST) < KEPT_RECORDS else 0
    for _, begin, residual, slopes in residual_blocks(model, data, own, True):
        yield begin, residual, slopes
        room -= slopes.nbytes
        blocks = [*blocks, (begin, residual, slopes)] if room >= 0 else []
    if blocks:
        _LAST[data] = [(what, blocks), *_LAST.get(data, ())][:2]


def noise_passed(prediction: Prediction, data: Data, begin: int, end: int) -> np.ndarray:
    """What the noise of the drive would do in some samples, (samples, channels), if the specimen felt it.

    It comes after the sensors: their range has not cut it off.
    """
    return small_response(prediction, data.channels, data.rest[begin:end])


def unexplained_blocks(model: Model, data: Data, own: np.ndarray) -> Iterator[tuple[Prediction, int, np.ndarray]]:
    """Blocks (prediction, begin, residuals) of a record, less the noise of the drive as the model itself passes it."""
    for prediction, begin, residual, _ in residual_blocks(replace(model, parameters=()), data, own, False):
        yield prediction, begin, residual - noise_passed(prediction, data, begin, begin + len(residual))


def _widened(derivatives: np.ndarray, count: int) -> np.ndarray:
    """Derivatives (samples, channels, p) with further columns of zeros.

    The samples lie together in memory, as their spectra want them.
    """
    samples, channels, p = derivatives.shape
    found = np.zeros((channels, count, samples)).transpose(2, 0, 1)
    found[:, :, :p] = derivatives
    return found


def _add(model: Model, more: Sequence[Extra], sizes: np.ndarray, time, predicted, slopes) -> None:
    """Add offsets and lines, and their derivatives in the last columns."""
    for k, (extra, size) in enumerate(zip(more, sizes, strict=True)):
        column = extra.columns(time)
        predicted += size * np.real(column)
        if slopes is None:
            continue
        slopes[:, :, k - len(more)] = np.real(column)
        for p, parameter in enumerate(model.parameters):
            if extra.effect is not None and parameter.path == ("effects", extra.effect, "frequency"):
                varied = parameter.slope(parameter.inner(extra.frequency))
                slopes[:, :, p] += size * varied * np.real(2j * np.pi * time[:, None] * column)
