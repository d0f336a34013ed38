"""Value that no passive, causal, linear shunt passes, by the dual of the convex program over all of them.

With Q = g + j b the admittance of the loop, passivity is g >= |Q|^2 Re Z at every frequency, and the sum rule
(2/pi) int g/w^2 dw <= C at the pole of Z at zero. Let rho(w) >= 0 and mu >= 0 be their multipliers. Since
rho R |Q|^2 >= 2 Re(conj(f) Q) - |f|^2/(R rho) for any f (R = Re Z), the Lagrangian is bounded by a linear functional
of g, whose coefficient must not be positive. With D(jw) any function whose real part is the Hilbert transform of its
imaginary part, and D' = D + mu/(pi w^2), the best f and rho at each frequency are known in closed form:

    P <= mu C + int h dw,   h = (|D'| - Re D')/R                   where 2 |D'| >= rho_0,
                            h = |D' - rho_0/2|^2/(R rho_0)         elsewhere,

rho_0 = density |v|^2/2 in the band, 0 outside. For a displacement x + a Q, with any y(w) in the band whose dual norm
is one (int |y| dw for the peak):

    max |x + a Q| >= int Re(conj(y) x) dw - mu C - int (|D''| - Re D'')/R dw,   D'' = D' + conj(y) a/2.

Every D, mu, y gives a bound that holds; the convex program finds good ones, and its accuracy decides only how close the
bound is. D has a piecewise linear imaginary part that vanishes where Re Z is negligible: there h = 0 if D' >= 0. In the
band of a displacement D'' is piecewise linear, and conj(y) a/2 = D'' - D': the best D'' is zero where passivity does
not bind, which a piecewise linear y would only come near to.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from piezoharvest.design.bound.density import Hats, interpolation, subdivided, trapezoid_weights
from piezoharvest.design.bound.port import ElectrodePort, PortValues
from piezoharvest.design.bound.program import MARGIN, solve
from piezoharvest.design.bound.target import Target

_FINE = 16  # points in an interval of the mesh at which the certificate is evaluated


@dataclass(frozen=True, eq=False)
class Multipliers:
    """Feasible point of the dual program.

    Attributes
    ----------
    hats : Hats
    imaginary : (n,) array
        Im D at the peaks of the hats.
    pole : float
        mu.
    inner : (m,) complex array
        D'' at the nodes in the band; empty for power.
    """

    hats: Hats
    imaginary: np.ndarray
    pole: float
    inner: np.ndarray


def certify(port: ElectrodePort, target: Target, nodes: np.ndarray, support: tuple[float, float]) -> float | None:
    """Power, or displacement, that no shunt passes; None if the solver fails.

    Parameters
    ----------
    port : ElectrodePort
    target : Target
    nodes : (n,) array
        Mesh, rad/s.
    support : pair of float
        Frequencies between which Im D differs from zero, rad/s.
    """
    hats = Hats(nodes[(nodes >= support[0]) & (nodes <= support[1])])
    beyond = np.concatenate((nodes[0] * np.array([0.01, 0.1, 0.5]), nodes, nodes[-1] * np.array([2.0, 10.0, 100.0])))
    found = _DualProgram(port, target, hats, np.union1d(subdivided(beyond, 3), subdivided(hats.nodes, 2))).solve()
    omega = subdivided(beyond, _FINE)
    value = np.nan if found is None else _evaluate(port, target, found, omega, port.at(omega))
    return float(value) if np.isfinite(value) else None


def _evaluate(port: ElectrodePort, target: Target, found: Multipliers, omega: np.ndarray, at: PortValues) -> float:
    """Value of a feasible point on a fine mesh; the pole's multiplier is raised where that makes the bound closer."""
    hats, inside = found.hats, target.inside(omega)
    d = hats.adjoint(omega) @ found.imaginary + 1j * (hats.values(omega) @ found.imaginary)
    gain, scale = 0.0, 1.0
    if target.kind != "power":
        inner = interpolation(omega, _band_nodes(hats.nodes, target)) @ found.inner
        pull = np.where(inside, inner - d - found.pole / (np.pi * omega**2), 0.0)
        y = np.conj(2 * pull / at.influence)
        scale = _dual_norm(target, omega, y)
        d = d + pull
        gain = float(target.weights(omega) @ np.real(np.conj(y) * at.displacement))
    least = max(found.pole, -2 * float(hats.first_moments @ found.imaginary), 0.0)
    weights, capacitance = trapezoid_weights(omega), port.free_capacitance
    quota = np.where(inside, 0.5 * target.density * np.abs(at.voltage) ** 2, 0.0) if target.kind == "power" else 0.0

    def cost(pole: float) -> float:
        penalty = _penalty(d + pole / (np.pi * omega**2), quota, at.resistance)
        if target.kind == "power":
            edges = target.weights(omega)
            outside = _penalty(d + pole / (np.pi * omega**2), 0.0, at.resistance)
            return float(edges @ penalty + (weights - edges) @ outside) + (pole * capacitance if pole else 0.0)
        return float(weights @ penalty) + (pole * capacitance if pole else 0.0)

    outside = (omega <= hats.nodes[0]) | (omega >= hats.nodes[-1])
    most = max(least, float(np.max(-np.real(d) * np.pi * omega**2, where=outside, initial=0.0)))
    costs = [cost(least), cost(most)] if np.isfinite(capacitance) else [cost(0.0)]
    if most > least and np.isfinite(capacitance):
        costs.append(float(minimize_scalar(cost, bounds=(least, most), method="bounded").fun))  # pyright: ignore
    return min(costs) if target.kind == "power" else (gain - min(costs)) * np.sqrt(target.density) / scale


