"""What holds for every effect, whoever wrote it: run over all that are registered."""

import dataclasses
import itertools
import math
from pathlib import Path

import numpy as np
import pint
import pytest
from examples import GIVEN, plain_examples, typical
from selection import with_slow
from studies import BENCH, DRIVE, LOOP, SECOND, STOPS, distance, objects, phasor
from studies import bench as bench_study

from piezoharvest.bench import effects as bench_effects
from piezoharvest.bench.solver import CIRCUITS, Model, integrate
from piezoharvest.cli import main
from piezoharvest.description import effects, shunts
from piezoharvest.description.excitation import SineForce
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.parameters import AS_LABELLED, ParameterError
from piezoharvest.description.shunts.switching import EmptyingSwitch, SwitchedCoil
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.engine import simulate, simulate_many
from piezoharvest.engine.lowering.lower import lower
from piezoharvest.engine.sensitivity.gradient import NoGradientError, gradient
from piezoharvest.linear import TwoPort, check_stability, frequency_response
from piezoharvest.predict.parameters import put
from piezoharvest.study import build, build_excitation, build_shunt, build_transducer

UNITS = pint.get_application_registry()
PLAIN = Transducer(**BENCH)
HYSTERETIC = dataclasses.replace(PLAIN, hysteresis=Hysteresis(**STOPS))
DRIVE_TABLE, DRIVE = DRIVE, SineForce(amplitude=DRIVE["amplitude"], frequency=DRIVE["frequency"])
SHUNTS = {
    "open": shunts.Open(),
    "resistor": shunts.Resistor(resistance=8e4),
    "rectifier": shunts.Rectifier(smoothing_capacitance=1e-6, load_resistance=1e5, diode_drop=0.1),
    "parallel_sshi": shunts.ParallelSSHI(dc_voltage=2.0, phase_lag=0.1, **LOOP),
    "sece": shunts.SECE(),
}
REGISTERED = effects.registered()
# Sensors feel these, the specimen does not.
UNFELT = {"channel_skew", "clipping", "contact_compliance", "displacement_lag", "mains_hum"}
# These bend with the amplitude and give back what they take, or go on through a record.
BENDING, DRIFTING = {"voltage_dependent_capacitance", "stiffening", "nonlinear_coupling"}, {"coupling_drift"}
SMOOTH = BENDING | DRIFTING
# These change a circuit that has a switch, a loop or diodes, and no other.
OF_THE_CIRCUIT = {
    "switch_delay", "inversion_loss", "diode_drop_error", "on_time_offset", "missed_switching", "reverse_leakage",
}  # fmt: skip
# These give power, or change the load.
SOURCES, OF_THE_LOAD, SLIPPING = {"bias_current"}, {"load_error"}, {"friction"}
EXAMPLES = {name: plain_examples(cls, GIVEN.get(name, {}))[0] for name, cls in REGISTERED.items()}
FELT = [name for name in REGISTERED if name not in UNFELT | DRIFTING]
PASSIVE = [name for name in FELT if name not in SOURCES | OF_THE_LOAD | OF_THE_CIRCUIT | SMOOTH]
each_effect = pytest.mark.parametrize("name", REGISTERED)
each_felt = pytest.mark.parametrize("name", FELT)
each_of_the_circuit = pytest.mark.parametrize("name", sorted(OF_THE_CIRCUIT))
each_passive = pytest.mark.parametrize("name", PASSIVE)
each_unfelt = pytest.mark.parametrize("name", sorted(UNFELT))
each_smooth = pytest.mark.parametrize("name", sorted(SMOOTH))
each_bending = pytest.mark.parametrize("name", sorted(BENDING))
each_shunt = pytest.mark.parametrize("shunt", SHUNTS)


def run(shunt, *present, device=HYSTERETIC):
    found = simulate(System(dataclasses.replace(device, effects=present), SHUNTS[shunt]), DRIVE)
    assert found.converged, found.message
    return found


def near_null(name, shunt):
    """As near the null as the bounds allow, behind this circuit."""
    cls, changes = REGISTERED[name], {}
    for field in dataclasses.fields(cls):
        null = field.metadata.get("null")
        if null == AS_LABELLED:
            label = getattr(SHUNTS[shunt], field.name, None)  # none, too, of a coil that a circuit may have
            changes[field.name] = typical(cls, field) if label is None else label
        elif null is not None:
            near = typical(cls, field)
            changes[field.name] = 1e18 * near if math.isinf(null) else null + 1e-18 * near
    return dataclasses.replace(EXAMPLES[name], **changes)


def settles(name, shunt):
    """A constant current into open electrodes charges them for ever."""
    return name not in SOURCES or shunt != "open"


def test_all_of_the_vocabulary_are_there():
    assert len(REGISTERED) >= 15
    passive = {"leakage", "creep", "dielectric_relaxation", "voltage_reversion", "probe_loading"} | SLIPPING
    assert set(REGISTERED) >= UNFELT | SMOOTH | SOURCES | OF_THE_LOAD | OF_THE_CIRCUIT | passive


@each_effect
def test_names_its_source_its_units_and_its_null(name):
    cls = REGISTERED[name]
    assert len(cls.source) > 5
    assert cls.looks and cls.told_by
    assert cls.__doc__
    assert any(field.metadata.get("null") is not None for field in dataclasses.fields(cls))
    for field in dataclasses.fields(cls):
        if "unit" in field.metadata:
            UNITS.parse_units(field.metadata["unit"])
            assert field.metadata["doc"]


