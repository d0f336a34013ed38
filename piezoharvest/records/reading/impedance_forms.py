"""Forms in which analysers and LCR meters give an impedance, one table.

Keysight, Impedance Measurement Handbook (5950-3000), table of parameters: the loss factor D = 1/Q is that of a
resistance in series with a capacitor (R_s omega C_s) or in parallel (1/(R_p omega C_p)), likewise of a coil.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

Formula = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


class Quantity(NamedTuple):
    """A quantity of which a form consists: its default column and its SI unit."""

    column: str
    unit: str


QUANTITIES: Mapping[str, Quantity] = {
    "admittance": Quantity("admittance_S", "S"),
    "admittance_phase": Quantity("admittance_phase_rad", "rad"),
    "conductance": Quantity("conductance_S", "S"),
    "susceptance": Quantity("susceptance_S", "S"),
    "parallel_capacitance": Quantity("parallel_capacitance_F", "F"),
    "series_capacitance": Quantity("series_capacitance_F", "F"),
    "parallel_inductance": Quantity("parallel_inductance_H", "H"),
    "series_inductance": Quantity("series_inductance_H", "H"),
    "parallel_resistance": Quantity("parallel_resistance_ohm", "ohm"),
    "loss_factor": Quantity("loss_factor", ""),
    "quality_factor": Quantity("quality_factor", ""),
}
# Impedance, below it admittance, from omega (rad/s) and the quantities of a form; "real" is the resistance in series.
_SERIES: Mapping[tuple[str, str], Formula] = {
    ("series_capacitance", "loss_factor"): lambda w, c, d: (d - 1j) / (w * c),
    ("series_capacitance", "quality_factor"): lambda w, c, q: (1 / q - 1j) / (w * c),
    ("series_capacitance", "real"): lambda w, c, r: r - 1j / (w * c),
    ("series_inductance", "loss_factor"): lambda w, l, d: (d + 1j) * w * l,  # noqa: E741
    ("series_inductance", "quality_factor"): lambda w, l, q: (1 / q + 1j) * w * l,  # noqa: E741
    ("series_inductance", "real"): lambda w, l, r: r + 1j * w * l,  # noqa: E741
}
_PARALLEL: Mapping[tuple[str, str], Formula] = {
    ("conductance", "susceptance"): lambda w, g, b: g + 1j * b,
    ("admittance", "admittance_phase"): lambda w, y, angle: y * np.exp(1j * angle),
    ("parallel_capacitance", "loss_factor"): lambda w, c, d: (d + 1j) * w * c,
    ("parallel_capacitance", "quality_factor"): lambda w, c, q: (1 / q + 1j) * w * c,
    ("parallel_capacitance", "conductance"): lambda w, c, g: g + 1j * w * c,
    ("parallel_capacitance", "parallel_resistance"): lambda w, c, r: 1 / r + 1j * w * c,
    ("parallel_inductance", "loss_factor"): lambda w, l, d: (d - 1j) / (w * l),  # noqa: E741
    ("parallel_inductance", "quality_factor"): lambda w, l, q: (1 / q - 1j) / (w * l),  # noqa: E741
    ("parallel_inductance", "conductance"): lambda w, l, g: g - 1j / (w * l),  # noqa: E741
    ("parallel_inductance", "parallel_resistance"): lambda w, l, r: 1 / r - 1j / (w * l),  # noqa: E741
}
FORMS = (*_SERIES, *_PARALLEL)


def impedance(parts: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Impedance (ohm) from the quantities of a form and "frequency" (Hz); None if there is no form among them."""
    omega = 2 * np.pi * parts["frequency"]
    for form in FORMS:
        if all(part in parts for part in form):
            first, second = (parts[part] for part in form)
            with np.errstate(divide="ignore", invalid="ignore"):  # what is not finite is found by the checks
                if form in _SERIES:
                    return _SERIES[form](omega, first, second)
                return 1 / _PARALLEL[form](omega, first, second)
    return None
