"""SPICE export: the netlists run in ngspice, and say the same as phasors, formulas of the literature and the engine."""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from oracles.ngspice import NgspiceError, needs_ngspice, run_netlist
from selection import with_slow
from studies import BENCH, SECOND, STOPS, bench, inversion, objects, solve

from piezoharvest.description.effects import Stiffening
from piezoharvest.description.excitation import RandomBase, Record, StepForce
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import SSDV, Open, ParallelSSHI, Resistor, Shunt, registered
from piezoharvest.linear import frequency_response
from piezoharvest.progress import Step
from piezoharvest.spice import export_spice
from piezoharvest.spice.circuits import WRITERS
from piezoharvest.spice.simulators import ngspice
from piezoharvest.spice.simulators.comparison import compare
from piezoharvest.spice.simulators.schematic import schematic
from piezoharvest.study import study_from

# Damped so much that it is steady after a dozen periods.
DAMPED = {"damping": 0.6, "coupling": 3e-4}
DRIVE = {"kind": "sine_force", "amplitude": 0.02, "frequency": 48.0}
PERIOD = 1 / DRIVE["frequency"]
OMEGA = 2 * np.pi * DRIVE["frequency"]
CAPACITANCE = BENCH["capacitance"]
LOAD = {"load_resistance": 1.6e5, "smoothing_capacitance": 2 * PERIOD / 1.6e5}
WIDE = {"load_resistance": 6.4e5, "smoothing_capacitance": 2 * PERIOD / 6.4e5}
COIL = {"inductance": (PERIOD / 50 / np.pi) ** 2 / CAPACITANCE, "quality": 5.0}
LOOP = {"flip_time": PERIOD / 50, "quality": 5.0}
NETWORK = "L1 1 2 150\nC1 2 0 30n\nR1 2 3 20k\nC2 3 0 100n\nR2 3 0 200k load\nR3 3 1 1meg load"
LOOPS = "C1 1 0 10n\nC2 1 2 20n\nC3 2 0 30n\nR1 2 0 90k load\nL1 2 3 20\nL2 3 4 30\nR2 4 0 50k\nL3 3 0 500"
EFFECTS = {
    "leakage": {"resistance": 4e5},
    "dielectric_relaxation": {"capacitance": 15e-9, "time_constant": 5e-3},
    "voltage_dependent_capacitance": {"beta": 0.02},
    "creep": {"compliance_ratio": 0.1, "time_constant": 5e-3},
    "stiffening": {"cubic_stiffness": 1e10},
    "friction": {"stiffness": 80.0, "threshold": 2e-5},
    "nonlinear_coupling": {"quadratic_coupling": 2.0},
    "bias_current": {"current": 2e-6},
    "load_error": {"relative_error": 0.3},
}
# Effects of circuits, all of them at once.
OF_CIRCUITS = {
    "switch_delay": {"time_lag": 2e-4}, "inversion_loss": {"quality": 3.0}, "on_time_offset": {"on_time_error": 0.1},
    "voltage_reversion": {"share": 0.1, "time_constant": 2e-3}, "diode_drop_error": {"diode_drop": 0.05},
    "reverse_leakage": {"conductance": 1e-6}, "probe_loading": {"resistance": 1e6, "capacitance": 1e-8, "place": "dc"},
}  # fmt: skip

# All effects at once in every circuit, and each by itself in one of them: the first shows that something is wrong in a
# circuit, the second which effect it is.
CIRCUITS = ["resistor", "rectifier", "parallel_sshi"]
OF_EFFECTS = [*(("all", kind) for kind in CIRCUITS), *zip(EFFECTS, itertools.cycle(CIRCUITS))]
QUICK = [("leakage", "resistor"), ("stiffening", "rectifier")]

