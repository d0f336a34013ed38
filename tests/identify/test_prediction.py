"""The prediction of a record against the bench's own solver, closed forms, and its own derivatives."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from identify.identify_runs import LINEAR, STACK
from scipy.integrate import solve_ivp

from piezoharvest.bench.effects import registered as bench_effects
from piezoharvest.bench.solver import CIRCUITS, Model, integrate
from piezoharvest.description.effects import registered
from piezoharvest.description.effects.electrical.dielectric_relaxation import DielectricRelaxation
from piezoharvest.description.effects.nameless.forms import Bends, Corners, Line, Power, TwoKnees
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import Play, Relaxation, Resonance
from piezoharvest.description.effects.nameless.places import (
    Capacitor,
    Coupling,
    Damper,
    Electrodes,
    GainOverTime,
    OverTime,
    Spring,
)
from piezoharvest.description.effects.nameless.shapes import Shape, StepChange
from piezoharvest.description.effects.sensing.channel_skew import ChannelSkew
from piezoharvest.description.effects.sensing.displacement_lag import DisplacementLag
from piezoharvest.description.transducer import Transducer
from piezoharvest.diagnose.discovery.law_fits import law_parameters
from piezoharvest.predict.discrete_model import setting_of
from piezoharvest.predict.drive import JUMP_PARTS, RISE_PARTS, corners_of, divided, drive_of, rise_steps
from piezoharvest.predict.parameters import Parameter, parameters_of, put, value_at
from piezoharvest.predict.prediction import Prediction
from piezoharvest.predict.propagation.propagate import propagate_block
from piezoharvest.predict.sensors import Course, sensed
from piezoharvest.study import build, build_excitation, build_shunt, build_transducer

LOAD = {"kind": "resistor", "resistance": 51.43e3}
SINE = {"kind": "sine_force", "amplitude": 450.0, "offset": 550.0, "frequency": 5.0}
# A cantilever near its resonance, where the record shows its dynamics.
BEAM = {"mass": 0.010, "damping": 0.0628, "stiffness": 986.96, "coupling": 1.0e-3, "capacitance": 40e-9}
TIMES = np.arange(3001) / 1000.0


def waves(transducer, excitation, shunt=LOAD, times=TIMES, effects=()):
    """Waveforms of the bench's own solver, without noise."""
    excitation, shunt = build_excitation(excitation, Path()), build_shunt(shunt)
    model = Model(build_transducer(transducer), CIRCUITS[shunt.kind](shunt), base=excitation.base)
    for name, table in effects:
        build(bench_effects()[name], table, name).act(model, float(times[-1]))
    return integrate(model, excitation, times)


def predicted(transducer, drive, values, shunt=LOAD, parameters=(), nuisance=None, step=1e-3, size=1 << 16, fine=1):
    setting = replace(setting_of(drive, shunt and build_shunt(shunt), step, values), fine=fine)
    prediction = Prediction(transducer, setting, parameters, nuisance)
    blocks = list(prediction.blocks(bool(parameters) or nuisance is not None, size))
    names = prediction.channels
    found = np.concatenate([block.values for block in blocks])
    return dict(zip(names, found.T, strict=True)), np.concatenate([block.derivatives for block in blocks])


def test_stack_under_a_force_agrees_with_the_bench():
    truth = waves(STACK, SINE)
    found, _ = predicted(build_transducer(STACK), "force", truth.sensed("force"))
    assert np.abs(found["displacement"] - truth.sensed("displacement")).max() < 1e-12
    _agree(found, truth, ("voltage", "current"))


def test_a_circuit_with_states_agrees_with_the_bench():
    shunt = {"kind": "series_rl", "resistance": 2e4, "inductance": 500.0}
    truth = waves(STACK, SINE, shunt, np.arange(6001) / 2000.0)
    found, _ = predicted(build_transducer(STACK), "force", truth.sensed("force"), shunt, step=5e-4)
    _agree(found, truth, ("displacement", "voltage", "current"))


def test_columns_grow_with_need():
    """Sixty equal branches beside the capacitance are one that is sixty times as large."""
    device, force = build_transducer(LINEAR), 400.0 * np.sin(2 * np.pi * 2.0 * np.arange(500) / 1000.0)

    def seen(count):
        branch = DielectricRelaxation(capacitance=5e-7 / count, time_constant=0.05)
        return predicted(replace(device, effects=(branch,) * count), "force", force)[0]["voltage"]

    one = seen(1)
    assert np.abs(one).max() > 0.1
    assert np.abs(seen(60) - one).max() < 1e-9 * np.abs(one).max()


def _agree(found, truth, channels, tolerance=1e-4):
    for channel in channels:
        wanted = truth.sensed(channel)
        assert found[channel].shape == wanted.shape
        assert np.abs(found[channel] - wanted).max() < tolerance * np.abs(wanted).max()


