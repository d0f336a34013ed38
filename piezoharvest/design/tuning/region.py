"""Search region for the free fields of a shunt: a box in logarithms, and the quality of inductors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from piezoharvest.design.drafts import ANGLES, Draft
from piezoharvest.design.tuning.starts import Host, scales

SPAN = np.log(1e4)  # e-folds about a part's typical size
COIL_QUALITY = 100.0  # w L/R that coils and gyrators hardly exceed; without it a tuning ends in lossless resonances
_AT_BOUND = 0.01  # e-folds
MOST_LAG = 3.1  # rad: a switch acts later than the last extremum, and earlier than the one after the next
_SPANS = {"phase_lag": MOST_LAG, "on_time_error": 0.5}  # relative: later, the current has gone back and forth
_AT_BORDER = 1e-9  # e-folds: rounding errors of a point that is clipped to the region
_SERIES = {"series_rl": 1.0, "series_rlc": 1.0, "parallel_rl": -1.0, "parallel_rlc": -1.0}


def coordinates(values: Mapping[str, float]) -> np.ndarray:
    """Coordinates in which fields are tuned: logarithms, and what may be negative as it is."""
    return np.array([value if name in ANGLES else np.log(value) for name, value in values.items()])


def values_at(names: Sequence[str], p: np.ndarray) -> dict[str, Any]:
    """Values of fields from their coordinates; those of several designs (n, d) are columns (n, 1)."""
    columns = p if p.ndim == 1 else p.T[:, :, None]
    found = {name: x if name in ANGLES else np.exp(x) for name, x in zip(names, columns, strict=True)}
    return {name: float(x) for name, x in found.items()} if p.ndim == 1 else found


@dataclass(frozen=True, eq=False)
class Region:
    """Allowed values of the free fields of a draft, in the order of `draft.free`: logarithms, and angles as they are.

    Attributes
    ----------
    names : tuple of str
    lower, upper : (n,) array
    coil : (m, n) array
        Rows of the linear constraints coil @ p >= offset, one for each circuit of a coil and a resistance: that is no
        less (in parallel no more) than the one of an inductor of quality `COIL_QUALITY`.
    offset : (m,) array
    """

    names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    coil: np.ndarray
    offset: np.ndarray

    @classmethod
    def of(cls, draft: Draft, host: Host, max_inductance: float | None) -> Region:
        """Region of a draft across a host."""
        middle = coordinates(scales(draft, host))
        span = np.array([_SPANS.get(name, SPAN) for name in draft.free])
        lower, upper = middle - span, middle + span
        names = list(draft.free)
        largest = np.inf if max_inductance is None else max_inductance
        for n in (n for n, name in enumerate(names) if _is_inductance(name)):
            upper[n] = min(upper[n], np.log(largest))
            lower[n] = min(lower[n], upper[n] - SPAN)
        rows, offsets, eye = [], [], np.eye(len(names))
        for prefix, shunt in draft.branches():
            sign, pair = _SERIES.get(shunt.kind, 0.0), (f"{prefix}resistance", f"{prefix}inductance")
            if sign and set(pair) <= set(names):
                rows.append(sign * (eye[names.index(pair[0])] - eye[names.index(pair[1])]))
                offsets.append(sign * np.log(host.omega) - np.log(COIL_QUALITY))
        coil = np.reshape(rows, (len(rows), len(names)))
        return cls(draft.free, lower, upper, coil, np.array(offsets))

    def logs(self, values: Mapping[str, float]) -> np.ndarray:
        """Logarithms of values, clipped to the region."""
        return self.clip(coordinates({name: values[name] for name in self.names}))

    def values(self, p: np.ndarray) -> dict[str, float]:
        """Values from their logarithms."""
        return values_at(self.names, p)

    def clip(self, p: np.ndarray) -> np.ndarray:
        """A nearby point inside: clipped to the box, then with the resistance changed to keep the coil quality."""
        p = np.clip(p, self.lower, self.upper)
        for row, missing in zip(self.coil, self.offset - self.coil @ p, strict=True):
            if missing > 0:
                n = next(n for n in np.flatnonzero(row) if self.names[n].endswith("resistance"))
                p[n] += row[n] * missing
        return p

    def contains(self, p: np.ndarray) -> bool:
        """True if a point is inside, or at the border."""
        inside = np.all((p >= self.lower - _AT_BORDER) & (p <= self.upper + _AT_BORDER))
        return bool(inside and np.all(self.coil @ p >= self.offset - _AT_BORDER))

    def beside(self, name: str, value: float) -> Region:
        """Region of the other parts where one is held at a value.

        With a resistance held, the quality of its coil is left to `contains`.
        """
        n = self.names.index(name)
        names = self.names[:n] + self.names[n + 1 :]
        kept = (self.coil[:, n] == 0) | (not name.endswith("resistance"))
        offset = (self.offset - self.coil[:, n] * np.log(value))[kept]
        return Region(
            names, np.delete(self.lower, n), np.delete(self.upper, n), np.delete(self.coil[kept], n, axis=1), offset
        )

    def remarks(self, p: np.ndarray) -> list[str]:
        """Remarks on parts at the border of the region, in words."""
        found = []
        if np.any(self.coil @ p - self.offset < _AT_BOUND):
            found.append(
                f"the resistance is what a coil of quality {COIL_QUALITY:g} has by itself, nothing is left for a load"
            )
        for n, name in enumerate(self.names):
            if not _is_inductance(name) and min(p[n] - self.lower[n], self.upper[n] - p[n]) < _AT_BOUND:
                side = "smallest" if p[n] < 0.5 * (self.lower[n] + self.upper[n]) else "largest"
                found.append(f"the {side} {name} tried is the best: this part may be left out")
        return found


def _is_inductance(name: str) -> bool:
    """True for inductances of a shunt and of its branches, and for those of a synthesised network: L1, L2, ..."""
    return "inductance" in name or name[0] == "L"
