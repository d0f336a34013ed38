"""The bench's own solver: another description of the specimen and another method than the engine that fits.

Equations are written afresh (`model`), stop operators are straight lines between located events (`stops`), loads answer
a voltage with a current (`circuits`), and time goes by implicit Runge-Kutta steps of order five (`radau`), which are
stable for mechanics that are a thousand times faster than the samples. Displacement and voltage are within 1e-7 of
their largest values of what DOP853 at 1e-12 gives, velocity and current within 1e-6. `scipy.integrate.Radau` takes
forty times as long for a record of the paper's stack, and more where it has to restart at events.
"""

from piezoharvest.bench.solver.circuits import CIRCUITS
from piezoharvest.bench.solver.model import Model, SolverError
from piezoharvest.bench.solver.run import Waves, integrate

__all__ = ["CIRCUITS", "Model", "SolverError", "Waves", "integrate"]
