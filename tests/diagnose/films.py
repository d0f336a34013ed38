"""Campaigns of quasi-static films in closed form, by no code of the package: C v + T x, x = F/k, on a resistor."""

import numpy as np
from scipy.signal import lfilter

STIFFNESS, COUPLING, CAPACITANCE = 1e5, 5.5e-4, 3.6e-9
RATE, COUNT = 2000.0, 2000
LOADS = (3.0e5, 1.2e6, 4.0e6, 8.0e5)
NOISE = 2e-3  # of a range
FINE = 20  # steps within a sample


def voltage(force, step, resistance):
    """Voltage of a film under a force that runs straight within a step, uncharged at first."""
    capacitance = CAPACITANCE + COUPLING**2 / STIFFNESS
    decay = np.exp(-step / (resistance * capacitance))
    pushed = -COUPLING / STIFFNESS * resistance * np.diff(force) / step * (1.0 - decay)
    return lfilter([1.0], [1.0, -decay], np.concatenate([[0.0], pushed]))


def force(kind, rng):
    """Force in N at the ends of the fine steps."""
    time = np.arange(COUNT * FINE + 1) / (RATE * FINE)
    if kind == "sine":
        return 3.0 + 2.0 * np.sin(2 * np.pi * rng.uniform(8.0, 20.0) * time + rng.uniform(0, 6))
    if kind == "impacts":
        hits = rng.uniform(0.05, 0.9, 5) * time[-1]
        return 0.2 + sum(rng.uniform(1, 3) * np.exp(-(((time - hit) * RATE / 10.0) ** 2)) for hit in hits)
    pole = np.exp(-2 * np.pi * 30.0 / (RATE * FINE))
    noise = rng.standard_normal(len(time))
    for _ in range(4):
        noise = lfilter([1 - pole], [1, -pole], noise)
    return 3.0 + noise / noise.std()


def write(folder, transducer, *, kind="sine", leakage=np.inf, offsets=(0.0, 0.0, 0.0, 0.0), bits=14, seed=0):
    """Write a campaign, the last record to validate with, and give the path of its file.

    Parameters
    ----------
    folder : Path
    transducer : str
        Lines of [transducer] beside stiffness, coupling and capacitance, which are off by up to a third.
    kind : "sine", "impacts" or "random"
    leakage : float
        Across the electrodes, ohm: a meter's input.
    offsets : tuple of float
        By how much the zero of the meter is off in each record, V.
    bits : int
        Of the converter.
    seed : int
    """
    rng, tables = np.random.default_rng(seed), ["[transducer]", transducer]
    nominal = {"stiffness": STIFFNESS, "coupling": COUPLING, "capacitance": CAPACITANCE}
    tables += [f"{name} = {value * rng.uniform(0.75, 1.33)}" for name, value in nominal.items()]
    forces = [force(kind, rng) for _ in LOADS]
    resistances = [1.0 / (1.0 / load + 1.0 / leakage) for load in LOADS]
    voltages = [voltage(f, 1.0 / (RATE * FINE), r) for f, r in zip(forces, resistances, strict=True)]
    ranges = [1.2 * np.abs(signals).max() for signals in (forces, voltages)]
    for n, (load, offset) in enumerate(zip(LOADS, offsets, strict=True)):
        columns = [np.arange(COUNT) / RATE]
        for signal, size, zero, converter in zip(
            (forces[n], voltages[n]), ranges, (0.0, offset), (16, bits), strict=True
        ):
            noisy = signal[::FINE][:COUNT] + NOISE * size * rng.standard_normal(COUNT) + zero
            step = 2.0 * size / 2**converter
            columns.append(np.round(noisy / step) * step)
        header = "time_s,force_N,voltage_V"
        np.savetxt(folder / f"r{n}.csv", np.column_stack(columns), "%.9g", ",", header=header, comments="")
        role = "validate" if n == len(LOADS) - 1 else "fit"
        tables += ["[[records]]", f'file = "r{n}.csv"', f"load_resistance = {load}", f'role = "{role}"']
    (folder / "campaign.toml").write_text("\n".join(tables))
    return folder / "campaign.toml"
