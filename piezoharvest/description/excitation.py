"""Excitations of the structure: force or base acceleration as a sum of tones or as a piecewise linear signal."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import reduce
from math import gcd
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.description.parameters import Component, ParameterError, described, quantity, subclasses_by

if TYPE_CHECKING:
    from piezoharvest.readers.units import Unit

_quantity = quantity  # a field of `Record` has this name


class Tones(NamedTuple):
    """offset + sum amplitudes * sin(2 pi frequencies t + phases)."""

    frequencies: np.ndarray
    amplitudes: np.ndarray
    phases: np.ndarray
    offset: float = 0.0

    def at(self, times: np.ndarray) -> np.ndarray:
        """Value at the given times (s)."""
        angle = np.multiply.outer(np.asarray(times, float), 2 * np.pi * self.frequencies) + self.phases
        amplitudes = self.amplitudes
        if np.shape(amplitudes) != self.frequencies.shape:  # of one for all, which takes as long as the rest
            amplitudes = np.broadcast_to(amplitudes, self.frequencies.shape)
        return self.offset + np.sin(angle) @ amplitudes


class Ramps(NamedTuple):
    """Straight pieces: starts[n] + slopes[n] (t - times[n]) from times[n] to times[n + 1]; may jump between them."""

    times: np.ndarray
    starts: np.ndarray
    slopes: np.ndarray

    def at(self, times: np.ndarray) -> np.ndarray:
        """Value at the given times (s), constant beyond the ends."""
        times = np.clip(times, self.times[0], self.times[-1])
        n = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.starts) - 1)
        return self.starts[n] + self.slopes[n] * (times - self.times[n])


def ramps_through(times: np.ndarray, values: np.ndarray) -> Ramps:
    """First-order hold through samples; equal times give a jump."""
    step = np.diff(times)
    keep = step > 0
    slopes = np.divide(np.diff(values), step, out=np.zeros(len(step)), where=keep)
    return Ramps(np.append(times[:-1][keep], times[-1]), values[:-1][keep], slopes[keep])


@dataclass(frozen=True, kw_only=True)
class Excitation(Component):
    """Base of all excitations.

    `base` is True for base acceleration (m/s^2) and False for a force (N), unless `imposed` is True: the signal is then
    the acceleration (m/s^2) of the structure, whose motion is imposed. `batched` is True if quantities that are arrays
    (see `Component`) make a batch of signals.
    """

    kind: ClassVar[str]
    base: ClassVar[bool] = False
    imposed: ClassVar[bool] = False
    batched: ClassVar[bool] = False

    @property
    def period(self) -> float | None:
        """Period in s, or None for a signal without one."""
        return None

    @property
    def frequency_hz(self) -> float | None:
        """Drive frequency in Hz to which angles refer, or None."""
        return None if self.period is None else 1.0 / self.period

    @property
    def size(self) -> tuple[Any, Any] | None:
        """Amplitude and frequency (Hz) of a single sine, arrays in a batch; None for any other signal."""
        return None

    @property
    def length(self) -> float | None:
        """Length of the signal in s, or None if it is endless."""
        return None

    @property
    def samples(self) -> float:
        """Number of samples of the signal; 0 if it consists of tones or of a few straight pieces."""
        return 0

    @property
    def rest(self) -> float:
        """Static value before t = 0, at which the structure is in equilibrium."""
        return 0.0

    @property
    def antisymmetric(self) -> bool:
        """True if the signal changes sign from one half period to the next."""
        return False

    def signal(self) -> Tones | Ramps:
        """The excitation signal."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class _Sine(Excitation):
    batched: ClassVar[bool] = True

    amplitude: float = quantity("N or m/s^2", "peak value", at_least=0)
    frequency: float = quantity("Hz", "frequency of the sine", above=0)
    offset: float = quantity("N or m/s^2", "static value to which the sine is added", default=0.0)

    @property
    def period(self):
        return 1.0 / self.frequency

    @property
    def size(self):
        return self.amplitude, self.frequency

    @property
    def rest(self):
        return self.offset

    @property
    def antisymmetric(self):
        return bool(np.all(self.offset == 0))

    def signal(self):
        zero = np.zeros(1)
        return Tones(np.atleast_1d(self.frequency), np.atleast_1d(self.amplitude), zero, self.offset)