@each_shunt
@each_felt
def test_absent_at_its_null_value(name, shunt):
    found, wanted = run(shunt, near_null(name, shunt)), run(shunt)
    assert found.displacement_amplitude == pytest.approx(wanted.displacement_amplitude, rel=1e-9)
    assert found.harvested_power == pytest.approx(wanted.harvested_power, rel=1e-9, abs=1e-18)
    assert found.energy[name] == pytest.approx(0.0, abs=1e-12 * wanted.energy["mechanical_in"])
    assert distance(found.waveforms.voltage, wanted.waveforms.voltage) < 1e-7


@each_effect
def test_absent_at_exactly_its_null_value(name):
    """Behind a circuit with a switch, a loop and diodes: to the last bit."""
    cls, null, shunt = REGISTERED[name], {}, "parallel_sshi"
    for field in dataclasses.fields(cls):
        value = field.metadata.get("null")
        if value == AS_LABELLED:
            value = getattr(SHUNTS[shunt], field.name)
        if value is not None and math.isfinite(value) and field.metadata.get("above") != value:
            null[field.name] = value
    if len(null) < sum(field.metadata.get("null") is not None for field in dataclasses.fields(cls)):
        pytest.skip("the bounds leave the null out")
    found, wanted = run(shunt, dataclasses.replace(EXAMPLES[name], **null)), run(shunt)
    assert found.displacement_amplitude == wanted.displacement_amplitude
    assert found.harvested_power == wanted.harvested_power
    assert found.energy[name] == 0.0
    assert found.message == wanted.message


@each_shunt
@each_passive
def test_changes_something_and_never_gives_energy(name, shunt):
    found, without = run(shunt, EXAMPLES[name]), run(shunt)
    assert abs(found.displacement_amplitude / without.displacement_amplitude - 1) > 1e-6
    assert abs(found.energy["closure"]) < 1e-10
    assert found.energy[name] >= 0.0


@each_shunt
@each_of_the_circuit
def test_changes_a_circuit_that_has_such_a_part_and_no_other(name, shunt):
    """From rest: a threshold is met by small voltages only."""
    present = (EXAMPLES[name],)
    found, without = (
        simulate(System(dataclasses.replace(HYSTERETIC, effects=some), SHUNTS[shunt]), DRIVE, transient=0.06)
        for some in (present, ())
    )
    if REGISTERED[name].acts_on(SHUNTS[shunt]):
        same = distance(found.waveforms.voltage, without.waveforms.voltage), found.harvested_power
        assert same[0] > 1e-3 or abs(same[1] / without.harvested_power - 1) > 1e-3
        assert found.message == ""
    else:
        assert np.array_equal(found.waveforms.voltage, without.waveforms.voltage)
        assert found.message == f"{name}: {shunt} has no part that it changes"
    assert abs(found.energy["closure"]) < 1e-12
    assert found.energy[name] == 0.0  # it is the circuit that loses


@each_passive
def test_never_gives_energy_in_a_transient(name):
    """What it holds at the end is stored, and what it has lost is lost."""
    for shunt in SHUNTS.values():
        system = System(dataclasses.replace(HYSTERETIC, effects=(EXAMPLES[name],)), shunt)
        for length in (0.003, 0.017, 0.05):
            found = simulate(system, DRIVE, transient=length)
            assert found.energy["closure"] < 1e-12
            assert found.energy[name] >= -1e-15 * found.energy["mechanical_in"]


@each_shunt
@pytest.mark.parametrize("name", sorted(SOURCES))
def test_a_source_is_in_the_ledger(name, shunt):
    strong = dataclasses.replace(EXAMPLES[name], current=2e-6)
    found = simulate(System(dataclasses.replace(HYSTERETIC, effects=(strong,)), SHUNTS[shunt]), DRIVE)
    assert found.converged == settles(name, shunt)
    assert found.energy["closure"] < 1e-12
    assert abs(found.energy[name]) > 1e-8 * found.energy["mechanical_in"]
    assert found.energy[name] < 0


def test_bias_current_runs_through_the_load():
    """Its mean voltage is R I, its power R I^2, whatever else moves."""
    current, resistance = 2e-6, SHUNTS["resistor"].resistance
    found = run("resistor", effects.BiasCurrent(current=current), device=PLAIN)
    without = run("resistor", device=PLAIN)
    assert np.mean(found.waveforms.voltage) == pytest.approx(resistance * current, rel=1e-9)
    assert found.energy["bias_current"] / found.period == pytest.approx(-resistance * current**2, rel=1e-9)
    assert found.harvested_power - without.harvested_power == pytest.approx(resistance * current**2, rel=1e-6)


def test_load_error_is_another_load():
    resistance = SHUNTS["resistor"].resistance
    wrong = simulate(System(HYSTERETIC, shunts.Resistor(resistance=1.1 * resistance)), DRIVE)
    without = run("resistor")
    for label, wanted in ((None, wrong), (resistance, wrong), (2.0 * resistance, without)):
        found = run("resistor", effects.LoadError(relative_error=0.1, resistance=label))
        assert found.displacement_amplitude == pytest.approx(wanted.displacement_amplitude, rel=1e-12)
        assert found.harvested_power == pytest.approx(wanted.harvested_power, rel=1e-12)


