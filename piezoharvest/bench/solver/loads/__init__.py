"""Loads for the solver, by the kind of shunt."""

from piezoharvest.bench.solver.loads.breakers import BREAKING
from piezoharvest.bench.solver.loads.circuits import UNSWITCHED
from piezoharvest.bench.solver.loads.controlled import CONTROLLED
from piezoharvest.bench.solver.loads.extraction import EXTRACTING
from piezoharvest.bench.solver.loads.network import Network
from piezoharvest.bench.solver.loads.switched import SWITCHED

CIRCUITS = UNSWITCHED | SWITCHED | EXTRACTING | CONTROLLED | BREAKING | {"network": Network}
