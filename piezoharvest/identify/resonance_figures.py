"""Figures of identified resonances: they are often known better than the coupling and the capacitance behind them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from piezoharvest.description.transducer import Transducer
from piezoharvest.linear import coupling_factor, resonances
from piezoharvest.predict.parameters import Path, put, value_at

STEP = 1e-5  # relative, of a parameter, for central differences: near the cube root of an eigenvalue's rounding, 1e-15
FELT = 1e-4  # relative change of a figure over that of a parameter, below which it is rounding (1e-15 over STEP)


@dataclass(frozen=True)
class ResonanceFigure:
    """A figure of a resonance that follows from identified parameters.

    Attributes
    ----------
    name : str
        `short_circuit_frequency`, `open_circuit_frequency` (undamped) or `coupling_squared` (k_e^2); of several modes
        with the number of the mode by frequency from 0, as `coupling_squared.1`.
    value, std : float
        In `unit`.
    unit : str
    """

    name: str
    value: float
    std: float
    unit: str


def resonance_figures(
    transducer: Transducer, paths: Sequence[Path], covariance: np.ndarray, known: Sequence[bool]
) -> tuple[ResonanceFigure, ...]:
    """Figures of the resonances, with standard errors that follow from those of the parameters and their correlations.

    Parameters
    ----------
    transducer : Transducer
        With the identified values.
    paths : sequence of tuple
        Of the transducer's parameters, (n,).
    covariance : (n, n) array
        Of their values, SI units.
    known : sequence of bool
        Whether the records determine each of them; a figure that depends on one that they do not is left out.
    """
    found = _figures(transducer)
    slopes = np.zeros((len(paths), found.size))
    felt = np.zeros(slopes.shape, bool)
    for n, path in enumerate(paths):
        value = float(np.real(value_at(transducer, path)))
        step = STEP * (abs(value) or 1.0)
        ends = value + step, value - step if value != 0.0 else 0.0  # a damping may be zero, and not less
        above, below = (_figures(put(transducer, path, end)) for end in ends)
        slopes[n] = (above - below) / (ends[0] - ends[1])
        felt[n] = np.abs(above - below) > FELT * STEP * np.abs(found)
    variances = np.einsum("nf,nm,mf->f", slopes, covariance, slopes)
    return tuple(
        ResonanceFigure(name, float(value), float(max(variance, 0.0)) ** 0.5, unit)
        for (name, unit), value, variance, on in zip(
            _names(len(transducer.all_modes)), found, variances, felt.T, strict=True
        )
        if on.any() and np.all(np.array(known)[on])
    )


def _names(modes: int) -> Iterator[tuple[str, str]]:
    for name, unit in (("short_circuit_frequency", "Hz"), ("open_circuit_frequency", "Hz"), ("coupling_squared", "")):
        yield from ((name if modes == 1 else f"{name}.{n}", unit) for n in range(modes))


def _figures(transducer: Transducer) -> np.ndarray:
    """Values in the order of the names."""
    found = resonances(transducer)
    factors = coupling_factor(transducer).effective
    return np.concatenate([found.short_circuit.undamped, found.open_circuit.undamped, factors])
