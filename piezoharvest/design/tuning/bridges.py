"""Closed-loop power of rectifying interfaces by their equivalent impedance, as a start for tuning their load.

Source: Liang & Liao, IEEE/ASME Trans. Mechatronics 17(6), 1145-1157, 2012. The bridge, with the clamped capacitance,
is an impedance Z that the strain current I sees; P = |V_eq|^2 R_h / (2 |Z_m + Z|^2). V_eq and Z_m are what the
two-port without its capacitance, so that further modes and effects are included.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from piezoharvest.description.shunts.bridge import Bridge
from piezoharvest.description.shunts.harvesting.series_sshi import SeriesSSHI
from piezoharvest.description.shunts.linear.open import Open
from piezoharvest.description.shunts.self_powered.series_sshi import SelfPoweredSeriesSSHI
from piezoharvest.design.drafts import Draft
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.tuning.starts import Start
from piezoharvest.linear import TwoPort

_LOADS = np.geomspace(1e-4, 1e4, 801)  # R C w, before the local maxima are refined
_DROP_STEPS = 40


class TheveninSource(NamedTuple):
    """Thevenin source that drives the capacitance at each frequency: V = (Z_m + Z) I.

    Attributes
    ----------
    omega : (f,) array
        rad/s.
    voltage : (f,) array
        |V_eq| at the operation's amplitude, V.
    impedance : (f,) complex array
        Z_m, ohm.
    Weights by which powers add up.
        With which powers add up.
    """

    omega: np.ndarray
    voltage: np.ndarray
    impedance: np.ndarray
    weights: np.ndarray


def bridge_starts(view: LinearView, draft: Draft) -> list[Start]:
    """Every local optimum of the load, by the closed-loop formula; best first."""
    bridge = draft.shunt
    assert isinstance(bridge, Bridge)
    capacitance = view.capacitance
    source, scale = strain_source(view), 1 / (2 * np.pi * view.operation.centre(view.transducer) * capacitance)

    def merit(log_load) -> np.ndarray:
        """Merit of each load, to be minimised."""
        load = scale * np.exp(np.atleast_1d(log_load))[:, None]
        power, current = powers(bridge, load, source, capacitance)
        if view.goal.damping:
            return np.log(np.max(current / source.omega, axis=1))
        return -np.log(np.maximum(power @ source.weights, 1e-300))

    logs = np.log(_LOADS)
    values = merit(logs)
    padded = np.concatenate(([np.inf], values, [np.inf]))
    found = []
    for n in np.flatnonzero((values <= padded[:-2]) & (values < padded[2:])):
        bounds = (logs[max(n - 1, 0)], logs[min(n + 1, len(logs) - 1)])
        best: Any = minimize_scalar(
            lambda x: float(merit(x)[0]), bounds=bounds, method="bounded", options={"xatol": 1e-6}
        )
        found.append((best.fun, scale * float(np.exp(best.x))))
    name = "equivalent impedance (Liang & Liao 2012)"
    return [_start(name, draft, bridge, load, source, capacitance) for _, load in sorted(found)[:3]]


def _start(name: str, draft: Draft, bridge: Bridge, load: float, source: TheveninSource, capacitance: float) -> Start:
    """Start at a load, or at the dc voltage that this load would have at the mean power."""
    if "load_resistance" in draft.free:
        return Start(name, {"load_resistance": load})
    power, _ = powers(bridge, np.full((1, 1), load), source, capacitance)
    mean = float(power[0] @ source.weights / np.sum(source.weights))
    return Start(name, {"dc_voltage": float(np.sqrt(max(mean * load, 1e-12)))})


def powers(
    bridge: Bridge, load: np.ndarray, source: TheveninSource, capacitance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Harvested power (W) and strain current (A) for loads (r, 1) at the source's frequencies, (r, f) arrays.

    Notes
    -----
    With x = R C w the balance of dc power, V_dc^2/R = R_h |I|^2/2, gives the rectified over the open-circuit voltage:
    V' = (2 x + pi V_F')/(pi + (1 + gamma) x), for series SSHI (2 g x + pi V_F')/(pi + 2 g x). The diode drop relative
    to V_oc = |I|/(w C) depends on the current, and is found with it by fixed-point steps.
    """
    reactance = 1 / (source.omega * capacitance)
    # A doubler is a bridge at half the voltage and twice the current.
    x = load / bridge.gain**2 / reactance
    current = source.voltage / np.abs(source.impedance + 1 / (1 / load + 1j / reactance))
    for _ in range(_DROP_STEPS if bridge.diode_drop > 0 else 1):
        drop = bridge.path_drop / (current * reactance)
        impedance, share = _impedance(bridge, x, drop, capacitance)
        current = np.sqrt(current * source.voltage / np.abs(source.impedance + impedance * reactance))
    # The last step is not averaged: without a diode drop it is exact.
    current = source.voltage / np.abs(source.impedance + impedance * reactance)
    return 0.5 * current**2 * share * reactance, current


def _impedance(bridge: Bridge, x: np.ndarray, drop: np.ndarray, capacitance: float) -> tuple[np.ndarray, np.ndarray]:
    """Equivalent impedance and its harvested part, both times C w."""
    if isinstance(bridge, SeriesSSHI | SelfPoweredSeriesSSHI):
        inversion = bridge.inversion(capacitance)
        g = (1 + inversion) / (1 - inversion)
        ratio = np.minimum((2 * g * x + np.pi * drop) / (np.pi + 2 * g * x), 1.0)
        harvested = 4 / np.pi * g * np.maximum(ratio - drop, 0) * (1 - ratio)
        return 4 / np.pi * g * (1 - ratio) - 1j, harvested
    gamma = -bridge.inversion(capacitance)
    ratio = np.minimum((2 * x + np.pi * drop) / (np.pi + (1 + gamma) * x), 2 / (1 + gamma))
    cosine = 1 - (1 + gamma) * ratio
    theta = np.arccos(np.clip(cosine, -1, 1))
    real = (1 - cosine) * (4 / (1 + gamma) - 1 + cosine)
    imaginary = np.sin(theta) * cosine - theta
    harvested = 2 / np.pi * np.maximum(ratio - drop, 0) * (2 - ratio * (1 + gamma))
    return (real + 1j * imaginary) / np.pi, harvested


def strain_source(view: LinearView) -> TheveninSource:
    """Thevenin source of the strain current at the operation's lines, the clamped capacitance taken out."""
    op, frequencies = view.operation, view.operation.frequencies
    omega = 2 * np.pi * frequencies
    leads = TwoPort.of(view.transducer, frequencies, amplitude=view.amplitude).impedance()
    opened = np.abs(view.response(Open(), frequencies).voltage)
    with np.errstate(all="ignore"):
        share = 1 / (1 - 1j * omega * view.capacitance * leads)
    amplitude = np.full(len(frequencies), op.amplitude) if op.apart else np.sqrt(op.squares)
    weights = np.full(len(frequencies), 1.0) if not op.apart else op.squares / amplitude**2
    return TheveninSource(omega, opened * np.abs(share) * amplitude, leads * share, weights)
