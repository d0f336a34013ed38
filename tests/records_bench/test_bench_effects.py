"""Every effect of the bench: absent at its null value, and at a large one as its closed form says."""

from pathlib import Path

import numpy as np
import pytest
from bench_runs import HOLD, LINEAR, LOAD, OPEN, SHORT, SINE, C, K, T, error, study, waves
from selection import with_slow

from piezoharvest.bench import measure
from piezoharvest.bench.effects import registered
from piezoharvest.bench.solver import CIRCUITS, Model, integrate
from piezoharvest.description.parameters import ParameterError
from piezoharvest.study import StudyError, build, build_excitation, build_shunt, build_transducer

FORCE = HOLD["amplitude"]
FREE = FORCE / K  # displacement of the shorted stack
SOFT = C + T * T / K  # capacitance of the free stack
SETTLING = LINEAR["damping"] / K  # by which its displacement is later than the force, s
QUIET = {"load_cell": {"noise": 0}, "laser": {"noise": 0, "resolution": 0}, "buffer": {"noise": 0}}
QUIET |= {"current_sense": {"noise": 0}, "converter": {"bits": 32}}
SWITCHED = {
    "kind": "parallel_sshi", "inductance": 0.01, "quality": 5.0, "diode_drop": 0.3, "smoothing_capacitance": 1e-5,
    "load_resistance": 1e5,
}  # fmt: skip
NULL = {
    "leakage": {"resistance": 1e18},
    "dielectric_relaxation": {"capacitance": 0.0, "time_constant": 0.1},
    "voltage_dependent_capacitance": {"beta": 0.0},
    "creep": {"compliance_ratio": 0.0, "time_constant": 0.1},
    "stiffening": {"cubic_stiffness": 0.0},
    "contact_compliance": {"coefficient": 0.0},
    "friction": {"stiffness": 0.0, "threshold": 1e-6},
    "nonlinear_coupling": {"quadratic_coupling": 0.0},
    "coupling_drift": {"relative_drift": 0.0},
    "bias_current": {"current": 0.0},
    "displacement_lag": {"time_constant": 0.0},
    "channel_skew": {"delay": 0.0},
    "clipping": {"limit": 1e9, "channel": "force"},
    "mains_hum": {"amplitude": 0.0, "frequency": 50.0, "channel": "voltage"},
    "load_error": {"relative_error": 0.0},
    "switch_delay": {"time_lag": 0.0},
    "inversion_loss": {"quality": SWITCHED["quality"]},
    "voltage_reversion": {"share": 0.0, "time_constant": 1e-3},
    "diode_drop_error": {"diode_drop": SWITCHED["diode_drop"]},
    "on_time_offset": {"on_time_error": 0.0},
    "missed_switching": {"threshold": 0.0},
    "reverse_leakage": {"conductance": 0.0},
    "probe_loading": {"resistance": 1e18, "capacitance": 0.0, "place": "leads"},
}
OF_CIRCUITS = (
    "switch_delay",
    "inversion_loss",
    "diode_drop_error",
    "on_time_offset",
    "missed_switching",
    "reverse_leakage",
)
# The smallest values that still do something: near them the equations must not lose precision.
TINY = {
    "voltage_dependent_capacitance": {"beta": 1e-15},
    "stiffening": {"cubic_stiffness": 1.0},
    "nonlinear_coupling": {"quadratic_coupling": 1e-6},
    "coupling_drift": {"relative_drift": 1e-12},
    "displacement_lag": {"time_constant": 1e-12},
}


def columns(effects, excitation=SINE, shunt=LOAD, transducer=LINEAR, **bench):
    """Columns of the only record of a quiet bench."""
    found = measure(study(excitation, shunt, transducer, effects=effects, **{"duration": 0.5, **QUIET, **bench}))
    return found.records[0].columns