BRANCHES = {"inductances": [300.0, 40.0], "resistances": [3e4, 2e4]}
LINEAR = {
    "open": {"kind": "open"},
    "short": {"kind": "short"},
    "resistor": {"kind": "resistor", "resistance": 8e4},
    "series_rl": {"kind": "series_rl", "inductance": 200.0, "resistance": 2e4},
    "parallel_rl": {"kind": "parallel_rl", "inductance": 200.0, "resistance": 2e5},
    "series_rlc": {"kind": "series_rlc", "inductance": 300.0, "resistance": 2e4, "capacitance": 80e-9},
    "parallel_rlc": {"kind": "parallel_rlc", "inductance": 100.0, "resistance": 1e5, "capacitance": 40e-9},
    "negative_capacitance": {"kind": "negative_capacitance", "resistance": 1e5, "capacitance": 20e-9},
    "series negative": {
        "kind": "negative_capacitance", "resistance": 1e5, "capacitance": 100e-9, "topology": "series",
    },
    "current_flowing": {"kind": "current_flowing", **BRANCHES, "capacitances": [50e-9, 40e-9]},
    "parallel_branches": {"kind": "parallel_branches", **BRANCHES, "capacitances": [40e-9]},
    "current_blocking": {
        "kind": "current_blocking", **BRANCHES, "blocking_inductances": [25.0, 3.0],
        "blocking_capacitances": [400e-9, 500e-9], "coil_quality": 6.0,
    },
    "network": {"kind": "network", "netlist": NETWORK},
    "network with loops and cutsets": {"kind": "network", "netlist": LOOPS},
}  # fmt: skip
SWITCHED = {
    "rectifier": {"kind": "rectifier", **LOAD, "diode_drop": 0.01},
    "parallel_sshi": {"kind": "parallel_sshi", **LOAD, **LOOP},
    "series_sshi": {"kind": "series_sshi", **LOAD, **LOOP, "diode_drop": 0.01},
    "sece": {"kind": "sece", "efficiency": 0.9, "diode_drop": 0.01},
    "sece coil": {"kind": "sece", **COIL, "efficiency": 0.9, "diode_drop": 0.01, "diode_resistance": 50.0},
    "sice": {"kind": "sice", **COIL},
    "sc_sece": {"kind": "sc_sece", **COIL, "short_time": 0.1 * PERIOD, "phase_lag": 0.2},
    "dssh": {"kind": "dssh", **COIL, "intermediate_capacitance": 120e-9, "diode_drop": 0.01},
    "essh": {
        "kind": "essh",
        **COIL,
        "intermediate_capacitance": 120e-9,
        "second_inductance": 0.02,
        "second_quality": 20.0,
        "residual": 0.5,
        "efficiency": 0.9,
    },
    "bias_flip": {"kind": "bias_flip", "steps": 3, **LOAD, **COIL, "bias_capacitance": 4e-7},
    "half_wave": {"kind": "half_wave", **WIDE, "diode_drop": 0.01, "diode_leakage": 1e-8, "diode_saturation": 1e-7},
    "doubler": {"kind": "doubler", **WIDE, "diode_drop": 0.01, "diode_resistance": 2e3, "diode_leakage": 1e-8},
    "battery": {"kind": "battery", "dc_voltage": 0.3, "internal_resistance": 2e3, "diode_resistance": 500.0},
    "mppt": {"kind": "mppt", "fraction": 0.5, "sampling_duty": 0.1, "diode_drop": 0.01},
    "sshc": {"kind": "sshc", **LOAD, "flip_capacitances": [60e-9], "switch_resistance": 1000.0},
    "ssds": {"kind": "ssds"},
    "ssds coil": {"kind": "ssds", **COIL},
    "ssdi": {"kind": "ssdi", **LOOP},
    "ssdv": {"kind": "ssdv", **LOOP, "source_voltage": 1.0},
}
STAGED = ("half_wave", "doubler", "battery", "mppt", "sshc", "bias_flip", "sece coil", "sice", "sc_sece", "dssh")
STAGED += ("essh", "ssds coil")
# Left to the slow tests from rest.
RARE = ("series_sshi", "ssds", *STAGED)
MISTIMED = {
    "late": {"phase_lag": 0.3},
    "early": {"phase_lag": -0.3},
    "closed too long": {"on_time_error": 0.2},
    "closed too briefly": {"on_time_error": -0.2},
}


def netlist(study, **options):
    """Netlist from rest, unless told otherwise: what ngspice finds by itself."""
    system, excitation = objects(study)
    return export_spice(system.transducer, system.shunt, excitation, **{"start": "rest", **options})


def compare_with_engine(study, tolerance, **options):
    """Run a study's netlist, started near the final dc voltage, and compare it with the engine's steady state."""
    response = solve(study)
    found = run_netlist(netlist(study, dc_start=response.dc_voltage, **options))
    expected = {
        "harvested_power": response.harvested_power,
        "mechanical_power": response.mechanical_power,
        "displacement_pp": 2 * response.displacement_amplitude,
        "voltage_pp": 2 * response.voltage_amplitude,
        "dc_voltage": response.dc_voltage,
        "efficiency": response.efficiency,
    }
    assert response.converged, response.message
    assert found == pytest.approx(expected, rel=tolerance, abs=1e-12)
    return found


@needs_ngspice
@pytest.mark.parametrize(
    ("said", "runs"),
    [
        ("Warning: singular matrix:  check node k", True),  # it has gone on with a shorter step
        ("doAnalyses: TRAN:  Timestep too small; time = 0.1", False),
        ("run simulation(s) aborted", False),
    ],
)
def test_what_ngspice_recovers_from_is_no_failure(said, runs):
    output = f"Circuit: * title\n{said}\nharvested_power     =  1.5e-03 from=  0.1 to=  0.2\n"
    if runs:
        assert ngspice._measured(output, 0) == {"harvested_power": 1.5e-3}
        return
    with pytest.raises(NgspiceError, match=re.escape(said)):
        ngspice._measured(output, 0)


