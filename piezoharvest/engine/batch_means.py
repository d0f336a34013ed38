"""Standard errors of averages over a run of noise: means of batches that are long enough to be independent.

Source: Law & Kelton, Simulation Modeling and Analysis, 3rd ed., 2000, section 9.5.3 (batch means).
"""

from __future__ import annotations

import numpy as np

from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.system import System

# A motion, or the voltage of the smoothing capacitor, has died out to exp(-5) = 0.7 % after so many time constants:
# what is left before the first batch is below the error, and batches of this length are independent of each other.
_DECAYS = 5.0
_MOST_BATCHES = 256  # an error of their standard error of 4 %
_LEAST_BATCHES = 8  # the same, 27 %: from fewer no error is told


def batch_edges(system: System, length: float) -> np.ndarray:
    """Edges (n + 1,) of the batches in s: after the motion from rest has died out, each as long as it takes to.

    Parameters
    ----------
    system : System
    length : float
        Of the run, s. One that is shorter than two batches has half of it for the beginning.
    """
    from piezoharvest.linear import poles

    plain = System(system.transducer, Shunt())
    found = np.concatenate([poles(System(system.transducer, ends.shunt)) for ends in (plain.shorted, plain.opened)])
    moving = found[np.imag(found) > 0]
    span = _DECAYS / float(np.min(-np.real(moving), initial=np.inf, where=np.real(moving) < 0))
    span = max(span, _DECAYS * _smoothing(system.shunt), length / _MOST_BATCHES)
    span = min(span, length / 2) if np.isfinite(span) else length / 2
    return np.linspace(span, length, max(int((length - span) / span), 1) + 1)


def standard_error(batches: np.ndarray) -> float:
    """Standard error of the mean of batches (n,); NaN from too few of them."""
    n = len(batches)
    return float(np.std(batches, ddof=1) / np.sqrt(n)) if n >= _LEAST_BATCHES else float("nan")


def rms_error(times: np.ndarray, values: np.ndarray, edges: np.ndarray) -> tuple[float, float]:
    """Root mean square of samples about their mean, and its standard error from the batches between edges."""
    squares = (values - np.mean(values)) ** 2
    rms = float(np.sqrt(np.mean(squares)))
    parts = np.split(squares, np.searchsorted(times, edges))[1:-1]
    error = standard_error(np.array([np.mean(part) for part in parts if len(part)]))
    return rms, error / (2 * rms) if rms > 0 else 0.0


def _smoothing(shunt: Shunt) -> float:
    """Time constant in s of a smoothing capacitor with its load; 0 without one."""
    capacitance, load = (getattr(shunt, name, None) for name in ("smoothing_capacitance", "load_resistance"))
    return float(capacitance * load) if capacitance and load else 0.0
