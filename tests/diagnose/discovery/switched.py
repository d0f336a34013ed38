"""Campaigns of specimens with a law behind switches, made with SciPy alone: events end each stretch of a record."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from nameless import BEAM, Drive, Laws
from scipy.integrate import solve_ivp

from piezoharvest.records import load_campaign

RATE, DURATION = 4000.0, 0.25  # Hz, s
DRIVES = (Drive((0.05,), (49.5,)), Drive((0.04,), (51.0,)), Drive((0.045,), (50.2,)))  # the last one for validation
NOISE = {"displacement": 3e-7, "voltage": 0.02, "dc_voltage": 0.01}
UNITS = {"force": "N", "displacement": "m", "voltage": "V"}
COIL = {"inductance": 0.5, "quality": 8.0}
DC = {"smoothing_capacitance": 1e-6, "load_resistance": 3e5, "diode_drop": 0.4}
LABELS = {
    "open": {},
    "resistor": {"resistance": 1e5},
    "ssdi": COIL,
    "sece": {},
    "series_sshi": {**COIL, **DC},
    "rectifier": DC,
}  # of circuits, by kind


@dataclass
class Circuit:
    """A circuit's state: which way its bridge conducts (0: not at all), and when its switch opens (inf: it is open).

    Attributes
    ----------
    closed_at : float
        Time at which the switch last closed, s.
    """

    kind: str
    label: dict
    capacitance: float
    side: int = 0
    opens: float = np.inf
    until: int = 1  # direction of motion that ends with the next extremum

    def value(self, name):
        return self.label.get(name, 0.0)

    @property
    def closed(self):
        return np.isfinite(self.opens)

    @property
    def resistance(self):
        """Of the switched loop, ohm."""
        return np.sqrt(self.label["inductance"] / self.capacitance) / self.label["quality"]

    @property
    def on_time(self):
        """Half a damped period, s."""
        coil = self.label["inductance"]
        return np.pi / np.sqrt(1.0 / (coil * self.capacitance) - (self.resistance / (2.0 * coil)) ** 2)

    def gap(self, v, dc):
        """Voltage by which the bridge blocks, V."""
        return dc + 2.0 * self.value("diode_drop") - abs(v)


def slopes(t, y, specimen, laws, drive, circuit):
    """Rates of motion, voltage, dc side, coil and what is in line: m x'' + b x' + k x = F + T v, C v' + T x' = -i.

    The last state is the current of the inductance in line, or the voltage of the capacitance there.
    """
    m, b, k, T, C = (specimen[name] for name in ("mass", "damping", "stiffness", "coupling", "capacitance"))
    x, u, v, dc, i, w = y
    lag, behind = in_line(laws, i, w)
    force = drive(t) - b * u - k * x - laws.spring(x) - laws.damper(u) + T * v
    flow, own, kind = -T * u - laws.electrodes(v), C + laws.capacitance(v), circuit.kind
    drain = load_current(circuit, laws, dc)
    store = circuit.value("smoothing_capacitance") or 1.0
    if kind == "rectifier" and circuit.side and laws.diode is not None:
        through = laws.diode(circuit.side * v - dc - 2.0 * circuit.value("diode_drop"))
        return [u, force / m, (flow - circuit.side * through) / own, (through - drain) / store, 0.0, 0.0]
    if kind == "rectifier" and circuit.side:
        rise = (circuit.side * flow - drain) / (own + store)
        return [u, force / m, circuit.side * rise, rise, 0.0, 0.0]
    if kind == "resistor":
        flow -= v / circuit.label["resistance"]
    across, charging = 0.0, 0.0
    if kind == "ssdi" and circuit.closed:
        across = v - circuit.resistance * i - laws.loop(i) - behind
    if kind == "series_sshi" and circuit.side:
        across = v - circuit.resistance * i - circuit.side * (dc + 2.0 * circuit.value("diode_drop"))
        charging = circuit.side * i
    bend = across / circuit.label["inductance"] if across else 0.0
    return [u, force / m, (flow - i) / own, (charging - drain) / store, bend, lag]


def load_current(circuit, laws, dc):
    """Current that leaves a smoothing capacitor, A."""
    return dc / circuit.label["load_resistance"] + laws.dc_load(dc) if "load_resistance" in circuit.label else 0.0


def in_line(laws, i, w):
    """Rate of the state of what is in line with a coil, and the voltage across it; i is the coil's current."""
    if not laws.line:
        return 0.0, 0.0
    resistance, beside = laws.line
    if laws.of_line == "inductance":
        across = resistance * (i - w)
        return across / beside, across
    return (i - w / resistance) / beside, w


