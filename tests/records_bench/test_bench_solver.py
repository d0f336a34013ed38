"""The bench's solver against independent integrations, and its own energy balance."""

import ast
from pathlib import Path

import numpy as np
import pytest
from bench_runs import HOLD, LINEAR, LOAD, OPEN, SHORT, SINE, STACK, C, K, T, error, waves
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.reference import simulate as reference
from scipy.integrate import simpson, solve_ivp
from selection import with_slow
from studies import BENCH, DRIVE, SECOND, STOPS, solve

import piezoharvest.bench
from piezoharvest.bench.solver import SolverError
from piezoharvest.description.hysteresis import stop
from piezoharvest.study import build_excitation

# What the solver promises, relative to the largest value of each waveform.
PROMISED = 1e-7
RLC = {"resistance": 2e4, "inductance": 300.0, "capacitance": 80e-9}
SHUNTS = {
    "open": OPEN,
    "short": SHORT,
    "resistor": {"kind": "resistor", "resistance": 8e4},
    "series_rl": {"kind": "series_rl", "inductance": 200.0, "resistance": 2e4},
    "parallel_rl": {"kind": "parallel_rl", "inductance": 200.0, "resistance": 2e5},
    "series_rlc": {"kind": "series_rlc", **RLC},
    "parallel_rlc": {"kind": "parallel_rlc", **RLC},
    "rectifier": {"kind": "rectifier", "smoothing_capacitance": 1e-6, "load_resistance": 1e5, "diode_drop": 0.3},
    "rectifier dc": {"kind": "rectifier", "dc_voltage": 2.0},
}
LOOP = {"inductance": 0.1, "quality": 5.0}
SMOOTHED = {"smoothing_capacitance": 1e-7, "load_resistance": 1e6}
SWITCHED = {
    "parallel_sshi": {"kind": "parallel_sshi", **SMOOTHED, **LOOP, "phase_lag": 0.2, "on_time_error": 0.2},
    "series_sshi": {"kind": "series_sshi", **SMOOTHED, **LOOP, "on_time_error": 0.4, "phase_lag": 0.1},
    "ssdi": {"kind": "ssdi", **LOOP, "on_time_error": 0.3},
    "ssdv": {"kind": "ssdv", **LOOP, "source_voltage": 1.0, "phase_lag": -0.1},
    "sece": {"kind": "sece", "phase_lag": 0.2},
    "ssds": {"kind": "ssds", "hold_off": 0.015},
}


def check(excitation, shunt, transducer, length, tolerance=PROMISED, rate=1000.0, **oracle):
    found = waves(excitation, shunt, transducer, length=length, rate=rate)
    study = {"transducer": transducer, "excitation": excitation, "shunts": [shunt]}
    wanted = reference(study, 0, duration=length, times=found.time, **oracle)
    # What is zero by nature (the voltage of a short) is so to rounding.
    floor = 1e-3 * np.abs(wanted.x).max() * transducer["coupling"] / transducer["capacitance"]
    # A bridge's current begins with a jump of its slope, and the stack's mass rings for microseconds.
    assert error(found.displacement, wanted.x) < tolerance
    assert error(found.velocity[1:], wanted.u[1:]) < 10 * tolerance
    assert error(found.voltage, wanted.v, floor) < tolerance
    if shunt["kind"] in ("open", "sece", "ssds"):
        assert not found.current.any()
    else:
        assert error(found.current[1:], wanted.i[1:]) < 10 * tolerance
    return found, wanted


@pytest.mark.parametrize(
    "hysteresis",
    [pytest.param({}, id="plain", marks=pytest.mark.slow), pytest.param({"hysteresis": STOPS}, id="hysteresis")],
)
@pytest.mark.parametrize("shunt", SHUNTS)
def test_cantilever_against_the_oracle(shunt, hysteresis):
    check(DRIVE, SHUNTS[shunt], {**BENCH, **hysteresis}, 0.2)


@pytest.mark.parametrize("kind", with_slow(SWITCHED, slow=lambda kind: kind not in ("parallel_sshi", "sece")))
def test_switched_circuits_against_the_oracle(kind):
    """Late, early, closed for too long, with extrema left out; from rest, with hysteresis, samples within flips."""
    found, _ = check(DRIVE, SWITCHED[kind], {**BENCH, "hysteresis": STOPS}, 0.05, rate=10000.0)
    assert len(found.pulses) == 3 if kind == "ssds" else len(found.pulses) >= 4


