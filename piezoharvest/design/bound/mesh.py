"""Frequencies at which the bound's unknown functions have their nodes."""

from __future__ import annotations

import numpy as np

_OCTAVES = 0.2  # of the frequency: largest spacing
_OUTSIDE = 0.3  # of the distance from the band
_MIN_DAMPING = 1e-7  # of a pole's frequency
_NEAR_EDGE, _EDGE = 0.25, 1 / 16  # at the edges of the band the optimal functions have logarithmic singularities
_FINE, _NEAREST = 1500, 0.05  # points about each pole and edge, and the first of them over the spacing there
REACH = 10.0  # times beyond all poles and the band


def mesh(band: tuple[float, float], poles: np.ndarray, count: int, near_pole: float) -> np.ndarray:
    """Graded nodes (n,) in rad/s, dense in the band, at its edges and at poles.

    Parameters
    ----------
    band : pair of float
        rad/s.
    poles : (p,) complex array
        rad/s.
    count : int
        Intervals in the band, without those that edges and poles ask for.
    near_pole : float
        Spacing near a pole, of the distance from it or of its damping, the larger of the two.
    """
    sizes = np.abs(poles)
    low, high = min(band[0], np.min(sizes)) / REACH, max(band[1], np.max(sizes)) * REACH
    places = _fine(low, high, band, poles, count)
    found = []
    for start, end in zip((low, *band), (*band, high), strict=True):
        # Nodes are where the integral of the density passes whole numbers; the band's edges are nodes.
        x = np.union1d(places[(places > start) & (places < end)], (start, end))
        density = 1 / _spacing(x, band, poles, count, near_pole)
        total = np.concatenate(([0.0], np.cumsum(np.diff(x) * 0.5 * (density[1:] + density[:-1]))))
        found.append(np.interp(np.linspace(0, total[-1], max(int(np.ceil(total[-1])), 1) + 1), total, x))
    return np.unique(np.concatenate(found))


def _spacing(
    omega: np.ndarray, band: tuple[float, float], poles: np.ndarray, count: int, near_pole: float
) -> np.ndarray:
    """Spacing (f,) of the nodes about each frequency, rad/s."""
    width = (band[1] - band[0]) / count
    outside = np.maximum(np.maximum(band[0] - omega, omega - band[1]), 0)
    spacing = np.minimum(_OCTAVES * omega, width + _OUTSIDE * outside)
    for edge in band:
        spacing = np.minimum(spacing, np.maximum(_NEAR_EDGE * np.abs(omega - edge), _EDGE * width))
    for pole in poles:
        away = np.maximum(np.abs(omega - np.imag(pole)), _MIN_DAMPING * np.abs(pole))
        spacing = np.minimum(spacing, near_pole * np.maximum(np.abs(np.real(pole)), away))
    return spacing


def _fine(low: float, high: float, band: tuple[float, float], poles: np.ndarray, count: int) -> np.ndarray:
    """Points at which the density of nodes is integrated."""
    found = [np.geomspace(low, high, 2 * _FINE), np.linspace(*band, _FINE)]
    places = [(edge, _EDGE * (band[1] - band[0]) / count) for edge in band]
    places += [(float(np.imag(p)), max(abs(float(np.real(p))), _MIN_DAMPING * abs(p))) for p in poles]
    for centre, width in places:
        away = np.geomspace(_NEAREST * width, max(centre, 2 * width), _FINE)
        found += [np.abs(centre - away), centre + away]
    points = np.unique(np.concatenate(found))
    return points[(points > low) & (points < high)]
