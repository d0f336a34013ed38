"""The linear view against hand formulas, against itself by two ways, and as python-control uses it."""

import dataclasses
import subprocess
import sys

import control as ct
import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from piezoharvest import linear
from piezoharvest.description.circuit import Product
from piezoharvest.description.effects import DielectricRelaxation, Leakage
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import (
    CurrentBlocking,
    CurrentFlowing,
    LinearShunt,
    NegativeCapacitance,
    Open,
    ParallelBranches,
    ParallelRL,
    ParallelRLC,
    Rectifier,
    Resistor,
    SeriesRL,
    SeriesRLC,
    Short,
)
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Electrode, Mode, Transducer
from piezoharvest.linear import TwoPort

PLAIN = Transducer(mass=0.010, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
HYSTERESIS = Hysteresis(thresholds=(1e-7, 3e-7), weights=(5e5, 1.5e6))
FULL = dataclasses.replace(
    PLAIN,
    effective_mass=0.012,
    hysteresis=HYSTERESIS,
    modes=(
        Mode(mass=0.010, damping=0.2, stiffness=4e4, coupling=5e-4, force_participation=0.8, effective_mass=-0.006),
        Mode(mass=0.020, damping=0.3, stiffness=5e5, coupling=-8e-4, force_participation=-0.5),
    ),
    effects=(Leakage(resistance=1.3e5), DielectricRelaxation(capacitance=8e-9, time_constant=2e-3)),
)
PAPER = Transducer(
    mass=0.0158, damping=1250.0, stiffness=3.125e8, coupling=7.822, capacitance=3.2e-6,
    hysteresis=Hysteresis(thresholds=(0.1e-6, 0.3e-6, 0.7e-6), weights=(0.5e6, 1.5e6, 0.5e6)),
)  # fmt: skip
FREQUENCIES = np.concatenate((np.geomspace(0.1, 3e3, 60), np.linspace(45, 55, 40)))
S = 2j * np.pi * FREQUENCIES
R, L, C = 4.7e4, 180.0, 2.2e-8

TWO = {"inductances": (L, 20.0), "resistances": (R, 3e4)}  # two branches
BLOCKED = {"blocking_inductances": (25.0, 3.0), "blocking_capacitances": (4e-7, 5e-7)}


def branch(s, n, rest):
    """Admittance of a branch of inductance, resistance and an impedance."""
    return 1 / (s * TWO["inductances"][n] + TWO["resistances"][n] + rest)


def block(s, n, quality=np.inf):
    """Impedance of a blocking circuit with losses in its coil."""
    inductance, capacitance = (BLOCKED[f"blocking_{name}"][n] for name in ("inductances", "capacitances"))
    return 1 / (s * capacitance + 1 / (s * inductance + np.sqrt(inductance / capacitance) / quality))


ADMITTANCES = [
    (Open(), lambda s: 0 * s),
    (Resistor(resistance=R), lambda s: 1 / R + 0 * s),
    (SeriesRL(inductance=L, resistance=R), lambda s: 1 / (R + s * L)),
    (ParallelRL(inductance=L, resistance=R), lambda s: 1 / R + 1 / (s * L)),
    (SeriesRLC(inductance=L, resistance=R, capacitance=C), lambda s: 1 / (R + s * L + 1 / (s * C))),
    (ParallelRLC(inductance=L, resistance=R, capacitance=C), lambda s: 1 / R + 1 / (s * L) + s * C),
    (
        CurrentFlowing(**TWO, capacitances=(C, 3e-8)),
        lambda s: branch(s, 0, 1 / (s * C)) + branch(s, 1, 1 / (s * 3e-8)),
    ),
    (ParallelBranches(**TWO, capacitances=(3e-8,)), lambda s: branch(s, 0, 0) + branch(s, 1, 1 / (s * 3e-8))),
    (
        CurrentBlocking(**TWO, **BLOCKED, coil_quality=30.0),
        lambda s: branch(s, 0, block(s, 1, 30.0)) + branch(s, 1, block(s, 0, 30.0)),
    ),
    (NegativeCapacitance(capacitance=C, resistance=R), lambda s: 1 / R - s * C),
    (
        NegativeCapacitance(capacitance=9e-8, resistance=R, topology="series"),
        lambda s: 1 / (R - 1 / (s * 9e-8)),
    ),
]
SHUNTS = [shunt for shunt, _ in ADMITTANCES]
NAMES = [f"{shunt.kind}_{getattr(shunt, 'topology', '')}".strip("_") for shunt in SHUNTS]


def by_hand(transducer, y, s, slope, base=False):
    """x, v, i, q for a unit drive, by elimination: an oracle that shares no code with the package."""
    modes = transducer.all_modes
    z = [m.mass * s**2 + m.damping * s + m.stiffness for m in modes]
    base_masses = [m.mass if m.effective_mass is None else m.effective_mass for m in modes]
    gain = [-m for m in base_masses] if base else [m.force_participation for m in modes]
    beside = 0.0
    for effect in transducer.effects:
        if isinstance(effect, Leakage):
            y = y + 1 / effect.resistance
        else:
            beside = beside + effect.capacitance / (1 + s * effect.time_constant)
    # q = c v_t + d with c, d from the modes; v = v_t + slope q; s q = -y v.
    c = transducer.capacitance + beside + sum(m.coupling**2 / zi for m, zi in zip(modes, z, strict=True))
    d = sum(m.coupling * g / zi for m, g, zi in zip(modes, gain, z, strict=True))
    v_t = -d * (s + y * slope) / (c * (s + y * slope) + y)
    q = c * v_t + d
    x = [(g + m.coupling * v_t) / zi for m, g, zi in zip(modes, gain, z, strict=True)]
    displacement = sum(m.force_participation * xi for m, xi in zip(modes, x, strict=True))
    drive_velocity = sum(g * s * xi for g, xi in zip(gain, x, strict=True))
    return displacement, v_t + slope * q, q, drive_velocity


def close(a, b, tolerance=1e-9):
    """Agreement relative to the largest value over the band."""
    a, b = np.broadcast_arrays(a, b)
    return np.max(np.abs(a - b)) <= tolerance * np.max(np.abs(b))


# --- circuits -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("shunt", "formula"), ADMITTANCES, ids=NAMES)
def test_admittance(shunt, formula):
    found = linear.admittance(shunt, FREQUENCIES, PLAIN)
    assert np.max(np.abs(found - formula(S)) / np.maximum(np.abs(formula(S)), 1e-300)) < 1e-12
    assert linear.admittance(shunt, 50.0) == pytest.approx(complex(formula(2j * np.pi * 50)), rel=1e-12)


def test_every_linear_shunt_is_covered_above():
    from piezoharvest.description.shunts import registered

    shipped = [cls for cls in registered().values() if cls.__module__.startswith("piezoharvest.")]
    kinds = {cls.kind for cls in shipped if issubclass(cls, LinearShunt)}
    assert kinds - {"network"} == {shunt.kind for shunt in SHUNTS} | {"short"}


def test_admittance_of_a_short_is_infinite():
    assert np.all(np.isinf(linear.admittance(Short(), FREQUENCIES)))


@pytest.mark.parametrize("drive", ["voltage", "current"])
@pytest.mark.parametrize(("shunt", "formula"), ADMITTANCES, ids=NAMES)
def test_linearize_shunt(shunt, formula, drive):
    branched = ("current_flowing", "parallel_branches", "current_blocking")
    improper = {
        "voltage": ("parallel_rlc", "negative_capacitance_parallel"),
        "current": ("open", "series_rl", "series_rlc", *branched),
    }
    name = NAMES[SHUNTS.index(shunt)]
    if name in improper[drive]:
        with pytest.raises(ParameterError, match=r"improper .* must be"):
            linear.linearize_shunt(shunt, drive=drive)
        return
    system = linear.linearize_shunt(shunt, drive=drive)
    expected = formula(S) if drive == "voltage" else 1 / formula(S)
    assert np.allclose(system(S), expected, rtol=1e-9, atol=0)
    assert system.input_labels == [drive] and system.output_labels == [{"voltage": "current"}.get(drive, "voltage")]


def test_a_shunt_of_the_users_own_needs_nothing_else():
    class LossyCapacitor(LinearShunt):
        def equations(self, configuration, port, z, dz):
            return [port.i - 3e-9 * port.dv - port.v / 2e6]

    assert linear.admittance(LossyCapacitor(), FREQUENCIES) == pytest.approx(1 / 2e6 + 3e-9 * S, rel=1e-12)


# --- frequency response ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("base", [False, True])
@pytest.mark.parametrize("transducer", [PLAIN, FULL], ids=["plain", "full"])
@pytest.mark.parametrize(("shunt", "formula"), ADMITTANCES, ids=NAMES)
def test_frequency_response(shunt, formula, transducer, base):
    response = linear.frequency_response(System(transducer, shunt), FREQUENCIES, base=base)
    y = formula(S)
    slope = transducer.hysteresis.stiffness if transducer.hysteresis else 0.0
    x, v, q, drive_velocity = by_hand(transducer, y, S, slope, base)
    assert close(response.displacement, x, 1e-11) and close(response.velocity, S * x, 1e-11)
    assert close(response.voltage, v, 1e-11)
    typical = transducer.coupling * np.max(np.abs(x))
    assert np.max(np.abs(response.charge - q)) <= 1e-11 * typical
    assert np.max(np.abs((response.current - y * v) / S)) <= 1e-11 * typical
    assert close(response.mechanical_power, drive_velocity.real / 2, 1e-9)


def test_short_circuit_response():
    response = linear.frequency_response(System(FULL, Short()), FREQUENCIES)
    x, _, q, _ = by_hand(FULL, 1e12, S, HYSTERESIS.stiffness)
    assert close(response.displacement, x, 1e-6) and close(response.charge, q, 1e-6)
    assert np.max(np.abs(response.voltage)) < 1e-9
    assert np.all(response.harvested_power == 0)


@pytest.mark.parametrize("shunt", SHUNTS[1:], ids=NAMES[1:])
def test_power_balance_of_a_lossless_transducer(shunt):
    """Without damping all mechanical power ends in the resistance of the shunt, if its coils have no losses."""
    lossless = dataclasses.replace(PLAIN, damping=0.0)
    shunt = dataclasses.replace(shunt, coil_quality=None) if hasattr(shunt, "coil_quality") else shunt
    response = linear.frequency_response(System(lossless, shunt), np.geomspace(20, 80, 30))
    electrical = np.real(response.voltage * np.conj(response.current)) / 2
    assert response.harvested_power == pytest.approx(electrical, rel=1e-8)
    assert response.efficiency == pytest.approx(1.0, rel=1e-8)


def test_static_gains():
    f = 1e-4
    still = dataclasses.replace(PLAIN, damping=0.0)
    opened = linear.frequency_response(System(still, Open()), f)
    shorted = linear.frequency_response(System(still, Short()), f)
    assert shorted.displacement == pytest.approx(1 / PLAIN.stiffness, rel=1e-8)
    assert shorted.charge == pytest.approx(PLAIN.coupling / PLAIN.stiffness, rel=1e-8)
    stiffness = PLAIN.stiffness + PLAIN.coupling**2 / PLAIN.capacitance
    assert opened.displacement == pytest.approx(1 / stiffness, rel=1e-8)
    assert opened.voltage == pytest.approx(-PLAIN.coupling / PLAIN.capacitance / stiffness, rel=1e-8)
    voltage_driven = linear.linearize(PLAIN, drive="voltage")
    assert voltage_driven.dcgain()[0] == pytest.approx([1 / PLAIN.stiffness, PLAIN.coupling / PLAIN.stiffness])
    # Load charge is -q_p: positive voltage charges the transducer with C + T^2/k.
    free = PLAIN.capacitance + PLAIN.coupling**2 / PLAIN.stiffness
    assert voltage_driven.dcgain()[2] == pytest.approx([-PLAIN.coupling / PLAIN.stiffness, -free])


def test_base_drive_of_one_mode_is_a_force():
    shunt = Resistor(resistance=R)
    force = linear.frequency_response(System(PLAIN, shunt), FREQUENCIES)
    base = linear.frequency_response(System(PLAIN, shunt), FREQUENCIES, base=True)
    assert base.voltage == pytest.approx(-PLAIN.mass * force.voltage, rel=1e-12)
    assert base.harvested_power == pytest.approx(PLAIN.mass**2 * force.harvested_power, rel=1e-12)
    assert base.mechanical_power == pytest.approx(PLAIN.mass**2 * force.mechanical_power, rel=1e-9)


def test_describing_function_enters_as_complex_slope():
    amplitude = 5e-7
    slope = HYSTERESIS.describing_function(amplitude)
    response = linear.frequency_response(System(FULL, Resistor(resistance=R)), FREQUENCIES, amplitude=amplitude)
    x, v, q, _ = by_hand(FULL, 1 / R, S, slope)
    for found, expected in ((response.displacement, x), (response.voltage, v), (response.charge, q)):
        assert close(found, expected, 1e-11)
    assert np.all(response.efficiency < 1)


@pytest.mark.parametrize(("point", "slope"), [("stick", 2e6), ("slip", 0.0), ((True, False), 1.5e6)])
def test_operating_point(point, slope):
    response = linear.frequency_response(System(FULL, Resistor(resistance=R)), FREQUENCIES, operating_point=point)
    assert close(response.voltage, by_hand(FULL, 1 / R, S, slope)[1], 1e-11)


def test_batch_of_designs():
    values = np.array([[1e4], [3e4], [9e4]])
    batch = linear.frequency_response(System(FULL, SeriesRL(inductance=L, resistance=values)), FREQUENCIES)
    admittances = linear.admittance(SeriesRL(inductance=L, resistance=values), FREQUENCIES)
    assert batch.displacement.shape == batch.harvested_power.shape == admittances.shape == (3, len(FREQUENCIES))
    for n, value in enumerate(values[:, 0]):
        one = linear.frequency_response(System(FULL, SeriesRL(inductance=L, resistance=value)), FREQUENCIES)
        assert batch.displacement[n] == pytest.approx(one.displacement, rel=1e-12)
        assert batch.harvested_power[n] == pytest.approx(one.harvested_power, rel=1e-12)
        assert admittances[n] == pytest.approx(1 / (value + S * L), rel=1e-12)


class StrayCapacitance(Leakage):
    """An effect that a user defines: 2 nF beside C, by the voltage across it."""

    def act(self, specimen):
        specimen.charge(2e-9 * specimen.v_t)

    def losses(self, terms):
        return ()


class Follower(Leakage):
    """One that draws in proportion to the load current, which is known only after all effects."""

    def act(self, specimen):
        specimen.draw(0.1 * specimen.i)

    def losses(self, terms):
        return [Product(0.1, terms.v, terms.i)]


def test_effects_of_what_is_known_last():
    """v_t and the load current follow from all effects; whether these stand before or after others is the same."""
    bare = dataclasses.replace(PLAIN, hysteresis=HYSTERESIS)
    follower, stray = Follower(resistance=1.0), StrayCapacitance(resistance=1.0)
    slope = HYSTERESIS.describing_function(5e-7)
    larger = dataclasses.replace(bare, capacitance=bare.capacitance + 2e-9)
    expected = by_hand(larger, 1.1 / R, S, slope)
    for effects in ((follower, stray), (stray, follower)):
        system = System(dataclasses.replace(bare, effects=effects), Resistor(resistance=R))
        found = linear.frequency_response(system, FREQUENCIES, amplitude=5e-7)
        assert close(found.displacement, expected[0], 1e-11)
        assert close(found.voltage, expected[1], 1e-11)
        assert close(found.current, expected[1] / R, 1e-11)


def test_an_effect_must_not_put_a_charge_where_only_states_can_stand():
    class Odd(Leakage):
        def act(self, specimen):
            specimen.charge(1e-9 * specimen.drive)

    with pytest.raises(ParameterError, match=r"transducer\.effects: found a charge, or the input of a stop, of drive"):
        linear.linearize(dataclasses.replace(PLAIN, effects=(Odd(resistance=1.0),)))


# --- python-control -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("base", [False, True])
@pytest.mark.parametrize("transducer", [PLAIN, FULL, PAPER], ids=["plain", "full", "paper"])
def test_state_space_is_the_exact_response(transducer, base):
    system = linear.linearize(transducer, base=base)
    assert system.input_labels == ["base_acceleration" if base else "force", "current"]
    assert system.output_labels == ["displacement", "velocity", "voltage"]
    assert system.state_labels[:2] == ["x1", "u1"] and "q" in system.state_labels
    opened = linear.frequency_response(System(transducer, Open()), FREQUENCIES, base=base)
    found = system(S)
    assert close(found[0, 0], opened.displacement) and close(found[1, 0], opened.velocity)
    assert close(found[2, 0], opened.voltage)
    two_port = TwoPort.of(transducer, FREQUENCIES)
    assert np.allclose(-found[2, 1], two_port.impedance("free"), rtol=1e-9, atol=0)


def test_further_electrodes_have_currents_and_voltages_of_their_own():
    host = dataclasses.replace(FULL, electrodes=(Electrode(capacitance=3e-8, coupling=(6e-4, -8e-4, 2e-4)),))
    plant = linear.linearize(host)
    assert plant.input_labels == ["force", "current", "current1"]
    assert plant.output_labels == ["displacement", "velocity", "voltage", "voltage1"]
    loads = np.array([1 / R, 1 / (5e4 + 2j * np.pi * 51.0 * L)])
    gains = plant(2j * np.pi * 51.0)  # v = g F + Z i, and i = v Y
    voltages = np.linalg.solve(np.eye(2) - gains[2:, 1:] * loads, gains[2:, 0])
    displacement = gains[0] @ np.array([1.0, *(loads * voltages)])
    shunt = SeriesRL(inductance=L, resistance=5e4, electrode=1, others=(Resistor(resistance=R),))
    found = linear.frequency_response(System(host, shunt), np.array([51.0]))
    assert found.voltage[0] == pytest.approx(voltages[1], rel=1e-9)
    assert found.displacement[0] == pytest.approx(displacement, rel=1e-9)


def test_voltage_drive_is_the_exact_response_but_for_the_leads():
    system = linear.linearize(PLAIN, drive="voltage")
    assert system.output_labels == ["displacement", "velocity", "charge", "current"]
    two_port = TwoPort.of(PLAIN, FREQUENCIES)
    found = system(S)
    assert np.allclose(found[3, 1], -1 / two_port.impedance("free"), rtol=1e-4)
    oc = PLAIN.open_circuit_frequency
    lead = 1e-6 / (2 * np.pi * oc * PLAIN.capacitance)
    exact = -1 / (TwoPort.of(PLAIN, [oc]).impedance("free")[0] + lead)
    assert system(2j * np.pi * oc)[3, 1] == pytest.approx(exact, rel=1e-9)
    blocked = TwoPort.of(PLAIN, [oc]).impedance("blocked")[0]
    assert abs(lead / blocked) == pytest.approx(1e-6, rel=1e-9)


@pytest.mark.parametrize("transducer", [PLAIN, FULL, PAPER], ids=["plain", "full", "paper"])
def test_voltage_drive_with_a_lead_resistance(transducer):
    resistance = 270.0
    found = linear.linearize(transducer, drive="voltage", lead_resistance=resistance)(S)
    impedance = TwoPort.of(transducer, FREQUENCIES).impedance("free") + resistance
    assert close(found[3, 1], -1 / impedance)
    assert close(found[2, 1] * S, found[3, 1])
    force = linear.frequency_response(System(transducer, Resistor(resistance=resistance)), FREQUENCIES)
    assert close(found[0, 0], force.displacement) and close(found[3, 0], force.current)
    assert close(found[2, 0] * S, force.current)


@pytest.mark.parametrize("transducer", [PLAIN, FULL], ids=["plain", "full"])
def test_feedback_with_a_resistor(transducer):
    """The plant's voltage falls with the load current; current = voltage/R closes the loop with positive sign."""
    system = linear.linearize(transducer)
    plant = system["voltage", "current"]
    sensitivity = ct.feedback(1, plant * (1 / R), sign=1)
    voltage = sensitivity * system["voltage", "force"]
    direct = linear.frequency_response(System(transducer, Resistor(resistance=R)), FREQUENCIES)
    assert close(voltage(S), direct.voltage)


@pytest.mark.parametrize("shunt", SHUNTS[1:], ids=NAMES[1:])
@pytest.mark.filterwarnings("ignore:Unused output")
def test_interconnection_with_a_shunt(shunt):
    """Signals of the same name connect: the two-port with a circuit is the closed loop."""
    names = {"parallel_rlc": "current", "negative_capacitance": "current"}
    imposed = names.get(shunt.kind, "voltage") if getattr(shunt, "topology", "parallel") == "parallel" else "voltage"
    circuit = linear.linearize_shunt(shunt, drive=imposed)
    direct = linear.closed_loop(System(FULL, shunt))
    if imposed == "voltage":
        system = linear.linearize(FULL)
        closed = ct.interconnect([system, circuit], inputs="force", outputs=["displacement", "voltage", "current"])
        expected = direct[["displacement", "voltage", "current"], "force"]
        assert close(closed(S), expected(S))
    else:
        system = linear.linearize(FULL, drive="voltage", lead_resistance=1e-3)
        closed = ct.interconnect([system, circuit], inputs="force", outputs=["displacement", "current"])
        expected = direct[["displacement", "current"], "force"](S)
        assert close(closed(S), expected, 1e-5)


def test_feedback_and_interconnection_with_a_resistor_agree_with_the_direct_loop():
    direct = linear.closed_loop(System(FULL, Resistor(resistance=R)))
    resistor = ct.ss([], [], [], [[1 / R]], inputs="voltage", outputs="current", name="resistor")
    closed = ct.interconnect(
        [linear.linearize(FULL), resistor], inputs="force", outputs=["displacement", "velocity", "voltage", "current"]
    )
    assert close(closed(S)[:3], direct(S)[:3]) and close(closed(S)[3], direct(S)[3])
    frequency = linear.frequency_response(System(FULL, Resistor(resistance=R)), FREQUENCIES)
    assert close(direct["current", "force"](S), frequency.current)


def test_bode_plot(tmp_path):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    response = ct.frequency_response(linear.linearize(FULL), 2 * np.pi * FREQUENCIES)
    ct.bode_plot(response)
    plt.savefig(tmp_path / "bode.png")
    plt.close("all")
    assert response.magnitude.shape == (3, 2, len(FREQUENCIES))


def test_describing_function_as_series_resistance():
    """Exact at its own frequency, and there equal to the complex slope."""
    amplitude, frequency = 5e-7, 73.0
    system = linear.linearize(FULL, amplitude=amplitude, frequency=frequency)
    exact = TwoPort.of(FULL, [frequency], amplitude=amplitude).impedance("free")[0]
    assert system(2j * np.pi * frequency)[2, 1] == pytest.approx(-exact, rel=1e-9)
    default = linear.linearize(FULL, amplitude=amplitude)
    sc = FULL.short_circuit_frequency
    exact = TwoPort.of(FULL, [sc], amplitude=amplitude).impedance("free")[0]
    assert default(2j * np.pi * sc)[2, 1] == pytest.approx(-exact, rel=1e-9)
    driven = linear.linearize(FULL, amplitude=amplitude, drive="voltage", lead_resistance=10.0)
    assert driven(2j * np.pi * sc)[3, 1] == pytest.approx(-1 / (exact + 10.0), rel=1e-9)


def test_importing_is_light():
    code = "import sys, piezoharvest.linear; sys.exit('control' in sys.modules or 'scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# --- two-port -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("transducer", [PLAIN, FULL, PAPER], ids=["plain", "full", "paper"])
@pytest.mark.parametrize("amplitude", [None, 5e-7])
def test_two_port_is_reciprocal_and_passive(transducer, amplitude):
    two_port = TwoPort.of(transducer, FREQUENCIES, amplitude=amplitude)
    assert two_port.is_reciprocal() and two_port.reciprocity_error < 1e-10
    assert two_port.is_passive() and two_port.passivity_margin > -1e-12


def test_impedance_matrix_of_one_mode():
    """z11 = Z_m + T^2/(s C), z12 = z21 = -T/(s C), z22 = 1/(s C)."""
    z = TwoPort.of(PLAIN, FREQUENCIES).z
    mechanical = PLAIN.mass * S + PLAIN.damping + PLAIN.stiffness / S
    assert z[:, 0, 0] == pytest.approx(mechanical + PLAIN.coupling**2 / (S * PLAIN.capacitance), rel=1e-9)
    assert z[:, 0, 1] == pytest.approx(-PLAIN.coupling / (S * PLAIN.capacitance), rel=1e-9)
    assert z[:, 1, 0] == pytest.approx(-PLAIN.coupling / (S * PLAIN.capacitance), rel=1e-9)
    assert z[:, 1, 1] == pytest.approx(1 / (S * PLAIN.capacitance), rel=1e-9)
    # Hybrid form: the equations of the model, F = Z_m u - T v, i_p = T u + s C v.
    h = TwoPort.of(PLAIN, FREQUENCIES).h
    assert np.max(np.abs(h[:, 0, 0] - mechanical)) < 1e-9 * np.max(np.abs(mechanical))
    assert h[:, 0, 1] == pytest.approx(-PLAIN.coupling, rel=1e-9)
    assert h[:, 1, 0] == pytest.approx(PLAIN.coupling, rel=1e-9)
    assert h[:, 1, 1] == pytest.approx(S * PLAIN.capacitance, rel=1e-9)


def test_matrices_belong_together():
    two_port = TwoPort.of(FULL, FREQUENCIES)
    z, y, h, chain = two_port.z, two_port.y, two_port.h, two_port.abcd
    scale = np.sqrt(np.abs(z[:, 0, 0] * z[:, 1, 1]))[:, None, None]
    identity = z @ y
    assert np.allclose(identity[:, [0, 1], [0, 1]], 1, atol=1e-9)
    assert np.all(np.abs(identity[:, 0, 1] * z[:, 1, 1]) < 1e-9 * scale[:, 0, 0])
    rng = np.random.default_rng(0)
    u, i = rng.normal(size=2) + 1j * rng.normal(size=2)
    force, v = np.moveaxis(z @ np.array([u, i]), -1, 0)
    found = np.einsum("fij,fj->fi", h, np.stack((u + 0 * v, v), -1))
    assert np.allclose(found, np.stack((force, i + 0 * v), -1), rtol=1e-8)
    found = np.einsum("fij,fj->fi", chain, np.stack((v, -i + 0 * v), -1))
    assert np.allclose(found, np.stack((force, u + 0 * v), -1), rtol=1e-8)
    assert np.allclose(np.linalg.det(chain), 1, rtol=1e-8)
    assert np.allclose(TwoPort.from_abcd(FREQUENCIES, chain).z, z, rtol=1e-8)


def test_cascade():
    """Cable capacitance across and resistance in the leads: as admittance and impedance added by hand."""
    two_port = TwoPort.of(FULL, FREQUENCIES)
    cable = two_port @ linear.parallel_element(S * 3e-9)
    assert np.allclose(1 / cable.impedance("free"), 1 / two_port.impedance("free") + S * 3e-9, rtol=1e-8)
    leads = cable @ linear.series_element(np.full(len(S), 50.0))
    assert np.allclose(leads.impedance("blocked"), cable.impedance("blocked") + 50.0, rtol=1e-8)
    assert leads.is_reciprocal(1e-7) and leads.is_passive(1e-7)
    # A second transducer joined at the leads, driven from its electrical side: chain of chains.
    pair = cable @ TwoPort(FREQUENCIES, two_port.z[:, ::-1, ::-1])
    assert np.allclose(pair.abcd, cable.abcd @ TwoPort(FREQUENCIES, two_port.z[:, ::-1, ::-1]).abcd, rtol=1e-7)
    load = 1 / linear.admittance(Resistor(resistance=R), FREQUENCIES)
    velocity = 1 / two_port.mechanical_impedance(load)
    assert close(velocity, linear.frequency_response(System(FULL, Resistor(resistance=R)), FREQUENCIES).velocity)
    with pytest.raises(ParameterError, match="frequencies"):
        two_port @ TwoPort.of(FULL, FREQUENCIES[:3])


def test_an_active_two_port_is_told_apart():
    active = TwoPort.of(PLAIN, FREQUENCIES) @ linear.parallel_element(np.full(len(S), -1e-6))
    assert not active.is_passive() and active.passivity_margin < -1e-3
    gyrating = TwoPort(FREQUENCIES, TwoPort.of(PLAIN, FREQUENCIES).z * np.array([[1, 1], [-1, 1]]))
    assert not gyrating.is_reciprocal() and gyrating.reciprocity_error == pytest.approx(2)


@pytest.mark.parametrize("amplitude", [None, 5e-7])
def test_conversion_efficiency(amplitude):
    shunt = SeriesRL(inductance=L, resistance=R)
    response = linear.frequency_response(System(FULL, shunt), FREQUENCIES, amplitude=amplitude)
    found = linear.conversion_efficiency(FULL, R + S * L, FREQUENCIES, amplitude=amplitude)
    assert found == pytest.approx(response.efficiency, rel=1e-7)
    assert np.all((found > 0) & (found < 1))


def test_power_limit():
    """No load draws more than F^2/(8 b) from a force at resonance, and the conjugate match reaches it."""
    sc = PLAIN.short_circuit_frequency
    two_port = TwoPort.of(PLAIN, [sc])
    load = two_port.impedance("free").conj()
    z_m = two_port.mechanical_impedance(load)[0]
    power = 0.5 * np.real(1 / z_m) * two_port.efficiency(load)[0]
    assert power == pytest.approx(1 / (8 * PLAIN.damping), rel=1e-9)


# --- resonances, poles, stability -----------------------------------------------------------------------------------


def test_resonances_of_one_mode():
    short, opened = linear.resonances(PLAIN)
    assert short.undamped == pytest.approx([PLAIN.short_circuit_frequency], rel=1e-12)
    assert opened.undamped == pytest.approx([PLAIN.open_circuit_frequency], rel=1e-12)
    assert short.natural == pytest.approx(short.undamped, rel=1e-9)
    critical = 2 * np.sqrt(PLAIN.stiffness * PLAIN.mass)
    assert short.damping_ratio == pytest.approx([PLAIN.damping / critical], rel=1e-9)
    assert opened.damping_ratio * opened.natural == pytest.approx(short.damping_ratio * short.natural, rel=1e-9)
    assert short.damped == pytest.approx(short.natural * np.sqrt(1 - short.damping_ratio**2))
    factors = linear.coupling_factor(PLAIN)
    assert factors.effective == pytest.approx([PLAIN.coupling_squared], rel=1e-9)
    assert factors.material == pytest.approx([PLAIN.coupling_squared / (1 + PLAIN.coupling_squared)], rel=1e-9)


def test_resonances_interlace_and_are_the_peaks_of_the_response():
    light = dataclasses.replace(FULL, effects=(), hysteresis=None, damping=0.0, modes=tuple(
        dataclasses.replace(mode, damping=0.0) for mode in FULL.modes))  # fmt: skip
    short, opened = linear.resonances(light)
    assert np.all(short.undamped < opened.undamped) and np.all(opened.undamped[:-1] < short.undamped[1:])
    assert short.natural == pytest.approx(short.undamped, rel=1e-9)
    assert opened.natural == pytest.approx(opened.undamped, rel=1e-9)
    two_port = TwoPort.of(light, np.concatenate((short.undamped, opened.undamped)))
    impedance = np.abs(two_port.impedance("free"))
    typical = np.abs(two_port.impedance("blocked"))
    assert np.all(impedance[:3] < 1e-6 * typical[:3]) and np.all(impedance[3:] > 1e6 * typical[3:])


def test_sticking_hysteresis_stiffens_the_short_circuit():
    with_it = dataclasses.replace(PLAIN, hysteresis=HYSTERESIS)
    stick, slip = linear.resonances(with_it), linear.resonances(with_it, operating_point="slip")
    series = 1 / (PLAIN.capacitance + 1 / HYSTERESIS.stiffness)
    expected = np.sqrt((PLAIN.stiffness + PLAIN.coupling**2 * series) / PLAIN.mass) / (2 * np.pi)
    assert stick.short_circuit.undamped == pytest.approx([expected], rel=1e-12)
    assert slip.short_circuit.undamped == pytest.approx([PLAIN.short_circuit_frequency], rel=1e-12)
    assert stick.open_circuit.undamped == pytest.approx(slip.open_circuit.undamped, rel=1e-12)


def test_overdamped_modes_do_not_ring():
    heavy = dataclasses.replace(PLAIN, damping=100.0)
    short = linear.resonances(heavy).short_circuit
    assert len(short.undamped) == 1 and len(short.natural) == 0


@pytest.mark.parametrize("shunt", SHUNTS, ids=NAMES)
def test_poles_are_roots_of_the_characteristic_equation(shunt):
    """At a pole the free response by hand has its determinant zero: C(s) (s + y N) + y = 0."""
    found = linear.poles(System(FULL, shunt))
    formula = dict(zip(NAMES, (f for _, f in ADMITTANCES), strict=True))[NAMES[SHUNTS.index(shunt)]]
    for pole in found[found != 0]:
        # Of what is largest there: a pole of a blocking circuit hardly moves the transducer.
        at, near = (by_hand(FULL, formula(s), s, HYSTERESIS.stiffness) for s in (pole * (1 + 1e-9), pole * 1.01))
        assert max(np.abs(a) / np.abs(b) for a, b in zip(at, near, strict=True)) > 1e4
    assert np.all(np.diff(np.abs(found)) >= -1e-9 * np.abs(found[1:]))


def test_zero_poles_are_floating_charge_and_constraints():
    assert np.sum(linear.poles(System(PLAIN, Open())) == 0) == 1
    assert np.sum(linear.poles(System(PLAIN, Short())) == 0) == 1
    assert np.sum(linear.poles(System(PLAIN, Resistor(resistance=R))) == 0) == 0
    series = NegativeCapacitance(capacitance=9e-8, resistance=R, topology="series")
    assert np.sum(linear.poles(System(PLAIN, series)) == 0) == 1
    linear.check_stability(System(PLAIN, series))


@pytest.mark.parametrize("shunt", [*SHUNTS, Short(), Rectifier(dc_voltage=3.0)], ids=[*NAMES, "short", "rectifier"])
@pytest.mark.parametrize("transducer", [PLAIN, PAPER, dataclasses.replace(PLAIN, damping=0.0)])
def test_passive_systems_are_stable(shunt, transducer):
    if shunt.kind != "negative_capacitance":
        linear.check_stability(System(transducer, shunt))


@pytest.mark.parametrize("topology", ["parallel", "series"])
@pytest.mark.parametrize("transducer", [PLAIN, dataclasses.replace(FULL, effects=())], ids=["plain", "full"])
def test_stability_limit_of_negative_capacitance(transducer, topology):
    """Parallel: C_n < C. Series: C_n > C + sum T_i^2/k_i. Hysteresis: the worst of sticking and slipping holds."""
    if topology == "parallel":
        limit, words, good, bad = transducer.stick_capacitance, "less than", 0.999, 1.001
    else:
        limit = transducer.capacitance + sum(m.coupling**2 / m.stiffness for m in transducer.all_modes)
        words, good, bad = "greater than", 1.001, 0.999

    def system(factor):
        return System(transducer, NegativeCapacitance(capacitance=factor * limit, resistance=1e5, topology=topology))

    linear.check_stability(system(good))
    with pytest.raises(ParameterError) as error:
        linear.check_stability(system(bad))
    text = str(error.value)
    assert error.value.key == "capacitance" and f"found {bad * limit:g} F, must be {words} " in text
    assert "(closed loop unstable: pole at +" in text and text.endswith(" 1/s)")
    assert float(text.split(words)[1].split()[0]) == pytest.approx(limit, rel=1e-5)


def test_cancelled_capacitance_is_refused():
    exact = System(PLAIN, NegativeCapacitance(capacitance=PLAIN.capacitance, resistance=1e5))
    with pytest.raises(ParameterError, match="capacitance: found 4e-08 F, must be less than 4e-08 F"):
        linear.check_stability(exact)


def test_series_negative_capacitance_with_a_leak_drifts_away():
    """The floating charge leaks through -C_n: a slow unstable pole at any value, for which no limit can be named."""
    leaking = dataclasses.replace(PLAIN, effects=(Leakage(resistance=1e9),))
    with pytest.raises(ParameterError, match="must be another shunt: no value is stable with this transducer"):
        linear.check_stability(System(leaking, NegativeCapacitance(capacitance=9e-8, resistance=R, topology="series")))


# --- material -------------------------------------------------------------------------------------------------------

PZT = {"d": 425e-12, "s": 23e-12, "epsilon": 1900 * 8.854e-12}


def test_stack_from_material_constants():
    """Static behaviour of the transducer is that of equation 10 with uniform stress and field."""
    area, thickness, layers = 1e-4, 1e-4, 50
    stack = linear.from_material(**PZT, area=area, thickness=thickness, layers=layers, mass=1e-3, damping=1.0)
    force, voltage = 120.0, 35.0
    strain, displacement = linear.static_matrix(**PZT) @ [force / area, voltage / thickness]
    x = (force + stack.coupling * voltage) / stack.stiffness
    q = stack.capacitance * voltage + stack.coupling * x
    assert x == pytest.approx(layers * thickness * strain, rel=1e-12)
    assert q == pytest.approx(layers * area * displacement, rel=1e-12)
    k33 = linear.material_coupling(**PZT)
    assert linear.coupling_factor(stack).material == pytest.approx([k33], rel=1e-9)
    assert linear.coupling_factor(stack).effective == pytest.approx([k33 / (1 - k33)], rel=1e-9)


@pytest.mark.parametrize("k2", [1e-9, 0.01, 0.3, 0.5, 0.9])
def test_transmission_coefficients_by_maximising_over_the_load_field(k2):
    """Units s = eps = 1, d = k, stress 1, load field -e: out e D/2 = e (k - e)/2, in T S/2 = (1 - k e)/2."""
    k = np.sqrt(k2)

    def output(e):
        return e * (k - e)

    def ratio(e):
        return output(e) / (1 - k * e)

    options = {"bounds": (0, k), "method": "bounded", "options": {"xatol": 1e-10 * k}}
    most = minimize_scalar(lambda e: -output(e), **options).x
    best = minimize_scalar(lambda e: -ratio(e), **options).x
    assert ratio(most) == pytest.approx(linear.transmission_coefficient(k2), rel=1e-7)
    assert ratio(best) == pytest.approx(linear.maximum_transmission_coefficient(k2), rel=1e-7)
    assert linear.maximum_transmission_coefficient(k2) >= linear.transmission_coefficient(k2)
    if k2 > 0.001:
        for textbook in ((2 - k2 - 2 * np.sqrt(1 - k2)) / k2, (1 / k - np.sqrt(1 / k2 - 1)) ** 2):
            assert linear.maximum_transmission_coefficient(k2) == pytest.approx(textbook, rel=1e-9)


# --- errors ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: linear.frequency_response(System(PLAIN, Rectifier(dc_voltage=3.0)), [50.0]), "shunt: found rectifier"),
        (lambda: linear.admittance(Rectifier(dc_voltage=3.0), [50.0]), "shunt: found rectifier, must be a linear"),
        (lambda: linear.poles(System(PLAIN, Rectifier(dc_voltage=3.0))), "shunt: found rectifier"),
        (lambda: linear.frequency_response(System(PLAIN), [0.0, 50.0]), "frequencies: found 0.0, must be a finite"),
        (lambda: TwoPort.of(PLAIN, [np.inf]), "frequencies: found inf"),
        (lambda: linear.linearize(PLAIN, drive="force"), 'drive: found "force", must be "current" or "voltage"'),
        (lambda: linear.linearize_shunt(Open(), drive="force"), 'drive: found "force"'),
        (lambda: linear.linearize(PLAIN, drive="voltage", lead_resistance=0.0), "lead_resistance: found 0.0"),
        (lambda: linear.linearize(FULL, amplitude=-1.0), "amplitude: found -1.0, must be a finite"),
        (lambda: linear.linearize(FULL, operating_point="slide"), 'operating_point: found "slide"'),
        (lambda: linear.linearize(FULL, operating_point=(True,)), "operating_point: found 1 flag for 2 operators"),
        (lambda: linear.material_coupling(1e-9, 1e-12, 1e-9), "d: found 1e-09, must have a magnitude below"),
        (lambda: linear.material_coupling(1e-9, -1e-12, 1e-9), "s: found -1e-12"),
        (lambda: TwoPort.of(PLAIN, [50.0]).impedance("loose"), 'mechanical: found "loose"'),
    ],
)
def test_errors(call, message):
    with pytest.raises(ParameterError, match=message):
        call()
