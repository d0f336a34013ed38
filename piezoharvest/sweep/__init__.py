"""Parameter sweeps: the same study at many values of its parameters, collected in one table."""

from piezoharvest.callable_package import make_callable
from piezoharvest.sweep.run import sweep
from piezoharvest.sweep.store import SUFFIXES
from piezoharvest.sweep.summary import SweepResult

__all__ = ["SUFFIXES", "SweepResult", "sweep"]

make_callable(__name__)
