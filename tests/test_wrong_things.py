"""What a user gets who hands a function, or a command, something else than it takes."""

import pint
import pytest

import piezoharvest as ph
from piezoharvest.cli import main

TRANSDUCER = ph.Transducer(mass=0.010, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
SYSTEM = ph.System(TRANSDUCER, ph.Resistor(resistance=1e5))
SINE = ph.SineForce(amplitude=0.02, frequency=50.6)

STUDY = """[transducer]
catalogue = "NAC2125-H10"
[excitation]
kind = "sine_force"
amplitude = 1.0
frequency = 50.0
[[shunts]]
kind = "open"
"""
CAMPAIGN = "[transducer]\n[channels]\n[[records]]\n"
SPECIMEN = "[transducer]\n[standard_errors]\n"


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: ph.System(TRANSDUCER, 1e5), "shunt: found 100000.0, must be a Shunt: such as Resistor("),
        (lambda: ph.System("x"), "transducer: found 'x', must be a Transducer"),
        (lambda: ph.simulate(TRANSDUCER, SINE), "system: found a Transducer, must be a System: System(transducer"),
        (lambda: ph.simulate(SYSTEM, 50), "excitation: found 50, must be an Excitation: such as SineForce("),
        (lambda: ph.linearize(SYSTEM), "transducer: found a System, must be a Transducer: closed_loop takes a System"),
        (lambda: ph.closed_loop(TRANSDUCER), "system: found a Transducer, must be a System"),
        (lambda: ph.frequency_response(TRANSDUCER, [50.0]), "system: found a Transducer, must be a System"),
        (lambda: ph.design("study.toml"), "study: found 'study.toml', must be a Study: load_study("),
        (lambda: ph.sweep(None, "x.csv"), "study: found None, must be a Study: load_study("),
        (lambda: ph.measure(3), "study: found 3, must be a Study: load_study("),
        (lambda: ph.identify("campaign.toml"), "campaign: found 'campaign.toml', must be a Campaign: load_campaign("),
        (lambda: ph.diagnose(None), "campaign: found None, must be a Campaign: load_campaign("),
        (lambda: ph.response_record(3), "response: found 3, must be a control.FRD"),
        (lambda: ph.shunt_from({}), "system: found a dict, must be a TransferFunction"),
        (
            lambda: ph.Resistor(resistance="1 Mohm"),
            "resistance: found '1 Mohm', must be a finite number greater than 0",
        ),
        (
            lambda: ph.Transducer.from_modal(modal_mass=0.25),
            "short_circuit_frequency: missing key, it is needed together with modal_mass; also missing: open_circuit",
        ),
        (lambda: ph.from_catalogue("NAC2125"), "transducer.catalogue: found 'NAC2125' (did you mean 'NAC2125-H10'?)"),
    ],
)
def test_python_says_what_is_needed(call, said):
    with pytest.raises(ph.ParameterError) as error:
        call()
    assert str(error.value).startswith(said)


def test_the_catalogue_from_python():
    found = ph.from_catalogue("NAC2125-H10", damping=900.0)
    assert (found.stiffness, found.damping) == (3.125e8, 900.0)


@pytest.mark.parametrize(
    ("load", "text", "said"),
    [
        (ph.load_study, CAMPAIGN, "found a campaign of measured records, for identify, diagnose and plan, but"),
        (ph.load_study, SPECIMEN, "found an identified specimen, which a study or campaign uses by transducer"),
        (ph.load_campaign, STUDY, "found a study, for simulate, design, sweep, measure and export, but"),
        (ph.load_campaign, SPECIMEN, "found an identified specimen"),
        (ph.load_specimen, STUDY, "found a study, for simulate"),
        (
            ph.load_study,
            STUDY.replace("[transducer]", "[[transducer]]"),
            "must be a table, written as [transducer], not",
        ),
        (
            ph.load_study,
            STUDY.replace("[[shunts]]", "[shunts]"),
            "must be a list of tables, written as [[shunts]], not",
        ),
    ],
)
def test_another_kind_of_file_is_named(tmp_path, load, text, said):
    path = tmp_path / "file.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"file\.toml") as error:
        load(path)
    assert said in str(error.value)


def test_known_keys_of_a_transducer_name_the_other_ways_to_give_it(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(STUDY.replace("[transducer]", '[transducer]\ndatashet = "x"'))
    with pytest.raises(ph.StudyError, match=r"transducer\.datashet: unknown key \(did you mean 'datasheet'\?\).*modal"):
        ph.load_study(path)


@pytest.mark.parametrize("command", ["simulate", "identify", "explore"])
@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("run.lvm", b"LabVIEW Measurement\n", "found a data file, but a TOML file that describes it is needed"),
        ("run.mat", b"\xe0MATLAB 5.0", "piezoharvest new campaign run.mat writes one"),
        ("coil.cir", b"* title\nL1 1 0 1m\n", "found a netlist, but a TOML file is needed: piezoharvest import"),
        ("study.toml", b"title\n", "not a valid TOML file"),
    ],
)
def test_a_file_of_another_kind_is_told_what_begins_with_it(tmp_path, capsys, command, name, content, words):
    (tmp_path / name).write_bytes(content)
    assert main([command, str(tmp_path / name)]) == 2
    assert words in capsys.readouterr().err


def test_a_decimal_comma_is_told(tmp_path, capsys):
    (tmp_path / "study.toml").write_text(STUDY.replace("amplitude = 1.0", "amplitude = 1,5  # N"))
    assert main(["simulate", str(tmp_path / "study.toml")]) == 2
    assert "line 5: found 1,5, must have a decimal point, not a comma" in capsys.readouterr().err


class TestQuantitiesOfPint:
    units = pint.UnitRegistry()

    @pytest.mark.parametrize("given", [units.Quantity(47, "kohm"), units.Quantity([47.0], "ohm")])
    def test_are_refused_at_once_with_the_field(self, given):
        with pytest.raises(
            ph.ParameterError, match=r"^resistance: found .*ohm.* with its unit, must be .* 0 ohm: .*m_as"
        ):
            ph.Resistor(resistance=given)

    def test_one_of_several(self):
        with pytest.raises(ph.ParameterError, match=r"^coupling: found 2.0 newton / volt with its unit"):
            ph.Electrode(coupling=(1.0, self.units.Quantity(2.0, "N/V")), capacitance=1e-9)

    def test_the_number_that_the_message_asks_for_is_taken(self):
        assert ph.Resistor(resistance=self.units.Quantity(47, "kohm").m_as("ohm")).resistance == 47e3
