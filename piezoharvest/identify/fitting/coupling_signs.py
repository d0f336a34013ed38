"""Signs of couplings that records cannot tell: they know the square alone, and the nominal value has the sign.

Turning the coupling round turns what is electrical against what is mechanical. Records that hold one of the two alone
look the same: an impedance, a current by a voltage, a displacement by a force.
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


def sides(data: Data | FrequencyData) -> set[bool]:
    """Which sides a record sees: True the electrical, False the mechanical one."""
    if isinstance(data, Data):
        return {channel in ELECTRICAL for channel in (data.drive, *data.channels)}
    return {channel in ELECTRICAL for channel in (data.record.input, data.record.output)}


def with_known_signs(
    parameters: Sequence[Parameter], data: Sequence[Data | FrequencyData], nominal: Transducer
) -> tuple[list[Parameter], frozenset[str]]:
    """Parameters; couplings whose sign the records cannot tell by their logarithm, with the sign of the nominal value.

    Returns
    -------
    parameters : list of Parameter
    ambiguous : frozenset of str
        Names of these couplings.
    """
    seen = [sides(each) for each in data]
    if any(len(each) > 1 for each in seen):
        return list(parameters), frozenset()
    # Seen by its electrodes alone, each mode may be turned round; else all of them together, the first one for all.
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
