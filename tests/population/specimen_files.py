"""Campaigns of several quasi-static specimens in closed form, by no code of the package.

k x = F + T v, and the charge C v + T x leaves through the load: (C + T^2/k) v' + v/R = -(T/k) F'.
"""

import numpy as np
from scipy.signal import lfilter

NOMINAL = {"stiffness": 1e5, "coupling": 5.5e-4, "capacitance": 3.6e-9}
RATE, FINE = 2000.0, 20  # Hz; steps within a sample
LOADS = (3.0e5, 1.2e6, 4.0e6, 8.0e5)
SIGMA = {"displacement": 2e-7, "voltage": 4e-3}  # m, V
HEADER = "time_s,force_N,displacement_m,voltage_V"


def drawn(rng, spread):
    """Values of a specimen of the kind: each with the same relative spread about the nominal ones."""
    return {name: value * np.exp(spread * rng.standard_normal()) for name, value in NOMINAL.items()}


def record(rng, specimen, load, count, leakage=np.inf):
    """Noisy samples of a specimen on a load under a force of two sines, uncharged at first, (count, 4)."""
    k, t, c = (specimen[name] for name in NOMINAL)
    step = 1.0 / (RATE * FINE)
    time = np.arange((count - 1) * FINE + 1) * step
    parts = zip((1.5, 1.0), rng.uniform(8.0, 40.0, 2), rng.uniform(0.0, 6.0, 2), strict=True)
    force = 3.0 + sum(size * np.sin(2 * np.pi * frequency * time + phase) for size, frequency, phase in parts)
    resistance = 1.0 / (1.0 / load + 1.0 / leakage)
    decay = np.exp(-step / (resistance * (c + t**2 / k)))
    pushed = -t / k * resistance * np.diff(force) / step * (1.0 - decay)
    voltage = lfilter([1.0], [1.0, -decay], np.concatenate([[0.0], pushed]))
    columns = [time, force, (force + t * voltage) / k, voltage]
    samples = np.column_stack([column[::FINE] for column in columns])
    samples[:, 2] += SIGMA["displacement"] * rng.standard_normal(count)
    samples[:, 3] += SIGMA["voltage"] * rng.standard_normal(count)
    return samples


def write(folder, specimens, counts, *, leakages=None, seed=0):
    """Write a campaign of several specimens, and give the path of its file.

    Parameters
    ----------
    folder : Path
    specimens : list of dict
        Values of each.
    counts : list of list of int
        Samples of the records of each; of several the last is one to validate with.
    leakages : list of float, optional
        Resistance across the electrodes of each, ohm.
    seed : int
    """
    rng = np.random.default_rng(seed)
    lines = ["[transducer]", "quasi_static = true", *(f"{name} = {value}" for name, value in NOMINAL.items())]
    for n, (values, lengths) in enumerate(zip(specimens, counts, strict=True)):
        lines += ["[[specimens]]", f'name = "film {n + 1}"']
        for m, count in enumerate(lengths):
            leakage = np.inf if leakages is None else leakages[n]
            samples = record(rng, values, LOADS[m], count, leakage)
            np.savetxt(folder / f"s{n}_{m}.csv", samples, "%.12g", ",", header=HEADER, comments="")
            role = "validate" if m and m == len(lengths) - 1 else "fit"
            lines += ["[[specimens.records]]", f'file = "s{n}_{m}.csv"', f"load_resistance = {LOADS[m]}"]
            lines += [f'role = "{role}"']
    (folder / "campaign.toml").write_text("\n".join(lines))
    return folder / "campaign.toml"
