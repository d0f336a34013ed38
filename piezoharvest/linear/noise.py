"""Exact mean squares under white noise, by the Lyapunov equation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezoharvest.description.circuit import Row
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.system import System
from piezoharvest.linear.assembly import assemble


class MeanSquares(NamedTuple):
    """Stationary averages of a linear system under noise.

    Attributes
    ----------
    displacement, voltage : float
        Mean squares, m^2 and V^2.
    harvested_power : float
        W, the mean power into the load.
    """

    displacement: float
    voltage: float
    harvested_power: float


def white_noise_response(system: System, psd: float, *, base: bool = False) -> MeanSquares:
    """Stationary mean squares of a system with a linear shunt under white noise.

    Parameters
    ----------
    system : System
        The shunt must be linear, and every motion must die out.
    psd : float
        One-sided power spectral density of the force, N^2/Hz, or with `base` of the base acceleration, (m/s^2)^2/Hz.
    base : bool
        The noise is base acceleration instead of force.

    Raises
    ------
    ParameterError
        The shunt has switches or diodes, or the system has a pole on the imaginary axis or right of it: a motion or a
        charge that does not die out (open electrodes keep theirs).

    Notes
    -----
    The covariance X of the states solves A X + X A' + B B' S/2 = 0 (Kwakernaak & Sivan, Linear Optimal Control Systems,
    1972, section 1.11), on balanced states, as charge and displacement differ by many orders of magnitude.
    """
    from scipy.linalg import matrix_balance, solve_continuous_lyapunov

    model = assemble(system.transducer, system.shunt, base=base)
    a, b = model.dynamics()
    found = np.linalg.eigvals(a)
    if np.max(np.real(found)) >= -1e-9 * np.min(np.abs(found), initial=np.inf, where=np.abs(found) > 0):
        raise ParameterError("shunt", "found a motion or charge that does not decay, allowed are stable systems")
    balanced, (scale, _) = matrix_balance(a, separate=True, permute=False)
    drive = b / scale[:, None]
    covariance = solve_continuous_lyapunov(balanced, -0.5 * psd * drive @ drive.T)
    covariance = covariance * np.outer(scale, scale)

    def mean(first: Row, second: Row) -> float:
        one, other = (z + dz @ a for z, dz, _ in map(model.split, (first, second)))
        return float(one @ covariance @ other)

    rows, powers = model.rows, model.powers.get("harvested", ())
    power = sum(float(p.coefficient) * mean(p.first, p.second) for p in powers)
    displacement, voltage = (mean(rows[name], rows[name]) for name in ("displacement", "voltage"))
    return MeanSquares(displacement, voltage, power)
