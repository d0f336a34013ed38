"""Electrodes as a shunt sees them: impedance, open-circuit voltage, and what a current does to the displacement."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from piezoharvest.description.shunts.linear.open import Open
from piezoharvest.description.shunts.linear.short import Short
from piezoharvest.description.system import System
from piezoharvest.design.linear_view import LinearView
from piezoharvest.linear import TwoPort, poles

_LOW = 1e-4  # of the lowest resonance: far below it the electrodes are a capacitance, if nothing leaks


class PortValues(NamedTuple):
    """Values at frequencies; all per unit of the drive's peak value.

    With the admittance Q = 1/(Z + Z_s) of the loop, a shunt Z_s draws the current i = Q v and the displacement is
    x = x_oc + a Q.

    Attributes
    ----------
    impedance : (f,) complex array
        Z of the electrodes without the drive, ohm.
    voltage : (f,) complex array
        v, with open electrodes, V.
    displacement : (f,) complex array
        x_oc, with open electrodes, m.
    influence : (f,) complex array
        a, m ohm.
    """

    impedance: np.ndarray
    voltage: np.ndarray
    displacement: np.ndarray
    influence: np.ndarray

    @property
    def resistance(self) -> np.ndarray:
        """Re Z, ohm."""
        return np.real(self.impedance)


@dataclass(frozen=True, eq=False)
class ElectrodePort:
    """The electrodes of a transducer in its operation."""

    view: LinearView

    def at(self, omega: np.ndarray) -> PortValues:
        """Values at angular frequencies (f,) in rad/s."""
        view, frequencies = self.view, omega / (2 * np.pi)
        z = TwoPort.of(view.transducer, frequencies, amplitude=view.amplitude).z
        impedance = z[:, 1, 1] - z[:, 0, 1] * z[:, 1, 0] / z[:, 0, 0]
        opened = view.response(Open(), frequencies)
        # A load current moves the free mechanical port by z_12/z_11.
        moved = z[:, 0, 1] / z[:, 0, 0] / (1j * omega)
        return PortValues(impedance, opened.voltage, opened.displacement, moved * opened.voltage)

    @cached_property
    def poles(self) -> np.ndarray:
        """Poles with shorted and with open electrodes, rad/s, those of zero frequency and one of each pair left out."""
        found = np.concatenate([poles(System(self.view.transducer, shunt)) for shunt in (Short(), Open())])
        found = found[np.imag(found) >= 0]
        return found[np.abs(found) > 1e-9 * np.max(np.abs(found))]

    @cached_property
    def free_capacitance(self) -> float:
        """Capacitance in F far below all poles, in which the pole of Z at zero ends; infinite if charge leaks."""
        low = _LOW * float(np.min(np.abs(self.poles)))
        z = self.at(np.array([low, 0.1 * low])).impedance
        capacitances = 1 / (np.array([low, 0.1 * low]) * np.abs(z))
        return float(capacitances[1]) if np.isclose(*capacitances, rtol=0.1) else np.inf