@each_shunt
def test_order_changes_nothing(shunt):
    present = [EXAMPLES[name] for name in FELT if settles(name, shunt) and name not in SMOOTH]
    orders = itertools.islice(itertools.permutations(present), 0, 5000, 1250)
    first, *others = [run(shunt, *order) for order in orders]
    for other in others:
        assert other.harvested_power == pytest.approx(first.harvested_power, rel=1e-10, abs=1e-18)
        assert other.displacement_amplitude == pytest.approx(first.displacement_amplitude, rel=1e-10)
        assert other.voltage_amplitude == pytest.approx(first.voltage_amplitude, rel=1e-9)
        assert other.energy["closure"] < 1e-12
        for name, value in first.energy.items():
            if name == "closure":
                continue
            assert other.energy[name] == pytest.approx(value, rel=1e-8, abs=1e-9 * first.energy["mechanical_in"]), name


@each_unfelt
def test_what_sensors_feel_leaves_the_specimen_alone(name):
    found, without = run("parallel_sshi", EXAMPLES[name]), run("parallel_sshi")
    assert found.displacement_amplitude == without.displacement_amplitude
    assert np.array_equal(found.waveforms.voltage, without.waveforms.voltage)
    assert found.message == f"{name}: not part of a simulation, only of measured records"


# --- What bends with the amplitude, or goes on through a record ------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "shunt"),
    with_slow(
        itertools.product(sorted(BENDING), SHUNTS),
        # These take several times as long as all others together.
        slow=lambda name, shunt: name != "stiffening" and shunt not in ("resistor", "sece"),
    ),
)
def test_what_bends_gives_back_what_it_takes(name, shunt):
    found, without = run(shunt, EXAMPLES[name]), run(shunt)
    assert abs(found.displacement_amplitude / without.displacement_amplitude - 1) > 1e-6
    assert found.energy["closure"] < 1e-11
    assert abs(found.energy[name]) < 1e-9 * found.energy["mechanical_in"]


@pytest.mark.parametrize("shunt", ["rectifier", pytest.param("parallel_sshi", marks=pytest.mark.slow)])
@each_bending
def test_steady_state_is_where_a_long_transient_ends(name, shunt):
    damped = dataclasses.replace(HYSTERETIC, damping=1.0, effects=(EXAMPLES[name],))
    system = System(damped, dataclasses.replace(SHUNTS[shunt]))
    found, period = simulate(system, DRIVE, samples=64), 1 / DRIVE.frequency
    long = simulate(system, DRIVE, transient=80 * period, samples=64)
    assert found.converged, found.message
    for signal in ("displacement", "voltage"):
        last = getattr(long.waveforms, signal)[-65:-1]
        assert distance(getattr(found.waveforms, signal), last) < 1e-6


def test_what_drifts_has_no_steady_state():
    """It goes on through a record; a steady state is that of its beginning, and says so."""
    found, without = run("rectifier", EXAMPLES["coupling_drift"]), run("rectifier")
    assert found.harvested_power == without.harvested_power
    assert found.message == "coupling_drift: not part of a simulation, only of measured records"
    system = System(dataclasses.replace(HYSTERETIC, effects=(EXAMPLES["coupling_drift"],)), SHUNTS["rectifier"])
    drifted, still = (simulate(s, DRIVE, transient=0.5) for s in (system, System(HYSTERETIC, SHUNTS["rectifier"])))
    assert drifted.message == ""
    assert drifted.energy["closure"] < 1e-12
    assert abs(drifted.harvested_power / still.harvested_power - 1) > 1e-3


@each_bending
def test_what_bends_has_no_gradient(name):
    system = System(dataclasses.replace(HYSTERETIC, effects=(EXAMPLES[name],)), SHUNTS["resistor"])
    with pytest.raises(NoGradientError, match="nonlinear between events"):
        gradient(system, DRIVE)


@pytest.mark.parametrize("force", [lambda s: s.power(s.x, 2.5), lambda s: 1e-6 * s.time], ids=["root", "time"])
def test_what_no_simulation_follows_is_refused(force, monkeypatch):
    monkeypatch.setattr(effects.Stiffening, "act", lambda self, specimen: specimen.push(force(specimen)))
    system = System(dataclasses.replace(PLAIN, effects=(effects.Stiffening(cubic_stiffness=1e6),)), SHUNTS["resistor"])
    with pytest.raises(ParameterError, match=r"transducer\.effects\.stiffening: found .*, allowed are sums, products"):
        simulate(system, DRIVE, transient=0.1)


# --- The linear view ------------------------------------------------------------------------------------------------

LINEAR = [name for name in PASSIVE if name not in SLIPPING] + sorted(OF_THE_LOAD)


@pytest.mark.parametrize("name", LINEAR)
@pytest.mark.parametrize("shunt", ["open", "resistor"])
def test_agrees_with_the_linear_view(name, shunt):
    system = System(dataclasses.replace(PLAIN, effects=(EXAMPLES[name],)), SHUNTS[shunt])
    response = frequency_response(system, [DRIVE.frequency])
    found, period = simulate(system, DRIVE), 1 / DRIVE.frequency
    for signal in ("displacement", "voltage", "current"):
        wanted = DRIVE.amplitude * getattr(response, signal)[0]
        floor = 1e-9 * DRIVE.amplitude * abs(response.charge[0]) * 2 * np.pi * DRIVE.frequency
        seen = phasor(found.waveforms, getattr(found.waveforms, signal), period)
        assert seen == pytest.approx(wanted, rel=1e-9, abs=floor)
    power = DRIVE.amplitude**2 * response.harvested_power[0]
    assert found.harvested_power == pytest.approx(power, rel=1e-9, abs=1e-20)
    check_stability(system)