class TestRuns:
    @pytest.mark.parametrize(
        ("hysteresis", "kind"),
        with_slow(
            itertools.product([STOPS, None], [*LINEAR, *SWITCHED]),
            # With hysteresis a netlist has all that it has without, and more.
            slow=lambda stops, kind: kind in ("essh", "ssds coil") or not (stops or kind in ("resistor", "rectifier")),
        ),
    )
    def test_every_kind(self, kind, hysteresis):
        transducer = {**DAMPED, **({"hysteresis": hysteresis} if hysteresis else {})}
        study = bench({**LINEAR, **SWITCHED}[kind], DRIVE, **transducer)
        found = run_netlist(netlist(study, periods=3, measured_periods=2, steps_per_period=500))
        assert found["displacement_pp"] > 1e-5
        assert found["mechanical_power"] > 0
        assert (found["harvested_power"] > 0) == (kind.split()[0] not in ("open", "short", "ssds", "ssdi", "ssdv"))

    def test_every_excitation(self, tmp_path):
        (tmp_path / "force.csv").write_text("time,force\n" + "".join(f"{n / 500},{n % 7 - 3}\n" for n in range(50)))
        system, _ = objects(bench({"kind": "parallel_sshi", **LOAD, **LOOP}, DRIVE, **DAMPED, modes=[SECOND]))
        for excitation in (
            Record(file=str(tmp_path / "force.csv"), column="force", sample_rate=500.0),
            RandomBase(psd=1e-2, band=(20.0, 80.0), duration=0.1, seed=1),
            StepForce(amplitude=0.5, duration=0.05, rise_time=0.01, offset=0.1),
        ):
            found = run_netlist(export_spice(system.transducer, system.shunt, excitation))
            assert found["harvested_power"] > 0
            assert found["displacement_pp"] > 0

    def test_a_preload_alone_leaves_it_at_rest(self):
        system, _ = objects(bench({"kind": "resistor", "resistance": 1e5}, hysteresis=STOPS, modes=[SECOND]))
        found = run_netlist(export_spice(*_parts(system), StepForce(amplitude=0.0, duration=0.05, offset=0.3)))
        assert found["displacement_pp"] < 1e-9 * 0.3 / BENCH["stiffness"]

    def test_what_does_not_run_is_an_error(self):
        system, excitation = objects(bench({"kind": "open"}, DRIVE))
        text = export_spice(*_parts(system), excitation, periods=2, measured_periods=1)
        with pytest.raises(NgspiceError):
            run_netlist(text.replace("Gspring1", "Xspring1"))

    def test_a_winding_that_rings_at_a_megahertz(self, monkeypatch):
        """Followed by steps that shrank with what was left of it, a run of 20 periods took more than ten minutes."""
        wound = {"inductance": 1e-3, "quality": 10.0, "self_resonance": 1.3e6, "switch_resistance": 5.0}
        bridge = {"smoothing_capacitance": 1e-6, "load_resistance": 1e6, "diode_drop": 0.3}
        study, told = bench({"kind": "parallel_sshi", **wound, **bridge}, DRIVE), []
        monkeypatch.setattr(ngspice, "QUICK", 0.0)
        found = run_netlist(netlist(study, start="steady", periods=3, measured_periods=2), progress=told.append)
        assert found["harvested_power"] == pytest.approx(solve(study).harvested_power, rel=2e-3)
        assert all(isinstance(step, Step) and 0 < step.done <= step.total == 20 for step in told)
        assert len(told) > 3
        # Told without a bar, too, how long it still takes: of a step that took five seconds.
        late = Step(told[0], told[0].done, told[0].total, spent=10 * told[0].spent + 5)
        assert re.fullmatch(r"ngspice: \d+ % of its run, about \d+:\d\d left", late.line)
        with pytest.raises(NgspiceError, match=r"^ngspice was stopped after 0.3 s, the time limit, when \d"):
            run_netlist(netlist(study, start="steady"), timeout=0.3)


def test_operators_without_weight_are_no_elements():
    load = {"kind": "resistor", "resistance": 1e5}
    some = {"thresholds": [1e-8, 2e-8, 4e-8], "weights": [0.0, 1e6, 0.0]}
    only = {"thresholds": [2e-8], "weights": [1e6]}
    assert netlist(bench(load, DRIVE, hysteresis=some)) == netlist(bench(load, DRIVE, hysteresis=only))
    none = {"thresholds": [2e-8], "weights": [0.0]}
    assert netlist(bench(load, DRIVE, hysteresis=none)) == netlist(bench(load, DRIVE))


