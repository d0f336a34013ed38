"""Transducers from the figures of modal tests and data sheets, against the linear two-port and the simulator."""

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezoharvest import Open, ParameterError, Resistor, SineBase, SineForce, System, Transducer, TwoPort, simulate
from piezoharvest.description import catalogue
from piezoharvest.linear import resonances
from piezoharvest.linear.material import from_material
from piezoharvest.study import StudyError, load_study

MODAL = {"short_circuit_frequency": 50.0, "open_circuit_frequency": 51.0, "quality": 50.0, "modal_mass": 0.01,
         "capacitance": 40e-9, "capacitance_is": "free"}  # fmt: skip
HARVESTER = {"open_circuit_voltage": 10.0, "acceleration": 9.8, "open_circuit_frequency": 100.0, "quality": 40.0,
             "capacitance": 50e-9, "capacitance_is": "free"}  # fmt: skip
POWERED = {"power": 1e-3, "acceleration": 9.8, "resonance_frequency": 100.0, "quality": 40.0, "capacitance": 50e-9,
           "modal_mass": 5e-3}  # fmt: skip
ACTUATOR = {"free_stroke": 15e-6, "blocking_force": 300.0, "voltage": 100.0, "capacitance": 1.5e-6, "quality": 30.0}


@given(
    frequency=st.floats(1.0, 1e5), ratio=st.floats(1.0001, 2.0), quality=st.floats(1.0, 1e4), mass=st.floats(1e-6, 1e3),
    capacitance=st.floats(1e-12, 1e-3), free=st.booleans(),
)  # fmt: skip
def test_a_modal_test_comes_back(frequency, ratio, quality, mass, capacitance, free):
    found = Transducer.from_modal(
        short_circuit_frequency=frequency, open_circuit_frequency=frequency * ratio, quality=quality, modal_mass=mass,
        capacitance=capacitance, capacitance_is="free" if free else "clamped", name="mine",
    )  # fmt: skip
    back = resonances(found)
    assert back.short_circuit.undamped[0] == pytest.approx(frequency, rel=1e-10)
    assert back.open_circuit.undamped[0] == pytest.approx(frequency * ratio, rel=1e-10)
    if quality > 1:
        assert back.short_circuit.damping_ratio[0] == pytest.approx(0.5 / quality, rel=1e-6)
    shown = found.capacitance + (found.coupling**2 / found.stiffness if free else 0.0)
    assert shown == pytest.approx(capacitance, rel=1e-10)
    assert found.mass == mass and found.name == "mine"


def test_the_free_capacitance_is_that_of_the_two_port_far_below_resonance():
    """Without force, v = z_22 i and F = 0: the port's impedance is that of a capacitor."""
    (mechanical, forward), (back, electrical) = TwoPort.of(Transducer.from_modal(**MODAL), [0.01]).z[0]
    impedance = electrical - back * forward / mechanical
    assert -1 / (2 * math.pi * 0.01 * impedance.imag) == pytest.approx(40e-9, rel=1e-6)


def test_an_impedance_is_a_modal_test():
    names = {"short_circuit_frequency": "resonance_frequency", "open_circuit_frequency": "antiresonance_frequency"}
    found = Transducer.from_datasheet(**{names.get(key, key): value for key, value in MODAL.items()})
    assert found == Transducer.from_modal(**MODAL)
    assert any("resonance and antiresonance" in text for text in found.assumptions)


class TestVibrationHarvester:
    drive = SineBase(amplitude=9.8, frequency=100.0)

    @pytest.mark.parametrize("kind", ["free", "clamped"])
    def test_the_voltage_comes_back_from_the_simulator(self, kind):
        found = Transducer.from_datasheet(**HARVESTER | {"capacitance_is": kind}, modal_mass=5e-3)
        assert simulate(System(found, Open()), self.drive).voltage_amplitude == pytest.approx(10.0, rel=1e-9)

    def test_the_mass_follows_from_the_power(self):
        known = Transducer.from_datasheet(**HARVESTER, modal_mass=5e-3)
        power = simulate(System(known, Resistor(resistance=3e4)), self.drive).harvested_power
        found = Transducer.from_datasheet(**HARVESTER, power=power, load_resistance=3e4)
        assert found.mass == pytest.approx(5e-3, rel=1e-9)

    def test_more_power_than_the_voltage_can_drive(self):
        with pytest.raises(ParameterError, match=r"power: found 1, must be less than \S+ W with this voltage"):
            Transducer.from_datasheet(**HARVESTER, power=1.0, load_resistance=3e4)

    def test_too_light(self):
        with pytest.raises(ParameterError, match=r"open_circuit_voltage: found 10, too large for a mass of 1e-06 kg"):
            Transducer.from_datasheet(**HARVESTER | {"capacitance_is": "clamped"}, modal_mass=1e-6)


