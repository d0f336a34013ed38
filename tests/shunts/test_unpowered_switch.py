"""Switches that the dc side has to power first: a rectifier until then, and the switched circuit from then on."""

import pytest
from messages import is_sentence
from oracles.ngspice import needs_ngspice
from studies import BENCH

from piezoharvest import SSHC, ParallelSSHI, Rectifier, SineForce, Storage, System, Transducer, simulate
from piezoharvest.description.parameters import ParameterError
from piezoharvest.spice.simulators.comparison import compare

DEVICE, DRIVE = Transducer(**BENCH), SineForce(amplitude=0.02, frequency=50.6)
DC = {"smoothing_capacitance": 1e-6, "load_resistance": 1e6}
LOOP = {"inductance": 0.1, "quality": 5.0}
CAPACITORS = {"flip_capacitances": (40e-9,), "switch_resistance": 100.0}


def run(shunt, transient=None):
    found = simulate(System(DEVICE, shunt), DRIVE, transient=transient, attenuation=False)
    assert found.converged, found.message
    assert abs(found.energy["closure"]) < 1e-10
    return found


def test_rectifier_until_it_starts():
    """The time is that after which a rectifier with a lockout, but without its load, is told to turn on."""
    found = run(ParallelSSHI(**DC, **LOOP, start_voltage=3.0), 0.2)
    lockout = Storage(turn_on=3.0, turn_off=1.0, max_voltage=30.0)
    assert found.time_to_start == pytest.approx(run(Rectifier(**DC, storage=lockout), 0.2).time_to_turn_on, rel=1e-9)
    events = list(zip(found.waveforms.event_names, found.waveforms.event_times, strict=True))
    assert min(t for name, t in events if name == "switch closes") >= found.time_to_start


@pytest.mark.parametrize("kind, keys", [(ParallelSSHI, LOOP), (SSHC, CAPACITORS)])
def test_steady_state_that_a_start_comes_to(kind, keys):
    """Of two steady states the one with the switch at work where the rectifier alone reaches the voltage."""
    plain = run(kind(**DC, **keys))
    assert run(kind(**DC, **keys, start_voltage=3.0)).harvested_power == pytest.approx(plain.harvested_power, rel=1e-9)
    never = run(kind(**DC, **keys, start_voltage=30.0))
    assert never.harvested_power == pytest.approx(run(Rectifier(**DC)).harvested_power, rel=1e-9)
    assert "switch closes" not in never.waveforms.event_names


def test_control_that_its_load_takes_the_power_from():
    """A supply empties the capacitor below the voltage of the control: it starts again and again."""
    storage = Storage(turn_on=8.0, turn_off=2.0, power=2e-3)
    shunt = ParallelSSHI(
        smoothing_capacitance=1e-6, **LOOP, storage=storage, start_voltage=4.0, stop_voltage=3.0, gate_energy=1e-9
    )
    names = run(shunt, 1.0).waveforms.event_names
    assert names.count("switch is powered") > 1
    assert names.count("switch is powered") - names.count("switch loses its power") in (0, 1)


@pytest.mark.parametrize(
    "key, keys",
    [
        ("start_voltage", {"dc_voltage": 1.0, "start_voltage": 1.0}),
        ("stop_voltage", {**DC, "stop_voltage": 1.0}),
        ("stop_voltage", {**DC, "start_voltage": 1.0, "stop_voltage": 1.0}),
    ],
)
def test_what_is_refused(key, keys):
    with pytest.raises(ParameterError) as caught:
        ParallelSSHI(**LOOP, **keys)
    assert caught.value.key == key
    assert is_sentence(caught.value.message)


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize(
    "shunt",
    [
        ParallelSSHI(**DC, **LOOP, start_voltage=3.0),
        SSHC(**DC, **CAPACITORS, start_voltage=3.0, stop_voltage=1.0),
        ParallelSSHI(**DC, **LOOP, smoothing_resistance=2e3, gate_energy=1e-8, control_power=1e-7),
    ],
    ids=["coil", "capacitors", "real parts"],
)
def test_against_ngspice(shunt):
    figures, trusted = compare(System(DEVICE, shunt), DRIVE)
    assert trusted
    for figure in figures:
        assert abs(figure.difference) < 0.01, figure
