"""The sampled loop of a digital shunt, exactly: stability by its spectral radius, and an admittance that anticipates.

From one sample to the next the transducer moves under a current that is constant but for one step, where the delay
ends: with E(t) = exp(A t) and G(t) = int_0^t E B dt, x+ = E(T) x + E(T - r) G(r) i_old + G(T - r) i_new, r being what
the delay exceeds whole sample times by (Astrom & Wittenmark, Computer-Controlled Systems, 3rd ed., section 2.5).

A delay of k sample times and r makes the loop unstable where a pole arrives at the unit circle: L_r(z) z^-k = 1 there,
with the loop's gain L_r of r alone. Its magnitude is one at few angles of z, whatever k, and those are eigenvalues of a
Hamiltonian matrix (Bruinsma & Steinbuch, Syst. Control Lett. 14(4), 287-293, 1990). At each of them the phase says how
long the delay is. Without such an angle no delay makes the loop unstable.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts.damping.digital import Digital
from piezoharvest.description.system import System
from piezoharvest.equations.circuits import circuit_equations, circuit_states
from piezoharvest.linear.assembly import LinearModel, connect

_FLOATING = 1e-9  # distance of a pole from 1 that counts as that of a floating charge: some thousand roundings
_SCANNED = 256  # sample times that are tried before the limit between two of them is found
_EXACT = 1e-12  # relative, of a limit
_SHARES = (0.0, 0.25, 0.5, 0.75)  # of a sample time: delays at which the search for crossings begins
_ON_CIRCLE = 1e-3  # relative distance from the imaginary axis of an eigenvalue where a crossing is looked for
_CROSSED = 1e-9  # of the logarithm of the loop's gain at a crossing


@dataclass(frozen=True, eq=False, repr=False)
class SampledLoop:
    """A transducer with a digital shunt from one sample to the next.

    Attributes
    ----------
    matrix : (n, n) array
        z+ = matrix z; z holds the transducer's states, the filter's, and the commands under way.
    sample_time : float
        s
    """

    matrix: np.ndarray
    sample_time: float

    def __repr__(self) -> str:
        """The loop in a line."""
        states = counted(len(self.matrix), "state")
        return f"<SampledLoop: {states}, every {self.sample_time:.6g} s, radius {self.radius:.6g}>"

    @property
    def poles(self) -> np.ndarray:
        """Eigenvalues in the plane of z, (n,) complex, largest magnitude first."""
        found = np.linalg.eigvals(self.matrix).astype(complex)
        return found[np.argsort(-np.abs(found))]

    @property
    def radius(self) -> float:
        """Spectral radius, a floating charge (a pole at 1) left out: the loop is stable below 1."""
        found = self.poles
        return float(np.max(np.abs(found[np.abs(found - 1) > _FLOATING]), initial=0.0))


@dataclass(frozen=True, eq=False)
class _Motion:
    """The transducer under a current: (x, i)' = generator (x, i), v = row x; time in sample times."""

    generator: np.ndarray
    row: np.ndarray

    def plant(self, whole: int, rest: float) -> _Plant:
        """From one sample to the next, with a current that is late by a number of sample times and a share of one."""
        from scipy.linalg import expm

        n = len(self.row)
        late, driven = (expm(self.generator * share) for share in (rest, 1.0 - rest))
        return _Plant(driven[:n, :n] @ late[:n, :n], driven[:n, :n] @ late[:n, n], driven[:n, n], self.row, whole)


@dataclass(frozen=True, eq=False)
class _Plant:
    """The transducer between samples under a current: x+ = forward x + old i_old + new i_new, v = row x."""

    forward: np.ndarray
    old: np.ndarray
    new: np.ndarray
    row: np.ndarray
    whole: int  # commands that are under way beside i_old

    def response(self, z: np.ndarray) -> np.ndarray:
        """Sampled voltage over commands, V/A, at points (k,) of the plane of z."""
        eye = np.eye(len(self.forward))
        driven = (self.old / z[:, None] + self.new) * z[:, None] ** -self.whole
        pairs = zip(z, driven, strict=True)
        return np.array([self.row @ np.linalg.solve(at * eye - self.forward, by) for at, by in pairs])


