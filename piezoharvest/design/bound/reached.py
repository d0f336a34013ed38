"""Value that a passive, causal, linear shunt is shown to reach, by the convex program over admittances of the loop.

The unknown is the conductance g(w) of Q = 1/(Z + Z_s): piecewise linear, with wide resonant branches so that it differs
from zero at all frequencies. Im Q follows in closed form, so that Q is positive real by construction. Passivity of Z_s
is required on a mesh, then restored between its points: if g >= |Q|^2 Re Z fails by a factor, Q times that factor keeps
it. Networks of resistors, coils and capacitors come as close as one wants to any such Q.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from piezoharvest.design.bound.density import Hats, subdivided
from piezoharvest.design.bound.port import ElectrodePort, PortValues
from piezoharvest.design.bound.program import MARGIN, solve
from piezoharvest.design.bound.target import Target

_PARTS, _FINE = 3, 16  # of an interval of the mesh: points of the program, and of the check
_TAILS = 0.1  # their natural size, of that of the hats
# Rounds in which points are added where passivity lacks by so much; what is left costs as much of the value at most.
_ROUNDS, _MAX_LACK = 4, 3e-4
# Where R |Q| is below this, conductance is added instead, which changes Q by less than that share of itself; a little
# more than lacks, as what is added to one place makes Q larger at others.
_LOSSLESS, _EXCESS, _REPAIRS = 0.03, 1.1, 20


@dataclass(frozen=True, eq=False)
class LoopAdmittance:
    """Admittance Q(jw) of the loop, positive real.

    Attributes
    ----------
    hats : Hats
    branches : (b,) array
        Frequencies of wide resonant branches 2 w_b s/(s + w_b)^2, rad/s.
    parts : (n,) array
        Conductances at the peaks of the hats and of the branches, S.
    """

    hats: Hats
    branches: np.ndarray
    parts: np.ndarray

    def at(self, omega: np.ndarray) -> np.ndarray:
        """Q (f,) in S at angular frequencies in rad/s."""
        return self.basis(omega) @ self.parts

    def basis(self, omega: np.ndarray) -> np.ndarray:
        """Admittance (f, n) of a unit of each part."""
        s = 1j * omega[:, None]
        branches = 2 * self.branches * s / (s + self.branches) ** 2
        return np.hstack((self.hats.values(omega) + 1j * self.hats.conjugate(omega), branches))

    @property
    def capacitances(self) -> np.ndarray:
        """Lim Q(s)/s at zero (n,) of a unit of each part, s."""
        return np.concatenate((self.hats.inverse_squares, 2 / self.branches))


def reach(port: ElectrodePort, target: Target, nodes: np.ndarray) -> tuple[float, LoopAdmittance] | None:
    """Value of a feasible admittance near the best, and the admittance; None if the solver fails.

    Parameters
    ----------
    port : ElectrodePort
    target : Target
    nodes : (n,) array
        Mesh, rad/s.
    """
    low, high = nodes[0], nodes[-1]
    branches = np.array([low, np.sqrt(low * high), high])
    beyond = np.concatenate((low * np.array([0.01, 0.1, 0.5]), nodes, high * np.array([2.0, 10.0])))
    empty = LoopAdmittance(Hats(nodes), branches, np.zeros(len(nodes) + 1))
    omega, met = subdivided(beyond, _FINE), subdivided(beyond, _PARTS)
    at = port.at(omega)
    for _ in range(_ROUNDS):
        found = _solve(port, target, empty, met)
        if found is None:
            return None
        surplus = _surplus(at, found.at(omega))
        lowest = (surplus <= np.append(surplus[1:], 0)) & (surplus <= np.append(0, surplus[:-1]))
        worst = lowest & (surplus < -_MAX_LACK)
        if not np.any(worst):
            break
        met = np.union1d(met, omega[worst])
    admittance = _made_passive(port, found, omega, at)
    return None if admittance is None else (target.value(omega, at, admittance.at(omega)), admittance)


def _surplus(at: PortValues, q: np.ndarray) -> np.ndarray:
    """Conductance beyond R |Q|^2, over the larger of that and a small share of |Q|; negative where not passive."""
    least = at.resistance * np.abs(q) ** 2
    return (np.real(q) - least) / np.maximum(least, _LOSSLESS * np.abs(q))


def _made_passive(
    port: ElectrodePort, found: LoopAdmittance, omega: np.ndarray, at: PortValues
) -> LoopAdmittance | None:
    """Admittance with conductance added where passivity lacks between the points of the program, then reduced."""
    basis, parts, hats = found.basis(omega), found.parts.copy(), found.hats
    near = [(omega >= a) & (omega <= b) for a, b in zip(hats.nodes[:-2], hats.nodes[2:], strict=True)]
    ends = [(omega < hats.nodes[1], len(near)), (omega > hats.nodes[-2], len(parts) - 1)]
    for _ in range(_REPAIRS):
        q = basis @ parts
        lack = at.resistance * np.abs(q) ** 2 - np.real(q)
        lack = np.where(at.resistance * np.abs(q) < _LOSSLESS, lack, 0.0)
        if np.max(lack) <= 0:
            break
        parts[: len(near)] += _EXCESS * np.array([np.max(lack[where], initial=0.0) for where in near])
        for where, n in ends:
            parts[n] += _EXCESS * np.max(lack[where] / basis[where, n].real, initial=0.0)
    q = basis @ parts
    share = np.min(np.real(q) / (at.resistance * np.abs(q) ** 2))
    share = min(1.0, share, port.free_capacitance / (found.capacitances @ parts))
    return LoopAdmittance(hats, found.branches, share * parts) if share > 0 else None


def _solve(port: ElectrodePort, target: Target, empty: LoopAdmittance, omega: np.ndarray) -> LoopAdmittance | None:
    """Solve the program on a mesh; None if the solver fails."""
    import cvxpy as cp

    at, inside = port.at(omega), target.inside(omega)
    capacitance = port.free_capacitance if np.isfinite(port.free_capacitance) else port.view.capacitance
    natural = np.minimum(1 / np.abs(at.impedance), 3 * omega * capacitance)
    # Beyond the mesh only the branches are left, which fall with the square of the distance.
    first, last = empty.hats.nodes[[0, -1]]
    natural *= np.minimum(omega / first, 1) * np.minimum(last / omega, 1) ** 3
    hats, branches = np.interp(empty.hats.peaks, omega, natural), np.interp(empty.branches, omega, natural)
    scale = np.concatenate((hats, _TAILS * branches))
    parts = cp.Variable(len(scale))
    basis = empty.basis(omega) * scale / natural[:, None]
    # As variables of their own: their dense rows are then in the solver's matrix once, not in each use.
    real, imaginary = cp.Variable(len(omega)), cp.Variable(len(omega))
    loss = np.sqrt(at.resistance * natural)
    # R |Q|^2 <= t <= Re Q, all over the natural size of Q; outside of a band of power, t is Re Q.
    counted = inside if target.kind == "power" else np.zeros(len(omega), bool)
    t = cp.Variable(int(np.sum(counted))) if np.any(counted) else None
    spent = real[~counted] - MARGIN if t is None else cp.hstack([t, real[~counted] - MARGIN])
    order = np.concatenate((np.flatnonzero(counted), np.flatnonzero(~counted)))
    lost = [cp.multiply(2 * loss[order], real[order]), cp.multiply(2 * loss[order], imaginary[order])]
    constraints: list[Any] = [parts >= 0, real == basis.real @ parts, imaginary == basis.imag @ parts]
    constraints.append(cp.SOC(1 + spent, cp.vstack([*lost, 1 - spent]), axis=0))
    if t is not None:
        constraints.append(t <= real[counted])
    if np.isfinite(port.free_capacitance):
        constraints.append((empty.capacitances * scale / capacitance) @ parts <= 1)
    found = solve(_objective(cp, target, omega, at, natural, real, imaginary, t), constraints, [parts])
    return None if found is None else LoopAdmittance(empty.hats, empty.branches, np.maximum(found[0] * scale, 0.0))


def _objective(
    cp: Any, target: Target, omega: np.ndarray, at: PortValues, natural: np.ndarray, real: Any, imaginary: Any, t: Any
) -> Any:
    """The target to be minimised, over a typical size of it."""
    inside, weights = target.inside(omega), target.weights(omega)
    if target.kind == "power":
        gain = weights * 0.5 * target.density * np.abs(at.voltage) ** 2 * natural
        return -(gain[inside] / target.frequency_wise(omega, at)) @ (real[inside] - t)
    x, a = at.displacement[inside], (at.influence * natural)[inside]
    size = np.max(np.abs(x))
    x, a, re, im = x / size, a / size, real[inside], imaginary[inside]
    parts = cp.vstack([x.real + cp.multiply(a.real, re) - cp.multiply(a.imag, im),
                       x.imag + cp.multiply(a.imag, re) + cp.multiply(a.real, im)])  # fmt: skip
    if target.kind == "peak":
        return cp.max(cp.norm(parts, 2, axis=0))
    return cp.norm(cp.multiply(np.sqrt(weights[inside] / np.sum(weights))[None], parts), "fro")
