"""First values of a transducer's parameters, read off the records before anything is fitted.

The capacitance follows from an impedance below all resonances, or from the decay of the voltage after a step into a
known load; the ratio of coupling to capacitance from the voltage peak of the step; the stiffness from displacement
against force. What the records do not show keeps its nominal value. Sources: IEEE Std 176-1987, section 6 (static
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
from piezoharvest.identify.hysteresis.charge_loops import believable, loop_of, thinned, with_charge_loops
from piezoharvest.records.finding import runs

LEVEL = 0.02  # of a drive's range, within which it counts as held
WINDOWS = 200  # of a record, in which that is looked for
LONG = 10  # windows that a drive is held at least
SHORTEST = 16  # samples of a decay
CLOSE = 0.02  # of a decay's size, that it may be off an exponential
SPREAD = 0.1  # relative, between loads that tell a leakage
KNEE = 0.8  # of the peak, above which operators that still stick make the decay faster
FALLEN = 0.3  # of the peak, to which a decay has to go so that it tells its time constant
LOW = 0.1  # of the first resonance: what is slower is quasi-static
FASTER = 0.01  # share of a drive's power that may be above this


class DriveStep(NamedTuple):
    """A quick step of the drive, and what follows while it is held.

    Attributes
    ----------
    resistance : float
        Of the load, ohm.
    decay_rate : float
        1/s, of the voltage.
    charge : float
        What the load takes until the peak of the voltage, C.
    force, displacement, voltage : float
        How far these go from before the step to the peak; N, m, V; NaN where the channel is not measured.
    """

    resistance: float
    decay_rate: float
    charge: float
    force: float
    displacement: float
    voltage: float


def first_values(data: Sequence[Data | FrequencyData], nominal: Transducer) -> Transducer:
    """Transducer with the values that records show at sight; what they do not show stays nominal.

    Parameters
    ----------
    data : sequence of Data or FrequencyData
    nominal : Transducer
        Of more than one mode, nothing is read off: channels then mix the modes.
    """
    if nominal.modes:
        return nominal
    records = [each for each in data if isinstance(each, Data)]
    found = _with_stiffness(records, nominal)
    found = _with_steps([step for each in records for step in steps_of(each)], found)
    found = _with_impedance([each for each in data if isinstance(each, FrequencyData)], found)
    return _with_stiffness(records, with_charge_loops(records, found))


def steps_of(data: Data) -> Iterator[DriveStep]:
    """Steps in a record with a resistor, whose voltage decays far enough to tell its time constant."""
    record, shunt, h = data.record, data.record.shunt, data.setting.sample_time
    if not isinstance(shunt, Resistor) or "voltage" not in data.channels:
        return
    drive, voltage, resistance = record[data.drive], record["voltage"], shunt.resistance
    for (_, before), (_, end) in pairwise(_held(drive)):
        peak = before + int(np.argmax(np.abs(voltage[before:end])))
        rate = _decay_rate(voltage[peak:end], h)
        if rate is None:
            continue
        charge = h * float(voltage[before : peak + 1].sum()) / resistance
        moves = {name: _move(record[name], before, peak) if name in record.signals else np.nan
                 for name in ("force", "displacement", "voltage")}  # fmt: skip
        yield DriveStep(resistance, rate, charge, **moves)


def _held(drive: np.ndarray) -> list[tuple[int, int]]:
    """First sample and end of the parts in which a drive is held."""
    width, window = LEVEL * float(np.ptp(drive)), max(len(drive) // WINDOWS, 3)
    calm = maximum_filter1d(drive, window) - minimum_filter1d(drive, window) < width
    parts = [(first, last + 1) for first, last in runs(calm)]
    return [(a, b) for a, b in parts if b - a >= LONG * window and np.ptp(drive[a:b]) < 2 * width]


def _move(values: np.ndarray, before: int, peak: int) -> float:
    """How far a channel has gone since it was calm."""
    count = max((peak - before) // 2, 3)
    return float(np.mean(values[peak : peak + 3]) - np.mean(values[max(before - count, 0) : before]))


def _decay_rate(voltage: np.ndarray, sample_time: float) -> float | None:
    """Rate (1/s) of an exponential with an offset; None where the voltage is none, or does not fall far enough.

    The integral of v' = -rate (v - rest) over the samples needs no derivative: v(t) - v(0) = -rate int v + rate rest t.
    """
    late = np.flatnonzero(np.abs(voltage) < KNEE * np.abs(voltage[0]))
    if not len(late) or len(voltage) - late[0] < SHORTEST:
        return None
    falling = voltage[late[0] :]
    integral = sample_time * np.concatenate([[0.0], np.cumsum(0.5 * (falling[1:] + falling[:-1]))])
    design = np.column_stack([integral, sample_time * np.arange(len(falling)), np.ones(len(falling))])
    solution, *_ = np.linalg.lstsq(design, falling)
    size = float(np.ptp(falling))
    off = float(np.std(falling - design @ solution))
    if off > CLOSE * size or np.abs(falling[-1]) > FALLEN * np.abs(falling[0]) or solution[0] >= 0:
        return None
    return -float(solution[0])


def _with_steps(steps: Sequence[DriveStep], found: Transducer) -> Transducer:
    """Coupling and capacitance from decays and peaks.

    At a constant force the electrodes have the capacitance C + T^2/k, whose decay rate is (1/R + G)/(C + T^2/k): over
    several loads the slope tells it, whatever the leakage G is. Before charge leaves, T x = -C v at the peak.
    """
    if not steps:
        return found
    free = free_capacitance(steps)

    def peak(step: DriveStep) -> float:
        # What has left meanwhile counts as if it were still there; it has turned the operators, which were drawn the
        # other way before.
        pairs = zip(found.hysteresis.thresholds, found.hysteresis.weights, strict=True) if found.hysteresis else ()
        turned = sum(w * min(abs(step.charge), 2.0 * r) for r, w in pairs)
        return step.voltage + step.charge / free + float(np.copysign(turned, step.charge))

    ratios = [-peak(step) / step.displacement for step in steps if abs(step.displacement) > 0]
    if ratios:
        ratio = float(np.median(ratios))  # T/C
        # C + ratio^2 C^2 / k = free
        share = ratio**2 * free / found.stiffness
        capacitance = 2.0 * free / (1.0 + np.sqrt(1.0 + 4.0 * share))
        return _put(found, capacitance=capacitance, coupling=ratio * capacitance)
    ratios = [-peak(step) / step.force for step in steps if abs(step.force) > 0]
    if not ratios:
        return _put(found, capacitance=free - found.coupling**2 / found.stiffness)
    # With x = (F + T v)/k: T/(C k + T^2).
    coupling = float(np.median(ratios)) * free * found.stiffness
    return _put(found, capacitance=free - coupling**2 / found.stiffness, coupling=coupling)


def free_capacitance(steps: Sequence[DriveStep]) -> float:
    """Capacitance at constant force, F, from the decay rates of steps into one or more loads."""
    conductance = np.array([1.0 / step.resistance for step in steps])
    rate = np.array([step.decay_rate for step in steps])
    if np.ptp(conductance) > SPREAD * conductance.max():
        slope, offset = np.polyfit(conductance, rate, 1)
        if slope > 0 and offset > 0:
            return float(1.0 / slope)
    return float(np.median(conductance / rate))


def _with_impedance(data: Sequence[FrequencyData], found: Transducer) -> Transducer:
    """Capacitance from the slope of the susceptance over frequency, below the resonance."""
    for each in data:
        record = each.record
        low = record.frequency < LOW * _resonance(found)
        if record.kind != "impedance" or not np.any(low):
            continue
        susceptance, omega = np.imag(1.0 / record.response[low]), 2 * np.pi * record.frequency[low]
        total = float(np.median(susceptance / omega))
        moving = found.coupling**2 / found.stiffness if record.mechanical == "free" else 0.0
        # Beside the capacitance that clamped electrodes have there is what the spring adds.
        found = _put(found, capacitance=total - moving)
    return found


def _resonance(found: Transducer) -> float:
    return float(np.sqrt(found.stiffness / found.mass) / (2 * np.pi))


def _with_stiffness(data: Sequence[Data], found: Transducer) -> Transducer:
    """Stiffness from displacement against force, k x = F + T v, where the force changes slowly."""
    products = np.zeros(2)
    for each in data:
        if each.drive != "force" or "displacement" not in each.channels or not slow(each, _resonance(found)):
            continue
        loop, force, x = loop_of(each, found), thinned(each.record["force"]), thinned(each.record["displacement"])
        if loop is not None:
            force = force + found.coupling / found.capacitance * (loop.charge - found.coupling * x)
        x, force = x - x.mean(), force - force.mean()
        products += x @ force, x @ x
    return _put(found, stiffness=products[0] / products[1]) if products[1] > 0 else found


def slow(data: Data, resonance: float) -> bool:
    """Whether hardly any of a drive's power is near the resonance."""
    drive = data.record[data.drive]
    power = np.abs(np.fft.rfft(drive - drive.mean())) ** 2
    lines = int(LOW * resonance * data.setting.sample_time * len(drive))
    return bool(power[lines + 1 :].sum() <= FASTER * power.sum())


def _put(found: Transducer, **values: float) -> Transducer:
    """Transducer with other values, of which those that nobody would believe are left out."""
    kept = {k: float(v) for k, v in values.items() if believable(v, getattr(found, k))}
    return replace(found, **kept)