def test_numbers_of_a_netlist_are_finite():
    tiny = {"thresholds": [2e-8], "weights": [1e-320]}
    with pytest.raises(ParameterError, match="each must be finite"):
        netlist(bench({"kind": "resistor", "resistance": 1e5}, DRIVE, hysteresis=tiny))


@needs_ngspice
class TestAgainstPhasors:
    @pytest.mark.parametrize("kind", LINEAR)
    def test_one_mode(self, kind):
        self.compare(bench(LINEAR[kind], DRIVE, **DAMPED))

    def test_modes_base_excitation_and_effects(self):
        drive = {"kind": "sine_base", "amplitude": 2.0, "frequency": 48.0}
        linear = {name: EFFECTS[name] for name in ("leakage", "dielectric_relaxation", "creep", "load_error")}
        keys = {**DAMPED, "modes": [SECOND], "effective_mass": 0.013, "effects": linear}
        self.compare(bench(LINEAR["resistor"], drive, **keys))

    @staticmethod
    def compare(study):
        system, excitation = objects(study)
        response = frequency_response(system, [excitation.frequency], base=excitation.base)
        found = run_netlist(netlist(study, periods=30))
        amplitude = excitation.amplitude
        assert found["harvested_power"] == pytest.approx(amplitude**2 * response.harvested_power[0], rel=1e-3)
        assert found["mechanical_power"] == pytest.approx(amplitude**2 * response.mechanical_power[0], rel=1e-3)
        assert found["displacement_pp"] == pytest.approx(2 * amplitude * abs(response.displacement[0]), rel=1e-3)
        assert found["voltage_pp"] == pytest.approx(2 * amplitude * abs(response.voltage[0]), rel=1e-3, abs=1e-9)


@needs_ngspice
class TestAgainstFormulas:
    """Prescribed displacement, that is weak coupling: Guyomar, Badel, Lefeuvre & Richard 2005; Lefeuvre et al. 2005."""

    COUPLING = 1e-5

    def harvested(self, shunt, **options):
        study = bench(shunt, DRIVE, damping=0.6, coupling=self.COUPLING)
        return run_netlist(netlist(study, periods=24, **options))["harvested_power"]

    def open_voltage(self):
        """Open-circuit voltage amplitude, V."""
        elasticity = BENCH["stiffness"] - BENCH["mass"] * OMEGA**2 + 0.6j * OMEGA
        return self.COUPLING * DRIVE["amplitude"] / abs(elasticity) / CAPACITANCE

    def test_rectifier(self):
        voltage = self.open_voltage()
        found = self.harvested({"kind": "rectifier", "dc_voltage": voltage / 2})
        assert found == pytest.approx(OMEGA * CAPACITANCE * voltage**2 / (2 * np.pi), rel=2e-3)

    @pytest.mark.slow
    def test_parallel_sshi(self):
        voltage = self.open_voltage()
        loss = 1 - inversion(LOOP["quality"])
        shunt = {"kind": "parallel_sshi", "dc_voltage": voltage / loss, **LOOP, "flip_time": PERIOD / 200}
        assert self.harvested(shunt) == pytest.approx(OMEGA * CAPACITANCE * voltage**2 / (np.pi * loss), rel=1e-2)

    def test_sece(self):
        expected = 2 * OMEGA * CAPACITANCE * self.open_voltage() ** 2 / np.pi
        assert self.harvested({"kind": "sece"}) == pytest.approx(expected, rel=2e-3)

    @pytest.mark.slow
    def test_half_the_step_changes_nothing(self):
        shunt = {"kind": "parallel_sshi", "dc_voltage": 2 * self.open_voltage(), **LOOP}
        coarse, fine = self.harvested(shunt), self.harvested(shunt, steps_per_period=2000)
        assert coarse == pytest.approx(fine, rel=1e-3)