@dataclass(frozen=True, kw_only=True)
class SineForce(_Sine):
    """Force amplitude * sin(2 pi frequency t)."""

    kind: ClassVar[str] = "sine_force"


@dataclass(frozen=True, kw_only=True)
class SineBase(_Sine):
    """Base acceleration amplitude * sin(2 pi frequency t)."""

    kind: ClassVar[str] = "sine_base"
    base: ClassVar[bool] = True


@dataclass(frozen=True, kw_only=True)
class StepForce(Excitation):
    """Force that rises from the offset by the amplitude in the rise time, stays until `duration`, falls likewise."""

    kind: ClassVar[str] = "step_force"

    amplitude: float = quantity("N", "height of the step")
    duration: float = quantity("s", "time from the start of the rise to the start of the fall", above=0)
    rise_time: float = quantity("s", "duration of the rise, and of the fall", default=0.0, at_least=0)
    offset: float = quantity("N", "static preload", default=0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rise_time > self.duration:
            raise ParameterError(
                "rise_time", f"found {self.rise_time:g} s, must be at most duration ({self.duration:g} s)"
            )

    @property
    def length(self):
        """Two durations: constant, then released and observed for as long."""
        return 2 * self.duration

    @property
    def rest(self):
        return self.offset

    def signal(self):
        t = np.array([0.0, self.rise_time, self.duration, self.duration + self.rise_time, 2 * self.duration])
        return ramps_through(t, self.offset + self.amplitude * np.array([0.0, 1.0, 1.0, 0.0, 0.0]))


@dataclass(frozen=True, kw_only=True)
class Multisine(Excitation):
    """Force sum amplitudes * sin(2 pi frequencies t + phases)."""

    kind: ClassVar[str] = "multisine"

    amplitudes: tuple[float, ...] = quantity("N", "peak value of each tone")
    frequencies: tuple[float, ...] = quantity("Hz", "frequency of each tone", above=0)
    phases: tuple[float, ...] = quantity("rad", "phase of each tone")
    duration: float = quantity("s", "duration, a whole number of periods of every tone", above=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("amplitudes", "phases"):
            if len(getattr(self, name)) != len(self.frequencies):
                values = counted(len(getattr(self, name)), "value")
                found = f"found {values} for {counted(len(self.frequencies), 'frequency', 'frequencies')}"
                raise ParameterError(name, f"{found}, each frequency needs one")
        if not self.frequencies:
            raise ParameterError("frequencies", "found an empty list, at least one frequency is needed")

    @property
    def period(self):
        """Shortest common period of the tones, or None if `duration` is not a multiple of it."""
        cycles = [round(f * self.duration) for f in self.frequencies]
        whole = (abs(c - f * self.duration) <= 1e-9 * c for c, f in zip(cycles, self.frequencies, strict=True))
        return self.duration / reduce(gcd, cycles) if all(whole) else None

    @property
    def length(self):
        return self.duration

    @property
    def antisymmetric(self):
        period = self.period
        return period is not None and all(round(f * period) % 2 for f in self.frequencies)

    def signal(self):
        return Tones(np.array(self.frequencies), np.array(self.amplitudes), np.array(self.phases))


@dataclass(frozen=True, kw_only=True)
class _Random(Excitation):
    psd: float = quantity("N^2/Hz or (m/s^2)^2/Hz", "one-sided power spectral density", at_least=0)
    band: tuple[float, float] = quantity("Hz", "lower and upper limit of the band", at_least=0)
    duration: float = quantity("s", "duration of the realisation", above=0)
    seed: int = quantity("", "seed of the realisation", at_least=0)

    # Samples at the upper edge of the band: the straight pieces between them are compensated exactly below it.
    _OVERSAMPLING: ClassVar[int] = 16

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "band", tuple(self.band))
        if len(self.band) != 2 or not self.band[0] < self.band[1]:
            raise ParameterError("band", f"found {list(self.band)}, must be [lower, upper] with lower < upper (Hz)")
        if self.duration * (self.band[1] - self.band[0]) < 1:
            least = 1 / (self.band[1] - self.band[0])
            raise ParameterError(
                "duration", f"found {self.duration:g} s, must be at least {least:g} s (one over the bandwidth)"
            )

    @property
    def length(self):
        return self.duration

    @property
    def samples(self):
        return np.ceil(self._OVERSAMPLING * self.band[1] * self.duration)

    def signal(self):
        count = int(self.samples)
        step = self.duration / count
        f = np.fft.rfftfreq(count, step)
        inside = (f >= self.band[0]) & (f <= self.band[1]) & (f > 0)
        rng = np.random.default_rng(self.seed)
        # Gaussian lines a/duration apart; straight lines between samples attenuate each of them by sinc^2.
        lines = rng.normal(size=(2, inside.sum())) * np.sqrt(0.5 * self.psd / self.duration)
        spectrum = np.zeros(len(f), complex)
        spectrum[inside] = (lines[0] + 1j * lines[1]) * np.sqrt(0.5) * count / np.sinc(f[inside] * step) ** 2
        values = np.fft.irfft(spectrum, count)
        return ramps_through(np.arange(count + 1) * step, np.append(values, values[0]))


@dataclass(frozen=True, kw_only=True)
class RandomForce(_Random):
    """Gaussian force with a flat spectrum within a band."""

    kind: ClassVar[str] = "random_force"


@dataclass(frozen=True, kw_only=True)
class RandomBase(_Random):
    """Gaussian base acceleration with a flat spectrum within a band."""

    kind: ClassVar[str] = "random_base"
    base: ClassVar[bool] = True


@dataclass(frozen=True, kw_only=True)
class Samples(Excitation):
    """Samples joined by straight lines (first-order hold).

    Attributes
    ----------
    sample_rate : float
        Hz.
    values : (n,) array
        N or m/s^2.
    """

    sample_rate: float = quantity("Hz", "sample rate", above=0)
    values: np.ndarray = field(init=False, repr=False, compare=False)

    @property
    def length(self):
        return (len(self.values) - 1) / self.sample_rate

    @property
    def samples(self):
        return len(self.values)

    @property
    def rest(self):
        return float(self.values[0])

    def signal(self):
        # As `ramps_through`, but nothing is copied: a record of a day has 1e8 samples.
        times = np.arange(len(self.values), dtype=float)
        times /= self.sample_rate
        slopes = np.diff(self.values)
        slopes /= np.diff(times)
        return Ramps(times, self.values[:-1], slopes)


# Between the sample rate of a record and that of the times in its file, relative; their longest step, in samples.
_RATE_TOLERANCE, _LONGEST_STEP = 1e-3, 1.5
# SI unit of what may be recorded, and its name in messages.
_KINDS_OF_UNITS = {"force": ("N", "force"), "base_acceleration": ("m/s^2", "acceleration")}


@dataclass(frozen=True, kw_only=True)
class Record(Samples):
    """A recorded force or base acceleration, joined by straight lines between its samples.

    Attributes
    ----------
    quantity : "force" or "base_acceleration"
        What was recorded.
    unit : str
        Of the values, such as "kN" or "g"; default: that stated in the file, else N or m/s^2.
    gain : float
        In `unit`, per number in the file; if it is given, the unit stated in the file is ignored.
    file : str
        In any format of a campaign's records.
    column : str or int
        Its name, or its number counted from 1.
    skip_rows, header_row : int, optional
        Of a text file: number of skipped lines, and the line of the names.

    Raises
    ------
    ParameterError
        The file or the column does not exist, the column's unit or that given is not one of the quantity, the column
        holds values that are not finite numbers, or the file's own times have another sample rate, or a gap.
    """

    kind: ClassVar[str] = "record"

    file: str = described("data file")
    column: Any = described("name of the column, or its number counted from 1")
    quantity: Literal["force", "base_acceleration"] = described("quantity in the column", default="force")
    unit: str | None = described("unit of the values; default: that of the file, or the SI unit", default=None)
    gain: float | None = _quantity("", "gain: quantity per number in the file", default=None)
    skip_rows: int | None = _quantity("", "number of lines above the table", default=None, at_least=0)
    header_row: int | None = _quantity("", "number of the line with the column names", default=None, at_least=1)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.quantity not in _KINDS_OF_UNITS:
            allowed = " or ".join(map(repr, _KINDS_OF_UNITS))
            raise ParameterError("quantity", f"found {self.quantity!r}, must be {allowed}")
        if self.gain == 0:
            raise ParameterError("gain", "found 0, must be a finite number other than 0")
        object.__setattr__(self, "values", self._read())

    @property
    def base(self) -> bool:
        """True if a base acceleration was recorded."""
        return self.quantity == "base_acceleration"

    def _factor(self, stated: Unit | None, where: str) -> float:
        """Factor from the file's numbers to SI values, given the unit that the file states."""
        from piezoharvest.readers.units import unit_of

        si, words = _KINDS_OF_UNITS[self.quantity]
        given = None if self.unit is None else unit_of(self.unit)
        if self.unit is not None and (given is None or given.si != si):
            raise ParameterError("unit", f"found {self.unit!r}, must be a unit of {words}, as {si}")
        if self.gain is not None:
            return self.gain * (1.0 if given is None else given.factor)
        if stated is not None and stated.si != si and stated.firm:
            raise ParameterError("column", f"found the unit {stated.text!r} {where}, must be a unit of {words}")
        if stated is None or stated.si != si:
            return 1.0 if given is None else given.factor
        if given is not None and given.factor != stated.factor:
            found = f"found {self.unit!r}, but {stated.text!r} {where}"
            raise ParameterError("unit", f"{found}: give the same unit, or a gain (values for one of its numbers)")
        return stated.factor

    def _read(self) -> np.ndarray:
        from piezoharvest.readers import MissingColumnError, ReadError, open_reader
        from piezoharvest.readers.base import named_time

        if not isinstance(self.column, str) and not (type(self.column) is int and self.column > 0):
            raise ParameterError(
                "column", f"found {self.column!r}, must be the name of a column or its number, counted from 1"
            )
        if not Path(self.file).exists():
            raise ParameterError("file", f"the file {self.file!r} does not exist")
        lines = {"skip_rows": self.skip_rows, "header_row": self.header_row}
        try:
            with open_reader(Path(self.file), **{key: n for key, n in lines.items() if n is not None}) as reader:
                name, clock = reader.resolve(self.column), named_time(reader)
                read = reader.read([name] if clock in (None, name) else [name, clock])
                values, unit, times = read.pop(name), reader.unit(name), reader.time_of(name)
                if clock in read:
                    of_clock = reader.unit(clock)
                    times = read[clock] * (1.0 if of_clock is None else of_clock.factor)
                rows = reader.numbering
        except ReadError as error:
            where = self.file if error.row is None else f"{self.file}, row {error.row}"
            key = "column" if isinstance(error, MissingColumnError) else "file"
            raise ParameterError(key, f"{error.message} (in {where})") from None
        where = f"in column {name!r} of {self.file}"
        if np.any(np.imag(values)):
            raise ParameterError("column", f"found complex numbers {where}, allowed are real numbers")
        values = np.real(values) * self._factor(unit, where)
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            row = rows[bad[0]] if isinstance(rows, np.ndarray) else rows + bad[0]
            raise ParameterError("file", f"found {values[bad[0]]} {where}, row {row}, must be a finite number")
        if len(values) < 2:
            raise ParameterError(
                "file", f"found {counted(len(values), 'sample')} in {self.file}, allowed are two or more"
            )
        if times is not None and len(times) == len(values):
            self._check_times(times)
        return values

    def _check_times(self, times: np.ndarray) -> None:
        """Raise `ParameterError` if times (s) of the file are not those of the sample rate; any that fall are none."""
        steps = np.diff(times)
        if not (np.all(steps >= 0) and 0 < times[-1] - times[0] < np.inf):
            return
        rate, own = np.real(self.sample_rate), len(steps) / (times[-1] - times[0])
        # Where all times differ, a step of one and a half is none that was rounded.
        gap = int(np.argmax(steps)) if steps.min() > 0 and steps.max() * rate > _LONGEST_STEP else None
        if gap is not None and np.median(steps) * rate < _LONGEST_STEP:
            found = f"found a gap in the times of {self.file}, {steps[gap]:.6g} s after {times[gap]:.6g} s"
            raise ParameterError("file", f"{found}, must be even")
        if np.any(np.abs(own / rate - 1) > max(_RATE_TOLERANCE, 1 / len(steps))):
            found = f"found {self.sample_rate:.6g} Hz, but the times in {self.file} have {own:.6g} Hz"
            raise ParameterError("sample_rate", f"{found}: give the same one")


def registered() -> dict[str, type[Excitation]]:
    """All excitations by kind."""
    return subclasses_by("kind", Excitation)