@pytest.mark.parametrize("point", ["stick", "slip"])
def test_friction_in_the_linear_view_is_a_spring_that_may_slip(point):
    held = EXAMPLES["friction"]
    stiffer = PLAIN.stiffness + (held.stiffness if point == "stick" else 0.0)
    frequencies = np.geomspace(1.0, 200.0, 20)
    found = TwoPort.of(dataclasses.replace(PLAIN, effects=(held,)), frequencies, operating_point=point)
    wanted = TwoPort.of(dataclasses.replace(PLAIN, stiffness=stiffer), frequencies)
    assert distance(found.z, wanted.z) < 1e-12


@each_effect
def test_two_port_stays_reciprocal_and_passive(name):
    """A relaxation, a leak or creep takes energy at every frequency; what is nonlinear or of sensors has no part."""
    two_port = TwoPort.of(dataclasses.replace(PLAIN, effects=(EXAMPLES[name],)), np.geomspace(0.1, 1e4, 50))
    assert two_port.is_reciprocal()
    assert two_port.is_passive()
    if name in UNFELT | SMOOTH | SOURCES:
        assert np.array_equal(two_port.z, TwoPort.of(PLAIN, two_port.frequencies).z)


@pytest.mark.parametrize("name", ["creep", "dielectric_relaxation"])
def test_of_its_own_physics(name):
    """Creep makes the spring softer, a relaxation the capacitance larger, by the transfer function of one pole."""
    frequencies = np.geomspace(0.1, 1e4, 50)
    s = 2j * np.pi * frequencies
    effect = EXAMPLES[name]
    found = TwoPort.of(dataclasses.replace(PLAIN, effects=(effect,)), frequencies)
    k, b, m, c = (getattr(PLAIN, key) for key in ("stiffness", "damping", "mass", "capacitance"))
    if name == "creep":
        # F = k (x - y), x = F/k (1 + c/(1 + s tau)).
        k = k / (1 + effect.compliance_ratio / (1 + s * effect.time_constant))
    else:
        c = c + effect.capacitance / (1 + s * effect.time_constant)
    assert distance(found.h[:, 0, 0], m * s + b + k / s) < 1e-10
    assert distance(found.h[:, 1, 1], s * c) < 1e-10


# --- Independent solver ---------------------------------------------------------------------------------------------

ORACLE = {
    "leakage": {"resistance": 8e4},
    "dielectric_relaxation": {"capacitance": 20e-9, "time_constant": 2e-3},
    "creep": {"compliance_ratio": 0.05, "time_constant": 5e-3},
    "bias_current": {"current": 1e-6},
    "friction": {"stiffness": 50.0, "threshold": 2e-5},
    "load_error": {"relative_error": 0.1},
    "voltage_dependent_capacitance": {"beta": 3e-3},
    "stiffening": {"cubic_stiffness": 2e9},
    "nonlinear_coupling": {"quadratic_coupling": 0.5},
    "coupling_drift": {"relative_drift": 0.2},
}
CASES = [*([name] for name in ORACLE), list(ORACLE)]
LOADS = [
    {"kind": "resistor", "resistance": 8e4},
    {"kind": "open"},
    {"kind": "rectifier", "smoothing_capacitance": 1e-6, "load_resistance": 1e5, "diode_drop": 0.1},
]
LENGTH = 0.12
PRELOADED = {**DRIVE_TABLE, "offset": 0.03}
STEP = {"kind": "step_force", "amplitude": 0.05, "duration": 0.03, "rise_time": 1e-3}


def solved_by_the_bench(names, load, excitation, times):
    """The same specimen in the virtual bench, whose solver and effects share nothing with the engine's."""
    present = [build(bench_effects.registered()[name], ORACLE[name], name) for name in names]
    shunt = build_shunt(load)
    for effect in present:
        shunt = effect.connect(shunt)
    model = Model(build_transducer({**BENCH, "hysteresis": STOPS}), CIRCUITS[shunt.kind](shunt), base=False)
    for effect in present:
        effect.act(model, LENGTH)
    return integrate(model, excitation, times)


def of_pairs():
    """Every effect with every load and with either drive, every load with either drive; all effects at once in all."""
    drives = {"preloaded sine": PRELOADED, "step": STEP}
    for (n, names), (m, load), (k, drive) in itertools.product(enumerate(CASES), enumerate(LOADS), enumerate(drives)):
        if len(names) > 1 or (n + m + k) % 2 == 0:
            label = names[0] if len(names) == 1 else "all at once"
            marks = pytest.mark.slow if len(names) == 1 and load["kind"] == "open" else ()
            yield pytest.param(names, load, drives[drive], id=f"{label}-{load['kind']}-{drive}", marks=marks)


@pytest.mark.parametrize(("names", "load", "table"), list(of_pairs()))
def test_agrees_with_the_virtual_bench(names, load, table):
    """From rest under the preload, with hysteresis, through conduction and slip."""
    study = bench_study(load, table, hysteresis=STOPS, effects={name: ORACLE[name] for name in names})
    found = simulate(*objects(study), transient=LENGTH, samples=200)  # the bench's own error is 1e-10 at this step
    waves = found.waveforms
    wanted = solved_by_the_bench(names, load, build_excitation(table, Path()), waves.time)
    assert found.energy["closure"] < 1e-12
    # Of what bends the engine promises 1e-8; the slope of a cubic is known to one order less than the cubic.
    precision, of_slopes = (1e-9, 1e-9) if SMOOTH.isdisjoint(names) else (1e-8, 3e-8)
    assert distance(waves.displacement, wanted.displacement) < precision
    assert distance(waves.voltage, wanted.voltage) < precision
    assert np.abs(waves.current - wanted.current).max() < of_slopes * max(np.abs(wanted.current).max(), 1e-9)