def test_the_vocabulary_is_complete():
    assert set(registered()) == set(NULL)
    for name, cls in registered().items():
        assert cls.__doc__
        fields = {field: cls.__dataclass_fields__[field].metadata for field in NULL[name]}
        assert all(
            "unit" in meta and meta["doc"] for field, meta in fields.items() if field not in ("channel", "place")
        )


@pytest.mark.parametrize("name", NULL)
def test_null_value_changes_nothing(name):
    plain = waves()
    found = waves(effects={name: NULL[name]})
    for signal in ("displacement", "reading", "voltage", "current"):
        assert error(getattr(found, signal), getattr(plain, signal)) < 1e-9
    quiet = {"duration": 0.1, **QUIET}
    plain, found = (measure(study(effects=effects, **quiet)).records[0].columns for effects in ({}, {name: NULL[name]}))
    for column, values in plain.items():
        assert error(found[column], values) < 1e-8


@pytest.mark.parametrize("name", OF_CIRCUITS)
def test_null_value_changes_no_circuit(name):
    circuit = build_shunt(SWITCHED)
    assert build(registered()[name], NULL[name], name).connect(circuit) == circuit


def test_voltage_falls_back_after_a_sudden_change():
    """By the share, with the time constant, at open electrodes that the stack hardly moves."""
    stiff = {**LINEAR, "coupling": 1e-3}
    effects = {"voltage_reversion": {"share": 0.2, "time_constant": 0.05}}
    found = waves(HOLD, OPEN, stiff, effects=effects)
    wanted = -1e-3 * FREE / C * (1.0 - 0.2 * (1.0 - np.exp(-found.time[5:] / 0.05)))
    assert error(found.voltage[5:], wanted) < 1e-4


def test_probe_at_the_leads_is_a_resistance_and_a_capacitance():
    found = waves(HOLD, OPEN, LINEAR, effects={"probe_loading": {"resistance": 1e5, "capacitance": 1e-6}})
    wanted = -T * FREE / (SOFT + 1e-6) * np.exp(-found.time[5:] / (1e5 * (SOFT + 1e-6)))
    assert error(found.voltage[5:], wanted) < 1e-4


def test_probe_at_the_dc_side_discharges_the_smoothing_capacitor():
    """Held: the bridge has charged it once, and the load and the probe discharge it, until it conducts again."""
    keys = {"resistance": 1e5, "capacitance": 1e-6, "place": "dc"}
    probe = build(registered()["probe_loading"], keys, "probe_loading")
    bridge = build_shunt({"kind": "rectifier", "smoothing_capacitance": 1e-6, "load_resistance": 1e5})
    model = Model(build_transducer(LINEAR), CIRCUITS["rectifier"](probe.connect(bridge)), base=False)
    time = np.arange(60) / 1000.0
    dc = integrate(model, build_excitation(HOLD, Path()), time).dc_voltage
    assert dc[0] == 0.0
    assert error(dc[20:], dc[20] * np.exp(-(time[20:] - time[20]) / (0.5e5 * 2e-6))) < 1e-6


@pytest.mark.parametrize("name", with_slow(TINY, slow=lambda name: name == "displacement_lag"))
def test_next_to_null_changes_next_to_nothing(name):
    plain, found = waves(), waves(effects={name: TINY[name]})
    for signal in ("reading", "voltage", "current"):
        assert error(getattr(found, signal), getattr(plain, signal)) < 1e-8


def test_leakage_discharges_open_electrodes():
    found = waves(HOLD, OPEN, LINEAR, effects={"leakage": {"resistance": 1e5}})
    assert error(found.voltage[5:], -T * FREE / SOFT * np.exp(-found.time[5:] / (1e5 * SOFT))) < 1e-4
    assert not found.current.any()


def test_relaxation_takes_charge():
    """From C alone to C and the slow branch, in the time that the two in series give."""
    slow, tau = 2e-6, 0.05
    effects = {"dielectric_relaxation": {"capacitance": slow, "time_constant": tau}}
    found = waves(HOLD, OPEN, LINEAR, effects=effects)
    early, late = -T * FREE / SOFT, -T * FREE / (SOFT + slow)
    rate = (1 + slow / SOFT) / tau
    assert error(found.voltage[5:], late + (early - late) * np.exp(-rate * found.time[5:])) < 1e-4


