"""A transducer from the data sheet of an actuator: free stroke and blocking force at a voltage."""

from __future__ import annotations

from dataclasses import dataclass

from piezoharvest.description.figures.base import Condition, Lumped, StaticFigures
from piezoharvest.description.parameters import ParameterError, described, quantity


@dataclass(frozen=True, kw_only=True)
class BlockedForce(StaticFigures):
    """Free stroke and blocking force of an actuator at a voltage: T = force/voltage, k = force/stroke.

    C = C_free - T^2/k. Stroke and force are figures of large signals, the capacitance usually of small ones: k^2 =
    T^2/(k C_free) above 0.57, that of the best ceramics (PZT-5H: k33 = 0.752), says that they do not belong together.
    """

    free_stroke: float = quantity("m", "free stroke at the voltage", above=0)
    blocking_force: float = quantity("N", "blocking force at the voltage", above=0)
    voltage: float = quantity("V", "voltage range (peak to peak) of both values", above=0)
    capacitance: float = quantity("F", "capacitance, free or clamped", above=0)
    capacitance_is: Condition = described("whether the capacitance is free or clamped", default="free")

    def lumped(self) -> Lumped:
        """Values of the transducer, see `Figures.lumped`."""
        stiffness, coupling = self.blocking_force / self.free_stroke, self.blocking_force / self.voltage
        motional = coupling**2 / stiffness
        capacitance = self.capacitance - (motional if self.capacitance_is == "free" else 0.0)
        if not capacitance > 0:
            why = f"stroke x force/voltage^2 = {motional:.3g} F of it is due to motion"
            raise ParameterError("capacitance", f"found {self.capacitance:g} F, too small for a free one: {why}")
        share = motional / (capacitance + motional)
        large = f"stroke and blocking force are of large signals, with k^2 = {share:.2f}: small signals may couple less"
        return self.with_mass(stiffness, coupling, capacitance, large)