BRIDGE = {"smoothing_capacitance": 1e-7, "load_resistance": 1e6, "diode_drop": 0.1}
COIL = {"inductance": 0.1, "quality": 5.0}
# Of each effect of a circuit one that it acts on, with values that show.
BEHIND = {
    "switch_delay": ({"time_lag": 4e-4}, {"kind": "ssdv", **COIL, "source_voltage": 1.0}),
    "inversion_loss": ({"quality": 3.0}, {"kind": "ssdi", **COIL}),
    "voltage_reversion": ({"share": 0.2, "time_constant": 1e-3}, {"kind": "ssdi", **COIL}),
    "diode_drop_error": ({"diode_drop": 0.4}, {"kind": "series_sshi", **BRIDGE, **COIL}),
    "on_time_offset": ({"on_time_error": 0.3}, {"kind": "parallel_sshi", **BRIDGE, **COIL}),
    "missed_switching": ({"threshold": 1.5}, {"kind": "sece"}),
    "reverse_leakage": ({"conductance": 1e-6}, {"kind": "rectifier", **BRIDGE}),
    "probe_loading": (
        {"resistance": 1e6, "capacitance": 3e-8, "place": "dc"}, {"kind": "parallel_sshi", **BRIDGE, **COIL}
    ),
}  # fmt: skip


def behind(names, load, length=0.06):
    """Waveforms of the engine and of the bench from rest, and those of the engine without the effects."""
    tables = {name: BEHIND[name][0] for name in names}
    system, excitation = objects(bench_study(load, DRIVE_TABLE, hysteresis=STOPS, effects=tables))
    found = simulate(system, excitation, transient=length, samples=200)
    plain = simulate(System(HYSTERETIC, system.shunt), excitation, transient=length, samples=200)
    present, shunt = [build(bench_effects.registered()[name], tables[name], name) for name in names], build_shunt(load)
    for effect in present:
        shunt = effect.connect(shunt)
    model = Model(build_transducer({**BENCH, "hysteresis": STOPS}), CIRCUITS[shunt.kind](shunt), base=False)
    for effect in present:
        effect.act(model, length)
    return found, integrate(model, excitation, found.waveforms.time), plain.waveforms


def check_behind(found, wanted, plain):
    assert found.energy["closure"] < 1e-12
    waves = found.waveforms
    # The bench takes a flip in some ten steps, each of them to 1e-7 of the state's size; measured: up to 4e-9.
    assert distance(waves.displacement, wanted.displacement) < 1e-8
    assert distance(waves.voltage, wanted.voltage) < 2e-8
    assert distance(waves.current, wanted.current) < 2e-8
    if np.any(waves.dc_voltage):
        assert distance(waves.dc_voltage, wanted.dc_voltage) < 1e-8
    changed = max(distance(waves.voltage, plain.voltage), distance(waves.dc_voltage, plain.dc_voltage))
    assert changed > 1e-2


@pytest.mark.parametrize("name", BEHIND)
def test_an_effect_of_a_circuit_agrees_with_the_virtual_bench(name):
    check_behind(*behind([name], BEHIND[name][1]))


@pytest.mark.parametrize("kind", ["parallel_sshi", "series_sshi"])
def test_all_effects_of_circuits_at_once_agree_with_the_virtual_bench(kind):
    check_behind(*behind(list(BEHIND), {"kind": kind, **BRIDGE, **COIL}))


def test_all_effects_of_circuits_are_compared():
    assert set(BEHIND) == OF_THE_CIRCUIT | {"voltage_reversion", "probe_loading"}


# Diodes before a coil instead of in a bridge, coils that a circuit may have.
ELSEWHERE = {
    "diode_drop_error": {
        "dssh": {"kind": "dssh", **COIL, "intermediate_capacitance": 1e-7},
        "sice": {"kind": "sice", **COIL},
        "sc_sece": {"kind": "sc_sece", **COIL, "short_time": 1e-3},
    },
    "inversion_loss": {"sece": {"kind": "sece", **COIL}, "ssds": {"kind": "ssds", **COIL}},
    "on_time_offset": {
        "ssds": {"kind": "ssds", **COIL},
        "sshc": {"kind": "sshc", "flip_capacitances": [4e-8, 6e-8], "switch_resistance": 300.0, "dc_voltage": 2.0},
    },
}


@pytest.mark.parametrize(("name", "kind"), [(name, kind) for name, kinds in ELSEWHERE.items() for kind in kinds])
def test_an_effect_acts_in_every_circuit_that_has_its_part(name, kind):
    load = ELSEWHERE[name][kind]
    values = {**BEHIND[name][0], **({"on_time_error": -0.3} if kind == "sshc" else {})}
    system, excitation = objects(bench_study(load, DRIVE_TABLE, effects={name: values}))
    found = simulate(system, excitation, transient=0.06, samples=200)
    circuit = bench_effects.registered()[name](**values).connect(build_shunt(load))
    model = Model(build_transducer(BENCH), CIRCUITS[kind](circuit), base=False)
    wanted = integrate(model, excitation, found.waveforms.time)
    plain = simulate(System(PLAIN, system.shunt), excitation, transient=0.06, samples=200)
    assert distance(found.waveforms.voltage, wanted.voltage) < 2e-8
    assert distance(found.waveforms.voltage, plain.waveforms.voltage) > 1e-3
    assert "has no part" not in found.message


KEYS = {
    "switch_delay": "time_lag", "inversion_loss": "quality", "diode_drop_error": "diode_drop",
    "on_time_offset": "on_time_error", "missed_switching": "detector_threshold", "reverse_leakage": "diode_leakage",
}  # fmt: skip


