"""What holds for every shunt, whoever wrote it: run over all that are registered."""

import dataclasses

import numpy as np
import pint
import pytest
from examples import examples
from studies import BENCH, DRIVE, LOOP, SECOND, STOPS, distance

from piezoharvest.description import effects, shunts
from piezoharvest.description.excitation import SineForce
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import LinearShunt
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Mode, Transducer
from piezoharvest.engine import simulate
from piezoharvest.linear import check_stability, frequency_response

EXAMPLES = examples(shunts.registered())
UNITS = pint.get_application_registry()
BENCH = Transducer(**BENCH)
DRIVE = SineForce(amplitude=DRIVE["amplitude"], frequency=DRIVE["frequency"])
LEAKY = (
    effects.Leakage(resistance=4e5),
    effects.DielectricRelaxation(capacitance=15e-9, time_constant=5e-3),
)
DEVICES = {
    "bench": BENCH,
    "hysteresis": dataclasses.replace(BENCH, hysteresis=Hysteresis(**STOPS)),
    "all": dataclasses.replace(BENCH, hysteresis=Hysteresis(**STOPS), modes=(Mode(**SECOND),), effects=LEAKY),
}
VOLTAGE = 2.0  # what strain makes of open electrodes
each_shunt = pytest.mark.parametrize("shunt", EXAMPLES.values(), ids=list(EXAMPLES))
each_device = pytest.mark.parametrize("device", DEVICES)


def system_of(device, shunt):
    """The two together, unless they are unstable (what conducts at dc discharges a series negative capacitance)."""
    system = System(DEVICES[device], shunt)
    try:
        check_stability(system)
    except ParameterError:
        pytest.skip("unstable together")
    return system


@pytest.mark.parametrize("cls", shunts.registered().values(), ids=list(shunts.registered()))
def test_names_its_source_and_its_units(cls):
    assert cls.kind == cls.kind.lower().strip()
    assert len(cls.source) > 5
    assert cls.__doc__
    for field in dataclasses.fields(cls):
        if "unit" not in field.metadata:
            without = (
                "netlist", "topology", "port", "load", "subcircuit", "steps", "electrode", "others", "storage",
                "diode_curve", "switch_curve", "loop_sections", "load_curve",
            )  # fmt: skip
            assert field.name in without, f"{field.name} has no unit"
            continue
        UNITS.parse_units(field.metadata["unit"])
        assert field.metadata["doc"]


@each_device
@each_shunt
def test_energy_closes(shunt, device):
    found = simulate(system_of(device, shunt), DRIVE)
    assert found.converged, found.message
    assert abs(found.energy["closure"]) < 1e-10
    ledger = {name: value for name, value in found.energy.items() if name not in ("mechanical_in", "source", "closure")}
    supplied = found.energy["mechanical_in"] + found.energy.get("source", 0.0)
    assert sum(ledger.values()) == pytest.approx(supplied, rel=1e-9)
    # Nothing but a source delivers: all that is lost or harvested counts as positive.
    for name, value in ledger.items():
        assert value >= -1e-12 * supplied, name
    if shunt.kind not in ("digital", "adaptive_rl"):  # whose sources take what the part that they imitate would store
        assert found.energy.get("source", 0.0) >= 0.0
    assert found.harvested_power == pytest.approx(found.energy["harvested"] / found.period, rel=1e-12)
    assert found.mechanical_power == pytest.approx(found.energy["mechanical_in"] / found.period, rel=1e-12)


@each_shunt
def test_energy_of_a_run_from_rest_closes(shunt):
    found = simulate(system_of("all", shunt), DRIVE, transient=5.3 / DRIVE.frequency)
    assert found.converged, found.message
    assert abs(found.energy["closure"]) < 1e-10
    assert found.energy["harvested"] >= 0.0


@each_device
@each_shunt
def test_second_half_of_the_period_mirrors_the_first(shunt, device):
    if shunt.kind == "spice" and DEVICES[device].hysteresis:
        pytest.skip("which configurations of a netlist mirror each other is not known: operators keep a remanence")
    if not shunt.mirrors:
        pytest.skip("its half waves differ")
    found = simulate(system_of(device, shunt), DRIVE, samples=250)
    waves = found.waveforms
    assert found.converged, found.message
    assert len(waves.time) == 250
    for name in ("drive", "displacement", "velocity", "voltage", "current", "charge", "hysteresis_voltage"):
        signal = getattr(waves, name)
        # What is zero by nature (the voltage of a short) is zero to rounding.
        size = max(np.abs(signal).max(), 1e-4 * VOLTAGE if name.endswith("voltage") else 0.0)
        assert np.abs(signal[125:] + signal[:125]).max() <= 1e-7 * size, name
    assert distance(waves.dc_voltage[125:], waves.dc_voltage[:125]) < 1e-7
    half = 0.5 * found.period
    times, names = waves.event_times, waves.event_names
    early = [(n, t) for n, t in zip(names, times, strict=True) if t < half - 1e-9 * half]
    late = [(n, t - half) for n, t in zip(names, times, strict=True) if t >= half - 1e-9 * half]
    assert len(early) == len(late)
    for kind in set(names):
        first, second = (sorted(t for n, t in group if n == kind) for group in (early, late))
        assert np.allclose(first, second, rtol=0, atol=1e-7 * half), kind


def samples_of(shunt):
    """Samples a period: more where a current jumps, as a coil's that is cut and that which charges a winding."""
    cut = getattr(shunt, "efficiency", None) and hasattr(shunt, "on_time_error")
    return 200000 if cut or getattr(shunt, "self_resonance", None) else 20000


