"""Diodes as straight or broken lines: their drop, series resistance and reverse leakage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts.curves.voltage_curve import VoltageCurve

BOLTZMANN, CHARGE = 1.380649e-23, 1.602176634e-19  # J/K and C, exact in the SI
# Points of a half sine of the current, and the power by which they crowd at its zero, where the law bends within a
# share I_s/peak of it: means then hold to 1e-9 down to 1e-12 of it.
POINTS, CROWDED = 200, 10
ROOM = 300.15  # K
# Ratio of currents from one point of a curve to the next one, and the largest (A): pieces are within 0.25 n k T/q of
# the law, which is a few millivolts.
RATIO, LARGEST = 5.0, 1.0


@dataclass(frozen=True)
class DiodeLine:
    """Keys of a bridge that stand for its diodes, with the largest error of the forward voltage.

    Attributes
    ----------
    diode_drop : float
        V.
    diode_resistance : float
        ohm.
    diode_leakage : float
        S.
    error : float
        Root mean square of what the line leaves of the forward voltage, V.
    """

    diode_drop: float
    diode_resistance: float
    diode_leakage: float
    error: float

    @property
    def keys(self) -> dict[str, float]:
        """Keys for a table of [[shunts]], or arguments of its class."""
        return {name: value for name, value in asdict(self).items() if name != "error"}

    def mean_drop(self, peak_current: float) -> float:
        """Drop (V) without a resistance that takes the same energy of a half sine with this peak (A)."""
        return self.diode_drop + np.pi / 4 * self.diode_resistance * peak_current


def exponential_diode(
    saturation_current: float,
    emission: float,
    series_resistance: float,
    peak_current: float,
    *,
    reverse_voltage: float | None = None,
    temperature: float = ROOM,
) -> DiodeLine:
    """Line for v = n k T/q ln(1 + i/I_s) + R_s i (Shockley 1949), over a half sine of the current.

    Parameters
    ----------
    saturation_current : float
        I_s, A.
    emission : float
        n.
    series_resistance : float
        R_s, ohm.
    peak_current : float
        Of the half sine, A: the fit is best for currents of this size.
    reverse_voltage : float, optional
        At which I_s is taken for a conductance, V; default: no leakage.
    temperature : float
        K.

    Raises
    ------
    ParameterError
        A value is not positive.
    """
    values = {"saturation_current": saturation_current, "emission": emission, "peak_current": peak_current}
    _check_law({**values, "temperature": temperature}, series_resistance)
    if reverse_voltage is not None:
        _check_law({"reverse_voltage": reverse_voltage}, series_resistance)
    currents, shares = _half_sine(peak_current)
    thermal = emission * BOLTZMANN * temperature / CHARGE
    voltages = thermal * np.log1p(currents / saturation_current) + series_resistance * currents
    leakage = 0.0 if reverse_voltage is None else saturation_current / reverse_voltage
    return _line(voltages, currents, leakage, shares)


def exponential_curve(
    saturation_current: float, emission: float, series_resistance: float, *, temperature: float = ROOM
) -> VoltageCurve:
    """The same law as a broken line up to 1 A, for currents of any size.

    Its points are at equal steps of the junction's voltage, and raised so that the mean voltage of a piece that is
    passed at a steady rate is that of the law.

    Raises
    ------
    ParameterError
        A value is not positive.
    """
    values = {"saturation_current": saturation_current, "emission": emission, "temperature": temperature}
    _check_law(values, series_resistance)
    thermal = emission * BOLTZMANN * temperature / CHARGE
    step = np.log(RATIO)
    raised = RATIO * step / (RATIO - 1) - 1 - step / 2  # of the logarithm's mean over a piece above its chord's
    count = int(np.ceil(np.log1p(LARGEST / saturation_current) / step))
    steps = step * np.arange(1, count + 1)
    currents = saturation_current * np.expm1(steps)
    voltages = thermal * (steps + raised) + series_resistance * currents
    points = {"currents": (0.0, *currents), "voltages": (0.0, *voltages)}
    read = {key: tuple(float(f"{each:.6g}") for each in values) for key, values in points.items()}  # as one writes them
    return VoltageCurve(**read)


def straight_diode(curve: VoltageCurve, peak_current: float) -> DiodeLine:
    """Line for a curve, over a half sine of the current with this peak (A)."""
    currents, shares = _half_sine(peak_current)
    return _line(np.array([curve.at(each) for each in currents]), currents, 0.0, shares)


def measured_diode(voltages: Sequence[float], currents: Sequence[float]) -> DiodeLine:
    """Line through points of a data sheet: V and A, forward ones above zero, reverse ones (if any) below.

    Raises
    ------
    ParameterError
        There are fewer than two forward points, or numbers that are not finite.
    """
    v, i = np.asarray(voltages, float), np.asarray(currents, float)
    if v.ndim != 1 or v.shape != i.shape or not np.all(np.isfinite(v)) or not np.all(np.isfinite(i)):
        raise ParameterError("voltages", "found other than two equally long lists of finite numbers")
    forward, backward = i > 0, (i < 0) & (v < 0)
    if len(np.unique(i[forward])) < 2:
        raise ParameterError("currents", f"found {np.sum(forward)} above zero, allowed are two or more that differ")
    leakage = float(i[backward] @ v[backward] / (v[backward] @ v[backward])) if np.any(backward) else 0.0
    return _line(v[forward], i[forward], leakage, np.full(len(v[forward]), 1.0 / len(v[forward])))


def _check_law(values: Mapping[str, float], series_resistance: float) -> None:
    """Raise `ParameterError` unless all values are above zero, and the resistance is not below it."""
    for name, value in values.items():
        if not (np.isfinite(value) and value > 0):
            raise ParameterError(name, f"found {value}, must be a finite number greater than 0")
    if not (np.isfinite(series_resistance) and series_resistance >= 0):
        raise ParameterError("series_resistance", f"found {series_resistance}, must be a finite number at least 0")


def _half_sine(peak: float) -> tuple[np.ndarray, np.ndarray]:
    """Currents (A) of a rising quarter period, and the share of it that each stands for (Gauss-Legendre)."""
    nodes, weights = np.polynomial.legendre.leggauss(POINTS)
    x = (nodes + 1) / 2
    return peak * np.sin(np.pi / 2 * x**CROWDED), weights / 2 * CROWDED * x ** (CROWDED - 1)


def _line(voltages: np.ndarray, currents: np.ndarray, leakage: float, shares: np.ndarray) -> DiodeLine:
    """Least squares weighted by the current, as the power in the diodes is; no value below zero."""
    power = shares * currents / currents.max()
    weights = np.sqrt(power)
    columns = np.stack([np.ones_like(currents), currents], axis=1)
    drop, resistance = np.linalg.lstsq(weights[:, None] * columns, weights * voltages, rcond=None)[0]
    if drop < 0:
        drop, resistance = 0.0, float((currents * voltages) @ power / (currents**2 @ power))
    if resistance < 0:
        drop, resistance = float(voltages @ power / np.sum(power)), 0.0
    left = voltages - drop - resistance * currents
    return DiodeLine(float(drop), float(resistance), leakage, float(np.sqrt(left**2 @ shares)))
