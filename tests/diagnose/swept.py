"""Campaigns of swept forces on a cantilever with one load, by SciPy: with noise, and with what a test hides in them."""

from functools import cache

import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import butter, lfilter
from sweeps import linear_sweep

from piezoharvest import Campaign

TRUE = {"mass": 0.0123, "damping": 0.21, "stiffness": 4200.0, "coupling": 2.1e-3, "capacitance": 62e-9}
NOMINAL = {"mass": 0.0123, "damping": 0.23, "stiffness": 4284.0, "coupling": 2.04e-3, "capacitance": 60e-9}
RATE, DURATION, LOAD = 4000.0, 1.0, 150e3  # Hz, s, ohm
SWEEPS = [(40.0, 160.0), (60.0, 130.0), (160.0, 50.0)]  # Hz


@cache
def motion(amplitude, sweep, duration, leakage=np.inf, spring=lambda x: 0.0):
    """Force, displacement and voltage by an explicit Runge-Kutta method of order 8; `spring` is a force beside k x.

    It is made once for all tests of a file that differ in their noise.
    """
    m, b, k, coupling, c = TRUE.values()
    time, ohm = np.arange(round(RATE * duration)) / RATE, 1.0 / (1.0 / LOAD + 1.0 / leakage)
    shape = linear_sweep(sweep[0], duration, sweep[1])

    def force(t):
        return amplitude * shape(t)

    def rates(t, y):
        x, v, u = y.tolist()
        return [v, (force(t) - b * v - k * x - spring(x) + coupling * u) / m, (-coupling * v - u / ohm) / c]

    options = {"method": "DOP853", "rtol": 1e-9, "atol": [1e-12, 1e-10, 1e-8], "max_step": 1e-3}
    x, _, u = solve_ivp(rates, (0.0, duration), [0, 0, 0], t_eval=time, **options).y
    return time, {"force_N": force(time), "displacement_m": x, "voltage_V": u}


def noisy(values, share, rng, kind):
    """Values with noise of a share of their own standard deviation."""
    size, white = share * values.std(), rng.standard_normal(len(values))
    if kind == "none":
        return values
    if kind == "low-pass":
        slow = lfilter(*butter(4, 0.4), white)
        return values + size * slow / slow.std()
    if kind == "of the reading":
        return values + share * np.abs(values) * white + 0.1 * size * white[::-1]
    return values + size * white


def campaign(
    kind, seed, amplitudes=(0.1, 0.5, 0.25), read=lambda voltage: voltage, crosstalk=None, duration=DURATION, **faults
):
    """Two fitted records and one that is not; `crosstalk`: what a displacement's reading has of (time, voltage)."""
    rng, records = np.random.default_rng(seed), []
    shares = {"force_N": 0.0 if kind == "of the reading" else 1e-3, "displacement_m": 5e-3, "voltage_V": 5e-3}
    for n, (amplitude, sweep) in enumerate(zip(amplitudes, SWEEPS, strict=True)):
        time, moved = motion(amplitude, sweep, duration, **faults)
        exact = dict(moved)
        if crosstalk is not None:
            exact["displacement_m"] = exact["displacement_m"] + crosstalk(time, exact["voltage_V"])
        exact["voltage_V"] = read(exact["voltage_V"])
        measured = {name: noisy(values, shares[name], rng, kind) for name, values in exact.items()}
        role = "validate" if n == len(amplitudes) - 1 else "fit"
        records.append({"data": {"time_s": time, **measured}, "load_resistance": LOAD, "role": role})
    return Campaign.from_arrays(NOMINAL, records)
