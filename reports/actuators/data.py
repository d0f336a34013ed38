"""The two measured data sets, which lie in ../shared/data beside the project and are not copied into it."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

DATA = Path(__file__).parents[2].parent / "shared" / "data"
STACK, MIRROR = DATA / "picma_stack_hysteresis", DATA / "fast_steering_mirror"
LEVELS = (100, 200, 300)  # mV rms
MIRROR_RATE, STACK_RATE = 6400.0, 200.0  # Hz


class Loops(NamedTuple):
    """Voltage before the amplifier (V), displacement one sample later and displacement wanted (um).

    The displacement is that of the next row, as the paper's own figures have it: the sensor is read before the voltage
    of the row is put out.
    """

    voltage: np.ndarray
    displacement: np.ndarray
    wanted: np.ndarray


@lru_cache
def sine() -> Loops:
    """The 1 Hz sine, 40 cycles."""
    rows = np.loadtxt(STACK / "Model_Vi_Do.dat")
    return Loops(rows[:-1, 0], rows[1:, 4], np.full(len(rows) - 1, np.nan))


@lru_cache
def minor_loops() -> Loops:
    """The test file: loops that grow and shrink, first without, then with the authors' inverse."""
    rows = np.loadtxt(STACK / "Test_Vi_Do_Di.dat")
    return Loops(rows[:-1, 0], rows[1:, 4], rows[:-1, 8])


class Multisines(NamedTuple):
    """Voltages (V) and displacements (m), (samples, channels, realisations, periods)."""

    voltage: np.ndarray
    displacement: np.ndarray


@lru_cache
def multisines(level: int, part: str) -> Multisines:
    """Records of a level in mV, to `train` or to `test`."""
    return Multisines(*(np.load(MIRROR / f"{name}_{level}mV_{part}.npy") for name in "uy"))