@pytest.mark.parametrize("kind", shunts.registered())
def test_an_effect_acts_where_the_label_has_its_key(kind):
    shunt = plain_examples(shunts.registered()[kind], GIVEN.get(kind, {}))[0]
    at_once = getattr(shunt, "at_once", False)  # no coil, so that neither its quality nor its time is any
    for name, key in KEYS.items():
        has = getattr(shunt, key, None) is not None and not (at_once and name in ("inversion_loss", "on_time_offset"))
        if name == "inversion_loss":
            has = has and isinstance(shunt, SwitchedCoil | EmptyingSwitch)  # other qualities are not of a switched loop
        assert REGISTERED[name].acts_on(shunt) == has, (name, kind)


@pytest.mark.parametrize(
    ("effect", "label"),
    [
        (effects.SwitchDelay(time_lag=2e-4), {"time_lag": 2e-4}),
        (effects.InversionLoss(quality=3.0), {"quality": 3.0}),
        (effects.DiodeDropError(diode_drop=0.3), {"diode_drop": 0.3}),
        (effects.OnTimeOffset(on_time_error=0.3), {"on_time_error": 0.3}),
        (effects.MissedSwitching(threshold=1.0), {"detector_threshold": 1.0}),
        (effects.ReverseLeakage(conductance=1e-7), {"diode_leakage": 1e-7}),
        (effects.ProbeLoading(resistance=1e7, capacitance=3e-8, place="dc"), {"dc_leakage": 1e-7}),
    ],
    ids=lambda each: getattr(each, "name", ""),
)
def test_a_circuit_is_what_its_label_says_with_the_effects_value(effect, label):
    circuit = shunts.ParallelSSHI(**BRIDGE, **COIL)
    if effect.name == "probe_loading":
        label = {**label, "smoothing_capacitance": BRIDGE["smoothing_capacitance"] + 3e-8}
    found = simulate(System(dataclasses.replace(PLAIN, effects=(effect,)), circuit), DRIVE)
    wanted = simulate(System(PLAIN, dataclasses.replace(circuit, **label)), DRIVE)
    assert found.converged
    assert found.harvested_power == wanted.harvested_power
    assert np.array_equal(found.waveforms.voltage, wanted.waveforms.voltage)


def test_diodes_that_leak_are_a_resistance_on_either_side():
    """Four of conductance g: 1/g across the leads, as a leakage of the specimen is, and 1/g beside the load."""
    conductance, load = 2e-6, 1e5
    leaking = shunts.Rectifier(smoothing_capacitance=1e-6, load_resistance=load, diode_leakage=conductance)
    both = shunts.Rectifier(smoothing_capacitance=1e-6, load_resistance=1 / (1 / load + conductance))
    found, leaky = run_of(leaking), run_of(both, effects.Leakage(resistance=1 / conductance))
    assert found.displacement_amplitude == pytest.approx(leaky.displacement_amplitude, rel=1e-10)
    assert found.dc_voltage == pytest.approx(leaky.dc_voltage, rel=1e-10)
    behind_diodes = leaky.harvested_power / (1 + load * conductance)
    assert found.harvested_power == pytest.approx(behind_diodes, rel=1e-9)
    lost = leaky.energy["leakage"] + leaky.energy["harvested"] - found.energy["harvested"]
    assert found.energy["shunt_loss"] == pytest.approx(lost, rel=1e-9)


def test_a_probe_beside_the_load_takes_no_harvest():
    load, meter = 1e5, 3e5
    probe = effects.ProbeLoading(resistance=meter, place="dc")
    found = run_of(shunts.Rectifier(smoothing_capacitance=1e-6, load_resistance=load), probe)
    wanted = run_of(shunts.Rectifier(smoothing_capacitance=1e-6, load_resistance=1 / (1 / load + 1 / meter)))
    assert found.dc_voltage == pytest.approx(wanted.dc_voltage, rel=1e-10)
    assert found.harvested_power == pytest.approx(wanted.harvested_power * meter / (load + meter), rel=1e-9)


def test_a_switch_that_misses_every_extremum_is_open():
    circuit = shunts.SSDI(**COIL)
    found, wanted = run_of(circuit, effects.MissedSwitching(threshold=1e3)), run_of(shunts.Open())
    assert found.displacement_amplitude == pytest.approx(wanted.displacement_amplitude, rel=1e-12)
    assert found.events_per_period == 0


def test_reversion_is_a_relaxation_in_the_terms_of_an_inversion():
    share, tau = 0.2, 1e-3
    branch = {"capacitance": PLAIN.capacitance * share / (1 - share), "time_constant": tau / (1 - share)}
    reversion = effects.VoltageReversion(share=share, time_constant=tau)
    found, wanted = (run_of(shunts.SSDI(**COIL), each) for each in (reversion, effects.DielectricRelaxation(**branch)))
    assert found.displacement_amplitude == pytest.approx(wanted.displacement_amplitude, rel=1e-11)
    assert found.energy["voltage_reversion"] == pytest.approx(wanted.energy["dielectric_relaxation"], rel=1e-9)


