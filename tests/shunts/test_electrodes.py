"""Further electrodes: several shunts at once against matrices by hand, and swapped electrodes against plain ones."""

import dataclasses
import io

import numpy as np
import pytest
from messages import is_sentence
from oracles.ngspice import needs_ngspice, run_netlist
from scipy.io import mmwrite
from scipy.sparse import coo_array

from piezoharvest import simulate
from piezoharvest.description.excitation import SineForce
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import (
    MPPT,
    SSDI,
    Open,
    ParallelRL,
    ParallelSSHI,
    Resistor,
    SelfPoweredSSDI,
    SeriesRL,
)
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Electrode, Mode, Transducer
from piezoharvest.engine.lowering.lower import lower
from piezoharvest.engine.run import Machine
from piezoharvest.linear import assemble, frequency_response, poles, resonances
from piezoharvest.readers import ReadError
from piezoharvest.readers.uff import ModeShapes
from piezoharvest.spice import export_spice
from piezoharvest.study import StudyError, load_study

OWN, FIRST, SECOND = (
    Electrode(capacitance=40e-9, coupling=(1e-3, 5e-4)),
    Electrode(capacitance=30e-9, coupling=(6e-4, -8e-4)),
    Electrode(capacitance=20e-9, coupling=(3e-4, 4e-4)),
)
DRIVE = SineForce(amplitude=0.02, frequency=51.0)


def host(own, *further):
    """Two modes with these electrodes; the displacement is read elsewhere than the force acts."""
    first = {"mass": 0.010, "damping": 0.0628, "stiffness": 986.96, "coupling": own.couplings[0]}
    second = Mode(
        mass=0.01, damping=0.2, stiffness=4e4, coupling=own.couplings[1], force_participation=0.7,
        sensor_participation=-0.4,
    )  # fmt: skip
    return Transducer(**first, capacitance=own.capacitance, modes=(second,), electrodes=further)


TWO = host(OWN, FIRST, SECOND)
ALL = SeriesRL(
    inductance=200.0, resistance=3e4, electrode=1,
    others=(ParallelRL(inductance=300.0, resistance=5e4, electrode=2), Resistor(resistance=5e5)),
)  # fmt: skip


def by_hand(frequency):
    """Displacement at the sensor, voltages and harvested power per N of the host with `ALL`: K u = f in phasors."""
    s = 2j * np.pi * frequency
    coupling = np.array([OWN.couplings, FIRST.couplings, SECOND.couplings]).T
    capacitance = np.diag([OWN.capacitance, FIRST.capacitance, SECOND.capacitance])
    admittance = np.diag([1 / 5e5, 1 / (3e4 + 200.0 * s), 1 / 5e4 + 1 / (300.0 * s)])
    stiffness = np.diag([0.01 * s**2 + 0.0628 * s + 986.96, 0.01 * s**2 + 0.2 * s + 4e4])
    matrix = np.block([[stiffness, -coupling], [s * coupling.T, s * capacitance + admittance]])
    found = np.linalg.solve(matrix, np.array([1.0, 0.7, 0.0, 0.0, 0.0]))
    v = found[2:]
    power = 0.5 * (abs(v[0]) ** 2 / 5e5 + abs(v[1] / (3e4 + 200.0 * s)) ** 2 * 3e4 + abs(v[2]) ** 2 / 5e4)
    return found[0] - 0.4 * found[1], v, power


def test_the_linear_view_has_all_shunts():
    for frequency in (20.0, 51.0, 320.0):
        displacement, voltages, power = by_hand(frequency)
        found = frequency_response(System(TWO, ALL), np.array([frequency]))
        assert found.displacement[0] == pytest.approx(displacement, rel=1e-10)
        assert found.voltage[0] == pytest.approx(voltages[1], rel=1e-10)
        assert found.harvested_power[0] == pytest.approx(power, rel=1e-10)
    states = assemble(TWO, ALL).states
    assert states == ("x1", "u1", "x2", "u2", "q", "q1", "q2", "shunt_current", "shunt_electrode2_current")


