"""A free frequency of the drive: against closed forms, grids that know nothing of the search, and the command line."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.optimize import differential_evolution

from piezoharvest.cli import main
from piezoharvest.description.excitation import RandomForce, SineForce
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import SSDI
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Mode
from piezoharvest.design import design
from piezoharvest.engine import simulate_many
from piezoharvest.study import DesignOptions, Study

FORCE = 0.02


def free(transducer, band, *candidates, shunts=(), **options):
    """Design with the frequency free in a band."""
    options = DesignOptions(band=band, candidates=candidates, **options)
    excitation = SineForce(amplitude=FORCE, frequency=1.0)
    study = Study(transducer=transducer, excitation=excitation, shunts=shunts, design=options, free_frequency=True)
    return design(study)


def electrodes(transducer, omega):
    """Impedance and open-circuit voltage of the electrodes, written down from the equations of the modes."""
    modes = [(m.mass, m.damping, m.stiffness, m.coupling) for m in (transducer, *transducer.modes)]
    speeds = [(t, 1 / (b + 1j * (m * omega - k / omega))) for m, b, k, t in modes]  # of a unit force
    admittance = 1j * omega * transducer.capacitance + sum(t**2 * speed for t, speed in speeds)
    return 1 / admittance, FORCE * sum(t * speed for t, speed in speeds) / admittance


def resistive(transducer, frequency):
    """Power in W into the best resistor at a frequency (Hz): |v|^2/(4 (|Z| + Re Z))."""
    impedance, voltage = electrodes(transducer, 2 * np.pi * frequency)
    return np.abs(voltage) ** 2 / (4 * (np.abs(impedance) + np.real(impedance)))


@pytest.mark.parametrize(("k2", "quality"), [(1e-4, 30), (0.02, 60), (0.3, 400)])
def test_resistor_and_its_frequency(host, k2, quality):
    """Weak coupling has one maximum, strong coupling reaches F^2/(8 b) near either resonance."""
    transducer, band = host(k2, quality), (40.0, 65.0)
    best = free(transducer, band, "resistor").best
    wanted = differential_evolution(lambda f: -resistive(transducer, f[0]), [band], rng=1, tol=1e-12)
    assert best.harvested_power == pytest.approx(-wanted.fun, rel=1e-6)
    assert best.harvested_power == pytest.approx(resistive(transducer, best.frequency), rel=1e-6)
    impedance, _ = electrodes(transducer, 2 * np.pi * best.frequency)
    assert best.shunt.resistance == pytest.approx(abs(impedance), rel=1e-2)
    if k2 * quality > 2:
        assert best.harvested_power == pytest.approx(FORCE**2 / (8 * transducer.damping), rel=1e-6)
        assert abs(np.imag(impedance)) < 5e-3 * np.real(impedance)


def test_maximum_outside_of_the_band_is_not_taken(host):
    """Without the resonance the band's edge is best."""
    best = free(host(1e-3, 60), (52.0, 60.0), "resistor").best
    assert best.frequency == pytest.approx(52.0, abs=1e-6)


@pytest.mark.parametrize(
    ("k2", "quality", "band", "fine"),
    [(0.025, 50, (48, 53), 1), pytest.param(0.3, 300, (42, 64), 2, marks=pytest.mark.slow),
     pytest.param(0.025, 50, (48, 53), 2, marks=pytest.mark.slow)],
)  # fmt: skip
def test_parallel_sshi_against_a_grid(host, k2, quality, band, fine):
    """No point of a grid in frequency, load and lag (10^4 of them if fine), near the design and far from it."""
    transducer = host(k2, quality)
    best = free(transducer, band, "parallel_sshi").best
    assert best.converged and band[0] < best.frequency < band[1]

    def grid(frequencies, loads, lags):
        f, load, lag = (x.reshape(-1, 1) for x in np.meshgrid(frequencies, loads, lags))
        time_constant = best.shunt.smoothing_capacitance * best.shunt.load_resistance
        shunt = replace(best.shunt, load_resistance=load, smoothing_capacitance=time_constant / load, phase_lag=lag)
        sines = SineForce(amplitude=FORCE, frequency=f)
        found = simulate_many(System(transducer, shunt), sines, len(f), attenuation=False, thorough=False)
        return np.max(found["harvested_power"], where=found["converged"], initial=0.0)

    width = transducer.damping / transducer.mass / (2 * np.pi)
    load, lag = best.shunt.load_resistance, best.shunt.phase_lag
    near = grid(
        best.frequency + width * np.linspace(-0.5, 0.5, 10 * fine + 1),
        load * np.geomspace(0.7, 1.4, 8 * fine), lag + np.linspace(-0.3, 0.3, 8 * fine),
    )  # fmt: skip
    far = grid(np.linspace(*band, 20 * fine), load * np.geomspace(0.02, 50, 6 * fine), np.linspace(-1.4, 1.4, 5 * fine))
    assert best.harvested_power > (1 - 1e-4) * max(near, far)


