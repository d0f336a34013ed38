"""Every printed row beside its simulation: Table V as published, and the extended model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from reports.paper.candidates import ABSENT, Parameters
from reports.paper.extended import bench, extended_fit
from reports.paper.fitting import rms
from reports.paper.model import transducer
from reports.paper.rows import Bench, Simulated, simulated
from reports.paper.tables import Row, all_rows, experiment

READINGS = ("stop", "play", "none")


@dataclass(frozen=True)
class Compared:
    """A row and a simulation of it.

    Attributes
    ----------
    row : Row
    simulated : Simulated
    energy : float
        J, in the reading that is compared with the printed value.
    peak : float
        W.
    """

    row: Row
    simulated: Simulated
    energy: float
    peak: float

    @property
    def ratios(self) -> tuple[float, float]:
        """Simulated over printed, of energy and peak power."""
        return self.energy / self.row.energy.value, self.peak / self.row.peak.value


def table_bench(reading: str = "stop", rise_time: float = 0.0) -> Bench:
    """Table V as published, on a machine with the given rise time (the paper gives none)."""
    return Bench(transducer(reading), rise_time)


def _cycles(p: Parameters, row: Row) -> float:
    """Over how many cycles a printed energy is summed."""
    if row.frequency is not None:
        return p["record"] * row.frequency
    return p["step_cycles"] if row.table == "I" else p["stroke_cycles"]


def _sine_load(row: Row, number: int = 1) -> float:
    """Load of a row; for a sine one of the three, by default Table V's."""
    return experiment()["loads_ohm"][number] if row.load is None else row.load


@cache
def per_cycle(reading: str = "stop", sine_load: int = 1, rise_time: float = 0.0) -> tuple[Compared, ...]:
    """Rows as their headers have it: one cycle, net mechanical energy, steps that rise at once."""
    machine = table_bench(reading, rise_time)
    runs = [simulated(machine, row, _sine_load(row, sine_load)) for row in all_rows()]
    return tuple(Compared(run.row, run, run.energy, run.peak) for run in runs)


@cache
def summed(reading: str = "stop", sine_load: int = 1) -> tuple[Compared, ...]:
    """Table V with energies summed over records and mechanical power by magnitude, as the tables suggest.

    The sines' record is ten seconds. What belongs to the experiment and not to Table V, the cycles of the steps and the
    time in which the force rises, is that of the extended model's fit.
    """
    p = {**extended_fit().parameters, "record": ABSENT["record"]}
    runs = per_cycle(reading, sine_load, p["rise_time"])
    return tuple(Compared(c.row, c.simulated, c.simulated.summed(_cycles(p, c.row)), c.peak) for c in runs)


@cache
def extended() -> tuple[Compared, ...]:
    """Rows of the extended model, with all that its fit says of sums, force and peaks."""
    p = extended_fit().parameters
    machine = bench(p)
    found = []
    for row in all_rows():
        force = row.force * (p["force_750"] if row.force == 750.0 else 1.0)
        run = simulated(machine, row._replace(force=force), _sine_load(row))
        peak = run.peak * (p["peak_factor"] if row.table in ("III", "IV") else 1.0)
        found.append(Compared(row, run, run.summed(_cycles(p, row)), peak))
    return tuple(found)


def error(chosen: Sequence[Compared], table: str | None = None) -> float:
    """Root mean square of the logarithms of simulated over printed, of a table or of all."""
    return rms(np.log([c.ratios for c in chosen if table in (None, c.row.table)]))
