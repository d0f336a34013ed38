"""Piecewise linear functions of frequency and their Hilbert transforms, in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_FAR, _TERMS = 3.0, 12  # times the last node, beyond which so many terms of a series leave 1e-12


@dataclass(frozen=True, eq=False)
class Hats:
    """Piecewise linear functions that vanish at both ends: one hat function for each inner node.

    Attributes
    ----------
    nodes : (n,) array
        Increasing angular frequencies above zero, rad/s.
    """

    nodes: np.ndarray

    @property
    def peaks(self) -> np.ndarray:
        """Nodes of the hats, (n-2,) array."""
        return self.nodes[1:-1]

    def values(self, omega: np.ndarray) -> np.ndarray:
        """Values (f, n-2) of the hats."""
        return interpolation(omega, self.nodes)[:, 1:-1]

    def conjugate(self, omega: np.ndarray) -> np.ndarray:
        """Im Q (f, n-2) of the positive-real Q whose real part is a hat: (2 w/pi) P int g(u)/(u^2 - w^2) du."""
        return (self._second_integral(-omega) - self._second_integral(omega)) @ self._kinks / np.pi

    def adjoint(self, omega: np.ndarray) -> np.ndarray:
        """Real part (f, n-2) of the function whose imaginary part is a hat: (2/pi) P int u f(u)/(w^2 - u^2) du."""
        found = (self._second_integral(omega) + self._second_integral(-omega)) @ self._kinks / np.pi
        far = omega > _FAR * self.nodes[-1]
        if np.any(far):
            # There the closed form is a small difference of large terms: a series in the moments of the hats.
            ratio = self.nodes[-1] / omega[far, None]
            orders = 2 * np.arange(_TERMS) + 1
            moments = np.array([self._moment(int(order)) for order in orders])
            found[far] = 2 / np.pi * ratio ** (orders + 1) @ moments
        return found

    def _moment(self, order: int) -> np.ndarray:
        """Int u^order f(u) du of each hat (n-2,) with u over the last node, which leaves out a factor of order + 1."""
        x = self.nodes / self.nodes[-1]
        return x ** (order + 2) @ self._kinks * self.nodes[-1] / ((order + 1) * (order + 2))

    @property
    def inverse_squares(self) -> np.ndarray:
        """(2/pi) int g(u)/u^2 du of each hat, (n-2,) array: lim Q(s)/s at zero."""
        x, step = self.nodes, np.diff(self.nodes)
        growth = np.log(x[1:] / x[:-1])
        rising, falling = (growth + x[:-1] / x[1:] - 1) / step, (x[1:] / x[:-1] - 1 - growth) / step
        return 2 / np.pi * (rising[:-1] + falling[1:])

    @property
    def first_moments(self) -> np.ndarray:
        """Int u f(u) du of each hat, (n-2,) array."""
        step = np.diff(self.nodes)
        return 0.5 * (step[:-1] + step[1:]) * self.peaks + (step[1:] ** 2 - step[:-1] ** 2) / 6

    def _second_integral(self, omega: np.ndarray) -> np.ndarray:
        """(w - x) log|w - x| for every node x: 1/(w - u) integrated twice over u."""
        distance = omega[:, None] - self.nodes
        with np.errstate(all="ignore"):
            return np.where(distance == 0, 0.0, distance * np.log(np.abs(distance)))

    @property
    def _kinks(self) -> np.ndarray:
        """Changes of slope (n, n-2) of each hat at the nodes."""
        slope = 1 / np.diff(self.nodes)
        n = np.arange(len(self.nodes) - 2)
        kinks = np.zeros((len(self.nodes), len(self.nodes) - 2))
        kinks[n, n], kinks[n + 1, n], kinks[n + 2, n] = slope[:-1], -slope[:-1] - slope[1:], slope[1:]
        return kinks


def interpolation(omega: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Matrix (f, n) that interpolates linearly between values at the nodes, zero outside of them."""
    k = np.clip(np.searchsorted(nodes, omega, side="right") - 1, 0, len(nodes) - 2)
    share = (omega - nodes[k]) / (nodes[k + 1] - nodes[k])
    inside = (omega >= nodes[0]) & (omega <= nodes[-1])
    found, rows = np.zeros((len(omega), len(nodes))), np.arange(len(omega))
    found[rows, k], found[rows, k + 1] = np.where(inside, 1 - share, 0.0), np.where(inside, share, 0.0)
    return found


def trapezoid_weights(omega: np.ndarray) -> np.ndarray:
    """Weights (f,) of the trapezoidal rule on increasing points."""
    step = np.diff(omega)
    return 0.5 * (np.append(step, 0.0) + np.append(0.0, step))


def subdivided(nodes: np.ndarray, parts: int) -> np.ndarray:
    """Nodes and the points that divide each interval into equal parts."""
    steps = np.diff(nodes)[:, None] * np.arange(parts) / parts
    return np.append((nodes[:-1, None] + steps).ravel(), nodes[-1])
