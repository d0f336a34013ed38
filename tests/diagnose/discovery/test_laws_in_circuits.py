"""Laws without a name of diodes, switched loops and dc loads, against records that SciPy made with events."""

from types import SimpleNamespace

import numpy as np
import pytest
from nameless import BEAM, Drive, Laws
from remembering import searched
from scipy.integrate import solve_ivp
from switched import COIL, DC, DURATION, RATE, switched, switched_campaign

from piezoharvest import SineForce, System, Transducer, diagnose, simulate
from piezoharvest.description.effects import DiodeDropError
from piezoharvest.description.effects.nameless.circuit_places import DcLoad, Diode, SwitchLoop
from piezoharvest.description.effects.nameless.forms import Corners, Knee, Line, Power
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import Play, Relaxation, Resonance
from piezoharvest.description.effects.nameless.places import Reading
from piezoharvest.description.effects.nameless.shapes import Shape, Shockley
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import SSDI, Rectifier, Resistor
from piezoharvest.description.shunts.curves.voltage_curve import VoltageCurve
from piezoharvest.diagnose.discovery.forms.wording import formula
from piezoharvest.diagnose.discovery.law_fits import law_parameters
from piezoharvest.diagnose.discovery.result import as_json, discovery
from piezoharvest.diagnose.discovery.verdict import _with_drop_free
from piezoharvest.identify.fitting.data import Data
from piezoharvest.predict.circuit.circuit_prediction import CircuitPrediction
from piezoharvest.predict.circuit.setting import circuit_setting
from piezoharvest.predict.parameters import STEP, put, value_at
from piezoharvest.predict.prediction import PredictionError

DRIVE = Drive((0.05,), (49.5,))
LABELS = {
    "diode": ("rectifier", Rectifier(**DC)), "switch_loop": ("ssdi", SSDI(**COIL)),
    "load": ("rectifier", Rectifier(**DC)),
}  # fmt: skip
PLACES = {"diode": Diode(reach=2e-4), "switch_loop": SwitchLoop(reach=1.2e-2), "load": DcLoad(reach=16.0)}
# A path of two diodes, the voltage of each of which grows as (i/i1)^0.4; a loop with what grows as i |i|^1.5.
SIZE, AT = 0.06, 1e-4
ROOT, BEND, LOOP_SIZE, LOOP_AT = 0.4, 2.5, 3.0, 1e-2
CLAMP, CLAMP_AT = 5e-6, 3.0  # S above V: LEDs across a load that comes to 14 V without them


def path_current(excess):
    """Current of a path at a voltage above its drops: the inverse of 2 SIZE (i/AT)^ROOT."""
    return AT * (max(excess, 0.0) / (2.0 * SIZE)) ** (1.0 / ROOT)


def loop_voltage(i):
    return LOOP_SIZE * np.sign(i) * (np.abs(i) / LOOP_AT) ** BEND


def clamp_current(dc):
    return CLAMP * max(dc - CLAMP_AT, 0.0)


HIDDEN = {
    "diode": Laws(diode=path_current), "switch_loop": Laws(loop=loop_voltage), "load": Laws(dc_load=clamp_current)
}  # fmt: skip
# In line with the coil, whose sqrt(L C) is 141 us: 300 ohm beside 30 mH, or beside 1.33 uF.
LINE_RESISTANCE, LINE_TIME = 300.0, {"inductance": 1e-4, "capacitance": 4e-4}
IN_LINE = {
    "inductance": Laws(line=(LINE_RESISTANCE, LINE_RESISTANCE * LINE_TIME["inductance"])),
    "capacitance": Laws(line=(LINE_RESISTANCE, LINE_TIME["capacitance"] / LINE_RESISTANCE), of_line="capacitance"),
}
TRUE = {
    "diode": Power(factor=SIZE, exponent=ROOT, scale=AT, odd=False),
    "switch_loop": Power(factor=LOOP_SIZE, exponent=BEND, scale=LOOP_AT, odd=False),
    "load": Knee(factor=CLAMP, knee=CLAMP_AT, sides=1),
}


