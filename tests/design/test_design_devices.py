"""Device properties and fields that are held: all candidates are compared with the same diodes and coils."""

import math
import re

import pytest

from piezoharvest.description.excitation import SineBase, SineForce
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import SECE, ParallelSSHI, Rectifier, Resistor, SeriesRL
from piezoharvest.description.shunts.curves.load_curve import LoadCurve
from piezoharvest.description.shunts.curves.loop_sections import LoopSections
from piezoharvest.description.shunts.curves.voltage_curve import VoltageCurve
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Electrode, Mode
from piezoharvest.design import design
from piezoharvest.design.drafts import Drafting, retuned
from piezoharvest.design.operation import operation_of
from piezoharvest.engine import simulate
from piezoharvest.study import DesignOptions, StudyError, load_study

SCHOTTKY = Rectifier(smoothing_capacitance=1e-5, load_resistance=2e5, diode_drop=0.2)
KINDS = ("rectifier", "parallel_sshi", "series_sshi", "sece")


def shunts_of(result):
    return {candidate.shunt.kind: candidate.shunt for candidate in result.candidates}


def test_diodes_of_one_template_are_those_of_all(host, run):
    result = run(host(0.025, 50), 50.3, shunts=[SCHOTTKY], candidates=KINDS, phase_lag="fixed")
    assert {shunt.diode_drop for shunt in shunts_of(result).values()} == {0.2}
    assert any(note == "sece: assumed diodes of 0.2 V as in the study's rectifier" for note in result.notes)
    assert not any("same devices" in note for note in result.notes)


def test_quality_of_one_template_is_that_of_all(host, run):
    coil = ParallelSSHI(smoothing_capacitance=1e-5, load_resistance=2e5, quality=9.0, inductance=0.1)
    result = run(host(0.025, 50), 50.3, shunts=[coil], candidates=KINDS, phase_lag="fixed")
    assert shunts_of(result)["series_sshi"].quality == 9.0
    assert any("quality 9 as in the study's parallel_sshi" in note for note in result.notes)


def test_devices_that_differ_are_told_with_their_units(host, run):
    coil = ParallelSSHI(smoothing_capacitance=1e-5, load_resistance=2e5, quality=9.0, inductance=0.1)
    bare = SECE(gate_energy=6.3e-9)
    result = run(host(0.025, 50), 50.3, shunts=[coil, bare], candidates=["parallel_sshi", "sece"], phase_lag="fixed")
    (note,) = (note for note in result.notes if "gate_energy is" in note)
    assert note.endswith("same devices: gate_energy is 0 J in parallel_sshi, 6.3e-09 J in sece")


def test_coil_capacitor_and_control_of_one_template_are_those_of_all(host, run):
    parts = {"inductance": 0.05, "core_resistance": 2e4, "switch_resistance": 20.0, "gate_energy": 1e-9}
    side = {"smoothing_capacitance": 1e-5, "load_resistance": 2e5, "smoothing_resistance": 50.0, "control_power": 1e-7}
    coil = ParallelSSHI(**parts, **side, quality=9.0)
    result = run(host(0.025, 50), 50.3, shunts=[coil, SeriesRL(inductance=150.0, resistance=1e4)], candidates=KINDS)
    found = shunts_of(result)
    for name, value in parts.items():
        assert getattr(found["series_sshi"], name) == value
    assert found["rectifier"].smoothing_resistance == 50.0
    assert (found["sece"].gate_energy, found["sece"].control_power) == (1e-9, 1e-7)
    assert found["sece"].core_resistance is None  # without a coil
    assert "series_sshi: assumed core_resistance = 20000 ohm as in the study's parallel_sshi" in result.notes
    assert not any("same devices" in note for note in result.notes)


def test_curves_of_one_template_are_those_of_all_that_can_have_them(host, run):
    diodes = VoltageCurve(currents=(0.0, 1e-6, 1e-4), voltages=(0.0, 0.1, 0.2))
    closed = VoltageCurve(currents=(0.0, 1e-5, 1e-2), voltages=(0.0, 0.3, 0.35))
    lagging = LoopSections(resistances=(40.0,), time_constants=(1e-4,), beside=("inductance",))
    coil = ParallelSSHI(
        smoothing_capacitance=1e-5, load_resistance=2e5, quality=6.0, inductance=0.1, diode_curve=diodes,
        switch_curve=closed, loop_sections=lagging,
    )  # fmt: skip
    kinds = ("rectifier", "parallel_sshi", "series_sshi", "self_powered_sshi")
    result = run(host(0.025, 50), 50.3, shunts=[coil], candidates=kinds, phase_lag="fixed")
    found = shunts_of(result)
    assert [kind for kind, shunt in found.items() if shunt.diode_curve == diodes] == [
        kind for kind in found if kind != "self_powered_sshi"
    ]
    for name, given in (("switch_curve", closed), ("loop_sections", lagging)):
        assert {kind for kind, shunt in found.items() if getattr(shunt, name, None) == given} == {
            "parallel_sshi", "series_sshi",
        }  # fmt: skip
    assert "rectifier: assumed diode_curve as in the study's parallel_sshi" in "\n".join(result.notes)