def test_the_engine_has_all_shunts():
    displacement, voltages, power = by_hand(DRIVE.frequency)
    response = simulate(System(TWO, ALL), DRIVE)
    assert response.converged and response.energy["closure"] < 1e-10
    assert response.displacement_amplitude == pytest.approx(0.02 * abs(displacement), rel=1e-6)
    assert response.voltage_amplitude == pytest.approx(0.02 * abs(voltages[1]), rel=1e-6)
    assert response.harvested_power == pytest.approx(0.02**2 * power, rel=1e-9)


@pytest.mark.parametrize(
    "shunt",
    [
        SSDI(inductance=0.1, quality=5.0),
        ParallelSSHI(inductance=0.1, quality=5.0, smoothing_capacitance=1e-6, load_resistance=1e6, diode_drop=0.2),
        MPPT(fraction=0.4),
    ],
    ids=lambda shunt: shunt.kind,
)
def test_electrodes_are_alike(shunt):
    beside = {"inductance": 200.0, "resistance": 3e4}
    plain = dataclasses.replace(shunt, others=(SeriesRL(**beside, electrode=1),))
    swapped = dataclasses.replace(shunt, electrode=1, others=(SeriesRL(**beside),))
    one = simulate(System(host(FIRST, OWN, SECOND), plain), DRIVE)
    other = simulate(System(host(OWN, FIRST, SECOND), swapped), DRIVE)
    assert one.converged and other.converged
    names = ("harvested_power", "mechanical_power", "displacement_amplitude", "voltage_amplitude", "attenuation_db")
    for name in names:
        assert getattr(other, name) == pytest.approx(getattr(one, name), rel=1e-8, abs=1e-15), name


def test_breakers_have_the_loop_of_their_electrodes():
    """In a netlist, too: coil and resistances are those beside the capacitance of the electrodes of the circuit."""
    keys = {"quality": 5.0, "inductance": 0.1, "envelope_capacitance": 1e-9, "threshold": 0.6}
    loops = []
    for transducer, electrode in ((host(FIRST, OWN), 0), (host(OWN, FIRST), 1)):
        text = export_spice(transducer, SelfPoweredSSDI(**keys, electrode=electrode), DRIVE, start="rest")
        loops.append([line for line in text.splitlines() if "loop" in line or "snubber" in line])
    assert loops[0] and loops[0] == loops[1]


def test_the_figure_of_merit_is_of_the_mode_wherever_it_is_read():
    plain = {"mass": 0.010, "damping": 0.0628, "stiffness": 986.96, "coupling": 1e-3, "capacitance": 40e-9}
    found = [
        simulate(System(Transducer(**plain, sensor_participation=seen), Resistor(resistance=5e4)), DRIVE)
        for seen in (1.0, -0.4)
    ]
    assert found[1].displacement_amplitude == pytest.approx(0.4 * found[0].displacement_amplitude, rel=1e-9)
    assert found[1].figure_of_merit == pytest.approx(found[0].figure_of_merit, rel=1e-9)


def test_open_electrodes_stiffen_the_modes():
    lone = Transducer(mass=0.01, damping=0.0, stiffness=1e3, coupling=1e-3, capacitance=40e-9,
                      electrodes=(Electrode(capacitance=30e-9, coupling=6e-4),))  # fmt: skip
    wanted = np.sqrt((1e3 + 6e-4**2 / 30e-9) / 0.01) / (2 * np.pi)
    assert resonances(lone).short_circuit.undamped == pytest.approx([wanted], rel=1e-12)
    opened = System(lone, Open(others=(Open(electrode=1),)))
    assert np.abs(poles(opened))[-1] == pytest.approx(2 * np.pi * resonances(lone).open_circuit.undamped[0], rel=1e-9)
    # Under a preload all electrodes begin relaxed: none pulls on the mean position.
    still = simulate(System(dataclasses.replace(lone, damping=0.1), Open()), SineForce(
        amplitude=0.02, frequency=40.0, offset=0.05))  # fmt: skip
    assert np.mean(still.waveforms.displacement) == pytest.approx(0.05 / 1e3, rel=1e-6)