def prediction(name, *laws, parameters=()):
    count = 500 if name == "load" else 300  # until its capacitor is charged
    device = Transducer(**BEAM, effects=laws)
    setting = circuit_setting("force", LABELS[name][1], 1.0 / RATE, DRIVE(np.arange(count) / RATE), device)
    return CircuitPrediction(device, setting, parameters)


def values(of):
    (block,) = of.blocks(False, channels=["displacement", "voltage"])
    return block.values


@pytest.mark.parametrize("name", HIDDEN)
def test_a_law_acts_on_the_specimen_as_in_another_integrator(name):
    true = switched(LABELS[name][0], HIDDEN[name], DRIVE)
    found = values(prediction(name, Law(place=PLACES[name], form=TRUE[name])))
    without = values(prediction(name))
    for k, channel in enumerate(("displacement", "voltage")):
        wanted = true[channel][: len(found)]
        # A broken line stands for the curve; a voltage that is being inverted differs by what its instant does.
        off, before = (np.sqrt(np.mean((each[:, k] - wanted) ** 2)) for each in (found, without))
        assert off < 0.02 * before, channel


def law_in_line(beside, factor=LINE_RESISTANCE):
    """The law of a resistance with this beside it."""
    behind = beside == "inductance"
    memory = Relaxation(time_constant=LINE_TIME[beside], behind=behind)
    return Law(place=PLACES["switch_loop"], form=Line(factor=-factor if behind else factor), memory=memory)


@pytest.mark.parametrize("beside", IN_LINE)
def test_what_lags_in_a_loop_acts_as_in_another_integrator(beside):
    true = switched("ssdi", IN_LINE[beside], DRIVE)
    found, without = values(prediction("switch_loop", law_in_line(beside))), values(prediction("switch_loop"))
    for k, channel in enumerate(("displacement", "voltage")):
        wanted = true[channel][: len(found)]
        off, before = (np.sqrt(np.mean((each[:, k] - wanted) ** 2)) for each in (found, without))
        assert off < 0.005 * before, channel


FORMS = {
    "table": Corners(knots=(0.0, 2e-5, 5e-5), kinks=(3e3, -1e3, -500.0)),
    "line": Line(factor=2e3),
    "knee": Knee(factor=3e3, knee=2e-5, sides=1),
    "power": TRUE["diode"],
    "shockley": Shockley(factor=0.03, scale=1e-6, resistance=300.0, knots=(0.0, 1e-5)),
    "log": Shape(factor=0.03, scale=1e-5, curve="log", bent=False, knots=(0.0, 1e-5)),
}


@pytest.mark.parametrize(
    ("name", "form"),
    [
        *(("diode", form) for form in FORMS.values()),
        ("switch_loop", TRUE["switch_loop"]),
        ("switch_loop", Corners(knots=(0.0, 1e-3), kinks=(50.0, 100.0))),
        ("switch_loop", Knee(factor=-50.0, knee=1e-3, sides=1)),
        ("load", TRUE["load"]),
        ("load", Corners(knots=(0.0, 1.5, 3.0), kinks=(1e-6, 2e-6, -1e-6))),
        ("load", Power(factor=2e-6, exponent=3.0, scale=3.0, odd=False)),
    ],
)
def test_derivatives_are_those_of_differences(name, form):
    agrees_with_differences(name, Law(place=PLACES[name], form=form))


@pytest.mark.parametrize("beside", IN_LINE)
def test_derivatives_of_what_lags_in_a_loop_are_those_of_differences(beside):
    agrees_with_differences("switch_loop", law_in_line(beside))
    agrees_with_differences("switch_loop", law_in_line(beside, factor=0.0))


