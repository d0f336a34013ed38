"""Measured frequency responses and impedances in a joint fit with time records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.ndimage import minimum_filter1d

from piezoharvest.description.shunts import Short
from piezoharvest.description.transducer import Transducer
from piezoharvest.identify.fitting.likelihood import Sums
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.frequency.line_noise import LineNoise
from piezoharvest.identify.frequency.response_reference import Reference, reference_of, relative
from piezoharvest.predict.parameters import STEP, stepped, value_at
from piezoharvest.predict.propagation.element_kinds import STOP
from piezoharvest.predict.record_model import LEADS, Matrices, RecordModel
from piezoharvest.records.record import FrequencyRecord

MAX_VALIDATION_RATIO = 1.2  # times the noise, from which on the residual of a validation record gives a warning
# Neighbouring lines, all off by this share of the response (3 dB): more than a spike.
MISSED_LINES = 3
MISSED_SHARE = 0.3
DEFAULT_RELATIVE_NOISE = 0.02  # relative noise of lines that are too few for an estimate, before a fit gives one


class ResponseSlopes(NamedTuple):
    """A response over frequency, (f,), and its derivatives, (f, parameters)."""

    value: np.ndarray
    slopes: np.ndarray

    def __add__(self, other: ResponseSlopes) -> ResponseSlopes:  # type: ignore[override]
        return ResponseSlopes(self.value + other.value, self.slopes + other.slopes)

    def __mul__(self, other: ResponseSlopes) -> ResponseSlopes:  # type: ignore[override]
        slopes = self.slopes * other.value[:, None] + self.value[:, None] * other.slopes
        return ResponseSlopes(self.value * other.value, slopes)

    def __truediv__(self, other: ResponseSlopes) -> ResponseSlopes:
        value = self.value / other.value
        return ResponseSlopes(value, (self.slopes - value[:, None] * other.slopes) / other.value[:, None])

    def __neg__(self) -> ResponseSlopes:
        return ResponseSlopes(-self.value, -self.slopes)


class ResponseQuality(NamedTuple):
    """Quality of a prediction of a response.

    Attributes
    ----------
    ratio : float
        Root mean square of the residual in units of the noise.
    lacking : bool
        True if it is larger than due to noise alone.
    missed : float or None
        Hz, where the prediction misses the response; None if nowhere.
    share : float
        Error in the worst lines, relative to the response.
    """

    ratio: float
    lacking: bool
    missed: float | None
    share: float


@dataclass(frozen=True, eq=False)
class FrequencyData:
    """A measured response prepared for a fit; see `data.Data`."""

    record: FrequencyRecord

    channels = ()
    sigma: Mapping[str, float] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        object.__setattr__(self, "sigma", {})

    @property
    def name(self) -> str:
        """The file."""
        return self.record.name

    @property
    def role(self) -> str:
        """Role of the record: "fit" or "validate"."""
        return self.record.role

    def __len__(self) -> int:
        return len(self.record)

    def matrices(self, transducer: Transducer, drive: str | None = None) -> Matrices:
        """Equations for the record's input, or for another drive; without coupling if the structure is blocked."""
        record = self.record
        drive = drive or ("voltage" if record.kind == "impedance" else record.input)
        if record.kind == "impedance" and record.mechanical == "blocked":
            still = tuple(replace(mode, coupling=0.0) for mode in transducer.modes)
            transducer = replace(transducer, coupling=0.0, modes=still)
        return RecordModel(transducer, record.shunt, drive, self._period).matrices()

    @property
    def _period(self) -> float:
        """Period of the highest frequency, s."""
        return 1.0 / float(self.record.frequency.max())

    def response(self, model: Model) -> tuple[np.ndarray, np.ndarray]:
        """Predicted response, operators sticking, (f,), and its derivatives, (f, parameters)."""
        record, varied = self.record, self._varied(model)
        if record.kind == "impedance":
            # The resistance of the leads in the model is subtracted.
            current, leads = self._transfer("current", varied, "voltage"), self._leads(varied)
            impedance = -1.0 / current.value - leads.value
            return impedance, current.slopes / current.value[:, None] ** 2 - leads.slopes
        if record.input == "voltage":
            return self._imposed(record.output, varied)
        found = self._transfer(record.output, varied, record.input)
        if isinstance(record.shunt, Short) and record.input in ("force", "base_acceleration"):
            current = found if record.output == "current" else self._transfer("current", varied, record.input)
            voltage = self._leads(varied) * current
            found = found + -(self._imposed(record.output, varied) * voltage)
        return found

    def _varied(self, model: Model) -> list[Transducer]:
        """The transducer, and copies with a complex step in each parameter."""
        device = model.transducer
        return [device, *(stepped(device, p, p.inner(value_at(device, p.path))) for p in model.parameters)]

    def _leads(self, varied: Sequence[Transducer]) -> ResponseSlopes:
        """Resistance of the leads through which a voltage is imposed, or the electrodes shorted, in `RecordModel`."""
        resistance = [LEADS * self._period / device.capacitance for device in varied]
        return ResponseSlopes(
            np.full(len(self), resistance[0]), np.tile(np.imag(resistance[1:]) / STEP, (len(self), 1))
        )

    def _imposed(self, output: str, varied: Sequence[Transducer]) -> ResponseSlopes:
        """Response of a channel to the voltage at the electrodes: that at the source minus R i of the leads."""
        current = self._transfer("current", varied, "voltage")
        share = self._leads(varied) * current
        found = current if output == "current" else self._transfer(output, varied, "voltage")
        return found / ResponseSlopes(1.0 + share.value, share.slopes)

    @cached_property
    def reference(self) -> Reference | None:
        """Model-free reference of the lines; None if they are too few."""
        return reference_of(self.record)

    @cached_property
    def sigma_of_lines(self) -> np.ndarray:
        """Standard deviation of each line's noise, in the response's unit and both its parts together, (f,)."""
        if self.reference is None:
            return DEFAULT_RELATIVE_NOISE * np.sqrt(2.0) * np.abs(self.record.response)
        noise = self.reference.noise
        return np.hypot(noise.along, noise.across) * np.abs(self.reference.smooth)

    @property
    def allowed(self) -> float:
        """Largest sum of squares, in units of the noise, of a complete model."""
        return np.inf if self.reference is None else self.reference.allowed

    def weighted(self, error: np.ndarray) -> np.ndarray:
        """Errors (f, ...) of the response in units of the noise: of the magnitudes, then of the phases, (2 f, ...)."""
        if self.reference is None:
            noise, smooth = LineNoise(*np.full((2, len(self)), DEFAULT_RELATIVE_NOISE)), self.record.response
        else:
            noise, smooth = self.reference.noise, self.reference.smooth
        inside = relative(error, smooth)
        shape = (-1, *[1] * (error.ndim - 1))
        parts = np.real(inside) / noise.along.reshape(shape), np.imag(inside) / noise.across.reshape(shape)
        return np.concatenate(parts)

    def judged(self, value: np.ndarray) -> ResponseQuality:
        """Quality of a prediction of the response, (f,)."""
        error = self.record.response - value
        squares = float(np.sum(self.weighted(error) ** 2))
        lacking = squares > (
            self.allowed if self.role == "fit" else max(self.allowed, MAX_VALIDATION_RATIO**2 * 2 * len(self))
        )
        # Relative to the larger one of the two, so that a peak in only one of them counts.
        share = np.abs(error) / np.maximum(np.abs(self.record.response), np.abs(value))
        together = minimum_filter1d(share, MISSED_LINES, mode="constant", cval=0.0)
        far = int(np.argmax(together))
        missed = float(self.record.frequency[far]) if lacking and together[far] > MISSED_SHARE else None
        return ResponseQuality(float(np.sqrt(squares / (2 * len(self)))), lacking, missed, float(together[far]))

    def _transfer(self, output: str, varied: Sequence[Transducer], drive: str) -> ResponseSlopes:
        """Transfer function from a drive to a channel."""
        real, *tangents = (self.matrices(device, drive) for device in varied)
        row = len(real.O) - len(real.channels) + real.channels.index(output)
        s = 2j * np.pi * self.record.frequency
        A, B, c, d = _sticking(real, row)
        n = len(A)
        resolvent = np.linalg.inv(s[:, None, None] * np.eye(n) - A)
        x = resolvent @ B
        left = c @ resolvent
        value = x @ c + d
        slopes = np.empty((len(s), len(tangents)), complex)
        for k, tangent in enumerate(tangents):
            dA, dB, dc, dd = (np.imag(part) / STEP for part in _sticking(tangent, row))
            slopes[:, k] = np.einsum("fi,fi->f", left, x @ dA.T + dB) + x @ dc + dd
        return ResponseSlopes(value, slopes)


