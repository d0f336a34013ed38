"""Sensors, amplifiers and converter of the bench, with those of the reference paper's section III as defaults.

Data of the devices that the paper names are used. Noise is white from sample to sample.
"""

from __future__ import annotations

from dataclasses import dataclass

from piezoharvest.description.parameters import Component, quantity


@dataclass(frozen=True, kw_only=True)
class LoadCell(Component):
    """Load cell with its amplifier: 25 kN at 10 V."""

    sensitivity: float = quantity("V/N", "sensitivity: converter voltage per newton", default=4e-4, above=0)
    noise: float = quantity("N", "standard deviation", default=0.5, at_least=0)


@dataclass(frozen=True, kw_only=True)
class Laser(Component):
    """Laser displacement sensor whose analogue output is set to 0.1 mm at 10 V; `resolution` is its digital step."""

    sensitivity: float = quantity("V/m", "sensitivity: converter voltage per metre", default=1e5, above=0)
    resolution: float = quantity("m", "smallest step of the reading, 0 for none", default=3e-8, at_least=0)
    lag: float = quantity("s", "time constant of its first-order lag", default=0.0, at_least=0)
    noise: float = quantity("m", "standard deviation of the noise, before the steps", default=1.2e-8, at_least=0)


@dataclass(frozen=True, kw_only=True)
class Buffer(Component):
    """Buffers at the electrodes, with their input resistance across them."""

    gain: float = quantity("", "gain: converter voltage per volt", default=1.0, above=0)
    input_resistance: float = quantity("ohm", "input resistance, across the electrodes", default=1e12, above=0)
    noise: float = quantity("V", "standard deviation", default=1.5e-3, at_least=0)


@dataclass(frozen=True, kw_only=True)
class CurrentSense(Component):
    """Sense resistor in the load's branch and its amplifier: INA213, whose 25 nV/sqrt(Hz) make 30 nA in 10 kHz.

    The resistor is part of the load: the nominal value of a load resistor includes it, a short is the sense resistor
    alone, and in other circuits it is neglected.
    """

    resistance: float = quantity("ohm", "sense resistor", default=100.0, above=0)
    gain: float = quantity("", "gain of the amplifier", default=50.0, above=0)
    noise: float = quantity("A", "standard deviation", default=3e-8, at_least=0)

    @property
    def sensitivity(self) -> float:
        """Converter voltage per ampere."""
        return self.resistance * self.gain


@dataclass(frozen=True, kw_only=True)
class Accelerometer(Component):
    """Accelerometer on the base, for base excitation; the paper has none: 10 V at 100 m/s^2."""

    sensitivity: float = quantity("V/(m/s^2)", "sensitivity: converter voltage per m/s^2", default=0.1, above=0)
    noise: float = quantity("m/s^2", "standard deviation", default=2e-3, at_least=0)


@dataclass(frozen=True, kw_only=True)
class Vibrometer(Component):
    """Laser vibrometer for the velocity: 10 V at 0.5 m/s, 1 um/s in the band of the converter."""

    sensitivity: float = quantity("V/(m/s)", "sensitivity: converter voltage per m/s", default=20.0, above=0)
    noise: float = quantity("m/s", "standard deviation", default=1e-6, at_least=0)


@dataclass(frozen=True, kw_only=True)
class DcMeter(Component):
    """Buffers at the dc side of a bridge, with a negligible load; `probe_loading` adds one."""

    gain: float = quantity("", "gain: converter voltage per volt", default=1.0, above=0)
    noise: float = quantity("V", "standard deviation", default=1.5e-3, at_least=0)


@dataclass(frozen=True, kw_only=True)
class Converter(Component):
    """Analogue-to-digital converter. It has no anti-alias filter: frequencies above half the sample rate are folded."""

    bits: int = quantity("", "resolution in bits", default=16, at_least=4, at_most=32)
    range: float = quantity("V", "largest voltage of the range, of either sign", default=10.0, above=0)

    @property
    def step(self) -> float:
        """Voltage of the last bit."""
        return 2.0 * self.range / 2**self.bits