def _penalty(d: np.ndarray, quota: Any, resistance: np.ndarray) -> np.ndarray:
    """The function h of the module's description."""
    size, real, imaginary = np.abs(d), np.real(d), np.imag(d)
    # |D| - Re D without cancellation.
    beyond = np.where(real > 0, imaginary**2 / np.maximum(size + np.abs(real), 1e-300), size - real)
    within = np.abs(d - quota / 2) ** 2 / np.where(2 * size < quota, quota, 1.0)
    return np.where(2 * size >= quota, beyond, within) / resistance


def _dual_norm(target: Target, omega: np.ndarray, y: np.ndarray) -> float:
    weights = target.weights(omega)
    return float(weights @ np.abs(y) if target.kind == "peak" else np.sqrt(weights @ np.abs(y) ** 2))


def _band_nodes(nodes: np.ndarray, target: Target) -> np.ndarray:
    return nodes[target.inside(nodes)]


@dataclass
class _DualProgram:
    """The dual program on a mesh, in units in which its solution is of the order of one.

    The value is over that without causality (power) or the displacement with open electrodes; D is over Re Z times
    the value's unit over the bandwidth.
    """

    port: ElectrodePort
    target: Target
    hats: Hats
    omega: np.ndarray

    def __post_init__(self) -> None:
        target, omega = self.target, self.omega
        self.at = at = self.port.at(omega)
        self.inside = target.inside(omega)
        self.support = (omega > self.hats.nodes[0]) & (omega < self.hats.nodes[-1])
        self.width = width = target.band[1] - target.band[0]
        # y over the inverse of its dual norm where it is one throughout the band.
        self.weight_unit = 1 / width if target.kind == "peak" else 1 / np.sqrt(width)
        if target.kind == "power":
            self.size = target.frequency_wise(omega, at)
        else:
            self.size = float(np.max(np.abs(at.displacement[self.inside]))) * self.weight_unit * width
        self.unit = at.resistance * self.size / width
        self.scale = np.interp(self.hats.peaks, omega, self.unit)
        self.leaks = not np.isfinite(self.port.free_capacitance)
        self.pole_unit = 0.0 if self.leaks else self.size / self.port.free_capacitance

    def solve(self) -> Multipliers | None:
        """Multipliers near the best; None if the solver fails."""
        import cvxpy as cp

        c, pole = cp.Variable(len(self.scale)), cp.Variable(nonneg=True)
        real, imaginary, outside = self._conjugate_pair(c, pole)
        gain, y, constraints = 0.0, None, []
        if self.target.kind != "power":
            y = cp.Variable((len(_band_nodes(self.hats.nodes, self.target)), 2))
            spread, norm, forward = self._pull()
            inside, b = self.inside, self.inside.astype(float)
            pulled = [(spread @ y[:, k])[inside] - part[inside] for k, part in enumerate((real, imaginary))]
            real, imaginary = (spread @ y[:, k] + cp.multiply(1 - b, part) for k, part in enumerate((real, imaginary)))
            gain = np.real(forward)[inside] @ pulled[0] - np.imag(forward)[inside] @ pulled[1]
            weights = (self.target.weights(self.omega) / self.width)[inside]
            constraints.append(_unit_norm(cp, self.target, norm[inside], weights, cp.vstack(pulled)))
        r, t = (cp.Variable(int(np.count_nonzero(self.support))) for _ in range(2))
        # D must not be negative far above the support, where it falls with the square of the frequency.
        moments = self.hats.first_moments * self.scale
        far = moments / np.max(moments) @ c if self.leaks else moments / self.pole_unit @ c + pole / 2
        constraints += [
            r >= self._quota()[self.support],
            # |D'|^2/r <= t
            cp.SOC(r + t, cp.vstack([2 * real[self.support], 2 * imaginary[self.support], r - t]), axis=0),
            outside >= MARGIN,
            far >= MARGIN,
        ]
        weights = (trapezoid_weights(self.omega) / self.width)[self.support]
        cost = weights @ (r / 4 - real[self.support] + t) + (0.0 if self.leaks else pole)
        found = solve(cost - gain, constraints, [c, pole, *(() if y is None else (y,))])
        if found is None:
            return None
        inner = np.empty(0) if y is None else (found[2] @ np.array([1, 1j])) * self._inner_unit()
        return Multipliers(self.hats, found[0] * self.scale, max(float(found[1]), 0.0) * self.pole_unit, inner)

    def _conjugate_pair(self, c: Any, pole: Any) -> tuple[Any, Any, Any]:
        """Re D' and Im D over their unit, and Re D' outside of the support over a natural size."""
        omega, unit = self.omega, self.unit
        adjoint, values = self.hats.adjoint(omega) * self.scale, self.hats.values(omega) * self.scale
        pole_part = self.pole_unit / (np.pi * omega**2)
        real = (adjoint / unit[:, None]) @ c + (pole_part / unit) * pole
        imaginary = (values / unit[:, None]) @ c
        natural = 1 / np.interp(omega, omega[self.support], unit[self.support])
        if not self.leaks:
            natural = np.minimum(natural, 1 / pole_part)
        off = ~self.support
        outside = (adjoint * natural[:, None])[off] @ c + (pole_part * natural)[off] * pole
        return real, imaginary, outside

    def _quota(self) -> np.ndarray:
        """rho_0 over the unit of D."""
        if self.target.kind != "power":
            return np.zeros(len(self.omega))
        return np.where(self.inside, 0.5 * self.target.density * np.abs(self.at.voltage) ** 2 / self.unit, 0.0)

    def _inner_unit(self) -> np.ndarray:
        return np.interp(_band_nodes(self.hats.nodes, self.target), self.omega, self.unit)

    def _pull(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Matrix from D'' at the nodes in the band to itself, and factors from conj(y) a/2 to |y| and the gain.

        All over their units; the gain is int Re(conj(y) x) dw.
        """
        at, target, omega = self.at, self.target, self.omega
        spread = interpolation(omega, _band_nodes(self.hats.nodes, target)) * self._inner_unit() / self.unit[:, None]
        norm = 2 * self.unit / np.abs(at.influence) / self.weight_unit
        return spread, norm, 2 * at.displacement / at.influence / self.size * target.weights(omega) * self.unit


def _unit_norm(cp: Any, target: Target, norm: np.ndarray, weights: np.ndarray, pulled: Any) -> Any:
    """Constraint that the dual norm of y is one at most; `pulled` (2, f) is conj(y) a/2 over its unit."""
    if target.kind == "peak":
        return (weights * norm) @ cp.norm(pulled, 2, axis=0) <= 1
    return cp.norm(cp.multiply((np.sqrt(weights) * norm)[None], pulled), "fro") <= 1
