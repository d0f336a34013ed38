"""Nominal values from records of a specimen of which nothing is known: linear regression of their spectra.

F = k x + b x' + m x'' - T v and i = -(C v' + T x'), with i the load current, are linear in what is sought. Noise
biases such a regression (Pintelon & Schoukens, System Identification, 2nd ed., ch. 7): good for the start of a fit.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import comb

import numpy as np

_SHARE = 0.999  # of the drive's power: the lines that have it are used, others are mostly noise
_EXPLAINED = 0.5  # least share of the drive's power that the regression explains: of unrelated channels it is nearly 0
_LEAST_LINES = 8  # for three to four values
_FLANK = 0.2  # of the mobility at a resonance: lines up to five half widths away, beyond is another's
_INTEGRALS = {"displacement": 0, "velocity": 1, "acceleration": 2}  # to the displacement


def rough_values(channels: Mapping[str, np.ndarray], rate: float, *, resonant: bool = False) -> dict[str, float]:
    """Mass, damping and stiffness, and coupling and capacitance where the records tell them.

    Parameters
    ----------
    channels : mapping of str to array (n,)
        In SI units: force and a motion (`displacement`, `velocity` or `acceleration`) at least; voltage and current for
        the electrical values.
    rate : float
        Hz.
    resonant : bool
        Only of records in which the resonance was driven, as mass and damping are rough in others.

    Returns
    -------
    dict
        Empty where samples are missing, or the regression gives no specimen: a value below zero, too few lines, a drive
        that is not explained.
    """
    motion = next((name for name in _INTEGRALS if name in channels), None)
    if "force" not in channels or motion is None or len(channels["force"]) < 2 * _LEAST_LINES:
        return {}
    if not all(np.isfinite(values).all() for values in channels.values()):
        return {}
    order = _INTEGRALS[motion]
    windowed = _Windowed({name: values - np.mean(values) for name, values in channels.items()}, rate)
    windowed.lines = _strong(windowed.derivative("force", 0))
    if len(windowed.lines) < _LEAST_LINES:
        return {}
    # Both equations are differentiated as often as the motion that was measured is the displacement, and weighted back.
    windowed.weight = order
    force = windowed.derivative("force", order)
    moved = [windowed.derivative(motion, n) for n in range(3)]
    columns = [*moved, *([-windowed.derivative("voltage", order)] if "voltage" in channels else [])]
    coefficients = _regressed(columns, force)
    left = force - np.column_stack(columns) @ coefficients
    if np.linalg.norm(left) ** 2 > (1.0 - _EXPLAINED) * np.linalg.norm(force) ** 2:
        return {}
    stiffness, damping, mass, *_ = coefficients
    found = {"mass": mass, "damping": damping, "stiffness": stiffness}
    driven = np.abs(windowed.s[windowed.lines]) ** 2 * mass
    if resonant and not driven.min() < stiffness < driven.max():
        return {}
    if "voltage" in channels and "current" in channels:
        charged = [-windowed.derivative("voltage", order + 1), -moved[1]]
        capacitance, coupling = _regressed(charged, windowed.derivative("current", order))
        found |= {"coupling": coupling, "capacitance": capacitance}
    return _if_positive(found)


class _Windowed:
    """Spectra of derivatives of signals under the window w = sin^4, from the signals themselves.

    The integral of w x' exp(-s t) is, by parts, that of (s w - w') x exp(-s t), as the window is zero at its ends with
    its derivatives up to the third. What a motion was doing before the record is not part of it, so that a resonance
    which is narrower than a line has its own damping (Shinbrot, Trans. ASME 79, 547-552, 1957).
    """

    def __init__(self, signals: Mapping[str, np.ndarray], rate: float):
        self.signals, count = signals, len(next(iter(signals.values())))
        self.angle, self.turn = 2 * np.pi * (np.arange(count) + 0.5) / count, 2 * np.pi * rate / count
        self.s = 2j * np.pi * np.fft.rfftfreq(count, 1.0 / rate)
        self.lines: np.ndarray | slice = slice(None)
        self.weight = 0

    def derivative(self, name: str, order: int) -> np.ndarray:
        """Spectrum of a derivative of a signal, in the lines, over `weight` factors of the frequency."""
        terms = (
            comb(order, k) * self.s ** (order - k) * (-1) ** k * np.fft.rfft(self._window(k) * self.signals[name])
            for k in range(order + 1)
        )
        return np.sum(list(terms), axis=0)[self.lines] / self.s[self.lines] ** self.weight

    def _window(self, order: int) -> np.ndarray:
        """Derivative of the window: of (3 - 4 cos a + cos 2 a)/8."""
        late = order * np.pi / 2
        waves = -4 * np.cos(self.angle + late) + 2**order * np.cos(2 * self.angle + late)
        return self.turn**order * (waves + 3 * (order == 0)) / 8


def rough_values_of_response(frequency: np.ndarray, response: np.ndarray, output: str) -> dict[str, float]:
    """Mass, damping and stiffness from a motion over a force; the stiffness is that with the record's load.

    Of several modes, they are those of the strongest resonance: of all lines together, a second mode made the mass tens
    of times too small, or left no value.

    Parameters
    ----------
    frequency : (n,) array
        Hz.
    response : (n,) complex array
        SI units.
    output : str
        `displacement`, `velocity` or `acceleration`; for others nothing is found.

    Returns
    -------
    dict
        Empty where the response is not that of a mode.
    """
    if output not in _INTEGRALS or len(frequency) < _LEAST_LINES or not np.isfinite(response).all():
        return {}
    s = 2j * np.pi * frequency
    receptance = response / s ** _INTEGRALS[output]
    near = _resonance(np.abs(s * receptance))
    s, receptance = s[near], receptance[near]
    weight = np.abs(receptance)  # lines at the resonance, where the noise is least beside the response
    # (k + b s + m s^2) (H - R) = 1 with the compliance R of what resonates elsewhere, over 1 + R k.
    columns = [weight * receptance * s**power for power in range(3)] + [weight * s**power for power in (1, 2)]
    coefficients = _regressed(columns, weight + 0j)
    stiffness, damping, mass, _, other = coefficients
    with np.errstate(all="ignore"):  # values of no specimen are left out
        scale = 1.0 / (1.0 + other / mass * stiffness)
        stiffness, damping, mass = stiffness * scale, damping * scale, mass * scale
        left = receptance - 1.0 / (stiffness + damping * s + mass * s**2) + other * scale / mass
    # A constant explains the rest of the compliance as well: what counts is what it leaves.
    whole = receptance - np.mean(receptance)
    if not np.linalg.norm(left) ** 2 < (1.0 - _EXPLAINED) * np.linalg.norm(whole) ** 2:
        return {}
    return _if_positive({"mass": mass, "damping": damping, "stiffness": stiffness})


def _resonance(mobility: np.ndarray) -> slice:
    """The lines about the strongest resonance, in which it is seen beside others.

    Parameters
    ----------
    mobility : (n,) array
        Magnitude of velocity over force, which is 1/b at the resonance of each mode.
    """
    peak = int(np.argmax(mobility))
    weak = np.flatnonzero(mobility < _FLANK * mobility[peak])
    first = weak[weak < peak].max(initial=-1) + 1
    last = weak[weak > peak].min(initial=len(mobility)) - 1
    return slice(max(min(first, peak - _LEAST_LINES), 0), max(last, peak + _LEAST_LINES) + 1)


def _if_positive(found: Mapping[str, float]) -> dict[str, float]:
    """The values, if they are those of a specimen."""
    positive = all(np.isfinite(value) and value > 0 for name, value in found.items() if name != "coupling")
    return {name: float(value) for name, value in found.items()} if positive else {}


def _strong(spectrum: np.ndarray) -> np.ndarray:
    """The fewest lines above 0 Hz that have most of the power, in their order."""
    power = np.abs(spectrum) ** 2
    power[:2] = 0.0  # the mean, as far as the window spreads it
    order = np.argsort(power)[::-1]
    share = np.cumsum(power[order]) / max(power.sum(), np.finfo(float).tiny)
    return np.sort(order[: int(np.searchsorted(share, _SHARE)) + 1])


def _regressed(columns: list[np.ndarray], wanted: np.ndarray) -> np.ndarray:
    """Real coefficients of complex columns, by least squares."""
    matrix = np.column_stack([_parts(column) for column in columns])
    size = np.linalg.norm(matrix, axis=0)
    size[size == 0] = 1.0
    return np.linalg.lstsq(matrix / size, _parts(wanted), rcond=None)[0] / size


def _parts(values: np.ndarray) -> np.ndarray:
    """Real parts, and the imaginary ones behind them."""
    return np.concatenate([np.real(values), np.imag(values)])