def power_in(transducer, resistance):
    """Mean power of 9.8 m/s^2 at the short-circuit resonance in a resistor."""
    drive = SineBase(amplitude=9.8, frequency=transducer.short_circuit_frequency)
    return simulate(System(transducer, Resistor(resistance=resistance)), drive).harvested_power


@pytest.mark.parametrize("kind", ["free", "clamped"])
class TestPowerAlone:
    def test_the_power_in_the_best_resistor_comes_back(self, kind):
        found = Transducer.from_datasheet(**POWERED, capacitance_is=kind)
        omega = 2 * math.pi * 100.0
        strength = found.coupling**2 / (found.damping * omega * found.capacitance)
        best = 1 / (omega * found.capacitance * math.sqrt(1 + strength**2))
        assert power_in(found, best) == pytest.approx(1e-3, rel=1e-6)
        assert max(power_in(found, 0.98 * best), power_in(found, 1.02 * best)) < 1e-3
        free = found.capacitance + found.coupling**2 / found.stiffness
        assert (free if kind == "free" else found.capacitance) == pytest.approx(50e-9, rel=1e-12)
        assert any("best load resistance" in text for text in found.assumptions)

    @pytest.mark.parametrize("load", [20e3, 200e3])
    def test_the_weaker_of_two_couplings_is_taken(self, kind, load):
        """Beside the found one, the same power is reached at another, larger coupling, where the power falls."""
        found = Transducer.from_datasheet(**POWERED, capacitance_is=kind, load_resistance=load)
        assert power_in(found, load) == pytest.approx(1e-3, rel=1e-6)
        stiffer = dataclasses.replace(found, coupling=1.001 * found.coupling)
        assert power_in(stiffer, load) > 1e-3
        assert any("weaker of the two" in text for text in found.assumptions)

    def test_what_the_damping_allows(self, kind):
        with pytest.raises(
            ParameterError, match=r"power: found 0.004 W, must be less than \(m a\)\^2/\(8 c\) = 0.00382 W"
        ):
            Transducer.from_datasheet(**POWERED | {"power": 4e-3}, capacitance_is=kind)

    def test_what_the_load_allows(self, kind):
        """The message's limit is where the two couplings meet."""
        with pytest.raises(
            ParameterError, match=r"found 0.003 W, must be less than \S+ W: with this capacitance"
        ) as error:
            Transducer.from_datasheet(**POWERED | {"power": 3e-3}, capacitance_is=kind, load_resistance=200e3)
        limit = float(str(error.value).split("less than ")[1].split()[0])
        for share, fine in ((0.99, True), (1.01, False)):
            figures = {**POWERED, "power": share * limit, "capacitance_is": kind, "load_resistance": 200e3}
            if fine:
                assert power_in(Transducer.from_datasheet(**figures), 200e3) == pytest.approx(share * limit, rel=1e-6)
            else:
                with pytest.raises(ParameterError, match="must be less than"):
                    Transducer.from_datasheet(**figures)


class TestActuator:
    def test_stroke_and_blocking_force_come_back(self):
        found = Transducer.from_datasheet(**ACTUATOR, modal_mass=1e-3)
        assert found.coupling * 100.0 / found.stiffness == pytest.approx(15e-6)
        assert found.coupling * 100.0 == pytest.approx(300.0)
        assert found.capacitance + found.coupling**2 / found.stiffness == pytest.approx(1.5e-6)

    def test_a_resonance_stands_for_the_mass(self):
        found = Transducer.from_datasheet(**ACTUATOR, resonance_frequency=30e3)
        assert found.short_circuit_frequency == pytest.approx(30e3)
        assert found.damping == pytest.approx(math.sqrt(found.stiffness * found.mass) / 30)

    def test_a_free_capacitance_below_what_moves(self):
        with pytest.raises(ParameterError, match=r"capacitance: found 1e-07 F, too small for a free one"):
            Transducer.from_datasheet(**ACTUATOR | {"capacitance": 1e-7}, modal_mass=1e-3)

    def test_a_coupling_factor(self):
        found = Transducer.from_datasheet(
            coupling_factor=0.7, stiffness=5e7, capacitance=1e-6, modal_mass=1e-3, damping_ratio=0.01
        )
        share = found.coupling_squared / (1 + found.coupling_squared)
        assert (math.sqrt(share), found.capacitance) == (pytest.approx(0.7), pytest.approx(1e-6 * (1 - 0.49)))


