"""Solver of the bench, with equations and methods independent of the engine and of identification.

Equations are separate (`model`), stop operators are linear between located events (`stops`), loads respond to a voltage
with a current (`loads`), and integration is by implicit Runge-Kutta steps of order five (`radau`), stable for
mechanics a thousand times faster than the samples. Displacement and voltage are within 1e-7 of their largest values of
what DOP853 at 1e-12 gives, velocity and current within 1e-6. `scipy.integrate.Radau` takes forty times as long for a
record of the paper's stack, and more where it has to restart at events.
"""

from piezoharvest.bench.solver.loads import CIRCUITS
from piezoharvest.bench.solver.model import Model, SolverError
from piezoharvest.bench.solver.run import Waves, integrate

__all__ = ["CIRCUITS", "Model", "SolverError", "Waves", "integrate"]