def sampled_loop(system: System) -> SampledLoop:
    """Loop of a transducer with a digital shunt, small motions, neither rounded nor saturated.

    Parameters
    ----------
    system : System
        Its shunt is `Digital`, the others are linear. Hysteresis sticks.

    Raises
    ------
    ParameterError
        The shunt is not a digital one.
    """
    shunt, plant = _shunt(system), _plant(system)
    above, below = (np.array(side, float) for side in shunt.filter())
    order, n = len(below) - 1, len(plant.forward)
    # Columns of z: states, memories 1 to order, commands from the last one on; the newest memory and command follow.
    size = n + order + plant.whole + 1
    memory = np.zeros((order + 1, size))
    memory[1:, n : n + order] = np.eye(order)
    memory[0, :n], memory[0, n : n + order] = plant.row, -below[1:]
    commands = np.zeros((plant.whole + 2, size))
    commands[0], commands[1:, n + order :] = above @ memory, np.eye(plant.whole + 1)
    states = np.zeros((n, size))
    states[:, :n] = plant.forward
    states += np.outer(plant.new, commands[plant.whole]) + np.outer(plant.old, commands[plant.whole + 1])
    return SampledLoop(np.vstack((states, memory[:order], commands[: plant.whole + 1])), shunt.sample_time)


def stability_limit(system: System, key: Literal["delay", "sample_time"] = "delay") -> float:
    """Largest delay, or sample time with the delay as a share of it, below which the sampled loop is stable, s.

    Returns
    -------
    float
        Zero if the loop is unstable however short it is. Infinite if no delay at all makes it unstable, or no sample
        time of up to half a period of the first resonance.

    Raises
    ------
    ParameterError
        The shunt is not a digital one, or the key is another one.
    """
    shunt = _shunt(system)
    if key not in ("delay", "sample_time"):
        raise ParameterError("key", f"found {key!r}, must be 'delay' or 'sample_time'")

    def stable(sample_time: float, samples: float) -> bool:
        changed = replace(shunt, sample_time=sample_time, delay=samples * sample_time)
        return sampled_loop(System(system.transducer, changed)).radius < 1

    if key == "delay":
        return _first_crossing(system) if stable(shunt.sample_time, 0.0) else 0.0
    late = shunt.delay / shunt.sample_time
    tried = 0.5 / system.transducer.short_circuit_frequency * np.arange(1, _SCANNED + 1) / _SCANNED
    first = next((n for n, value in enumerate(tried) if not stable(float(value), late)), None)
    if first is None:
        return float("inf")
    low, high = (float(tried[first - 1]) if first else 0.0), float(tried[first])
    while high - low > _EXACT * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle, late) else (low, middle)
    return low


def _first_crossing(system: System) -> float:
    """Shortest delay in s with which a pole of the loop is on the unit circle; infinite if there is none."""
    from scipy.optimize import root

    shunt, motion = _shunt(system), _motion(system)
    above, below = (np.array(side, float) for side in shunt.filter())

    def gain(lateness: float, angle: float) -> complex:
        z, (whole, rest) = np.exp([1j * angle]), divmod(lateness, 1.0)
        return (np.polyval(above, z) / np.polyval(below, z) * motion.plant(int(whole), rest).response(z))[0]

    crossings = [np.inf]
    for share in _SHARES:
        for angle in _angles_of_unit_gain(above, below, motion.plant(0, share)):
            # gain(share, .) is L of this share; as many sample times more as turn its phase to zero.
            lateness = (share + np.angle(gain(share, angle)) / angle) % (2 * np.pi / angle)

            def off(x: np.ndarray, lateness: float = lateness, angle: float = angle) -> list[float]:
                value = np.log(gain(lateness + x[0] / angle, angle * np.exp(x[1])))
                return [value.real, value.imag]

            found = root(off, [0.0, 0.0], tol=_EXACT)
            if np.max(np.abs(found.fun)) < _CROSSED:
                crossings.append(lateness + found.x[0] / angle)
    return shunt.sample_time * float(min(value for value in crossings if value >= 0))


def _angles_of_unit_gain(above: np.ndarray, below: np.ndarray, plant: _Plant) -> np.ndarray:
    """Angles of z on the unit circle, between 0 and pi, where a filter and a plant in series have the gain one.

    With z = (1 + s)/(1 - s) the circle is the imaginary axis.
    """
    from scipy.signal import tf2ss

    of, into, out, through = tf2ss(above, below)
    n, order = len(plant.forward), len(of)
    read = np.append(plant.row, 0.0)[None]
    moved = np.block([[plant.forward, plant.old[:, None]], [np.zeros((1, n + 1))]])
    loop = np.block([[moved, np.zeros((n + 1, order))], [into @ read, of]])
    eye, driven = np.eye(len(loop)), np.concatenate((plant.new, [1.0], np.zeros(order)))
    a, b = np.linalg.solve(loop + eye, loop - eye), np.linalg.solve(loop + eye, driven)
    c = np.hstack((through @ read, out))[0]
    c, d = c @ (eye - a), -c @ b
    left = 1 - d**2
    a = a + np.outer(b, c) * d / left
    found = np.linalg.eigvals(np.block([[a, np.outer(b, b) / left], [-np.outer(c, c) / left, -a.T]]))
    found = found[(np.imag(found) > _FLOATING) & (np.abs(np.real(found)) < _ON_CIRCLE * np.imag(found))]
    return 2 * np.arctan(np.imag(found))