def agrees_with_differences(name, law):
    """Assert that a prediction has the derivatives of its differences; what a law of zero lags by has none."""
    parameters = law_parameters(law, 0)
    whole = prediction(name, law, parameters=parameters)
    (block,) = whole.blocks(channels=["displacement", "voltage"])
    for k, parameter in enumerate(parameters):
        inner = parameter.inner(value_at(whole.transducer, parameter.path))
        step = 1e-4 * (abs(inner) or 1.0)

        def moved(by, parameter=parameter, inner=inner):
            device = put(whole.transducer, parameter.path, float(parameter.outer(inner + by)))
            return values(CircuitPrediction(device, whole.setting))

        difference = (moved(step) - moved(-step)) / (2.0 * step)
        size = np.abs(difference).max(axis=0)
        assert np.all(size > 0.0) or (law.absent and parameter.path[-1] == "time_constant")
        assert np.all(np.abs(block.derivatives[..., k] - difference).max(axis=0) <= 5e-3 * size), parameter.name


@pytest.mark.parametrize("name", PLACES)
def test_a_law_that_is_zero_changes_nothing_and_a_small_one_next_to_nothing(name):
    """A diode gets what drops a millivolt at its largest current, without which there is no derivative."""
    absent = Law(place=PLACES[name], form=Corners(knots=(0.0, 1e-5), kinks=(0.0, 0.0)))
    assert absent.connect(LABELS[name][1]) is LABELS[name][1]
    small = Law(place=PLACES[name], form=Corners(knots=(0.0, 1e-5), kinks=(1e-12 if name == "load" else 1e-6, 0.0)))
    difference = np.abs(values(prediction(name, small)) - values(prediction(name)))
    assert np.all(difference.max(axis=0) <= [2e-8, 2e-3])


def test_a_law_adds_to_the_curve_of_a_label():
    law = Law(place=PLACES["diode"], form=Line(factor=1000.0))
    curve = VoltageCurve(currents=(0.0, 1e-5, 1e-4), voltages=(0.0, 0.1, 0.2))
    found = law.connect(Rectifier(**DC, diode_curve=curve)).diode_curve
    for current in (0.0, 5e-6, 1e-5, 5e-5, 1e-4, 2e-4):
        wanted = curve.at(current) + (1000.0 + 1e-3 / PLACES["diode"].reach) * current
        assert found.at(current) == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("beside", IN_LINE)
def test_what_lags_in_a_loop_takes_energy_by_one_sign_of_its_factor(beside):
    law = law_in_line(beside)
    assert np.sign(law.form.factor) == law.passive_sign
    factor = next(each for each in law_parameters(law, 0) if each.path[-1] == "factor")
    assert (factor.lower, factor.upper) == ((-np.inf, 0.0) if law.passive_sign < 0 else (0.0, np.inf))
    for effects in ((law,), (law, law)):  # two are two parts in line
        device, drive = Transducer(**BEAM, effects=effects), SineForce(amplitude=0.05, frequency=49.5)
        found = simulate(System(device, SSDI(**COIL)), drive)
        assert found.converged and abs(found.energy["closure"]) < 1e-10
    assert len(law.connect(law.connect(SSDI(**COIL))).loop_sections.each) == 2


@pytest.mark.parametrize(
    ("place", "form", "memory"),
    [
        ("switch_loop", Knee(factor=1.0, knee=1e-3), Relaxation(time_constant=1e-4)),
        ("switch_loop", Line(factor=1.0), Play(threshold=1e-3)),
        ("switch_loop", Line(factor=1.0), Resonance(frequency=1e3, damping_ratio=0.1)),
        ("diode", Line(factor=1.0), Relaxation(time_constant=1e-4)),
    ],
)
def test_other_memories_are_refused_in_circuits(place, form, memory):
    with pytest.raises(ParameterError, match=place):
        Law(place=PLACES[place], form=form, memory=memory)


def test_a_formula_names_the_parts_in_line():
    assert formula(law_in_line("inductance")) == "300 ohm * (i - lag(i; 0.0001 s)), 300 ohm beside 0.03 H"
    assert formula(law_in_line("capacitance")) == "300 ohm * lag(i; 0.0004 s), 300 ohm beside 1.333e-06 F"