def test_what_a_load_takes_beside_its_resistance_is_that_of_all_with_such_a_load(host, run):
    """Without it, candidates of other kinds would feed another load."""
    load = LoadCurve(voltages=(0.0, 2.0, 3.0), currents=(0.0, 0.0, 1e-4))
    study = Rectifier(smoothing_capacitance=1e-5, load_resistance=2e5, load_curve=load)
    result = run(host(0.025, 50), 50.3, shunts=[study], candidates=("rectifier", "parallel_sshi", "sece"))
    found = shunts_of(result)
    assert found["rectifier"].load_curve == found["parallel_sshi"].load_curve == load
    assert "parallel_sshi: assumed load_curve as in the study's rectifier" in "\n".join(result.notes)


def test_circuits_with_straight_diodes_have_those_of_the_curve_at_their_own_current(host, run):
    """They were ideal beside real ones; a coil passes the charge of its electrodes in a fraction of the period."""
    diodes = VoltageCurve(currents=(0.0, 1e-5, 1e-2), voltages=(0.0, 0.2, 0.5))
    study = Rectifier(smoothing_capacitance=1e-5, load_resistance=2e5, diode_curve=diodes)
    kinds = ("rectifier", "self_powered_sshi", "dssh", "sece")
    result = run(host(0.025, 50), 50.3, shunts=[study], candidates=kinds, phase_lag="fixed")
    for kind, shunt in shunts_of(result).items():
        if kind != "rectifier":
            assert 0.2 < shunt.diode_drop + shunt.diode_resistance * 1e-3 < 0.5
    assert any(
        re.match("dssh: assumed diodes of 0.*as in the study's rectifier at 0.* A", note) for note in result.notes
    )
    assert not any("ideal diodes" in note or "same devices" in note for note in result.notes)


def test_a_template_of_the_kind_says_otherwise(host, run):
    """It stays as it is written, and that the devices differ is said."""
    templates = [SCHOTTKY, SECE(diode_drop=0.5)]
    result = run(host(0.025, 50), 50.3, shunts=templates, candidates=("rectifier", "sece"), phase_lag="fixed")
    assert shunts_of(result)["sece"].diode_drop == 0.5
    assert any("diode_drop is 0.2 V in rectifier, 0.5 V in sece" in note for note in result.notes)


def test_held_keys_are_not_tuned(host, run):
    coil = ParallelSSHI(smoothing_capacitance=1e-5, load_resistance=2e5, quality=6.0, inductance=0.1, phase_lag=0.3)
    series = SeriesRL(inductance=150.0, resistance=1e4)
    hold = ("load_resistance", "inductance")
    kinds = ("parallel_sshi", "series_rl")
    found = shunts_of(run(host(0.025, 50), 50.3, shunts=[coil, series], candidates=kinds, hold=hold))
    assert found["parallel_sshi"].load_resistance == 2e5 and found["parallel_sshi"].phase_lag != 0.3
    assert found["series_rl"].inductance == 150.0 and found["series_rl"].resistance != 1e4
    hold = ("load_resistance", "phase_lag")
    held = run(host(0.025, 50), 50.3, shunts=[coil], candidates=("parallel_sshi",), hold=hold).best
    assert held.shunt == coil and held.method == "nothing to tune"


class TestWhatIsTunedOfGivenValues:
    """Nobody who writes 3.3 V expects another dc voltage without a word."""

    SIDE = Rectifier(dc_voltage=3.3)
    COIL = ParallelSSHI(dc_voltage=3.3, quality=6.0, inductance=0.1, phase_lag=0.3, others=(
        Resistor(resistance=1e4, electrode=1),
    ))  # fmt: skip

    def told(self, device, shunts, **options):
        options = DesignOptions(candidates=("rectifier", "parallel_sshi", "resistor"), **options)
        drive = SineForce(amplitude=0.02, frequency=50.3)
        drafts = Drafting(device, shunts, options, operation_of(drive, None, device)).drafts()
        return retuned(drafts, shunts, options.tune or (), options.hold or ())

    def test_is_one_sentence_with_the_keys_to_write(self, host):
        (told,) = self.told(host(0.025, 50), (self.SIDE,))
        assert told.startswith("tuned, so values given in [[shunts]] are not used: dc_voltage of rectifier; ")
        assert told.endswith('; design.hold = ["dc_voltage"] keeps them')

    def test_knows_lags_and_what_is_at_other_electrodes(self, host):
        device = host(0.025, 50, electrodes=(Electrode(capacitance=40e-9, coupling=1e-3),))
        (told,) = self.told(device, (self.COIL, self.SIDE))
        assert "dc_voltage of rectifier and parallel_sshi, phase_lag of parallel_sshi, resistance of resistor;" in told
        assert 'design.hold = ["dc_voltage", "phase_lag", "resistance"] keeps' in told

    def test_the_suggested_key_goes_on_to_hold_what_is_held(self, host):
        loaded = Rectifier(smoothing_capacitance=1e-5, load_resistance=2e5)
        (told,) = self.told(host(0.025, 50), (loaded,), hold=("phase_lag",))
        assert told.endswith('; design.hold = ["phase_lag", "load_resistance"] keeps them')

    @pytest.mark.parametrize("options", [{"hold": ("dc_voltage",)}, {"tune": ("dc_voltage",)}])
    def test_says_nothing_of_what_is_held_or_asked_for(self, host, options):
        assert self.told(host(0.025, 50), (self.SIDE,), **options) == []

    def test_is_among_the_notes(self, host, run):
        result = run(host(0.025, 50), 50.3, shunts=[Resistor(resistance=1e4)], candidates=("resistor", "short"))
        assert sum('design.hold = ["resistance"]' in note for note in result.notes) == 1