def test_relaxation_stands_beside_the_capacitance():
    """Not across the electrodes: what it takes passes the hysteresis too, so that open electrodes let nothing pass."""
    effects = {"dielectric_relaxation": {"capacitance": 2e-6, "time_constant": 0.05}}
    found = waves(HOLD, OPEN, effects=effects)
    assert not found.states[:, 2].any()
    assert np.abs(found.states[-1, 3]) > 1e-6


def test_voltage_dependent_capacitance_at_open_electrodes():
    """C v (1 + beta v^2) + T x = 0 with k x = F + T v."""
    for beta in (5e-3, -5e-4):
        found = waves(HOLD, OPEN, LINEAR, effects={"voltage_dependent_capacitance": {"beta": beta}}, length=0.05)
        roots = np.roots([C * beta, 0.0, SOFT, T * FREE])
        wanted = roots[np.argmin(np.abs(roots + T * FREE / SOFT))].real
        assert found.voltage[-1] == pytest.approx(wanted, rel=1e-9)
        assert abs(found.voltage[-1] * SOFT / (T * FREE) + 1) > 0.01


def test_creep_of_a_held_load():
    """Shorted: x = F/k (1 + c (1 - exp(-t/tau))), and the charge is T x."""
    effects = {"creep": {"compliance_ratio": 0.3, "time_constant": 0.1}}
    found = waves(HOLD, SHORT, LINEAR, effects=effects)
    wanted = FREE * (1 + 0.3 * (1 - np.exp(-found.time[5:] / 0.1)))
    assert error(found.displacement[5:], wanted) < 1e-4
    assert error(found.states[5:, 2], T * wanted) < 1e-4


def test_a_preload_has_crept_before():
    effects = {"creep": {"compliance_ratio": 0.3, "time_constant": 0.1}}
    found = waves({**SINE, "amplitude": 0.0}, SHORT, LINEAR, effects=effects)
    assert error(found.displacement, np.full(501, 1.3 * SINE["offset"] / K)) < 1e-12


def test_stiffening_of_a_held_load():
    cubic = 0.5 * K / FREE**2
    found = waves(HOLD, SHORT, LINEAR, effects={"stiffening": {"cubic_stiffness": cubic}}, length=0.05)
    roots = np.roots([cubic, 0.0, K, -FORCE])
    assert found.displacement[-1] == pytest.approx(roots[np.abs(roots.imag) < 1e-12].real[0], rel=1e-9)


def test_a_stiff_preload_is_at_rest():
    """The start is the equilibrium of the nonlinear spring: nothing moves."""
    cubic = 0.5 * K / FREE**2
    effects = {"stiffening": {"cubic_stiffness": cubic}, "nonlinear_coupling": {"quadratic_coupling": 1e6}}
    found = waves({**SINE, "amplitude": 0.0}, LOAD, effects=effects)
    x = found.displacement[0]
    assert K * x + cubic * x**3 == pytest.approx(SINE["offset"], rel=1e-12)
    assert np.ptp(found.displacement) < 1e-9 * x
    assert np.abs(found.voltage).max() < 1e-8


def test_friction_loses_its_loop():
    """Shorted and slow, work per cycle is that of the stop, 4 k_f r (A - r), but for 0.1 % of damping."""
    stiffness, threshold = 0.3 * K, 0.3e-6
    effects = {"friction": {"stiffness": stiffness, "threshold": threshold}}
    found = waves({**SINE, "frequency": 2.0, "offset": 0.0}, SHORT, LINEAR, effects=effects, length=1.0, rate=4000.0)
    last = slice(2000, 4001)
    work = np.sum(0.5 * (found.drive[last][1:] + found.drive[last][:-1]) * np.diff(found.displacement[last]))
    amplitude = 0.5 * np.ptp(found.displacement[last])
    viscous = np.pi * LINEAR["damping"] * 2 * np.pi * 2.0 * amplitude**2
    assert amplitude == pytest.approx((SINE["amplitude"] - stiffness * threshold) / K, rel=1e-4)
    assert work - viscous == pytest.approx(4 * stiffness * threshold * (amplitude - threshold), rel=1e-3)


