"""Sampling of waveforms: sensor, disturbance, noise, range, converter; every channel in its SI unit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from piezoharvest.bench.devices import Converter
from piezoharvest.bench.effects import BenchEffect
from piezoharvest.bench.settings import Bench

# A channel that moves by fewer steps of the converter gets a warning.
FEW_STEPS = 20


class Channel(NamedTuple):
    """One channel of the bench.

    Attributes
    ----------
    key : str
        Key of [bench] that sets its gain to the converter's range.
    sensitivity : float
        Converter volts per unit.
    noise : float
        Standard deviation of the noise before quantisation, in the unit.
    resolution : float
        Step of the sensor's own quantisation, in the unit; 0 for none.
    """

    key: str
    sensitivity: float
    noise: float
    resolution: float = 0.0

    def sigma(self, converter: Converter) -> float:
        """Standard deviation of the reading, in the unit: noise, and a twelfth of the squares of both steps."""
        steps = self.resolution**2 + (converter.step / self.sensitivity) ** 2
        return float(np.sqrt(self.noise**2 + steps / 12.0))


def channels(bench: Bench, *, base: bool) -> dict[str, Channel]:
    """Channels of a record, the drive first: base acceleration where the base is driven, force otherwise."""
    cell, meter, laser = bench.load_cell, bench.accelerometer, bench.laser
    buffer, sense = bench.buffer, bench.current_sense
    if base:
        drive = {"base_acceleration": Channel("accelerometer.sensitivity", meter.sensitivity, meter.noise)}
    else:
        drive = {"force": Channel("load_cell.sensitivity", cell.sensitivity, cell.noise)}
    return drive | {
        "displacement": Channel("laser.sensitivity", laser.sensitivity, laser.noise, laser.resolution),
        "voltage": Channel("buffer.gain", buffer.gain, buffer.noise),
        "current": Channel("current_sense.gain", sense.sensitivity, sense.noise),
    }


def sample(
    name: str,
    channel: Channel,
    time: np.ndarray,
    true: np.ndarray,
    converter: Converter,
    effects: Sequence[BenchEffect],
    rng: np.random.Generator,
) -> tuple[np.ndarray, str]:
    """Samples of a channel from its true values.

    Parameters
    ----------
    name : str
        Name of the channel, as effects refer to it.
    channel : Channel
    time, true : (n,) array
        s; the channel's unit. Samples are instantaneous: the bandwidth is not limited before the converter.
    converter : Converter
    effects : sequence of BenchEffect
    rng : numpy.random.Generator

    Returns
    -------
    values : (n,) array
        In the channel's unit.
    warning : str
        Message on a fault of the range; empty if there is none.
    """
    values = true + channel.noise * rng.standard_normal(len(true))
    for effect in effects:
        values = values + effect.disturbance(name, time, rng)
    if channel.resolution:
        values = channel.resolution * np.round(values / channel.resolution)
    span = min((effect.span(name) for effect in effects), default=np.inf)
    codes = np.round(np.clip(values, -span, span) * channel.sensitivity / converter.step)
    # Two's complement: the lowest code is -range, the highest one step below +range.
    top = 2 ** (converter.bits - 1)
    lost = np.sum((codes < -top) | (codes > top - 1))
    codes = np.clip(codes, -top, top - 1) + 0.0  # no negative zero
    return codes * (converter.step / channel.sensitivity), _warning(name, channel, codes, lost, np.ptp(true) > 0)


def _warning(name: str, channel: Channel, codes: np.ndarray, lost: int, moves: bool) -> str:
    if lost:
        return f"{name}: {lost} of {len(codes)} samples are beyond the converter's range: lower bench.{channel.key}"
    if moves and np.ptp(codes) < FEW_STEPS:
        return f"{name}: moves by {np.ptp(codes):.0f} steps of the converter only: raise bench.{channel.key}"
    return ""