def test_unknown_held_key(run, host, tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(
        '[transducer]\ncatalogue = "NAC2125-H10"\n[excitation]\nkind = "sine_force"\namplitude = 1000\nfrequency = 50\n'
        '[design]\nhold = ["load_resistence"]\n'
    )
    with pytest.raises((StudyError, ParameterError), match=r"hold\.0: found 'load_resistence' \(did you mean 'load_r"):
        design(load_study(path))


def test_what_is_assumed_only_of_kinds_that_are_named(host, run):
    """A cell's voltage, an amplifier and a law of adaptation: started from values that the operation gives."""
    named = ("battery", "adaptive_rl", "op_amp_negative_capacitance")
    result = run(host(0.025, 50), 50.6, candidates=named)
    found = {candidate.shunt.kind: candidate for candidate in result.candidates}
    assert set(found) == set(named)
    assert all(candidate.converged for candidate in found.values())
    assert found["battery"].shunt.dc_voltage == 3.7
    assert found["adaptive_rl"].gap_to_bound < 2e-3  # the coil finds its resonance, the resistance is tuned
    better = found["op_amp_negative_capacitance"].harvested_power
    assert better > run(host(0.025, 50), 50.6, candidates=("resistor",)).best.harvested_power
    assert "battery: assumed a lithium-ion cell of 3.7 V" in result.notes


@pytest.mark.parametrize("band", [None, (48.0, 53.0)])
def test_the_source_of_an_ssdv_is_half_of_what_stops_the_motion(host, run, band):
    """Lefeuvre et al. 2006: x = (F - (4/pi) g T V_s)/(b w + (4/pi) g T^2/C), g = (1+q)/(1-q), at the resonance."""
    device, force = host(0.01, 50), 0.02
    options = {"candidates": ("ssdv", "ssdi"), "objective": "damping", "band": band, "amplitude": force}
    found = {c.shunt.kind: c for c in run(device, device.open_circuit_frequency, **options).candidates}
    shunt, q = found["ssdv"].shunt, math.exp(-math.pi / 12)
    gain = 4 / math.pi * (1 + q) / (1 - q)
    assert shunt.quality == 6.0 and shunt.source_voltage == pytest.approx(0.5 * force / (gain * device.coupling))
    # Where the source takes half of the drive, half of the motion is left: 6 dB.
    assert found["ssdv"].attenuation_db - found["ssdi"].attenuation_db == pytest.approx(-6.02, abs=0.1)
    drive = SineForce(amplitude=force, frequency=device.open_circuit_frequency)
    motion = simulate(System(device, shunt), drive).displacement_amplitude
    stiffness = device.damping * 2 * math.pi * drive.frequency + gain * device.coupling**2 / device.capacitance
    assert motion == pytest.approx(0.5 * force / stiffness, rel=0.01)


def test_what_stops_the_motion_of_several_modes_under_acceleration(host):
    """The voltage is sum T_i H_i m_i a / sum T_i^2 H_i, with the response H_i of each mode to a force."""
    second = Mode(mass=2e-3, damping=0.05, stiffness=2e3, coupling=-4e-4)
    device, frequency, acceleration = host(0.01, 50, modes=(second,)), 70.0, 2.0
    drive = SineBase(amplitude=acceleration, frequency=frequency)
    leads = Drafting(device, (), DesignOptions(), operation_of(drive, None, device)).leads
    omega = 2 * math.pi * frequency
    modes = (device, second)
    moved = [m.coupling / (m.stiffness + 1j * omega * m.damping - m.mass * omega**2) for m in modes]
    by_drive, by_voltage = (
        sum(h * f for h, f in zip(moved, forces, strict=True))
        for forces in ([m.mass * acceleration for m in modes], [m.coupling for m in modes])
    )
    wanted = abs(by_drive / by_voltage)
    assert leads.blocking_voltage == pytest.approx(wanted, rel=1e-9)
