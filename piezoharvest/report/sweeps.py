"""Curves of a report: linear circuits on the exact two-port, others by simulation within a time budget."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.description.excitation import Excitation
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import Short, Shunt
from piezoharvest.description.system import System
from piezoharvest.design.operation import mean_nodes
from piezoharvest.engine import simulate, simulate_many
from piezoharvest.engine.batch import one_of
from piezoharvest.linear import frequency_response
from piezoharvest.report.limits import hysteretic
from piezoharvest.report.spans import design_band, drive_frequency
from piezoharvest.report.subjects import Subject
from piezoharvest.study import Study

BUDGET_SECONDS = 5.0  # s of simulation for one figure
MIN_POINTS = 5  # fewest points of a curve
_MOST_AT_ONCE = 32  # points simulated in one pass: what all have in common is then a small part of the work
_FINE_POINTS = 121  # loads of a curve from the two-port
_MAX_DIFFERENCE = 1e-3  # largest relative difference of two-port and simulation
_MEAN_ERROR, _MAX_NODES = 1e-3, 21


class Swept(NamedTuple):
    """Powers in W, displacement amplitude in m, attenuation in dB; NaN where there is no reliable answer."""

    harvested: float
    mechanical: float
    displacement: float
    attenuation: float


NO_ANSWER = Swept(*[float("nan")] * 4)


@dataclass(frozen=True, eq=False)
class CandidateCurve:
    """A candidate along one variable: load or frequency.

    Attributes
    ----------
    subject : Subject
    x : (n,) array
        Load in ohm or frequency in Hz.
    harvested, mechanical : (n,) array
        W.
    displacement : (n,) array
        m.
    attenuation : (n,) array
        dB against shorted electrodes at the same frequency.
    exact : bool
        True if computed from the two-port, False if simulated.
    """

    subject: Subject
    x: np.ndarray
    harvested: np.ndarray
    mechanical: np.ndarray
    displacement: np.ndarray
    attenuation: np.ndarray
    exact: bool

    @property
    def efficiency(self) -> np.ndarray:
        """Harvested over mechanical power."""
        with np.errstate(all="ignore"):
            return np.where(self.mechanical > 0, self.harvested / self.mechanical, np.nan)

    @property
    def missing(self) -> int:
        """Number of points without a reliable answer."""
        return int(np.sum(~np.isfinite(self.displacement)))


@dataclass
class CurveTracer:
    """Evaluates circuits in the operation of the study.

    Attributes
    ----------
    study : Study
    budget : float
        Seconds of simulation for one set of curves.
    cut_short : bool
        True if some curve has fewer points than requested, for lack of time.
    """

    study: Study
    budget: float = BUDGET_SECONDS
    cut_short: bool = field(default=False, init=False)

    def simulated(self, shunt: Shunt, excitation: Excitation) -> Swept:
        """One simulation."""
        try:
            r = simulate(System(self.study.transducer, shunt), excitation, samples=2)
        except (ParameterError, ValueError, np.linalg.LinAlgError):
            return NO_ANSWER
        if not r.converged:
            return NO_ANSWER
        return Swept(r.harvested_power, r.mechanical_power, r.displacement_amplitude, float(r.attenuation_db))

    def simulated_many(self, shunt: Shunt, excitation: Excitation, designs: int) -> np.ndarray:
        """Many simulations in one; (designs, 4) as in `Swept`. What differs between them is of shape (designs, 1)."""
        try:
            with np.errstate(all="ignore"):
                found = simulate_many(System(self.study.transducer, shunt), excitation, designs)
        except (ParameterError, ValueError, np.linalg.LinAlgError):  # which one of them is to blame for
            each = ((one_of(shunt, n), one_of(excitation, n)) for n in range(designs))
            return np.array([self.simulated(*one) for one in each])
        columns = ("harvested_power", "mechanical_power", "displacement_amplitude", "attenuation_db")
        points = np.stack([found[name] for name in columns], axis=-1)
        return np.where(found["converged"][:, None], points, np.nan)

    @property
    def strength(self) -> float:
        """Amplitude of the study's sine; 1 for other excitations."""
        return 1.0 if drive_frequency(self.study) is None else self.study.excitation.amplitude  # pyright: ignore

    def two_port(self, shunt: Shunt, frequencies: np.ndarray) -> list[np.ndarray]:
        """Arrays as in `Swept` for a sine of this strength at any frequencies (Hz), by exact linear algebra."""
        base, amplitude = self.study.excitation.base, self.strength
        found, short = (
            frequency_response(System(self.study.transducer, s), frequencies, base=base) for s in (shunt, Short())
        )
        square, displacement = amplitude**2, amplitude * np.abs(found.displacement)
        with np.errstate(all="ignore"):
            attenuation = 20 * np.log10(np.abs(found.displacement) / np.abs(short.displacement))
        return [square * found.harvested_power, square * found.mechanical_power, displacement, attenuation]

    def exact(self, subject: Subject) -> bool:
        """True if the two-port agrees with the simulation of a candidate, so that it can replace it."""
        found = subject.response
        if drive_frequency(self.study) is None or not subject.linear or found is None or not found.converged:
            return False
        if hysteretic(self.study.transducer) or not found.period > 0:
            return False
        power, _, displacement, _ = (x[0] for x in self.two_port(subject.shunt, np.array([1 / found.period])))
        pairs = ((power, found.harvested_power), (displacement, found.displacement_amplitude))
        return all(abs(one - other) <= _MAX_DIFFERENCE * abs(other) for one, other in pairs)

    def along_loads(self, subjects: Sequence[Subject], loads: np.ndarray) -> list[CandidateCurve]:
        """Curves of all candidates that have a load; with a fixed dc voltage V the load is V^2 over the power."""
        loaded = [s for s in subjects if s.load_field is not None and s.harvests]
        exact = [s for s in loaded if self.exact(s)]
        curves = [self._load_curve(s, loads) for s in exact]
        jobs = {}
        for s in loaded:
            if s not in exact:
                assert s.load_field is not None
                tuned = getattr(s.shunt, s.load_field)
                values = loads if s.load_field != "dc_voltage" else tuned * np.geomspace(0.05, 20, len(loads))
                jobs[s] = np.unique(np.append(values, tuned))
        for s, values, points in self._timed(jobs, self._operated, self._tuned):
            if s.load_field == "dc_voltage":
                with np.errstate(all="ignore"):
                    values = np.where(points[:, 0] > 0, values**2 / points[:, 0], np.nan)
            curves.append(CandidateCurve(s, values, *points.T, exact=False))
        return sorted(curves, key=lambda curve: curve.subject.rank)

    def linear(self, subjects: Sequence[Subject], frequencies: np.ndarray) -> list[CandidateCurve]:
        """Curves of the linear candidates on the two-port; empty with hysteresis."""
        if hysteretic(self.study.transducer):
            return []
        kept = [s for s in subjects if s.linear]
        return [CandidateCurve(s, frequencies, *self.two_port(s.shunt, frequencies), exact=True) for s in kept]

    def along_frequencies(
        self, subjects: Sequence[Subject], frequencies: np.ndarray, fine: np.ndarray
    ) -> list[CandidateCurve]:
        """Curves of all candidates for the study's sine at other frequencies; `fine` ones are used on the two-port."""
        exact = [s for s in subjects if self.exact(s)]
        curves = [CandidateCurve(s, fine, *self.two_port(s.shunt, fine), exact=True) for s in exact]
        jobs = {s: frequencies for s in subjects if s not in exact}

        def at(subject: Subject, some: np.ndarray) -> np.ndarray:
            return self.simulated_many(subject.shunt, self._sine(some[:, None]), len(some))

        curves += [CandidateCurve(s, x, *points.T, exact=False) for s, x, points in self._timed(jobs, at)]
        return sorted(curves, key=lambda curve: curve.subject.rank)

    def _tuned(self, subject: Subject, values: np.ndarray) -> dict[int, Sequence[float]]:
        """The tuned point of a curve along loads, by its index; it is not subject to the time budget."""
        r = subject.response
        assert subject.load_field is not None
        load = getattr(subject.shunt, subject.load_field)
        place = int(np.flatnonzero(values == load)[0])
        if r is None or not r.converged or design_band(self.study) is not None:
            return {place: self._operated(subject, np.array([load]))[0]}
        return {place: Swept(r.harvested_power, r.mechanical_power, r.displacement_amplitude, float(r.attenuation_db))}

    def against_short(
        self, curves: Sequence[CandidateCurve], fine: np.ndarray
    ) -> tuple[tuple[np.ndarray, np.ndarray], list[CandidateCurve]]:
        """Frequencies and displacement with shorted electrodes, and curves with the attenuation relative to it.

        Computed on the two-port without hysteresis: a simulation without damping has no steady state there.
        """
        if hysteretic(self.study.transducer):
            first = curves[0]
            return (first.x, first.displacement * 10 ** (-first.attenuation / 20)), list(curves)
        with np.errstate(all="ignore"):
            levels = [20 * np.log10(c.displacement / self.two_port(Short(), c.x)[2]) for c in curves]
        compared = [dataclasses.replace(c, attenuation=level) for c, level in zip(curves, levels, strict=True)]
        return (fine, self.two_port(Short(), fine)[2]), compared

    def _load_curve(self, subject: Subject, loads: np.ndarray) -> CandidateCurve:
        assert subject.load_field is not None
        frequencies, weights = self._nodes(subject)
        fine = np.geomspace(loads[0], loads[-1], _FINE_POINTS)
        values = np.unique(np.append(fine, getattr(subject.shunt, subject.load_field)))
        points = [x @ weights for x in self.two_port(subject.with_load(values[:, None]), frequencies)]
        return CandidateCurve(subject, values, *points, exact=True)

    def _operated(self, subject: Subject, loads: np.ndarray) -> np.ndarray:
        """A candidate with each of some loads in its operation: under the excitation itself, or averaged over the band.

        Returns an array (loads, 4) as in `Swept`.
        """
        if drive_frequency(self.study) is None:
            return np.array([self.simulated(subject.with_load(float(load)), self.study.excitation) for load in loads])
        frequencies, weights = self._nodes(subject)
        shunt = subject.with_load(np.repeat(loads, len(frequencies))[:, None])
        sine = self._sine(np.tile(frequencies, len(loads))[:, None] if len(frequencies) > 1 else frequencies[0])
        points = self.simulated_many(shunt, sine, len(loads) * len(frequencies))
        return weights @ points.reshape(len(loads), len(frequencies), -1)

    def _nodes(self, subject: Subject) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies in Hz and weights of the mean in a candidate's operation; one that was free is its own."""
        band, drive = design_band(self.study), subject.candidate.frequency or drive_frequency(self.study)
        if band is None:
            return np.array([drive]), np.ones(1)
        return mean_nodes(band, self.study.transducer, _MEAN_ERROR, _MAX_NODES)

    def _sine(self, frequency: Any) -> Excitation:
        return dataclasses.replace(self.study.excitation, frequency=frequency)

    def _timed(
        self,
        jobs: dict[Subject, np.ndarray],
        evaluate: Callable[[Subject, np.ndarray], np.ndarray],
        known=lambda *_: {},
    ):
        """Evaluate all jobs from coarse to fine until the time is up; (subject, x, points (n, 4)) of each.

        `known` returns, for a subject and its values, points by their index that need no simulation.
        """
        found = {subject: dict(known(subject, values)) for subject, values in jobs.items()}
        begin, slowest = time.monotonic(), dict.fromkeys(jobs, 0.0)  # s, the latter of a point
        for shares in _in_batches(_coarse_to_fine(max(map(len, jobs.values()), default=0))):
            for subject, values in jobs.items():
                places, now = {round(share * (len(values) - 1)) for share in shares}, time.monotonic()
                new = sorted(places - found[subject].keys())
                if new and now - begin + len(new) * slowest[subject] > self.budget:
                    self.cut_short = True
                elif new:
                    found[subject] |= zip(new, evaluate(subject, values[new]), strict=True)
                    slowest[subject] = max(slowest[subject], (time.monotonic() - now) / len(new))
        for subject, points in found.items():
            if len(points) >= MIN_POINTS:
                order = sorted(points)
                yield subject, jobs[subject][order], np.array([points[n] for n in order])


def _coarse_to_fine(count: int) -> list[float]:
    """Positions from 0 to 1 in an order in which every initial part is evenly spread: halves, quarters, eighths, ..."""
    shares, step = [0.5, 0.0, 1.0], 0.5
    while step * (count - 1) > 1:
        step /= 2
        shares += [n * step for n in range(1, round(1 / step), 2)]
    return shares


def _in_batches(shares: list[float]) -> Iterator[list[float]]:
    """Positions in small batches first, which tell how long one takes, and not too large ones then."""
    size = MIN_POINTS
    while shares:
        yield shares[:size]
        shares, size = shares[size:], min(2 * size, _MOST_AT_ONCE)