def test_every_bad_place_is_told():
    rl = {"inductance": 1.0, "resistance": 1.0}
    cases = [
        (lambda: System(TWO, SeriesRL(**rl, electrode=3)), "electrode"),
        (lambda: System(TWO, SeriesRL(**rl, others=(Open(electrode=7),))), "others.0.electrode"),
        (lambda: SeriesRL(**rl, electrode=-1), "electrode"),
        (lambda: SeriesRL(**rl, others=(Open(),)), "others.0.electrode"),
        (lambda: SeriesRL(**rl, others=(SSDI(inductance=0.1, quality=5.0, electrode=1),)), "others.0"),  # pyright: ignore
        (lambda: dataclasses.replace(TWO, electrodes=(Electrode(capacitance=1e-9, coupling=1e-3),)),
         "electrodes.0.coupling"),
    ]  # fmt: skip
    for make, key in cases:
        with pytest.raises(ParameterError) as caught:
            make()
        assert caught.value.key == key
        assert is_sentence(caught.value.message)


@needs_ngspice
def test_ngspice_agrees():
    for shunt in (ALL, SSDI(inductance=0.1, quality=5.0, electrode=2)):
        response = simulate(System(TWO, shunt), DRIVE)
        found = run_netlist(export_spice(TWO, shunt, DRIVE))
        assert found["displacement_pp"] == pytest.approx(2 * response.displacement_amplitude, rel=2e-3)
        assert found["voltage_pp"] == pytest.approx(2 * response.voltage_amplitude, rel=2e-3)
        assert found["mechanical_power"] == pytest.approx(response.mechanical_power, rel=3e-3)


def test_work_grows_less_than_with_the_square_of_the_modes():
    """Of a period with eight pairs of electrodes, counted as the limit on work counts it."""
    spent = []
    for count in (10, 40):
        modes = [
            {"mass": 0.01, "damping": 0.02 * n, "stiffness": 986.96 * n**2, "coupling": 1e-3 * np.cos(n)}
            for n in range(1, count + 1)
        ]
        further = tuple(
            Electrode(capacitance=40e-9, coupling=tuple(float(1e-3 * np.cos(k * n)) for n in range(1, count + 1)))
            for k in range(2, 9)
        )
        device = Transducer(
            **modes[0], capacitance=40e-9, modes=tuple(Mode(**mode) for mode in modes[1:]), electrodes=further
        )
        others = tuple(SeriesRL(inductance=200.0, resistance=3e4, electrode=k) for k in range(1, 8))
        lowered = lower(System(device, SSDI(inductance=0.1, quality=5.0, others=others)), DRIVE)
        machine = Machine(lowered)
        state = machine.state()
        machine.run(state, 5 / DRIVE.frequency)  # builds the tables
        before = lowered.budget.left
        machine.run(state, 15 / DRIVE.frequency)
        spent.append(before - lowered.budget.left)
    assert np.log(spent[1] / spent[0]) / np.log(4) < 2


MODES = """frequency_Hz,damping_ratio,force,sensor,coupling_0,coupling_1,base
50,0.01,0,2,0.01,0.006,0.1
51,0.02,10,9,0.011,0.007,0.2
318,0.005,9,-5,0.005,-0.008,-0.05
"""
STUDY = """
[transducer]
modes_file = "modes.csv"
capacitance = 40e-9
[[transducer.electrodes]]
capacitance = 30e-9

[excitation]
kind = "sine_force"
amplitude = 0.02
frequency = 51.0

[[shunts]]
kind = "series_rl"
electrode = 1
inductance = 200
resistance = 3e4
[[shunts.others]]
kind = "resistor"
resistance = 5e5
"""


def studied(folder, modes=MODES, study=STUDY):
    """Study with its file of modes."""
    (folder / "modes.csv").write_text(modes)
    (folder / "study.toml").write_text(study)
    return load_study(folder / "study.toml")