def sticking_rates(data: FrequencyData, transducer: Transducer) -> tuple[np.ndarray, tuple[str, ...]]:
    """Matrix whose eigenvalues are the poles of a response, operators sticking, and the names of its states."""
    real = data.matrices(transducer)
    return _sticking(real, len(real.O) - 1)[0], real.states


def _sticking(m: Matrices, row: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C and D with every stop operator linear, as it is while it sticks."""
    n, w = len(m.A), len(m.kinds)
    stick = np.array(
        [m.O[place, :n] if kind == STOP else np.zeros(n) for kind, place in zip(m.kinds, m.places[:, 0], strict=True)]
    )
    stick = stick.reshape(w, n)
    return m.A + m.W @ stick, m.B[:, 0], m.O[row, :n] + m.O[row, n : n + w] @ stick, m.O[row, n + w]


class ResponseWeights:
    """Weights of a measured response by the noise of its lines, times a factor; see `likelihood.Whitener`."""

    def __init__(self, factor: float, data: FrequencyData) -> None:
        self.factor, self.data = factor, data

    def sums(self, model: Model, nuisance: np.ndarray, scatter: bool = False) -> Sums:
        """Sums of squares of the weighted residuals, all in the last band; see `likelihood.Sums`."""
        value, slopes = self.data.response(model)
        flat = self.data.weighted(self.data.record.response - value) / self.factor
        full = self.data.weighted(slopes) / self.factor
        sums = Sums.empty(len(model.parameters))
        sums.information[-1], sums.gradient[-1] = full.T @ full, full.T @ flat
        sums.squares[-1], sums.count[-1] = flat @ flat, len(flat)
        return sums