def test_beam_on_a_moving_base_agrees_with_the_bench():
    excitation = {"kind": "sine_base", "amplitude": 2.0, "frequency": 50.6}
    times = np.arange(20001) / 10e3
    truth = waves(BEAM, excitation, {"kind": "resistor", "resistance": 1e5}, times)
    found, _ = predicted(
        build_transducer(BEAM), "base_acceleration", truth.sensed("base_acceleration"),
        {"kind": "resistor", "resistance": 1e5}, nuisance=None, step=1e-4,
    )  # fmt: skip
    late = slice(len(times) * 3 // 4, None)  # ringing of the start, which a fit has free, is gone
    for channel in ("displacement", "voltage"):
        wanted = truth.sensed(channel)[late]
        assert np.abs(found[channel][late] - wanted).max() < 2e-2 * np.abs(wanted).max()


def test_a_delayed_voltage_keeps_the_corners_of_its_hysteresis():
    """Through the samples alone they are rounded; a curve through parts of a sample is nearer by their square."""
    delay, late = 3e-4, slice(100, None)
    truth = waves(STACK, SINE, times=np.union1d(TIMES, TIMES[1:] - delay))
    setting = replace(setting_of("force", build_shunt(LOAD), 1e-3, truth.at(TIMES).sensed("force")), fine=16)
    wanted = truth.at(TIMES - delay).sensed("voltage")[late]

    def off(parts):
        (block,) = Prediction(build_transducer(STACK), setting).blocks(False, channels=("voltage",), parts=parts)
        added = 5.0 * np.cos(TIMES)  # as a line is, on top of what the model predicts
        values = block.values + added[:, None]
        course = Course(1e-3, between=block.between)
        read, _ = sensed([ChannelSkew(delay=delay)], (), {"voltage": 0.0}, course, values, None)
        return np.linalg.norm(read[late, 0] - 5.0 * np.cos(TIMES[late] - delay) - wanted)

    assert off(4) < 0.3 * off(1)
    assert off(16) < 0.3 * off(4)


@pytest.mark.parametrize("size", [1 << 16, 500])
def test_values_between_the_samples_are_those_of_a_finer_record(size):
    force, device = waves(STACK, SINE, times=np.arange(12001) / 4000.0).sensed("force"), build_transducer(STACK)
    fine = predicted(device, "force", force, step=2.5e-4)[0]["voltage"]
    setting = setting_of("force", build_shunt(LOAD), 1e-3, force[::4])
    for block in Prediction(device, setting).blocks(False, size, ("voltage",), 4):
        wanted = fine[4 * block.begin :][: 4 * (len(block.values) - 1) + 1]
        assert block.between[:, 0] == pytest.approx(wanted, abs=1e-4 * np.abs(fine).max())


@pytest.mark.parametrize(("begin", "rise", "history"), [(100.0, 900.0, 1.0), (1000.0, -900.0, -1.0)])
def test_a_load_before_the_record_has_left_its_history_in_the_operators(begin, rise, history):
    """Cut out of a longer one, a record begins while the load is held, when the charge of its rise has drained."""
    load = {"kind": "step_force", "offset": begin, "amplitude": rise, "duration": 4.0, "rise_time": 0.1}
    truth, cut = waves(STACK, load, times=np.arange(6001) / 1000.0), slice(3500, None)
    setting = setting_of("force", build_shunt(LOAD), 1e-3, truth.sensed("force")[cut])
    wanted, off = truth.sensed("voltage")[cut], []
    for ran in (history, 0.0):
        (block,) = Prediction(build_transducer(STACK), setting, (), np.full(3, ran)).blocks(False)
        off.append(np.abs(block.values[:, 1] - wanted).max() / np.abs(wanted).max())
    assert off[0] < 1e-4
    assert off[1] > 0.03


@pytest.mark.parametrize("held", [0.0, 1e-3, -0.03, 1.0])
def test_a_drive_that_is_held_exactly_has_a_prediction_at_rest(held):
    """All that is left of the operators' inputs is rounded: their differences are, too."""
    force = np.concatenate([np.full(300, held), held + 0.1 * np.sin(0.1 * np.arange(200)), np.full(100, held)])
    found, _ = predicted(build_transducer(STACK), "force", force)
    assert np.abs(np.diff(found["displacement"][:300])).max() < 1e-15
    assert np.all(np.isfinite(found["voltage"]))
    smooth = held + np.concatenate([force[:1] - held, np.diff(force)]).cumsum()
    again, _ = predicted(build_transducer(STACK), "force", smooth + 1e-9 * np.sin(TIMES[:600] * 40.0))
    assert np.abs(again["voltage"] - found["voltage"]).max() < 1e-9


def test_voltage_drive_is_the_inverse_of_a_free_actuator():
    """Slowly: the displacement is T (v - v_h)/k, v_h by a Prandtl-Ishlinskii operator of the charge."""
    device = build_transducer(STACK)
    time = np.arange(4001) / 1000.0
    voltage = 20.0 * np.sin(2 * np.pi * 0.5 * time)
    found, _ = predicted(device, "voltage", voltage, None)
    compliant = device.capacitance + device.coupling**2 / device.stiffness
    charge = device.hysteresis.charge(voltage, compliant)
    wanted = device.coupling * charge / compliant / device.stiffness
    assert np.abs(found["displacement"] - wanted).max() < 2e-4 * np.abs(wanted).max()


def test_displacement_drive_agrees_with_an_integration():
    """V' = -(v/R + T x')/C by scipy, without hysteresis; the force follows."""
    device, load = build_transducer(LINEAR), 51.43e3
    x = lambda t: 3e-6 * np.sin(2 * np.pi * 5 * t) ** 2  # noqa: E731
    dx = lambda t: 3e-6 * 2 * np.pi * 5 * np.sin(4 * np.pi * 5 * t)  # noqa: E731

    def rate(t, v):
        return -(v / load + device.coupling * dx(t)) / device.capacitance

    truth = solve_ivp(rate, (0, TIMES[-1]), [0.0], t_eval=TIMES, rtol=1e-10, atol=1e-12).y[0]
    found, _ = predicted(device, "displacement", x(TIMES))
    assert np.abs(found["voltage"] - truth).max() < 1e-5 * np.abs(truth).max()
    force = device.stiffness * x(TIMES) + device.damping * dx(TIMES) - device.coupling * truth
    assert np.abs(found["force"] - force)[5:-5].max() < 1e-5 * np.abs(force).max()


@pytest.mark.parametrize(
    ("name", "table"),
    [("leakage", {"resistance": 3e5}), ("dielectric_relaxation", {"capacitance": 4e-7, "time_constant": 0.2})],
)
def test_linear_effects_agree_with_the_bench(name, table):
    truth = waves(STACK, SINE, effects=[(name, table)])
    device = build_transducer({**STACK, "effects": {name: table}})
    assert name in registered()
    found, _ = predicted(device, "force", truth.sensed("force"))
    late = slice(2000, None)
    for channel in ("displacement", "voltage"):
        wanted = truth.sensed(channel)[late]
        assert np.abs(found[channel][late] - wanted).max() < 1e-3 * np.abs(wanted).max()


@pytest.mark.parametrize(
    ("name", "table"),
    [
        ("nonlinear_coupling", {"quadratic_coupling": -1e5}),
        pytest.param("stiffening", {"cubic_stiffness": 1e18}, marks=pytest.mark.slow),
        ("voltage_dependent_capacitance", {"beta": 1e-3}),
    ],
)
def test_what_bends_agrees_with_the_bench_under_tension_too(name, table):
    """A square is even: under a load in one direction alone nothing tells it from one with the sign of its root."""
    truth = waves(STACK, {"kind": "sine_force", "amplitude": 800.0, "frequency": 2.0}, effects=[(name, table)])
    found, _ = predicted(build_transducer({**STACK, "effects": {name: table}}), "force", truth.sensed("force"))
    for channel in ("displacement", "voltage", "current"):
        wanted = truth.sensed(channel)[2:]
        assert np.abs(found[channel][2:] - wanted).max() < 1e-4 * np.abs(wanted).max(), channel


DRIVES = {
    "force": lambda t: 550 + 450 * np.sin(2 * np.pi * 3 * t) + 100 * np.sin(2 * np.pi * 17 * t),
    "voltage": lambda t: 20 * np.sin(2 * np.pi * 3 * t) + 5 * np.sin(2 * np.pi * 13 * t),
    "displacement": lambda t: 3e-6 * np.sin(2 * np.pi * 3 * t) + 1e-6 * np.sin(2 * np.pi * 13 * t),
    "base_acceleration": lambda t: 1e4 * np.sin(2 * np.pi * 3 * t) + 3e3 * np.sin(2 * np.pi * 13 * t),
}


@pytest.mark.parametrize(("drive", "fine"), [*((drive, 1) for drive in DRIVES), ("force", 3)])
def test_derivatives_are_those_of_central_differences(drive, fine):
    """Of every parameter, and of the record's own states; away from samples where an operator changes its branch."""
    device, values = build_transducer(STACK), DRIVES[drive](np.arange(600) / 1000.0)
    shunt = None if drive == "voltage" else LOAD
    parameters = parameters_of(device, {drive})
    _, slopes = predicted(device, drive, values, shunt, parameters, fine=fine)
    shape = slopes.shape[2]
    for k, parameter in enumerate(parameters):
        inner, step = parameter.inner(value_at(device, parameter.path)), 1e-6
        step *= 1.0 if parameter.scaling == "log" else abs(inner)
        sides = [
            predicted(
                put(device, parameter.path, float(parameter.outer(inner + sign * step))),
                drive,
                values,
                shunt,
                fine=fine,
            )[0]
            for sign in (1, -1)
        ]
        for c, channel in enumerate(sides[0]):
            wanted = (sides[0][channel] - sides[1][channel]) / (2 * step)
            # What hardly changes anything is within a millionth of the signal.
            size = max(np.abs(wanted).max(), 1e-2 * np.abs(sides[0][channel]).max() * 1e-6 / step)
            off = np.abs(slopes[:, c, k] - wanted) / size
            # Through leads of 0.03 ohm differences of the current are rounded to this.
            close = 1e-2 if (drive, channel) == ("voltage", "current") else 1e-4
            assert np.mean(off > close) < 0.02, (parameter.name, channel, off.max())
    _own_derivatives(device, drive, values, shunt, slopes[:, :, len(parameters) :], shape - len(parameters), fine)


def test_derivatives_with_elements_of_every_kind_in_one_model():
    """Slopes of one element are not those of the one before it: stops, products, powers, hinges and curves."""
    laws = [
        Law(place=Spring(), form=TwoKnees(factor=300.0, second=200.0, upper=1e-4, lower=-2e-4)),
        Law(place=OverTime("stiffness", "time"), form=StepChange(factor=-0.05, at=0.1, width=0.02)),
        Law(place=Electrodes(), form=Shape(factor=1e-6, scale=1.0, curve="sinh", bent=False)),
        Law(place=Damper(), form=Power(factor=2e-3, exponent=1.7, scale=0.1)),
        Law(place=Capacitor(), form=Line(factor=1e-9), memory=Play(threshold=1.0)),
        build(registered()["stiffening"], {"cubic_stiffness": 1e8}, "stiffening"),
        build(registered()["nonlinear_coupling"], {"quadratic_coupling": 0.5}, "nonlinear_coupling"),
    ]
    hysteresis = {"thresholds": [1e-8, 5e-8], "weights": [6e6, 3e6]}
    device = replace(build_transducer({**BEAM, "hysteresis": hysteresis}), effects=tuple(laws))
    force, load = 0.03 * np.sin(2 * np.pi * 43.0 * np.arange(400) / 2000.0), {"kind": "resistor", "resistance": 1e5}
    parameters = parameters_of(device, {"force"})
    parameters += [p for n, law in enumerate(laws[:5]) for p in law_parameters(law, n)]
    parameters = list({p.path: p for p in parameters}.values())
    assert len(parameters) == 22
    _, slopes = predicted(device, "force", force, load, parameters, step=5e-4)
    for k, parameter in enumerate(parameters):
        inner = parameter.inner(value_at(device, parameter.path))
        step = 1e-6 * (1.0 if parameter.scaling == "log" else abs(inner))
        sides = [put(device, parameter.path, float(parameter.outer(inner + sign * step))) for sign in (1, -1)]
        up, down = (predicted(side, "force", force, load, step=5e-4)[0] for side in sides)
        for c, channel in enumerate(up):
            wanted = (up[channel] - down[channel]) / (2 * step)
            size = max(np.abs(wanted).max(), 1e-8 * np.abs(up[channel]).max() / abs(step))
            assert np.mean(np.abs(slopes[:, c, k] - wanted) > 1e-3 * size) < 0.02, (parameter.path, channel)


TABLE = (-0.9, -0.4, 0.2, 0.7)
KINKS = np.array([0.4, -0.3, 0.5, -0.2])
# Laws of which inputs are reached by what elements give: within the step their courses follow from each other.
REACHED = {
    "coupling": (Coupling(), Bends, 2e-4, 3e-4),  # displacement in m, charge in C over m
    "capacitor": (Capacitor(), Bends, 6.0, 2e-8),
    "capacitor with corners": (Capacitor(), Corners, 6.0, 2e-8),
    "electrodes": (Electrodes(), Corners, 6.0, 3e-6),
}


def _beam_with_table(name):
    place, kind, size, slope = REACHED[name]
    kinks = KINKS * (slope / size if kind is Bends else slope)
    law = Law(place=place, form=kind(knots=tuple(size * k for k in TABLE), kinks=tuple(kinks.tolist())))
    hysteresis = {"thresholds": [1e-8, 5e-8], "weights": [6e6, 3e6]}
    return replace(build_transducer({**BEAM, "hysteresis": hysteresis}), effects=(law,))


@pytest.mark.parametrize("name", REACHED)
def test_one_step_follows_inputs_that_outputs_reach(name):
    """As lines between samples they are off by (w h)^2/12, here a 130th of what the elements do."""
    device, force = _beam_with_table(name), 0.02 * np.sin(2 * np.pi * 48.0 * np.arange(1000) / 1000.0)
    one, sixteen = (predicted(device, "force", force, {"kind": "resistor", "resistance": 1e5}, fine=k)[0]
                    for k in (1, 16))  # fmt: skip
    for channel, most in (("displacement", 1e-5), ("voltage", 5e-5)):
        assert np.std(one[channel] - sixteen[channel]) < most * np.std(sixteen[channel]), channel


@pytest.mark.parametrize("name", REACHED)
@pytest.mark.parametrize("null", [False, True])
def test_derivatives_of_tables_whose_inputs_outputs_reach(name, null):
    """Those with respect to a kink that is zero, too: then outputs reach the input by their derivatives alone."""
    device, load = _beam_with_table(name), {"kind": "resistor", "resistance": 1e5}
    if null:
        (law,) = device.effects
        device = replace(device, effects=(replace(law, form=replace(law.form, kinks=(0.0,) * len(TABLE))),))
    force = 0.02 * np.sin(2 * np.pi * 48.0 * np.arange(300) / 1000.0)
    parameters = [*parameters_of(device, {"force"}), *law_parameters(device.effects[0], 0)]
    _, slopes = predicted(device, "force", force, load, parameters)
    for k, parameter in enumerate(parameters):
        inner = parameter.inner(value_at(device, parameter.path))
        scale = abs(inner) if inner else REACHED[name][3] / (1.0 if "corners" in name else REACHED[name][2])
        step = 1e-6 if parameter.scaling == "log" else 1e-4 * scale
        sides = [put(device, parameter.path, float(parameter.outer(inner + sign * step))) for sign in (1, -1)]
        up, down = (predicted(side, "force", force, load)[0] for side in sides)
        for c, channel in enumerate(up):
            wanted = (up[channel] - down[channel]) / (2 * step)
            size = max(np.abs(wanted).max(), 1e-8 * np.abs(up[channel]).max() / abs(step))
            assert np.mean(np.abs(slopes[:, c, k] - wanted) > 1e-3 * size) < 0.02, (parameter.path, channel)


def test_derivatives_of_two_effects_at_null_that_multiply_rows_of_zero():
    """Such rows are alike but for their derivatives: each is an input of its own."""
    table = Law(place=Coupling(), form=Bends(knots=(0.0, -0.0), kinks=(0.0, 0.0)))
    gain = Law(place=GainOverTime("displacement"), form=StepChange(factor=0.0, at=0.1, width=0.004))  # s
    device = replace(build_transducer(BEAM), effects=(table, gain))
    force = 0.02 * np.sin(np.arange(200) / 5.0)
    parameters = [*law_parameters(table, 0), Parameter(("effects", 1, "form", "factor"), "", "linear", -1.0, 1.0)]
    _, slopes = predicted(device, "force", force, parameters=parameters)
    for k, channel, step in ((0, "voltage", 1e-3), (2, "displacement", 1e-5)):
        parameter = parameters[k]
        sides = [predicted(put(device, parameter.path, s * step), "force", force)[0][channel] for s in (1, -1)]
        wanted = (sides[0] - sides[1]) / (2 * step)
        column = ("displacement", "voltage").index(channel)
        assert slopes[:, column, k] == pytest.approx(wanted, abs=1e-4 * np.abs(wanted).max()), channel


@pytest.mark.parametrize("place", [Spring(), Capacitor()], ids=lambda place: place.name)
def test_derivatives_of_many_memories_without_a_strength(place):
    """Each is that of a small strength with its memory alone: the states of the others change nothing."""
    step, bare = (0.01 if place.name == "spring" else 1e-11), build_transducer(BEAM)
    memories = [Relaxation(time_constant=tau) for tau in np.geomspace(1e-4, 0.03, 7)]
    memories += [Resonance(frequency=f, damping_ratio=0.05) for f in np.geomspace(5.0, 200.0, 7)]
    laws = [Law(place=place, form=Line(factor=0.0), memory=memory) for memory in memories]
    own = [Parameter((name,), "", "log", -np.inf, np.inf) for name in ("stiffness", "capacitance")]
    strengths = [Parameter(("effects", k, "form", "factor"), "", "linear", -1e9, 1e9) for k in range(len(laws))]
    force = 0.01 * np.random.default_rng(8).standard_normal(400).cumsum()

    def seen(effects, parameters=()):
        found, slopes = predicted(replace(bare, effects=tuple(effects)), "force", force, parameters=parameters)
        return np.column_stack(list(found.values())), slopes

    _, slopes = seen(laws, [*own, *strengths])
    for k, law in enumerate(laws):
        high, low = (seen([put(law, ("form", "factor"), sign * step)])[0] for sign in (1.0, -1.0))
        wanted = (high - low) / (2.0 * step)
        assert np.all(np.abs(slopes[..., 2 + k] - wanted).max(axis=0) < 1e-5 * np.abs(wanted).max(axis=0))
    _, alone = seen([], own)
    assert np.all(np.abs(slopes[..., :2] - alone).max(axis=0) < 1e-9 * np.abs(alone).max(axis=0))


@pytest.mark.parametrize(
    ("name", "table"),
    [("nonlinear_coupling", {"quadratic_coupling": 0.5}), ("voltage_dependent_capacitance", {"beta": 0.002})],
)
def test_electrical_laws_at_resonance_agree_with_the_bench(name, table):
    hysteresis = {"thresholds": [1e-8, 5e-8], "weights": [6e6, 3e6]}
    sine, load = {"kind": "sine_force", "amplitude": 0.02, "frequency": 48.0}, {"kind": "resistor", "resistance": 1e5}
    truth = waves({**BEAM, "hysteresis": hysteresis}, sine, load, np.arange(1001) / 2000.0, [(name, table)])
    device = build_transducer({**BEAM, "hysteresis": hysteresis})
    device = replace(device, effects=(build(registered()[name], table, name),))
    found, _ = predicted(device, "force", truth.sensed("force"), load, step=5e-4)
    for channel in ("displacement", "voltage"):
        wanted = truth.sensed(channel)
        assert np.abs(found[channel] - wanted).max() < 1e-5 * np.abs(wanted).max(), channel


def _own_derivatives(device: Transducer, drive, values, shunt, slopes, count, fine):
    for k in range(count):
        step = np.zeros(count)
        step[k] = 1e-4
        sides = [predicted(device, drive, values, shunt, nuisance=sign * step, fine=fine)[0] for sign in (1, -1)]
        for c, channel in enumerate(sides[0]):
            wanted = (sides[0][channel] - sides[1][channel]) / 2e-4
            size = max(np.abs(wanted).max(), 1e-7 * np.abs(sides[0][channel]).max())
            assert np.mean(np.abs(slopes[:, c, k] - wanted) > 1e-3 * size) < 0.02


@pytest.mark.parametrize("size", [7, 100, 599])
def test_blocks_are_the_whole(size):
    device, values = build_transducer(STACK), DRIVES["force"](np.arange(600) / 1000.0)
    parameters = parameters_of(device, {"force"})
    whole, slopes = predicted(device, "force", values, LOAD, parameters)
    parts, of_parts = predicted(device, "force", values, LOAD, parameters, size=size)
    for channel in whole:
        np.testing.assert_allclose(
            parts[channel], whole[channel], rtol=1e-12, atol=1e-12 * np.abs(whole[channel]).max()
        )
    np.testing.assert_allclose(of_parts, slopes, rtol=1e-9, atol=1e-9 * np.abs(slopes).max())


def test_the_prediction_never_stops_under_a_noisy_drive():
    """Every sample may turn every operator: the equations of a step have to be solved all the same."""
    rng, device = np.random.default_rng(9), build_transducer(STACK)
    held = np.where(np.arange(20000) < 10000, 1000.0, 100.0) + 0.5 * rng.standard_normal(20000)
    found, _ = predicted(device, "force", held)
    assert np.all(np.isfinite(found["voltage"]))


def test_a_jump_of_the_drive_does_not_ring():
    values = np.where(np.arange(100) < 50, 0.0, 1.0)
    motion = drive_of(values)
    assert motion.jumps.tolist() == [49]
    inside = motion.coefficients[:, 0] + 0.5 * motion.coefficients[:, 1] + 0.25 * motion.coefficients[:, 2]
    assert inside.min() >= -1e-12
    assert inside.max() <= 1 + 1e-12


@pytest.mark.parametrize("late", [-0.49, -0.2, 0.0, 0.3, 0.49])
@pytest.mark.parametrize("rise", [-4.0, 0.0, 0.2])
def test_a_jump_between_samples_keeps_its_mean(late, rise):
    small, slopes = rise_steps(np.array([2.0, 3.0, 0.0, 0.0]), late * JUMP_PARTS, rise)
    means = small @ [1.0, 1 / 2, 1 / 3, 1 / 4]
    assert means.mean() == pytest.approx(2.0 + 3.0 * (0.5 - late))
    assert means.min() >= 2.0
    assert means.max() <= 5.0
    between = ~np.isclose(means, 2.0) & ~np.isclose(means, 5.0)
    assert between.sum() <= np.ceil(RISE_PARTS * np.exp(rise)) + 1
    assert slopes[:, 0].sum() == pytest.approx(1.0)
    assert slopes[:, 1].sum() == pytest.approx(0.0, abs=1e-6)
    away = np.abs(np.arange(JUMP_PARTS) + 0.5 - JUMP_PARTS * (0.5 + late)) > 0.5 * RISE_PARTS * np.exp(rise) + 1.0
    assert np.abs(slopes[away]).max() < 1e-9


def test_a_jump_that_takes_a_whole_sample_goes_straight():
    small, _ = rise_steps(np.array([2.0, 3.0, 0.0, 0.0]), 0.0, np.log(JUMP_PARTS / RISE_PARTS))
    np.testing.assert_allclose(small[:, 0], 2.0 + 3.0 * (np.arange(JUMP_PARTS) + 0.5) / JUMP_PARTS, rtol=1e-12)


def test_small_steps_follow_the_drive():
    cubic = np.array([1.0, -2.0, 3.0, 0.5])
    share = (np.arange(64) + 0.25) / 64
    found = divided(np.array([cubic, 2 * cubic]), 64) @ (0.25 ** np.arange(4))
    once = np.polynomial.polynomial.polyval(share, cubic)
    np.testing.assert_allclose(found, np.concatenate([once, 2 * once]), rtol=1e-12)


@pytest.mark.slow
def test_what_bends_at_resonance_is_followed_by_cubics():
    """Outputs of elements that run straight between samples are off by (w h)^2/12 of what these do, here a 130th."""
    hysteresis = {"thresholds": [1e-8, 5e-8], "weights": [6e6, 3e6]}
    cubic = {"cubic_stiffness": 1e8}
    sine = {"kind": "sine_force", "amplitude": 0.02, "frequency": 48.0}
    truth = waves({**BEAM, "hysteresis": hysteresis}, sine, effects=[("stiffening", cubic)])
    device = build_transducer({**BEAM, "hysteresis": hysteresis})
    device = replace(device, effects=(build(registered()["stiffening"], cubic, "stiffening"),))
    setting, found = setting_of("force", build_shunt(LOAD), 1e-3, truth.sensed("force")), {}
    for fine in (1, 2, 8):
        (block,) = Prediction(device, replace(setting, fine=fine)).blocks(False)
        found[fine] = block.values[:, 0]
    wanted = truth.sensed("displacement")
    assert np.abs(found[1] - wanted).max() < 3e-5 * np.abs(wanted).max()  # the drive's spline is off by 1e-5
    assert np.abs(found[2] - found[8]).max() < np.abs(found[1] - found[8]).max() / 10.0


def _beam_off_equilibrium(lag, nuisance=(1e-4, 0.02, 1e-8), parameters=()):
    """Displacement of a beam that a record finds in motion, and its derivatives."""
    device = build_transducer(BEAM)
    effects = () if lag is None else (DisplacementLag(time_constant=lag),)
    force = 0.01 * np.cos(2 * np.pi * 30.0 * np.arange(300) / 1000.0)
    setting = setting_of("force", build_shunt(LOAD), 1e-3, force, device)
    assert setting.free == ("x1", "u1", "q")
    prediction = Prediction(replace(device, effects=effects), setting, parameters, np.array(nuisance))
    (block,) = prediction.blocks(True)
    return block.values[:, prediction.channels.index("displacement")], block.derivatives


def test_a_sensor_that_lags_has_followed_what_it_sees_before_the_record():
    without, _ = _beam_off_equilibrium(None)
    hardly, _ = _beam_off_equilibrium(1e-9)
    np.testing.assert_allclose(hardly, without, atol=1e-6 * np.abs(without).max())
    # To first order a lag takes the velocity off, at the first sample too.
    little, _ = _beam_off_equilibrium(1e-5)
    velocity = np.gradient(without, 1e-3, edge_order=2)
    np.testing.assert_allclose(without - little, 1e-5 * velocity, atol=0.05 * np.abs(1e-5 * velocity).max())


def test_a_charge_that_is_off_equilibrium_has_moved_the_displacement_before_the_record():
    device = build_transducer(LINEAR)
    setting = setting_of("force", build_shunt(LOAD), 1e-3, np.full(50, 300.0), device)
    prediction = Prediction(device, setting, nuisance=np.array([4e-6]))
    (block,) = prediction.blocks(False)
    displacement, voltage, _ = block.values.T
    assert prediction.channels[:2] == ("displacement", "voltage")
    assert abs(voltage[0]) > 0.5
    quasistatic = (300.0 + device.coupling * voltage) / device.stiffness
    assert displacement == pytest.approx(quasistatic, rel=1e-6)


def test_derivatives_where_a_lagging_sensor_begins():
    nuisance, varied = (
        np.array([1e-4, 0.02, 1e-8]),
        Parameter(("effects", 0, "time_constant"), "s", "linear", 0.0, 1.0),
    )
    _, slopes = _beam_off_equilibrium(2e-4, nuisance, (varied,))
    steps = [np.zeros(3), *(np.eye(3) * 1e-3 * nuisance)]
    for k, step in enumerate(steps):
        lag = 0.0 if k else 1e-7
        sides = [_beam_off_equilibrium(2e-4 + sign * lag, nuisance + sign * step)[0] for sign in (1, -1)]
        wanted = (sides[0] - sides[1]) / (2 * (step.sum() if k else lag))
        found = slopes[:, 0, k]
        np.testing.assert_allclose(found, wanted, atol=1e-5 * np.abs(wanted).max())


STEP = {"kind": "step_force", "amplitude": 900.0, "offset": 100.0, "duration": 1.0}


def stepped(transducer, duration, effects=(), parameters=(), rise=-4.0):
    """Prediction of a record that begins with a step and ends it after `duration`, and the bench's own waveforms."""
    truth = waves(STACK, {**STEP, "duration": duration}, effects=effects)
    setting = setting_of("force", build_shunt(LOAD), 1e-3, truth.sensed("force"), transducer, abrupt=True)
    instant = duration / 1e-3 - setting.motion.jumps[0]  # share of the step
    fall, jump = setting.motion.coefficients[setting.motion.jumps[0], 1], setting.motion.jumps[0]
    history = [name for name in Prediction(transducer, setting).nuisance_names if name.startswith("history")]
    nuisance = {"q": 0.0, "drive before": STEP["offset"], **dict.fromkeys(history, 0.0)}
    nuisance |= {f"jump{jump}": -fall * JUMP_PARTS * (instant - 0.5), f"rise{jump}": rise}
    prediction = Prediction(transducer, setting, parameters, np.array([*nuisance.values()]))
    assert prediction.nuisance_names == tuple(nuisance)
    (block,) = prediction.blocks(True)
    clear = np.arange(len(TIMES)) != setting.motion.jumps[0] + 1
    return prediction, block, truth, clear


def test_a_drive_does_not_ring_at_the_corners_of_a_ramp():
    time = np.arange(200.0)
    ramp = 100.0 + 45.0 * np.clip(time - 50.0, 0.0, 20.0) - 90.0 * np.clip(time - 120.0, 0.0, 10.0)
    assert corners_of(ramp).tolist() == [50, 70, 120, 130]
    coefficients, jumps, _ = drive_of(ramp)
    assert len(jumps) == 0
    assert coefficients[:, :2] == pytest.approx(np.column_stack([ramp[:-1], np.diff(ramp)]), abs=1e-9)
    assert np.abs(coefficients[:, 2:]).max() < 1e-9
    noisy = ramp + 0.05 * np.random.default_rng(1).standard_normal(len(ramp))
    assert {50, 70, 120, 130} <= set(corners_of(noisy).tolist())


@pytest.mark.parametrize("tones", [[5.0], [61.0], [0.5, 3.0, 11.0, 29.0, 43.0], [180.0]])
def test_what_is_smooth_has_no_corners(tones):
    values = sum(np.sin(2 * np.pi * f * TIMES + f) for f in tones)
    assert len(corners_of(values)) == 0


@pytest.mark.parametrize("corner", [98, 99, 100, 101, 102])
def test_a_corner_beside_a_jump(corner):
    time = np.arange(200.0)
    values = 2.0 * np.clip(time - corner, 0.0, None) + 900.0 * (time > 99.5)
    coefficients, jumps, _ = drive_of(values)
    assert jumps.tolist() == [99]
    assert coefficients[:, 0] == pytest.approx(values[:-1])
    assert coefficients.sum(axis=1) == pytest.approx(values[1:])


@pytest.mark.parametrize("delay", [2e-4, 6.5e-4])
def test_what_is_read_late_of_an_abrupt_start_has_already_moved(delay):
    device = build_transducer(STACK)
    prediction, _, _, _ = stepped(device, 1.0)
    truth = waves(STACK, STEP, times=np.union1d(TIMES, TIMES[1:] - delay))
    wanted = truth.at(TIMES - delay).sensed("voltage")[1:100]
    (block,) = prediction.blocks(False, channels=("voltage",), parts=4)
    setting, off = prediction.setting, []
    for abrupt in (True, False):
        course = Course(1e-3, setting.jumps, block.between, abrupt)
        read, _ = sensed([ChannelSkew(delay=delay)], (), {"voltage": 0.0}, course, block.values.copy(), None)
        off.append(np.abs(read[1:100, 0] - wanted).max())
    assert off[0] < 0.1 * off[1]


@pytest.mark.parametrize("duration", [1.0, 1.00035, 1.00093])
def test_ideal_steps_agree_with_the_bench(duration):
    """Operators turn where the charge does, within the step: a corner out of place is wrong by a tenth of a volt."""
    prediction, block, truth, clear = stepped(build_transducer(STACK), duration)
    for c, channel in enumerate(prediction.channels):
        wanted = truth.sensed(channel)
        assert np.abs(block.values[:, c] - wanted)[clear].max() < 2e-6 * np.abs(wanted).max(), channel


def test_friction_sees_what_overshoots_at_a_step():
    table = {"stiffness": 1e7, "threshold": 3e-7}
    device = build_transducer({**STACK, "effects": {"friction": table}})
    prediction, block, truth, clear = stepped(device, 1.0, effects=[("friction", table)])
    wanted = truth.sensed("displacement")
    found = block.values[:, prediction.channels.index("displacement")]
    # Its two ends of slip are 2 k r / k_E = 19 nm apart.
    assert np.abs(found - wanted)[clear].max() < 2e-10


@pytest.mark.parametrize("name, by", [("drive before", 1.0), ("jump1000", 20.0), ("rise1000", 1e-3)])
@pytest.mark.parametrize("rise", [-1.0, 1.0])
def test_derivatives_to_what_begins_and_to_when_it_ends(name, by, rise):
    device = build_transducer(STACK)
    prediction, block, _, _ = stepped(device, 1.00035, rise=rise)
    k = prediction.nuisance_names.index(name)
    sides = []
    for sign in (1.0, -1.0):
        nuisance = prediction.nuisance.copy()
        nuisance[k] += sign * by
        (side,) = Prediction(device, prediction.setting, (), nuisance).blocks(False)
        sides.append(side.values)
    wanted = (sides[0] - sides[1]) / (2.0 * by)
    for c in range(len(prediction.channels)):
        off = np.abs(block.derivatives[:, c, k] - wanted[:, c])
        rounding = 4.0 * np.finfo(float).eps / by * np.abs(block.values[:, c]).max()
        assert np.mean(off > 1e-5 * np.abs(wanted[:, c]).max() + rounding) < 0.01


@pytest.mark.parametrize("delay", [0.0, 0.4e-3, 2.3e-3])
def test_a_late_channel_jumps_without_ringing(delay):
    """Each side of the jump is delayed by itself: a spline across it would ring for tens of samples."""
    h, time = 1e-3, np.arange(200) * 1e-3
    before, after = np.sin(20.0 * time), 3.0 + np.cos(15.0 * time)
    values = np.where(time < 0.1 - 0.5 * h, before, after)[:, None]
    parameters = (Parameter(("effects", 0, "delay"), "s", "linear", 0.0, np.inf),)
    slopes = np.zeros((200, 1, 1))
    found, slopes = sensed(
        [ChannelSkew(delay=delay)], parameters, {"voltage": 0.0}, Course(h, [99]), values.copy(), slopes
    )
    late = time - delay
    wanted = np.where(late < 0.1 - 0.5 * h, np.sin(20.0 * late), 3.0 + np.cos(15.0 * late))
    rate = np.where(late < 0.1 - 0.5 * h, 20.0 * np.cos(20.0 * late), -15.0 * np.sin(15.0 * late))
    # Nobody knows the samples between the last before the jump and the first after it.
    clear = (late > 2 * h) & ((late <= 0.099 + 1e-9) | (late >= 0.1 - 1e-9)) & (abs(late - 0.1) > 1.5 * h)
    assert np.abs(found[:, 0] - wanted)[clear].max() < 1e-5
    assert np.abs(slopes[:, 0, 0] + rate)[clear].max() < 0.02
    assert np.all((found[:, 0] >= -1.001) & (found[:, 0] <= 4.001))


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
def test_a_rise_within_a_sample_is_that_of_a_record_that_shows_it(share):
    """What overshoots turns friction back: a rise that lasts leaves another displacement than a jump."""
    friction = {"friction": {"stiffness": 1e7, "threshold": 3e-7}}
    device, parts = build_transducer({**STACK, "effects": friction}), 1024
    time = np.arange(200 * parts + 1) / parts
    shown = 900.0 * np.clip((time - 99.5) / share + 0.5, 0.0, 1.0)
    fine = setting_of("force", build_shunt(LOAD), 1e-3 / parts, shown, device)
    assert len(fine.motion.jumps) == 0
    wanted = next(Prediction(device, fine).blocks(False, size=len(shown))).values[::parts]
    setting, off = setting_of("force", build_shunt(LOAD), 1e-3, shown[::parts], device), []
    for rise in (np.log(share * JUMP_PARTS / RISE_PARTS), -4.0):
        (block,) = Prediction(device, setting, (), np.array([0.0] * 6 + [rise])).blocks(False)
        off.append(np.abs(block.values - wanted)[101:].max(axis=0) / np.abs(wanted).max(axis=0))
    assert off[0].max() < 1e-5
    assert off[1].max() > 5e-4


@pytest.mark.parametrize("tension", ["open", "closed"])
def test_a_contact_under_tension_agrees_with_the_bench(tension):
    table, sine = {"coefficient": 3e-9, "tension": tension}, {**SINE, "offset": 50.0}
    truth = waves(LINEAR, sine, effects=[("contact_compliance", table)])
    found, _ = predicted(
        build_transducer({**LINEAR, "effects": {"contact_compliance": table}}), "force", truth.sensed("force")
    )
    wanted = truth.sensed("displacement")
    assert np.abs(found["displacement"] - wanted).max() < 1e-6 * np.abs(wanted).max()


def test_elements_of_any_kind_take_the_same_compiled_code():
    """Whole exponents alone once were integers, for which all was compiled anew."""
    for effects in ({"stiffening": {"cubic_stiffness": 1e18}}, {"friction": {"stiffness": 1e7, "threshold": 3e-7}}):
        predicted(build_transducer({**LINEAR, "effects": effects}), "force", np.sin(TIMES[:50]))
    assert len(propagate_block.nopython_signatures) == 1