def test_a_host_by_its_modes_in_a_file(tmp_path):
    study = studied(tmp_path)
    table = np.array([[float(word) for word in line.split(",")] for line in MODES.splitlines()[1:]])
    frequency, ratio, force, sensor, *coupling, base = table.T
    s = 2j * np.pi * 51.0
    omega, coupling = 2 * np.pi * frequency, np.array(coupling).T
    matrix = np.block([
        [np.diag(omega**2 + 2 * ratio * omega * s + s**2), -coupling],
        [s * coupling.T, np.diag([40e-9 * s + 1 / 5e5, 30e-9 * s + 1 / (3e4 + 200 * s)])],
    ])  # fmt: skip
    for by_base, drive in ((False, force), (True, -base)):
        found = frequency_response(study.systems[0], np.array([51.0]), base=by_base)
        wanted = np.linalg.solve(matrix, np.array([*drive, 0.0, 0.0]))
        assert found.displacement[0] == pytest.approx(sensor @ wanted[:3], rel=1e-9)
        assert found.voltage[0] == pytest.approx(wanted[4], rel=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "key", "message"),
    [
        ("318", "-3", "transducer.modes_file", "modes.csv, row 4: found -3.0 in column 'frequency_Hz'"),
        ("coupling_1", "couplin_1", "transducer.modes_file", "modes.csv: the file has no column 'coupling_1'"),
        ("coupling_1,base", "coupling_1,coupling_2", "transducer.modes_file", "modes.csv: found column 'coupling_2'"),
        ("modes.csv", "none.csv", "transducer.modes_file", "found 'none.csv', which is no existing file"),
        ("capacitance = 40e-9", "capacitance = 40e-9\nmass = 1.0", "transducer.mass", "found together with modes_file"),
        ("electrode = 1", "electrode = 2", "shunts.0.electrode", "found 2, must be a number from 0 to 1"),
        ("resistance = 5e5", "resistance = -1", "shunts.0.others.0.resistance", "found -1"),
    ],
)
def test_what_is_wrong_with_a_file_or_a_place_is_told(tmp_path, old, new, key, message):
    with pytest.raises(StudyError) as caught:
        studied(tmp_path, MODES.replace(old, new), STUDY.replace(old, new))
    assert caught.value.key == key
    assert caught.value.message.startswith(message)
    assert is_sentence(caught.value.message)


@pytest.mark.parametrize("kind", ["sine_base", "random_base"])
def test_a_moving_base_needs_its_participations(tmp_path, kind):
    """Without them each mode was driven by its mass, which of unit modal mass means nothing; nothing was said."""
    drive = {
        "sine_base": "amplitude = 1.0\nfrequency = 51.0",
        "random_base": "psd = 1.0\nband = [20, 90]\nduration = 1.0\nseed = 1",
    }
    force = 'kind = "sine_force"\namplitude = 0.02\nfrequency = 51.0'
    assert force in STUDY
    study = STUDY.replace(force, f'kind = "{kind}"\n{drive[kind]}')
    assert studied(tmp_path, study=study).transducer.effective_mass is not None
    without = "\n".join(line.rpartition(",")[0] for line in MODES.splitlines()) + "\n"
    with pytest.raises(StudyError) as caught:
        studied(tmp_path, without, study)
    assert caught.value.key == "transducer.modes_file"
    assert caught.value.message.startswith(
        f"modes.csv: the file has no column 'base', excitation.kind = '{kind}' needs"
    )
    assert studied(tmp_path, without).transducer.effective_mass is None  # a force needs none