REAL = {"core_resistance": 1e4, "switch_resistance": 200.0, "self_resonance": 8e3}


@pytest.mark.parametrize("keys", [("core_resistance",), tuple(REAL)], ids=["core", "core and winding"])
@pytest.mark.parametrize("kind", ["parallel_sshi", "ssdv", "bias_flip"])
def test_real_coils_of_further_circuits_as_in_the_engine(kind, keys):
    """Two sets of equations and two ways to solve them; SSDI is held against DOP853 in literature/test_wound_coils."""
    side = {} if kind == "ssdv" else SMOOTHED
    more = {"ssdv": {"source_voltage": 1.0}, "bias_flip": {"steps": 3, "bias_capacitance": 4e-7}}.get(kind, {})
    shunt = {"kind": kind, **LOOP, **side, **more, **{key: REAL[key] for key in keys}}
    study = {"transducer": BENCH, "excitation": DRIVE, "shunts": [shunt]}
    wanted = solve(study, transient=0.1, samples=512).waveforms
    found = waves(DRIVE, shunt, BENCH, times=wanted.time)
    for name in ("displacement", "voltage"):
        assert error(getattr(found, name), getattr(wanted, name)) < 10 * PROMISED


ACTIVE = {
    "beside": {"kind": "negative_capacitance", "capacitance": 20e-9, "resistance": 2e5},
    "in series": {"kind": "negative_capacitance", "capacitance": 90e-9, "resistance": 3e4, "topology": "series"},
    "amplifier": {
        "kind": "op_amp_negative_capacitance", "capacitance": 20e-9, "resistance": 2e5, "gain_bandwidth": 1e4,
        "saturation": 6.0,
    },
    # Unstable at rest: it reaches its limit in a thousandth of a period, and goes on from one to the other.
    "runaway": {
        "kind": "op_amp_negative_capacitance", "capacitance": 200e-9, "resistance": 2e4, "gain_bandwidth": 1e5,
        "saturation": 6.0,
    },
}  # fmt: skip


@pytest.mark.parametrize("kind", ACTIVE)
def test_active_capacitances_against_their_equations(kind):
    """From rest; the amplifier saturates in every half period, and is released where its inputs change sign."""
    shunt = ACTIVE[kind]
    found = waves(DRIVE, shunt, BENCH, length=0.2, rate=5000.0)
    m, b, k, theta, c = (BENCH[name] for name in ("mass", "damping", "stiffness", "coupling", "capacitance"))
    part, load, limit = shunt["capacitance"], shunt["resistance"], shunt.get("saturation", np.inf)

    def rates(t, y, held=0):
        x, u, v, w = y.tolist()
        push = DRIVE["amplitude"] * np.sin(2 * np.pi * DRIVE["frequency"] * t)
        moves = 0.0
        if kind == "beside":
            rise = (-theta * u - v / load) / (c - part)
        elif kind == "in series":
            current = (v - w) / load
            rise, moves = (-theta * u - current) / c, -current / part
        else:
            moves = 0.0 if held else 2 * np.pi * shunt["gain_bandwidth"] * (v - 0.5 * w)
            rise = (-theta * u - v / load + part * moves) / (c + part)
        return [u, (push + theta * v - b * u - k * x) / m, rise, moves]

    times, y, held, rows = found.time, np.zeros(4), 0, []
    begin = 0.0
    while begin < times[-1]:

        def ends(t, y, held):
            return held * (y[2] - 0.5 * y[3]) if held else limit - abs(y[3]) if limit < np.inf else 1.0

        ends.terminal, ends.direction = True, -1
        inside = times[(times > begin) & (times <= times[-1])]
        run = solve_ivp(
            rates, (begin, times[-1]), y, "DOP853", t_eval=inside, args=(held,), events=ends, rtol=1e-11, atol=1e-25
        )  # fmt: skip
        rows += [np.column_stack([run.t, run.y.T])] if len(run.t) else []
        if run.status == 0:
            break
        begin, y = run.t_events[0][0], run.y_events[0][0]
        held = 0 if held else int(np.sign(y[3]))
    wanted = np.vstack(rows)
    assert np.array_equal(wanted[:, 0], times[1:])
    assert error(found.displacement[1:], wanted[:, 1]) < PROMISED
    # A voltage on its way from limit to limit grows by a factor e in 2 us: 1e-5 is an instant off by 2e-11 s.
    assert error(found.voltage[1:], wanted[:, 3]) < (1e-5 if kind == "runaway" else PROMISED)
    if limit < np.inf:
        assert len(rows) > 20


