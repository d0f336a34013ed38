"""A periodic signal as a constant and harmonics, fitted to noisy samples of a few periods.

Least squares for the frequency, the constant and the harmonics together, by Gauss-Newton: the estimate of greatest
likelihood in white noise (Handel, IEEE Trans. Instrum. Meas. 49(6), 1189-1193, 2000, for a single sine, as in IEEE Std
1057, four parameters).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.signal.windows import hann

HIGHEST_ORDER = 10  # of the harmonics that are looked for: a shaker distorts in its lowest ones
ROUNDING = 1e-9  # of a signal's range: what is smaller may be arithmetic or the digits of a file
FALSE_ALARM = 1e-3  # probability that noise alone gives a constant or a harmonic in a signal
PADDING = 8  # times the samples, of the transform that gives the first frequency: a start within a fifth of a line
ITERATIONS, TOLERANCE = 30, 1e-12  # of Gauss-Newton, and relative change of the frequency at its end


@dataclass(frozen=True, eq=False)
class Harmonics:
    """offset + Re sum sizes exp(2 pi j orders frequency t), t in s from the first sample.

    Attributes
    ----------
    frequency : float
        Hz.
    offset : float
        In the signal's unit; 0 where noise would give as much.
    orders : (k,) int array
        Significant ones, the first of which is 1.
    sizes : (k,) complex array
    stated : bool
        The frequency is known, not fitted.
    """

    frequency: float
    offset: float
    orders: np.ndarray
    sizes: np.ndarray
    stated: bool

    @property
    def period(self) -> float:
        """Period, s."""
        return 1.0 / self.frequency

    def at(self, times: np.ndarray) -> np.ndarray:
        """Values (n,) at times (n,) in s."""
        turns = np.exp(2j * np.pi * self.frequency * np.multiply.outer(times, self.orders))
        return self.offset + np.real(turns @ self.sizes)

    def refitted(self, values: np.ndarray, step: float) -> Self:
        """The same constant and orders fitted to other samples (n,), a time `step` (s) apart."""
        return self._fitted(values, step, self.frequency, self.stated, self.offset != 0.0, self.orders)[0]

    @classmethod
    def of(cls, values: np.ndarray, step: float, frequency: float | None = None) -> Self | None:
        """Fit to samples (n,), a time `step` apart, with a given frequency or the best one; None if there is no sine.

        Parameters
        ----------
        values : (n,) array
        step : float
            s.
        frequency : float, optional
            Hz.
        """
        begin = _strongest(values, step) if frequency is None else frequency
        most = min(HIGHEST_ORDER, int(0.5 / (begin * step) * (1.0 - 1e-9)), (len(values) - 3) // 4)
        if most < 1:
            return None
        found, covariance = cls._fitted(values, step, begin, frequency is not None, True, np.arange(1, most + 1))
        # Constant, cosines and sines are judged by their squares in units of their variance, chi-square distributed.
        spread = np.maximum(np.diag(covariance), (ROUNDING * float(np.ptp(values))) ** 2 + 1e-300)
        shown = found.offset**2 / spread[0] > -2.0 * np.log(FALSE_ALARM)
        of_cosines, of_sines = spread[1 : 1 + most], spread[1 + most : 1 + 2 * most]
        squares = np.real(found.sizes) ** 2 / of_cosines + np.imag(found.sizes) ** 2 / of_sines
        kept = squares > -2.0 * np.log(FALSE_ALARM / most)
        if not kept[0]:
            return None
        return cls._fitted(values, step, found.frequency, found.stated, bool(shown), found.orders[kept])[0]

    @classmethod
    def _fitted(
        cls, values: np.ndarray, step: float, frequency: float, stated: bool, constant: bool, orders: np.ndarray
    ) -> tuple[Self, np.ndarray]:
        """Fit, and the covariance of constant, cosines, sines and, unless it is stated, frequency."""
        time, k = (np.arange(len(values)) - 0.5 * (len(values) - 1)) * step, len(orders)
        for _ in range(ITERATIONS):
            turns = np.exp(2j * np.pi * frequency * np.multiply.outer(time, orders))
            columns = np.column_stack([constant * np.ones(len(time)), np.real(turns), np.imag(turns)])
            sizes = _solved(columns, values)
            # Re c exp(j a) with c = p - j s for the columns cos and sin; its derivative is Re j a' c exp(j a).
            c = sizes[1 : 1 + k] - 1j * sizes[1 + k :]
            if stated:
                break
            moving = 2.0 * np.pi * time * np.real(1j * turns @ (orders * c))
            columns = np.column_stack([columns, moving])
            change = _solved(columns, values - columns[:, :-1] @ sizes)[-1]
            # By no more than half a line at a time: further off another line of the spectrum would be the nearest.
            half = 0.5 / (len(values) * step)
            frequency = max(frequency + float(np.clip(change, -half, half)), half)
            if abs(change) < TOLERANCE * frequency:
                break
        left = values - columns[:, : 1 + 2 * k] @ sizes
        spread = left @ left / max(len(values) - columns.shape[1], 1)
        covariance = spread * np.linalg.pinv(columns.T @ columns, hermitian=True)
        late = np.exp(2j * np.pi * frequency * orders * (-time[0]))  # from the middle to the first sample
        return cls(frequency, float(sizes[0]) if constant else 0.0, orders, c / late, stated), covariance


def _solved(columns: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Least squares by the normal equations: the columns are few and nearly orthogonal."""
    size = np.sqrt(np.maximum((columns**2).sum(axis=0), 1e-300))
    scaled = columns / size
    return np.linalg.lstsq(scaled.T @ scaled, scaled.T @ values, rcond=1e-12)[0] / size


def _strongest(values: np.ndarray, step: float) -> float:
    """Frequency (Hz) of the largest line above the lowest ones, which the mean reaches into."""
    n = len(values)
    power = np.abs(np.fft.rfft((values - values.mean()) * hann(n, sym=False), PADDING * n)) ** 2
    lowest = PADDING // 2
    return float(lowest + np.argmax(power[lowest:])) / (PADDING * n * step)
