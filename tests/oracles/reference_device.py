"""Transducer and excitation of the reference simulator (INTERFACE.md sections 1 and 2), free of any circuit.

Written from the interface text alone: nothing here comes from, or imports, piezoharvest.
"""

from __future__ import annotations

import math
from collections.abc import Callable

# Integrals carried as extra states, so that they are as accurate as the motion itself.
QUADRATURES = ("mechanical_in", "damping", "hysteresis", "harvested", "shunt_loss", "source", "dc_integral")


class Excitation:
    """The drive as a function of time, and how much of it each mode feels.

    Parameters
    ----------
    table : dict
        The ``[excitation]`` table of a study.

    Attributes
    ----------
    base : bool
        The drive is a base acceleration (m/s^2), not a force (N).
    frequency, period : float or None
        None where the excitation has no single frequency.
    offset : float
        Static preload; the run starts from its equilibrium.
    breaks : list of float
        Instants at which the drive is not smooth; the integrator restarts there.
    """

    def __init__(self, table: dict) -> None:
        self.kind = table["kind"]
        self.base = self.kind.endswith("_base")
        self.offset = float(table.get("offset", 0.0))
        self.frequency = float(table["frequency"]) if self.kind in ("sine_force", "sine_base") else None
        self.period = 1.0 / self.frequency if self.frequency else None
        self.duration = float(table["duration"]) if "duration" in table else None
        self.breaks: list[float] = []
        if self.frequency:
            self.size = abs(float(table["amplitude"]))
            self._lines = [(float(table["amplitude"]), self.frequency, 0.0)]
        elif self.kind == "multisine":
            phases = table.get("phases", [0.0] * len(table["amplitudes"]))
            self._lines = list(zip(table["amplitudes"], table["frequencies"], phases, strict=True))
            self.size = math.sqrt(sum(a * a for a in table["amplitudes"]))
        elif self.kind == "step_force":
            self._amplitude = float(table["amplitude"])
            self._rise = float(table.get("rise_time", 0.0))
            self.size = abs(self._amplitude)
            ends = (0.0, self.duration)
            self.breaks = sorted({*ends, *(end + self._rise for end in ends)})
        else:
            raise NotImplementedError(f"the reference simulator has no excitation of kind {self.kind!r}")
        self.size = max(self.size, abs(self.offset))

    def piece(self, start: float, end: float) -> Callable[[float], float]:
        """Return the drive as a smooth function that holds on [start, end], ends included.

        At a jump the two pieces differ at the same instant, which is why a plain function of time will not do.
        """
        if self.kind == "step_force":
            level, slope, middle = self.offset, 0.0, 0.5 * (start + end)
            for edge, sign in ((0.0, 1.0), (self.duration, -1.0)):
                if middle >= edge + self._rise:
                    level += sign * self._amplitude
                elif middle > edge:
                    slope += sign * self._amplitude / self._rise
                    level -= sign * self._amplitude / self._rise * edge
            return lambda t: level + slope * t
        offset = self.offset
        if len(self._lines) == 1 and self.frequency:
            amplitude, omega = self._lines[0][0], 2.0 * math.pi * self.frequency
            return lambda t: offset + amplitude * math.sin(omega * t)
        lines = [(a, 2.0 * math.pi * f, phase) for a, f, phase in self._lines]
        return lambda t: offset + sum(a * math.sin(w * t + phase) for a, w, phase in lines)