NETWORKS = {
    "ladder": "L1 1 2 150\nC1 2 0 30n\nR1 2 0 100k load",
    "capacitors in loops, one with the port": "C1 1 0 20n\nR1 1 2 50k\nC2 2 0 30n\nC3 2 1 10n\nR3 2 0 100k",
    "coils that meet": "L1 1 2 100\nL2 2 0 50\nL3 2 3 80\nR1 3 0 20k load\nR2 1 0 1meg",
    "a port that only coils lead to": "L1 0 1 400\nR1 2 0 300k\nL2 1 3 80\nR2 3 2 3k\nC1 2 0 10n\nC2 3 2 5n",
}


@pytest.mark.parametrize("name", NETWORKS)
def test_networks_as_in_the_engine(name):
    """By nodes and least squares here, by a normal tree there."""
    shunt = {"kind": "network", "netlist": NETWORKS[name]}
    study = {"transducer": {**BENCH, "hysteresis": STOPS}, "excitation": DRIVE, "shunts": [shunt]}
    wanted = solve(study, transient=0.1, samples=200).waveforms
    found = waves(DRIVE, shunt, study["transducer"], times=wanted.time)
    for signal in ("displacement", "voltage"):
        assert error(getattr(found, signal), getattr(wanted, signal)) < PROMISED
    assert error(found.current[1:], wanted.current[1:]) < 10 * PROMISED


BREAKER = {"envelope_capacitance": 1e-9, "threshold": 0.6, "inductance": 0.01, "quality": 6.0}
BREAKERS = {
    "sshi": {"kind": "self_powered_sshi", "dc_voltage": 1.0},
    "sshi smoothed": {"kind": "self_powered_sshi", "smoothing_capacitance": 24e-9, "load_resistance": 8e4},
    "sshi with losses": {
        "kind": "self_powered_sshi", "dc_voltage": 1.0, "diode_drop": 0.05, "diode_resistance": 3e3, "dc_leakage": 1e-6,
        "diode_leakage": 1e-6, "core_resistance": 3e3,
    },
    "series": {
        "kind": "self_powered_series_sshi", "smoothing_capacitance": 24e-9, "load_resistance": 8e4, "diode_drop": 0.05,
        "breaker_drop": 0.2, "diode_resistance": 50.0,
    },
    "series with a core": {"kind": "self_powered_series_sshi", "dc_voltage": 0.3, "core_resistance": 3e3},
    "sece": {"kind": "self_powered_sece", "diode_drop": 0.05, "core_resistance": 3e3},
    "sshi with a resistance of the base": {
        "kind": "self_powered_sshi", "dc_voltage": 1.0, "diode_drop": 0.05, "base_resistance": 2e5,
    },
    "sece with a small resistance of the base": {
        "kind": "self_powered_sece", "diode_drop": 0.05, "base_resistance": 1e3,
    },
    "series with a resistance of the base": {
        "kind": "self_powered_series_sshi", "dc_voltage": 0.3, "diode_drop": 0.05, "base_resistance": 2e5,
    },
    "ssdi": {"kind": "self_powered_ssdi"},
    "ssdi with a winding": {
        "kind": "self_powered_ssdi", "diode_drop": 0.05, "core_resistance": 3e3, "switch_resistance": 30.0,
        "self_resonance": 4e4,
    },
}  # fmt: skip


@pytest.mark.parametrize("name", BREAKERS)
@pytest.mark.parametrize("hysteresis", [{}, {"hysteresis": STOPS}], ids=["plain", "hysteresis"])
def test_electronic_breakers_as_in_the_engine(name, hysteresis):
    """From rest; the engine's are held against closed forms and ngspice in shunts/test_self_powered.

    The instants of the bench drift, by some picoseconds in ninety events. A voltage that swings from 19 to -15 V moves
    by a 1e-7th of that in seven of them, so the record is as long as eight actions take.
    """
    transducer = {**BENCH, **hysteresis}
    study = {"transducer": transducer, "excitation": DRIVE, "shunts": [{**BREAKER, **BREAKERS[name]}]}
    wanted = solve(study, transient=0.09, samples=400).waveforms
    found = waves(DRIVE, study["shunts"][0], transducer, times=wanted.time)
    assert wanted.event_names.count("switch closes") >= 7
    for signal in ("displacement", "voltage"):
        assert error(getattr(found, signal), getattr(wanted, signal)) < PROMISED
    if np.any(found.dc_voltage > 0):
        assert error(found.dc_voltage, wanted.dc_voltage) < PROMISED


