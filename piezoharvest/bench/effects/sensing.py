"""Effects in the sensors, their wiring and the load."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from piezoharvest.bench.effects.base import BenchEffect
from piezoharvest.description.parameters import ParameterError, described, quantity
from piezoharvest.description.shunts.linear.resistor import Resistor

Channel = Literal["force", "base_acceleration", "displacement", "voltage", "current"]


@dataclass(frozen=True, kw_only=True)
class ContactCompliance(BenchEffect):
    """Hertzian contact between specimen and target: the sensor reads c F^(2/3) more, for compression (F > 0).

    Under tension it reads as much less.
    """

    name: ClassVar[str] = "contact_compliance"

    coefficient: float = quantity("m/N^(2/3)", "coefficient c of the joint", null=0.0)
    tension: Literal["open", "closed"] = described(
        "behaviour under tension: the joint opens, or is held closed", default="open"
    )

    def act(self, model, duration):
        """Add the contact's approach to what the sensor reads."""
        if model.base:
            raise ParameterError("coefficient", "found a base excitation, but this effect needs a force on the joint")
        specimen = model.sensed
        least = -np.inf if self.tension == "closed" else 0.0

        def reading(m):
            force = np.maximum(m.drive, least)
            return specimen(m) + self.coefficient * np.sign(force) * np.abs(force) ** (2 / 3)

        model.sensed = reading
        model.smooth = model.smooth or model.reading is not None


@dataclass(frozen=True, kw_only=True)
class DisplacementLag(BenchEffect):
    """First-order lag of the displacement sensor, settled before the record."""

    name: ClassVar[str] = "displacement_lag"

    time_constant: float = quantity("s", "time constant", at_least=0, null=0.0)

    def act(self, model, duration):
        """Add the reading as a state that follows the displacement."""
        if not self.time_constant:
            return
        if model.reading is not None:
            raise ParameterError("time_constant", "bench.laser.lag is given too, but only one of the two may be")

        def rate(m):
            return (model.sensed(m) - m.y[row]) / self.time_constant

        row = model.reading = model.add_state(model.transducer.stiffness, rate, lambda m: model.sensed(m))
        model.smooth = model.smooth or model.sensed != model.displacement


@dataclass(frozen=True, kw_only=True)
class ChannelSkew(BenchEffect):
    """Delay of voltage and current by `delay`."""

    name: ClassVar[str] = "channel_skew"

    delay: float = quantity("s", "delay of voltage and current", at_least=0, null=0.0)

    def lateness(self, channel):
        """The delay, of voltage and current."""
        return self.delay if channel in ("voltage", "current") else 0.0


@dataclass(frozen=True, kw_only=True)
class Clipping(BenchEffect):
    """Limit of a channel's range to +-limit."""

    name: ClassVar[str] = "clipping"

    limit: float = quantity("", "largest value, in the channel's unit", above=0, null=np.inf)
    channel: Channel = described("channel that has the fault")

    def span(self, channel):
        """The limit, of its channel."""
        return self.limit if channel == self.channel else np.inf


@dataclass(frozen=True, kw_only=True)
class MainsHum(BenchEffect):
    """Sinusoidal interference on a channel, with a random phase in each record."""

    name: ClassVar[str] = "mains_hum"

    amplitude: float = quantity("", "peak value, in the channel's unit", at_least=0, null=0.0)
    frequency: float = quantity("Hz", "mains frequency", above=0)
    channel: Channel = described("channel that has the fault")

    def disturbance(self, channel, time, rng):
        """The interference at these times, on its channel."""
        if channel != self.channel:
            return 0.0
        return self.amplitude * np.sin(2 * np.pi * (self.frequency * time + rng.random()))


@dataclass(frozen=True, kw_only=True)
class LoadError(BenchEffect):
    """Relative error e of all load resistors, or of those whose label is `resistance`."""

    name: ClassVar[str] = "load_error"

    relative_error: float = quantity("", "relative error e of the load", above=-1, null=0.0)
    resistance: float | None = quantity(
        "ohm", "nominal value of the load concerned; default: all loads", default=None, above=0
    )

    def connect(self, shunt):
        """The circuit with its load resistance larger by the error."""
        if isinstance(shunt, Resistor) and self.resistance in (None, shunt.resistance):
            return replace(shunt, resistance=shunt.resistance * (1.0 + self.relative_error))
        return shunt
