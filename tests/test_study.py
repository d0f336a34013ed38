"""Studies: what is accepted, and that whatever is wrong is said in one sentence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import pytest
from messages import is_sentence

from piezoharvest.description import catalogue, shunts
from piezoharvest.description.effects import Leakage
from piezoharvest.description.excitation import SineForce
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts import LinearShunt, Network, ParallelSSHI, Resistor
from piezoharvest.description.transducer import Mode, Transducer
from piezoharvest.readers.conversion import with_unit
from piezoharvest.study import DesignOptions, Study, StudyError, SweepOptions, SweepParameter, load_study

STUDY = """\
title = "bench harvester"

[transducer]
mass = 0.010
damping = 0.0628
stiffness = 986.96
coupling = 1.0e-3
capacitance = 40e-9

[transducer.hysteresis]
thresholds = [1e-7, 3e-7]
weights = [5e5, 1.5e6]

[[transducer.modes]]
mass = 0.011
damping = 0.2
stiffness = 4.0e4
coupling = 5e-4
force_participation = 1

[transducer.effects.leakage]
resistance = 130000

[excitation]
kind = "sine_force"
amplitude = 0.02
frequency = 50.6

[[shunts]]
kind = "resistor"
resistance = 1e5

[[shunts]]
kind = "parallel_sshi"
dc_voltage = 10
inductance = 0.1
quality = 6

[design]
objective = "harvest"
band = [48.0, 53]
candidates = ["resistor", "parallel_sshi"]

[sweep]
method = "grid"
parameters = [
  { path = "shunts.0.resistance", from = 1e4, to = 1e6, scale = "log", count = 5 },
]