class TestMaterial:
    def test_a_stack(self):
        size = {"area": 25e-6, "thickness": 50e-6, "layers": 100}
        found = Transducer.from_datasheet(material="PZT-5A", **size, modal_mass=1e-3, quality=50.0)
        # The constants of PZT-5A, from Erturk & Inman 2011, table E.1.
        known = from_material(374e-12, 18.8e-12, 1700 * 8.8541878188e-12, **size, mass=1e-3, damping=found.damping)
        for field in ("stiffness", "coupling", "capacitance"):
            assert getattr(found, field) == pytest.approx(getattr(known, field), rel=1e-12)

    def test_a_plate(self):
        """Free stroke d31 V l/t, blocked force d31 V w/s11, free capacitance eps l w/t."""
        found = Transducer.from_datasheet(
            material="PZT-5H", length=0.03, width=0.01, thickness=2e-4, modal_mass=1e-4, quality=50.0
        )
        free = found.capacitance + found.coupling**2 / found.stiffness
        assert found.coupling / found.stiffness == pytest.approx(-274e-12 * 0.03 / 2e-4)
        assert found.coupling == pytest.approx(-274e-12 * 0.01 / 16.5e-12)
        assert free == pytest.approx(3400 * 8.8541878188e-12 * 0.03 * 0.01 / 2e-4)

    def test_an_impossible_one(self):
        with pytest.raises(ParameterError, match="d31: found 1e-09, must have a magnitude below"):
            Transducer.from_datasheet(
                d31=1e-9, s11=16e-12, relative_permittivity=1000.0, length=0.03, width=0.01, thickness=2e-4,
                modal_mass=1e-4, quality=50.0,
            )  # fmt: skip


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"quality": None, "damping_ratio": None}, "quality: missing key, quality or damping_ratio is needed"),
        ({"damping_ratio": 0.01}, "damping_ratio: found together with quality"),
        ({"open_circuit_frequency": 49.0}, "open_circuit_frequency: found 49 Hz, must be at least"),
        ({"quality": -1.0}, "quality: found -1.0, must be a finite number greater than 0"),
        ({"capacitance_is": "fre"}, "capacitance_is: found 'fre' (did you mean 'free'?), allowed are free, clamped"),
    ],
)
def test_wrong_figures(changed, message):
    with pytest.raises(ParameterError) as error:
        Transducer.from_modal(**MODAL | changed)
    assert str(error.value).startswith(message)


def test_an_antiresonance_below_the_resonance_is_told_by_its_own_key():
    figures = {"resonance_frequency": 98.0, "capacitance": 1e-8, "modal_mass": 1.0, "quality": 10.0}
    with pytest.raises(ParameterError, match="antiresonance_frequency: found 90 Hz, must be at least resonance_freq"):
        Transducer.from_datasheet(antiresonance_frequency=90.0, **figures)


def test_missing_and_unknown_figures():
    with pytest.raises(ParameterError, match="capacitance_is: missing key, it is needed together with"):
        Transducer.from_modal(**{key: value for key, value in MODAL.items() if key != "capacitance_is"})
    with pytest.raises(ParameterError, match="datasheet: missing key, one of blocking_force"):
        Transducer.from_datasheet(mass=1.0)
    with pytest.raises(
        ParameterError, match=r"material: found 'PZT' \(did you mean 'PZT-8' or .*, allowed are PIC255, PVDF, PZT-4"
    ):
        Transducer.from_datasheet(material="PZT")


