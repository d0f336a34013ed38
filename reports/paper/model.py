"""The transducer of Table V, in the readings that its printed units leave open."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from piezoharvest import Hysteresis, Resistor, System, Transducer
from reports.paper import tables
from reports.paper.closed_form import Circuit

# Stand-ins for zero and infinity in the thresholds of stop operators, C: seven orders beyond any charge here.
_NO_CHARGE, _ANY_CHARGE = 1e-10, 1.0


def table_value(symbol: str) -> float:
    """Value of a parameter of Table V in SI units."""
    return tables.parameters()[symbol].printed.value


def transducer(reading: str = "stop", **changes) -> Transducer:
    """The transducer of Table V.

    Parameters
    ----------
    reading : str
        How r_i and w_i are read. "stop": v_h = sum w_i stop(q; r_i) with r in uC and w in V/uC. "play":
        q = sum w_i play(v_h; r_i), as equations (11) and (12) are written, with r in V and w in uC/V. "none": left out.
    **changes
        Fields of the transducer that differ from Table V.
    """
    names = {"mass": "m", "damping": "b", "stiffness": "k", "coupling": "T", "capacitance": "C"}
    values = {name: table_value(symbol) for name, symbol in names.items()}
    return Transducer(**{**values, "hysteresis": hysteresis(reading), **changes})


def hysteresis(reading: str) -> Hysteresis | None:
    """The Prandtl-Ishlinskii model of Table V in one of the readings of `transducer`.

    Raises
    ------
    KeyError
        Unknown reading.
    """
    r = [float(tables.parameters()[f"r_{n}"].printed.text) for n in (1, 2, 3)]
    w = [float(tables.parameters()[f"w_{n}"].printed.text) for n in (1, 2, 3)]
    return {
        "none": lambda: None,
        "stop": lambda: Hysteresis(thresholds=tuple(1e-6 * np.array(r)), weights=tuple(1e6 * np.array(w))),
        "play": lambda: as_stops(r, [1e-6 * slope for slope in w]),
    }[reading]()


def as_stops(thresholds: Sequence[float], slopes: Sequence[float]) -> Hysteresis:
    """Stop operators of charge that are the inverse of play operators of voltage.

    Parameters
    ----------
    thresholds : sequence of float
        Of the play operators, V, increasing, all above zero.
    slopes : sequence of float
        C/V.

    Notes
    -----
    On the virgin curve the charge is zero up to the first threshold and then rises with the slopes of the operators
    that move. Its inverse jumps by the first threshold and has corners where the next operator joins; beyond the last
    one it goes on rising, which is a capacitance in series.
    """
    r, stiffness = np.asarray(thresholds, float), 1.0 / np.cumsum(slopes)
    corners = np.cumsum(np.diff(r) / stiffness[:-1])
    return Hysteresis(
        thresholds=(_NO_CHARGE, *corners, _ANY_CHARGE),
        weights=(r[0] / _NO_CHARGE, *-np.diff(stiffness), stiffness[-1]),
    )


def table_circuit() -> Circuit:
    """Table V without its hysteresis, as the closed forms take it."""
    charge = table_value("T") / table_value("k")
    return Circuit(charge, table_value("C") + table_value("T") * charge)


def loaded(device: Transducer, load: float) -> System:
    """The transducer on a load (ohm) with the shunt of the current measurement in series."""
    return System(device, Resistor(resistance=load + tables.experiment()["shunt_ohm"]))


def open_circuit_voltage_per_force(device: Transducer) -> float:
    """Quasi-static voltage of the linear transducer with open leads, V/N: no load and no rise time gives more."""
    charge = device.coupling / device.stiffness
    return charge / (device.capacitance + device.coupling * charge)
