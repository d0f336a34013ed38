"""Bound of the power that leaves several pairs of electrodes together.

At each frequency the electrodes' voltages v act on the modes by forces T^T v, and the structure moves by its mobility
Y: u = Y (f + T^T v). What leaves the electrodes is -Re(v^H T u)/2 whatever is connected to them, and the largest of all
v gives a^H (Q^H Re(Y) Q)^-1 a/8, with a = Q^H Y f and Q an orthonormal basis of the forces that they can exert: the
conjugate match of a multi-port (Desoer, IEEE Trans. Circuit Theory 20(3), 328-330, 1973), written in the mechanical
variables, in which it is regular however many electrodes there are. With as many as modes it is sum f_n^2/(8 b_n).
"""

from __future__ import annotations

import numpy as np

from piezoharvest.description.transducer import Transducer
from piezoharvest.design.goal import Goal
from piezoharvest.design.operation import Operation
from piezoharvest.design.result import Bound
from piezoharvest.equations.rows import gains

_RANK = 1e-9  # singular values of the couplings that count, relative to the largest


def bound_of_several(
    transducer: Transducer, operation: Operation, goal: Goal, taken: tuple[int, ...],
    band: tuple[float, float] | None = None,
) -> Bound:  # fmt: skip
    """Bound of all circuits between electrodes of these numbers, the others being open, in an operation.

    For the harvested power alone: what a frequency of its own each could draw, which switched circuits do not pass
    either. Networks that connect the electrodes with each other reach it at single frequencies. With a `band` in which
    the frequency is free there is none.
    """
    many = f"electrodes {', '.join(map(str, sorted(taken)))}"
    if band is not None:
        return Bound(notes=(f"no bound is computed for a free frequency with shunts at {many}",))
    if goal.damping:
        return Bound(notes=(f"no bound is computed for the displacement with shunts at {many}",))
    if transducer.hysteresis or transducer.effects:
        return Bound(notes=(f"no bound is computed with shunts at {many} beside hysteresis or effects",))
    if not operation.periodic and not hasattr(operation.excitation, "psd"):
        why = "the excitation ends, and what is stored then counts as much as what is harvested"
        return Bound(notes=(f"no bound: {why}",))
    power = float(operation.squares @ most_power(transducer, 2 * np.pi * operation.frequencies, operation.base, taken))
    if not np.isfinite(power):
        return Bound(notes=("no bound: the transducer has no loss",))
    lines = operation.apart and operation.band is None
    notes = [f"the bound is that of any circuit between {many}, which may connect them with each other"]
    notes += [] if lines else ["it ignores causality: how close a network can come to it is not known"]
    return Bound(
        harvested_power=power, reached=power if lines else None, frequency_wise=power, any_interface=power,
        notes=tuple(notes),
    )  # fmt: skip


def most_power(transducer: Transducer, omega: np.ndarray, base: bool, taken: tuple[int, ...]) -> np.ndarray:
    """Largest mean power (f,) in W that leaves electrodes of these numbers for a drive of peak value 1.

    Parameters
    ----------
    transducer : Transducer
        Without hysteresis and effects.
    omega : (f,) array
        rad/s.
    base : bool
        Drive by base acceleration instead of force.
    taken : tuple of int
        The other electrodes are open.
    """
    modes, electrodes = transducer.all_modes, transducer.all_electrodes
    mass, damping, stiffness = (np.array([getattr(m, n) for m in modes]) for n in ("mass", "damping", "stiffness"))
    opened = [pair for number, pair in enumerate(electrodes) if number not in taken]
    stiff = np.diag(stiffness) + sum(np.outer(p.couplings, p.couplings) / p.capacitance for p in opened)
    exerted = np.array([electrodes[number].couplings for number in taken])
    _, sizes, rows = np.linalg.svd(exerted, full_matrices=False)
    basis = rows[sizes > _RANK * sizes[0]].T
    impedance = stiff / (1j * omega[:, None, None]) + np.diag(damping) + 1j * omega[:, None, None] * np.diag(mass)
    force = np.array(gains(transducer, base), complex)
    with np.errstate(all="ignore"):
        mobile = np.linalg.solve(impedance, basis.astype(complex))
        moved = basis.T @ np.linalg.solve(impedance, np.broadcast_to(force[:, None], (len(omega), len(force), 1)))
        # Re(Y) = Y^H B Y, by which no digits are lost off resonance, and by whose root none in the inverse.
        _, shares, directions = np.linalg.svd(np.sqrt(damping)[:, None] * mobile, full_matrices=False)
        return np.sum(np.abs((directions @ moved)[..., 0] / shares) ** 2, axis=-1) / 8
