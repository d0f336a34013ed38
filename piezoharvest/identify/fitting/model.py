"""Model of a fit: the transducer's fitted parameters, each record's nuisance parameters, and the residuals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.transducer import Transducer
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.noise.noise_gain import small_response, specimen_gain
from piezoharvest.predict.any_prediction import AnyPrediction
from piezoharvest.predict.circuit.circuit_prediction import CircuitPrediction, Systems
from piezoharvest.predict.circuit.periodic_prediction import PeriodicPrediction
from piezoharvest.predict.circuit.setting import by_engine
from piezoharvest.predict.discrete_model import DiscreteModel
from piezoharvest.predict.parameters import Parameter, put, value_at
from piezoharvest.predict.prediction import Block, Prediction, PredictionError
from piezoharvest.predict.sensors import Course, any_delays, sensed

SUBSAMPLES = 4  # parts of a sample that resolve corners of hysteresis if a channel is delayed
# Bytes of derivatives that are cached for a record, and number of such records.
CACHE_BYTES = 1 << 24
CACHED_RECORDS = 16
MAX_DELAY_SAMPLES = 2  # samples by which a channel may be delayed: as many after a jump may be read during it

_CACHE: WeakKeyDictionary[Data, list] = WeakKeyDictionary()


@dataclass(frozen=True)
class Model:
    """A transducer with its fitted parameters, and the kinds of nuisance parameters of the records.

    Attributes
    ----------
    transducer : Transducer
    parameters : tuple of Parameter
        Fitted parameters, common to all records.
    offset_channels : tuple of str
        Channels whose offset is free in every record.
    relaxed : bool
        True if every record begins with stops at zero.
    at_rest : bool
        True if states of effects, such as creep, begin every record in equilibrium.
    felt : int or None
        Number of effects that have an influence by themselves; of those behind them only the derivatives count.
    """

    transducer: Transducer
    parameters: tuple[Parameter, ...]
    offset_channels: tuple[str, ...]
    relaxed: bool = False
    at_rest: bool = True
    felt: int | None = None
    _lowered: dict = field(init=False, repr=False, compare=False, default_factory=dict)
    _systems: Systems = field(init=False, repr=False, compare=False, default_factory=dict)

    def prediction(self, data: Data, nuisance: np.ndarray | None = None) -> AnyPrediction:
        """Prediction of a record with its nuisance parameters, in the order of its `nuisance_names`."""
        if by_engine(data.setting):
            of_engine = CircuitPrediction if data.setting.harmonics is None else PeriodicPrediction
            return of_engine(
                self.transducer, data.setting, self.parameters, nuisance, relaxed=self.relaxed, felt=self.felt,
                systems=self._systems, under_way=0 if self.at_rest else self._felt,
            )  # fmt: skip
        lowered = self.lowered(data)
        return Prediction(
            self.transducer, data.setting, self.parameters, nuisance, lowered, relaxed=self.relaxed,
            at_rest=self.at_rest,
        )  # fmt: skip

    @property
    def _felt(self) -> int:
        """Number of effects that have an influence."""
        return len(self.transducer.effects) if self.felt is None else self.felt

    def forget(self) -> None:
        """Forget the systems of circuits, whose tables take a megabyte each."""
        self._systems.clear()

    def lowered(self, data: Data) -> DiscreteModel:
        """Equations for a record, shared by records with the same settings."""
        key = DiscreteModel.key(data.setting, self.transducer)
        if key not in self._lowered:
            self._lowered[key] = DiscreteModel(self.transducer, data.setting, self.parameters)
        return self._lowered[key]


def inner_values(model: Model) -> np.ndarray:
    """Values of the fitted parameters, on the scales of the fit."""
    return np.array([p.inner(value_at(model.transducer, p.path)) for p in model.parameters])


def with_values(model: Model, values: np.ndarray) -> Model:
    """Model with other values of the fitted parameters."""
    if not model.parameters:
        return model  # with its cached equations, which take longer than a short record
    transducer = model.transducer
    for parameter, value in zip(model.parameters, values, strict=True):
        transducer = put(transducer, parameter.path, float(np.real(parameter.outer(float(value)))))
    return replace(model, transducer=transducer)


class Extra(NamedTuple):
    """An offset or a line in a record, whose size is one of the record's nuisance parameters.

    Attributes
    ----------
    name : str
    gains : (channels,) complex array
        Contribution of a unit to each channel.
    frequency : float
        Hz.
    effect : int or None
        Index of the effect that it belongs to.
    """

    name: str
    gains: np.ndarray
    frequency: float
    effect: int | None

    def columns(self, time: np.ndarray) -> np.ndarray:
        """Contribution of a unit to the channels, (samples, channels), complex."""
        if self.frequency == 0.0:
            return np.broadcast_to(self.gains, (len(time), len(self.gains)))
        return np.exp(2j * np.pi * self.frequency * time)[:, None] * self.gains


def extras(model: Model, data: Data, prediction: AnyPrediction) -> list[Extra]:
    """Offsets and lines of a record; a line has two, for its two phases."""
    eye = np.eye(len(data.channels))
    free = [c for c in data.channels if c in model.offset_channels]
    found = [Extra(f"{c} offset", eye[data.channels.index(c)], 0.0, None) for c in free]
    for n, effect in enumerate(model.transducer.effects):
        for channel in (*data.channels, data.drive):
            frequency = effect.line(channel)
            if frequency is None:
                continue
            # A line in the measured drive only is not in the actual drive: the prediction has it in all channels.
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
    """Samples (and channels) after a jump, at which the reading, between before and after, is a nuisance parameter.

    Its value is the reading without noise minus the measured one. A sample after two neighbouring jumps has only one.
    """
    after = {int(jump) + 1 + k for jump in data.setting.motion.jumps for k in range(MAX_DELAY_SAMPLES)}
    return [(sample, c) for sample in sorted(after) if sample < len(data) for c in range(len(data.channels))]


def nuisance_names(model: Model, data: Data) -> tuple[str, ...]:
    """Names of a record's nuisance parameters: initial states, jumps, first samples after these, offsets, lines."""
    prediction = model.prediction(data)
    first = (f"{data.channels[c]} sample{sample}" for sample, c in first_samples(data))
    return (*prediction.nuisance_names, *first, *(extra.name for extra in extras(model, data, prediction)))


