"""A figure for the page of each effect: a record of the virtual bench with and without it, and what differs."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from made_from_code.figures import BENCH
from piezoharvest.bench import measure
from piezoharvest.bench.effects import registered
from piezoharvest.report.figures import style
from piezoharvest.report.units import engineering
from piezoharvest.study import study_from

_SINE = {"kind": "sine_force", "amplitude": 0.02, "frequency": 49.0}
_SLOW = {"kind": "sine_force", "amplitude": 0.2, "frequency": 5.0}
_STEP = {"kind": "step_force", "amplitude": 0.1, "duration": 0.3, "rise_time": 0.02}
_RESISTOR = {"kind": "resistor", "resistance": 1e6}
_OPEN = {"kind": "open"}
_SSHI = {
    "kind": "parallel_sshi", "inductance": 0.1, "quality": 5.0, "smoothing_capacitance": 1e-6, "load_resistance": 2e5,
    "diode_drop": 0.2,
}  # fmt: skip
_SSDI = {"kind": "ssdi", "inductance": 0.1, "quality": 5.0}
# Values that show, the circuit and the drive, and the channel in which it shows.
_SHOWN: Mapping[str, tuple[Mapping[str, Any], Mapping[str, Any], Mapping[str, Any], str]] = {
    "leakage": ({"resistance": 1e6}, _OPEN, _STEP, "voltage"),
    "dielectric_relaxation": ({"capacitance": 1e-8, "time_constant": 0.05}, _OPEN, _STEP, "voltage"),
    "voltage_dependent_capacitance": ({"beta": 3e-2}, _RESISTOR, _SLOW, "voltage"),
    "creep": ({"compliance_ratio": 0.1, "time_constant": 0.1}, _RESISTOR, _STEP, "displacement"),
    "stiffening": ({"cubic_stiffness": 1e10}, _RESISTOR, _SLOW, "displacement"),
    "contact_compliance": ({"coefficient": 1e-4}, _RESISTOR, _SLOW, "displacement"),
    "friction": ({"stiffness": 300.0, "threshold": 5e-5}, _RESISTOR, _SLOW, "displacement"),
    "nonlinear_coupling": ({"quadratic_coupling": 1.0}, _RESISTOR, _SLOW, "voltage"),
    "coupling_drift": ({"relative_drift": 0.4}, _RESISTOR, _SLOW, "voltage"),
    "bias_current": ({"current": 3e-7}, _RESISTOR, _SLOW, "voltage"),
    "displacement_lag": ({"time_constant": 1e-3}, _RESISTOR, _SINE, "displacement"),
    "channel_skew": ({"delay": 1e-3}, _RESISTOR, _SINE, "voltage"),
    "clipping": ({"limit": 2.5, "channel": "voltage"}, _RESISTOR, _SLOW, "voltage"),
    "mains_hum": ({"amplitude": 0.3, "frequency": 50.0, "channel": "voltage"}, _RESISTOR, _SLOW, "voltage"),
    "load_error": ({"relative_error": 0.2}, _RESISTOR, _SLOW, "current"),
    "switch_delay": ({"time_lag": 1e-3}, _SSHI, _SINE, "voltage"),
    "inversion_loss": ({"quality": 2.0}, _SSHI, _SINE, "voltage"),
    "voltage_reversion": ({"share": 0.2, "time_constant": 1e-3}, _SSDI, _SINE, "voltage"),
    "diode_drop_error": ({"diode_drop": 0.8}, _SSHI, _SINE, "voltage"),
    "on_time_offset": ({"on_time_error": 0.4}, _SSHI, _SINE, "voltage"),
    "missed_switching": ({"threshold": 2.0}, _SSDI, _SINE, "voltage"),
    "reverse_leakage": ({"conductance": 2e-6}, _SSHI, _SINE, "voltage"),
    "probe_loading": ({"resistance": 2e5, "capacitance": 1e-8, "place": "leads"}, _RESISTOR, _SINE, "voltage"),
}
_QUIET = {
    "load_cell": {"noise": 0}, "laser": {"noise": 0, "resolution": 0, "sensitivity": 1e4},
    "buffer": {"noise": 0, "gain": 0.1},
    "current_sense": {"noise": 0}, "converter": {"bits": 32},
}  # fmt: skip
_UNITS = {"voltage": ("V", 1.0), "displacement": ("µm", 1e6), "current": ("µA", 1e6)}
_COLUMNS = {"voltage": "voltage_V", "displacement": "displacement_m", "current": "current_A"}


def figures() -> Iterator[tuple[str, str, bytes]]:
    """Name, caption and picture (PNG) of each effect of the virtual bench."""
    plain: dict[tuple[int, int], dict[str, np.ndarray]] = {}  # without an effect, by circuit and drive: few are in use
    for name in registered():
        if name in _SHOWN:
            values, shunt, drive, channel = _SHOWN[name]
            if (id(shunt), id(drive)) not in plain:
                plain[id(shunt), id(drive)] = _record(shunt, drive, {})
            with_it, without = _record(shunt, drive, {name: values}), plain[id(shunt), id(drive)]
            stream = io.BytesIO()
            style.write_png(_drawn(with_it, without, channel), stream)
            yield name, _caption(name, values, shunt, drive), stream.getvalue()


def _record(shunt: Mapping[str, Any], drive: Mapping[str, Any], effects: Mapping[str, Any]) -> dict[str, np.ndarray]:
    bench = {"duration": 0.5 if drive is not _SINE else 0.2, "sample_rate": 5000.0, "effects": effects, **_QUIET}
    tables = {"transducer": BENCH, "excitation": drive, "shunts": [shunt], "bench": bench}
    return dict(measure(study_from(tables, Path("study.toml"))).records[0].columns)


@style.styled
def _drawn(with_it: Mapping[str, np.ndarray], without: Mapping[str, np.ndarray], channel: str):
    figure, (upper, lower) = style.grid_of_axes(2, height=3.6, sharex=True)
    (unit, scale), column = _UNITS[channel], _COLUMNS[channel]
    time, plain, changed = with_it["time_s"], scale * without[column], scale * with_it[column]
    handles = upper.plot(time, plain, color=style.MUTED, linestyle="--", label="without the effect")
    handles += upper.plot(time, changed, color=style.PALETTE[1], label="with the effect")
    lower.plot(time, changed - plain, color=style.PALETTE[0])
    upper.set(ylabel=f"{channel} in {unit}")
    lower.set(xlabel="time in s", ylabel=f"difference in {unit}", xlim=(0.0, time[-1]))
    style.legend_above(figure, handles)
    return figure


def _caption(name: str, values: Mapping[str, Any], shunt: Mapping[str, Any], drive: Mapping[str, Any]) -> str:
    fields = registered()[name].__dataclass_fields__
    texts = {
        key: value if isinstance(value, str) else engineering(value, fields[key].metadata["unit"])
        for key, value in values.items()
    }
    said = ", ".join(f"{key.replace('_', ' ')} {text}" for key, text in texts.items())
    kind = "a step of the force" if drive is _STEP else f"a sine of {drive['frequency']:g} Hz"
    place = f"A record without noise on the virtual bench, from rest, under {kind}, with the shunt `{shunt['kind']}`"
    return f"{place}: {said}."