def test_nonlinear_coupling_of_a_held_load():
    """Shorted, the charge is T x + T2 x^2; open, v_t follows from it and pulls with T + 2 T2 x."""
    quadratic = 0.2 * T / FREE
    effects = {"nonlinear_coupling": {"quadratic_coupling": quadratic}}
    found = waves(HOLD, SHORT, LINEAR, effects=effects, length=0.05)
    assert found.states[-1, 2] == pytest.approx(1.2 * T * FREE, rel=1e-7, abs=0)  # what the solver promises
    found = waves(HOLD, OPEN, LINEAR, effects=effects, length=0.05)
    x, v = found.displacement[-1], found.voltage[-1]
    assert C * v == pytest.approx(-T * x - quadratic * x * x, rel=1e-9)
    assert K * x == pytest.approx(FORCE + (T + 2 * quadratic * x) * v, rel=1e-9)


def test_coupling_drifts_over_a_record():
    """Shorted under a held load the current is what the charge T(t) x gives away."""
    found = waves(HOLD, SHORT, LINEAR, effects={"coupling_drift": {"relative_drift": 0.1}}, length=0.2)
    assert error(found.states[5:, 2], T * FREE * (1 + 0.1 * found.time[5:] / 0.2)) < 1e-9
    assert error(found.current[5:], np.full(196, -T * FREE * 0.1 / 0.2)) < 1e-6


def test_bias_charges_open_electrodes():
    found = waves({**SINE, "amplitude": 0.0}, OPEN, LINEAR, effects={"bias_current": {"current": 1e-6}})
    assert error(found.voltage[5:], 1e-6 * found.time[5:] / SOFT) < 1e-3
    # and leaves through a load, which shows it
    effects = {"bias_current": {"current": 1e-6}}
    found = waves({**SINE, "amplitude": 0.0}, {**LOAD, "resistance": 1e3}, LINEAR, effects=effects)
    assert found.current[-1] == pytest.approx(1e-6, rel=1e-9)
    assert found.voltage[-1] == pytest.approx(1e-3, rel=1e-9)


def test_contact_adds_to_the_reading_alone():
    plain, found = waves(), waves(effects={"contact_compliance": {"coefficient": 3e-9}})
    assert error(found.reading - found.displacement, 3e-9 * found.drive ** (2 / 3)) < 1e-12
    for signal in ("displacement", "voltage", "current"):
        assert np.array_equal(getattr(plain, signal), getattr(found, signal))
    pulling = waves({**SINE, "offset": -900.0}, effects={"contact_compliance": {"coefficient": 3e-9}})
    assert np.array_equal(pulling.reading, pulling.displacement)
    pressed = {"contact_compliance": {"coefficient": 3e-9, "tension": "closed"}}
    closed = waves({**SINE, "offset": -900.0}, effects=pressed)
    assert error(closed.displacement - closed.reading, 3e-9 * np.abs(closed.drive) ** (2 / 3)) < 1e-12


def test_lag_of_the_displacement_sensor():
    """After a ramp has gone on for long, a first-order lag is behind by slope times time constant."""
    ramp = {**HOLD, "duration": 1.0, "rise_time": 1.0}
    found = waves(ramp, SHORT, LINEAR, effects={"displacement_lag": {"time_constant": 0.01}}, length=0.5)
    behind = found.displacement - found.reading
    assert error(behind[5:], 0.01 * FREE * (1 - np.exp(-(found.time[5:] - SETTLING) / 0.01))) < 1e-6


