"""Loads for the solver, by the kind of shunt."""

from piezoharvest.bench.solver.loads.breakers import BREAKING
from piezoharvest.bench.solver.loads.circuits import UNSWITCHED
from piezoharvest.bench.solver.loads.controlled import CONTROLLED
from piezoharvest.bench.solver.loads.extraction import EXTRACTING
from piezoharvest.bench.solver.loads.network import Network
from piezoharvest.bench.solver.loads.spice import Spice
from piezoharvest.bench.solver.loads.switched import SWITCHED
from piezoharvest.bench.solver.loads.tracker import MPPT

CIRCUITS = UNSWITCHED | SWITCHED | EXTRACTING | CONTROLLED | BREAKING
CIRCUITS |= {"network": Network, "spice": Spice, "mppt": MPPT}