@pytest.mark.parametrize("name", BEHIND)
def test_lowering_takes_a_complex_step_of_an_effect(name):
    """As those need who derive predictions through the engine: its imaginary part is the difference quotient."""
    example, circuit = build(REGISTERED[name], BEHIND[name][0], name), shunts.ParallelSSHI(**BRIDGE, **COIL)
    strength, step = REGISTERED[name].strength().name, 1e-20
    value = getattr(example, strength)

    def lowered(changed):
        system = System(put(PLAIN, ("effects",), (put(example, (strength,), changed),)), circuit)
        return lower(system, DRIVE).program

    ours, above, below = (lowered(x) for x in (value + 1j * step, value * (1 + 1e-6), value * (1 - 1e-6)))
    felt = 0
    for key in ("rate", "product_coefficient", "lag", "on_time", "threshold"):
        wanted = (getattr(above, key) - getattr(below, key)) / (2e-6 * value)
        size = np.abs(wanted).max()
        felt += bool(size > 0)
        assert np.abs(np.imag(getattr(ours, key)) / step - wanted).max() <= 1e-7 * size, key
    assert felt


def run_of(shunt, *present):
    found = simulate(System(dataclasses.replace(PLAIN, effects=present), shunt), DRIVE)
    assert found.converged, found.message
    return found


def test_agrees_with_the_virtual_bench_on_a_moving_base():
    """Two modes, of which the first creeps and rubs."""
    table = {"kind": "sine_base", "amplitude": 2.0, "frequency": 50.6}
    keys = {"hysteresis": STOPS, "modes": [SECOND], "effective_mass": 0.013}
    names = [name for name in ORACLE if name not in OF_THE_LOAD]
    study = bench_study(LOADS[0], table, **keys, effects={name: ORACLE[name] for name in names})
    found = simulate(*objects(study), transient=LENGTH, samples=200)
    model = Model(build_transducer({**BENCH, **keys}), CIRCUITS["resistor"](build_shunt(LOADS[0])), base=True)
    for name in names:
        build(bench_effects.registered()[name], ORACLE[name], name).act(model, LENGTH)
    wanted = integrate(model, build_excitation(table, Path()), found.waveforms.time)
    assert found.energy["closure"] < 1e-12
    assert distance(found.waveforms.displacement, wanted.displacement) < 1e-8
    assert distance(found.waveforms.voltage, wanted.voltage) < 1e-8


# --- Many designs, and gradients ------------------------------------------------------------------------------------

KINDS = ["resistor", "parallel_sshi", "sece"]


@pytest.mark.parametrize(
    ("name", "shunt"),
    with_slow(itertools.product(FELT, KINDS), slow=lambda name, shunt: name in BENDING and shunt != "sece"),
)
def test_many_designs_are_those_of_one(name, shunt):
    """The strength from its null, where that is within the bounds, to twice the example's.

    What bends takes much longer the more it does so: up to the example's.
    """
    field, shares = REGISTERED[name].strength(), np.array([[0.0], [0.5], [1.0], [2.0]])
    if name in BENDING:
        shares = shares[:3]
    null, usual = field.metadata["null"], getattr(EXAMPLES[name], field.name)
    if null == AS_LABELLED or not math.isfinite(null) or field.metadata.get("above") == null:
        shares = shares[1:]
    batch = dataclasses.replace(EXAMPLES[name], **{field.name: shares * usual})
    found = simulate_many(System(dataclasses.replace(HYSTERETIC, effects=(batch,)), SHUNTS[shunt]), DRIVE, len(shares))
    for n, share in enumerate(shares[:, 0]):
        one = run(shunt, dataclasses.replace(EXAMPLES[name], **{field.name: share * usual}))
        assert found["converged"][n]
        assert found["displacement_amplitude"][n] == pytest.approx(one.displacement_amplitude, rel=1e-10)
        assert found["harvested_power"][n] == pytest.approx(one.harvested_power, rel=1e-9)
        nothing = 1e-13 if name not in SMOOTH else 1e-9  # what bends takes nothing in a period, to its precision
        assert found[f"energy.{name}"][n] == pytest.approx(
            one.energy[name], rel=1e-8, abs=nothing * one.energy["mechanical_in"]
        )


@pytest.mark.parametrize("shunt", KINDS)
@each_passive
def test_gradients_are_central_differences(name, shunt):
    example = EXAMPLES[name]
    system = System(dataclasses.replace(HYSTERETIC, effects=(example,)), SHUNTS[shunt])
    found = gradient(system, DRIVE)
    for field in (field for field in dataclasses.fields(example) if "unit" in field.metadata):
        k, value = found.quantities.index(f"transducer.effects.{name}.{field.name}"), getattr(example, field.name)
        sides = [
            run(shunt, dataclasses.replace(example, **{field.name: value * share})) for share in (1 + 1e-4, 1 - 1e-4)
        ]
        for result in ("displacement_amplitude", "harvested_power"):
            above, below = (getattr(side, result) for side in sides)
            size = (above + below) / (2 * value)
            assert found.by[result][k] == pytest.approx((above - below) / (2e-4 * value), rel=1e-6, abs=1e-8 * size)


# --- Identities -----------------------------------------------------------------------------------------------------


def test_two_leakages_are_one_of_half_the_resistance():
    one, half = effects.Leakage(resistance=4e5), effects.Leakage(resistance=2e5)
    found = simulate(System(dataclasses.replace(PLAIN, effects=(one,)), shunts.Resistor(resistance=4e5)), DRIVE)
    wanted = simulate(System(dataclasses.replace(PLAIN, effects=(half,)), shunts.Open()), DRIVE)
    assert found.displacement_amplitude == pytest.approx(wanted.displacement_amplitude, rel=1e-10)
    assert found.energy["harvested"] + found.energy["leakage"] == pytest.approx(wanted.energy["leakage"], rel=1e-9)
    twice = simulate(System(dataclasses.replace(PLAIN, effects=(one, one)), shunts.Open()), DRIVE)
    assert twice.energy["leakage"] == pytest.approx(wanted.energy["leakage"], rel=1e-9)
    assert twice.energy["closure"] < 1e-12


