"""Resonances with shorted and with open electrodes, and the coupling factors that follow from them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezoharvest.description.shunts.base import LinearShunt
from piezoharvest.description.shunts.linear.open import Open
from piezoharvest.description.shunts.linear.short import Short
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.linear.assembly import OperatingPoint, hysteresis_slope
from piezoharvest.linear.stability import poles


class Resonance(NamedTuple):
    """Resonances under one electrical condition.

    Attributes
    ----------
    undamped : (n,) array
        Natural frequencies of all n modes without damping and without effects, Hz, increasing.
    natural : (p,) array
        Magnitude of the damped poles over 2 pi, Hz, increasing; overdamped modes are omitted.
    damping_ratio : (p,) array
        -Re s/|s| of these poles.
    """

    undamped: np.ndarray
    natural: np.ndarray
    damping_ratio: np.ndarray

    @property
    def damped(self) -> np.ndarray:
        """Damped frequencies natural * sqrt(1 - damping_ratio^2), Hz, (p,) array."""
        return self.natural * np.sqrt(1 - self.damping_ratio**2)


class Resonances(NamedTuple):
    """Resonances with shorted and with open electrodes."""

    short_circuit: Resonance
    open_circuit: Resonance


class CouplingFactors(NamedTuple):
    """Coupling of each mode, from its two undamped resonances.

    Attributes
    ----------
    effective : (n,) array
        k_e^2 = (w_oc^2 - w_sc^2)/w_sc^2, with one mode T^2/(k C): the K^2 of shunt damping, may exceed 1.
    material : (n,) array
        k^2 = (w_oc^2 - w_sc^2)/w_oc^2 = k_e^2/(1 + k_e^2): share of the energy converted, below 1; for a stack in its
        33 mode the material's d^2/(s eps) (IEEE Std 176-1987).
    """

    effective: np.ndarray
    material: np.ndarray


def resonances(transducer: Transducer, *, operating_point: OperatingPoint = "stick") -> Resonances:
    """Short- and open-circuit resonance frequencies and damping ratios of all modes.

    Shorted, or open, are the electrodes 0; further ones are open in both.

    Parameters
    ----------
    transducer : Transducer
    operating_point : "stick", "slip" or sequence of bool
        Hysteresis by its slope. Sticking operators are elastic, and shorted electrodes do not short the capacitance:
        "short_circuit" is then above sqrt(k/m).
    """
    return Resonances(
        _resonance(transducer, Short(), operating_point, shorted=True),
        _resonance(transducer, Open(), operating_point, shorted=False),
    )


def coupling_factor(transducer: Transducer, *, operating_point: OperatingPoint = "stick") -> CouplingFactors:
    """Coupling factors of all modes from their undamped short- and open-circuit resonances.

    Parameters
    ----------
    transducer : Transducer
    operating_point : "stick", "slip" or sequence of bool
        Hysteresis by its slope, as in `resonances`.
    """
    short, opened = (r.undamped**2 for r in resonances(transducer, operating_point=operating_point))
    return CouplingFactors((opened - short) / short, (opened - short) / opened)


def _resonance(transducer: Transducer, shunt: LinearShunt, operating_point: OperatingPoint, shorted: bool) -> Resonance:
    """Undamped frequencies by the symmetric eigenvalue problem of stiffness and mass, damped ones by the poles."""
    modes = transducer.all_modes
    root_mass = np.sqrt([mode.mass for mode in modes])
    coupling = np.array([mode.coupling for mode in modes]) / root_mass
    # With v_p = 0 the sticking hysteresis (slope h) is in series with C: stiffness T T'/(C + 1/h); open, T T'/C.
    slope = float(np.real(hysteresis_slope(transducer, operating_point)))
    elastance = slope / (1 + slope * transducer.capacitance) if shorted else 1 / transducer.capacitance
    stiffness = np.diag([mode.stiffness / mode.mass for mode in modes]) + elastance * np.outer(coupling, coupling)
    for electrode in transducer.electrodes:  # open
        own = np.array(electrode.couplings) / root_mass
        stiffness += np.outer(own, own) / electrode.capacitance
    found = poles(System(transducer, shunt), operating_point=operating_point)
    found = found[np.imag(found) > 0]
    return Resonance(
        np.sqrt(np.linalg.eigvalsh(stiffness)) / (2 * np.pi),
        np.abs(found) / (2 * np.pi),
        -np.real(found) / np.abs(found),
    )
