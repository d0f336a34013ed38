"""Operating conditions of a design: the excitation as spectral lines for the linear two-port, and as single runs."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.special import roots_legendre

from piezoharvest.description.excitation import Excitation, Multisine, Tones
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts.linear.open import Open
from piezoharvest.description.shunts.linear.short import Short
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.linear import poles, resonances

_MEAN_ERROR = 1e-9  # relative error of a mean over a band on the two-port
_MAX_NODES = 400
_PANEL_NODES = 10
_LEAST_STEPS = 24  # of a band in which a frequency is sought
_WIDENING = 0.4  # step over distance from a resonance: so that two steps on each side of it are about its half width
_SHARPEST = 1e-6  # damping ratio; resonances that are sharper are looked at as if they were not
_SAMPLES = 2**16  # of a signal whose spectrum is taken
_BINS = 4096


@dataclass(frozen=True, eq=False)
class Operation:
    """Excitation and band that a design is optimised for.

    Attributes
    ----------
    excitation : Excitation
    band : (float, float) or None
        Hz; where given, the excitation is a sine that goes through the band with its amplitude kept.
    frequencies, squares : (n,) array
        Lines in Hz and their squared peak values, with which linear powers add up: over a band the nodes and weights
        of a Gauss-Legendre mean, for noise those of its integral.
    apart : bool
        True if the lines are single sines one at a time, False if they act together.
    """

    excitation: Excitation
    band: tuple[float, float] | None
    frequencies: np.ndarray
    squares: np.ndarray
    apart: bool

    @property
    def base(self) -> bool:
        """True if the excitation is base acceleration."""
        return self.excitation.base

    @property
    def periodic(self) -> bool:
        """True if there is a periodic steady state."""
        return self.excitation.period is not None

    @property
    def amplitude(self) -> float:
        """Amplitude of the sine (for sinusoidal excitations)."""
        return float(np.sqrt(np.sum(self.squares)))

    def centre(self, transducer: Transducer) -> float:
        """Frequency in Hz at which closed forms are evaluated: a driven resonance, else the strongest line."""
        if self.apart and self.band is None:
            return float(self.frequencies[0])
        found = resonances(transducer)
        both = np.sqrt(found.short_circuit.undamped * found.open_circuit.undamped)
        inside = both[(both >= self.frequencies[0]) & (both <= self.frequencies[-1])]
        if len(inside) and not isinstance(self.excitation, Multisine):
            return float(inside[0])
        return float(self.frequencies[np.argmax(self.squares)])

    def modes(self, transducer: Transducer) -> list[tuple[float, float]]:
        """Short- and open-circuit resonances (rad/s) of the modes in the band, the most strongly coupled first.

        Of all modes where the excitation has no band.
        """
        found = resonances(transducer)
        pairs = 2 * np.pi * np.transpose([found.short_circuit.undamped, found.open_circuit.undamped])
        if len(self.frequencies) > 1:
            low, high = 2 * np.pi * self.frequencies[[0, -1]]
            pairs = pairs[(pairs[:, 1] >= low) & (pairs[:, 0] <= high)]
        return [(float(s), float(o)) for s, o in sorted(pairs, key=lambda pair: pair[0] / pair[1])]

    def at(self, frequency: float | np.ndarray) -> Excitation:
        """The sine at another frequency (Hz), or a batch of sines at frequencies (n, 1)."""
        return dataclasses.replace(self.excitation, frequency=frequency)


def operation_of(excitation: Excitation, band: tuple[float, float] | None, transducer: Transducer) -> Operation:
    """Operation from an excitation; `band` is used with a sine only.

    Raises
    ------
    ParameterError
        The excitation is zero.
    """
    if is_sine(excitation):
        if band is None:
            lines = np.array([excitation.frequency]), np.ones(1)  # pyright: ignore[reportAttributeAccessIssue]
        else:
            lines = mean_nodes(band, transducer, _MEAN_ERROR, _MAX_NODES)
        square = excitation.amplitude**2  # pyright: ignore[reportAttributeAccessIssue]
        operation = Operation(excitation, band, lines[0], lines[1] * square, apart=True)
    else:
        operation = Operation(excitation, None, *_lines(excitation, transducer), apart=False)
    if not np.sum(operation.squares) > 0:
        raise ParameterError("excitation", f"found {excitation.kind} of zero amplitude, must have one above 0")
    return operation


def is_sine(excitation: Excitation) -> bool:
    """True if the excitation is a single sine, which can be swept through a band."""
    return hasattr(excitation, "frequency") and hasattr(excitation, "amplitude")


def mean_nodes(
    band: tuple[float, float], transducer: Transducer, tolerance: float, most: int
) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (Hz) and weights of the mean over a band of what the transducer answers, by Gauss-Legendre quadrature.

    Notes
    -----
    The error of n nodes falls as rho^(-2 n), rho being the size of the Bernstein ellipse through the nearest pole of
    the integrand (Trefethen, SIAM Review 50(1), 67-87, 2008). The poles with shorted and with open electrodes are
    taken: a load that takes power damps more. `most` caps the number.
    """
    middle, half = 0.5 * (band[0] + band[1]), 0.5 * (band[1] - band[0])
    # Of real frequency: a pole's distance from it is its damping.
    places = (_extreme_poles(transducer) / (2j * np.pi) - middle) / half
    root = np.sqrt(places**2 - 1 + 0j)
    ellipse = float(np.min(np.maximum(np.abs(places + root), np.abs(places - root)), initial=1e3))
    needed = np.log(1 / tolerance) / (2 * np.log(max(ellipse, 1 + 1e-9)))
    nodes, weights = _gauss(int(np.clip(np.ceil(needed) + 1, 5, most)))
    return middle + half * nodes, 0.5 * weights


