"""Initial estimates of a transducer's parameters, from features of the records, before the fit.

The capacitance follows from an impedance below all resonances, or from the decay of the voltage after a step into a
known load; the ratio of coupling to capacitance from the voltage peak of the step; the stiffness from displacement
against force. Other parameters keep their nominal values. Sources: IEEE Std 176-1987, section 6 (static
coefficients); Preumont, Mechatronics, 2006, section 4.2 (the equations of a stack).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from piezoharvest.description.shunts.linear.resistor import Resistor
from piezoharvest.description.transducer import Transducer
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.hysteresis.charge_loops import decimated, is_plausible, loop_of, with_charge_loops
from piezoharvest.records.finding import runs

CONSTANT_RANGE = 0.02  # of a drive's range, within which it counts as constant
WINDOWS = 200  # per record, in which that is tested
MIN_CONSTANT_WINDOWS = 10  # least number of windows in which a drive is constant
MIN_DECAY_SAMPLES = 16  # samples of a decay
MAX_DECAY_MISFIT = 0.02  # of a decay's size: largest deviation from an exponential
MIN_LOAD_SPREAD = 0.1  # least relative difference between loads for an estimate of the leakage
DECAY_START_LEVEL = 0.8  # of the peak, above which operators that stick make the decay faster
DECAY_END_LEVEL = 0.3  # of the peak, to which a decay must fall for an estimate of its time constant
QUASI_STATIC_RATIO = 0.1  # of the first resonance: lower frequencies are quasi-static
MAX_FAST_POWER = 0.01  # largest share of a drive's power above that frequency


class DriveStep(NamedTuple):
    """A fast step of the drive, and the response while it is then constant.

    Attributes
    ----------
    resistance : float
        Of the load, ohm.
    decay_rate : float
        Of the voltage, 1/s.
    charge : float
        Charge through the load until the peak of the voltage, C.
    force, displacement, voltage : float
        Changes from before the step to the peak; N, m, V; NaN if the channel is not measured.
    """

    resistance: float
    decay_rate: float
    charge: float
    force: float
    displacement: float
    voltage: float


def estimate_initial_values(data: Sequence[Data | FrequencyData], nominal: Transducer) -> Transducer:
    """Transducer with initial estimates from the records; parameters without an estimate stay nominal.

    Parameters
    ----------
    data : sequence of Data or FrequencyData
    nominal : Transducer
        With more than one mode, it is returned unchanged: channels then mix the modes.
    """
    if nominal.modes:
        return nominal
    records = [each for each in data if isinstance(each, Data)]
    found = _with_stiffness(records, nominal)
    found = _with_steps([step for each in records for step in drive_steps(each)], found)
    found = _with_impedance([each for each in data if isinstance(each, FrequencyData)], found)
    return _with_stiffness(records, with_charge_loops(records, found))


def drive_steps(data: Data) -> Iterator[DriveStep]:
    """Steps in a record with a resistor, after which the voltage decays far enough for its time constant."""
    record, shunt, h = data.record, data.record.shunt, data.setting.sample_time
    if not isinstance(shunt, Resistor) or "voltage" not in data.channels:
        return
    drive, voltage, resistance = record[data.drive], record["voltage"], shunt.resistance
    for (_, before), (_, end) in pairwise(_constant_parts(drive)):
        peak = before + int(np.argmax(np.abs(voltage[before:end])))
        rate = _decay_rate(voltage[peak:end], h)
        if rate is None:
            continue
        charge = h * float(voltage[before : peak + 1].sum()) / resistance
        moves = {name: _change(record[name], before, peak) if name in record.signals else np.nan
                 for name in ("force", "displacement", "voltage")}  # fmt: skip
        yield DriveStep(resistance, rate, charge, **moves)


def _constant_parts(drive: np.ndarray) -> list[tuple[int, int]]:
    """First sample and end of the parts in which a drive is constant."""
    width, window = CONSTANT_RANGE * float(np.ptp(drive)), max(len(drive) // WINDOWS, 3)
    calm = maximum_filter1d(drive, window) - minimum_filter1d(drive, window) < width
    parts = [(first, last + 1) for first, last in runs(calm)]
    return [(a, b) for a, b in parts if b - a >= MIN_CONSTANT_WINDOWS * window and np.ptp(drive[a:b]) < 2 * width]


def _change(values: np.ndarray, before: int, peak: int) -> float:
    """Change of a channel since it was constant."""
    count = max((peak - before) // 2, 3)
    return float(np.mean(values[peak : peak + 3]) - np.mean(values[max(before - count, 0) : before]))


def _decay_rate(voltage: np.ndarray, sample_time: float) -> float | None:
    """Rate (1/s) of an exponential with an offset; None if the voltage is none, or does not fall far enough.

    The integral of v' = -rate (v - rest) over the samples needs no derivative: v(t) - v(0) = -rate int v + rate rest t.
    """
    late = np.flatnonzero(np.abs(voltage) < DECAY_START_LEVEL * np.abs(voltage[0]))
    if not len(late) or len(voltage) - late[0] < MIN_DECAY_SAMPLES:
        return None
    falling = voltage[late[0] :]
    integral = sample_time * np.concatenate([[0.0], np.cumsum(0.5 * (falling[1:] + falling[:-1]))])
    design = np.column_stack([integral, sample_time * np.arange(len(falling)), np.ones(len(falling))])
    solution, *_ = np.linalg.lstsq(design, falling)
    size = float(np.ptp(falling))
    off = float(np.std(falling - design @ solution))
    if off > MAX_DECAY_MISFIT * size or np.abs(falling[-1]) > DECAY_END_LEVEL * np.abs(falling[0]) or solution[0] >= 0:
        return None
    return -float(solution[0])


def _with_steps(steps: Sequence[DriveStep], found: Transducer) -> Transducer:
    """Coupling and capacitance from decays and peaks.

    At a constant force the electrodes have the capacitance C + T^2/k, whose decay rate is (1/R + G)/(C + T^2/k): its
    slope over several loads gives the capacitance for any leakage G. Before charge leaves, T x = -C v at the peak.
    """
    if not steps:
        return found
    free = free_capacitance(steps)

    def peak(step: DriveStep) -> float:
        # The charge that has left meanwhile is added; it has reversed the operators, which were deflected the other way
        # before.
        pairs = zip(found.hysteresis.thresholds, found.hysteresis.weights, strict=True) if found.hysteresis else ()
        turned = sum(w * min(abs(step.charge), 2.0 * r) for r, w in pairs)
        return step.voltage + step.charge / free + float(np.copysign(turned, step.charge))

    ratios = [-peak(step) / step.displacement for step in steps if abs(step.displacement) > 0]
    if ratios:
        ratio = float(np.median(ratios))  # T/C
        # C + ratio^2 C^2 / k = free
        share = ratio**2 * free / found.stiffness
        capacitance = 2.0 * free / (1.0 + np.sqrt(1.0 + 4.0 * share))
        return _with_plausible(found, capacitance=capacitance, coupling=ratio * capacitance)
    ratios = [-peak(step) / step.force for step in steps if abs(step.force) > 0]
    if not ratios:
        return _with_plausible(found, capacitance=free - found.coupling**2 / found.stiffness)
    # With x = (F + T v)/k: T/(C k + T^2).
    coupling = float(np.median(ratios)) * free * found.stiffness
    return _with_plausible(found, capacitance=free - coupling**2 / found.stiffness, coupling=coupling)


def free_capacitance(steps: Sequence[DriveStep]) -> float:
    """Capacitance at constant force, F, from the decay rates of steps into one or more loads."""
    conductance = np.array([1.0 / step.resistance for step in steps])
    rate = np.array([step.decay_rate for step in steps])
    if np.ptp(conductance) > MIN_LOAD_SPREAD * conductance.max():
        slope, offset = np.polyfit(conductance, rate, 1)
        if slope > 0 and offset > 0:
            return float(1.0 / slope)
    return float(np.median(conductance / rate))


def _with_impedance(data: Sequence[FrequencyData], found: Transducer) -> Transducer:
    """Capacitance from the slope of the susceptance over frequency, below the resonance."""
    for each in data:
        record = each.record
        low = record.frequency < QUASI_STATIC_RATIO * _resonance(found)
        if record.kind != "impedance" or not np.any(low):
            continue
        susceptance, omega = np.imag(1.0 / record.response[low]), 2 * np.pi * record.frequency[low]
        total = float(np.median(susceptance / omega))
        moving = found.coupling**2 / found.stiffness if record.mechanical == "free" else 0.0
        # The total is the clamped capacitance plus the contribution of the stiffness.
        found = _with_plausible(found, capacitance=total - moving)
    return found


def _resonance(found: Transducer) -> float:
    return float(np.sqrt(found.stiffness / found.mass) / (2 * np.pi))


def _with_stiffness(data: Sequence[Data], found: Transducer) -> Transducer:
    """Stiffness from displacement against force, k x = F + T v, in records with a slow force."""
    products = np.zeros(2)
    for each in data:
        if each.drive != "force" or "displacement" not in each.channels or not drive_is_slow(each, _resonance(found)):
            continue
        loop, force, x = loop_of(each, found), decimated(each.record["force"]), decimated(each.record["displacement"])
        if loop is not None:
            force = force + found.coupling / found.capacitance * (loop.charge - found.coupling * x)
        x, force = x - x.mean(), force - force.mean()
        products += x @ force, x @ x
    return _with_plausible(found, stiffness=products[0] / products[1]) if products[1] > 0 else found


def drive_is_slow(data: Data, resonance: float) -> bool:
    """True if hardly any of a drive's power is near the resonance."""
    drive = data.record[data.drive]
    power = np.abs(np.fft.rfft(drive - drive.mean())) ** 2
    lines = int(QUASI_STATIC_RATIO * resonance * data.setting.sample_time * len(drive))
    return bool(power[lines + 1 :].sum() <= MAX_FAST_POWER * power.sum())


def _with_plausible(found: Transducer, **values: float) -> Transducer:
    """Transducer with new values, except those that are not plausible."""
    kept = {k: float(v) for k, v in values.items() if is_plausible(v, getattr(found, k))}
    return replace(found, **kept)
