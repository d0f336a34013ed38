"""The points of a sweep, for any range of its designs, without holding all of them."""

from __future__ import annotations

import warnings
from functools import cached_property
from typing import Any

import numpy as np

from piezoharvest.study import SweepOptions, SweepParameter

# Designs that are evaluated at a time and kept together: enough for compiled code to run at full speed, few enough for
# a small sweep to be spread over the cores and for little to be lost when it is killed.
_LARGEST_CHUNK, _SMALLEST_CHUNK, _CHUNKS = 1024, 64, 16


class Plan:
    """The designs of a sweep in their order, cut into chunks.

    In a grid the last parameter varies fastest.

    Parameters
    ----------
    options : SweepOptions

    Attributes
    ----------
    designs : int
        Number of designs.
    chunk : int
        Designs in a chunk (the last one may have fewer). Depends on the plan alone, not on who evaluates it.
    chunks : int
        Number of chunks.

    Notes
    -----
    The sequence of Sobol is scrambled (Owen, J. Complexity 14(4), 466-489, 1998) and balanced at powers of two.
    """

    def __init__(self, options: SweepOptions):
        self._options = options
        self.designs = options.designs
        self.chunk = min(max(-(-self.designs // _CHUNKS), _SMALLEST_CHUNK), _LARGEST_CHUNK)
        self.chunks = -(-self.designs // self.chunk)

    def range(self, chunk: int) -> range:
        """Numbers of the designs in a chunk."""
        return range(chunk * self.chunk, min((chunk + 1) * self.chunk, self.designs))

    def points(self, designs: range) -> np.ndarray:
        """Values of the parameters in a range of designs.

        Returns
        -------
        (n, p) array
            A row for each design, a column for each parameter, SI units.
        """
        parameters = self._options.parameters
        share = {"grid": self._grid, "random": self._random, "sobol": self._sobol}[self._options.method](designs)
        return np.column_stack([_between(parameter, share[:, n]) for n, parameter in enumerate(parameters)])

    def _grid(self, designs: range) -> np.ndarray:
        counts = [parameter.count or 1 for parameter in self._options.parameters]
        steps = np.unravel_index(np.arange(designs.start, designs.stop), counts)
        return np.column_stack([step / max(count - 1, 1) for step, count in zip(steps, counts, strict=True)])

    def _random(self, designs: range) -> np.ndarray:
        """Part of the numbers that numpy's default generator gives for this seed: one step of it for each number."""
        width = len(self._options.parameters)
        bits = np.random.PCG64(self._options.seed)
        bits.advance(designs.start * width)
        return np.random.Generator(bits).random((len(designs), width))

    def _sobol(self, designs: range) -> np.ndarray:
        sequence = self._sequence
        if designs.start < sequence.num_generated:
            sequence.reset()
        if designs.start > sequence.num_generated:
            sequence.fast_forward(designs.start - sequence.num_generated)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "The balance properties", UserWarning)
            return sequence.random(len(designs))

    @cached_property
    def _sequence(self) -> Any:
        """The sequence, which remembers where it stands: to go on is cheap, to go back is not."""
        from scipy.stats import qmc  # takes its time to import

        return qmc.Sobol(len(self._options.parameters), rng=self._options.seed)


def _between(parameter: SweepParameter, share: np.ndarray) -> np.ndarray:
    """Values that lie a share of the way from the first to the last one; exact at both ends."""
    ends = np.array([parameter.from_, parameter.to])
    if parameter.scale == "log":
        first, last = np.log10(ends)
        values = 10.0 ** (first + share * (last - first))
    else:
        values = ends[0] * (1 - share) + ends[1] * share
    values = np.where(share == 0, ends[0], np.where(share == 1, ends[1], values))
    return np.clip(values, ends.min(), ends.max())