def test_bound_is_the_largest_of_the_band(host):
    """Of two modes that are damped differently the better one counts."""
    transducer = host(0.03, 50, modes=(Mode(mass=0.01, damping=0.02, stiffness=8e3, coupling=5e-4),))
    result = free(transducer, (40.0, 200.0), "resistor")
    frequencies = np.linspace(40, 200, 400_001)
    impedance, voltage = electrodes(transducer, 2 * np.pi * frequencies)
    wanted = np.max(np.abs(voltage) ** 2 / (8 * np.real(impedance)))
    assert result.bound.harvested_power == pytest.approx(wanted, rel=1e-5)
    assert result.bound.any_interface == pytest.approx(wanted, rel=1e-5)
    assert result.best.harvested_power == pytest.approx(np.max(resistive(transducer, frequencies)), rel=1e-5)


def test_a_limit_is_kept_at_the_frequency_found(host):
    transducer = host(0.05, 60)
    best = free(transducer, (45.0, 56.0), "resistor").best
    less = free(transducer, (45.0, 56.0), "resistor", max_voltage=0.5 * best.voltage_amplitude).best
    assert less.feasible and less.voltage_amplitude <= 0.5 * best.voltage_amplitude
    assert less.frequency == pytest.approx(50.0, abs=0.5)  # near the short circuit, where the voltage is less


def test_what_harvests_nothing_stays_at_the_resonance(host):
    transducer = host(0.05, 60)
    result = free(transducer, (45.0, 56.0), "ssdi", shunts=[SSDI(inductance=0.1, quality=5.0)])
    assert result.best.frequency == pytest.approx(np.sqrt(50.0 * 50.0 * np.sqrt(1.05)), rel=1e-3)


STUDY = """
[transducer]
mass = 0.01
damping = 0.0628
stiffness = 986.96
coupling = 1e-3
capacitance = 40e-9
[excitation]
kind = "sine_force"
amplitude = 0.02
frequency = "free"
[[shunts]]
kind = "resistor"
resistance = 1e5
"""


@pytest.fixture
def study(tmp_path):
    def write(text):
        path = tmp_path / "study.toml"
        path.write_text(text)
        return str(path)

    return write


SOUGHT = STUDY + '[design]\nband = [45, 55]\ncandidates = ["resistor"]'


def test_command_line(study, capsys):
    assert main(["design", study(SOUGHT), "--json"]) == 0
    assert all(45 < one["frequency"] < 55 for one in json.loads(capsys.readouterr().out)["candidates"])
    assert main(["design", study(SOUGHT)]) == 0
    assert "frequency" in capsys.readouterr().out


@pytest.mark.slow
def test_report(study, tmp_path):
    assert main(["design", study(SOUGHT), "--report", str(tmp_path / "report")]) == 0
    page = (tmp_path / "report" / "report.html").read_text()
    assert "free from 45" in page and page.count("frequency&nbsp;=") == 1


@pytest.mark.parametrize(
    "command", [["simulate"], ["sweep", "--out", "x.csv"], ["measure", "--out", "x"], ["export", "--out", "x.cir"]]
)
def test_other_commands_refuse(study, capsys, command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = study(STUDY + "[design]\nband = [45, 55]")
    assert main([command[0], path, *command[1:]]) == 2
    said = capsys.readouterr().err
    assert "excitation.frequency: found 'free'" in said and "only the command design" in said
    assert not list(tmp_path.glob("x*"))


@pytest.mark.parametrize(("more", "key"), [
    ("", "excitation.frequency"), ("[design]", "design.band"),
    ('[design]\nband = [45, 55]\nobjective = "damping"', "design.objective"),
    ('[design]\nband = [45, 55]\nobjective = "trade_off"', "design.objective"),
    ('[design]\nband = [45, 55]\ncandidates = ["synthesised"]', "design.candidates"),
])  # fmt: skip
def test_messages(study, capsys, more, key):
    assert main(["design", study(STUDY + more)]) == 2
    said = capsys.readouterr().err
    assert f": {key}: " in said and "free" in said and said.count("\n") == 1


def test_only_a_sine_has_a_frequency_to_be_free(study, capsys):
    noise = STUDY.replace('"sine_force"\namplitude = 0.02', '"random_force"\npsd = 1.0')
    assert main(["design", study(noise)]) == 2
    assert "excitation.frequency: unknown key" in capsys.readouterr().err
    noise = RandomForce(psd=1.0, band=(1.0, 10.0), duration=10.0, seed=1)
    make = partial(Study, transducer=None, design=DesignOptions(band=(1, 2)), free_frequency=True)  # type: ignore
    with pytest.raises(ParameterError, match="must be a sine where the frequency is free"):
        make(excitation=noise)