def test_a_gate_misses_no_pulse_that_is_shorter_than_a_sample():
    found = waves(DRIVE, SWITCHED["ssdi"], BENCH, length=0.1, rate=500.0)
    edges = np.flatnonzero(np.diff(found.gate) > 0) + 1
    assert len(edges) == len(found.pulses)
    for edge, (closed, opened) in zip(edges, found.pulses, strict=True):
        assert found.time[edge - 1] < closed <= found.time[edge]
        assert opened - closed < 0.002
    assert set(found.gate) == {0.0, 1.0}
    assert np.isnan(waves(DRIVE, SHUNTS["resistor"], BENCH, length=0.01).gate).all()


@pytest.mark.parametrize(
    "excitation",
    [
        {"kind": "sine_base", "amplitude": 2.0, "frequency": 50.6},
        {"kind": "step_force", "amplitude": 0.02, "duration": 0.0937, "rise_time": 0.0111},
        {
            "kind": "multisine", "duration": 0.2,
            "amplitudes": [0.01, 0.01], "frequencies": [40.0, 90.0], "phases": [0.0, 1.0],
        },
    ],
    ids=lambda table: table["kind"],
)  # fmt: skip
def test_excitations_of_two_modes_against_the_oracle(excitation):
    check(excitation, SHUNTS["resistor"], {**BENCH, "hysteresis": STOPS, "modes": [SECOND]}, 0.2)


def test_stack_against_the_oracle():
    """Its mechanics are a thousand times faster than the samples."""
    found, wanted = check(SINE, LOAD, STACK, 0.25, method="Radau", rtol=1e-9)
    # Stops that turn back do so together: one event here, one for each of them there.
    assert found.events == len({round(time, 7) for time, name in wanted.events if "stop" in name}) > 10
    # Ten seconds of it take some ten thousand steps: this is what makes campaigns quick.
    assert found.steps < 2 * len(found.time)


@settings(max_examples=15, deadline=None)
@given(
    coupling=st.floats(1e-4, 3e-3),
    damping=st.floats(0.01, 1.0),
    # Where the load discharges C within a sample the oracle's explicit method is good to some 1e-6 only.
    resistance=st.floats(3e4, 1e7),
    frequency=st.floats(5.0, 120.0),
    weights=st.tuples(st.floats(0, 1e7), st.floats(0, 1e7)),
    offset=st.floats(-0.1, 0.1),
)
def test_any_study_against_the_oracle(coupling, damping, resistance, frequency, weights, offset):
    transducer = {**BENCH, "coupling": coupling, "damping": damping}
    transducer["hysteresis"] = {"thresholds": [1e-8, 1e-7], "weights": list(weights)}
    drive = {"kind": "sine_force", "amplitude": 0.02, "frequency": frequency, "offset": offset}
    check(drive, {"kind": "resistor", "resistance": resistance}, transducer, 0.1)


def test_a_load_that_discharges_within_a_sample():
    check(
        {**DRIVE, "offset": 0.03}, {"kind": "resistor", "resistance": 1300.0}, BENCH, 0.05, method="Radau", rtol=1e-10
    )