def test_relaxation_is_the_same_branch_as_a_network_would_be():
    """Without hysteresis the voltage across C is that across the electrodes."""
    branch = effects.DielectricRelaxation(capacitance=15e-9, time_constant=5e-3)
    effect = simulate(System(dataclasses.replace(PLAIN, effects=(branch,)), shunts.Open()), DRIVE)
    network = shunts.Network(netlist=f"C1 1 2 15n\nR1 2 0 {5e-3 / 15e-9!r}")
    shunt = simulate(System(PLAIN, network), DRIVE)
    assert effect.displacement_amplitude == pytest.approx(shunt.displacement_amplitude, rel=1e-10)
    assert effect.energy["dielectric_relaxation"] == pytest.approx(shunt.energy["shunt_loss"], rel=1e-9)
    assert np.abs(effect.waveforms.current).max() < 1e-9 * np.abs(shunt.waveforms.current).max()


def test_friction_loses_the_area_of_its_loop():
    """4 k_f r (X - r) a period, where X is the amplitude (Iwan 1966)."""
    friction = effects.Friction(stiffness=50.0, threshold=2e-5)
    found = run("resistor", friction)
    area = 4 * friction.stiffness * friction.threshold * (found.displacement_amplitude - friction.threshold)
    assert found.energy["friction"] == pytest.approx(area, rel=1e-9)


def test_friction_that_never_slips_is_a_spring():
    held = effects.Friction(stiffness=50.0, threshold=0.1)
    stiffer = dataclasses.replace(HYSTERETIC, stiffness=HYSTERETIC.stiffness + 50.0)
    for shunt in SHUNTS:
        found, wanted = run(shunt, held), run(shunt, device=stiffer)
        assert found.displacement_amplitude == pytest.approx(wanted.displacement_amplitude, rel=1e-9)
        assert found.energy["friction"] == pytest.approx(0.0, abs=1e-15 * found.energy["mechanical_in"])


# --- Studies --------------------------------------------------------------------------------------------------------


def write_study(path, name, parameters):
    lines = ["[transducer]", *(f"{key} = {value}" for key, value in BENCH.items()), f"[transducer.effects.{name}]"]
    lines += [f"{key} = {value!r}" for key, value in parameters.items()]
    lines += ["[excitation]", *(f"{key} = {value!r}" for key, value in DRIVE_TABLE.items())]
    lines += ["[[shunts]]", 'kind = "resistor"', "resistance = 8e4"]
    swept = '{ path = "shunts.0.resistance", from = 1e4, to = 1e5, count = 2 }'
    lines += ["[sweep]", 'method = "grid"', f"parameters = [{swept}]"]
    path.write_text("\n".join(lines))
    return str(path)


def of_study(name):
    """Keys and values of the example, as a study has them."""
    values = {field.name: getattr(EXAMPLES[name], field.name) for field in dataclasses.fields(EXAMPLES[name])}
    return {key: value for key, value in values.items() if value is not None}


def refused(capsys, *arguments):
    """The error on stderr, one line behind whatever progress there was; exit status 2, nothing on stdout."""
    assert main([*arguments]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    *before, last = told.err.strip().splitlines()
    assert last.startswith("piezoharvest: error: ") and not any("Traceback" in line for line in before), told.err
    return last


@each_effect
def test_in_a_study(name, tmp_path, capsys):
    path = write_study(tmp_path / "study.toml", name, of_study(name))
    assert main(["simulate", path, "--json"]) == 0
    assert f'"{name}"' in capsys.readouterr().out


@pytest.mark.parametrize("command", ["simulate", "sweep"])
def test_commands_refuse_what_they_cannot_do(command, tmp_path, capsys, monkeypatch):
    """A charge that depends on the voltage behind the hysteresis, where charge is taken at once."""
    charge = lambda self, specimen: specimen.charge(self.beta * specimen.power(specimen.v, 3))  # noqa: E731
    monkeypatch.setattr(effects.VoltageDependentCapacitance, "act", charge)
    options = ["--out", str(tmp_path / "t.csv")] if command == "sweep" else []
    path = Path(write_study(tmp_path / "study.toml", "voltage_dependent_capacitance", {"beta": 1e-12}))
    text = path.read_text().replace('kind = "resistor"\nresistance = 8e4', 'kind = "sece"\nefficiency = 0.9')
    path.write_text(
        text.replace("shunts.0.resistance", "shunts.0.efficiency").replace("1e4, to = 1e5", "0.5, to = 0.9")
    )
    told = refused(capsys, command, str(path), *options)
    assert "transducer.effects: found a smooth term of q, v, i" in told and "allowed" in told
    assert sorted(p.name for p in tmp_path.iterdir()) == ["study.toml"]


@pytest.mark.parametrize("command", ["simulate", "design", "sweep", "export"])
def test_commands_refuse_an_effect_that_they_do_not_know(command, tmp_path, capsys):
    options = {"sweep": ["t.csv"], "export": ["t.cir", "--format", "spice"]}.get(command, [])
    options = ["--out", str(tmp_path / options[0]), *options[1:]] if options else []
    path = write_study(tmp_path / "study.toml", "stifening", {"cubic_stiffness": 1e9})
    told = refused(capsys, command, path, *options)
    assert "study.toml: transducer.effects.stifening: unknown effect (did you mean 'stiffening'?)" in told
