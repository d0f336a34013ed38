"""Excitations as lines, means over bands, and the region in which parts are sought."""

from dataclasses import replace

import numpy as np
import pytest

from piezoharvest.description.effects import Stiffening
from piezoharvest.description.excitation import Multisine, RandomForce, Record, SineForce, StepForce
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import Open, ParallelRL, Resistor, SeriesRL
from piezoharvest.description.system import System
from piezoharvest.design.drafts import Draft
from piezoharvest.design.goal import Goal
from piezoharvest.design.operation import mean_nodes, operation_of
from piezoharvest.design.region import COIL_QUALITY, Region
from piezoharvest.design.starts import Host, starts
from piezoharvest.design.trial import Trial
from piezoharvest.design.twoport import LinearView
from piezoharvest.linear import frequency_response
from piezoharvest.study import DesignOptions


@pytest.mark.parametrize("quality", [5, 50, 500])
def test_nodes_of_a_mean(host, quality):
    transducer, band = host(0.05, quality), (48.0, 53.0)
    shunt = Resistor(resistance=5e4)
    f = np.linspace(*band, 100001)
    exact = np.trapezoid(frequency_response(System(transducer, shunt), f).harvested_power, f) / 5.0
    for tolerance in (1e-2, 1e-6):
        nodes, weights = mean_nodes(band, transducer, tolerance, 2000)
        found = frequency_response(System(transducer, shunt), nodes).harvested_power @ weights
        assert found == pytest.approx(exact, rel=tolerance)


def test_mean_square_of_the_lines(host, tmp_path):
    """Half the sum of the squared peak values is the mean square of the signal."""
    transducer = host(0.05, 50)
    t = np.arange(2000) / 1000.0
    np.savetxt(tmp_path / "force.csv", np.sin(2 * np.pi * 50 * t), header="force_N", comments="")
    record = Record(file=str(tmp_path / "force.csv"), column="force_N", sample_rate=1000.0)
    cases = [
        (SineForce(amplitude=0.02, frequency=50.0), 0.02**2 / 2),
        (Multisine(amplitudes=(1.0, 2.0, 1.0), frequencies=(50.0, 60.0, 50.0), phases=(0.0,) * 3, duration=0.1), 4.0),
        (RandomForce(psd=1e-3, band=(10.0, 90.0), duration=1.0, seed=0), 1e-3 * 80),
        (record, 0.5),
    ]  # fmt: skip
    for excitation, square in cases:
        operation = operation_of(excitation, None, transducer)
        assert np.sum(operation.squares) / 2 == pytest.approx(square, rel=2e-2)
        assert operation.centre(transducer) == pytest.approx(50.0, rel=0.25)
    assert operation_of(StepForce(amplitude=1.0, duration=1.0), None, transducer).centre(transducer) > 49


def test_linear_power_of_a_record(host, run, tmp_path):
    """A recorded tone is worth as much as the tone."""
    transducer = host(0.05, 20)
    t = np.arange(20001) / 2000.0
    np.savetxt(tmp_path / "force.csv", 0.02 * np.sin(2 * np.pi * 50 * t), header="force_N", comments="")
    record = Record(file=str(tmp_path / "force.csv"), column="force_N", sample_rate=2000.0)
    tone, recorded = (
        run(transducer, 50.0, excitation=e, candidates=("resistor",)).best
        for e in (SineForce(amplitude=0.02, frequency=50.0), record)
    )
    assert recorded.shunt.resistance == pytest.approx(tone.shunt.resistance, rel=2e-2)
    assert recorded.harvested_power == pytest.approx(tone.harvested_power, rel=5e-2)


@pytest.mark.parametrize("cls", [SeriesRL, ParallelRL])
def test_region(host, cls):
    """Parts are brought inside, below the largest inductance and to no more than the quality of a coil."""
    transducer = host(0.05, 50)
    view = LinearView(transducer, operation_of(SineForce(amplitude=1.0, frequency=50.0), None, transducer),
                      Goal(DesignOptions()))  # fmt: skip
    draft = Draft(cls(inductance=1.0, resistance=1.0), ("inductance", "resistance"))
    region = Region.of(draft, Host.of(view), max_inductance=10.0)
    extreme = 1e-6 if cls is SeriesRL else 1e12
    inside = region.values(region.logs({"inductance": 250.0, "resistance": extreme}))
    assert inside["inductance"] == pytest.approx(10.0)
    reactance = 2 * np.pi * 50 * 10.0
    quality = reactance / inside["resistance"] if cls is SeriesRL else inside["resistance"] / reactance
    assert quality == pytest.approx(COIL_QUALITY, rel=1e-9)
    assert any("coil" in text for text in region.remarks(region.logs(inside)))
    assert all(min(start.values.values()) > 0 for start in starts(draft, Host.of(view)))


def test_peaks_are_exact(host):
    """Against the pole of the open host, to rounding."""
    transducer = host(0.05, 200)
    operation = operation_of(SineForce(amplitude=1.0, frequency=50.0), (40.0, 60.0), transducer)
    view = LinearView(transducer, operation, Goal(DesignOptions(objective="damping")))
    found = view.grid(Open())
    heights = np.abs(view.response(Open(), found).displacement)
    dense = np.abs(view.response(Open(), np.linspace(51.0, 51.5, 200001)).displacement)
    assert heights.max() == pytest.approx(dense.max(), rel=1e-9)


def test_what_the_short_circuit_cannot_follow_is_not_designed_for(host, run):
    """An offset of 1e12 m into a stiffening spring."""
    transducer = host(0.025, 50, effects=(Stiffening(cubic_stiffness=1e5),))
    excitation = SineForce(amplitude=0.02, frequency=50.6, offset=1e15)
    with pytest.raises(ParameterError, match="cannot be simulated with short: simulation failed"):
        run(transducer, excitation=excitation, objective="damping", candidates=("resistor",))


def test_candidate_that_takes_too_much_work_is_left_out(host, run, monkeypatch):
    simulated = Trial._simulate

    def give_up(self, shunt, *rest):
        if shunt.kind == "rectifier":
            raise self._impossible(replace(simulated(self, Open(), False), shunt="rectifier", message="given up"))
        return simulated(self, shunt, *rest)

    monkeypatch.setattr(Trial, "_simulate", give_up)
    found = run(host(0.025, 50), candidates=("resistor", "rectifier"))
    assert [candidate.shunt.kind for candidate in found.candidates] == ["resistor"]
    assert any(note.startswith("left out: rectifier: ") for note in found.notes)
    with pytest.raises(ParameterError, match="with rectifier: given up"):
        run(host(0.025, 50), candidates=("rectifier",))


def test_a_design_takes_only_so_much_work(host, run, monkeypatch):
    """What is drafted first is designed, and the rest is left out by name."""
    made, used = Trial.__init__, []
    monkeypatch.setattr(Trial, "__init__", lambda self, view: (made(self, view), used.append(self))[0])
    run(host(0.025, 50), candidates=("resistor",))
    enough = 3 * (Trial.left - used[0].left)
    monkeypatch.setattr(Trial, "__init__", lambda self, view: made(self, view, left=enough))
    found = run(host(0.025, 50), candidates=("resistor", "rectifier"))
    assert [candidate.shunt.kind for candidate in found.candidates] == ["resistor"]
    assert any(note.startswith("left out: rectifier: this is more to simulate than a design") for note in found.notes)
    with pytest.raises(ParameterError, match="more to simulate than a design may take, take fewer candidates"):
        run(host(0.025, 50), candidates=("rectifier",))
