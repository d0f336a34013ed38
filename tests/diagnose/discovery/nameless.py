"""Campaigns of specimens with a law that is in no file of the package, made with SciPy alone."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from piezoharvest.records import load_campaign

STACK = {"mass": 0.0158, "damping": 1250.0, "stiffness": 3.125e8, "coupling": 7.822, "capacitance": 3.2e-6}
BEAM = {"mass": 0.010, "damping": 0.0628, "stiffness": 986.96, "coupling": 1e-3, "capacitance": 40e-9}
NOISE = {
    "stack": {"force": 0.0, "displacement": 1.2e-8, "voltage": 1.5e-3, "current": 2e-8},
    "beam": {"force": 0.0, "displacement": 1e-7, "voltage": 3e-3, "current": 3e-8},
}
COLUMNS = {"force": "force_N", "displacement": "displacement_m", "voltage": "voltage_V", "current": "current_A"}


def nothing(x, *others):
    """The law of a healthy specimen."""
    return 0.0 * x


@dataclass(frozen=True)
class Laws:
    """What is added at each place; `capacitance` is the slope of a charge, `coupling` that of q_t.

    `loop` is a voltage over the current of a switched loop, `line` (ohm; H or F) what stands in line with its coil: a
    resistance beside an inductance, or what `of_line` names. `diode` is the current of a path over its voltage above
    the drops: where it is given, a path is no constant drop. `dc_load` is a current over the voltage behind a bridge.
    """

    spring: object = nothing
    damper: object = nothing
    electrodes: object = nothing
    load: object = nothing
    capacitance: object = nothing
    coupling: object = nothing
    loop: object = nothing
    line: tuple = ()
    of_line: str = "inductance"
    diode: object = None
    dc_load: object = nothing
    reading: dict = field(default_factory=dict)  # of the true channels, by channel


@dataclass(frozen=True)
class Drive:
    """Sum of sines and an offset, N."""

    amplitudes: tuple
    frequencies: tuple
    offset: float = 0.0

    def __call__(self, t):
        terms = (a * np.sin(2 * np.pi * f * t) for a, f in zip(self.amplitudes, self.frequencies, strict=True))
        return self.offset + sum(terms)


@dataclass(frozen=True)
class Gentle(Drive):
    """The same from its lowest value on, where it stands still: nothing jumps as a record begins."""

    def __call__(self, t):
        terms = (a * np.cos(2 * np.pi * f * t) for a, f in zip(self.amplitudes, self.frequencies, strict=True))
        return self.offset - sum(terms)


def record(specimen, laws, drive, load, duration, rate):
    """True channels of one record, from equilibrium under the offset: m x'' + b x' + k x = F + T v, q' = -i."""
    m, b, k, T, C = (specimen[name] for name in ("mass", "damping", "stiffness", "coupling", "capacitance"))

    def slopes(t, y):
        x, u, v = y.tolist()
        coupling, out = T + laws.coupling(x), v / load + laws.load(v) + laws.electrodes(v)
        force = drive(t) - b * u - k * x - laws.spring(x) - laws.damper(u) + coupling * v
        return [u, force / m, -(out + coupling * u) / (C + laws.capacitance(v))]

    t = np.arange(round(duration * rate)) / rate
    start = [drive(0.0) / k, 0.0, 0.0]
    # Absolute errors far below the noise of the sensors.
    run = solve_ivp(slopes, (0, t[-1]), start, "LSODA", t, rtol=1e-9, atol=[1e-13, 1e-9, 1e-8])
    x, _, v = run.y
    return {"time_s": t, "force": drive(t), "displacement": x, "voltage": v, "current": v / load + laws.load(v)}


def nameless_campaign(folder, kind, laws, records, *, rate=1000.0, duration=2.0, seed=0, off=0.05):
    """Campaign of `records`, (drive, load resistance), the last of which is for validation; nominal values are off.

    `laws` may be a function of the drive of a record.
    """
    specimen = {"stack": STACK, "beam": BEAM}[kind]

    def read(drive, load):
        own = laws(drive) if callable(laws) else laws
        true = record(specimen, own, drive, load, duration, rate)
        return {name: true[name] + (own.reading[name](true) if name in own.reading else 0.0) for name in true}

    return campaign_of(folder, kind, read, records, seed=seed, off=off)


def campaign_of(folder, kind, reading, records, *, seed=0, off=0.05):
    """Campaign of what `reading(drive, load)` returns of channels, with noise."""
    specimen, rng, folder = {"stack": STACK, "beam": BEAM}[kind], np.random.default_rng(seed), Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    nominal = {name: value * (1.0 + off * rng.uniform(-1, 1)) for name, value in specimen.items()}
    text = ["[transducer]", *(f"{name} = {value!r}" for name, value in nominal.items())]
    for n, (drive, load) in enumerate(records):
        read = reading(drive, load)
        noisy = [read[name] + NOISE[kind][name] * rng.standard_normal(len(read["time_s"])) for name in COLUMNS]
        table = np.column_stack([read["time_s"], *noisy])
        header = ",".join(["time_s", *COLUMNS.values()])
        np.savetxt(folder / f"r{n}.csv", table, delimiter=",", header=header, comments="", fmt="%.12g")
        role = "validate" if n == len(records) - 1 else "fit"
        text += ["[[records]]", f'file = "r{n}.csv"', f'role = "{role}"', f"load_resistance = {load!r}"]
    (folder / "campaign.toml").write_text("\n".join(text) + "\n")
    return load_campaign(folder / "campaign.toml")
