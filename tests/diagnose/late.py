"""Campaigns of a cantilever whose load conducts late: behind a first-order lag, or a while ago, by SciPy."""

import numpy as np
from diagnose.swept import DURATION, LOAD, NOMINAL, RATE, SWEEPS, TRUE, noisy
from scipy.integrate import solve_ivp
from sweeps import linear_sweep

from piezoharvest import Campaign

OPTIONS = {"method": "DOP853", "rtol": 1e-9, "atol": [1e-12, 1e-10, 1e-8, 1e-13], "max_step": 1e-3}


def lagging(amplitude, sweep, time_constant, share=1.0, duration=DURATION):
    """Samples of all channels; a share of the load's current follows its voltage by a first-order lag."""
    m, b, k, coupling, c = TRUE.values()
    time, shape = np.arange(round(RATE * duration)) / RATE, linear_sweep(sweep[0], duration, sweep[1])

    def rates(t, y):
        x, v, u, i = y.tolist()
        drawn = share * i + (1.0 - share) * u / LOAD
        acceleration = (amplitude * shape(t) - b * v - k * x + coupling * u) / m
        return [v, acceleration, (-coupling * v - drawn) / c, (u / LOAD - i) / time_constant]

    x = amplitude * shape(0.0) / TRUE["stiffness"]
    x, _, u, i = solve_ivp(rates, (0.0, time[-1]), [x, 0.0, 0.0, 0.0], t_eval=time, **OPTIONS).y
    current = share * i + (1.0 - share) * u / LOAD
    return time, {"force_N": amplitude * shape(time), "displacement_m": x, "voltage_V": u, "current_A": current}


def delayed(amplitude, sweep, delay, duration=DURATION):
    """The same with a current that is that of a while ago: by steps of the delay, in each of which it is known."""
    m, b, k, coupling, c = TRUE.values()
    time, shape = np.arange(round(RATE * duration)) / RATE, linear_sweep(sweep[0], duration, sweep[1])
    before, found = (lambda t: 0.0 * t), []
    y = [amplitude * shape(0.0) / TRUE["stiffness"], 0.0, 0.0]
    options = {**OPTIONS, "atol": OPTIONS["atol"][:3]}
    for n in range(int(np.ceil(time[-1] / delay))):

        def rates(t, y, late=before):
            x, v, u = y.tolist()
            acceleration = (amplitude * shape(t) - b * v - k * x + coupling * u) / m
            return [v, acceleration, (-coupling * v - late(t - delay) / LOAD) / c]

        begin, end = n * delay, (n + 1) * delay
        run = solve_ivp(rates, (begin, end), y, dense_output=True, **options)
        some = time[(time >= begin) & (time < end)]
        if len(some):
            found.append(np.vstack([run.sol(some), before(some - delay) / LOAD]))
        y, before = run.y[:, -1], (lambda t, sol=run.sol: sol(t)[2])
    x, _, u, i = np.concatenate(found, axis=1)
    return time, {"force_N": amplitude * shape(time), "displacement_m": x, "voltage_V": u, "current_A": i}


def campaign(seed, make, amplitudes=(0.1, 0.5, 0.25)):
    """Two fitted records and one that is not, of what `make(amplitude, sweep)` returns."""
    rng, records = np.random.default_rng(seed), []
    for n, (amplitude, sweep) in enumerate(zip(amplitudes, SWEEPS, strict=True)):
        time, exact = make(amplitude, sweep)
        measured = {name: noisy(v, 1e-3 if name == "force_N" else 5e-3, rng, "white") for name, v in exact.items()}
        role = "validate" if n == len(amplitudes) - 1 else "fit"
        records.append({"data": {"time_s": time, **measured}, "load_resistance": LOAD, "role": role})
    return Campaign.from_arrays(NOMINAL, records)
