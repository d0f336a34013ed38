"""Poles of the closed loop of a transducer and a linear circuit, and a stability check."""

from __future__ import annotations

import dataclasses

import numpy as np

from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts.base import LinearShunt
from piezoharvest.description.system import System
from piezoharvest.equations.circuits import circuit_states
from piezoharvest.equations.terms import Terms
from piezoharvest.linear.assembly import CANCELLED, OperatingPoint, assemble, hysteresis_slope

_RANK_TOLERANCE = 1e-13  # of the largest singular value: a smaller one counts as zero
_MAX_DOUBLINGS = 14  # of an unstable value, upwards and downwards, in the search for a stable one
_REAL_PART_TOLERANCE = 1e-9  # of a pole's magnitude: a smaller real part counts as zero


def poles(system: System, *, operating_point: OperatingPoint = "stick") -> np.ndarray:
    """Poles of the closed loop, 1/s: generalised eigenvalues of M z' = N z.

    Parameters
    ----------
    system : System
        The shunt must be linear.
    operating_point : "stick", "slip" or sequence of bool
        Hysteresis by its slope: all operators stick, all slip, or True for each one that slips.

    Returns
    -------
    (n,) complex array
        Sorted by magnitude. A floating charge (open electrodes) and a constraint that a circuit states by its
        derivative (a short) give poles at exactly zero.

    Raises
    ------
    ParameterError
        The shunt has switches or diodes, or cancels the transducer's capacitance exactly.
    """
    slope = hysteresis_slope(system.transducer, operating_point)
    model = assemble(system.transducer, system.shunt, slope=slope, operating_point=operating_point)
    # Normalised: states by their energy, time by the first resonance, each equation by its largest term.
    rate, scales = 2 * np.pi * system.transducer.short_circuit_frequency, _energy_scales(system)
    m, n = model.M * scales * rate, model.N * scales
    rows = np.max(np.abs(np.concatenate((m, n), axis=1)), axis=1, keepdims=True)
    m, n = m / rows, n / rows
    # Combinations of equations without states (y N = 0) conserve y M z: poles at zero, removed before rounding can
    # shift them.
    left, singular, _ = np.linalg.svd(n)
    conserved = left.T[singular < _RANK_TOLERANCE * singular[0]] @ m
    motion = np.linalg.svd(conserved)[2][len(conserved) :].T if len(conserved) else np.eye(len(m))
    try:
        found = np.linalg.eigvals(motion.T @ np.linalg.solve(m, n @ motion)) * rate
    except np.linalg.LinAlgError:
        raise ParameterError("capacitance", f"{CANCELLED}, use another value") from None
    found = np.concatenate((np.zeros(len(conserved)), found)).astype(complex)
    return found[np.lexsort((np.imag(found), np.abs(found)))]


def _energy_scales(system: System) -> np.ndarray:
    """Value of each state, in the order of the model, at which its energy is 1/2 J."""
    transducer = system.transducer
    scales = [scale for mode in transducer.all_modes for scale in (mode.stiffness**-0.5, mode.mass**-0.5)]
    states = Terms(transducer, linearised=True).states
    states += circuit_states(system)
    charged = sorted({0, *system.shunt.taken})
    charges = [transducer.all_electrodes[number].capacitance ** 0.5 for number in charged]
    return np.array([*scales, *charges, *(abs(s.storage or 1.0) ** -0.5 for s in states)])


def check_stability(system: System) -> None:
    """Raise an error unless the closed loop is stable, with sticking and with slipping hysteresis.

    A pole at zero (a floating charge) is not instability. Circuits with switches or diodes are passive and pass.

    Raises
    ------
    ParameterError
        A pole has a positive real part; the message names the value at fault, the allowed values and the pole.
    """
    if not isinstance(system.shunt, LinearShunt):
        return
    worst = _unstable_pole(system)
    if worst is None:
        return
    imaginary = f" ± {abs(worst.imag):.4g}j" if worst.imag else ""
    reason = f"closed loop unstable: pole at +{worst.real:.4g}{imaginary} 1/s"
    key = _active_field(system)
    if key is None:
        raise ParameterError("shunt", f"found {system.shunt.kind}, which is not stable with this transducer ({reason})")
    unit = next(field.metadata["unit"] for field in dataclasses.fields(system.shunt) if field.name == key)
    found, allowed = getattr(system.shunt, key), _stable_values(system, key, unit)
    raise ParameterError(key, f"found {found:g} {unit}, must be {allowed} ({reason})")


def _unstable_pole(system: System) -> complex | None:
    """Unstable pole with the largest real part, or None if the loop is stable; infinite if the loop is singular."""
    worst: complex | None = None
    for operating_point in ("stick", "slip"):
        try:
            found = poles(system, operating_point=operating_point)
        except ParameterError:
            return complex(np.inf)
        found = found[
            np.real(found) > np.maximum(_REAL_PART_TOLERANCE * np.abs(found), _RANK_TOLERANCE * np.max(np.abs(found)))
        ]
        if len(found) and (worst is None or np.real(found).max() > worst.real):
            worst = complex(found[np.argmax(np.real(found))])
    return worst


def _active_field(system: System) -> str | None:
    """Name of the shunt's field for the magnitude of a negative storage element, if there is one."""
    negative = [-state.storage for state in system.shunt.states(system.electrode.capacitance) if state.storage < 0]
    for field in dataclasses.fields(system.shunt):
        if "unit" in field.metadata and any(getattr(system.shunt, field.name) == value for value in negative):
            return field.name
    return None


def _stable_values(system: System, key: str, unit: str) -> str:
    """Description of the values of a shunt's field with which the loop is stable, by bisection."""
    found = getattr(system.shunt, key)

    def stable(value: float) -> bool:
        shunt = dataclasses.replace(system.shunt, **{key: value})
        return _unstable_pole(System(system.transducer, shunt)) is None

    for doublings in range(1, _MAX_DOUBLINGS):
        for factor, words in ((0.5, "less than"), (2.0, "greater than")):
            good = found * factor**doublings
            if not stable(good):
                continue
            bad = found * factor ** (doublings - 1)
            while abs(good / bad - 1) > 1e-6:
                middle = (good * bad) ** 0.5
                good, bad = (middle, bad) if stable(middle) else (good, middle)
            return f"{words} {good:.6g} {unit}"
    return "another shunt: no value is stable with this transducer"