def universal(frequencies, ratios, masses, shapes, units=(1.0, 1.0)):
    """Universal file as its description says (data sets 164 and 55): records of fixed columns, six values a node.

    `shapes` (modes, nodes, 6); `units` are the factors from SI of length and force.
    """
    length, force = units
    lines = ["    -1", "   164", f"{1:10d}{'SI: Meters (newton)':20s}{2:10d}"]
    lines += [f"{length:25.16E}{force:25.16E}{1.0:25.16E}".replace("E", "D"), f"{273.15:25.16E}".replace("E", "D")]
    lines += ["    -1"]
    for n, (frequency, ratio, mass, shape) in enumerate(zip(frequencies, ratios, masses, shapes, strict=True), 1):
        lines += ["    -1", "    55", *["NONE"] * 5, "".join(f"{word:10d}" for word in (1, 2, 3, 8, 2, 6))]
        lines += ["".join(f"{word:10d}" for word in (2, 4, 1, n))]
        lines += ["".join(f"{value:13.5E}" for value in (frequency, mass, ratio, 0.0))]
        for node, values in enumerate(shape, 11):
            lines += [f"{node:10d}", "".join(f"{value:13.5E}" for value in values)]
        lines += ["    -1"]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("units", [(1.0, 1.0), (1000.0, 1.0)], ids=["m and N", "mm and N"])
def test_a_host_by_its_shapes_in_a_universal_file(tmp_path, units):
    """The same as by its columns, to the five digits of the file."""
    pytest.importorskip("pyuff")
    table = np.array([[float(word) for word in line.split(",")] for line in MODES.splitlines()[1:]])
    frequency, ratio, force, sensor, *coupling, base = table.T
    masses = np.array([0.5, 2.0, 1.5])  # of the modes as the file scales them
    shapes = np.zeros((3, 2, 6))
    # Node 11 in +Z, and the rotation of node 12 about -X. With a modal coordinate in the file's length, a displacement
    # for a unit of it is a number without unit, a rotation an angle for a length; its masses are N s^2 over a length.
    shapes[:, 0, 2], shapes[:, 1, 3] = force, -sensor / units[0]
    shapes *= np.sqrt(masses)[:, None, None]
    text = universal(frequency, ratio, masses * units[1] / units[0], shapes, units)
    (tmp_path / "host.unv").write_text(text)
    lists = "\n".join(f"coupling_{k} = {list(map(float, row))}" for k, row in enumerate(coupling))
    places = f'[transducer.shapes]\nforce = "11+Z"\nsensor = "12-RX"\nbase = {list(map(float, base))}\n{lists}\n'
    study = STUDY.replace("modes.csv", "host.unv").replace("[excitation]", places + "[excitation]")
    found, wanted = studied(tmp_path, study=study).systems[0], studied(tmp_path).systems[0]
    for by_base in (False, True):
        pair = [frequency_response(system, np.array([40.0, 51.0, 300.0]), base=by_base) for system in (found, wanted)]
        np.testing.assert_allclose(pair[0].displacement, pair[1].displacement, rtol=1e-4)
        np.testing.assert_allclose(pair[0].voltage, pair[1].voltage, rtol=1e-4)


def test_a_universal_file_that_is_cut_off_has_not_just_fewer_modes(tmp_path):
    pytest.importorskip("pyuff")
    text = universal([50.0, 90.0], [0.01, 0.02], [1.0, 1.0], np.ones((2, 2, 6)))
    (tmp_path / "host.unv").write_text(text[: len(text) - 40])
    with pytest.raises(ReadError, match=r"its last data set has no end \(-1\), the file is cut off"):
        ModeShapes(tmp_path / "host.unv")


