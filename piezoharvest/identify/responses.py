"""Measured frequency responses and impedances beside time records in one fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from piezoharvest.identify.model import Model
from piezoharvest.identify.sums import Sums
from piezoharvest.predict.parameters import STEP, stepped, value_at
from piezoharvest.predict.specimen import STOP, Matrices, Specimen
from piezoharvest.records.record import FrequencyRecord
from piezoharvest.transducer import Transducer

FIRST_ERROR = 0.02  # relative, before the residuals tell


@dataclass(frozen=True, eq=False)
class FrequencyData:
    """A measured response as a fit takes it; see `data.Data`."""

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
        """Whether it is fitted: "fit" or "validate"."""
        return self.record.role

    def __len__(self) -> int:
        return len(self.record)

    def matrices(self, transducer: Transducer) -> Matrices:
        """Equations under the record's input; blocked, nothing moves."""
        record = self.record
        drive = "voltage" if record.kind == "impedance" or record.input == "voltage" else record.input
        if record.kind == "impedance" and record.mechanical == "blocked":
            still = tuple(replace(mode, coupling=0.0) for mode in transducer.modes)
            transducer = replace(transducer, coupling=0.0, modes=still)
        # Leads far faster than the highest frequency.
        return Specimen(transducer, record.shunt, drive, 0.01 / float(record.frequency.max())).matrices()

    def response(self, model: Model) -> tuple[np.ndarray, np.ndarray]:
        """Predicted response, operators sticking, (f,), and its derivatives, (f, parameters)."""
        real = self.matrices(model.transducer)
        tangents = []
        for parameter in model.parameters:
            inner = parameter.inner(value_at(model.transducer, parameter.path))
            tangents.append(self.matrices(stepped(model.transducer, parameter, inner)))
        value, slopes = self._transfer(real, tangents)
        if self.record.kind == "impedance":
            return -1.0 / value, slopes / value[:, None] ** 2
        return value, slopes

    def _transfer(self, real: Matrices, tangents: list[Matrices]) -> tuple[np.ndarray, np.ndarray]:
        """Transfer function from the drive, with derivatives."""
        output = "current" if self.record.kind == "impedance" else self.record.output
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
        return value, slopes


def _sticking(m: Matrices, row: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C and D with every stop operator as the straight line that it is while it sticks."""
    n, w = len(m.A), len(m.kinds)
    stick = np.array(
        [m.O[place, :n] if kind == STOP else np.zeros(n) for kind, place in zip(m.kinds, m.places[:, 0], strict=True)]
    )
    stick = stick.reshape(w, n)
    return m.A + m.W @ stick, m.B[:, 0], m.O[row, :n] + m.O[row, n : n + w] @ stick, m.O[row, n + w]


class ResponseWeights:
    """Weights of a measured response by its coherence and its relative error; see `sums.Whitener`."""

    def __init__(self, error: float, data: FrequencyData) -> None:
        self.error, self.data = error, data

    def sums(self, model: Model, own: np.ndarray, scatter: bool = False) -> Sums:
        """Sums of squares of the weighted residuals, which stand in the last band; see `sums.Sums`."""
        record = self.data.record
        value, slopes = self.data.response(model)
        sigma = self.error * relative_error(record) * np.abs(record.response)
        r, d = (record.response - value) / sigma, slopes / sigma[:, None]
        flat, full = np.concatenate([r.real, r.imag]), np.concatenate([d.real, d.imag])
        sums = Sums.empty(len(model.parameters))
        sums.information[-1], sums.gradient[-1] = full.T @ full, full.T @ flat
        sums.squares[-1], sums.count[-1] = flat @ flat, len(flat)
        return sums


def relative_error(record: FrequencyRecord) -> np.ndarray:
    """Error of each line by its coherence, but for a common factor (Bendat & Piersol, Random Data, 2010, 9.2)."""
    if record.coherence is None:
        return np.ones(len(record))
    coherence = np.clip(record.coherence, 1e-3, 1.0 - 1e-6)
    return np.sqrt((1.0 - coherence) / (2.0 * coherence))
