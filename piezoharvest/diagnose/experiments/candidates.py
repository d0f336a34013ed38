"""Planned records: sines and steps over all frequencies, loads and durations within reach."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from piezoharvest.description.excitation import Excitation, SineBase, SineForce, StepForce
from piezoharvest.description.shunts import Shunt
from piezoharvest.description.transducer import Transducer
from piezoharvest.diagnose.experiments.reach import DRIVES, Reach

NO_PRELOAD = 0.03  # mean of a drive, of its amplitude, below which a planned sine has none
FREQUENCIES = 9  # of sines, evenly spaced in their logarithms over the whole range
MAX_SAMPLES = 5000  # of a planned record: a slower sampling serves a longer one as well
SAMPLES_PER_PERIOD = 20  # at least
RISE_SHARE = 0.01  # of a step's duration: a bench that can only drive slowly cannot jump
SMALLER = 0.3  # times the full drive: of what depends on the level
SHORTER = (0.3, 0.1)  # times the longest duration


@dataclass(frozen=True)
class Planned:
    """A record that has not been measured.

    Attributes
    ----------
    excitation : Excitation
    shunt : Shunt
    duration, sample_rate : float
        s, Hz.
    """

    excitation: Excitation
    shunt: Shunt
    duration: float
    sample_rate: float

    @property
    def time(self) -> np.ndarray:
        """Sample instants, s."""
        return np.arange(max(int(self.duration * self.sample_rate), 3)) / self.sample_rate


def first_look(reach: Reach, transducer: Transducer) -> Iterator[Planned]:
    """Records of the full duration at the full drive: sines, and a step where the drive is a force."""
    lowest, highest = reach.frequency
    frequencies = np.geomspace(lowest, highest, FREQUENCIES).tolist()
    resonance = transducer.short_circuit_frequency
    if lowest < resonance < highest and not transducer.quasi_static:
        frequencies.append(resonance)
    middle, size = 0.5 * (reach.span[0] + reach.span[1]), 0.5 * (reach.span[1] - reach.span[0])
    if abs(middle) < NO_PRELOAD * size:  # of noise and rounding, which nobody means to repeat
        middle = 0.0
    kind = SineBase if DRIVES[reach.drive] else SineForce
    for shunt in reach.shunts:
        for frequency in frequencies:
            yield _sine(reach, kind(amplitude=size, frequency=frequency, offset=middle), shunt, reach.duration)
        if kind is SineForce:
            yield _step(reach, shunt, reach.duration)


def variants(reach: Reach, planned: Planned) -> Iterator[Planned]:
    """The same record shorter, and at a smaller drive."""
    for share in SHORTER:
        duration = share * planned.duration
        excitation = planned.excitation
        if isinstance(excitation, StepForce):
            yield _step(reach, planned.shunt, duration)
        elif duration * (excitation.frequency_hz or 0.0) >= 2.0:
            yield _sine(reach, excitation, planned.shunt, duration)
    yield scaled(planned, SMALLER)


def scaled(planned: Planned, factor: float) -> Planned:
    """The same record with a smaller drive, its lowest value kept."""
    excitation = planned.excitation
    amplitude = getattr(excitation, "amplitude")  # noqa: B009  (sines and steps have one)
    offset = getattr(excitation, "offset")  # noqa: B009
    if not isinstance(excitation, StepForce):
        offset -= (1.0 - factor) * amplitude if offset else 0.0
    return replace(planned, excitation=replace(excitation, amplitude=factor * amplitude, offset=offset))  # pyright: ignore


def _step(reach: Reach, shunt: Shunt, duration: float) -> Planned:
    """A step that is held for half of the record, and then released.

    Its corners are at samples: between them the drive would not be known there.
    """
    rate = _rate(reach, duration)
    half = max(round(0.5 * duration * rate), 2) / rate
    rise = max(math.ceil(max(RISE_SHARE * half, 0.5 / reach.frequency[1]) * rate), 1) / rate
    step = StepForce(amplitude=reach.span[1] - reach.span[0], offset=reach.span[0], duration=half,
                     rise_time=min(rise, half))  # fmt: skip
    return Planned(step, shunt, duration, rate)


def _sine(reach: Reach, excitation: Excitation, shunt: Shunt, duration: float) -> Planned:
    return Planned(excitation, shunt, duration, _rate(reach, duration, excitation.frequency_hz or 0.0))


def _rate(reach: Reach, duration: float, frequency: float = 0.0) -> float:
    """Sample rate of a record, as many samples as a long one needs: the highest divided by a whole number."""
    wanted = max(MAX_SAMPLES / duration, SAMPLES_PER_PERIOD * frequency)
    return reach.sample_rate / max(int(reach.sample_rate / wanted), 1)
