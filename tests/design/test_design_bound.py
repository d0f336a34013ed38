"""The bound of passive linear shunts against closed forms, random networks, LQG control and its own dual."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import solve_continuous_are
from scipy.optimize import minimize_scalar

from piezoharvest.description.effects.electrical.leakage import Leakage
from piezoharvest.description.excitation import RandomBase, RandomForce, SineForce
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.shunts.linear.short import Short
from piezoharvest.description.transducer import Mode, Transducer
from piezoharvest.design.bound import bound_of, bounds
from piezoharvest.design.bound.certificate import certify
from piezoharvest.design.bound.density import Hats, subdivided
from piezoharvest.design.bound.mesh import Grading, mesh
from piezoharvest.design.bound.port import ElectrodePort
from piezoharvest.design.bound.reached import reach
from piezoharvest.design.bound.target import Target
from piezoharvest.design.goal import Goal
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.operation import operation_of
from piezoharvest.study import DesignOptions

BENCH = Transducer(mass=0.01, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
SINE = SineForce(amplitude=0.02, frequency=50.0)


def view_of(transducer=BENCH, objective="harvest", band=None, excitation=SINE) -> LinearView:
    operation = operation_of(excitation, band, transducer)
    return LinearView(transducer, operation, Goal(DesignOptions(objective=objective, band=band))).working()


class TestHilbertTransform:
    NODES = np.array([1.0, 1.3, 2.0, 2.2])

    @pytest.mark.parametrize("omega", [0.4, 1.1, 1.3, 1.7, 2.05, 5.0])
    def test_conjugate_and_adjoint_are_principal_values(self, omega):
        hats = Hats(self.NODES)

        def principal(numerator, n):
            # f/(u^2 - w^2) = [f/(u + w)]/(u - w)
            def inner(u):
                return numerator(u) * np.interp(u, self.NODES, np.eye(4)[n]) / (u + omega)

            edges = np.union1d(self.NODES, omega)
            return sum(self.piece(inner, a, b, omega) for a, b in pairwise(edges))

        at = np.array([omega])
        for n in (1, 2):
            conjugate = 2 * omega / np.pi * principal(lambda u: 1.0, n)
            adjoint = -2 / np.pi * principal(lambda u: u, n)
            assert hats.conjugate(at)[0, n - 1] == pytest.approx(conjugate, rel=1e-6, abs=1e-9)
            assert hats.adjoint(at)[0, n - 1] == pytest.approx(adjoint, rel=1e-6, abs=1e-9)

    @staticmethod
    def piece(f, a, b, pole):
        """Integral of f(u)/(u - pole), the logarithm at an end subtracted with that of the neighbour."""
        base = f(pole)
        smooth = quad(lambda u: (f(u) - base) / (u - pole) if u != pole else 0.0, a, b, limit=200)[0]
        logs = sum(sign * np.log(abs(end - pole)) for sign, end in ((1, b), (-1, a)) if end != pole)
        return smooth + base * logs

    def test_moments(self):
        hats = Hats(self.NODES)
        for n in (1, 2):
            inverse, first = (self.integral(n, power) for power in (-2, 1))
            assert hats.inverse_squares[n - 1] == pytest.approx(2 / np.pi * inverse, rel=1e-10)
            assert hats.first_moments[n - 1] == pytest.approx(first, rel=1e-10)

    def integral(self, n, power):
        def inner(u):
            return np.interp(u, self.NODES, np.eye(4)[n]) * u**power

        return sum(quad(inner, a, b)[0] for a, b in pairwise(self.NODES))


class TestOneFrequency:
    @pytest.mark.parametrize("frequency", [45.0, 50.0, 50.6, 70.0])
    def test_any_frequency_of_a_single_mode_offers_the_same_power(self, frequency):
        found = bound_of(view_of(excitation=SineForce(amplitude=0.02, frequency=frequency)))
        limit = 0.02**2 / (8 * BENCH.damping)
        assert found.harvested_power == pytest.approx(limit, rel=1e-9)
        assert found.any_interface == pytest.approx(limit, rel=1e-9)

    def test_a_mode_that_can_be_cancelled_has_no_least_displacement(self):
        assert bound_of(view_of(objective="damping")).attenuation_db is None

    def test_displacement_is_the_distance_of_a_disc(self):
        modes = (Mode(mass=0.004, stiffness=4000.0, damping=0.2, coupling=-5e-4),)
        host = Transducer(mass=0.01, damping=0.3, stiffness=986.96, coupling=3e-4, capacitance=40e-9, modes=modes)
        view = view_of(host, "damping", excitation=SineForce(amplitude=0.02, frequency=70.0))
        at = ElectrodePort(view).at(np.array([2 * np.pi * 70.0]))
        x, a, centre = at.displacement[0], at.influence[0], 1 / (2 * at.resistance[0])

        def on_circle(angle):
            return abs(x + a * centre * (1 + np.exp(1j * angle)))

        angles = np.linspace(0, 2 * np.pi, 361)
        start = angles[np.argmin([on_circle(angle) for angle in angles])]
        bounds = (start - angles[1], start + angles[1])
        least = minimize_scalar(on_circle, bounds=bounds, method="bounded", options={"xatol": 1e-10}).fun
        shorted = abs(view.response(Short(), np.array([70.0])).displacement[0])
        assert shorted == pytest.approx(abs(x + a / at.impedance[0]), rel=1e-9)
        assert bound_of(view).attenuation_db == pytest.approx(20 * np.log10(least / shorted), abs=1e-6)


@pytest.fixture(scope="module")
def bench():
    return bound_of(view_of(band=(48.0, 53.0)))


class TestBand:
    def test_bench_harvester(self, bench):
        # 567 uW by an independent convex program, discretised from below; 796 uW without causality
        assert bench.reached == pytest.approx(567e-6, rel=6e-3)
        assert bench.reached <= bench.harvested_power <= 1.01 * bench.reached
        assert bench.frequency_wise == pytest.approx(796e-6, rel=1e-3)
        assert not bench.notes

    def test_a_hundred_thousand_random_networks_stay_below(self, bench):
        view = view_of(band=(48.0, 53.0))
        op, omega = view.operation, 2 * np.pi * view.operation.frequencies
        at = ElectrodePort(view).at(omega)
        rng, best = np.random.default_rng(3), 0.0
        for _ in range(100):
            load = random_impedances(rng, 1000, omega, 1 / (2 * np.pi * 50 * BENCH.capacitance))
            drawn = np.abs(at.voltage / (at.impedance + load)) ** 2 * load.real / 2
            best = max(best, float(np.max(drawn @ op.squares)))
        assert 0.7 * bench.harvested_power < best < bench.harvested_power

    def test_what_is_reached_is_passive(self):
        view, band = view_of(band=(48.0, 53.0)), (2 * np.pi * 48.0, 2 * np.pi * 53.0)
        port = ElectrodePort(view)
        nodes = mesh(band, port.poles, Grading(10, 0.25))
        value, admittance = reach(port, Target("power", band, 0.02**2 / (band[1] - band[0])), nodes)
        omega = subdivided(np.union1d(nodes, np.geomspace(1.0, 1e5, 200)), 7)
        at, q = port.at(omega), admittance.at(omega)
        assert np.all(np.real(1 / q - at.impedance) > -2e-3 * np.abs(at.impedance))
        assert admittance.capacitances @ admittance.parts <= port.free_capacitance * (1 + 1e-9)
        assert value == pytest.approx(568e-6, rel=5e-3)

    def test_causality_counts_where_the_coupling_is_weak(self):
        found = bound_of(view_of(band=(40.0, 60.0)))
        assert found.harvested_power < 0.27 * found.frequency_wise
        assert found.reached >= 0.99 * found.harvested_power

    @pytest.mark.slow
    def test_the_sum_rule_counts(self, monkeypatch):
        # Without it Re Z_s >= 0 alone would let a negative capacitance pass for a passive network.
        view = view_of(band=(40.0, 60.0))
        certified, _ = on_a_coarse_mesh(view, "power")
        monkeypatch.setattr(ElectrodePort, "free_capacitance", np.inf)
        _, without = on_a_coarse_mesh(view, "power")
        assert without > 1.04 * certified

    def test_worst_peak(self):
        certified, reached = on_a_coarse_mesh(view_of(objective="damping", band=(40.0, 60.0)), "peak")
        assert certified <= reached <= 1.06 * certified  # 1 % on the meshes of `bound_of`

    @pytest.mark.slow
    def test_damping_within_one_per_cent(self):
        found = bound_of(view_of(objective="damping", band=(48.0, 53.0)))
        assert found.attenuation_db <= found.reached <= found.attenuation_db + 20.0 * np.log10(1.01)

    @pytest.mark.slow
    def test_several_modes_a_leak_and_a_moving_base(self):
        modes = (Mode(mass=0.004, stiffness=900.0, damping=0.02, coupling=-5e-4),)
        host = replace(BENCH, modes=modes, effects=(Leakage(resistance=5e6),))
        base = RandomBase(psd=1e-3, band=(40.0, 90.0), duration=10.0, seed=1)
        certified, reached = on_a_coarse_mesh(view_of(host, excitation=base), "power")
        assert reached <= certified <= 1.06 * reached
        assert certified < 0.6 * bounds._frequency_wise(ElectrodePort(view_of(host, excitation=base)), "power")


def on_a_coarse_mesh(view, kind):
    """Certified and reached value on a mesh that takes little time."""
    port, target = ElectrodePort(view), bounds._target(view, kind)
    nodes = mesh(target.band, port.poles, Grading(10, 0.2))
    return certify(port, target, nodes, bounds._support(port, target, nodes)), reach(port, target, nodes)[0]


def random_impedances(rng, count, omega, size):
    """Impedances (count, f) of random ladders of two series and two parallel branches of R, L and C."""

    def branch():
        r, x, y = size * np.exp(rng.uniform(-6, 4, (3, count, 1)))
        ratio = omega / (2 * np.pi * rng.uniform(40, 62, (count, 1)))
        resonant = r + 1j * x * (ratio - 1 / ratio)
        choice = rng.integers(0, 4, (count, 1))
        return np.select([choice == 0, choice == 1, choice == 2], [r + 0 * ratio, resonant, r + 1j * x * ratio],
                         r - 1j * y / ratio)  # fmt: skip

    inner = branch() + branch()
    return branch() + 1 / (1 / inner + 1 / branch())


class TestNoise:
    def test_no_causal_control_does_better_than_lqg(self):
        # A leak makes the optimal control of the voltage a regular one: maximise E[T u v - v^2/R].
        leak = 2e5
        host = Transducer(mass=0.01, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=1e-9,
                          effects=(Leakage(resistance=leak),))  # fmt: skip
        psd = 1e-6
        white = RandomForce(psd=psd, band=(0.5, 1000.0), duration=10.0, seed=1)
        found = bound_of(view_of(host, excitation=white))
        m, b, k, t = host.mass, host.damping, host.stiffness, host.coupling
        a, drive = np.array([[0, 1], [-k / m, -b / m]]), np.array([[0], [-t / m]])
        cross = np.array([[0], [-t / 2]])
        value = solve_continuous_are(a, drive, np.zeros((2, 2)), np.array([[1 / leak]]), s=cross)
        lqg = -value[1, 1] * psd / (2 * m**2)
        assert 0.97 * lqg <= found.reached <= lqg
        assert found.harvested_power <= 1.01 * lqg  # as close as the certified value is to what is reached

    @pytest.mark.slow
    def test_mean_square_displacement(self):
        noise = RandomForce(psd=1e-6, band=(20.0, 100.0), duration=10.0, seed=1)
        certified, reached = on_a_coarse_mesh(view_of(objective="damping", excitation=noise), "mean_square")
        assert certified <= reached <= 1.05 * certified


class TestWhatIsSaid:
    def test_no_loss_no_bound(self):
        found = bound_of(
            view_of(Transducer(mass=0.01, damping=0.0, stiffness=986.96, coupling=1e-3, capacitance=40e-9))
        )
        assert found.harvested_power is None
        assert found.notes == ("no bound: the transducer has no loss",)

    def test_hysteresis_is_linearised(self):
        hysteresis = Hysteresis(weights=(2e6, 1e6), thresholds=(1e-7, 3e-7))
        host = Transducer(mass=0.01, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9,
                          hysteresis=hysteresis)  # fmt: skip
        found = bound_of(view_of(host))
        assert found.linearised
        assert found.harvested_power < found.any_interface == pytest.approx(0.02**2 / (8 * 0.0628))

    def test_json(self, run):
        found = run(BENCH, 50.3, candidates=("resistor",)).as_json()
        assert set(found["bound"]) == {
            "harvested_power", "attenuation_db", "reached", "frequency_wise", "any_interface", "linearised",
        }  # fmt: skip
        assert found["candidates"][0]["gap_to_bound"] == pytest.approx(
            1 - found["candidates"][0]["harvested_power"] / found["bound"]["harvested_power"]
        )


def test_a_gap_that_rounds_to_the_promise_is_told_with_the_digits_that_show_it():
    """A plate's worst peak: reached 4.1417 um, certified 4.1006 um; "only within 1.0 %" reads as if it were kept."""
    assert "comes within 1.001 % of it, not 1 %" in bounds._gap(4.100644e-6, 4.059596e-6, "power")
    assert "comes within 0.08651 dB of it, not 0.08643 dB" in bounds._gap(4.100644e-6, 4.141689e-6, "peak")
    assert bounds._agree(4.1e-6, 4.1e-6 * 1.0099) and not bounds._agree(4.100644e-6, 4.141689e-6)


def test_a_gap_of_displacements_is_told_in_decibels_as_the_bound_is():
    """Beside -29.7 dB it read "within 51.59 % of it"."""
    assert "comes within 3.614 dB of it" in bounds._gap(1e-6, 1.516e-6, "peak")
