"""Laws with a memory: predicted and simulated as SciPy integrates them, found at their place, closing their energy."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from nameless import BEAM, Drive, Gentle, Laws, nameless_campaign
from remembering import delayed, lagging, relaxing, resonating, ringing, rubbing, searched, spring_with, with_play
from scipy.integrate import cumulative_simpson

from piezoharvest import Open, Resistor, SineForce, System, Transducer, simulate
from piezoharvest.description.effects.nameless.forms import Knee, Line
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import CHARGE, DIRECT, RATE, Delay, Play, Relaxation, Resonance
from piezoharvest.description.effects.nameless.places import Capacitor, Electrodes, Load, Reading, Spring
from piezoharvest.description.parameters import ParameterError
from piezoharvest.diagnose.discovery.law_fits import LawFit, fitted, law_parameters, score, without_law
from piezoharvest.diagnose.discovery.result import as_json, discovery
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.identification import identify
from piezoharvest.identify.preparation import prepared
from piezoharvest.predict.discrete_model import setting_of
from piezoharvest.predict.prediction import Prediction

DRIVE, LOAD, RATE_OF_SAMPLES = Drive((0.02, 0.01), (48.0, 53.0)), 1e5, 8000.0
SPRINGS = {
    "play": (Law(place=Spring(), form=Line(factor=200.0), memory=Play(threshold=3e-5)), rubbing(200.0, 3e-5)),
    "relaxation": (
        Law(place=Spring(), form=Line(factor=-60.0), memory=Relaxation(time_constant=4e-3)),
        relaxing(60.0, 4e-3),
    ),
    "resonance": (
        Law(place=Spring(), form=Line(factor=-40.0), memory=Resonance(frequency=70.0, damping_ratio=0.1)),
        resonating(40.0, 70.0, 0.1),
    ),
}


def predicted(law, drive, rate=RATE_OF_SAMPLES):
    setting = setting_of("force", Resistor(resistance=LOAD), 1.0 / rate, drive)
    run = Prediction(Transducer(**BEAM, effects=(law,)), setting, relaxed=True)
    (block,) = run.blocks(False, channels=["displacement", "voltage"])
    return block.values.T


@pytest.mark.parametrize("name", SPRINGS)
def test_a_spring_with_a_memory_moves_as_an_independent_integration(name):
    law, memory = SPRINGS[name]
    true = spring_with(memory, DRIVE, LOAD, 0.06, RATE_OF_SAMPLES)
    plain = predicted(Law(place=Spring(), form=Line(factor=0.0), memory=law.memory), true["force"])
    for channel, values, without in zip(("displacement", "voltage"), predicted(law, true["force"]), plain, strict=True):
        assert np.abs(values - true[channel]).max() < 2e-4 * np.ptp(true[channel]), channel
        assert np.abs(without - true[channel]).max() > 0.01 * np.ptp(true[channel])  # it matters


@pytest.mark.parametrize(
    ("memory", "reading"),
    [
        (Play(threshold=5e-5), lambda t, x: with_play(x, 5e-5)),
        (Relaxation(time_constant=2e-3, behind=True), lambda t, x: lagging(t, x, 2e-3)),
        (Resonance(frequency=200.0, damping_ratio=0.3, behind=True), lambda t, x: ringing(t, x, 200.0, 0.3)),
    ],
    ids=lambda each: getattr(each, "kind", ""),
)
def test_a_reading_with_a_memory_is_that_of_an_independent_filter(memory, reading):
    t = np.arange(800) / RATE_OF_SAMPLES
    drive = DRIVE(t)
    place = Reading("displacement", "displacement")
    truth, _ = predicted(Law(place=place, form=Line(factor=0.0), memory=memory), drive)
    weight = -1.0 if isinstance(memory, Play) else 1.0  # the reading then has the memory's output in its place
    read, _ = predicted(Law(place=place, form=Line(factor=weight), memory=memory), drive)
    assert np.abs(read - reading(t, truth)).max() < 2e-3 * np.ptp(truth)
    assert np.abs(read - truth).max() > 0.01 * np.ptp(truth)


@pytest.mark.parametrize(
    "law",
    [
        *(law for law, _ in SPRINGS.values()),
        Law(place=Capacitor(), form=Line(factor=-6e-9), memory=Play(threshold=0.5)),
        Law(place=Capacitor(), form=Line(factor=8e-9), memory=Relaxation(time_constant=4e-3)),
        Law(place=Capacitor(), form=Line(factor=4e-9), memory=Resonance(frequency=80.0, damping_ratio=0.2)),
        Law(place=Electrodes(), form=Line(factor=4e-6), memory=Relaxation(time_constant=4e-3)),
        Law(place=Load(), form=Line(factor=4e-6), memory=Relaxation(time_constant=4e-3)),
    ],
    ids=lambda law: law.name,
)
def test_the_energy_of_a_memory_closes_and_it_takes_some(law):
    run = simulate(
        System(Transducer(**BEAM, effects=(law,)), Resistor(resistance=LOAD)), SineForce(amplitude=0.02, frequency=50.0)
    )
    assert run.converged
    assert abs(run.energy["closure"]) < 1e-9
    assert run.energy[law.name] > 1e-3 * run.energy["mechanical_in"]


@pytest.mark.parametrize("shunt", [Open(), Resistor(resistance=2e5)], ids=lambda each: each.kind)
def test_a_capacitor_with_play_has_the_charge_of_its_stop(shunt):
    """Charge from the coupling and the current, against C v + f stop(v; r) of SciPy's and NumPy's own."""
    factor, threshold = -1.2e-8, 2.0
    law = Law(place=Capacitor(), form=Line(factor=factor), memory=Play(threshold=threshold))
    device = Transducer(**BEAM, effects=(law,))
    run = simulate(System(device, shunt), SineForce(amplitude=0.3, frequency=45.0), transient=0.3, samples=20000)
    waves, v = run.waveforms, run.waveforms.voltage
    assert np.ptp(v) > 8 * threshold
    stop = v - with_play(v, threshold)
    charge = device.coupling * waves.displacement + device.capacitance * v + factor * stop
    drawn = cumulative_simpson(waves.current, x=waves.time, initial=0.0)
    np.testing.assert_allclose(charge, -drawn, rtol=0, atol=1e-6 * device.capacitance * np.ptp(v))
    assert np.abs(factor * stop).max() > 0.01 * np.abs(device.capacitance * v).max()


@pytest.mark.parametrize("factor", [-1.0, -1.5])
def test_a_capacitor_with_more_play_than_capacitance_is_refused(factor):
    law = Law(place=Capacitor(), form=Line(factor=factor * BEAM["capacitance"]), memory=Play(threshold=2.0))
    system = System(Transducer(**BEAM, effects=(law,)), Open())
    with pytest.raises(ParameterError, match="must be above minus its capacitance"):
        simulate(system, SineForce(amplitude=0.3, frequency=45.0))


def test_a_reading_with_a_memory_moves_nothing():
    law = Law(place=Reading("voltage", "voltage"), form=Line(factor=1.0), memory=Play(threshold=0.1))
    with_it, without = (
        simulate(
            System(Transducer(**BEAM, effects=effects), Resistor(resistance=LOAD)),
            SineForce(amplitude=0.02, frequency=50.0),
        )
        for effects in ((law,), ())
    )
    assert with_it.harvested_power == without.harvested_power


def test_a_memory_of_a_port_takes_energy_only():
    signs = {
        (kind.__name__, port): kind.signs.get(port)
        for kind in (Play, Relaxation, Resonance)
        for port in (RATE, CHARGE, DIRECT)
    }
    assert signs["Resonance", DIRECT] is None  # a current that follows gives energy above the resonance
    law = SPRINGS["relaxation"][0]
    factor = next(p for p in law_parameters(law, 0) if p.path[-1] == "factor")
    assert (factor.lower, factor.upper) == (-np.inf, 0.0)


STACK = [
    (Drive((450.0,), (4.0,), 550.0), 97780.0),
    (Drive((300.0, 150.0), (3.0, 7.3), 500.0), 51430.0),
    (Drive((350.0,), (5.0,), 450.0), 97780.0),
]


def found_in(folder, laws, drive=Drive):
    """What a search finds in the fitted records of a campaign."""
    records = [(drive(each.amplitudes, each.frequencies, each.offset), load) for each, load in STACK]
    return searched(nameless_campaign(folder, "stack", laws, records, rate=400.0, duration=1.5))


def test_what_the_sensor_of_the_force_shows_besides_does_not_act():
    """A kinked reading of the drive: the rest of what is shown moves the specimen."""
    shown = DRIVE(np.arange(2000) / RATE_OF_SAMPLES)
    knee = Knee(factor=0.3, knee=0.012, sides=1)
    found = predicted(Law(place=Reading("force", "force"), form=knee), shown)
    wanted = predicted(Law(place=Spring(), form=Line(factor=0.0)), shown - knee.values(shown))
    without = predicted(Law(place=Spring(), form=Line(factor=0.0)), shown)
    assert np.all(np.abs(found - wanted).max(axis=1) < 2e-3 * np.abs(without - wanted).max(axis=1))


@pytest.mark.slow
def test_a_play_in_the_reading_of_the_force_is_found_there(tmp_path):
    half, share = 40.0, 0.1
    laws = Laws(reading={"force": lambda true: share * (with_play(true["force"], half) - true["force"])})
    found = found_in(tmp_path, laws)
    law = found.best.law
    assert (law.place.name, law.place.input, law.memory.kind) == ("reading.force", "force", "play")
    # Of what is shown, which within the play is less than what acts.
    assert law.memory.threshold == pytest.approx(half * (1.0 - share), rel=0.01)
    assert law.form.factor == pytest.approx(-share / (1.0 - share), rel=0.01)
    assert not found.close


def test_a_law_with_states_leaves_a_fit_without_them(tmp_path):
    """What a fit knew of the beginnings of a memory goes with the law."""
    records = [(Drive((0.02,), (48.0,)), LOAD), (Drive((0.02,), (52.0,)), LOAD)]
    campaign = nameless_campaign(tmp_path, "beam", Laws(), records, rate=1000.0, duration=0.3)
    problem = Problem(prepared(campaign, "fit"), campaign.transducer, ("displacement",))
    base = identify(campaign, offsets=("displacement",)).found
    base = replace(base, model=replace(base.model, at_rest=False))
    law = Law(place=Spring(), form=Line(factor=-1.0), memory=Relaxation(time_constant=0.02))
    with_it = fitted(problem, base, law, np.linspace(-1e-4, 1e-4, 9))
    bare = without_law(problem, with_it)
    sizes = [len(each) for each in bare.nuisance]
    assert sizes == [len(each) for each in base.nuisance] < [len(each) for each in with_it.found.nuisance]
    assert bare.information.shape == base.information.shape
    assert score(problem, bare, Law(place=Spring(), form=Knee(factor=0.0, knee=1e-5)), with_it.visited) is not None


@pytest.mark.parametrize(("frequency", "ends"), [(400.0, True), (60.0, False)])
def test_a_memory_at_the_end_of_its_range_is_none(frequency, ends):
    """A resonance that was looked for about 40 Hz and has gone to ten times as much is a straight line."""
    begun = Law(place=Spring(), form=Line(factor=-1.0), memory=Resonance(frequency=40.0, damping_ratio=0.2))
    moved = Law(place=Spring(), form=Line(factor=-1.0), memory=Resonance(frequency=frequency, damping_ratio=0.2))
    model = Model(Transducer(**BEAM, effects=(moved,)), tuple(law_parameters(begun, 0)), ())
    found = LawFit(SimpleNamespace(model=model), np.linspace(-1.0, 1.0, 3))
    assert found.memory_at_its_end is ends


def test_a_delay_of_less_than_a_millisecond_is_at_no_end():
    """Its bound of zero is none of a logarithm: all such delays were put down as memories that a fit had let go."""
    late = Law(place=Reading("voltage", "voltage"), form=Line(factor=1.0), memory=Delay(delay=4e-5))
    model = Model(Transducer(**BEAM, effects=(late,)), tuple(law_parameters(late, 0)), ())
    assert not LawFit(SimpleNamespace(model=model), np.linspace(-1.0, 1.0, 3)).memory_at_its_end


@pytest.mark.slow
def test_a_backlash_in_the_fixture_is_a_play_in_the_reading_of_the_displacement(tmp_path):
    half = 0.17638e-6
    laws = Laws(reading={"displacement": lambda true: with_play(true["displacement"], half) - true["displacement"]})
    found = found_in(tmp_path, laws)
    table = as_json(discovery(found.best, 1.0, 0.0, ()))
    assert (table["place"], table["input"]) == ("reading.displacement", "displacement")
    assert table["memory"]["kind"] == "play"
    threshold, slope = (table["parameters"][name] for name in ("threshold", "slope"))
    assert (threshold["unit"], slope["unit"]) == ("m", "m/m")
    # Between two samples a true motion turns later than its samples show.
    assert threshold["value"] == pytest.approx(half, abs=4.0 * threshold["std"])
    assert slope["value"] == pytest.approx(-1.0, abs=4.0 * slope["std"])
    assert table["memory"]["threshold"] == threshold["value"]
    assert table["formula"].endswith(" m)") and "stop(x; " in table["formula"]
    assert not found.close


@pytest.mark.slow
@pytest.mark.parametrize(
    ("channel", "memory", "reading", "name", "value"),
    [
        ("voltage", "lag", lambda t, x: lagging(t, x, 6e-3), "time_constant", 6e-3),
        ("voltage", "resonance", lambda t, x: ringing(t, x, 40.0, 0.3), "frequency", 40.0),
        ("voltage", "delay", lambda t, x: delayed(t, x, 1.3e-3), "delay", 1.3e-3),
    ],
)  # fmt: skip
def test_a_sensor_with_a_memory_is_found(channel, memory, reading, name, value, tmp_path):
    laws = Laws(reading={channel: lambda true: reading(true["time_s"], true[channel]) - true[channel]})
    found = found_in(tmp_path, laws, Gentle)  # a delay of a corner at the first sample is told from none
    table = as_json(discovery(found.best, 1.0, 0.0, ()))
    assert (table["place"], table["memory"]["kind"]) == (f"reading.{channel}", memory)
    assert table["memory"][name] == pytest.approx(value, rel=0.03)