@needs_ngspice
class TestAgainstEngine:
    @pytest.mark.parametrize("kind", with_slow(SWITCHED, slow=lambda kind: kind in RARE))
    def test_switched(self, kind):
        begins = "steady" if kind == "bias_flip" else "rest"  # its bias capacitors settle slowly
        compare_with_engine(bench(SWITCHED[kind], DRIVE, **DAMPED), 3e-3, start=begins)

    @pytest.mark.parametrize(
        ("kind", "timing"),
        with_slow(
            itertools.product(["parallel_sshi", "series_sshi"], MISTIMED),
            slow=lambda kind, timing: (kind, timing) != ("series_sshi", "early"),
        ),
    )
    def test_mistimed(self, kind, timing):
        compare_with_engine(bench({**SWITCHED[kind], **MISTIMED[timing]}, DRIVE, **DAMPED), 5e-3)

    @pytest.mark.slow
    def test_source_switched_early(self):
        compare_with_engine(bench({**SWITCHED["ssdv"], "phase_lag": -0.1}, DRIVE, **DAMPED), 5e-3)

    @pytest.mark.parametrize(
        "kind", with_slow(["short", "resistor", "parallel_sshi", "sece"], slow=lambda kind: kind not in LINEAR)
    )
    def test_hysteresis(self, kind):
        # Thresholds that the charge passes, so that the operators slip.
        stops = {"thresholds": [1e-9, 5e-9], "weights": [1e7, 5e6]}
        study = bench({**LINEAR, **SWITCHED}[kind], DRIVE, **DAMPED, hysteresis=stops)
        compare_with_engine(study, 5e-3)

    @pytest.mark.parametrize(
        ("effect", "kind"), with_slow(OF_EFFECTS, slow=lambda effect, kind: (effect, kind) not in QUICK)
    )
    def test_effects(self, effect, kind):
        effects = EFFECTS if effect == "all" else {effect: EFFECTS[effect]}
        drive = {**DRIVE, "offset": 0.01} if kind == "rectifier" else DRIVE
        study = bench({**LINEAR, **SWITCHED}[kind], drive, **DAMPED, effects=effects)
        compare_with_engine(study, 5e-3)

    @pytest.mark.slow
    @pytest.mark.parametrize("kind", ["sece", "ssds"])
    def test_bent_charge_taken_at_once(self, kind):
        name = "voltage_dependent_capacitance"
        compare_with_engine(bench(SWITCHED[kind], DRIVE, **DAMPED, effects={name: EFFECTS[name]}), 5e-3)

    def test_drift_over_a_record(self):
        drive = {"kind": "step_force", "amplitude": 0.5, "duration": 0.2, "rise_time": 0.01}
        study = bench(LINEAR["resistor"], drive, **DAMPED, effects={"coupling_drift": {"relative_drift": 0.5}})
        response, still = solve(study), solve(bench(LINEAR["resistor"], drive, **DAMPED))
        assert abs(response.harvested_power / still.harvested_power - 1) > 0.1
        found = run_netlist(netlist(study))
        assert found["harvested_power"] == pytest.approx(response.harvested_power, rel=3e-3)
        assert found["displacement_pp"] == pytest.approx(2 * response.displacement_amplitude, rel=1e-3)

    @pytest.mark.parametrize("kind", ["rectifier", pytest.param("parallel_sshi", marks=pytest.mark.slow)])
    def test_effects_of_circuits(self, kind):
        study = bench(SWITCHED[kind], DRIVE, **DAMPED, effects=OF_CIRCUITS)
        plain = solve(bench(SWITCHED[kind], DRIVE, **DAMPED))
        assert abs(solve(study).harvested_power / plain.harvested_power - 1) > 0.1
        compare_with_engine(study, 5e-3)

    @pytest.mark.parametrize("kind", ["rectifier", pytest.param("sece", marks=pytest.mark.slow)])
    def test_step(self, kind):
        drive = {"kind": "step_force", "amplitude": 0.5, "duration": 0.2, "rise_time": 0.01, "offset": 0.1}
        study = bench(SWITCHED[kind], drive, **DAMPED)
        response = solve(study)
        found = run_netlist(netlist(study))
        assert found["harvested_power"] == pytest.approx(response.harvested_power, rel=1e-2)
        assert found["displacement_pp"] == pytest.approx(2 * response.displacement_amplitude, rel=1e-3)


# A structure of two tonnes, moved back by its own shunt: two thirds of its extrema follow another within the hold-off.
HEAVY = {"mass": 2000.0, "damping": 1256.6, "stiffness": 710612.0, "coupling": 0.65297, "capacitance": 1e-6}
WIGGLING = {
    "transducer": HEAVY,
    "excitation": {"kind": "sine_force", "amplitude": 500.0, "frequency": 2.71662},
    "shunts": [{
        "kind": "series_sshi", "flip_time": 6.1351e-3, "quality": 10.0, "load_resistance": 17576.0,
        "smoothing_capacitance": 2e-5,
    }],
}  # fmt: skip


