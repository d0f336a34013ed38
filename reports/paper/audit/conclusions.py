"""What the paper concludes, against its numbers and its model."""

from __future__ import annotations

import numpy as np

from piezoharvest import Open, Short, System, simulate
from reports.paper.audit.finding import Finding, finding, span
from reports.paper.model import table_circuit, table_value, transducer
from reports.paper.rows import RECORD, Bench, simulated, sine, sine_force
from reports.paper.tables import Row, experiment, rows


def damping_cannot_be_identified() -> Finding:
    """Damping from data at 1 to 5 Hz."""
    b, k, m = (table_value(name) for name in "bkm")
    fastest, rate = max(experiment()["frequencies_Hz"]), experiment()["sample_rate_Hz"]
    phase = 2 * np.pi * fastest * b / k
    resolution = experiment()["displacement_resolution_m"] * k / (0.5 * (1000.0 - experiment()["offset_N"]))
    resonance = float(np.sqrt(k / m)) / (2 * np.pi)
    return finding(
        "damping-not-identifiable",
        phase < 0.1 * resolution and resonance > 10 * rate,
        phase_rad=phase,
        resolution=resolution,
        resolution_over_phase=resolution / phase,
        resonance_kHz=resonance / 1e3,
        over_drive=resonance / fastest,
        over_band=resonance / (0.5 * rate),
    )


def cost_function_mixes_units() -> Finding:
    """Equation (16) adds A^2 and m^2."""
    current = max(float(np.sqrt(row.peak.value / row.ohm)) for row in rows("I"))
    stroke = max(row.force for row in rows("I")) / table_value("k")
    weight = (stroke / current) ** 2
    return finding(
        "cost-function-mixes-units", weight < 0.01, current_uA=1e6 * current, stroke_um=1e6 * stroke, weight=weight
    )


def _ends(table: str) -> list[tuple[Row, Row]]:
    """Rows at 1 and at 5 Hz of each force."""
    return list(zip(*([row for row in rows(table) if row.hertz == f] for f in (1.0, 5.0)), strict=True))


def loop_depends_on_rate() -> Finding:
    """The displacement-voltage loop from 1 to 5 Hz."""
    voltage = span(np.sqrt(high.peak.value / low.peak.value) for low, high in _ends("II"))
    stroke = span(high.peak.value / high.hertz / (low.peak.value / low.hertz) - 1 for low, high in _ends("IV"))
    tau = table_circuit().capacitance * experiment()["loads_ohm"][1]
    leads = span(90 - np.degrees(np.arctan(2 * np.pi * f * tau)) for f in (1.0, 5.0))
    return finding(
        "loop-depends-on-rate", voltage[0] > 1.2, voltage_ratio=voltage, stroke_change=stroke, lead_degrees=leads
    )


def sign_and_equation_numbers() -> Finding:
    """Sign of v_p i_p when harvesting, and which equation the energies are from."""
    response = sine(Bench(transducer("stop")), 1000.0, 5.0, experiment()["loads_ohm"][1])
    waves = response.waveforms
    assert waves is not None
    # i_p flows into the positive lead, the load current out of it.
    power = float(np.mean(-waves.voltage * waves.current))
    return finding(
        "sign-and-equation-numbers", power < 0, mean_uW=1e6 * power, harvested_uW=1e6 * response.harvested_power
    )


def efficiency_of_the_tables() -> Finding:
    """The ratio of the tables' energies is no efficiency."""
    steps = span(a.energy.value / b.energy.value for a, b in zip(rows("I"), rows("III"), strict=True))
    sines = span(a.energy.value / b.energy.value for a, b in zip(rows("II"), rows("IV"), strict=True))
    bench, load = Bench(transducer("stop")), experiment()["loads_ohm"][1]
    cycles = [simulated(bench, row, load).cycle for row in rows("IV") if row.force == 1000.0]
    net = span(sine(bench, 1000.0, f, load).efficiency for f in experiment()["frequencies_Hz"])
    return finding(
        "efficiency-of-the-tables",
        sines[1] < 0.1 and net[0] > 0.3,
        steps=steps,
        sines=sines,
        model_net=net,
        model_gross=span(cycle.electrical / cycle.mechanical_gross for cycle in cycles),
    )


def load_is_not_tuned_to_a_resonance() -> Finding:
    """The best resistor, and whether shunting reduces the motion."""
    device, loads = transducer("none"), experiment()["loads_ohm"]
    best = span(1 / (2 * np.pi * f * table_circuit().capacitance) for f in (1.0, 5.0))
    drive = sine_force(1000.0, 5.0)
    short, unloaded = (simulate(System(device, shunt), drive).displacement_amplitude for shunt in (Short(), Open()))
    change = 1 - unloaded / short
    return finding(
        "load-is-not-tuned-to-a-resonance",
        best[0] < min(loads) and change < 0.1,
        best_load_kohm=[1e-3 * value for value in best],
        displacement_change=change,
        load_over_best=span(load / best[0] for load in loads),
    )


def power_for_small_electronics() -> Finding:
    """What Table II does say about usable power."""
    best = max(rows("II"), key=lambda row: row.energy.value)
    literal, half, record = best.energy.value * best.hertz, 0.5 * best.peak.value, best.energy.value / RECORD
    return finding(
        "power-for-small-electronics",
        abs(record / half - 1) < 0.2 and literal > 5 * half,
        row=best.label,
        half_peak_mW=1e3 * half,
        record_mW=1e3 * record,
        literal_mW=1e3 * literal,
    )
