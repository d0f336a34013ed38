"""Start values of the state in which a record behind a circuit begins, from its first samples."""

from __future__ import annotations

import numpy as np

from piezoharvest.description.shunts import Shunt
from piezoharvest.description.transducer import Transducer
from piezoharvest.identify.fitting.jumps import jumps_of
from piezoharvest.identify.noise.noise_model import initial_noise
from piezoharvest.predict.discrete_model import Setting
from piezoharvest.records.record import Record

SAMPLES = 5  # first samples, through which a parabola gives value and slope
# Standard deviations of the noise within which so many first samples are those of a rest: one in 1000 rests is missed.
REST_DEVIATIONS, REST_SAMPLES = 4.0, 3
PERIODS = 1.5  # of the structure: in this time the voltage reaches what the diodes allow


def loop_closed_at_first(record: Record, shunt: Shunt, transducer: Transducer) -> int:
    """Number of first samples in which the loop of the switch may still be closed after an action at the beginning.

    It is 0 where the voltage does not jump there. Else the record begins within an inversion, or with one: what the
    loop has then, no state that a record begins with tells, but after it a fit has all from the states alone. A record
    of which this were half or more, as of a loop slower than the record, keeps all of its samples.
    """
    switch = shunt.switch(transducer.capacitance, None)
    if switch is None or switch.clocked or "voltage" not in record.signals:
        return 0
    closed = int(np.ceil(float(switch.on_time) * record.sample_rate))
    period = 2.0 * np.pi * np.sqrt(transducer.mass / transducer.stiffness)
    jumps = np.flatnonzero(jumps_of(record, "voltage", period)[: closed + 1])
    first = int(jumps[0]) + closed + 1 if len(jumps) else 0
    return first if 2 * first < len(record) else 0


def circuit_start(
    record: Record, setting: Setting, shunt: Shunt, transducer: Transducer, first: int = 0
) -> dict[str, float]:
    """Start values by name, in units of `setting.sizes`; what no channel shows begins at rest.

    The charge is that at the sample `first`, before which the loop of a switch may be closed.

    So does all where nothing differs from rest by more than noise: a velocity out of noise alone may have the wrong
    sign, which lets the switch act once more at the very beginning, and no small step leads back from there.
    """
    x, u = (None, None) if record.drive == "displacement" else _motion(record)
    rest = setting.first * _gain(transducer, record.drive) / transducer.stiffness
    if _is_at_rest(record, rest):
        return {}
    found = {"x1": None if x is None else x - rest, "u1": u}
    if "voltage" in record.signals:
        voltage = float(record["voltage"][first])
        there = float(record["displacement"][first]) if first and "displacement" in record.signals else x
        moved = 0.0 if there is None else transducer.coupling * (there - rest)
        found["q"] = transducer.capacitance * voltage + moved
        found |= shunt.guessed_states(voltage, float(_parabola(record, "voltage").deriv()(0.0)))
    found["dc"] = _dc(record, shunt, transducer)
    return {
        f"start {name}": value / size
        for name, size in zip(setting.free, setting.sizes, strict=True)
        if (value := found.get(name)) is not None
    }


def _is_at_rest(record: Record, rest: float) -> bool:
    """True if the first samples show a structure, electrodes and a dc side that rest, as far as noise lets them."""
    resting = {"displacement": rest, "velocity": 0.0, "voltage": 0.0, "dc_voltage": 0.0, "dc_current": 0.0}
    shown = {name: signal for name, signal in record.signals.items() if name in resting and name != record.drive}
    if not {"displacement", "velocity"} & set(shown):
        return False
    for name, signal in shown.items():
        noise = initial_noise(signal.values) if signal.sigma is None else signal.sigma
        if np.max(np.abs(signal.values[:REST_SAMPLES] - resting[name])) > REST_DEVIATIONS * noise:
            return False
    return True


def _gain(transducer: Transducer, drive: str) -> float:
    """Force of the first mode for a unit of the drive."""
    return 1.0 if drive == "force" else -transducer.all_modes[0].base_mass


def _motion(record: Record) -> tuple[float | None, float | None]:
    """Displacement and velocity at the first sample, None where no channel shows them."""
    x = u = None
    if "displacement" in record.signals:
        fit = _parabola(record, "displacement")
        x, u = float(fit(0.0)), float(fit.deriv()(0.0))
    if "velocity" in record.signals:
        u = float(record["velocity"][0])
    return x, u


def _parabola(record: Record, channel: str) -> np.polynomial.Polynomial:
    """Parabola over time (s) through the first samples of a channel."""
    count, step = min(SAMPLES, len(record)), 1.0 / record.sample_rate
    return np.polynomial.Polynomial.fit(np.arange(count) * step, record[channel][:count], min(2, count - 1))


def _dc(record: Record, shunt: Shunt, transducer: Transducer) -> float | None:
    """Voltage of the smoothing capacitor: as measured, or what the electrodes reach at first."""
    if "dc_voltage" in record.signals:
        return float(record["dc_voltage"][0])
    load = getattr(shunt, "load_resistance", None)
    if "dc_current" in record.signals and load is not None:
        return float(record["dc_current"][0]) * load
    if "voltage" not in record.signals:
        return None
    period = 2.0 * np.pi * np.sqrt(transducer.mass / transducer.stiffness)
    first = record["voltage"][: max(int(PERIODS * period * record.sample_rate), SAMPLES)]
    return max(float(np.max(np.abs(first))) - 2.0 * getattr(shunt, "diode_drop", 0.0), 0.0)