@needs_ngspice
class TestSteadyStart:
    """A netlist that begins in the steady state is there at once, and stays."""

    @pytest.mark.parametrize("kind", ["series_rlc", "series negative", "current_blocking", "network", "rectifier"])
    def test_is_there_at_once(self, kind):
        study = bench({**LINEAR, **SWITCHED}[kind], DRIVE)
        compare_with_engine(study, 2e-3, start="steady", periods=1, measured_periods=1)

    @pytest.mark.parametrize("timing", [{}, {"phase_lag": -0.05}, {"phase_lag": 0.3}])
    def test_with_a_switch(self, timing):
        # Early by less than the switch is closed: some action is always under way.
        study = bench({**SWITCHED["parallel_sshi"], **timing}, DRIVE)
        compare_with_engine(study, 3e-3, start="steady")

    @pytest.mark.parametrize("kind", with_slow(STAGED, slow=lambda kind: kind in ("essh", "ssds coil")))
    def test_capacitors_and_coils_of_its_own(self, kind):
        compare_with_engine(bench(SWITCHED[kind], DRIVE), 2e-3, start="steady")

    @pytest.mark.parametrize("kind", with_slow(("sece coil", "sice", "sc_sece"), slow=lambda kind: kind != "sice"))
    def test_a_bridge_that_is_closed_too_long(self, kind):
        """Its diodes keep the coil from inverting the voltage, and its current goes round through all of them."""
        diodes = {"diode_drop": 0.01, "diode_resistance": 200.0}
        compare_with_engine(bench({**SWITCHED[kind], **diodes, "on_time_error": 0.4}, DRIVE), 3e-3, start="steady")

    def test_hysteresis_modes_and_effects(self):
        stops = {"thresholds": [1e-9, 5e-9], "weights": [1e7, 5e6]}
        drive = {**DRIVE, "offset": 0.01}
        effects = {name: EFFECTS[name] for name in ("dielectric_relaxation", "creep", "friction", "bias_current")}
        study = bench(LINEAR["resistor"], drive, **DAMPED, hysteresis=stops, modes=[SECOND], effects=effects)
        compare_with_engine(study, 3e-3, start="steady", periods=1, measured_periods=1)

    def test_hold_off(self):
        found = compare_with_engine(WIGGLING, 1e-2, start="steady", periods=16)
        without = {**WIGGLING, "shunts": [{**WIGGLING["shunts"][0], "hold_off": 0.0}]}
        assert solve(without).harvested_power > 1.5 * found["harvested_power"]

    def test_a_study_without_a_steady_state_begins_at_rest(self):
        study = {**WIGGLING, "shunts": [{**WIGGLING["shunts"][0], "load_resistance": 2929.3, "flip_time": 0.018405}]}
        assert not solve(study).converged
        assert " from rest, of which" in netlist(study, start="steady")


# Pins of LTspice's own symbols (lib/sym/*.asy), from the symbol's place.
PINS = {
    "res": ((16, 16), (16, 96)), "ind": ((16, 16), (16, 96)), "cap": ((16, 0), (16, 64)),
    "voltage": ((0, 16), (0, 96)), "diode": ((16, 0), (16, 64)),
}  # fmt: skip


def netlist_of(schematic):
    """Net list of a schematic without wires, as LTspice makes it: nets are the labels at the pins."""
    labels, parts, directives = {}, [], []
    for line in schematic.splitlines():
        match line.split():
            case ["FLAG", x, y, name]:
                labels.setdefault((int(x), int(y)), name)
            case ["SYMBOL", kind, x, y, "R0"]:
                nets = [labels.pop((int(x) + across, int(y) + down)) for across, down in PINS[kind]]
                parts.append({"nets": nets})
            case ["SYMATTR", key, *value]:
                parts[-1][key] = " ".join(value)
            case ["TEXT", _, _, "Left", "2", *words] if words[0].startswith("!"):
                directives += line.partition("!")[2].split("\\n")
    assert not labels
    lines = [" ".join([p["InstName"], *p["nets"], p["Value"], p.get("SpiceLine", "")]) for p in parts]
    return "\n".join(["* from a schematic", *lines, *directives, ".end", ""])


@needs_ngspice
class TestDialects:
    @pytest.mark.parametrize("kind", ["series_rlc", "rectifier"])
    def test_a_schematic_is_the_same_circuit(self, kind):
        text = netlist(bench({**LINEAR, **SWITCHED}[kind], DRIVE), start="steady", periods=2, measured_periods=1)
        assert run_netlist(netlist_of(schematic(text))) == pytest.approx(run_netlist(text), rel=1e-9)

    def test_a_subcircuit_is_one_directive(self):
        """Its lines stay together in whatever order LTspice takes the directives."""
        drawn = schematic(netlist(bench(SWITCHED["rectifier"], DRIVE, hysteresis=STOPS)))
        (whole,) = (line for line in drawn.splitlines() if ".subckt" in line)
        begin, end = whole.index(".subckt transducer"), whole.index(".ends transducer")
        assert begin < whole.index("Cslip2 ") < end and whole.partition(" 2 ")[2].startswith("!.subckt")
        assert whole.endswith(".ends transducer")

    def test_each_has_its_own_options(self):
        text = {d: netlist(bench(SWITCHED["rectifier"], DRIVE), dialect=d) for d in (None, "ngspice", "ltspice")}
        assert ["plotwinsize" in text[d].replace("plotwinsize=0 keeps", "") for d in text] == [True, False, True]
        assert "LTspice" not in text["ngspice"].partition("--- values")[0]
        assert "ngspice" not in text["ltspice"]

    def test_comparison(self):
        system, excitation = objects(bench(SWITCHED["rectifier"], DRIVE))
        figures, trusted = compare(system, excitation)
        assert trusted
        assert max(abs(figure.difference) for figure in figures) < 2e-3
        figures, _ = compare(system, excitation, diodes="D(Is=1e-12 N=1)")
        assert figures[0].name == "harvested_power"
        assert figures[0].difference < -0.2  # diodes take much of the 2 V that there are