def test_circuits_without_the_part_stay_as_they_are():
    law = Law(place=PLACES["diode"], form=Line(factor=1000.0))
    for shunt in (Resistor(resistance=1e5), SSDI(**COIL)):
        assert law.connect(shunt) is shunt


@pytest.mark.slow
@pytest.mark.parametrize("name", HIDDEN)
def test_the_part_is_found_with_its_law(name, tmp_path):
    kinds = [LABELS[name][0]] * 3
    found = diagnose(switched_campaign(tmp_path, HIDDEN[name], kinds))
    assert found.verdict == "new_effect"
    (law,) = found.discovery
    assert law.place == name
    wanted = np.real(TRUE[name].values(law.input))
    # The diodes' constant drop is a parameter of its own: a curve is known but for it.
    shift = np.mean(law.value - wanted) if name == "diode" else 0.0
    assert np.mean(np.abs(law.value - wanted - shift) < 3.0 * law.std + 0.05 * np.abs(wanted).max()) > 0.95
    assert law.gain > 0.9


# Of an inversion of 0.44 ms, which has to be sampled: after it nothing but its loss is known.
FAST = 20000.0


def is_what_lags(law, beside):
    """Assert that a law has the kind, the time and the factor of the hidden one."""
    assert law.place == "switch_loop"
    assert as_json(law)["memory"]["kind"] == {"inductance": "lag", "capacitance": "relaxation"}[beside]
    true = {"slope": law_in_line(beside).form.factor, "time_constant": LINE_TIME[beside]}
    for name, wanted in true.items():
        value, std, _ = law.parameters[name]
        assert abs(value - wanted) < 3.0 * std < 0.2 * abs(wanted), name


@pytest.mark.slow
def test_a_resistance_beside_an_inductance_in_a_loop_is_diagnosed(tmp_path):
    found = diagnose(switched_campaign(tmp_path, IN_LINE["inductance"], ["ssdi"] * 3, rate=FAST))
    assert found.verdict == "new_effect"
    (law,) = found.discovery
    assert law.gain > 0.95
    is_what_lags(law, "inductance")


@pytest.mark.slow
def test_a_resistance_beside_a_capacitance_is_found_from_more_times_than_one(tmp_path):
    """From the best score alone a fit ended in a valley, at a third of the time constant."""
    found = searched(switched_campaign(tmp_path, IN_LINE["capacitance"], ["ssdi"] * 3, rate=FAST))
    is_what_lags(discovery(found.best, 1.0, 0.0, (), found.forms), "capacitance")


@pytest.mark.slow
def test_a_healthy_loop_that_is_sampled_as_fast_raises_no_alarm(tmp_path):
    found = diagnose(switched_campaign(tmp_path, Laws(), ["ssdi"] * 3, rate=FAST))
    assert found.verdict == "adequate"


def test_what_the_drive_s_sensor_shows_besides_is_refused_behind_a_circuit_instead_of_left_out():
    law = Law(place=Reading("force", "force"), form=Knee(factor=0.3, knee=0.01, sides=1))
    with pytest.raises(PredictionError, match=r"reading\.force"):
        values(prediction("diode", law))


@pytest.mark.parametrize(("drops", "free"), [((0.4, 0.4), True), ((0.4, 0.3), False)])
def test_a_drop_is_free_only_where_all_diodes_have_the_same_label(drops, free):
    """One value for diodes of two kinds would be wrong for one of them."""
    records = [record_behind(Rectifier(**{**DC, "diode_drop": drop})) for drop in drops]
    asked = []
    trials = SimpleNamespace(
        problem=SimpleNamespace(data=records), extended=lambda now, effect, aim: asked.append(effect) and None
    )
    start = SimpleNamespace(model=SimpleNamespace(transducer=Transducer(**BEAM)))
    assert _with_drop_free(trials, start) is start  # the fit of what was asked for has no solution here
    assert asked == ([DiodeDropError(diode_drop=0.4)] if free else [])


def record_behind(shunt):
    """A record of which nothing but its circuit is known."""
    setting = SimpleNamespace(shunt=shunt)
    return Data("r", "fit", None, setting, np.zeros(0), (), {}, {})


