"""Frequencies at which the bound's unknown functions have their nodes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

_OCTAVES = 0.2  # of the frequency: largest spacing
_OUTSIDE = 0.3  # of the distance from the band
_MIN_DAMPING = 1e-7  # of a pole's frequency
_FINE, _NEAREST = 1500, 0.05  # points about each pole and edge, and the first of them over the spacing there
REACH = 10.0  # times beyond all poles and the band


class Grading(NamedTuple):
    """Density of a mesh.

    Attributes
    ----------
    count : int
        Intervals in the band, without those that edges and poles ask for.
    near_pole : float
        Spacing near a pole, of the distance from it or of its damping, the larger of the two.
    near_edge : float
        Spacing near an edge of the band, of the distance from it: there the optimal functions have logarithmic
        singularities.
    at_edge : float
        Smallest spacing at an edge, of that in the band.
    """

    count: int
    near_pole: float
    near_edge: float = 0.25
    at_edge: float = 1 / 16


def mesh(band: tuple[float, float], poles: np.ndarray, grading: Grading) -> np.ndarray:
    """Graded nodes (n,) in rad/s, dense in the band, at its edges and at poles.

    Parameters
    ----------
    band : pair of float
        rad/s.
    poles : (p,) complex array
        rad/s.
    grading : Grading
    """
    sizes = np.abs(poles)
    low, high = min(band[0], np.min(sizes)) / REACH, max(band[1], np.max(sizes)) * REACH
    places = _fine(low, high, band, poles, grading)
    found = []
    for start, end in zip((low, *band), (*band, high), strict=True):
        # Nodes are where the integral of the density passes whole numbers; the band's edges are nodes.
        x = np.union1d(places[(places > start) & (places < end)], (start, end))
        density = 1 / _spacing(x, band, poles, grading)
        total = np.concatenate(([0.0], np.cumsum(np.diff(x) * 0.5 * (density[1:] + density[:-1]))))
        found.append(np.interp(np.linspace(0, total[-1], max(int(np.ceil(total[-1])), 1) + 1), total, x))
    return np.unique(np.concatenate(found))


def _spacing(omega: np.ndarray, band: tuple[float, float], poles: np.ndarray, grading: Grading) -> np.ndarray:
    """Spacing (f,) of the nodes about each frequency, rad/s."""
    width = (band[1] - band[0]) / grading.count
    outside = np.maximum(np.maximum(band[0] - omega, omega - band[1]), 0)
    spacing = np.minimum(_OCTAVES * omega, width + _OUTSIDE * outside)
    for edge in band:
        spacing = np.minimum(spacing, np.maximum(grading.near_edge * np.abs(omega - edge), grading.at_edge * width))
    for pole in poles:
        away = np.maximum(np.abs(omega - np.imag(pole)), _MIN_DAMPING * np.abs(pole))
        spacing = np.minimum(spacing, grading.near_pole * np.maximum(np.abs(np.real(pole)), away))
    return spacing


def _fine(low: float, high: float, band: tuple[float, float], poles: np.ndarray, grading: Grading) -> np.ndarray:
    """Points at which the density of nodes is integrated."""
    found = [np.geomspace(low, high, 2 * _FINE), np.linspace(*band, _FINE)]
    places = [(edge, grading.at_edge * (band[1] - band[0]) / grading.count) for edge in band]
    places += [(float(np.imag(p)), max(abs(float(np.real(p))), _MIN_DAMPING * abs(p))) for p in poles]
    for centre, width in places:
        away = np.geomspace(_NEAREST * width, max(centre, 2 * width), _FINE)
        found += [np.abs(centre - away), centre + away]
    points = np.unique(np.concatenate(found))
    return points[(points > low) & (points < high)]
