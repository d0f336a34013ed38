"""Campaigns in which something changes at once at a moment within one record, and stays so, by SciPy."""

import numpy as np
from diagnose.swept import LOAD, NOMINAL, RATE, TRUE, noisy
from scipy.integrate import solve_ivp
from sweeps import linear_sweep

from piezoharvest import Campaign

BEGINS = (0.0, 20.0, 60.0, 40.0)  # s since the campaign began: the last record is not fitted, and was not the last
SWEEPS = [(60.0, 130.0), (130.0, 60.0), (70.0, 140.0), (120.0, 70.0)]  # Hz
AMPLITUDES = (0.2, 0.5, 0.25, 0.3)  # N


def motion(amplitude, sweep, duration, change, at):
    """Samples of time, force, displacement and voltage; parameters change by the shares of `change` at a time.

    What stays as they change is where the mass is, how fast it moves, and the charge.
    """
    time, shape = np.arange(round(RATE * duration)) / RATE, linear_sweep(sweep[0], duration, sweep[1])

    def values(share):
        return (value * (1.0 + share * change.get(name, 0.0)) for name, value in TRUE.items())

    def rates(t, y, share):
        x, v, q = y.tolist()
        m, b, k, coupling, c = values(share)
        u = (q - coupling * x) / c
        return [v, (amplitude * shape(t) - b * v - k * x + coupling * u) / m, -u / LOAD]

    x = amplitude * shape(0.0) / TRUE["stiffness"]  # at rest under the first force, without a voltage
    found, y, options = (
        [],
        [x, 0.0, TRUE["coupling"] * x],
        {"rtol": 1e-9, "atol": [1e-12, 1e-10, 1e-15], "max_step": 1e-3},
    )
    at = min(max(at, 0.0), duration)
    for begin, end, share in ((0.0, at, 0.0), (at, duration, 1.0)):
        if end > begin:
            run = solve_ivp(rates, (begin, end), y, "DOP853", dense_output=True, args=(share,), **options)
            some = time[(time >= begin) & ((time < end) | (end == duration))]
            (x, _, q), (_, _, _, coupling, c) = run.sol(some), values(share)
            found, y = [*found, np.stack([x, (q - coupling * x) / c])], run.y[:, -1]
    x, u = np.concatenate(found, axis=1)
    return time, {"force_N": amplitude * shape(time), "displacement_m": x, "voltage_V": u}


def campaign(seed, moment, change=None, read=lambda time, channels: channels, duration=1.5):
    """Three fitted records and one that is not; `read` is what the sensors make of (campaign's time, true channels)."""
    rng, records = np.random.default_rng(seed), []
    for n, (begin, sweep, amplitude) in enumerate(zip(BEGINS, SWEEPS, AMPLITUDES, strict=True)):
        time, exact = motion(amplitude, sweep, duration, change or {}, moment - begin)
        shown = read(begin + time, exact)
        measured = {name: noisy(v, 1e-3 if name == "force_N" else 5e-3, rng, "white") for name, v in shown.items()}
        role = "validate" if n == len(BEGINS) - 1 else "fit"
        records.append(
            {"data": {"time_s": time, **measured}, "load_resistance": LOAD, "start_time": begin, "role": role}
        )
    return Campaign.from_arrays(NOMINAL, records)
