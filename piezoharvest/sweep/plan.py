"""The points of a sweep, for any range of its designs, without storing all of them."""

from __future__ import annotations

import warnings
from functools import cached_property
from typing import Any

import numpy as np

from piezoharvest.study import SweepOptions, SweepParameter

# Designs that are evaluated and stored together: enough for compiled code to run at full speed, few enough for
# a small sweep to use all cores and for little to be lost when it is killed.
_MAX_CHUNK, _MIN_CHUNK, _CHUNKS = 1024, 64, 16


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
        Designs in a chunk (the last one may have fewer). Depends on the plan alone, not on the workers.
    chunks : int
        Number of chunks.

    Notes
    -----
    The Sobol sequence is scrambled (Owen, J. Complexity 14(4), 466-489, 1998) and balanced at powers of two.
    """

    def __init__(self, options: SweepOptions):
        self._options = options
        self.designs = options.designs
        self.chunk = min(max(-(-self.designs // _CHUNKS), _MIN_CHUNK), _MAX_CHUNK)
        self.chunks = -(-self.designs // self.chunk)

    def range(self, chunk: int) -> range:
        """Indices of the designs in a chunk."""
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
        """The numbers of these designs from numpy's default generator with this seed: one step for each number."""
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
        """The sequence at its present position: advancing it is cheap, returning is not."""
        from scipy.stats import qmc  # slow to import

        return qmc.Sobol(len(self._options.parameters), rng=self._options.seed)


def _between(parameter: SweepParameter, share: np.ndarray) -> np.ndarray:
    """Values at a share of the way from the first to the last one; exact at both ends."""
    ends = np.array([parameter.from_, parameter.to])
    if parameter.scale == "log":
        first, last = np.log10(ends)
        values = 10.0 ** (first + share * (last - first))
    else:
        values = ends[0] * (1 - share) + ends[1] * share
    values = np.where(share == 0, ends[0], np.where(share == 1, ends[1], values))
    return np.clip(values, ends.min(), ends.max())
