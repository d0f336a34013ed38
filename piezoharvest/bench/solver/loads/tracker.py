"""Load of the solver whose dc voltage follows from the open electrodes, written from docs/equations.md."""

from __future__ import annotations

from piezoharvest.bench.solver.loads.circuits import Rectifier


class MPPT(Rectifier):
    """Bridge into a voltage that a tracker has found before the run; until then its electrodes are open."""

    fraction: float
    found = False

    def __init__(self, shunt):
        super().__init__(shunt)
        self.dc_voltage = 0.0

    @property
    def tracks(self):
        return not self.found

    def track(self, open_voltage):
        self.found = True
        self.dc_voltage = self.fraction * max(open_voltage - self.diodes * self.diode_drop, 0.0)

    def flow(self, z, v, free, elastance):
        return super().flow(z, v, free, elastance) if self.found else (0.0 * v, ())