@needs_ngspice
class TestRealDiodes:
    """Under a high voltage diodes are ideal but for a drop of about n V_T ln(i/Is), a small part of it."""

    KINDS = ("rectifier", "doubler", "battery", "half_wave", "sshc", "series_sshi")

    @pytest.mark.parametrize("kind", with_slow(KINDS, slow=lambda kind: kind in ("half_wave", "sshc", "series_sshi")))
    def test_nearly_ideal_under_a_high_voltage(self, kind):
        # 0.54 V at the milliampere that flows here, against 160 V and more.
        shunt = {k: v for k, v in SWITCHED[kind].items() if k not in ("diode_resistance", "diode_leakage")}
        study = bench({**shunt, "diode_drop": 0.54}, {**DRIVE, "amplitude": 8.0}, **DAMPED)
        found = run_netlist(netlist(study, start="steady", diodes="D(Is=1e-12 N=1)"))
        assert found["harvested_power"] == pytest.approx(solve(study).harvested_power, rel=3e-3)

    def test_a_diode_of_the_catalogue(self):
        text = netlist(bench(SWITCHED["rectifier"], DRIVE), diodes="BAT54")
        assert ".model diode D(IS=2.117e-07 N=1.016 RS=2.637)" in text

    def test_from_the_steady_state_of_the_same_diodes_the_run_is_short(self):
        shunt = {"kind": "rectifier", **LOAD, "diode": "BAT54"}
        study = study_from({"title": "", **bench(shunt, DRIVE)}, Path("study.toml"))
        texts = [
            export_spice(study.transducer, study.shunts[0], study.excitation, diodes=name)
            for name in ("BAT54", "1N4148")
        ]
        lengths = [float(text.split("\n.tran ")[1].split()[1]) for text in texts]
        assert lengths[0] < 0.5 * lengths[1]

    def test_a_wrong_model_is_refused(self):
        for model in ("1N4149", "D(Is=1n) .include x", "D(Is)"):
            with pytest.raises(ParameterError, match="must be a diode of the catalogue or a model such as"):
                netlist(bench(SWITCHED["rectifier"], DRIVE), diodes=model)
        with pytest.raises(ParameterError, match="resistor has no bridge"):
            netlist(bench(LINEAR["resistor"], DRIVE), diodes="D(Is=1n)")


