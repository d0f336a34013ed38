"""The loaded transducer, written out by hand for the alternatives: linear modes, guards, what events do.

States are in energy coordinates (see `studies`), followed by what the drive needs: y = [z | force, its partner, 1].
Nothing of this comes from the package; INTERFACE.md sections 1 and 2 is all that it knows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


class Mode(NamedTuple):
    """Which equations hold: direction of the motion, switch, sign of the conducting diodes, sides of the stops."""

    direction: int
    closed: bool
    bridge: int
    slips: tuple[int, ...]


class Motion(NamedTuple):
    """Equations of one mode: y' = matrix y until a guard rises through zero; the charge flows in at rate y."""

    matrix: np.ndarray  # (a, a)
    guards: np.ndarray  # (g, a)
    events: list[tuple[str, int, int]]  # name, which stop, sign
    rate: np.ndarray  # (a,)


@dataclass
class Run:
    """State, mode and clock of a simulation."""

    z: np.ndarray
    mode: Mode
    t: float = 0.0
    opens: float = math.inf
    acted: float = -math.inf


class Loaded:
    """The transducer with hysteresis and a resistor across it."""

    def __init__(self, study: dict, drive, own_sizes: tuple[float, ...] = ()) -> None:
        device, self.shunt, self.drive = study["transducer"], study["shunts"][0], drive
        self.m, self.b, self.k = device["mass"], device["damping"], device["stiffness"]
        self.T, self.C = device["coupling"], device["capacitance"]
        hysteresis = device.get("hysteresis", {"thresholds": [], "weights": []})
        self.limits, self.weights = np.array(hysteresis["thresholds"]), np.array(hysteresis["weights"])
        self.stops = len(self.limits)
        self.sizes = np.sqrt([self.k, self.m, self.C, *self.weights, *own_sizes])
        self._motions: dict[Mode, Motion] = {}

    def start(self) -> Run:
        """Rest, about to move upwards."""
        return Run(np.zeros(len(self.sizes)), Mode(1, False, 0, (0,) * self.stops))

    def augmented(self, run: Run) -> np.ndarray:
        """State and drive of a run."""
        return np.concatenate([run.z, self.drive.states(run.t)])

    def readings(self, z: np.ndarray) -> np.ndarray:
        """What is compared, from rows of states: see `studies.energy_coordinates`."""
        v_h = (z / self.sizes)[:, 3 : 3 + self.stops] @ self.weights
        dc = z[:, -1] if len(self.sizes) > 3 + self.stops else np.zeros(len(z))
        return np.column_stack([z[:, :3], v_h * np.sqrt(self.C), dc])

    def motion(self, mode: Mode) -> Motion:
        """Equations of a mode."""
        if mode not in self._motions:
            self._motions[mode] = self._write(mode)
        return self._motions[mode]

    def _write(self, mode: Mode) -> Motion:
        n, h = len(self.sizes), self.stops
        y = np.eye(n + 3)
        x, u, v_t, s, force, one = y[0], y[1], y[2], y[3 : 3 + h], y[n], y[n + 2]
        sticking = np.array([side == 0 for side in mode.slips], bool)
        elastance = 1 / self.C + self.weights[sticking].sum()
        port = (v_t + self.weights @ s, -self.T / self.C * u, elastance)
        rate, own_rates, guards = self.circuit(mode, port, u, y[3 + h : n])
        rates = [u, (force + self.T * v_t - self.b * u - self.k * x) / self.m, (rate - self.T * u) / self.C]
        rates += [rate * stick for stick in sticking] + own_rates
        for j, side in enumerate(mode.slips):
            if not rate.any():  # no charge can flow: all stops stay where they are
                continue
            if side:
                guards.append(("sticks", j, side, -side * rate))
            else:
                guards += [("slips", j, sign, sign * s[j] - self.limits[j] * one) for sign in (1, -1)]
        units = np.concatenate([self.sizes, np.ones(3)])
        matrix = np.vstack([units[:n, None] * np.array(rates), self.drive.generator @ y[n:]]) / units
        rows = np.array([row for *_, row in guards]).reshape(len(guards), n + 3) / units
        rows /= np.maximum(np.abs(rows[:, :n]).max(axis=1, keepdims=True), 1e-300)
        return Motion(matrix, rows, [(name, j, sign) for name, j, sign, _ in guards], rate / units)

    def circuit(self, mode: Mode, port: tuple, u, own) -> tuple:
        """Rate of the charge, rates of the circuit's own states, and its guards; port: v_p, its drift, dv_p/dq."""
        return -port[0] / self.shunt["resistance"], [], []

    def fire(self, run: Run, name: str, which: int = 0, sign: int = 0) -> None:
        """Change the mode of a run by an event."""
        if name == "sticks":  # all that slip turn with the charge
            run.mode = run.mode._replace(slips=(0,) * self.stops)
        elif name == "slips":
            # With it slip those that have come back to where they last turned.
            stops, sizes = run.z[3 : 3 + self.stops], self.sizes[3 : 3 + self.stops]
            full = sign * stops >= self.limits * sizes * (1 - 1e-9)
            full[which] = True
            stops[full] = (sign * self.limits * sizes)[full]
            run.mode = run.mode._replace(slips=tuple(np.where(full, sign, run.mode.slips).tolist()))
