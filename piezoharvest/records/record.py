"""Records as they have been read: signals in SI units over time, and frequency responses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.description.effects.circuit_value import CircuitValue
from piezoharvest.description.shunts import Shunt
from piezoharvest.description.shunts.switching import SynchronisedShunt
from piezoharvest.notebook import Shown, frame
from piezoharvest.records.gate import Edges, rising_edges
from piezoharvest.records.harmonics import Harmonics

Role = Literal["fit", "validate"]


@dataclass(frozen=True, eq=False)
class Signal:
    """One measured channel of a record.

    Attributes
    ----------
    values : (n,) array
        In the channel's SI unit.
    sigma : float or None
        Known standard deviation of the noise, in the same unit.
    file, column : str
        Source of the values; the column is empty if they follow from the sample rate.
    first_row : int or (n,) array of int
        Row of the first sample in the file, counted from 1, or of each if their rows are not consecutive.
    reverse : str
        Keys in [channels] with which the values have the other sign, as text.
    factor : float
        SI value of one of the unit in which they were taken to be.
    gain : float or None
        The gain that the campaign states, in the SI unit per raw unit.
    """

    values: np.ndarray
    sigma: float | None
    file: str
    column: str
    first_row: int | np.ndarray
    reverse: str = "gain = -1"
    factor: float = 1.0
    gain: float | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Record(Shown):
    """Channels measured at the same time.

    Attributes
    ----------
    name : str
        The file, as the campaign names it.
    key : str
        Key of its table in the campaign: "records.0".
    role : "fit" or "validate"
    drive : str
        The imposed channel: "force", "voltage", "displacement" or "base_acceleration".
    shunt : Shunt or None
        Shunt across the electrodes; None if the voltage is imposed and no shunt is given.
    start_time : float
        s since the campaign began.
    time : Signal
        s; raw time stamps if the file has them.
    signals : mapping of str to Signal
        By channel; the drive is one of them, and any other may be missing.
    fitted : tuple of CircuitValue
        Values of the shunt that are fitted.
    periodic : bool
        It is a few periods of a sine in steady state.
    frequency : float or None
        Of such a sine, Hz, if it is stated.
    """

    name: str
    key: str
    role: Role
    drive: str
    shunt: Shunt | None
    start_time: float
    time: Signal
    signals: Mapping[str, Signal]
    fitted: tuple[CircuitValue, ...] = ()
    periodic: bool = False
    frequency: float | None = None

    def __getitem__(self, channel: str) -> np.ndarray:
        """Values of a channel, or of "time", in its SI unit, (n,)."""
        return (self.time if channel == "time" else self.signals[channel]).values

    def __len__(self) -> int:
        return len(self.time.values)

    @property
    def heading(self) -> str:
        """Its name, how long it is, and its drive."""
        return f"{self.name}, {counted(len(self), 'sample')}, driven by {self.drive}"

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The range of each channel, SI units."""
        return [{"channel": name, "least": float(self[name].min()), "most": float(self[name].max())}
                for name in self.signals]  # fmt: skip

    def to_frame(self) -> Any:
        """The channels over time as a `pandas.DataFrame`, SI units; raises `ImportError` where pandas is missing."""
        found = frame({"time": self["time"], **{name: self[name] for name in self.signals}})
        return found.set_index("time")

    @property
    def numbers(self) -> int:
        """How many numbers it has in memory."""
        return len(self) * (1 + len(self.signals))

    def beginning(self, count: int) -> Record:
        """Record of the first samples, without copying; a few periods in steady state are not divided."""
        if self.periodic:
            return self

        def cut(signal: Signal) -> Signal:
            return replace(signal, values=signal.values[:count])

        signals = {channel: cut(signal) for channel, signal in self.signals.items()}
        return replace(self, time=cut(self.time), signals=signals)

    @property
    def responses(self) -> tuple[str, ...]:
        """Channels other than the drive."""
        return tuple(channel for channel in self.signals if channel != self.drive)

    @cached_property
    def gate(self) -> Edges | None:
        """When the switch was told to act; None where its own detector did, or nothing was recorded or can be used."""
        if "gate" not in self.signals or self.gate_reason:
            return None
        return rising_edges(self["gate"], 1.0 / self.sample_rate)

    @property
    def gate_reason(self) -> str:
        """Why a recorded gate is not used, or ""."""
        if self.drive == "voltage" or not isinstance(self.shunt, SynchronisedShunt):
            return "no switch depends on it"
        return "in steady state the displacement determines when the switch acts" if self.periodic else ""

    @property
    def duration(self) -> float:
        """Time from the first to the last sample, s."""
        return float(self.time.values[-1] - self.time.values[0])

    @cached_property
    def sample_rate(self) -> float:
        """Sample rate, Hz."""
        return (len(self) - 1) / self.duration

    @cached_property
    def harmonics(self) -> Harmonics | None:
        """Drive of a record in steady state, without its noise; None if it is no sine or the record no such one."""
        return Harmonics.of(self[self.drive], 1.0 / self.sample_rate, self.frequency) if self.periodic else None


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyRecord(Shown):
    """A measured frequency response: of one channel to another, or the impedance of the leads.

    Attributes
    ----------
    name, key, role, shunt, start_time
        As in `Record`; the shunt is None for an impedance.
    kind : "frf" or "impedance"
    input, output : str
        Channels; the response is output over input. An impedance is the voltage over the current INTO the leads.
    mechanical : "free" or "blocked"
        For an impedance, the mechanical boundary condition.
    frequency : (n,) array
        Hz, in ascending order; a frequency may occur several times, once for each sweep.
    response : (n,) complex array
        SI unit of the output over that of the input; e^(jwt).
    coherence : (n,) array or None
        From 0 to 1.
    columns : mapping of str to str
        Columns read, by quantity: "frequency", "real", "imaginary", "magnitude", "phase", "coherence".
    first_row : int or (n,) array of int
        As in `Signal`.
    """

    name: str
    key: str
    role: Role
    kind: Literal["frf", "impedance"]
    input: str
    output: str
    shunt: Shunt | None
    mechanical: Literal["free", "blocked"]
    start_time: float
    frequency: np.ndarray
    response: np.ndarray
    coherence: np.ndarray | None
    columns: Mapping[str, str]
    first_row: int | np.ndarray

    def __len__(self) -> int:
        return len(self.frequency)

    @property
    def responses(self) -> tuple[str, ...]:
        """The response, as output over input."""
        return (f"{self.output}/{self.input}",)

    @property
    def heading(self) -> str:
        """Its name, how many lines it has, and of which response."""
        return f"{self.name}, {counted(len(self), 'line')} of {self.responses[0]}"

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The ranges of frequency (Hz) and of the response's magnitude, SI units."""
        values = {"frequency": self.frequency, "magnitude": np.abs(self.response)}
        return [{"quantity": name, "least": float(x.min()), "most": float(x.max())} for name, x in values.items()]

    def to_frame(self) -> Any:
        """The response over the frequency (Hz) as a `pandas.DataFrame`, SI units; raises `ImportError`."""
        found = frame({"frequency": self.frequency, self.responses[0]: self.response})
        return found.set_index("frequency")

    @property
    def numbers(self) -> int:
        """How many numbers it has in memory."""
        return 4 * len(self)
