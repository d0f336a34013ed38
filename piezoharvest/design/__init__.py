"""Choice of the shunt: optimal loads and tuning, checked by simulation, best first."""

from piezoharvest.callable_package import make_callable
from piezoharvest.design.result import Bound, Candidate, DesignResult
from piezoharvest.design.search import design

__all__ = ["Bound", "Candidate", "DesignResult", "design"]

make_callable(__name__)