def test_contact_and_lag_together():
    """The lag takes the sum of displacement and contact: at a constant load it reads the sum."""
    effects = {"displacement_lag": {"time_constant": 0.01}, "contact_compliance": {"coefficient": 3e-9}}
    for order in (effects, dict(reversed(effects.items()))):
        found = waves({**HOLD, "offset": 100.0}, SHORT, LINEAR, effects=order)
        late = found.time[5:] - SETTLING * 1000.0 / K / (1000.0 / K + 3e-9 * (1100.0 ** (2 / 3) - 100.0 ** (2 / 3)))
        start, end = (f / K + 3e-9 * f ** (2 / 3) for f in (100.0, 1100.0))
        assert found.reading[0] == pytest.approx(start, rel=1e-12)
        assert error(found.reading[5:], end + (start - end) * np.exp(-late / 0.01)) < 1e-6


def test_skew_delays_voltage_and_current():
    plain, late = columns({}), columns({"channel_skew": {"delay": 0.0155}}, sample_rate=2000.0)
    for column in ("voltage_V", "current_A"):
        # 15.5 ms are 31 samples of 2 kHz; before the record there was rest.
        assert error(late[column][31::2], plain[column][: len(late[column][31::2])]) < 1e-7
        assert np.all(np.abs(late[column][:31]) <= np.abs(plain[column][0]) + 1e-12)
    for column in ("force_N", "displacement_m"):
        assert error(late[column][::2], plain[column]) < 1e-7


def test_clipping_of_one_channel():
    plain, found = columns({}), columns({"clipping": {"limit": 2.0, "channel": "voltage"}})
    assert np.abs(plain["voltage_V"]).max() > 2.5
    assert error(found["voltage_V"], np.clip(plain["voltage_V"], -2.0, 2.0)) < 1e-8
    assert np.array_equal(plain["current_A"], found["current_A"])


def test_hum_is_one_line_with_another_phase_in_each_record():
    records = [{"load_resistance": 5e4}, {"load_resistance": 5e4}]
    effects = {"mains_hum": {"amplitude": 0.05, "frequency": 50.0, "channel": "voltage"}}
    with_hum, without = (measure(study(effects=e, duration=1.0, records=records, **QUIET)) for e in (effects, {}))
    lines = []
    for found, plain in zip(with_hum.records, without.records, strict=True):
        spectrum = np.fft.rfft(found.columns["voltage_V"] - plain.columns["voltage_V"]) / 500
        assert np.abs(spectrum[50]) == pytest.approx(0.05, rel=1e-6)
        assert np.delete(np.abs(spectrum), 50).max() < 1e-7
        lines.append(spectrum[50])
    assert abs(lines[0] - lines[1]) > 1e-3


@pytest.mark.parametrize(("label", "wrong"), [(None, 1.05), (51.43e3, 1.05), (97.78e3, 1.0)])
def test_load_error_of_all_or_of_one_label(label, wrong):
    effects = {"load_error": {"relative_error": 0.05} | ({"resistance": label} if label else {})}
    found = columns(effects)
    assert found["voltage_V"] @ found["current_A"] / (found["current_A"] @ found["current_A"]) == pytest.approx(
        wrong * 51.43e3, rel=1e-6
    )


def test_effects_that_do_not_go_together_are_refused():
    with pytest.raises(StudyError, match=r"bench\.effects\.contact_compliance\.coefficient: found a base excitation"):
        columns(
            {"contact_compliance": {"coefficient": 1e-9}}, {"kind": "sine_base", "amplitude": 1.0, "frequency": 5.0}
        )
    with pytest.raises(StudyError, match=r"displacement_lag\.time_constant: bench\.laser\.lag is given too"):
        columns({"displacement_lag": {"time_constant": 1e-3}}, laser={"lag": 1e-3})
    with pytest.raises(ParameterError):
        build(registered()["creep"], {"compliance_ratio": -1.0, "time_constant": 1.0}, "creep")