def events_of(circuit):
    """Functions of time and state whose sign change ends a stretch, in this order: extremum, bridge."""
    bridged = circuit.kind == "rectifier" or (circuit.kind == "series_sshi" and circuit.closed)

    def extremum(t, y, *others):
        return circuit.until * y[1]

    def bridge(t, y, *others):
        if not bridged:
            return 1.0
        if circuit.side == 0:
            return circuit.gap(y[2], y[3])
        if circuit.kind == "series_sshi":
            return circuit.side * y[4] + (1e-12 if t < circuit.begun + 1e-9 else 0.0)
        if others[1].diode is not None:
            return -circuit.gap(y[2], y[3])
        rise = slopes(t, y, *others)[3]
        return circuit.label["smoothing_capacitance"] * rise + load_current(circuit, others[1], y[3])

    for event in (extremum, bridge):
        event.terminal, event.direction = True, -1.0
    return extremum, bridge


def acted(circuit, t, y):
    """State after the switch has acted on an extremum."""
    circuit.until = -circuit.until
    if circuit.kind == "sece":
        y[2] = 0.0
    if circuit.kind in ("ssdi", "series_sshi"):
        circuit.opens, circuit.begun = t + circuit.on_time, t
        if circuit.kind == "series_sshi" and circuit.gap(y[2], y[3]) < 0.0:
            circuit.side = int(np.sign(y[2]))
    return y


def bridged(circuit, t, y):
    """State after the bridge has changed over."""
    circuit.begun, way = t, int(np.sign(y[2]))
    if not circuit.side:
        circuit.side = way
        return y
    y[4] = 0.0
    # A coil has swung the voltage beyond the dc side: it conducts the other way at once.
    circuit.side = way if circuit.kind == "series_sshi" and circuit.gap(y[2], y[3]) < 0.0 else 0
    return y


def opened(circuit, y):
    """State after the switch has opened: what current is left is cut."""
    circuit.opens, circuit.side, y[4] = np.inf, 0, 0.0
    return y


def switched(kind, laws: Laws, drive: Drive, specimen=BEAM, label=None, rate=RATE):
    """True channels of a record from rest behind a circuit of a kind."""
    circuit = Circuit(kind, LABELS[kind] if label is None else label, specimen["capacitance"])
    times = np.arange(round(DURATION * rate)) / rate
    found, t, y = [], 0.0, np.zeros(6)
    while True:
        end = min(times[-1], circuit.opens)
        left = times[(times >= t) & (times <= end if end == times[-1] else times < end)]
        at = np.append(left, end) if not len(left) or left[-1] < end else left
        given = (specimen, laws, drive, circuit)
        run = solve_ivp(
            slopes, (t, end), y, "DOP853", at, args=given, events=events_of(circuit), rtol=1e-9, atol=1e-12,
            max_step=1.0 / rate,
        )  # fmt: skip
        if len(run.y):
            found.append(run.y[:, : len(left)])
        if run.status == 0 and end == times[-1]:
            break
        if run.status == 0:
            t, y = end, opened(circuit, run.y[:, -1].copy())
            continue
        which = int(np.argmax([e[-1] if len(e) else -1.0 for e in run.t_events]))
        t, y = run.t_events[which][-1], run.y_events[which][-1].copy()
        y = (acted if which == 0 else bridged)(circuit, t, y)
    x, _, v, dc, *_ = np.concatenate(found, axis=1)
    return {"time_s": times, "force": drive(times), "displacement": x, "voltage": v, "dc_voltage": dc}


def switched_campaign(
    folder, laws: Laws, kinds, *, seed=0, off=0.03, drives=DRIVES, rate=RATE, labels=LABELS, units=UNITS
):  # fmt: skip
    """Campaign of `drives`, each record behind one of `kinds`; nominal values are off."""
    rng, folder = np.random.default_rng(seed), Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    nominal = {name: value * (1.0 + off * rng.uniform(-1, 1)) for name, value in BEAM.items()}
    text = ["[transducer]", "quasi_static = false", *(f"{name} = {value!r}" for name, value in nominal.items())]
    for n, (drive, kind) in enumerate(zip(drives, kinds, strict=True)):
        label = labels[kind].items()
        true = switched(kind, laws, drive, label=labels[kind], rate=rate)
        read = {name: true[name] + laws.reading[name](true) if name in laws.reading else true[name] for name in true}
        noisy = [read[name] + NOISE.get(name, 0.0) * rng.standard_normal(len(read["time_s"])) for name in units]
        header = ",".join(["time_s", *(f"{name}_{unit}" for name, unit in units.items())])
        table = np.column_stack([read["time_s"], *noisy])
        np.savetxt(folder / f"r{n}.csv", table, delimiter=",", header=header, comments="", fmt="%.12g")
        text += ["[[records]]", f'file = "r{n}.csv"', f'role = "{"validate" if n == len(drives) - 1 else "fit"}"']
        text += ["[records.shunt]", f'kind = "{kind}"', *(f"{name} = {value!r}" for name, value in label)]
    (folder / "campaign.toml").write_text("\n".join(text) + "\n")
    return load_campaign(folder / "campaign.toml")