class TestStudy:
    TEXT = """\
excitation = { kind = "sine_base", amplitude = "1 g", frequency = "50 Hz" }
shunts = [{ kind = "open" }]
[transducer.effects.leakage]
resistance = "10 Mohm"
[transducer.modal]
short_circuit_frequency = "50 Hz"
open_circuit_frequency = "51 Hz"
quality = 50
modal_mass = "10 g"
capacitance = "40 nF"
capacitance_is = "free"
"""

    def load(self, folder, text):
        path = folder / "study.toml"
        path.write_text(text)
        return load_study(path).transducer

    def test_the_same_as_in_python(self, tmp_path):
        found = self.load(tmp_path, self.TEXT)
        known = Transducer.from_modal(**MODAL)
        assert dataclasses.replace(found, effects=()) == known
        assert found.assumptions == known.assumptions and found.effects

    def test_keys_of_the_transducer_go_before(self, tmp_path):
        found = self.load(tmp_path, self.TEXT + '[transducer]\ndamping = "3 N s/m"\n')
        assert (found.damping, found.mass) == (3.0, 0.01)

    @pytest.mark.parametrize(
        ("old", "new", "message"),
        [
            ('"free"', '"loose"', "transducer.modal.capacitance_is: found 'loose', must be 'free' or 'clamped'"),
            ("quality", "qality", "transducer.modal.qality: unknown key (did you mean 'quality'?)"),
            ('"51 Hz"', '"49 Hz"', "transducer.modal.open_circuit_frequency: found 49 Hz, must be at least"),
            ("transducer.modal", "transducer.datasheet", "transducer.datasheet.short_circuit_frequency: unknown key"),
            ("[transducer.modal]", "[transducer.datasheet]\n[transducer.modal]", "only one of the two may be given"),
            ("[transducer.modal]", '[transducer]\ncatalogue = "P-885.51"\n[transducer.modal]',
             "transducer.modal: found together with catalogue, only one of the two may be given"),
            ("[transducer.modal]", "[transducer]\nmass = 3.0\n[transducer.modal]",
             "transducer.mass: found together with a table modal, from which it follows"),
        ],
    )  # fmt: skip
    def test_wrong(self, tmp_path, old, new, message):
        with pytest.raises(StudyError) as error:
            self.load(tmp_path, self.TEXT.replace(old, new))
        assert message in str(error.value)


def test_the_catalogue_has_all_kinds_with_sources():
    """At least 25 transducers, each with a source, passive (k^2 below 1) and with a resonance below 1 MHz."""
    assert len(catalogue.names()) >= 25
    for name in catalogue.materials():
        material = catalogue.material(name)
        constants = material["material"]
        permittivity = constants["relative_permittivity"] * 8.8541878188e-12
        assert material["source"] and 0 < constants["d33"] ** 2 / (constants["s33"] * permittivity) < 1
        assert 0 < constants["d31"] ** 2 / (constants["s11"] * permittivity) < 1


def test_sources_are_those_of_who_measured():
    """No copies on a site where anybody puts documents."""
    entries = [*map(catalogue.entry, catalogue.names()), *map(catalogue.material, catalogue.materials())]
    assert [entry["source"] for entry in entries if "scribd" in entry["source"].lower()] == []


def test_a_film_has_the_coupling_factor_of_its_manual():
    """PVDF: k31 = 0.12, and 380 pF/cm^2 at 28 um (Piezo Film Sensors Technical Manual, table 1)."""
    found = Transducer.from_datasheet(
        material="PVDF", length=0.03, width=0.012, thickness=28e-6, modal_mass=6e-6, quality=10.0
    )
    share = found.coupling_squared / (1 + found.coupling_squared)
    assert math.sqrt(share) == pytest.approx(0.12, abs=0.005)
    assert (found.capacitance + found.coupling**2 / found.stiffness) / 3.6 == pytest.approx(380e-12, rel=0.05)


def test_a_ceramic_patch_is_about_as_stiff_as_its_ceramic():
    found = Transducer.from_datasheet(**catalogue.entry("P-876.A12")["transducer"]["datasheet"])
    plate = Transducer.from_datasheet(
        material="PIC255", length=0.05, width=0.03, thickness=2e-4, modal_mass=0.00078, quality=30.0
    )
    assert found.stiffness == pytest.approx(plate.stiffness, rel=0.15)  # the polymer adds a tenth
    assert abs(plate.coupling) == pytest.approx(0.335, abs=5e-4)  # as the note says for small signals


def test_a_catalogued_stack_meets_its_own_data_sheet():
    """P-885.51: 70 kHz with both ends free is 35 kHz with one fixed; the lumped mass (a third) is 10 % from it."""
    found = Transducer.from_datasheet(**catalogue.entry("P-885.51")["transducer"]["datasheet"])
    assert found.short_circuit_frequency == pytest.approx(35e3, rel=0.1)
    still = SineForce(amplitude=1.0, frequency=1.0)
    assert simulate(System(found, Open()), still).displacement_amplitude == pytest.approx((1 - 0.69**2) / 5e7, rel=1e-3)
