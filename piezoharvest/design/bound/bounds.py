"""The bound of a design: certified, reached, without causality, and for any interface."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from piezoharvest.design.bound.certificate import certify
from piezoharvest.design.bound.density import subdivided
from piezoharvest.design.bound.mesh import Grading, mesh
from piezoharvest.design.bound.port import ElectrodePort
from piezoharvest.design.bound.reached import reach
from piezoharvest.design.bound.target import Kind, Target, least_displacement
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.operation import operation_of
from piezoharvest.design.result import Bound

# Meshes of the certificate and of what is reached: refined until the two agree. Displacements are differences of large
# parts, and need finer ones than powers; the certificate at the edges of the band, the other one near poles.
_EDGES = {"near_edge": 0.4, "at_edge": 1e-4}
_DISPLACEMENT = (
    (Grading(20, 0.25, **_EDGES), Grading(20, 0.12)), (Grading(40, 0.25, **_EDGES), Grading(40, 0.08)),
    (Grading(40, 0.25, **_EDGES), Grading(60, 0.06)),
)  # fmt: skip
_POWER = tuple((Grading(*each), Grading(*each)) for each in ((20, 0.25), (40, 0.12), (60, 0.08)))
_MESHES: dict[Kind, tuple] = {"power": _POWER, "peak": _DISPLACEMENT, "mean_square": _DISPLACEMENT}
_COARSEST = Grading(20, 0.25)
_MAX_NODES = 310  # time goes with the cube: 300 take 8 s, 500 would take a minute (three modes in one band)
# Where the certificate's functions differ from zero: about the band, and where Re Z/|Z| counts. A certificate holds
# with any; with 0.3 and 3 in place of 0.6 and 1.6 it comes closer by 2e-4 of its value.
_BELOW, _ABOVE, _NEGLIGIBLE = 0.6, 1.6, 1e-3
_LOSSLESS = 1e-9  # Re Z/|Z|: the rounding error of Z is 1e-12 to 1e-10 of it
_AGREEMENT = 0.01  # between what is certified and what is reached, as users are promised
_CANCELLED = 1e-6  # of the displacement with shorted electrodes: the solver's accuracy


def bound_of(view: LinearView) -> Bound:
    """Bound of passive, causal, linear one-ports on the electrodes of a transducer in its operation.

    Parameters
    ----------
    view : LinearView
        With hysteresis at the charge amplitude of its linearisation.

    Notes
    -----
    One frequency: closed form (|v|^2/(8 Re Z); distance of a disc from zero). Lines that act together: the sum over
    the lines, as a network may have any passive impedance at each. Bands and noise: `certificate`, `reached`.
    `any_interface` is the power that anything on the electrodes can draw, whether it switches or not: current at
    frequencies that are not driven only loses power.
    """
    port, notes = ElectrodePort(view), []
    op, objective = view.operation, view.goal.options.objective
    linearised = view.transducer.hysteresis is not None
    obstacle = _obstacle(port)
    if obstacle:
        return Bound(linearised=linearised, notes=(f"no bound: {obstacle}",))
    found: dict[str, float | None] = {}
    computed: list[tuple[float, float | None, Kind]] = []
    if objective in ("harvest", "trade_off"):
        value, reached, acausal = _figures(port, "power")
        computed.append((value, reached, "power"))
        found |= {"harvested_power": value, "reached": reached, "frequency_wise": acausal}
        found["any_interface"] = _frequency_wise(ElectrodePort(_elastic(view)), "power")
    if objective in ("damping", "trade_off"):
        kind: Kind = "peak" if op.apart else "mean_square"
        value, reached, acausal = _figures(port, kind)
        computed.append((value, reached, kind))
        shorted = _shorted(view)
        found["attenuation_db"] = _decibels(value, shorted)
        if objective == "damping":
            found |= {"reached": _decibels(reached, shorted), "frequency_wise": _decibels(acausal, shorted)}
    notes += [_gap(*values) for values in computed if values[0] > 0 and not _agree(*values[:2])]
    return Bound(**found, linearised=linearised, notes=tuple(notes))


def bound_in_band(view: LinearView, frequencies: np.ndarray) -> Bound:
    """Bound of the harvested power where the frequency of the sine is free: the largest of all in a band.

    Parameters
    ----------
    view : LinearView
        At any one frequency.
    frequencies : (f,) array
        Hz, over the band, close enough to see every maximum.
    """

    def most(view: LinearView) -> LinearView:
        def less(frequency: float) -> float:
            return -float(limits_along(view, np.array([frequency]))[0][0])

        n = int(np.argmax(np.nan_to_num(limits_along(view, frequencies)[0], nan=0.0, posinf=0.0)))
        near = frequencies[max(n - 1, 0)], frequencies[min(n + 1, len(frequencies) - 1)]
        top: Any = minimize_scalar(less, bounds=near, method="bounded")
        best = float(top.x) if top.fun < less(frequencies[n]) else float(frequencies[n])
        operation = operation_of(view.operation.at(best), None, view.transducer)
        return dataclasses.replace(view, operation=operation)

    found, anything = bound_of(most(view)), most(_elastic(view))
    return dataclasses.replace(found, any_interface=bound_of(anything).any_interface)


def _elastic(view: LinearView) -> LinearView:
    """The view without hysteresis."""
    return dataclasses.replace(view, transducer=dataclasses.replace(view.transducer, hysteresis=None), amplitude=None)


def limits_along(view: LinearView, frequencies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Largest power (f,) in W and least displacement amplitude (f,) in m of a passive shunt at each frequency alone.

    Parameters
    ----------
    view : LinearView
        Of a sinusoidal drive, whose amplitude is kept.
    frequencies : (f,) array
        Hz.
    """
    at, amplitude = ElectrodePort(view).at(2 * np.pi * frequencies), view.operation.amplitude
    return amplitude**2 * np.abs(at.voltage) ** 2 / (8 * at.resistance), amplitude * least_displacement(at)


