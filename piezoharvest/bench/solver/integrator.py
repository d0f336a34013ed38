"""Integration of a model from rest: steps between nodes, with location of every change of branch."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
from scipy.optimize import brentq

from piezoharvest.bench.solver.drive import Drive
from piezoharvest.bench.solver.model import Model, SolverError
from piezoharvest.bench.solver.radau import NODES
from piezoharvest.bench.solver.rest import rest
from piezoharvest.bench.solver.sizes import elastance, expected_sizes, voltage_rounding
from piezoharvest.bench.solver.stepper import Stepper, Trial
from piezoharvest.progress import Stage

# Tolerance of the estimated local error, relative to the size of each state. The estimate is of third order and the
# method of fifth: waveforms are far more accurate, which tests/records_bench measures.
TOLERANCE = 1e-7
# Smallest size of a state, relative to its value if it held all the energy.
MIN_SIZE = 1e-3
# The same of a circuit that may make much of what is small: an output that runs away from rest until it is at its limit
# has its phase from then on from its first moments.
MIN_ACTIVE = 1e-12
# The same of the electrode voltage, and its smallest size, relative to that of open electrodes.
VOLTAGE_TOLERANCE, MIN_VOLTAGE = 1e-6, 1e-6
# Rounding of an estimated error over that of the state.
ESTIMATED = 30.0
# A guard counts as crossed beyond this fraction of its size, which is above rounding.
SLACK = 1e-10
# Limits of trial steps in a run, and per interval between nodes: most records take one to three per interval, one with
# a preload and five operators 24 (measured; twice that is allowed). A hundred thousand take about a second.
MAX_TRIALS, TRIALS_PER_INTERVAL = 50_000, 50

_STAGES = np.append(0.0, NODES)
# Coefficients of the cubic through values at the start and the stages.
_CUBIC = np.linalg.inv(np.vander(_STAGES))


def _zero(function: Callable[[float], float], low: float, high: float, resolution: float) -> float:
    return brentq(function, low, high, xtol=resolution)  # pyright: ignore[reportReturnType]


def _root(values: np.ndarray) -> tuple[float, float]:
    """First upward zero crossing of the cubic through `values` at the start and the stages, and its slope there."""
    cubic = _CUBIC @ values
    above = int(np.argmax(values > 0.0))
    root = _zero(lambda s: float(np.polyval(cubic, s)), _STAGES[above - 1], _STAGES[above], 1e-12)
    return root, float(np.polyval(np.polyder(cubic), root))


class Integrator:
    """One run of a model from rest.

    Parameters
    ----------
    model : Model
    drive : Drive

    Attributes
    ----------
    states : (nodes, states) array
        At the nodes of the drive.
    branches : list of (int, tuple)
        First node at which branches of the model hold, and these; of two for one node the later is valid.
    steps, events : int
        Numbers of steps and events.
    """

    def __init__(self, model: Model, drive: Drive) -> None:
        self.model, self.drive = model, drive
        nodes, lengths = drive.nodes, np.diff(drive.nodes)
        self.drives = drive.within(np.arange(len(lengths))[:, None], nodes[:-1, None] + lengths[:, None] * _STAGES)
        self.force = float(self.drives[0, 0])
        self.t, self.y, self.h = float(nodes[0]), rest(model, drive.rest), float(lengths.max())
        expected = expected_sizes(model, drive)
        least = MIN_ACTIVE if model.circuit.active else MIN_SIZE
        rest_size = np.abs(self.y)
        stiff = elastance(model)
        least_energy = voltage_rounding(model, rest_size, stiff) / stiff**0.5 / TOLERANCE
        self.sizes = np.maximum(rest_size, max(least * expected.root_energy, least_energy) / model.scale)
        self.voltage = MIN_VOLTAGE * expected.voltage  # largest so far, V
        # Largest values at changes of branch so far of voltage, current, what the switch watches, and the rate of each
        # stop's coordinate. A current that begins at zero has its size from the voltage that drives it.
        self.peaks: dict[str | int, float] = {
            "V": expected.voltage,
            "A": 0.01 * model.circuit.surge * expected.voltage,
            "S": expected.turning,
        }
        self.least, self.resolution = 1e-12 * float(lengths.min()), 1e-9 * float(lengths.min())
        energy = expected.root_energy if np.any(self.drives) else 1.0
        reach = np.exp2(np.round(np.log2(energy / model.scale)))  # a power of two, by which nothing is rounded
        self.stepper = Stepper(model, self.sizes, reach, 1e-10 * float(lengths.min()))
        self.states = np.empty((len(nodes), len(self.y)))
        self.branches: list[tuple[int, tuple]] = []
        self.steps = self.events = 0
        self.kept = False  # whether steps of the next one's length are likely to be repeated
        self.seen = self.drives[0]  # drive at the start and the stages of the last step that was tried
        self.trials = MAX_TRIALS + TRIALS_PER_INTERVAL * len(self.drives)

    def run(self, stage: Stage | None = None) -> None:
        """Integrate from the first node to the last; a `stage` tells how far it is.

        Raises
        ------
        SolverError
            Steps become too short or too many.
        """
        with np.errstate(all="ignore"):
            self._enter(0)
            for interval in range(len(self.drives)):
                self.model.tie(self.t, self.y)
                self.states[interval] = self.y
                self._integrate_interval(interval)
                if stage is not None:
                    stage.reached(interval + 1, len(self.drives))
            self.states[-1] = self.y

    def _integrate_interval(self, interval: int) -> None:
        """Advance from one node to the next."""
        end, self.even = float(self.drive.nodes[interval + 1]), True
        self.force = float(self.drives[interval, 0])
        while end - self.t > self.least:
            if self.trials <= 0:
                most = MAX_TRIALS + TRIALS_PER_INTERVAL * len(self.drives)
                raise SolverError(f"more than {most} steps, on the way to {end:.9g} s: too many events, or too fast")
            until = min(end, self.model.circuit.due)
            if until < end:
                self.even = False
            if until - self.t > self.least:
                self._advance(interval, until, self._length(interval, until - self.t), ends=until == end)
            else:
                self._act(interval)
        self.t = end

    def _length(self, interval: int, left: float) -> float:
        """Length of the next step: a binary fraction of the interval, or of its rest after an event.

        With a switch or a clock, whose events are many, all that fits is a fraction of the interval, whose matrices are
        kept, and the rest is one step; under a clock that is kept, too.
        """
        if self.model.circuit.timed and not self.even and left <= self.h:
            self.kept = self.model.circuit.switch is None  # a clock leaves the same again and again
            return left
        binary = self.even or self.model.circuit.timed
        whole = float(self.drive.nodes[interval + 1] - self.drive.nodes[interval]) if binary else left
        self.kept = binary
        fits = min(left, self.h) * (1.0 + 1e-6)
        return whole if whole <= fits else whole / 2 ** math.ceil(math.log2(whole / fits))

    def _act(self, interval: int) -> None:
        """Let the circuit act at this instant."""
        self.events += 1
        model = self.model
        self._moment()  # which the circuit watches
        if model.circuit.act(self.y[model.own_rows.stop :]):
            model.discharge(self.t, self.y)
        model.tie(self.t, self.y)
        self._enter(interval + 1)

    def _advance(self, interval: int, end: float, h: float, *, ends: bool) -> None:
        """Try one step; accept it as a whole, up to its first event, or reject it.

        The last step goes up to `end`, which `ends` the interval or is an instant within it.
        """
        trial = self._try(interval, h)
        error = max(float((np.abs(trial[1]) / self.sizes).max()) / TOLERANCE, self._voltage_error(trial[1]))
        if not error <= 1.0:
            self._shorten(h, error)
            return
        passed = (trial[2] > 0.0).any()
        if passed:
            self.even = False
            h, trial, passed = self._locate(interval, h, trial)
        elif error < 1 / 32:
            self.h = max(self.h, 2.0 * h)
        last = abs(end - self.t - h) <= self.least
        self.t, self.y = end if last else self.t + h, trial[0][2].copy()
        self.force = float(self.drives[interval, 3] if last and ends else self.seen[3] if h else self.force)
        self.stepper.accept()
        self.steps += 1
        np.maximum(self.sizes, np.abs(self.y), out=self.sizes)
        self.voltage = max(self.voltage, abs(float(self.stepper.line.voltage @ np.append(self.y, 1.0))))
        if passed:
            self._fire(int(np.argmax(trial[2][2] / self.guard_sizes)))
            self._enter(interval + 1)
        elif self.stepper.stale:
            self.stepper.linearise(self.t, self.force, self.y)

    def _try(self, interval: int, h: float) -> Trial:
        self.trials -= 1
        keep, self.kept = self.kept, False
        whole = self.even and h == self.drive.nodes[interval + 1] - self.drive.nodes[interval]
        self.seen = self.drives[interval] if whole else self.drive.within(interval, self.t + h * _STAGES)
        return self.stepper.step(self.t, h, self.y, self.seen, keep=keep)

    def _shorten(self, h: float, error: float) -> None:
        """Recompute an outdated tangent, or else shorten the step according to an error of fourth order."""
        if self.stepper.stale and self.stepper.linearised_at != self.t:
            self.stepper.linearise(self.t, self.force, self.y)
            return
        self.h = h * 0.5 ** (math.ceil(math.log2(error) / 4) if error < 1e6 else 5)
        if self.h < self.least:
            raise SolverError(f"no step is short enough at {self.t:.9g} s: the equations have no solution there")

    def _locate(self, interval: int, h: float, trial: Trial) -> tuple[float, Trial, bool]:
        """Length of the step that ends at the first event, that step, and True if there is indeed an event."""
        before = self.stepper.guards(self.t, self.force, self.y) / self.guard_sizes
        stay = 0.0, (np.tile(self.y, (3, 1)), trial[1], np.tile(before * self.guard_sizes, (3, 1))), True
        if before.max() >= 0.0:
            return stay
        seen = np.vstack([before, trial[2] / self.guard_sizes])
        length, slope = min(_root(seen[:, j]) for j in np.flatnonzero((seen > 0.0).any(axis=0)))
        length, slope = length * h, slope / h
        for _ in range(4):
            if not (0.0 < length <= h and slope > 0.0):
                break
            trial = self._try(interval, length)
            value = float((trial[2][2] / self.guard_sizes).max())
            if abs(value) <= slope * self.resolution:
                return length, trial, True
            length -= value / slope

        def excess(length: float) -> float:
            guards = self._try(interval, length)[2][2] if length else before * self.guard_sizes
            return float((guards / self.guard_sizes).max())

        far = h * float(NODES[int(np.argmax((seen[1:] > 0.0).any(axis=1)))])
        # A stage may differ from the end of a step to its instant: then the event is later.
        while excess(far) <= 0.0 and far < h:
            far = h
        if excess(far) <= 0.0:
            return far, self._try(interval, far), False
        length = _zero(excess, 0.0, far, self.resolution)
        return (length, self._try(interval, length), True) if length else stay

    def _fire(self, guard: int) -> None:
        """Change the branch of the crossed guard; stops of the same coordinate reverse together."""
        self.events += 1
        own = self.model.circuit.guard_count
        timing = own + 2 * len(self.model.all_stops)
        if guard >= timing:
            assert self.model.circuit.switch is not None
            self.model.circuit.switch.turn(guard - timing, self.t, self._moment().v[0])
            return
        if guard < own:
            self._moment()  # which the circuit watches
            self.model.circuit.fire(guard)
            self.model.circuit.blocked(self.y[self.model.own_rows.stop :])
            self.model.tie(self.t, self.y)
            return
        stop = self.model.all_stops[(guard - own) // 2]
        turning = [other for other in self.model.all_stops if (other.row, other.side) == (stop.row, stop.side)]
        for other in turning if stop.side else [stop]:
            other.fire((guard - own) % 2, self.y)

    def _enter(self, node: int) -> None:
        """Adopt the model's present branches, which hold from the given node on."""
        model = self.model
        self.branches.append((node, model.branches))
        self.stepper.enter(self.t, self.force, self.y)
        m, switch = self._moment(), model.circuit.switch
        for key, value in [
            ("V", m.v),
            ("A", m.i),
            ("S", m.turning),
            *((stop.row, m.rates[stop.row]) for stop in model.all_stops),
        ]:
            self.peaks[key] = max(self.peaks.get(key, 1e-300), abs(float(value[0])))
        units = model.circuit.guard_units
        of_stops = [self.peaks[stop.row] if stop.side else stop.threshold for stop in model.all_stops]
        self.guard_sizes = np.array(
            [self.peaks[unit] for unit in units]
            + [size for size in of_stops for _ in "12"]
            + ([self.peaks["S"]] * 2 if switch else [])
        )
        slack = SLACK * self.guard_sizes
        voltages = [n for n, unit in enumerate(units) if unit == "V"]
        slack[voltages] += voltage_rounding(model, self.sizes, float(m.elastance[0]))
        if switch:  # an extremum just passed, or not quite, is not the next one
            slack[-2:] = np.maximum(slack[-2:], [float(np.squeeze(each)) for each in switch.guards(m.turning)])
        self.stepper.allow(slack)

    def _voltage_error(self, error: np.ndarray) -> float:
        """Error of the voltage over what is allowed: it may be a small difference of the charges that are states.

        It is so behind a coil that all but shorts the electrodes, and beside a capacitor that is much larger than they.
        """
        slope = self.stepper.line.voltage[:-1]
        rounding = voltage_rounding(self.model, self.sizes, float(slope[self.model.q_row]))
        return abs(float(slope @ error)) / max(VOLTAGE_TOLERANCE * self.voltage, ESTIMATED * rounding)

    def _moment(self) -> SimpleNamespace:
        """All quantities at this instant."""
        y = self.y[:, None]
        return self.model.moment(np.array([self.t]), np.array([self.force]), y, np.empty_like(y))
