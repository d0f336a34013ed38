"""Every row of Tables I to IV simulated: steps of 5 s and release, sines, on each of the loads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from piezoharvest import Response, SineForce, StepForce, Transducer, simulate
from piezoharvest.records.power import PowerAnalysis, analyse
from reports.paper.model import loaded
from reports.paper.tables import Row, experiment

RECORD = 10.0  # s: over which the sines' energies are sums, as the tables have it
_SETTLING, _KEPT = 1.0, 2.0  # s of a simulated sine for the low-pass to settle, and after it: whole periods of each
_REST = 0.1  # s of a record before a step
_PERIOD_SAMPLES = 4000


class Signals(NamedTuple):
    """Samples at equal intervals, SI units; the current is that of the load."""

    time: np.ndarray
    force: np.ndarray
    displacement: np.ndarray
    voltage: np.ndarray
    current: np.ndarray


class Powers(NamedTuple):
    """Energies of one cycle (J) and peak powers (W).

    `mechanical_net` is the integral of F x', what the transducer has taken in; `mechanical_gross` that of |F x'|,
    which counts what the machine gets back as well.
    """

    electrical: float
    electrical_peak: float
    mechanical_net: float
    mechanical_gross: float
    mechanical_peak: float


@dataclass(frozen=True)
class Bench:
    """A specimen on the test machine.

    Attributes
    ----------
    device : Transducer
    rise_time : float
        Of the step force, s; the paper gives none.
    joint : callable, optional
        Displacement (m) that the sensor reads beside the specimen's, from the force (N).
    """

    device: Transducer
    rise_time: float = 0.0
    joint: Callable[[np.ndarray], np.ndarray] | None = None

    def reading(self, force: np.ndarray, displacement: np.ndarray) -> np.ndarray:
        """What the displacement sensor shows, m."""
        return displacement if self.joint is None else displacement + self.joint(force)


def sine_force(force: float, frequency: float) -> SineForce:
    """Sine between the offset and the maximum force (N)."""
    offset = experiment()["offset_N"]
    return SineForce(amplitude=0.5 * (force - offset), offset=0.5 * (force + offset), frequency=frequency)


@lru_cache(maxsize=1024)
def sine(bench: Bench, force: float, frequency: float, load: float) -> Response:
    """Steady state of a sine."""
    return simulate(loaded(bench.device, load), sine_force(force, frequency), samples=_PERIOD_SAMPLES)


@lru_cache(maxsize=256)
def step(bench: Bench, force: float, load: float) -> Response:
    """A load step and its release, from rest, sampled as in the paper."""
    hold, rate = experiment()["hold_s"], experiment()["sample_rate_Hz"]
    excitation = StepForce(amplitude=force, duration=hold, rise_time=bench.rise_time)
    return simulate(loaded(bench.device, load), excitation, samples=round(2 * hold * rate / 8))


def sampled(bench: Bench, response: Response) -> Signals:
    """The record that the converter makes of a response: a run after a moment of rest, a steady state as it goes on."""
    waves = response.waveforms
    assert waves is not None
    rate = experiment()["sample_rate_Hz"]
    # A steady state goes round; a run ends where its samples do, and begins from what np.interp goes on with: rest.
    periodic = waves.time[-1] < response.period * (1 - 1e-9)
    begin, end = (0.0, _SETTLING + _KEPT) if periodic else (-_REST, response.period)
    time = np.arange(round(begin * rate), round(end * rate) + 1) / rate
    period = response.period if periodic else None

    def resampled(values: np.ndarray) -> np.ndarray:
        return np.interp(time, waves.time, values, period=period)

    force = resampled(waves.drive)
    displacement = bench.reading(force, resampled(waves.displacement))
    return Signals(time, force, displacement, resampled(waves.voltage), resampled(waves.current))


@dataclass(frozen=True)
class Simulated:
    """A row as simulated: energies (J) of one cycle (step: load and release) and peak powers (W)."""

    row: Row
    load: float
    cycle: Powers
    converged: bool

    @property
    def energy(self) -> float:
        """What the row's header says, for one cycle: electrical, or mechanical energy taken in (net)."""
        return self.cycle.electrical if self.row.table in ("I", "II") else self.cycle.mechanical_net

    @property
    def peak(self) -> float:
        """Peak power of the row's domain."""
        return self.cycle.electrical_peak if self.row.table in ("I", "II") else self.cycle.mechanical_peak

    def summed(self, cycles: float) -> float:
        """Energy in the reading that the printed values suggest: of so many cycles, mechanical power by magnitude."""
        gross = self.cycle.electrical if self.row.table in ("I", "II") else self.cycle.mechanical_gross
        return cycles * gross


def simulated(bench: Bench, row: Row, load: float | None = None) -> Simulated:
    """Simulate a row; `load` (ohm) is needed for the sines, whose load the paper does not print."""
    load = row.load if load is None else load
    if load is None:
        raise ValueError(f"Table {row.table}, {row.label}: found no load, must be one of the paper's")
    if row.frequency is None:
        response, settling = step(bench, row.force, load), -_REST
    else:
        response, settling = sine(bench, row.force, row.frequency, load), _SETTLING
    cutoff = experiment()["filter_cutoff_Hz"]
    analysis = analyse(*sampled(bench, response), frequency=row.frequency, cutoff=cutoff)
    return Simulated(row, load, _cycle(analysis, settling), response.converged)


def _cycle(analysis: PowerAnalysis, settling: float) -> Powers:
    """Mean of the cycles that begin once the filters have settled (s), and the largest powers in them."""
    kept = analysis.boundaries[:-1] >= settling - 1e-9
    electrical, mechanical = analysis.electrical.cycles, analysis.mechanical.cycles
    return Powers(
        float(np.mean(electrical.net[kept])),
        float(np.max(electrical.peak_power[kept])),
        float(np.mean(mechanical.net[kept])),
        float(np.mean((mechanical.supplied + mechanical.returned)[kept])),
        float(np.max(mechanical.peak_power[kept])),
    )
