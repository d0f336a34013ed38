"""The parallel SSHI of the bench, written out by hand on top of `equations`."""

from __future__ import annotations

import math

import numpy as np

from reports.speed.equations import Loaded, Run


class SSHI(Loaded):
    """The transducer with hysteresis, a bridge with a smoothing capacitor, and a switched inductor beside it."""

    def __init__(self, study: dict, drive) -> None:
        shunt, capacitance = study["shunts"][0], study["transducer"]["capacitance"]
        self.L, self.Cs, self.load = shunt["inductance"], shunt["smoothing_capacitance"], shunt["load_resistance"]
        self.R = math.sqrt(self.L / capacitance) / shunt["quality"]
        super().__init__(study, drive, (self.L, self.Cs))
        self.on_time = math.pi / math.sqrt(1 / (self.L * capacitance) - (self.R / (2 * self.L)) ** 2)
        self.hold_off = 0.25 / study["excitation"]["frequency"]

    def circuit(self, mode, port, u, own):
        """See `Loaded.circuit`."""
        (v, drift, elastance), (i, dc), sign = port, own, mode.bridge
        i = i if mode.closed else 0 * i
        guards = [("turns", 0, 0, -mode.direction * u)]
        rectified = 0 * i
        if sign:  # v_p = sign v_dc decides what flows through the diodes
            bent = sign * (drift - elastance * i) + dc / (self.load * self.Cs)
            rectified = bent / (1 / self.Cs + elastance)
            guards.append(("blocks", 0, 0, -rectified))
        else:
            guards += [("conducts", 0, side, side * v - dc) for side in (1, -1)]
        rates = [(v - self.R * i) / self.L * mode.closed, (rectified - dc / self.load) / self.Cs]
        return -(i + sign * rectified), rates, guards

    def fire(self, run, name, which=0, sign=0):
        """See `Loaded.fire`; "opens" is due when the clock says so."""
        mode = run.mode
        if name == "turns":
            closes = not mode.closed and run.t - run.acted >= self.hold_off
            if closes:
                run.acted, run.opens = run.t, run.t + self.on_time
            run.mode = mode._replace(direction=-mode.direction, closed=mode.closed or closes)
        elif name == "opens":
            run.z[-2], run.opens = 0.0, math.inf
            run.mode = mode._replace(closed=False)
        elif name in ("conducts", "blocks"):
            run.mode = mode._replace(bridge=sign)
        else:
            super().fire(run, name, which, sign)
        if name in ("conducts", "opens"):
            self._settle(run)

    def _settle(self, run: Run) -> None:
        """Bring the stops in line with a current that jumped."""
        rate = self.motion(run.mode).rate @ self.augmented(run)
        stops = run.z[3 : 3 + self.stops] / self.sizes[3 : 3 + self.stops]
        full = np.abs(stops) >= self.limits * (1 - 1e-9)
        slips = [int(np.sign(s)) if f and s * rate > 0 else 0 for s, f in zip(stops, full, strict=True)]
        run.mode = run.mode._replace(slips=tuple(slips))