def is_switched(shunt):
    """True if something in a circuit opens and closes."""
    return hasattr(shunt, "on_time_error") or hasattr(shunt, "envelope_capacitance")


@each_shunt
def test_hysteresis_loses_the_area_of_its_loop(shunt):
    """By trapezoids, exact but where the loop has a corner between two samples (some 60 of them in a flip)."""
    # The current of an envelope capacitor jumps where its diode begins to conduct in the midst of a flip.
    samples = 200000 if hasattr(shunt, "envelope_capacitance") else samples_of(shunt)
    found = simulate(System(DEVICES["hysteresis"], shunt), DRIVE, samples=samples)
    q, v = found.waveforms.charge, found.waveforms.hysteresis_voltage
    area = 0.5 * np.dot(v + np.roll(v, -1), np.roll(q, -1) - q)
    if "voltage extracted" in found.waveforms.event_names:
        pytest.skip("the charge jumps: see the next test")
    corners = 1e-3 if is_switched(shunt) else 1e-5
    assert found.energy["hysteresis"] == pytest.approx(area, rel=corners, abs=1e-6 * found.energy["mechanical_in"])


@pytest.mark.parametrize("kind", ["ssds", "sece"])
def test_hysteresis_of_a_charge_that_jumps_from_end_to_end(kind):
    shunt = next(s for s in EXAMPLES.values() if s.kind == kind)
    found = simulate(System(DEVICES["hysteresis"], shunt), DRIVE)
    wanted = DEVICES["hysteresis"].hysteresis.loss_per_cycle(0.5 * np.ptp(found.waveforms.charge))
    assert found.energy["hysteresis"] == pytest.approx(wanted, rel=1e-9)


@each_shunt
def test_hysteresis_voltage_is_that_of_the_operators(shunt):
    """From rest, through samples that miss the turning points by little."""
    system, length = System(DEVICES["hysteresis"], shunt), 3 / DRIVE.frequency
    waves = simulate(system, DRIVE, transient=length, samples=samples_of(shunt)).waveforms
    assert distance(Hysteresis(**STOPS).voltage(waves.charge), waves.hysteresis_voltage) < 1e-3


@each_shunt
def test_hysteresis_without_weight_changes_nothing(shunt):
    plain = simulate(System(BENCH, shunt), DRIVE)
    null = dataclasses.replace(BENCH, hysteresis=Hysteresis(thresholds=(1e-8, 1e-7), weights=(0.0, 0.0)))
    found = simulate(System(null, shunt), DRIVE)
    assert found.displacement_amplitude == pytest.approx(plain.displacement_amplitude, rel=1e-9)
    assert found.harvested_power == pytest.approx(plain.harvested_power, rel=1e-9, abs=1e-18)
    assert found.energy["hysteresis"] == 0.0


@each_device
@pytest.mark.parametrize("name", [name for name, shunt in EXAMPLES.items() if isinstance(shunt, LinearShunt)])
def test_linear_shunt_matches_its_frequency_response(name, device):
    system = system_of(device, EXAMPLES[name])
    system = dataclasses.replace(system, transducer=dataclasses.replace(system.transducer, hysteresis=None))
    for frequency in (20.0, 50.6, 141.0):
        wanted = frequency_response(system, [frequency])
        found = simulate(system, SineForce(amplitude=0.02, frequency=frequency))
        assert found.displacement_amplitude == pytest.approx(0.02 * abs(wanted.displacement[0]), rel=1e-9)
        assert found.voltage_amplitude == pytest.approx(0.02 * abs(wanted.voltage[0]), rel=1e-9, abs=1e-12)
        power, rounding = 0.02**2 * wanted.harvested_power[0], 1e-12 * found.mechanical_power
        assert found.harvested_power == pytest.approx(power, rel=1e-9, abs=rounding)


@pytest.mark.parametrize("name", [name for name, shunt in EXAMPLES.items() if hasattr(shunt, "phase_lag")])
def test_switch_acts_twice_a_period_and_in_time(name):
    shunt = EXAMPLES[name]
    found = simulate(System(BENCH, shunt), DRIVE, samples=40000)
    waves = found.waveforms
    events = list(zip(waves.event_names, waves.event_times, strict=True))
    acts = [t for name, t in events if name in ("switch closes", "voltage extracted")]
    opens = [t for name, t in events if name == "switch opens"]
    assert len(acts) == 2
    on_time = shunt.switch(BENCH.capacitance, found.period).on_time
    # Of all stages together, or of an action that has stages of its own.
    shares = [1.0, *(shunt.stage(c, BENCH.capacitance) for c in shunt.configurations() if not shunt.mirrors)]
    for closed in acts:
        at = np.mod(closed - shunt.phase_lag / (2 * np.pi) * found.period, found.period)
        # The extremum is where the velocity changes sign; an early switch expects it half a period after the last.
        u = np.interp(at, waves.time, waves.velocity, period=found.period)
        if shunt.mirrors or shunt.phase_lag >= 0:  # else the half periods differ
            assert abs(u) < 2e-5 * np.abs(waves.velocity).max()
        if opens:
            lasted = [np.mod(o - closed, found.period) for o in opens]
            assert min(abs(time - share * on_time) for time in lasted for share in shares) < 1e-9 * found.period


def test_better_loops_harvest_more():
    loops = [{**LOOP, "quality": quality} for quality in (0.6, 2.0, 6.0)]
    powers = [simulate(System(BENCH, shunts.ParallelSSHI(dc_voltage=1.0, **p)), DRIVE).harvested_power for p in loops]
    assert powers == sorted(powers)
