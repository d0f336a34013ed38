"""Loads of the solver with a controller, written from docs/equations.md."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from piezoharvest.bench.solver.loads.circuits import Circuit


class AdaptiveRL(Circuit):
    """Coil that adapts itself; states are its current, the filtered product of the detector, and L_0/L - 1.

    Its branch is 0 while it adapts, 1 where it is shortest and -1 where it is longest.
    """

    inductance: float
    resistance: float
    adaptation_rate: float
    averaging_time: float
    min_inductance: float | None
    max_inductance: float | None
    topology: str
    guard_count = 2
    smooth = True

    def __init__(self, shunt):
        super().__init__(shunt)
        least, most = self.min_inductance or self.inductance / 2, self.max_inductance or self.inductance * 2
        self.highest, self.lowest = self.inductance / least - 1, self.inductance / most - 1
        # A^2, of a product that adapts as fast as it is seen
        squared = 1 / (self.adaptation_rate * self.averaging_time)
        self.storage = (self.inductance, self.inductance / squared, self.inductance * squared)

    def flow(self, z, v, free, elastance):
        current, product, excess = z
        series = self.topology == "series"
        across = v - self.resistance * current if series else v
        moves = 0.0 * product if self.branch else self.adaptation_rate * product
        rates = (
            (1 + excess) * across / self.inductance,
            (current * self.turning - product) / self.averaging_time,
            moves,
        )
        return current if series else current + v / self.resistance, rates

    def guards(self, z, v, i):
        if self.branch:
            return [-self.branch * z[1], 0.0 * v - 1.0]
        return [z[2] - self.highest, self.lowest - z[2]]

    def fire(self, guard):
        self.branch = 0 if self.branch else 1 - 2 * guard


class Digital(Circuit):
    """Sampled filter behind a current source; its state is the current that is held."""

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    sample_time: float
    delay: float
    resolution: float
    saturation: float | None

    def __init__(self, shunt):
        from scipy.signal import bilinear

        super().__init__(shunt)
        filtered = bilinear(self.numerator, self.denominator, 1.0 / self.sample_time)
        above, self.below = (np.asarray(each, float) for each in filtered)
        self.above = np.pad(above, (len(self.below) - len(above), 0))
        self.inputs, self.outputs = np.zeros(len(self.above)), np.zeros(len(self.below) - 1)
        late = self.delay / self.sample_time % 1.0
        late = 0.0 if 1.0 - late < 1e-9 else late
        # The clock begins amid the longer part of it: before a current and after the sample, or the other way round.
        self.sample = self.sample_time * (0.5 * (1.0 - late) if late <= 0.5 else 1.0 - 0.5 * late)
        self.waiting: deque[tuple[float, float]] = deque()

    def meet(self, capacitance):
        self.storage = (self.sample_time**2 / capacitance,)

    @property
    def timed(self):
        return True

    @property
    def due(self):
        return min(self.sample, self.waiting[0][0]) if self.waiting else self.sample

    def act(self, z):
        if self.waiting and self.waiting[0][0] <= self.sample:
            z[0] = self.waiting.popleft()[1]
            return False
        read = float(self.voltage[0])
        if self.resolution:
            read = self.resolution * math.floor(read / self.resolution + 0.5)
        self.inputs = np.append(read, self.inputs[:-1])
        output = self.above @ self.inputs - self.below[1:] @ self.outputs
        self.outputs = np.append(output, self.outputs)[: len(self.outputs)]
        limit = math.inf if self.saturation is None else self.saturation
        self.waiting.append((self.sample + self.delay, float(np.clip(output, -limit, limit))))
        self.sample += self.sample_time
        return False

    def flow(self, z, v, free, elastance):
        return z[0] + 0.0 * v, (0.0 * z[0],)


CONTROLLED: dict[str, type[Circuit]] = {"adaptive_rl": AdaptiveRL, "digital": Digital}