def _figures(port: ElectrodePort, kind: Kind) -> tuple[float, float | None, float]:
    """Certified, reached and frequency-wise value, W or m."""
    target, acausal = _target(port.view, kind), _frequency_wise(port, kind)
    if target is None:
        return acausal, acausal, acausal
    power, values, reached = kind == "power", [acausal], []
    for nodes, others in _meshes(port, target):
        # Every mesh gives a bound, and a value that is reached: the closest count.
        certified = certify(port, target, nodes, _support(port, target, nodes))
        values += [] if certified is None else [certified]
        found = reach(port, target, others)
        reached += [] if found is None else [found[0]]
        value, best = (min(values), max(reached, default=None)) if power else (max(values), min(reached, default=None))
        if (not power and value == 0) or _agree(value, best):
            break
    return value, best, acausal


def _meshes(port: ElectrodePort, target: Target) -> list[tuple[np.ndarray, np.ndarray]]:
    """Meshes to be tried one after the other, rad/s: those that are quick to solve, or the coarsest one."""
    coarsest = mesh(target.band, port.poles, _COARSEST)
    pairs = [tuple(mesh(target.band, port.poles, each) for each in pair) for pair in _MESHES[target.kind]]
    return [(a, b) for a, b in pairs if max(len(a), len(b)) <= _MAX_NODES] or [(coarsest, coarsest)]


def _support(port: ElectrodePort, target: Target, nodes: np.ndarray) -> tuple[float, float]:
    """Frequencies about the band between which Re Z counts, rad/s."""
    impedance = port.at(nodes).impedance
    lossy = nodes[np.real(impedance) > _NEGLIGIBLE * np.abs(impedance)]
    low, high = _BELOW * target.band[0], _ABOVE * target.band[1]
    return float(np.min(lossy, initial=low)), float(np.max(lossy, initial=high))


def _agree(value: float, reached: float | None) -> bool:
    return reached is not None and abs(value - reached) <= _AGREEMENT * value


def _gap(value: float, reached: float | None, kind: Kind) -> str:
    """Remark on a bound that is not shown to be reached within 1 %, in the unit in which the bound is told."""
    if reached is None:
        return "no shunt is shown to reach the bound: the convex program could not be solved"
    gap, promised = f"{100 * abs(value - reached) / value:.4g} %", f"{100 * _AGREEMENT:g} %"
    if kind != "power":  # displacements, which are told in decibels
        gap, promised = (f"{20 * np.log10(ratio):.4g} dB" for ratio in (reached / value, 1 + _AGREEMENT))
    return f"the bound is certified, but the best network that is known comes within {gap} of it, not {promised}"


def _target(view: LinearView, kind: Kind) -> Target | None:
    """Target of a band or of noise; None for separate lines."""
    op, excitation = view.operation, view.operation.excitation
    if op.band is not None:
        band, density = op.band, op.amplitude**2
        width = 2 * np.pi * (band[1] - band[0])
        return Target(kind, _angular(band), density if kind == "peak" else density / width)
    psd = getattr(excitation, "psd", None)
    if psd is None:
        return None
    low, high = excitation.band  # pyright: ignore[reportAttributeAccessIssue]
    return Target(kind, _angular((max(low, 1e-6 * high), high)), psd / np.pi)


def _angular(band: tuple[float, float]) -> tuple[float, float]:
    return 2 * np.pi * band[0], 2 * np.pi * band[1]


def _frequency_wise(port: ElectrodePort, kind: Kind) -> float:
    """Figure if every frequency had a passive shunt of its own."""
    op = port.view.operation
    if kind == "peak" and op.band is not None:
        band = _angular(op.band)
        omega = subdivided(mesh(band, port.poles, _COARSEST), 4)
        return Target(kind, band, op.amplitude**2).frequency_wise(omega, port.at(omega))
    at = port.at(2 * np.pi * op.frequencies)
    if kind == "power":
        return float(op.squares @ (np.abs(at.voltage) ** 2 / (8 * at.resistance)))
    return float(np.sqrt(op.squares @ least_displacement(at) ** 2))


def _shorted(view: LinearView) -> float:
    """The displacement's figure with shorted electrodes, m."""
    if view.operation.apart:
        return view.shorted
    displacement = np.abs(view.response(view.short, view.operation.frequencies).displacement)
    return float(np.sqrt(view.operation.squares @ displacement**2))


def _decibels(displacement: float | None, shorted: float) -> float | None:
    """Attenuation in dB; None where the displacement can be cancelled whole, or is not known."""
    if displacement is None or not displacement > _CANCELLED * shorted:
        return None
    return 20 * float(np.log10(displacement / shorted))


def _obstacle(port: ElectrodePort) -> str:
    """Reason why there is no bound, in words; empty if there is none."""
    operation = port.view.operation
    if not operation.periodic and not hasattr(operation.excitation, "psd"):
        return "the excitation ends, and what is stored then counts as much as what is harvested"
    lines = 2 * np.pi * operation.frequencies
    at = port.at(np.union1d(lines, np.geomspace(0.1, 10, 201) * lines[len(lines) // 2]))
    share = at.resistance / np.abs(at.impedance)
    if np.nanmin(share) < -_LOSSLESS:
        return "the transducer with its effects is not passive: it delivers power by itself"
    if not np.nanmax(share) > _LOSSLESS:
        return "the transducer has no loss"
    return ""