class TestText:
    def test_every_value_is_a_parameter_of_the_netlist(self):
        def without_parameters(study):
            text = netlist(study, periods=20)
            return re.sub(r"^(\.param|\.options|\.tran|\*) .*$", "", text.replace("\n+ ", " "), flags=re.MULTILINE)

        study = bench(LINEAR["series_rl"], DRIVE, modes=[SECOND])
        other = bench(LINEAR["series_rl"], DRIVE, modes=[{**SECOND, "mass": 0.02}], stiffness=990.0, damping=0.1)
        other["shunts"] = [{**study["shunts"][0], "resistance": 1e5, "inductance": 210.0}]
        first, second = without_parameters(study), without_parameters(other)
        # Initial conditions and what the powers are counted in are numbers of this run.
        own = ("C", "Bharvested_rate", "Bmechanical_rate")
        for one, other_one in zip(first.splitlines(), second.splitlines(), strict=True):
            assert one == other_one or one.startswith(own)

    def test_a_detector_that_misses_extrema_is_refused(self):
        study = bench(SWITCHED["ssds"], DRIVE, effects={"missed_switching": {"threshold": 1.5}})
        with pytest.raises(
            ParameterError, match=r"detector_threshold: found 1\.5 V, for which a netlist has no element"
        ):
            netlist(study)

    def test_every_kind_of_the_package_is_known(self):
        own = {k for k, cls in registered().items() if cls.__module__.startswith("piezoharvest.")}
        missing = own - set(WRITERS)
        assert not missing, f"write a function for {missing} in piezoharvest/spice/circuits.py and enter it in WRITERS"
        assert set(WRITERS) == own

    @pytest.mark.parametrize(
        ("kind", "begins"), [*((kind, "rest") for kind in [*LINEAR, *SWITCHED]), ("parallel_sshi", "steady")]
    )
    def test_only_what_both_simulators_read(self, kind, begins):
        effects = EFFECTS if begins == "rest" else {}
        study = bench({**LINEAR, **SWITCHED}[kind], DRIVE, **DAMPED, hysteresis=STOPS, modes=[SECOND], effects=effects)
        text = netlist(study, start=begins)
        joined = text.replace("\n+ ", " ").splitlines()
        for line in joined:
            if line.startswith("*"):
                continue
            assert not re.search(r"[\^?&|~']|\*\*", line), line
            functions = set(re.findall(r"([a-z]+)\(", line.partition("=")[2])) if line.startswith("B") else set()
            assert functions <= {"abs", "exp", "floor", "max", "min", "sin", "sqrt"}, line
        names = [line.split()[0].lower() for line in joined if line[:1].isalpha()]
        assert len(names) == len(set(names))
        assert text.endswith(".end\n")
        assert max(map(len, text.splitlines())) <= 120
        assert "nan" not in text
        assert "inf" not in text

    def test_base_acceleration_pushes_backwards(self):
        drive = {"kind": "sine_base", "amplitude": 2.0, "frequency": 48.0}
        text = netlist(bench({"kind": "open"}, drive, modes=[SECOND], effective_mass=0.013))
        assert ".param drive_gain=-0.013\n" in text
        assert f".param drive_gain_2=-{SECOND['mass']}\n" in text

    def test_title_is_one_line(self):
        system, excitation = objects(bench({"kind": "open"}, DRIVE))
        text = export_spice(*_parts(system), excitation, title="a\nb  c")
        assert text.splitlines()[0] == "* a b c"

    def test_a_run_that_is_cut_says_so(self):
        loads = {"load_resistance": 1e6, "smoothing_capacitance": 1e-4}
        assert "may be short" in netlist(bench({"kind": "rectifier", **loads}, DRIVE))
        assert "may be short" not in netlist(bench({"kind": "rectifier", **LOAD}, DRIVE, **DAMPED))

    def test_unknown_shunt(self):
        system, excitation = objects(bench({"kind": "open"}, DRIVE))
        shunt = Open()
        object.__setattr__(shunt, "kind", "mine")  # not a class of its own, which would stay registered
        with pytest.raises(ParameterError, match=r"found kind 'mine', .* allowed are .*network, op_amp_.*, open"):
            export_spice(system.transducer, shunt, excitation)

    def test_what_an_effect_may_not_use(self, monkeypatch):
        monkeypatch.setattr(Stiffening, "act", lambda self, specimen: specimen.push(specimen.q))
        system, excitation = objects(bench({"kind": "open"}, DRIVE, effects={"stiffening": EFFECTS["stiffening"]}))
        with pytest.raises(ParameterError, match=r"effects: found terms of q, .* allowed are one, drive, v_t"):
            export_spice(*_parts(system), excitation)

    def test_what_sensors_make_of_it_is_not_there(self):
        study = bench({"kind": "open"}, DRIVE, effects={"displacement_lag": {"time_constant": 1e-3}})
        assert "displacement_lag is not in this netlist" in netlist(study)

    @pytest.mark.parametrize(
        ("options", "key"),
        [
            ({"periods": 2}, "periods"),
            ({"measured_periods": 0}, "measured_periods"),
            ({"steps_per_period": 0}, "steps_per_period"),
        ],
    )
    def test_counts(self, options, key):
        system, excitation = objects(bench({"kind": "open"}, DRIVE))
        with pytest.raises(ParameterError) as caught:
            export_spice(*_parts(system), excitation, **options)
        assert caught.value.key == key

    def test_angle_without_a_period(self):
        system, _ = objects(bench({"kind": "open"}))
        shunts: list[Shunt] = [ParallelSSHI(**LOAD, **LOOP, phase_lag=0.1), SSDV(**LOOP, source_voltage=1, phase_lag=1)]
        for shunt in shunts:
            with pytest.raises(ParameterError, match="time_lag"):
                export_spice(system.transducer, shunt, StepForce(amplitude=1.0, duration=1.0))

    def test_no_damping_and_no_coupling(self):
        system, excitation = objects(bench({"kind": "open"}, DRIVE, damping=0.0, coupling=0.0))
        text = export_spice(system.transducer, Resistor(resistance=1e3), excitation)
        assert "Rdamping" not in text


def _parts(system):
    return system.transducer, system.shunt