class Device:
    """Modes, capacitance, coupling and Prandtl-Ishlinskii stops of one transducer.

    The state vector is ``[x_1.., u_1.., q, s_1.., shunt states.., quadratures..]``.

    Parameters
    ----------
    table : dict
        The ``[transducer]`` table of a study.
    excitation : Excitation
        Needed for the share of the drive that each mode takes.
    """

    def __init__(self, table: dict, excitation: Excitation) -> None:
        for key in ("catalogue", "effects"):
            if key in table:
                raise NotImplementedError(f"the reference simulator does not know transducer.{key}")
        modes = [table, *table.get("modes", [])]
        self.mass = [float(mode["mass"]) for mode in modes]
        self.damping = [float(mode["damping"]) for mode in modes]
        self.stiffness = [float(mode["stiffness"]) for mode in modes]
        self.coupling = [float(mode["coupling"]) for mode in modes]
        self.participation = [1.0] + [float(mode.get("force_participation", 1.0)) for mode in modes[1:]]
        self.capacitance = float(table["capacitance"])
        hysteresis = table.get("hysteresis", {})
        self.threshold = [float(r) for r in hysteresis.get("thresholds", [])]
        self.weight = [float(w) for w in hysteresis.get("weights", [])]
        if excitation.base:
            self.gain = [-float(mode.get("effective_mass", mode["mass"])) for mode in modes]
        else:
            self.gain = list(self.participation)
        self.modes = len(modes)
        self.stops = len(self.threshold)
        self.q_at = 2 * self.modes
        self.shunt_at = self.q_at + 1 + self.stops

    def displacement(self, y) -> float:
        """Sum of the modes by participation; ``y`` may also be a matrix of states in columns."""
        return sum(weight * y[i] for i, weight in enumerate(self.participation))

    def electrode_voltage(self, y) -> float:
        """v_p = (q - sum T_i x_i)/C + sum w_j s_j; ``y`` may also be a matrix of states in columns."""
        strain_charge = sum(coupling * y[i] for i, coupling in enumerate(self.coupling))
        hysteretic = sum(weight * y[self.q_at + 1 + j] for j, weight in enumerate(self.weight))
        return (y[self.q_at] - strain_charge) / self.capacitance + hysteretic

    def strain_current(self, y) -> float:
        """Sum T_i u_i, whose zeros are the extrema at which switched shunts act."""
        return sum(coupling * y[self.modes + i] for i, coupling in enumerate(self.coupling))

    def elastance(self, slip) -> float:
        """dv_p/dq at fixed strain: 1/C plus the weights of the stops that stick."""
        return 1.0 / self.capacitance + sum(w for w, side in zip(self.weight, slip, strict=True) if side == 0)

    def stored(self, y) -> float:
        """Energy held by the transducer: kinetic, elastic, in C and in the stops."""
        n = self.modes
        energy = 0.0
        for i in range(n):
            energy += 0.5 * self.mass[i] * y[n + i] ** 2 + 0.5 * self.stiffness[i] * y[i] ** 2
        v_t = (y[self.q_at] - sum(self.coupling[i] * y[i] for i in range(n))) / self.capacitance
        energy += 0.5 * self.capacitance * v_t**2
        return energy + sum(0.5 * w * y[self.q_at + 1 + j] ** 2 for j, w in enumerate(self.weight))

    def rest(self, offset: float) -> list[float]:
        """Equilibrium [x.., u.., q, s..] under a static drive, with v_t = 0 and relaxed stops."""
        x = [gain * offset / k for gain, k in zip(self.gain, self.stiffness, strict=True)]
        charge = sum(t * xi for t, xi in zip(self.coupling, x, strict=True))
        return [*x, *[0.0] * self.modes, charge, *[0.0] * self.stops]

    def typical(self, excitation: Excitation) -> dict[str, float | list[float]]:
        """Sizes of the states, from below: the smaller of the static and the dynamic response to the drive."""
        omega = 2.0 * math.pi * excitation.frequency if excitation.frequency else None
        x = []
        for m, b, k, gain in zip(self.mass, self.damping, self.stiffness, self.gain, strict=True):
            static = abs(gain) * excitation.size / k
            x.append(static if omega is None else min(static, static * k / abs(k - m * omega**2 + 1j * b * omega)))
        charge = sum(abs(t) * xi for t, xi in zip(self.coupling, x, strict=True))
        voltage = charge / self.capacitance
        # A mode that takes no force still moves, through the electrodes.
        x = [max(xi, abs(t) * voltage / k) for xi, t, k in zip(x, self.coupling, self.stiffness, strict=True)]
        rates = [math.sqrt(k / m) for m, k in zip(self.mass, self.stiffness, strict=True)]
        rate = omega if omega is not None else rates[0]
        u = [xi * max(rate, own) if omega is None else xi * rate for xi, own in zip(x, rates, strict=True)]
        energy = max(0.5 * k * xi**2 for k, xi in zip(self.stiffness, x, strict=True))
        return {"x": x, "u": u, "charge": charge, "voltage": voltage, "rate": rate, "energy": energy}


def charge_jump(device: Device, y) -> tuple[float, float]:
    """Take the electrode voltage to zero at once, along the monotone charge path; ``y`` is changed in place.

    Between the instants at which a stop starts to slip, v is linear in q, so the trapezoid below is exact.

    Returns
    -------
    energy_out : float
        Minus the integral of v dq: what the electrodes give away.
    hysteresis : float
        What the slipping stops turn into heat on the way.
    """
    at = device.q_at
    voltage = device.electrode_voltage(y)
    direction = -1.0 if voltage > 0.0 else 1.0
    energy_out = hysteresis = 0.0
    while voltage != 0.0:
        sticking = [j for j in range(device.stops) if device.threshold[j] - direction * y[at + 1 + j] > 0.0]
        elastance = 1.0 / device.capacitance + sum(device.weight[j] for j in sticking)
        needed = abs(voltage) / elastance
        room = {j: device.threshold[j] - direction * y[at + 1 + j] for j in sticking}
        step = min([needed, *room.values()])
        reached = 0.0 if step == needed else voltage + direction * elastance * step
        energy_out += 0.5 * abs(voltage + reached) * step
        y[at] += direction * step
        for j in range(device.stops):
            if j not in room:
                hysteresis += device.weight[j] * device.threshold[j] * step
            elif room[j] <= step:
                y[at + 1 + j] = direction * device.threshold[j]
            else:
                y[at + 1 + j] += direction * step
        voltage = reached
    return energy_out, hysteresis