def anticipating(system: System) -> Digital:
    """Digital shunt whose sampled loop has about the poles that the admittance has without sampling and delay.

    The filter keeps its order, but its numerator may have that of its denominator: it leads. Its coefficients are those
    with which the sampled loop, exactly as it is, has these poles, two pairs for each resonance of the circuit with the
    electrodes: linear equations, solved in the least-squares sense. That an admittance can be chosen to undo its delay
    at the poles is the idea of Raze, Dietrich & Kerschen, J. Intell. Mater. Syst. Struct. 33(16), 2022.

    Parameters
    ----------
    system : System
        Its shunt is `Digital`, with the admittance that is wanted.

    Returns
    -------
    Digital
        The shunt with another numerator and denominator.

    Raises
    ------
    ParameterError
        The shunt is not a digital one, or the loop would be unstable all the same.
    """
    shunt, wanted = _shunt(system), _circuit_poles(system)
    z, scale = np.exp(wanted * shunt.sample_time), float(np.abs(wanted[0]))
    s = 2 / shunt.sample_time * (z - 1) / (z + 1) / scale
    below = max(1, len(shunt.denominator) - 1)
    above = min(below, 2 * len(wanted) - 1 - below)  # no more coefficients than equations
    # numerator(s) gain = denominator(s), of which the highest coefficient is 1.
    gain = _plant(system).response(z)[:, None]
    leading, *lower = (s**power for power in range(below, -1, -1))
    equations = np.hstack((gain * s[:, None] ** np.arange(above, -1, -1), -np.stack(lower, axis=1)))
    rows, right = (np.concatenate((part.real, part.imag)) for part in (equations, leading))
    found = np.linalg.lstsq(rows, right, rcond=None)[0]
    numerator = found[: above + 1] / scale ** np.arange(above, -1, -1)
    denominator = np.array([1.0, *found[above + 1 :]]) / scale ** np.arange(below, -1, -1)
    better = replace(shunt, numerator=tuple(map(float, numerator)), denominator=tuple(map(float, denominator)))
    radius = sampled_loop(System(system.transducer, better)).radius
    if not radius < 1:
        late = f"found {shunt.delay:g} s with samples every {shunt.sample_time:g} s"
        reason = f"no admittance of order {below} is found that is stable with it (spectral radius {radius:.6g})"
        raise ParameterError("delay", f"{late}, but {reason}")
    return better


def _shunt(system: System) -> Digital:
    """The digital shunt of a system."""
    if not isinstance(system.shunt, Digital):
        raise ParameterError("shunt", f"found {system.shunt.kind}, must be a digital one")
    return system.shunt


def _under_current(system: System) -> LinearModel:
    """Rows of the transducer with the other shunts, a current imposed at the digital one's electrodes."""
    number = system.shunt.electrode
    opened = system.opened

    def terminate(ports, z, dz, w):
        of_ports, own = circuit_equations(opened.shunt, "linear", ports, z, dz)
        place = ports.charged.index(number)
        of_ports[place] = of_ports[place] - w["current"]
        return [*of_ports, *own]

    return connect(
        system.transducer, terminate, circuit_states(opened), electrical=("current",), electrodes=opened.shunt.taken
    )


def _motion(system: System) -> _Motion:
    a, b, c, _ = _under_current(system).explicit(("voltage",))
    n = len(a)
    generator = np.zeros((n + 1, n + 1))
    generator[:n, :n], generator[:n, n] = a, b[:, 1]
    return _Motion(generator * _shunt(system).sample_time, c[0])


def _plant(system: System) -> _Plant:
    """The transducer from one sample to the next."""
    return _motion(system).plant(*_shunt(system).lateness())


def _circuit_poles(system: System) -> np.ndarray:
    """Poles (1/s, one of each pair) without sampling and delay that are farthest from those with open electrodes."""
    from scipy.signal import tf2ss

    shunt = _shunt(system)
    a, b, c, _ = _under_current(system).explicit(("voltage",))
    of, into, out, through = tf2ss(shunt.numerator, shunt.denominator)
    current = b[:, 1:]
    loop = np.block([[a + through * current @ c, current @ out], [into @ c, of]])
    found, opened = np.linalg.eigvals(loop).astype(complex), np.linalg.eigvals(a)
    found = found[np.imag(found) > 0]
    moved = np.min(np.abs(found[:, None] - opened) / np.abs(found[:, None]), axis=1)
    pairs = max(1, 2 * (len(shunt.denominator) // 2))
    return found[np.argsort(-moved)][:pairs]
