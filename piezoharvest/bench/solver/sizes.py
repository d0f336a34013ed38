"""Sizes of a run before it begins: those of the linear specimen without a voltage."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezoharvest.bench.solver.drive import Drive
from piezoharvest.bench.solver.model import Model

TINY = 1e-300  # of nothing: a drive that rests
ROUNDING = 1e-15  # of a charge, from a few sums


class Sizes(NamedTuple):
    """Largest values of a run; none of them is zero.

    Attributes
    ----------
    root_energy : float
        Root of twice the energy of a mode, sqrt(J).
    voltage : float
        Of the electrodes, V.
    turning : float
        Of the current sum T_i u_i, A.
    """

    root_energy: float
    voltage: float
    turning: float


def expected_sizes(model: Model, drive: Drive) -> Sizes:
    """Sizes of the shorted linear specimen under a drive, and the voltage of open electrodes that moved as much.

    At as many instants as the drive has nodes, and at most those of the energy of a static deflection, which a
    resonance may exceed later. That alone would be too much wherever inertia or damping carries the force: a structure
    driven at a thousand times its corner frequency moves by a thousandth of it, and what counts as zero voltage has to
    be a share of the voltage that there is. The energy is with that of a preload.
    """
    from scipy.signal import lsim

    n, coupling, mass, damping = model.count, model.coupling, model.mass, np.diag(model.damping[:, 0])
    stiff = elastance(model)
    rates = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(model.stiffness[:, 0]) / mass, -damping / mass]])
    # In units of the root of energy, in which the numbers of any structure are alike.
    scale = np.concatenate((model.stiffness, mass)) ** 0.5
    into = scale * np.concatenate((np.zeros((n, 1)), model.gain / mass))
    times = np.linspace(0.0, drive.nodes[-1] - drive.nodes[0], len(drive.nodes))
    signal = drive.at(drive.nodes[0] + times) - drive.rest
    system = scale * rates / scale.T, into, np.eye(2 * n), np.zeros((2 * n, 1))
    moved = lsim(system, signal, times)[1].reshape(len(times), 2 * n)
    x, u = moved[:, :n] / scale[:n].T, moved[:, n:] / scale[n:].T
    preload = np.abs(model.gain * drive.rest / model.stiffness**0.5).max()
    found = (float(np.abs(each).max()) for each in (np.abs(moved) + preload, x @ coupling, u @ coupling))
    static = np.abs(signal + drive.rest).max() * float(np.abs(model.gain / model.stiffness**0.5).max())
    most = static * np.array([1.0, stiff**-0.5, float(np.abs(coupling / mass**0.5).max())])
    energy, charge, turning = (min(each, other) + TINY for each, other in zip(found, most, strict=True))
    # A stop carries no more than its threshold.
    held = sum(w * min(charge, stop.threshold) for w, stop in zip(model.weights, model.stops, strict=True))
    return Sizes(energy, charge / (model.transducer.capacitance + model.beside) + held, turning)


def voltage_rounding(model: Model, sizes: np.ndarray, slope: float) -> float:
    """Rounding error of the electrode voltage (V) with states of these sizes and a `slope` by the charge (1/F).

    v_t is a difference of charges, which under a preload may be a hundred million times as large as that.
    """
    softness = 1.0 / (model.transducer.capacitance + model.beside)
    strain = float(np.abs(model.coupling[:, 0]) @ sizes[: model.count])
    return ROUNDING * (abs(slope) * float(sizes[model.q_row]) + softness * strain)


def elastance(model: Model) -> float:
    """Electrode voltage that a charge gives while every stop sticks, 1/F."""
    return 1.0 / (model.transducer.capacitance + model.beside) + sum(model.weights)