@pytest.mark.parametrize("turned", [0.0, 0.4], ids=["in phase", "out of phase"])
def test_complex_modes_of_a_modal_test(tmp_path, turned):
    """Written by pyuff: scaled so that the residues are shape^2/(modal A), with a node that may lag."""
    pyuff = pytest.importorskip("pyuff")
    omega, ratio = 2 * np.pi * np.array([50.0, 310.0]), np.array([0.01, 0.004])
    poles = omega * (-ratio + 1j * np.sqrt(1 - ratio**2))
    shape, scales = np.array([[1.2, 0.7], [-0.9, 1.1]]), np.array([0.3 - 2j, 40 + 7j])
    lag = np.exp(1j * np.array([0.0, turned]))
    for n, (pole, own, scale) in enumerate(zip(poles, shape, scales, strict=True), 1):
        given = own * lag * np.sqrt(scale / (2j * pole.imag))
        mode = {
            "type": 55, "model_type": 1, **{f"id{k}": "NONE" for k in range(1, 6)}, "analysis_type": 3, "data_ch": 2,
            "spec_data_type": 8, "data_type": 5, "n_data_per_node": 3, "load_case": 1, "mode_n": n, "eig": pole,
            "modal_a": scale, "modal_b": -scale * pole, "node_nums": np.array([1, 2]), "r1": 0 * given, "r2": 0 * given,
            "r3": given,
        }  # fmt: skip
        pyuff.UFF(str(tmp_path / "host.unv")).write_sets(mode, "add")
    if turned:
        with pytest.raises(ReadError, match=r"mode 1 is complex, of whose shape \d+% is out of phase, allowed"):
            ModeShapes(tmp_path / "host.unv")
        return
    found = ModeShapes(tmp_path / "host.unv")
    assert found.frequency == pytest.approx(omega / (2 * np.pi), rel=1e-4)
    assert found.damping_ratio == pytest.approx(ratio, rel=1e-3)
    driven, seen = (found.at(f"{node}+Z", "force") for node in (1, 2))
    assert driven * seen == pytest.approx(shape[:, 0] * shape[:, 1], rel=1e-4)


def state_space(frequency, ratio, inputs, outputs):
    """Matrices A, B and C of modes: inputs (n, 3), outputs (1, n); with velocities of the outputs, too."""
    omega, n = 2 * np.pi * frequency, len(frequency)
    a = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(omega**2), -np.diag(2 * ratio * omega)]])
    nothing = np.zeros_like(outputs)
    return a, np.vstack([np.zeros_like(inputs), inputs]), np.block([[outputs, nothing], [nothing, outputs]])


def matrix_market(matrices, sparse=True):
    """A text with all of them, names and labels between."""
    text = "State-space model of modes\n"
    for name, matrix in zip("ABC", matrices, strict=False):
        written = io.BytesIO()
        mmwrite(written, coo_array(matrix) if sparse else matrix, precision=13, symmetry="general")
        text += f"Matrix {name}\n{written.getvalue().decode()}\n"
    return text + "Labels: force, patch 0, patch 1\n"


@pytest.mark.parametrize("sparse", [True, False])
def test_a_host_by_its_state_space_model(tmp_path, sparse):
    """The same as by its columns."""
    table = np.array([[float(word) for word in line.split(",")] for line in MODES.splitlines()[1:]])
    frequency, ratio, force, sensor, *coupling, base = table.T
    model = state_space(frequency, ratio, np.column_stack([force, *coupling]), sensor[None])
    (tmp_path / "host.spm").write_text(matrix_market(model, sparse))
    places = f"[transducer.shapes]\nforce = 1\nsensor = 1\nbase = {list(map(float, base))}\n"
    places += "".join(f"coupling_{k} = {k + 2}\n" for k, _ in enumerate(coupling))
    study = STUDY.replace("modes.csv", "host.spm").replace("[excitation]", places + "[excitation]")
    found, wanted = studied(tmp_path, study=study).systems[0], studied(tmp_path).systems[0]
    for by_base in (False, True):
        pair = [frequency_response(system, np.array([40.0, 51.0, 300.0]), base=by_base) for system in (found, wanted)]
        np.testing.assert_allclose(pair[0].displacement, pair[1].displacement, rtol=1e-9)
        np.testing.assert_allclose(pair[0].voltage, pair[1].voltage, rtol=1e-9)


def _changed(which, place, value):
    model = state_space(np.array([50.0, 90.0]), np.array([0.01, 0.01]), np.ones((2, 3)), np.ones((1, 2)))
    model[which][place] = value
    return matrix_market(model)


