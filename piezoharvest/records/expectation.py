"""Responses to a record's drive that the nominal model predicts, with its values uncertain.

Nominal values are the start of a fit and may be wrong. A check may therefore use them only if every variant agrees:
resonances 0.7 to 1.4 times as high, damping 0.3 to 3 times as large, hysteresis sticking or slipping.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import lru_cache
from itertools import islice

import numpy as np

from piezoharvest.description.shunts import LinearShunt, Open, Short, Shunt
from piezoharvest.description.transducer import Transducer
from piezoharvest.linear import TwoPort, assemble, hysteresis_slope
from piezoharvest.linear.assembly import LinearModel, angular, connect
from piezoharvest.records.reading.channels import RATES

_MASSES = (1.0, 0.5, 0.7, 1.4, 2.0)
_DAMPINGS = (1.0, 0.3, 3.0)
MODELS = 16  # sets of models that are kept: loads of a campaign

# Transfer functions (variants, f) by response and input; the first variant is the nominal one.
Transfers = Mapping[str, Mapping[str, np.ndarray]]


def variants(transducer: Transducer) -> Iterator[tuple[Transducer, str]]:
    """Variants of the nominal transducer, each with the operating point of its hysteresis."""
    points = ("stick", "slip") if transducer.hysteresis else ("stick",)
    for mass in _MASSES:
        for damping in _DAMPINGS:
            scaled = {"mass": mass, "damping": damping}
            modes = tuple(_scaled(mode, scaled) for mode in transducer.modes)
            for point in points:
                yield _scaled(replace(transducer, modes=modes), scaled), point


def _scaled(part, factors: Mapping[str, float]):
    return replace(part, **{name: getattr(part, name) * factor for name, factor in factors.items()})


def transfers(
    transducer: Transducer, shunt: Shunt | None, drive: str, frequencies: np.ndarray, *, nominal: bool = False
) -> Transfers:
    """Responses of all channels to a unit drive.

    Parameters
    ----------
    transducer : Transducer
    shunt : Shunt or None
        With switches or diodes, only the motion is predicted, between that with open and with shorted electrodes.
    drive : str
        The imposed channel. With an imposed voltage, a force is a second input.
    frequencies : (f,) array
        Hz, above 0.
    nominal : bool
        Use the nominal values only.

    Returns
    -------
    mapping
        By response and input, arrays (variants, f) in SI units. A channel without a prediction is missing.
    """
    linear = drive == "voltage" or isinstance(shunt, LinearShunt)
    shunts = (shunt,) if linear else (Open(), Short())
    found: dict[str, dict[str, list[np.ndarray]]] = {}
    omega = angular(frequencies)
    for model in _models(transducer, shunts, drive, nominal):
        for (response, cause), values in _responses(model, drive, omega).items():
            if linear or response == "displacement" or response in RATES:
                found.setdefault(response, {}).setdefault(cause, []).append(values)
    # The predictions of these would be rounding errors only.
    silent = {"voltage"} if isinstance(shunt, Short) else {"current"} if isinstance(shunt, Open) else set()
    return {
        response: {cause: np.array(values) for cause, values in by.items()}
        for response, by in found.items()
        if drive == "voltage" or response not in silent
    }


@lru_cache(maxsize=MODELS)
def _models(
    transducer: Transducer, shunts: tuple[Shunt | None, ...], drive: str, nominal: bool
) -> tuple[LinearModel, ...]:
    """Models of all variants, or of the nominal one, with each of the shunts; many records of a campaign share them."""
    some = islice(variants(transducer), 1 if nominal else None)
    return tuple(_model(variant, shunt, drive, point) for variant, point in some for shunt in shunts)


def _model(transducer: Transducer, shunt: Shunt | None, drive: str, point: str) -> LinearModel:
    slope = hysteresis_slope(transducer, point)
    if drive == "voltage":
        imposed = {"slope": slope, "electrical": ("voltage",)}
        return connect(transducer, lambda ports, z, dz, w: [ports[0].v - w["voltage"]], **imposed)
    assert shunt is not None
    return assemble(transducer, shunt, slope=slope, base=drive == "base_acceleration")


def _responses(model: LinearModel, drive: str, omega: np.ndarray) -> dict[tuple[str, str], np.ndarray]:
    """Transfer functions (f,) by (response, input) of one variant."""
    if drive == "voltage":
        return _with_rates(_of(model, omega, ("displacement", "current"), ("force", "voltage")), omega)
    found = _of(model, omega, ("displacement", "voltage", "current"), (drive,))
    if drive != "displacement":
        return _with_rates(found, omega)
    # Whatever moves the structure: its displacement is known, and the other channels are proportional to it.
    moved = found.pop(("displacement", drive))
    rates = _rates(drive, np.ones(len(omega)), omega)
    return {("force", drive): 1 / moved, **{key: values / moved for key, values in found.items()}, **rates}


def _with_rates(found: dict[tuple[str, str], np.ndarray], omega: np.ndarray) -> dict[tuple[str, str], np.ndarray]:
    """Transfer functions, and those of velocity and acceleration that follow from them."""
    moved = [(cause, values) for (response, cause), values in found.items() if response == "displacement"]
    return found | {key: values for cause, motion in moved for key, values in _rates(cause, motion, omega).items()}


def _rates(cause: str, motion: np.ndarray, omega: np.ndarray) -> dict[tuple[str, str], np.ndarray]:
    """Velocity and acceleration (f,) of a displacement (f,), by (response, input)."""
    return {(rate, cause): (1j * omega) ** order * motion for rate, order in RATES.items()}


def _of(
    model: LinearModel, omega: np.ndarray, responses: tuple[str, ...], causes: tuple[str, ...]
) -> dict[tuple[str, str], np.ndarray]:
    transfer = model.phasors(omega)
    values = {response: transfer(model.rows[response]) for response in responses}
    return {(response, cause): values[response][..., n] for response in responses for n, cause in enumerate(causes)}


def impedances(transducer: Transducer, frequencies: np.ndarray, mechanical) -> np.ndarray:
    """Impedance of the leads, ohm, (variants, f)."""
    found = (TwoPort.of(t, frequencies, operating_point=point) for t, point in variants(transducer))
    return np.array([port.impedance(mechanical) for port in found])
