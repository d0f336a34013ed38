"""Effects of the displacement sensor on predicted samples: what it reads beside the specimen, and its lag."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.signal import lfilter

from piezoharvest.description.circuit import Row
from piezoharvest.description.transducer import Transducer
from piezoharvest.predict.parameters import STEP
from piezoharvest.predict.prediction import PredictionError

NEEDED = ("displacement", "velocity", "voltage", "current")


class Readings:
    """Samples in the place of rows, on which the effects of a transducer act as on equations.

    Only what they add to the displacement sensor is kept; what they add to the specimen is in the samples already.

    Parameters
    ----------
    transducer : Transducer
    drive_name : str
    samples : mapping of str to (n,) array
        The drive as "drive", and `NEEDED`; they may have complex steps.
    sample_time : float
        s.
    """

    reads, size = True, None

    def __init__(
        self, transducer: Transducer, drive_name: str, samples: Mapping[str, np.ndarray], sample_time: float
    ) -> None:
        self.transducer, self.drive_name = transducer, drive_name
        self.drive, self.x, self.u = samples["drive"], samples["displacement"], samples["velocity"]
        self.v, self.i = samples["voltage"], samples["current"]
        self.drive_rate = np.gradient(self.drive, sample_time) if len(self.drive) > 1 else 0.0 * self.drive
        self.one, self.time = np.ones_like(self.x), np.linspace(0.0, 1.0, len(self.x))
        self.v_t, self.q = self.v, 0.0 * self.x
        self.strain_charge = transducer.coupling * self.x
        self._step, self._read, self._lags = sample_time, [], []
        for effect in transducer.effects:
            effect.act(self)

    @property
    def differs(self) -> bool:
        """True if the sensor reads anything but the displacement."""
        return bool(self._read or self._lags)

    def displacement(self) -> np.ndarray:
        """What the sensor reads, (n,)."""
        read = self.x + sum(self._read)
        for time_constant in self._lags:
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
        """Add a displacement to the sensor's reading, m."""
        if channel != "displacement":
            raise PredictionError(f"behind diodes and switches no effect on the reading of the {channel} is predicted")
        self._read.append(row)

    def lag(self, time_constant: complex) -> None:
        """Put a first-order lag into the sensor."""
        self._lags.append(time_constant)

    def product(self, first: Row, second: Row) -> Row:
        """Product of two rows."""
        return first * second

    def power(self, row: Row, exponent: float, *, positive: bool = False) -> Row:
        """Power of a row, or of its positive part."""
        if not positive:
            return row**exponent
        return np.where(np.real(row) > 0, np.where(np.real(row) > 0, row, 1.0) ** exponent, 0.0)

    def hinge(self, row: Row, knot: complex, width: float) -> Row:
        """Excess of a row over a knot, zero below it."""
        return np.where(np.real(row) > np.real(knot), row - knot, 0.0)

    def state(self, name: str, storage: complex) -> tuple[Row, Row]:
        """Ignore a state of the specimen."""
        return 0.0 * self.x, 0.0 * self.x

    def stop(self, row: Row, threshold: complex) -> Row:
        """Ignore a stop of the specimen."""
        return 0.0 * self.x

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


def reads_more(transducer: Transducer, drive_name: str) -> bool:
    """True if the displacement sensor reads anything but the displacement."""
    nothing: dict[str, np.ndarray] = dict.fromkeys(("drive", *NEEDED), np.zeros(1))
    return bool(transducer.effects) and Readings(transducer, drive_name, nothing, 1.0).differs


def read_displacement(
    devices: Sequence[Transducer], drive_name: str, drive: np.ndarray, values: np.ndarray, slopes: np.ndarray,
    sample_time: float,
) -> None:  # fmt: skip
    """Overwrite the displacement by what its sensor reads.

    Parameters
    ----------
    devices : sequence of Transducer
        The transducer, then the same with a complex step for each derivative.
    drive_name : str
    drive : (n,) array
    values : (n, outputs) array
        `NEEDED` first.
    slopes : (n, outputs, lanes) array
        Their derivatives.
    sample_time : float
        s.
    """

    def sensor(device: Transducer, columns: np.ndarray) -> Readings:
        return Readings(device, drive_name, {"drive": drive, **dict(zip(NEEDED, columns.T, strict=True))}, sample_time)

    plain = sensor(devices[0], values[:, : len(NEEDED)])
    if not plain.differs:
        return
    found = [
        np.imag(sensor(device, values[:, : len(NEEDED)] + 1j * STEP * slopes[:, : len(NEEDED), s]).displacement())
        for s, device in enumerate(devices[1:])
    ]
    values[:, 0] = plain.displacement()
    for s, column in enumerate(found):
        slopes[:, 0, s] = column / STEP