def graded_nodes(band: tuple[float, float], transducer: Transducer) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (Hz) and weights of a mean over a band that may be far wider than its resonances.

    Gauss-Legendre quadrature in panels whose widths double with the distance from a pole; their Bernstein ellipses
    end at more than three times their size, so that ten nodes leave 1e-9.
    """
    edges = list(band)
    for pole in _extreme_poles(transducer) / (2 * np.pi):
        damping = max(-float(np.real(pole)), 1e-9 * abs(pole))
        doublings = max(int(np.ceil(np.log2(band[1] / damping))), 1)
        away = damping * 2.0 ** np.arange(doublings + 1)
        edges += [float(np.imag(pole)), *(np.imag(pole) - away), *(np.imag(pole) + away)]
    # A low edge far below everything is approached by halves, too.
    edges += list(band[1] / 2.0 ** np.arange(1, int(np.clip(np.log2(band[1] / band[0]), 1, 40))))
    edges = np.unique(np.clip(edges, *band))
    nodes, weights = _gauss(_PANEL_NODES)
    middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    return (middle[:, None] + half[:, None] * nodes).ravel(), (half[:, None] * weights).ravel() / (band[1] - band[0])


def widening_grid(band: tuple[float, float], transducer: Transducer) -> np.ndarray:
    """Frequencies (n,) in Hz over a band in which no resonance is missed, with shorted or open electrodes.

    Steps of a quarter of the half-power width at each resonance, which widen evenly away from it.
    """
    found = _extreme_poles(transducer) / (2 * np.pi)
    places, quarters = np.imag(found), 0.5 * np.maximum(-np.real(found), _SHARPEST * np.abs(found))
    widest, grid = (band[1] - band[0]) / _LEAST_STEPS, [band[0]]
    while grid[-1] < band[1]:
        steps = np.hypot(quarters, _WIDENING * (grid[-1] - places))
        grid.append(grid[-1] + min(widest, float(np.min(steps, initial=widest))))
    steps = np.array(grid) - band[0]
    return band[0] + (band[1] - band[0]) * steps / steps[-1]


def narrowest_width(transducer: Transducer) -> float:
    """Half-power width in Hz of the least damped resonance, shorted or open."""
    damping = float(np.min(-np.real(_extreme_poles(transducer)), initial=np.inf))
    return max(damping / np.pi, 1e-6 * transducer.short_circuit_frequency)


def _extreme_poles(transducer: Transducer) -> np.ndarray:
    """Poles in rad/s with shorted and with open electrodes, one of each pair."""
    found = np.concatenate([poles(System(transducer, shunt)) for shunt in (Short(), Open())])
    return found[np.imag(found) > 0]


@cache
def _gauss(count: int) -> tuple[np.ndarray, np.ndarray]:
    return roots_legendre(count)


def _lines(excitation: Excitation, transducer: Transducer) -> tuple[np.ndarray, np.ndarray]:
    """Lines and squared peak values of an excitation that is not one sine."""
    psd = getattr(excitation, "psd", None)
    if psd is not None:
        band: tuple[float, float] = excitation.band  # pyright: ignore[reportAttributeAccessIssue]
        band = (max(band[0], 1e-6 * band[1]), band[1])
        nodes, weights = graded_nodes(band, transducer)
        # The expectation, not one realisation: a load should not be fitted to the seed.
        return nodes, 2 * psd * (band[1] - band[0]) * weights
    signal = excitation.signal()
    if isinstance(signal, Tones):
        phasors = signal.amplitudes * np.exp(1j * signal.phases)
        frequencies, where = np.unique(signal.frequencies, return_inverse=True)
        total = np.zeros(len(frequencies), complex)
        np.add.at(total, where, phasors)
        return frequencies, np.abs(total) ** 2
    return _spectrum(signal, excitation, transducer)


def _spectrum(signal, excitation: Excitation, transducer: Transducer) -> tuple[np.ndarray, np.ndarray]:
    """Lines of a signal of finite length, up to twice the highest resonance, grouped in bins."""
    length = float(excitation.length or signal.times[-1])
    highest = 2 * float(np.max(resonances(transducer).open_circuit.undamped))
    count = int(np.clip(4 * highest * length, 256, _SAMPLES))
    values = signal.at(np.arange(count) * (length / count)) - excitation.rest
    squares = np.abs(2 * np.fft.rfft(values) / count)[1:] ** 2
    frequencies = np.arange(1, len(squares) + 1) / length
    inside = frequencies <= max(highest, frequencies[0])
    frequencies, squares = frequencies[inside], squares[inside]
    if len(frequencies) > _BINS:
        edges = np.linspace(0, len(frequencies), _BINS + 1).astype(int)[:-1]
        frequencies = np.add.reduceat(frequencies, edges) / np.diff(edges, append=len(frequencies))
        squares = np.add.reduceat(squares, edges)
    heard = squares > np.finfo(float).eps * np.max(squares, initial=0.0)
    return frequencies[heard], squares[heard]