SATURATION, EMISSION, SERIES = 1e-8, 0.045, 800.0  # A, V, ohm: of one diode


def shockley_path(voltage):
    """Current of two diodes with resistances in series, by Newton's steps in the voltage of their junctions."""
    bare = 2.0 * EMISSION
    junctions = min(voltage, bare * np.log1p(max(voltage, 0.0) / (2.0 * SERIES) / SATURATION))
    for _ in range(60):
        grown = SATURATION * np.exp(junctions / bare)
        step = (junctions + 2.0 * SERIES * (grown - SATURATION) - voltage) / (1.0 + 2.0 * SERIES * grown / bare)
        junctions -= step
        if abs(step) < 1e-12:
            break
    return SATURATION * np.expm1(junctions / bare)


def behind_shockley_diodes(drive):
    """True channels of a record behind a bridge of such diodes, which conduct at any voltage: no events."""
    m, b, k, T, C = (BEAM[name] for name in ("mass", "damping", "stiffness", "coupling", "capacitance"))

    def slopes(t, y):
        x, u, v, dc = y.tolist()
        up, down = shockley_path(v - dc), shockley_path(-v - dc)
        force, drain = drive(t) - b * u - k * x + T * v, dc / DC["load_resistance"]
        return [u, force / m, (-T * u - up + down) / C, (up + down - drain) / DC["smoothing_capacitance"]]

    t = np.arange(round(DURATION * RATE)) / RATE
    x, _, v, dc = solve_ivp(slopes, (0.0, t[-1]), np.zeros(4), "LSODA", t, rtol=1e-9, atol=1e-12).y
    return {"time_s": t, "force": drive(t), "displacement": x, "voltage": v, "dc_voltage": dc}


@pytest.mark.slow
def test_diodes_of_a_constant_drop_by_their_label_are_found_to_follow_shockley(tmp_path, monkeypatch):
    """The label says 0.4 V whatever the current: that constant goes, and the whole curve takes its place."""
    monkeypatch.setattr("switched.switched", lambda kind, laws, drive: behind_shockley_diodes(drive))
    found = diagnose(switched_campaign(tmp_path, Laws(), ["rectifier"] * 3))
    assert found.verdict == "new_effect"
    (law,) = found.discovery
    assert law.place == "diode" and law.gain > 0.95
    # Of the whole curve a constant is the least certain: no channel shows the dc voltage.
    assert [each.effect.diode_drop for each in found.effects] == [0.0]
    off = law.value - (EMISSION * np.log1p(law.input / SATURATION) + SERIES * law.input)
    assert np.mean(np.abs(off) < 3.0 * law.std) > 0.95
    assert np.abs(off - off.mean())[law.input > 0.02 * law.input.max()].max() < 2e-3
    for name, true in (("factor", EMISSION), ("scale", SATURATION), ("resistance", SERIES)):
        value, std, _ = law.parameters[name]
        assert abs(value - true) < 3.0 * std, name


@pytest.mark.parametrize("curve", ["tanh", "exponential"])
def test_a_curve_that_comes_to_its_end_far_below_the_largest_current_has_derivatives(curve):
    """Far out its second derivative is zero, whose root has no derivative: the fit of such a law did not move."""
    scale, apart, place = -2e-4 if curve == "exponential" else 2e-4, 1e-4, PLACES["switch_loop"]

    def points(scale):
        return [np.ravel(each) for each in place.points(put(form, ("scale",), scale))]

    form = Shape(factor=0.8, scale=scale, curve=curve, bent=False)
    found = [np.imag(each) / STEP for each in points(scale + 1j * STEP)]
    above, below = points(scale * (1.0 + apart)), points(scale * (1.0 - apart))
    for slope, more, less in zip(found, above, below, strict=True):
        apart_by = np.real(more - less) / (2.0 * apart * scale)
        np.testing.assert_allclose(slope, apart_by, rtol=0.0, atol=1e-3 * np.abs(apart_by).max())
