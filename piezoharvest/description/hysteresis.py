"""Prandtl-Ishlinskii hysteresis: stop operators (voltage from charge), play operators (charge from voltage).

Sources: Goldfarb & Celanovic, ASME J. Dyn. Syst. Meas. Control 119(3), 478-485, 1997 (Maxwell slip = stop type);
Krejci & Kuhnen, IEE Proc. Control Theory Appl. 148(3), 185-192, 2001, and Kuhnen, European J. Control 9(4), 407-418,
2003 (closed-form inverse).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.description.parameters import Component, ParameterError, quantity


def stop(signal: np.ndarray, threshold: float, initial: float = 0.0) -> np.ndarray:
    """Stop operator: follows the increments of the signal, saturated at +-threshold.

    Parameters
    ----------
    signal : (n,) array
        Input, piecewise monotone between its samples; `initial` applies at its first sample.
    threshold : float
        Saturation r, in the unit of the signal.
    initial : float
        Output at the first sample.

    Returns
    -------
    (n,) array
    """
    signal = np.asarray(signal, float)
    starts, run = _monotone(signal)
    values = [min(max(initial, -threshold), threshold)]
    for increment in np.diff(signal[starts]).tolist():
        values.append(min(max(values[-1] + increment, -threshold), threshold))
    return np.clip(np.array(values)[run] + (signal - signal[starts][run]), -threshold, threshold)


def play(signal: np.ndarray, threshold: float, initial: float = 0.0) -> np.ndarray:
    """Play (backlash) operator: signal minus its stop, so play + stop = signal.

    Parameters and return value as in `stop`; `initial` is the play's output before the first sample.
    """
    signal = np.asarray(signal, float)
    starts, run = _monotone(signal)
    values = [initial]
    for sample in signal[starts].tolist():
        values.append(min(max(values[-1], sample - threshold), sample + threshold))
    return np.clip(np.array(values[1:])[run], signal - threshold, signal + threshold)


def _monotone(signal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First samples of the monotone runs of a signal, and the run of every sample: within one, operators only clip."""
    starts = np.concatenate([[0], 1 + np.flatnonzero(np.diff(np.sign(np.diff(signal))))])
    return starts, np.repeat(np.arange(len(starts)), np.diff(starts, append=len(signal)))


