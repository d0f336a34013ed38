"""Sampling of waveforms: sensor, disturbance, noise, range, converter; every channel in its SI unit."""

from __future__ import annotations

from collections.abc import Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from piezoharvest.bench.devices import Converter
from piezoharvest.bench.effects import BenchEffect
from piezoharvest.bench.settings import Bench
from piezoharvest.counting import counted
from piezoharvest.records.reading import channels as reading

# Columns and units of the channels that a record of the bench may have.
COLUMNS = MappingProxyType({
    "velocity": "velocity_m_s", "acceleration": "acceleration_m_s2", "dc_voltage": "dc_voltage_V",
    "dc_current": "dc_current_A", "gate": "gate", **reading.COLUMNS,
})  # fmt: skip
UNITS = MappingProxyType({
    "velocity": "m/s", "acceleration": "m/s^2", "dc_voltage": "V", "dc_current": "A", "gate": "", **reading.UNITS,
})  # fmt: skip
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
    """Channels of a record, the drive first: base acceleration where the base is driven, force otherwise.

    A gate is a logic input: it has no noise, and one step of the converter or none.
    """
    cell, meter, laser = bench.load_cell, bench.accelerometer, bench.laser
    buffer, sense = bench.buffer, bench.current_sense
    if base:
        drive = {"base_acceleration": Channel("accelerometer.sensitivity", meter.sensitivity, meter.noise)}
    else:
        drive = {"force": Channel("load_cell.sensitivity", cell.sensitivity, cell.noise)}
    speed, shaken, dc, through = bench.vibrometer, bench.moving_accelerometer, bench.dc_meter, bench.dc_sense
    known = {
        "displacement": Channel("laser.sensitivity", laser.sensitivity, laser.noise, laser.resolution),
        "voltage": Channel("buffer.gain", buffer.gain, buffer.noise),
        "current": Channel("current_sense.gain", sense.sensitivity, sense.noise),
        "velocity": Channel("vibrometer.sensitivity", speed.sensitivity, speed.noise),
        "acceleration": Channel("moving_accelerometer.sensitivity", shaken.sensitivity, shaken.noise),
        "dc_voltage": Channel("dc_meter.gain", dc.gain, dc.noise),
        "dc_current": Channel("dc_sense.gain", through.sensitivity, through.noise),
        "gate": Channel("", bench.converter.step, 0.0),
    }
    return drive | {name: channel for name, channel in known.items() if name in bench.channels}


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
    return codes * (converter.step / channel.sensitivity), _warning(name, channel, codes, lost, float(np.std(true)))


def _warning(name: str, channel: Channel, codes: np.ndarray, lost: int, signal: float) -> str:
    """What is wrong with the range or the noise of a channel whose true values have this standard deviation."""
    if channel.noise > signal > 0:  # below 0 dB
        device, ratio = channel.key.partition(".")[0], channel.noise / signal
        found = f"the noise of its sensor, {channel.noise:.3g} {UNITS[name]} (rms), is {ratio:.3g} times the signal"
        return f"{name}: {found}: choose another sensitivity and lower the noise of bench.{device}"
    if lost:
        samples = f"{lost} of {counted(len(codes), 'sample')} exceed{'s' if lost == 1 else ''}"
        return f"{name}: {samples} the range of the A/D converter: lower bench.{channel.key}"
    if signal > 0 and channel.key and np.ptp(codes) < FEW_STEPS:
        return (
            f"{name}: spans only {counted(int(np.ptp(codes)), 'step')} of the A/D converter: raise bench.{channel.key}"
        )
    return ""