def nuisance_limits(model: Model, data: Data) -> np.ndarray:
    """Largest magnitudes of a record's nuisance parameters."""
    limits = model.prediction(data).nuisance_limits
    return np.pad(limits, (0, len(nuisance_names(model, data)) - len(limits)), constant_values=np.inf)


def begun_effects(model: Model, data: object) -> tuple[int, ...]:
    """Index of the effect of each nuisance parameter that is the initial state of one, in a record of any kind."""
    return model.prediction(data).begun if isinstance(data, Data) else ()


def prediction_of(model: Model, data: Data, nuisance: np.ndarray) -> AnyPrediction:
    """Prediction of a record with initial states and jumps from its nuisance parameters."""
    return model.prediction(data, nuisance[: len(model.prediction(data).nuisance_names)])


def residual_blocks(
    model: Model, data: Data, nuisance: np.ndarray, derivatives: bool
) -> Iterator[tuple[AnyPrediction, int, np.ndarray, Any]]:
    """Blocks (prediction, begin, residuals, derivatives) of a record; `nuisance` in the order of `nuisance_names`.

    The residuals are those of the response to the drive without its noise.
    """
    first, more = first_samples(data), extras(model, data, model.prediction(data))
    states, read, added = np.split(nuisance, [len(nuisance) - len(first) - len(more), len(nuisance) - len(more)])
    prediction = model.prediction(data, states)
    h, effects = data.setting.sample_time, model.transducer.effects
    parts = SUBSAMPLES if any_delays(effects, data.channels) and prediction.bends else 1
    for block in _predicted(prediction, data, derivatives, parts):
        end = block.begin + len(block.values)
        time = (np.arange(block.begin, end) - 0.5 * len(data)) * h
        predicted, slopes = block.values, None
        if derivatives:
            slopes = _widened(block.derivatives, len(model.parameters) + len(nuisance))
        _add(model, more, added, time, predicted, slopes)
        abrupt = data.setting.abrupt and block.begin == 0
        course = Course(h, data.setting.jumps - block.begin, block.between, abrupt)
        predicted, slopes = sensed(effects, model.parameters, data.scatter, course, predicted, slopes)
        residual = data.part(block.begin, end) - predicted
        for k, (sample, c) in enumerate(first):
            if block.begin <= sample < end:
                # Independent of the prediction there, which is discontinuous in the jump's instant.
                residual[sample - block.begin, c] = -read[k]
                if slopes is not None:
                    slopes[sample - block.begin, c] = 0.0
                    slopes[sample - block.begin, c, k - len(first) - len(more)] = 1.0
        yield prediction, block.begin, residual, slopes


def _predicted(prediction: AnyPrediction, data: Data, derivatives: bool, parts: int) -> Iterator[Block]:
    """Blocks of a prediction, whose errors say which record they are about."""
    try:
        yield from prediction.blocks(derivatives, channels=data.channels, parts=parts)
    except (PredictionError, ParameterError) as error:  # the latter of a model without an equilibrium
        raise PredictionError(f"{data.name}: {error}") from None


def evaluated(model: Model, data: Data, nuisance: np.ndarray) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Blocks (begin, residuals, derivatives) of a record, read-only.

    Those of the last two models are cached if they are small: the next descent begins where the last one has ended,
    and a failed step may have been tried in between.
    """
    kinds = model.offset_channels, model.relaxed, model.at_rest, model.felt
    what = model.transducer, model.parameters, *kinds, nuisance.tobytes()
    for known, blocks in _CACHE.get(data, ()):
        if known == what:
            yield from blocks
            return
    blocks, room = [], CACHE_BYTES if data in _CACHE or len(_CACHE) < CACHED_RECORDS else 0
    for _, begin, residual, slopes in residual_blocks(model, data, nuisance, True):
        yield begin, residual, slopes
        room -= slopes.nbytes
        blocks = [*blocks, (begin, residual, slopes)] if room >= 0 else []
    if blocks:
        _CACHE[data] = [(what, blocks), *_CACHE.get(data, ())][:2]


def drive_noise_response(prediction: AnyPrediction, data: Data, begin: int, end: int) -> np.ndarray:
    """Response to the noise of the drive in some samples, (samples, channels), if it acted on the specimen.

    It is added after the sensors, not clipped by their range.
    """
    return small_response(prediction, data.channels, data.rest[begin:end])


def unexplained_blocks(
    model: Model, data: Data, nuisance: np.ndarray
) -> Iterator[tuple[AnyPrediction, int, np.ndarray]]:
    """Blocks (prediction, begin, residuals) of a record, minus the noise of the drive as filtered by the model."""
    for prediction, begin, residual, _ in residual_blocks(replace(model, parameters=()), data, nuisance, False):
        yield prediction, begin, residual - drive_noise_response(prediction, data, begin, begin + len(residual))


def _widened(derivatives: np.ndarray, count: int) -> np.ndarray:
    """Derivatives (samples, channels, p) with further columns of zeros.

    The samples are contiguous in memory, for the computation of their spectra.
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