@dataclass(frozen=True, kw_only=True)
class Hysteresis(Component):
    """Rate-independent hysteresis in the electrical domain, v_h = sum_i w_i stop(q; r_i), started from zero.

    Raises
    ------
    ParameterError
        Thresholds and weights differ in number, or thresholds do not increase.
    """

    thresholds: tuple[float, ...] = quantity("C", "thresholds r_i of the stop operators, increasing", above=0)
    weights: tuple[float, ...] = quantity("V/C", "weights w_i of the stop operators", at_least=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "thresholds", tuple(self.thresholds))
        object.__setattr__(self, "weights", tuple(self.weights))
        if len(self.thresholds) != len(self.weights):
            raise ParameterError(
                "weights",
                f"found {len(self.weights)} for {counted(len(self.thresholds), 'threshold')}, each threshold needs one",
            )
        for before, after in zip(self.thresholds, self.thresholds[1:], strict=False):
            if not np.all(after > before):
                raise ParameterError("thresholds", f"found {after} after {before}, allowed are increasing values")

    @property
    def acting(self) -> Hysteresis | None:
        """The operators that have a weight, without which they add no voltage; None if none has."""
        pairs = [(r, w) for r, w in zip(self.thresholds, self.weights, strict=True) if w > 0]
        if not pairs:
            return None
        return Hysteresis(thresholds=tuple(r for r, _ in pairs), weights=tuple(w for _, w in pairs))

    @property
    def stiffness(self) -> float:
        """Slope dv_h/dq in V/C with every operator sticking."""
        return sum(self.weights)

    def voltage(self, charge: np.ndarray) -> np.ndarray:
        """Voltage v_h (V) of a charge history (C) that starts from the virgin state at zero.

        Parameters
        ----------
        charge : (n,) array
            q_p, piecewise monotone between samples. The first sample is reached monotonically from zero.
        """
        path = np.concatenate(([0.0], np.asarray(charge, float)))
        total = np.zeros(len(path))
        for r, w in zip(self.thresholds, self.weights, strict=True):
            total += w * stop(path, r)
        return total[1:]

    def inverse(self, capacitance: float | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Play operators that invert the stop operators, in closed form (Krejci & Kuhnen 2001).

        Parameters
        ----------
        capacitance : float, optional
            Clamped capacitance C in F. With it, the inverse of q/C + v_h(q) is given: charge from the voltage of the
            clamped transducer. Without it, the inverse of v_h alone, which exists only up to its saturation.

        Returns
        -------
        thresholds : (n + 1,) array
            Play thresholds in V; the first is 0 (the charge that follows at once). n is the number of positive weights.
        slopes : (n + 1,) array
            Weights in F: charge = sum_j slopes_j play(v; thresholds_j). Without capacitance the last slope, beyond
            saturation, would be infinite and is left out: n play operators.

        Notes
        -----
        On the virgin curve q(v) is piecewise linear with slope 1/(1/C + sum of the weights still sticking), and its
        corners are at v(r_i); a play operator starts to move at its threshold with its slope. The thresholds of the
        play are the stop's initial-loading values because the operators are dual.
        """
        # Without weights above the last positive one, v_h is saturated and has no inverse.
        acting = self.acting
        r, w = (np.array(acting.thresholds), np.array(acting.weights)) if acting else (np.zeros(0), np.zeros(0))
        base = 0.0 if capacitance is None else 1.0 / capacitance
        sticking = base + np.concatenate((np.cumsum(w[::-1])[::-1], [0.0]))
        corner = np.concatenate(([0.0], np.cumsum(sticking[:-1] * np.diff(r, prepend=0.0))))
        if capacitance is None:
            sticking, corner = sticking[:-1], corner[:-1]
        slope = 1.0 / sticking
        return corner, np.diff(slope, prepend=0.0)

    def charge(self, voltage: np.ndarray, capacitance: float | None = None) -> np.ndarray:
        """Charge q_p (C) of a voltage history (V): the exact inverse of `voltage`, as play operators.

        Parameters
        ----------
        voltage : (n,) array
            v_h, or with `capacitance` q/C + v_h; the first sample is reached monotonically from zero.
        capacitance : float, optional
            Clamped capacitance C in F.

        Raises
        ------
        ParameterError
            Without capacitance: the voltage is above the saturation of the operators.
        """
        voltage = np.asarray(voltage, float)
        if capacitance is None:
            limit = float(np.dot(self.weights, self.thresholds))
            if np.max(np.abs(voltage), initial=0.0) > limit * (1 + 1e-12):
                raise ParameterError("voltage", f"found {np.max(np.abs(voltage)):g} V, must be at most {limit:g} V")
        thresholds, slopes = self.inverse(capacitance)
        total = np.zeros(len(voltage))
        for r, b in zip(thresholds, slopes, strict=True):
            total += b * play(voltage, r)
        return total

    def describing_function(self, amplitude: float) -> complex:
        """Complex gain v_h/q (V/C) for a sinusoidal charge of the given amplitude (C), demagnetised.

        The real part is the mean slope, the imaginary part the loss: the loop area is pi A^2 imag. Equivalent to
        Gelb & Vander Velde, Multiple-Input Describing Functions, 1968, for the elastoplastic element.
        """
        gain = 0j
        for r, w in zip(self.thresholds, self.weights, strict=True):
            if amplitude <= r:
                gain += w
                continue
            # After a reversal the element sticks until the charge has moved back by 2 r: the angle theta.
            theta = np.arccos(1.0 - 2.0 * r / amplitude)
            gain += w / np.pi * (theta - 0.5 * np.sin(2 * theta))
            gain += 1j * w * 4.0 * r * (amplitude - r) / (np.pi * amplitude**2)
        return gain

    def loss_per_cycle(self, amplitude: float) -> float:
        """Energy in J lost in a closed loop of charge amplitude A (C): sum of 4 w r (A - r) over slipping elements."""
        pairs = zip(self.thresholds, self.weights, strict=True)
        return sum(4.0 * w * r * (amplitude - r) for r, w in pairs if amplitude > r)