@pytest.mark.parametrize("kind", ["random_force", "random_base", "record"])
def test_random_and_recorded_drive_against_exponentials(tmp_path, kind):
    """Straight lines between the corners of the drive, which are not at the samples, are taken exactly."""
    samples = np.random.default_rng(0).normal(size=338)
    (tmp_path / "drive.csv").write_text("f\n" + "\n".join(f"{v:.17g}" for v in samples))
    table = {"kind": kind, "psd": 1e-5, "band": [5.0, 90.0], "duration": 0.5, "seed": 3}
    if kind == "record":
        table = {"kind": kind, "file": str(tmp_path / "drive.csv"), "column": "f", "sample_rate": 673.0}
    found = waves(table, {"kind": "resistor", "resistance": 8e4}, BENCH, length=0.5)
    m, b, k, t, c = (BENCH[key] for key in ("mass", "damping", "stiffness", "coupling", "capacitance"))
    rc, gain = 8e4 * c, -m if kind == "random_base" else 1.0
    # x, u, q, with v = (q - t x)/c and q' = -v/r.
    A = np.array([[0, 1, 0], [-(k + t * t / c) / m, -b / m, t / (c * m)], [t / rc, 0, -1 / rc]])
    values, vectors = np.linalg.eig(A)
    once = -np.linalg.solve(A, [0, gain / m, 0])  # what a constant drive of 1 ends at
    twice = np.linalg.solve(A, once)
    signal = build_excitation(table, tmp_path).signal()
    grid = np.union1d(signal.times[signal.times < 0.5], found.time)
    level = signal.at(grid)
    # From rest under the first value, where v = 0; a random drive comes out of nothing.
    start = 0.0 if kind != "record" else level[0] / k
    wanted = [np.array([start, 0.0, t * start])]
    for here, there, step in zip(level, level[1:], np.diff(grid), strict=False):
        slope = (there - here) / step
        transient = np.linalg.solve(vectors, wanted[-1] - once * here - twice * slope)
        wanted.append((vectors @ (np.exp(values * step) * transient)).real + once * there + twice * slope)
    x, _, q = np.array(wanted)[np.searchsorted(grid, found.time)].T
    assert error(found.displacement, x) < PROMISED
    assert error(found.voltage, (q - t * x) / c) < PROMISED


def nonlinear(t, y, force, p):
    """Equations of the cantilever with every smooth effect, written for this test alone."""
    x, u, q, polarisation, crept = y.tolist()
    now = p["T"] * (1 + p["drift"] * t)
    charge = q - now * x - p["T2"] * x * x - polarisation
    roots = np.roots([p["beta"] * p["C"], 0.0, p["C"], -charge])
    v = float(roots[np.argmin(np.abs(roots.imag))].real)
    acceleration = force(t) + (now + 2 * p["T2"] * x) * v - p["b"] * u - p["k"] * (x - crept) - p["k3"] * x**3
    return [
        u,
        acceleration / p["m"],
        p["bias"] - v / p["R"] - v / p["leak"],
        (p["Cr"] * v - polarisation) / p["tau_r"],
        (p["ratio"] * (x - crept) - crept) / p["tau_c"],
    ]


def test_all_smooth_effects_at_once_against_dop853():
    p = {"T": 1e-3, "C": 40e-9, "m": 0.01, "b": 0.0628, "k": 986.96, "R": 8e4}
    p |= {"beta": 2e-3, "k3": 5e8, "T2": 0.3, "drift": -0.5, "leak": 3e5, "bias": 1e-6, "Cr": 2e-8, "tau_r": 0.03}
    p |= {"ratio": 0.1, "tau_c": 0.05}
    effects = {
        "voltage_dependent_capacitance": {"beta": p["beta"]},
        "stiffening": {"cubic_stiffness": p["k3"]},
        "nonlinear_coupling": {"quadratic_coupling": p["T2"]},
        "coupling_drift": {"relative_drift": p["drift"] * 0.2},  # of a record of 0.2 s
        "leakage": {"resistance": p["leak"]},
        "bias_current": {"current": p["bias"]},
        "dielectric_relaxation": {"capacitance": p["Cr"], "time_constant": p["tau_r"]},
        "creep": {"compliance_ratio": p["ratio"], "time_constant": p["tau_c"]},
    }
    drive = {"kind": "sine_force", "amplitude": 0.1, "frequency": 50.6}
    found = waves(drive, {"kind": "resistor", "resistance": p["R"]}, BENCH, effects=effects, length=0.2)

    def force(t):
        return 0.1 * np.sin(2 * np.pi * 50.6 * t)

    options = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-16, "t_eval": found.time}
    wanted = solve_ivp(nonlinear, (0, 0.2), np.zeros(5), args=(force, p), **options).y
    assert error(found.displacement, wanted[0]) < PROMISED
    assert error(found.states[:, 2], wanted[2]) < PROMISED
    assert error(found.states[:, 3], wanted[3]) < PROMISED
    assert error(found.states[:, 4], wanted[4]) < PROMISED


