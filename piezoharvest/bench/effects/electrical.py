"""Effects in the electrical domain of the specimen and in its coupling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from piezoharvest.bench.effects.base import BenchEffect
from piezoharvest.description.parameters import ParameterError, quantity


@dataclass(frozen=True, kw_only=True)
class Leakage(BenchEffect):
    """A resistance across the electrodes."""

    name: ClassVar[str] = "leakage"

    resistance: float = quantity("ohm", "leakage resistance", above=0, null=float("inf"))

    def act(self, model, duration):
        """Draw v/R from the node beside the load."""
        model.drawn.append(lambda m: m.v / self.resistance)


@dataclass(frozen=True, kw_only=True)
class BiasCurrent(BenchEffect):
    """A constant current into the positive lead, as from an amplifier's input."""

    name: ClassVar[str] = "bias_current"

    current: float = quantity("A", "current into the positive lead", null=0.0)

    def act(self, model, duration):
        """Draw the negative of the current, which flows in."""
        model.drawn.append(lambda m: -self.current + 0.0 * m.v)


@dataclass(frozen=True, kw_only=True)
class DielectricRelaxation(BenchEffect):
    """Slow polarisation beside C: tau q_r' = C_r v_t - q_r, and q_p = q_c + q_r + q_t."""

    name: ClassVar[str] = "dielectric_relaxation"

    capacitance: float = quantity("F", "capacitance of the relaxing branch", at_least=0, null=0.0)
    time_constant: float = quantity("s", "time constant of the branch", above=0)

    def act(self, model, duration):
        """Add the slow charge as a state."""

        def rate(m):
            return (self.capacitance * m.v_t - m.y[row]) / self.time_constant

        storage = 1.0 / (self.capacitance or model.transducer.capacitance)
        row = model.add_state(storage, rate, lambda m: 0.0 * m.x[0])
        model.slow_charges.append(row)


@dataclass(frozen=True, kw_only=True)
class VoltageDependentCapacitance(BenchEffect):
    """q_c = C v_t (1 + beta v_t^2), solved for v_t in closed form; with beta < 0 only up to q_c's maximum."""

    name: ClassVar[str] = "voltage_dependent_capacitance"

    beta: float = quantity("1/V^2", "relative change of the charge, per squared volt", null=0.0)

    def act(self, model, duration):
        """Replace the dielectric by the bent one."""
        if not self.beta:
            return
        if model.beside:
            raise ParameterError(
                "beta", "the capacitance of probe_loading is given too, but only one of the two may be"
            )
        capacitance, half = model.transducer.capacitance, 1.0 / np.sqrt(3.0 * abs(self.beta))
        there, back = (np.arcsinh, np.sinh) if self.beta > 0 else (np.arcsin, np.sin)

        def dielectric(charge):
            v_t = 2.0 * half * back(there(1.5 / (half * capacitance) * charge) / 3.0)
            return v_t, 1.0 / (capacitance * (1.0 + 3.0 * self.beta * v_t * v_t))

        model.dielectric, model.smooth = dielectric, True


@dataclass(frozen=True, kw_only=True)
class NonlinearCoupling(BenchEffect):
    """q_t = T x + T2 x^2 and its reciprocal F_t = (T + 2 T2 x) v_t, in the first mode."""

    name: ClassVar[str] = "nonlinear_coupling"

    quadratic_coupling: float = quantity("C/m^2", "quadratic coupling T2", null=0.0)

    def act(self, model, duration):
        """Set the quadratic coupling."""
        model.quadratic_coupling, model.smooth = self.quadratic_coupling, model.smooth or self.quadratic_coupling != 0


@dataclass(frozen=True, kw_only=True)
class CouplingDrift(BenchEffect):
    """T(t) = T (1 + d t/duration): by the end of the record the coupling has changed by the fraction d."""

    name: ClassVar[str] = "coupling_drift"

    relative_drift: float = quantity("", "relative change over a record", null=0.0)

    def act(self, model, duration):
        """Set the rate at which the coupling changes."""
        model.coupling_rate = self.relative_drift / duration
        model.smooth = model.smooth or self.relative_drift != 0