[bench]
anything = { goes = 1 }
"""

MANY = list(range(1, 2001))
RANDOM = """\
kind = "random_force"
psd = 1e-6
band = [40.0, {}]
duration = 1.0
seed = 1
"""


def write(folder, text: str | bytes):
    path = folder / "study.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def load(folder, *changes: tuple[str, str]) -> Study:
    """Load the study after replacing texts in it, each of which must be there."""
    text = STUDY
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    return load_study(write(folder, text))


def error(folder, *changes: tuple[str, str]) -> str:
    """Message of the error, without the file in front, after the checks that hold for every message."""
    with pytest.raises(StudyError) as caught:
        load(folder, *changes)
    message = str(caught.value)
    path = str(folder / "study.toml")
    assert message.startswith(path + ": ")
    assert "\n" not in message
    assert is_sentence(message)
    assert caught.value.path == path
    return message.removeprefix(path + ": ")


class TestAccepted:
    def test_every_table_becomes_its_component(self, tmp_path):
        study = load(tmp_path)
        assert study == Study(
            title="bench harvester",
            transducer=Transducer(
                mass=0.010,
                damping=0.0628,
                stiffness=986.96,
                coupling=1e-3,
                capacitance=40e-9,
                hysteresis=Hysteresis(thresholds=(1e-7, 3e-7), weights=(5e5, 1.5e6)),
                modes=(Mode(mass=0.011, damping=0.2, stiffness=4e4, coupling=5e-4),),
                effects=(Leakage(resistance=1.3e5),),
            ),
            excitation=SineForce(amplitude=0.02, frequency=50.6),
            shunts=(Resistor(resistance=1e5), ParallelSSHI(dc_voltage=10.0, inductance=0.1, quality=6.0)),
            path=tmp_path / "study.toml",
            design=DesignOptions(band=(48.0, 53.0), candidates=("resistor", "parallel_sshi")),
            sweep=SweepOptions(
                parameters=(SweepParameter(path="shunts.0.resistance", from_=1e4, to=1e6, scale="log", count=5),)
            ),
            bench={"anything": {"goes": 1}},
        )
        assert [system.shunt for system in study.systems] == list(study.shunts)
        assert all(system.transducer is study.transducer for system in study.systems)

    def test_integers_are_numbers(self, tmp_path):
        study = load(tmp_path, ("damping = 0.0628", "damping = 1"))
        assert isinstance(study.transducer.damping, float)
        assert isinstance(study.transducer.effects[0].resistance, float)

    def test_optional_tables_may_be_missing(self, tmp_path):
        study = load_study(write(tmp_path, STUDY[STUDY.index("[transducer]") : STUDY.index("[design]")]))
        assert (study.title, study.design, study.sweep, study.bench) == ("study", None, None, {})

    def test_design_brings_its_own_candidates(self, tmp_path):
        text = STUDY[: STUDY.index("[[shunts]]")] + "[design]\n"
        study = load_study(write(tmp_path, text))
        assert study.shunts == ()
        assert study.design == DesignOptions()

    @pytest.mark.parametrize("objective", ["harvest", "damping", "trade_off"])
    def test_design_options(self, tmp_path, objective):
        limits = "max_voltage = 60\nmax_inductance = 1\nmax_displacement = 1e-3\nmin_power = 0\nmin_attenuation_db = 6"
        study = load(tmp_path, ('objective = "harvest"', f'objective = "{objective}"\nparts = "E24"\n{limits}'))
        assert study.design.objective == objective
        assert (study.design.parts, study.design.max_voltage, study.design.min_power) == ("E24", 60.0, 0.0)

    def test_byte_order_mark_and_windows_line_ends(self, tmp_path):
        assert load_study(write(tmp_path, b"\xef\xbb\xbf" + STUDY.replace("\n", "\r\n").encode())) == load(tmp_path)

    def test_record_is_relative_to_the_study(self, tmp_path, monkeypatch):
        (tmp_path / "data").mkdir()
        (tmp_path / "data" / "force.csv").write_text("time_s,force_N\n0,1\n0.1,2\n0.2,3\n")
        monkeypatch.chdir("/")
        study = load(tmp_path, RECORD)
        assert study.excitation.length == pytest.approx(0.2)

    @pytest.mark.parametrize("form", ["text", "list"])
    def test_netlist_goes_to_the_network_as_it_stands(self, tmp_path, form):
        netlists = {"text": '"R1 1 0 1e4"', "list": '["R1 1 0 1e4"]'}
        study = load(tmp_path, RESISTOR_TO(f'kind = "network"\nnetlist = {netlists[form]}'))
        assert study.shunts[0] == Network(netlist="R1 1 0 1e4")

    def test_a_class_of_the_users_script_is_found(self, tmp_path):
        @dataclass(frozen=True, kw_only=True)
        class Lamp(LinearShunt):
            kind: ClassVar[str] = "lamp_of_test_study"
            source: ClassVar[str] = "none"
            resistance: float = quantity("ohm", "resistance", above=0)

            def equations(self, configuration, port, z, dz):
                return [self.resistance * port.i - port.v]

        try:
            study = load(tmp_path, ('"resistor"\nresistance', '"lamp_of_test_study"\nresistance'))
            assert study.shunts[0] == Lamp(resistance=1e5)
            found = error(tmp_path, RESISTOR_TO('kind = "lamp_of_test_study"\nresistance = -1'))
            assert found == "shunts.0.resistance: found -1.0, must be a finite number greater than 0 ohm"
        finally:
            del Lamp.kind  # leave no new name in the registry, which goes by subclasses


RECORD = (
    'kind = "sine_force"\namplitude = 0.02\nfrequency = 50.6',
    'kind = "record"\nfile = "data/force.csv"\ncolumn = "force_N"\nsample_rate = 10',
)


def RESISTOR_TO(table: str) -> tuple[str, str]:  # noqa: N802
    """Replace the first shunt."""
    return ('kind = "resistor"\nresistance = 1e5', table)


class TestCatalogue:
    @pytest.mark.parametrize("name", catalogue.names())
    def test_every_entry_loads_and_names_its_source(self, tmp_path, name):
        study = load_study(write(tmp_path, FROM_CATALOGUE.replace("NAME", name)))
        assert study.transducer.name == catalogue.entry(name)["name"]
        assert catalogue.entry(name)["source"]

    def test_further_keys_override(self, tmp_path):
        text = FROM_CATALOGUE.replace("NAME", "NAC2125-H10")
        plain = load_study(write(tmp_path, text)).transducer
        text += "\n[transducer.hysteresis]\nweights = [1e5, 1e5, 1e5]\n[transducer.effects.leakage]\nresistance = 1e6\n"
        changed = load_study(write(tmp_path, text.replace('H10"', 'H10"\ndamping = 7'))).transducer
        assert (changed.damping, changed.mass) == (7.0, plain.mass)
        assert changed.hysteresis == Hysteresis(thresholds=plain.hysteresis.thresholds, weights=(1e5, 1e5, 1e5))
        assert changed.effects == (Leakage(resistance=1e6),)

    def test_unknown_name(self, tmp_path):
        with pytest.raises(
            StudyError, match=r"transducer.catalogue: found 'nac2125h10' \(did you mean 'NAC2125-H10'\?\)"
        ):
            load_study(write(tmp_path, FROM_CATALOGUE.replace("NAME", "nac2125h10")))

    @pytest.mark.parametrize("name", ["../study", "", "NAC2125-H10.toml"])
    def test_only_names_are_entries(self, name):
        with pytest.raises(KeyError):
            catalogue.entry(name)


FROM_CATALOGUE = """\
excitation = { kind = "sine_force", amplitude = 1, frequency = 10 }
shunts = [{ kind = "short" }]
[transducer]
catalogue = "NAME"
"""


class TestValues:
    MASS = "must be a finite number greater than 0 kg"

    @pytest.mark.parametrize(
        ("value", "found"),
        [
            ("-0.01", "-0.01"),
            ("0", "0.0"),
            ("nan", "nan"),
            ("inf", "inf"),
            ("-inf", "-inf"),
            ("true", "true"),
            ('"heavy"', "'heavy'"),
            ("[0.01]", "[0.01]"),
            ("{ value = 0.01 }", "{'value': 0.01}"),
            ("1979-05-27", "datetime.date(1979, 5, 27)"),
        ],
    )
    @pytest.mark.parametrize(("old", "where"), [("0.010", "transducer"), ("0.011", "transducer.modes.0")])
    def test_mass(self, tmp_path, value, found, old, where):
        assert error(tmp_path, (f"mass = {old}", f"mass = {value}")) == f"{where}.mass: found {found}, {self.MASS}"

    def test_number_too_large_for_a_float(self, tmp_path):
        assert error(tmp_path, ("mass = 0.010", "mass = 1" + "0" * 400)).endswith(self.MASS)

    @pytest.mark.parametrize(
        ("change", "key", "message"),
        [
            (("50.6", "0"), "excitation.frequency", "found 0.0, must be a finite number greater than 0 Hz"),
            (("1e5", "0"), "shunts.0.resistance", "found 0.0, must be a finite number greater than 0 ohm"),
            (("= 10\n", '= "ten"\n'), "shunts.1.dc_voltage", "found 'ten', must be a finite number at least 0 V"),
            (
                ("130000", "nan"),
                "transducer.effects.leakage.resistance",
                "found nan, must be a finite number greater than 0 ohm",
            ),
            (
                ("[5e5, 1.5e6]", "[5e5, nan]"),
                "transducer.hysteresis.weights",
                "found nan, must be a finite number at least 0 V/C",
            ),
            (
                ("[5e5, 1.5e6]", '[5e5, "a"]'),
                "transducer.hysteresis.weights.1",
                "found 'a', must be a finite number at least 0 V/C",
            ),
            (
                ("[5e5, 1.5e6]", "5e5"),
                "transducer.hysteresis.weights",
                "found 500000.0, must be a list, each a finite number at least 0 V/C",
            ),
            (
                ("[5e5, 1.5e6]", "[5e5]"),
                "transducer.hysteresis.weights",
                "found 1 for 2 thresholds, each threshold needs one",
            ),
            (('"bench harvester"', "7"), "title", "found 7, must be a string"),
            (
                ("[48.0, 53]", "[53, 48]"),
                "design.band",
                "found [53.0, 48.0], must be [lower, upper] with lower < upper (Hz)",
            ),
            (
                ("[48.0, 53]", "[48]"),
                "design.band",
                "found [48], must be a list of 2, each a finite number greater than 0 Hz",
            ),
            (
                ("[48.0, 53]", "[48, 50, 53]"),
                "design.band",
                "found [48, 50, 53], must be a list of 2, each a finite number greater than 0 Hz",
            ),
            (
                ('["resistor", "parallel_sshi"]', "[]"),
                "design.candidates",
                "found an empty list, at least one kind of shunt is needed",
            ),
            (('["resistor", "parallel_sshi"]', "[1]"), "design.candidates.0", "found 1, must be a string"),
            (
                ('"harvest"', '"harvesting"'),
                "design.objective",
                "found 'harvesting', must be 'harvest' or 'damping' or 'trade_off'",
            ),
            (
                ("band", "max_voltage = 0\nband"),
                "design.max_voltage",
                "found 0.0, must be a finite number greater than 0 V",
            ),
        ],
    )
    def test_message(self, tmp_path, change, key, message):
        assert error(tmp_path, change) == f"{key}: {message}"

    def test_bridge_with_both_load_and_voltage(self, tmp_path):
        found = error(tmp_path, ("dc_voltage = 10", "dc_voltage = 10\nload_resistance = 1e5"))
        assert found.startswith("shunts.1.dc_voltage: found load_resistance and dc_voltage, give smoothing_")

    def test_whole_numbers(self, tmp_path):
        noise = 'kind = "random_force"\npsd = 1e-6\nband = [10, 20]\nduration = 5\nseed = SEED'
        for seed in ("1.5", "1.0", "true", "-1"):
            found = error(tmp_path, (RECORD[0], noise.replace("SEED", seed)))
            assert found.startswith("excitation.seed: found ")
        assert load(tmp_path, (RECORD[0], noise.replace("SEED", "1"))).excitation.seed == 1

    def test_phase_lag_needs_a_frequency(self, tmp_path):
        step = 'kind = "step_force"\namplitude = 1\nduration = 0.1'
        found = error(tmp_path, (RECORD[0], step), ("quality = 6", "quality = 6\nphase_lag = 0.1"))
        assert found.startswith("shunts.1.phase_lag: found 0.1 for an excitation without a frequency")

    @pytest.mark.parametrize("topology", ["parallel", "series"])
    def test_unstable_negative_capacitance(self, tmp_path, topology):
        table = 'kind = "negative_capacitance"\nresistance = 1e4\ntopology = "{}"\ncapacitance = {}'
        simple = STUDY[: STUDY.index("[transducer.hysteresis]")] + STUDY[STUDY.index("[excitation]") :]
        first, rest = simple.split('kind = "resistor"\nresistance = 1e5')
        # T^2/k = 1.01 nF beside the clamped 40 nF
        values = {"parallel": (39e-9, 42e-9), "series": (42e-9, 39e-9)}[topology]
        assert load_study(write(tmp_path, first + table.format(topology, values[0]) + rest)).shunts[0].kind
        with pytest.raises(StudyError, match=r"study\.toml: shunts\.0\.capacitance: found .*, must be "):
            load_study(write(tmp_path, first + table.format(topology, values[1]) + rest))


class TestUnits:
    """Quantities may be text with a unit."""

    def test_of_every_table(self, tmp_path):
        plain = load(tmp_path)
        written = load(
            tmp_path,
            ("mass = 0.010", 'mass = "10 g"'),
            ("coupling = 1.0e-3", 'coupling = "1 mN/V"'),
            ("capacitance = 40e-9", 'capacitance = "40nF"'),
            ("thresholds = [1e-7, 3e-7]", 'thresholds = ["0.1 uC", 3e-7]'),
            ("mass = 0.011", 'mass = "11 g"'),
            ("resistance = 130000", 'resistance = "0.13 Mohm"'),
            ("amplitude = 0.02", 'amplitude = "2e1 mN"'),
            ("frequency = 50.6", 'frequency = "0.0506 kHz"'),
            ("dc_voltage = 10", 'dc_voltage = "1e4 mV"'),
        )
        assert repr(written.systems) == repr(plain.systems)
        assert written.excitation.amplitude == pytest.approx(plain.excitation.amplitude, rel=1e-15)

    @pytest.mark.parametrize(
        ("text", "si", "value"),
        [
            ("0.5 g", "m/s^2", 0.5 * 9.80665), ("0.01 g^2/Hz", "(m/s^2)^2/Hz", 0.01 * 9.80665**2), ("10 g", "kg", 0.01),
            ("20 %", "", 0.2), ("90 deg", "rad", 1.5707963267948966), ("3 kΩ", "ohm", 3e3), ("300 pC/N", "C/N", 3e-10),
        ],
    )  # fmt: skip
    def test_as_the_field_writes_them(self, text, si, value):
        assert with_unit(text, si) == pytest.approx(value, rel=1e-14)

    def test_base_acceleration_in_standard_gravity(self, tmp_path):
        found = load(tmp_path, ('kind = "sine_force"', 'kind = "sine_base"'), ("amplitude = 0.02", 'amplitude = "1 g"'))
        assert found.excitation.amplitude == pytest.approx(9.80665, rel=1e-15)

    @pytest.mark.parametrize(
        ("value", "message"),
        [
            ("40 nH", "found the unit 'nH', must be a unit that converts to F"),
            ("40n", "found the unit 'n', must be a unit such as F"),
            ("40", "found '40' without its unit, must be a number, or text such as '40 F'"),
            ("-40 nF", "found -4e-08, must be a finite number greater than 0 F"),
            ("1e999 F", "found inf, must be a finite number greater than 0 F"),
            ("40 nF nF", "found the unit 'nF nF', must be a unit that converts to F"),
            ("small", "found 'small', must be a finite number greater than 0 F"),
        ],
    )
    def test_refused(self, tmp_path, value, message):
        found = error(tmp_path, ("capacitance = 40e-9", f'capacitance = "{value}"'))
        assert f"transducer.capacitance: {message}" in found


class TestNames:
    @pytest.mark.parametrize(
        ("change", "key", "message"),
        [
            (("mass", "mas"), "transducer.mas", "unknown key (did you mean 'mass'?), known keys are "),
            (
                ("[design]", "[desing]"),
                "desing",
                "unknown key (did you mean 'design'?), known keys are bench, design, ",
            ),
            (
                ("thresholds", "threshold"),
                "transducer.hysteresis.threshold",
                "unknown key (did you mean 'thresholds'?)",
            ),
            (
                ("effects.leakage", "effects.leakge"),
                "transducer.effects.leakge",
                "unknown effect (did you mean 'leakage'?)",
            ),
            (
                ('"sine_force"', '"Sine_Forces"'),
                "excitation.kind",
                "found 'Sine_Forces' (did you mean 'sine_force'?), allowed are ",
            ),
            (('"sine_force"', "3"), "excitation.kind", "found 3, allowed are multisine, "),
            (
                ("frequency", "freqency"),
                "excitation.freqency",
                "unknown key (did you mean 'frequency'?), known keys are amplitude, ",
            ),
            (
                ('kind = "resistor"', 'kind = "paralel_rl"'),
                "shunts.0.kind",
                "found 'paralel_rl' (did you mean 'parallel_rl'?), allowed are ",
            ),
            (
                ("resistance = 1e5", "resistence = 1e5"),
                "shunts.0.resistence",
                "unknown key (did you mean 'resistance'?), known keys are electrode, others, resistance",
            ),
            (
                ("resistance = 1e5", "resistance = 1e5\nxyz = 0"),
                "shunts.0.xyz",
                "unknown key, known keys are electrode, others, resistance",
            ),
            (
                ('["resistor", ', '["resister", '),
                "design.candidates.0",
                "found 'resister' (did you mean 'resistor'?), allowed are ",
            ),
            (("[sweep]", "[[sweep]]"), "sweep", "found [{'method': 'grid', "),
            (
                ("from = 1e4", "from_ = 1e4"),
                "sweep.parameters.0.from_",
                "unknown key (did you mean 'from'?), known keys are count, from, path, scale, to",
            ),
        ],
    )
    def test_unknown(self, tmp_path, change, key, message):
        assert error(tmp_path, change).startswith(f"{key}: {message}")

    @pytest.mark.parametrize("key", ["mass", "damping", "stiffness", "coupling", "capacitance"])
    def test_missing_in_transducer(self, tmp_path, key):
        text = "\n".join(line for line in STUDY.split("[transducer.hyst")[0].splitlines() if not line.startswith(key))
        with pytest.raises(StudyError, match=rf"transducer\.{key}: missing key, must be a finite number"):
            load_study(write(tmp_path, text + "\n[transducer.hyst" + STUDY.split("[transducer.hyst")[1]))

    def test_all_missing_keys_of_a_table_are_named(self, tmp_path):
        text = STUDY.split("[transducer.hyst")[0]
        kept = [line for line in text.splitlines() if not line.startswith(("damping", "coupling", "capacitance"))]
        with pytest.raises(StudyError, match=r"transducer\.damping: missing key, .* N s/m; also missing: coupling,"):
            load_study(write(tmp_path, "\n".join(kept) + "\n[transducer.hyst" + STUDY.split("[transducer.hyst")[1]))

    @pytest.mark.parametrize(
        ("change", "key"),
        [
            (("weights = [5e5, 1.5e6]\n", ""), "transducer.hysteresis.weights"),
            (('kind = "sine_force"\n', ""), "excitation.kind"),
            (("amplitude = 0.02\n", ""), "excitation.amplitude"),
            (('kind = "resistor"\n', ""), "shunts.0.kind"),
            (("resistance = 1e5\n", ""), "shunts.0.resistance"),
            (("quality = 6\n", ""), "shunts.1.quality"),
            (RESISTOR_TO('kind = "network"'), "shunts.0.netlist"),
        ],
    )
    def test_missing(self, tmp_path, change, key):
        told = error(tmp_path, change)
        assert told.startswith((f"{key}: missing key, must be ", f"{key}: missing key, allowed are "))

    @pytest.mark.parametrize("table", ["transducer", "excitation", "shunts"])
    def test_missing_table(self, tmp_path, table):
        tables = {
            "transducer": "transducer = { mass = 1, damping = 0, stiffness = 1, coupling = 1, capacitance = 1 }",
            "excitation": 'excitation = { kind = "sine_force", amplitude = 1, frequency = 10 }',
            "shunts": 'shunts = [{ kind = "short" }]',
        }
        assert load_study(write(tmp_path, "\n".join(tables.values()))).shunts
        del tables[table]
        with pytest.raises(StudyError, match=rf"study.toml: {table}: missing tables? \[+{table}\]"):
            load_study(write(tmp_path, "\n".join(tables.values())))

    @pytest.mark.parametrize(
        ("value", "found"), [("[]", "an empty list, at least"), ("{}", "{}, must be a"), ("[1]", "1, must be a")]
    )
    def test_shunts_are_a_list_of_tables(self, tmp_path, value, found):
        text = f"shunts = {value}\n" + STUDY[: STUDY.index("[[shunts]]")]
        with pytest.raises(StudyError, match=rf"shunts(\.0)?: found {found} "):
            load_study(write(tmp_path, text))

    @pytest.mark.parametrize("kind", sorted(shunts.registered()))
    def test_every_kind_refuses_unknown_keys(self, tmp_path, kind):
        found = error(tmp_path, RESISTOR_TO(f'kind = "{kind}"\nno_such_key = 1'))
        assert found.startswith("shunts.0.no_such_key: unknown key, known keys are ")


class TestFiles:
    def test_missing_file(self, tmp_path):
        with pytest.raises(StudyError, match=r"nowhere\.toml: the file cannot be read \(No such file or directory\)"):
            load_study(tmp_path / "nowhere.toml")

    def test_directory(self, tmp_path):
        with pytest.raises(StudyError, match=r"the file cannot be read \(Is a directory\)"):
            load_study(tmp_path)

    def test_not_utf8(self, tmp_path):
        with pytest.raises(StudyError, match=r"found byte 0xe9 at offset 9, but a TOML file must be text in UTF-8"):
            load_study(write(tmp_path, 'title = "é"'.encode("latin-1")))

    @pytest.mark.parametrize(
        ("change", "place"),
        [
            (("quality = 6", "quality = 6 7"), "line 37"),
            (("quality = 6", "quality = 6\nquality = 7"), "line 38"),
            (("mass = 0.010", "mass = "), "line 4"),
        ],
    )
    def test_syntax_error_names_the_line(self, tmp_path, change, place):
        assert place in error(tmp_path, change)

    def test_what_the_parser_cannot_hold(self, tmp_path):
        assert "digits" in error(tmp_path, ("mass = 0.010", "mass = " + "1" * 5000))
        assert "nested too deeply" in error(tmp_path, ("mass = 0.010", "mass = " + "[" * 5000))

    def test_keys_and_values_cannot_break_the_line(self, tmp_path):
        error(tmp_path, ("mass = 0.010", r'"ma\nss\u001b" = 1'))
        error(tmp_path, ("mass = 0.010", r'mass = "1\n2"'))

    def test_record_file_and_column(self, tmp_path):
        assert error(tmp_path, RECORD).startswith("excitation.file: the file ")
        (tmp_path / "data").mkdir()
        force = tmp_path / "data" / "force.csv"
        force.write_text("time_s,load_N\n0,1\n0.1,2\n")
        assert error(tmp_path, RECORD).startswith(
            "excitation.column: the file has no column 'force_N', its columns are "
        )
        force.write_bytes("time_s,force_N,°C\n0,1,2\n".encode("latin-1"))
        # Letters of another encoding in the name of another column do no harm; one sample is too few.
        assert error(tmp_path, RECORD).startswith("excitation.file: found 1 sample in ")


@pytest.mark.parametrize("value", ["nan", "-1e300", "0", "1e300", "true", '"x"', "[]", "{}", "[[1]]", "07:32:00"])
def test_whatever_stands_at_a_key_is_accepted_or_refused_in_one_sentence(tmp_path, value):
    lines = STUDY.splitlines()
    for n, line in enumerate(lines):
        if " = " not in line:
            continue
        text = "\n".join([*lines[:n], f"{line.split(' = ')[0]} = {value}", *lines[n + 1 :]])
        try:
            load_study(write(tmp_path, text))
        except StudyError as problem:
            assert is_sentence(str(problem))
            assert "\n" not in str(problem)


@pytest.mark.parametrize("value", ["1e308", "1.7e308", "1e70", "1e-70", "1e-300", "5e-324"])
@pytest.mark.parametrize(
    ("line", "key"),
    [
        ("mass = 0.010", "transducer.mass"),
        ("stiffness = 986.96", "transducer.stiffness"),
        ("capacitance = 40e-9", "transducer.capacitance"),
        ("resistance = 130000", "transducer.effects.leakage.resistance"),
        ("frequency = 50.6", "excitation.frequency"),
        ("inductance = 0.1", "shunts.1.inductance"),
        ("quality = 6", "shunts.1.quality"),
    ],
)
def test_sizes_that_square_or_invert_to_infinity_are_refused_by_their_key(tmp_path, line, key, value):
    message = error(tmp_path, (line, f"{line.split(' = ')[0]} = {value}"))
    assert message.startswith(f"{key}: found ")
    assert "to 1e+60" in message or "greater than" in message


def test_sizes_twelve_decades_from_the_usual_are_accepted(tmp_path):
    for power in (-12, 12):
        for line, value in (("mass = 0.010", 0.01), ("stiffness = 986.96", 987.0), ("capacitance = 40e-9", 4e-8)):
            assert load(tmp_path, (line, f"{line.split(' = ')[0]} = {value * 10.0**power}"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('kind = "sine_force"\namplitude = 0.02\nfrequency = 50.6', RANDOM.format("1e15")),
         "excitation: found 1.6e+16 samples, allowed are up to 10000000"),
        (('kind = "sine_force"\namplitude = 0.02\nfrequency = 50.6', RANDOM.format("60.0").replace("1.0", "1e12")),
         "excitation: found 9.6e+14 samples, allowed are up to 10000000"),
        (("thresholds = [1e-7, 3e-7]\nweights = [5e5, 1.5e6]", f"thresholds = {MANY}\nweights = {MANY}"),
         "transducer.hysteresis.thresholds: found 2000 thresholds, allowed are up to 50"),
        (('kind = "resistor"\nresistance = 1e5', f'kind = "network"\nnetlist = {[f"R{n} 1 0 1" for n in range(300)]}'),
         "shunts.0.netlist: found 300 elements, allowed are up to 100"),
    ],
    ids=["rate", "duration", "stops", "network"],
)  # fmt: skip
def test_what_would_not_fit_into_memory_is_refused(tmp_path, change, message):
    assert error(tmp_path, change).startswith(message)
