"""Signs of couplings that records do not determine: only the square is known, and the sign is the nominal one.

Reversing a coupling reverses the electrical against the mechanical quantities. Records with only one of the two do not
change: an impedance, a current by a voltage, a displacement by a force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from piezoharvest.description.transducer import Transducer
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.predict.parameters import Parameter, value_at

ELECTRICAL = {"voltage", "current"}


def domains(data: Data | FrequencyData) -> set[bool]:
    """Sides of the transducer that a record contains: True the electrical, False the mechanical one."""
    if isinstance(data, Data):
        return {channel in ELECTRICAL for channel in (data.drive, *data.channels)}
    return {channel in ELECTRICAL for channel in (data.record.input, data.record.output)}


def with_known_signs(
    parameters: Sequence[Parameter], data: Sequence[Data | FrequencyData], nominal: Transducer
) -> tuple[list[Parameter], frozenset[str]]:
    """Parameters, with couplings of ambiguous sign scaled by their logarithm, with the sign of the nominal value.

    Returns
    -------
    parameters : list of Parameter
    ambiguous : frozenset of str
        Names of these couplings.
    """
    seen = [domains(each) for each in data]
    if any(len(each) > 1 for each in seen):
        return list(parameters), frozenset()
    # In electrical channels only, the sign of each mode is ambiguous; else that of all together, given by the first.
    each_mode = all(True in side for side in seen)
    kept, names = [], set()
    for parameter in parameters:
        turned = parameter.path[-1] == "coupling" and (each_mode or len(parameter.path) == 1)
        value = float(value_at(nominal, parameter.path)) if turned else 0.0
        if value:
            names.add(parameter.name)
            kept.append(replace(parameter, scaling="log", sign=float(np.sign(value))))
        else:
            kept.append(parameter)
    return kept, frozenset(names)