UNIT = matrix_market([np.eye(4)] * 3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("simplorer { A = [1, 2] }", "host.spm: found 0 matrices in Matrix Market format,"
         " must be A, B and C, as SPMWRITE writes them with FileFormat = 1; 0 (dense) and 2 to 4"),
        (matrix_market([np.eye(4), np.ones((3, 1)), np.ones((1, 4))]), "host.spm: found matrices of 4 x 4, 3 x 1"),
        (_changed(0, (2, 1), 5e4), "host.spm: found a matrix A that is not that of modes"),
        (_changed(0, (2, 0), 1.0), "host.spm: found a matrix A that is not that of modes"),
        (_changed(0, (0, 2), 1.01), "host.spm: found rates of modal coordinates that are not the states"),
        (_changed(1, (0, 1), 0.5), "host.spm: found rates of modal coordinates that are not the states"),
        (_changed(1, (2, 1), np.nan), "host.spm: found entries in matrix 2 that are no finite real numbers"),
        (UNIT.replace("4 4 4", "4 4 9", 1), "host.spm: found no Matrix Market matrix behind banner 1"),
        (UNIT.replace("4 4 4", "four", 1), "host.spm: found no Matrix Market matrix behind banner 1, must be its size"),
        (UNIT.replace("4 4 4", "90000 90000 4", 1), "host.spm: found 90000 x 90000 entries"),
    ],
    ids=["SML", "shapes", "coupled", "unstable", "rate", "input", "NaN", "cut off", "size", "huge"],
)  # fmt: skip
def test_what_is_no_model_of_modes_is_told(tmp_path, text, message):
    (tmp_path / "host.spm").write_text(text)
    places = "[transducer.shapes]\nforce = 1\ncoupling_0 = 2\ncoupling_1 = 3\n[excitation]"
    with pytest.raises(StudyError) as caught:
        studied(tmp_path, study=STUDY.replace("modes.csv", "host.spm").replace("[excitation]", places))
    assert caught.value.key == "transducer.modes_file"
    assert caught.value.message.startswith(message)
    assert is_sentence(caught.value.message)


COUPLED = "coupling_0 = [1]\ncoupling_1 = [1]"


@pytest.mark.parametrize(
    ("name", "places", "key", "message"),
    [
        ("host.unv", "", "transducer.shapes", "missing table, host.unv has shapes at nodes"),
        ("host.unv", "force = '11+Z'\ncoupling_0 = [1]", "transducer.shapes.coupling_1", "missing key"),
        ("host.unv", "force = '9+Z'\ncoupling_0 = [1]\ncoupling_1 = [1]", "transducer.shapes.force", "found no '9+Z'"),
        (
            "host.unv", "force = '11+Z'\ncoupling_0 = [1, 2]\ncoupling_1 = [1]", "transducer.shapes.coupling_0",
            "found [1, 2], must be a list of 1 number",
        ),
        ("light.unv", f"force = '11+Z'\n{COUPLED}", "transducer.modes_file", "light.unv: mode 1 has a modal mass of 0"),
        ("host.spm", "", "transducer.shapes", "missing table, host.spm has inputs and outputs by number"),
        ("host.spm", "force = 1\ncoupling_0 = 2\ncoupling_1 = 9", "transducer.shapes.coupling_1", "found 9, must be"),
        ("host.spm", "force = true\ncoupling_0 = 2\ncoupling_1 = 3", "transducer.shapes.force", "found True, must be"),
        ("modes.csv", "force = '11+Z'", "transducer.shapes", "found together with modes.csv"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_shapes_is_told(tmp_path, name, places, key, message):
    pytest.importorskip("pyuff")
    for file, mass in (("host.unv", 1.0), ("light.unv", 0.0)):
        (tmp_path / file).write_text(universal([50.0], [0.01], [mass], np.ones((1, 2, 6))))
    model = state_space(np.array([50.0]), np.array([0.01]), np.ones((1, 3)), np.ones((1, 1)))
    (tmp_path / "host.spm").write_text(matrix_market(model))
    given = f"[transducer.shapes]\n{places}\n[excitation]" if places else "[excitation]"
    with pytest.raises(StudyError) as caught:
        studied(tmp_path, study=STUDY.replace("modes.csv", name).replace("[excitation]", given))
    assert caught.value.key == key
    assert caught.value.message.startswith(message)
    assert is_sentence(caught.value.message)
