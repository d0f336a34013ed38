"""Studies as tables, as the oracle reads them, and the same studies as the objects that the package works with."""

import math
from pathlib import Path

import numpy as np

from piezoharvest.description.system import System
from piezoharvest.study import build_excitation, build_shunt, build_transducer

# A strongly coupled bench: k_e^2 = 0.025, Q_m = 50, driven between its resonances.
BENCH = {"mass": 0.010, "damping": 0.0628, "stiffness": 986.96, "coupling": 1.0e-3, "capacitance": 40e-9}
DRIVE = {"kind": "sine_force", "amplitude": 0.02, "frequency": 50.6}
STOPS = {"thresholds": [1e-7, 3e-7], "weights": [5e5, 1.5e6]}
SECOND = {"mass": 0.01, "damping": 0.6, "stiffness": 8e3, "coupling": 5e-4, "force_participation": 0.7}
LOOP = {"inductance": 0.01, "quality": 6.0}


def bench(shunt, excitation=DRIVE, **transducer):
    """Study of the bench with a shunt; further keys go into the transducer's table."""
    return {"transducer": {**BENCH, **transducer}, "excitation": dict(excitation), "shunts": [shunt]}


def objects(study, index=0):
    """System and excitation of a study's tables."""
    transducer = build_transducer(study["transducer"])
    return System(transducer, build_shunt(study["shunts"][index])), build_excitation(study["excitation"], Path())


def solve(study, index=0, **options):
    """Response of a study's tables: its steady state, or with `transient` the run from rest."""
    from piezoharvest.engine import simulate

    system, excitation = objects(study, index)
    return simulate(system, excitation, **options)


def inversion(quality):
    """Share of the voltage's magnitude that a swing of the switched loop leaves; exp(-pi/(2 Q)) for large Q."""
    return math.exp(-math.pi / math.sqrt(4.0 * quality**2 - 1.0))


def one_period(waveforms, period):
    """Indices of exactly one period of samples: without its end, should the samples include it."""
    return slice(None, int(np.sum(waveforms.time < period * (1 - 1e-9))))


def phasor(waveforms, signal, period):
    """X of the steady waveform Im(X exp(jwt)), by its first Fourier coefficient."""
    one = one_period(waveforms, period)
    return 2j * np.mean(signal[one] * np.exp(-2j * np.pi * waveforms.time[one] / period))


def distance(found, wanted):
    """Largest difference of two waveforms relative to the largest value of the second."""
    largest = np.abs(wanted).max()
    difference = np.abs(np.asarray(found) - wanted).max()
    return difference / largest if largest > 0 else difference
