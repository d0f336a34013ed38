"""State-space systems of python-control with named signals: transducer two-ports, linear circuits, closed loops."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from piezoharvest.description.circuit import Row, State
from piezoharvest.description.parameters import ParameterError, check_kind
from piezoharvest.description.shunts.base import LinearShunt
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.equations.rows import Ports
from piezoharvest.linear.assembly import (
    LinearModel,
    OperatingPoint,
    assemble,
    connect,
    hysteresis_slope,
    require_positive,
)
from piezoharvest.linear.circuits import circuit_columns

if TYPE_CHECKING:
    from control import StateSpace

Drive = Literal["current", "voltage"]


def linearize(
    transducer: Transducer,
    *,
    drive: Drive = "current",
    base: bool = False,
    operating_point: OperatingPoint = "stick",
    amplitude: float | None = None,
    frequency: float | None = None,
    lead_resistance: float | None = None,
    name: str = "transducer",
) -> StateSpace:
    """Linear two-port of a transducer as a `control.StateSpace` with named signals.

    Parameters
    ----------
    transducer : Transducer
    drive : "current" or "voltage"
        Quantity imposed on the electrodes. "current": inputs `force` and `current`, outputs `displacement`, `velocity`
        and `voltage`, with further electrodes also `current1`, `voltage1`, ... "voltage": those are open; inputs
        `force` and `voltage`, outputs `displacement`, `velocity`, `charge`, `current`.
        `current` is the LOAD current i (A), positive out of the transducer, and `charge` its integral (C, without
        effects -q_p), so that current = d charge/dt and a resistor closes the loop by current = voltage/R.
    base : bool
        Take `base_acceleration` (m/s^2) as input instead of `force` (N).
    operating_point : "stick", "slip" or sequence of bool
        Hysteresis by its slope: all operators stick (small signal), all slip, or True for each one that slips.
    amplitude : float, optional
        Charge amplitude in C. If given, the hysteresis is represented by its describing function N: Re N as slope and
        Im N as the series resistance Im N/omega, which is exact at `frequency` only.
    frequency : float, optional
        Hz, used with `amplitude`; default the first mode's short-circuit resonance.
    lead_resistance : float, optional
        Voltage drive only: resistance in ohm between the imposed voltage and the electrodes. An ideal capacitor has
        no proper current response; with it, current and charge roll off at 1/(R C). Default 1e-6/(w_oc C), an error
        of about 1e-6 at the open-circuit resonance; take a larger one where the fast pole is in the way.
    name : str
        Name of the system, for `control.interconnect`.

    Returns
    -------
    control.StateSpace
        States x1, u1 (m, m/s; first mode), x2, u2, ..., q (C, q_p), then those of the effects.

    Raises
    ------
    ParameterError
        An argument is not one of those allowed.
    """
    check_kind("transducer", transducer, Transducer, "closed_loop takes a System, linearize_shunt a shunt")
    slope = complex(hysteresis_slope(transducer, operating_point, amplitude))
    frequency = transducer.short_circuit_frequency if frequency is None else frequency
    require_positive("frequency", frequency, "Hz")
    settings: dict[str, Any] = {
        "slope": slope.real, "resistance": slope.imag / (2 * np.pi * frequency), "base": base,
        "operating_point": operating_point,
    }  # fmt: skip
    if drive == "current":
        numbers = ["", *map(str, range(1, 1 + len(transducer.electrodes)))]
        currents = [f"current{number}" for number in numbers]
        model = connect(
            transducer, lambda ports, z, dz, w: [p.i - w[name] for p, name in zip(ports.all, currents, strict=True)],
            electrical=currents, electrodes=range(len(numbers)), **settings,
        )  # fmt: skip
        return _state_space(model, ("displacement", "velocity", *(f"voltage{number}" for number in numbers)), name)
    if drive != "voltage":
        raise ParameterError("drive", f'found "{drive}", must be "current" or "voltage"')
    model = _voltage_driven(transducer, lead_resistance, settings)
    return _state_space(model, ("displacement", "velocity", "load_charge", "current"), name, load_charge="charge")


def _voltage_driven(transducer: Transducer, lead_resistance: float | None, settings: dict[str, Any]) -> LinearModel:
    """Rows of the transducer behind its leads; with effects that draw current the load's charge is a state."""
    if lead_resistance is None:
        lead_resistance = 1e-6 / (2 * np.pi * transducer.open_circuit_frequency * transducer.capacitance)
    require_positive("lead_resistance", lead_resistance, "ohm")
    integrate = bool(transducer.effects)

    def terminate(ports: Ports, z, dz, w) -> list[Row]:
        port = ports[0]
        # The source's voltage drives -i through the leads into the electrodes: w = v - R i.
        leads = port.v - lead_resistance * port.i - w["voltage"]
        return [leads, dz.charge - port.i] if integrate else [leads]

    states = (State("charge", 0.0),) if integrate else ()
    model = connect(transducer, terminate, states, prefix="load_", electrical=("voltage",), **settings)
    return dataclasses.replace(model, rows={"load_charge": -model.rows["charge"], **model.rows})


