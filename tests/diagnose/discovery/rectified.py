"""Campaigns of specimens with a law behind a bridge rectifier, made with SciPy alone: three states, ended by events."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from nameless import BEAM, Drive, Laws
from scipy.integrate import solve_ivp

from piezoharvest.records import load_campaign

BRIDGE = {"smoothing_capacitance": 1e-6, "load_resistance": 3e5, "diode_drop": 0.4}
RATE, DURATION = 4000.0, 0.25  # Hz, s
DRIVES = (Drive((0.05,), (49.5,)), Drive((0.04,), (51.0,)), Drive((0.045,), (50.2,)))  # the last one for validation
NOISE = {"displacement": 3e-7, "voltage": 0.02}
UNITS = {"force": "N", "displacement": "m", "voltage": "V"}


def rectified(laws: Laws, drive: Callable, specimen=BEAM, bridge=BRIDGE, duration=DURATION, rate=RATE):
    """True channels of a record from rest: m x'' + b x' + k x = F + T v, C v' + T x' = -i, two diodes in every path."""
    m, b, k, T, C = (specimen[name] for name in ("mass", "damping", "stiffness", "coupling", "capacitance"))
    store, load, drop = bridge["smoothing_capacitance"], bridge["load_resistance"], 2.0 * bridge["diode_drop"]

    def slopes(t, y, side):
        x, u, v, dc = y
        force = drive(t) - b * u - k * x - laws.spring(x) - laws.damper(u) + T * v
        flow, own = -T * u - laws.electrodes(v), C + laws.capacitance(v)
        if side == 0:
            return [u, force / m, flow / own, -dc / load / store]
        rise = (side * flow - dc / load) / (own + store)  # of the dc side, and of the voltage on this side
        return [u, force / m, side * rise, rise]

    def conducts(t, y, side):
        return min(y[3] + drop - y[2], y[3] + drop + y[2]) if side == 0 else 1.0

    def blocks(t, y, side):  # the current, which charges the dc side
        return store * slopes(t, y, side)[3] + y[3] / load if side else 1.0

    conducts.terminal = blocks.terminal = True
    conducts.direction = blocks.direction = -1.0
    times = np.arange(round(duration * rate)) / rate
    found, t, y, side = [], 0.0, np.zeros(4), 0
    while True:
        left = times[times >= t]
        run = solve_ivp(
            slopes, (t, times[-1]), y, "DOP853", left, args=(side,), events=(conducts, blocks), rtol=1e-10,
            atol=1e-13, max_step=1.0 / rate,
        )  # fmt: skip
        found.append(run.y)
        if run.status == 0:
            break
        t, y = max((e[-1], tuple(s[-1])) for e, s in zip(run.t_events, run.y_events, strict=True) if len(e))
        side = 0 if side else int(np.sign(y[2]))
    x, _, v, dc = np.concatenate(found, axis=1)
    return {"time_s": times, "force": drive(times), "displacement": x, "voltage": v, "dc_voltage": dc}


def rectified_campaign(folder, laws: Laws, *, seed=0, off=0.03):
    """Campaign of `DRIVES`; nominal values are off."""
    rng, folder = np.random.default_rng(seed), Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    nominal = {name: value * (1.0 + off * rng.uniform(-1, 1)) for name, value in BEAM.items()}
    text = ["[transducer]", "quasi_static = false", *(f"{name} = {value!r}" for name, value in nominal.items())]
    for n, drive in enumerate(DRIVES):
        true = rectified(laws, drive)
        read = {name: true[name] + laws.reading[name](true) if name in laws.reading else true[name] for name in true}
        noisy = [read[name] + NOISE.get(name, 0.0) * rng.standard_normal(len(read["time_s"])) for name in UNITS]
        header = ",".join(["time_s", *(f"{name}_{unit}" for name, unit in UNITS.items())])
        table = np.column_stack([read["time_s"], *noisy])
        np.savetxt(folder / f"r{n}.csv", table, delimiter=",", header=header, comments="", fmt="%.12g")
        text += ["[[records]]", f'file = "r{n}.csv"', f'role = "{"validate" if n == len(DRIVES) - 1 else "fit"}"']
        text += ["[records.shunt]", 'kind = "rectifier"', *(f"{name} = {value!r}" for name, value in BRIDGE.items())]
    (folder / "campaign.toml").write_text("\n".join(text) + "\n")
    return load_campaign(folder / "campaign.toml")
