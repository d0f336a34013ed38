"""Voltage of the open electrodes under a sine, which a tracker takes its own from."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.memory import program as pg


def open_voltage(program: pg.Program) -> np.ndarray:
    """Peak voltage (V) of the open electrodes in the steady state of one tone, of each design of a batch.

    Parameters
    ----------
    program : Program
        Of open electrodes. Their charge is at rest, so that no hysteresis opens a loop; what else bends is taken as it
        is in small motions.

    Returns
    -------
    array
        Of shape (designs, 1) in a batch.
    """
    n = len(program.odd)
    at = n + pg.DERIVATIVES * len(program.element_power)  # where the sine of the tone stands
    own, driven = program.rate[..., 0, :, :n], program.rate[..., 0, :, at]
    # In parts that go with the sine and the cosine: complex numbers would take the imaginary part, which is that of a
    # derivative, for one of the phase.
    turning = np.asarray(program.omega)[..., None] * np.eye(n)
    turning, own = np.broadcast_arrays(turning, own)
    both = np.concatenate((np.concatenate((own, turning), -1), np.concatenate((-turning, own), -1)), -2)
    driven = np.concatenate((-driven, np.zeros_like(driven)), -1)
    states = np.linalg.solve(both, np.broadcast_to(driven, both.shape[:-1])[..., None])[..., 0]
    row = program.voltage_row[..., None, :n]
    parts = np.sum(row * states.reshape(*states.shape[:-1], 2, n), axis=-1)
    # The voltage of open electrodes is one of states: there is no part of it that the drive makes at once.
    peak = np.sqrt(parts[..., 0] ** 2 + parts[..., 1] ** 2) / np.asarray(program.exo_scale)[..., at - n]
    return peak[..., None] if peak.ndim else peak