def closed_loop(
    system: System, *, base: bool = False, operating_point: OperatingPoint = "stick", name: str = "system"
) -> StateSpace:
    """Transducer with its linear shunt as a `control.StateSpace`.

    Parameters
    ----------
    system : System
        The shunt must be linear.
    base : bool
        Take `base_acceleration` (m/s^2) as input instead of `force` (N).
    operating_point : "stick", "slip" or sequence of bool
        Hysteresis by its slope, as in `linearize`.
    name : str
        Name of the system.

    Returns
    -------
    control.StateSpace
        Input `force` or `base_acceleration`; outputs `displacement`, `velocity`, `voltage`, `current` (load).

    Raises
    ------
    ParameterError
        The shunt has switches or diodes.
    """
    check_kind("system", system, System, "System(transducer, shunt) makes one")
    slope = hysteresis_slope(system.transducer, operating_point)
    model = assemble(system.transducer, system.shunt, slope=slope, base=base, operating_point=operating_point)
    return _state_space(model, ("displacement", "velocity", "voltage", "current"), name)


def linearize_shunt(
    shunt: LinearShunt, *, drive: Drive = "voltage", capacitance: float = float("nan"), name: str = "shunt"
) -> StateSpace:
    """Linear circuit as a `control.StateSpace`, for interconnection with `linearize(transducer, ...)`.

    Parameters
    ----------
    shunt : LinearShunt
    drive : "voltage" or "current"
        "voltage": input `voltage` (V), output `current` (load current, A): the admittance; goes with a transducer
        under current drive. "current": the impedance; goes with one under voltage drive.
    capacitance : float, optional
        Clamped capacitance of the transducer in F, for circuits that are tuned to it.
    name : str
        Name of the system.

    Raises
    ------
    ParameterError
        The response is improper (a capacitance has no proper admittance, a series inductance no proper impedance).
    """
    if drive not in ("current", "voltage"):
        raise ParameterError("drive", f'found "{drive}", must be "current" or "voltage"')
    columns = circuit_columns(shunt, capacitance)
    output = "current" if drive == "voltage" else "voltage"
    imposed, free = (columns.v, columns.i) if drive == "voltage" else (columns.i, columns.v)
    z, dz, imposed, free, rest = _integrated(columns.z, columns.dz, imposed, free, columns.dv, drive)
    try:
        solution = -np.linalg.solve(np.column_stack((dz, free)), np.column_stack((z, imposed)))
    except np.linalg.LinAlgError:
        rest = np.ones(1)
    if np.any(rest):
        raise ParameterError(
            "drive",
            f'found "{drive}" for {shunt.kind}, whose response to it is improper (not causal), must be "{output}"',
        )
    n = len(columns.states)
    signals = {"inputs": [drive], "outputs": [output], "states": list(columns.states), "name": name}
    return _system(solution[:n, :n], solution[:n, n:], solution[n:, :n], solution[n:, n:], signals)


def _integrated(z, dz, imposed, free, dv, drive: Drive):
    """Integrate equations that contain derivatives only: a constraint such as dv/dt = 0 becomes v = 0."""
    pure = ~(np.any(z, axis=1) | (imposed != 0) | (free != 0))
    z, dz = np.where(pure[:, None], dz, z), np.where(pure[:, None], 0.0, dz)
    voltage = np.where(pure, dv, imposed if drive == "voltage" else free)
    imposed, free = (voltage, free) if drive == "voltage" else (imposed, voltage)
    return z, dz, imposed, free, np.where(pure, 0.0, dv)


def _state_space(model: LinearModel, outputs: tuple[str, ...], name: str, **labels: str) -> StateSpace:
    """State-space system of a model; `labels` rename outputs."""
    matrices = model.explicit(outputs)
    signals = {
        "inputs": list(model.inputs), "outputs": [labels.get(output, output) for output in outputs],
        "states": list(model.states), "name": name,
    }  # fmt: skip
    return _system(*matrices, signals)


def _system(a, b, c, d, signals: dict[str, Any]) -> StateSpace:
    """System of python-control, which is imported only here: that takes a second."""
    from control import StateSpace

    return StateSpace(*(matrix + 0.0 for matrix in (a, b, c, d)), **signals)
