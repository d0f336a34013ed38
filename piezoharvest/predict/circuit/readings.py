"""Effects of sensors on predicted samples: what each reads beside the true value, and the displacement's lag."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from piezoharvest.description.circuit import Row
from piezoharvest.description.effects.nameless.numbers import Numbers
from piezoharvest.description.effects.nameless.sizes import RecordSizes, length_of
from piezoharvest.description.transducer import Transducer
from piezoharvest.predict.parameters import STEP
from piezoharvest.predict.prediction import PredictionError

NEEDED = ("displacement", "velocity", "voltage", "current")
OTHERS = ("acceleration", "dc_voltage", "dc_current")  # of which their own sensors alone may read a function


class SampledCourse(NamedTuple):
    """What passes while samples are taken, known without a prediction.

    Attributes
    ----------
    drive_name : str
    drive, time : (n,) array
        In its unit; as a share of the record.
    step : float
        s.
    size : (float, float) or None
        Amplitude and frequency of the drive.
    """

    drive_name: str
    drive: np.ndarray
    time: np.ndarray
    step: float
    size: RecordSizes | None = None


class Readings(Numbers):
    """Samples instead of rows, on which the effects of a transducer act as on equations.

    Only what they add to the readings of sensors is kept; what they add to the specimen is in the samples already.

    Parameters
    ----------
    transducer : Transducer
    samples : SampledCourse
    true : mapping of str to (n,) array
        True values of `NEEDED` and of other channels; they may have complex steps.
    """

    reads = True

    def __init__(self, transducer: Transducer, samples: SampledCourse, true: Mapping[str, np.ndarray]) -> None:
        self.transducer, self.drive_name, self.size = transducer, samples.drive_name, samples.size
        self.x, self.u, self.v, self.i = (true[name] for name in NEEDED)
        self.further = true
        self.drive, self.time, self._step = samples.drive, samples.time, samples.step
        self.elapsed = length_of(samples.size) * samples.time
        self.drive_rate = np.gradient(self.drive, self._step) if len(self.drive) > 1 else 0.0 * self.drive
        self.one = np.ones_like(self.x)
        self.v_t, self.q = self.v, 0.0 * self.x
        self.strain_charge = transducer.coupling * self.x
        self._read: dict[str, list[Row]] = {}
        self._lags: list[complex] = []
        for effect in transducer.effects:
            effect.act(self)

    @property
    def channels(self) -> set[str]:
        """Channels whose sensors read anything but the true value."""
        return {*self._read, *(["displacement"] if self._lags else [])}

    def of(self, channel: str) -> np.ndarray:
        """What the sensor of a channel reads, (n,)."""
        read = self.further[channel] + sum(self._read.get(channel, ()))
        if np.any(np.isnan(read)):
            raise PredictionError(f"behind diodes and switches no state is predicted that the sensor of {channel} has")
        for time_constant in self._lags if channel == "displacement" else ():
            read = self._lagging(read, time_constant)
        return read

    def _lagging(self, values: np.ndarray, time_constant: complex) -> np.ndarray:
        """First-order lag of samples joined by straight lines, settled before the first one."""
        if np.real(time_constant) == 0:
            # To first order a lag subtracts the velocity; this suffices for a derivative.
            return values - time_constant * self.u
        ratio = time_constant / self._step
        kept = np.exp(-1.0 / ratio)
        before, now = ratio * (1.0 - kept) - kept, 1.0 - ratio * (1.0 - kept)
        first = values[0] - time_constant * self.u[0]
        rest, _ = lfilter([now, before], [1.0, -kept], values[1:], zi=[kept * first + before * values[0]])
        return np.concatenate([[first], rest])

    # What effects call while they act.

    def read(self, row: Row, channel: str = "displacement") -> None:
        """Add to what the sensor of a channel reads, in the channel's unit."""
        if channel == self.drive_name:
            why = "but what its sensor shows besides is known only where a record's load is linear"
            raise PredictionError(f"found a law at reading.{channel}, which drives the record, {why}")
        self._read.setdefault(channel, []).append(row)

    def lag(self, time_constant: complex) -> None:
        """Put a first-order lag into the sensor."""
        self._lags.append(time_constant)

    def state(self, name: str, storage: complex) -> tuple[Row, Row]:
        """State of the specimen, which is not in the samples: no sensor may read it."""
        return np.nan * self.x, np.nan * self.x

    def stop(self, row: Row, threshold: complex) -> Row:
        """Stop operator of samples between which the row does not turn, started from zero."""
        found, now, limit = np.zeros(len(row), np.result_type(row, threshold)), 0.0, float(np.real(threshold))
        for k, rise in enumerate(np.diff(row), 1):
            now += rise
            if abs(now.real) > limit:
                now = np.sign(now.real) * threshold
            found[k] = now
        return found

    def equation(self, residual: Row) -> None:
        """Ignore an equation of the specimen."""

    def charge(self, row: Row) -> None:
        """Ignore a charge in the specimen."""

    def draw(self, row: Row) -> None:
        """Ignore a current in the specimen."""

    def conduct(self, row: Row) -> None:
        """Ignore a current through the load."""

    def push(self, row: Row, mode: int = 0) -> None:
        """Ignore a force on the specimen."""


def read_more(transducer: Transducer, drive_name: str) -> set[str]:
    """Channels whose sensors read anything but the true value."""
    if not transducer.effects:
        return set()
    nothing: dict[str, np.ndarray] = dict.fromkeys((*NEEDED, *OTHERS), np.zeros(1))
    return Readings(transducer, SampledCourse(drive_name, np.zeros(1), np.zeros(1), 1.0), nothing).channels


def read(
    devices: Sequence[Transducer], samples: SampledCourse, needed: tuple[np.ndarray, np.ndarray],
    channels: Mapping[str, int], values: np.ndarray, slopes: np.ndarray,
) -> None:  # fmt: skip
    """Overwrite channels by what their sensors read.

    Parameters
    ----------
    devices : sequence of Transducer
        The transducer, then the same with a complex step for each derivative.
    samples : SampledCourse
    needed : ((n, 4), (n, 4, lanes)) arrays
        True values of `NEEDED`, and their derivatives.
    channels : mapping of str to int
        Places of channels in what follows.
    values : (n, channels) array
    slopes : (n, channels, lanes) array
        Their derivatives.
    """
    own = list(channels.values())
    true, changes = (np.concatenate([a, b[:, own]], axis=1) for a, b in zip(needed, (values, slopes), strict=True))

    def sensors(device: Transducer, columns: np.ndarray) -> Readings:
        return Readings(device, samples, dict(zip((*NEEDED, *channels), columns.T, strict=True)))

    plain = sensors(devices[0], true)
    for s, device in enumerate(devices[1:]):
        moved = sensors(device, true + 1j * STEP * changes[..., s])
        for name, c in channels.items():
            slopes[:, c, s] = np.imag(moved.of(name)) / STEP
    for name, c in channels.items():
        values[:, c] = plain.of(name)