def test_a_loaded_step_decays_with_rc():
    """The stack follows F + T v at once, so that C + T^2/k discharges into the load."""
    found = waves(HOLD, LOAD, LINEAR, length=1.0)
    total = C + T * T / K
    wanted = -T * 1000.0 / K / total * np.exp(-found.time / (LOAD["resistance"] * total))
    # The mechanics settle within a millisecond; what they do not settle to is of order b/(k R C).
    assert error(found.voltage[5:], wanted[5:]) < 1e-4


def test_energy_closes():
    """Force's work is found again in damping, hysteresis, the load and what is stored."""
    found = waves(length=0.4, rate=20_000.0)
    x, u, q = found.states.T
    # Not the integral of F u: in the first microseconds the mass has to gather speed.
    work = np.sum(0.5 * (found.drive[1:] + found.drive[:-1]) * np.diff(x))
    friction = simpson(STACK["damping"] * u**2, x=found.time)
    load = simpson(found.voltage * found.current, x=found.time)
    # Where the charge turns or a stop gives way, straight lines between samples are off by their distance squared.
    pairs = zip(STACK["hysteresis"]["weights"], STACK["hysteresis"]["thresholds"], strict=True)
    hysteretic = sum(w * stop(q, r) for w, r in pairs)  # at the first sample q is where the stops are relaxed
    inside = np.sum(0.5 * (hysteretic[1:] + hysteretic[:-1]) * np.diff(q))
    v_t = (q - T * x) / C
    stored = 0.5 * STACK["mass"] * u**2 + 0.5 * K * x**2 + 0.5 * C * v_t**2
    assert work == pytest.approx(friction + load + inside + stored[-1] - stored[0], abs=1e-6 * (load + inside))
    assert min(load, inside) > 0.1 * (load + inside)


def test_the_solution_does_not_depend_on_the_samples():
    coarse, fine = waves(rate=250.0), waves(rate=4000.0)
    assert error(coarse.voltage, fine.voltage[::16]) < PROMISED
    assert error(coarse.displacement, fine.displacement[::16]) < PROMISED


def test_what_has_no_solution_is_said():
    """With beta < 0 the charge has a maximum, where v^2 = 1/(3 |beta|): 5.8 V here, and the stack would give 7.4 V."""
    effects = {"voltage_dependent_capacitance": {"beta": -0.01}}
    with pytest.raises(SolverError, match=r"no step is short enough at 0\.\d+ s"):
        waves({**HOLD, "rise_time": 0.1}, OPEN, LINEAR, effects=effects)


def test_more_steps_than_a_run_may_take_are_said(monkeypatch):
    monkeypatch.setattr("piezoharvest.bench.solver.integrator.MAX_TRIALS", 100)
    monkeypatch.setattr("piezoharvest.bench.solver.integrator.TRIALS_PER_INTERVAL", 0)
    with pytest.raises(SolverError, match=r"more than 100 steps, on the way to 0\.\d+ s"):
        waves()


def test_nothing_of_the_engine_is_used():
    """Neither the engine nor the equations that it lowers, so that data for tests do not come from what they test."""
    parts = ("engine", "linear", "equations", "predict", "spice", "description.circuit", "description.effects")
    forbidden = tuple(f"piezoharvest.{part}" for part in parts)
    for path in Path(piezoharvest.bench.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [node.module] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                assert not f"{name}.".startswith(tuple(f"{part}." for part in forbidden)), (
                    f"{path}:{node.lineno}: {name}"
                )


def test_a_current_beside_which_that_of_the_electrodes_is_nothing():
    """All of a bias current goes into the capacitor across the leads: the stops let no charge into the electrodes."""
    device = {"mass": 1.2e-8, "damping": 1e-14, "stiffness": 1.8e-12, "coupling": -2.4e-14, "capacitance": 9.7e-13}
    device["hysteresis"] = {"thresholds": [20.0], "weights": [1.6e17]}
    shunt = {"kind": "parallel_rlc", "inductance": 1e21, "resistance": 1e22, "capacitance": 1.1e-8}
    sine = {"kind": "sine_force", "amplitude": 400.0, "frequency": 0.002}
    found = waves(sine, shunt, device, effects={"bias_current": {"current": 350.0}}, length=2000.0, rate=0.1)
    assert error(found.voltage, 350.0 * found.time / 1.1e-8) < 1e-4
