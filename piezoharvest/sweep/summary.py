"""Summary of a sweep."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from piezoharvest.study import Study
from piezoharvest.sweep.table import wanted_outputs

if TYPE_CHECKING:
    import pyarrow

# Criteria for the best row, the first available one; True if it should be large.
_MERITS = {"harvested_power": True, "attenuation_db": False}


@dataclass(frozen=True)
class SweepResult:
    """Result of a sweep; the table itself is in the file.

    Attributes
    ----------
    title : str
    out : Path
    designs, resumed : int
        Designs in the file, and the number of them that an earlier run had left.
    rows, converged, incomplete : int
        Rows (one for each design and shunt), those that converged, and of these the ones with a null output.
    seconds : float
        Duration of this run.
    units : tuple of dict
        Of the parameters by path, and of the outputs by name.
    best : dict or None
        Of the rows that converged, the one that harvests most (or, without harvested_power among the outputs, moves
        least): its columns by name.
    """

    title: str
    out: Path
    designs: int
    resumed: int
    rows: int
    converged: int
    incomplete: int
    seconds: float
    units: tuple[dict[str, str], dict[str, str]]
    best: dict[str, Any] | None

    @property
    def failed(self) -> int:
        """Rows that did not converge."""
        return self.rows - self.converged

    @property
    def designs_per_second(self) -> float:
        """Rate of this run."""
        return (self.designs - self.resumed) / self.seconds

    def as_json(self) -> dict[str, Any]:
        """The result in JSON types."""
        names = ("title", "designs", "resumed", "rows", "converged", "failed", "incomplete", "seconds")
        found = {name: getattr(self, name) for name in names}
        return {**found, "designs_per_second": self.designs_per_second, "out": str(self.out), "best": self.best}


class Summary:
    """Counts and the best row of a table that is read piece by piece."""

    def __init__(self, study: Study):
        self._outputs = wanted_outputs(study)
        self._merit = next((name for name in _MERITS if name in self._outputs), None)
        self.rows = self.converged = self.incomplete = 0
        self.best: dict[str, Any] | None = None

    def look(self, table: pyarrow.Table) -> None:
        """Update with the next rows."""
        converged = table["converged"].to_numpy()
        null = np.any([np.isnan(table[name].to_numpy()) for name in self._outputs], axis=0)
        self.rows += len(converged)
        self.converged += int(np.sum(converged))
        self.incomplete += int(np.sum(null & converged))
        if self._merit is None:
            return
        sign = 1.0 if _MERITS[self._merit] else -1.0
        values = np.where(converged, sign * table[self._merit].to_numpy(), np.nan)
        if np.all(np.isnan(values)):
            return
        row = int(np.nanargmax(values))
        if self.best is None or values[row] > sign * self.best[self._merit]:
            self.best = table.slice(row, 1).to_pylist()[0]
