"""Charge taken at once where it is no straight line of the voltage: against DOP853 and root finding, written out."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq
from selection import with_slow
from studies import BENCH, STOPS, distance

from piezoharvest import SineForce, System, Transducer, simulate
from piezoharvest.description import effects, shunts
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.parameters import ParameterError

DRIVE = SineForce(amplitude=0.02, frequency=50.6)
LENGTH = 0.12


class Bench:
    """One mode, hysteresis in the charge, q = T x + C v_t (1 + beta v_t^2), a leak of g v^3 beside the extractions.

    Between two of these v has one sign, so that the charge goes one way.
    """

    def __init__(self, beta, hysteresis, leak=0.0):
        self.beta, self.hysteresis, self.leak = beta, hysteresis, leak
        self.q, self.stops, self.taken = 0.0, np.zeros(len(hysteresis["thresholds"])), 0.0

    def inner_voltage(self, x, q):
        """Voltage across the capacitance: the real root of the cubic."""
        s = (q - BENCH["coupling"] * x) / BENCH["capacitance"]
        if self.beta == 0.0:
            return s
        a = np.sqrt(3.0 * abs(self.beta))
        if self.beta > 0.0:
            return 2.0 / a * np.sinh(np.arcsinh(1.5 * a * s) / 3.0)
        return 2.0 / a * np.sin(np.arcsin(np.clip(1.5 * a * s, -1.0, 1.0)) / 3.0)

    def stops_at(self, q):
        r = np.array(self.hysteresis["thresholds"])
        return np.clip(self.stops + q - self.q, -r, r)

    def voltage(self, x, q):
        return self.inner_voltage(x, q) + np.dot(self.hysteresis["weights"], self.stops_at(q))

    def extract(self, x):
        """Move the charge until the voltage is zero; what leaves is the integral of the voltage over it."""
        far = 4.0 * abs(self.q - BENCH["coupling"] * x) + 1e-12
        end = brentq(lambda q: self.voltage(x, q), self.q - far, self.q + far, xtol=1e-26, rtol=1e-15)
        r = np.array(self.hysteresis["thresholds"])
        kinks = np.concatenate([self.q + r - self.stops, self.q - r - self.stops])
        inside = sorted(k for k in kinks if min(self.q, end) < k < max(self.q, end))
        path = [self.q, *(inside if end > self.q else inside[::-1]), end]
        for a, b in pairwise(path):
            self.taken -= quad(lambda q: self.voltage(x, q), a, b, epsabs=0, epsrel=1e-12)[0]
        self.stops, self.q = self.stops_at(end), end

    def rates(self, t, z):
        x, u, q = z.tolist()
        force = DRIVE.amplitude * np.sin(2 * np.pi * DRIVE.frequency * t)
        push = BENCH["coupling"] * self.inner_voltage(x, q)
        rate = (force + push - BENCH["damping"] * u - BENCH["stiffness"] * x) / BENCH["mass"]
        return [u, rate, -self.leak * self.voltage(x, q) ** 3]

    def run(self, times):
        """Displacement and voltage at the times, from rest."""
        waves, t, z, turning = np.zeros((2, len(times))), 0.0, np.zeros(3), -1
        while t < times[-1]:
            event = lambda t, z: z[1]  # noqa: E731
            event.terminal, event.direction = True, turning
            part = solve_ivp(
                self.rates, (t, times[-1]), z, "DOP853", events=event, dense_output=True, rtol=1e-12, atol=1e-20
            )
            here = (times >= t) & (times <= part.t[-1])
            x, _, q = part.sol(times[here])
            waves[:, here] = x, [self.voltage(*each) for each in zip(x, q, strict=True)]
            t, x, q = part.t[-1], part.y[0, -1], part.y[2, -1]
            if part.status == 1:
                self.stops, self.q = self.stops_at(q), q
                self.extract(x)
                turning = -turning
            z = np.array([x, 0.0, self.q])
        return waves


@pytest.mark.parametrize("beta", with_slow([0.0, 3e-3, 3e-2, -1e-3], slow=lambda beta: beta > 3e-3))
@pytest.mark.parametrize("stops", [{"thresholds": [], "weights": []}, STOPS], ids=["plain", "hysteresis"])
@pytest.mark.parametrize("kind", ["sece", "ssds"])
def test_agrees_with_dop853(kind, stops, beta):
    shunt = shunts.SECE(efficiency=0.9) if kind == "sece" else shunts.SSDS()
    present = (effects.VoltageDependentCapacitance(beta=beta),) if beta else ()
    hysteresis = Hysteresis(**stops) if stops["weights"] else None
    system = System(Transducer(**BENCH, hysteresis=hysteresis, effects=present), shunt)
    found = simulate(system, DRIVE, transient=LENGTH, samples=300)
    bench = Bench(beta, stops)
    x, v = bench.run(found.waveforms.time)
    taken = found.energy["harvested"] + found.energy["shunt_loss"]
    assert distance(found.waveforms.displacement, x) < 1e-9
    assert distance(found.waveforms.voltage, v) < 1e-8
    assert taken == pytest.approx(bench.taken, rel=1e-9)
    assert found.energy["harvested"] == pytest.approx((0.9 if kind == "sece" else 0.0) * taken, rel=1e-12)
    assert found.energy["closure"] < 1e-12
    if beta:  # its electrodes end without voltage: what it stored is given back
        assert abs(found.energy["voltage_dependent_capacitance"]) < 1e-5 * taken


@pytest.mark.parametrize(
    "stops", [pytest.param(None, id="plain", marks=pytest.mark.slow), pytest.param(STOPS, id="hysteresis")]
)
@pytest.mark.parametrize(
    "shunt",
    with_slow([shunts.SECE(), shunts.SSDS(), shunts.SECE(phase_lag=0.1)], slow=lambda shunt: shunt == shunts.SECE()),
    ids=str,
)
def test_steady_state_is_that_of_a_long_run(shunt, stops):
    """Found in a few periods, which it is not with wrong tangents."""
    hysteresis = Hysteresis(**stops) if stops else None
    present = (effects.VoltageDependentCapacitance(beta=3e-3), effects.NonlinearCoupling(quadratic_coupling=0.1))
    system = System(Transducer(**BENCH, hysteresis=hysteresis, effects=present), shunt)
    found = simulate(system, DRIVE)
    assert found.converged
    assert found.periods_evaluated < 12
    cycles = 150  # nine time constants of the structure, without what the shunt damps
    waited = simulate(system, DRIVE, transient=cycles / DRIVE.frequency, samples=40)
    last = waited.waveforms.displacement[-400:]
    assert 0.5 * np.ptp(last) == pytest.approx(0.5 * np.ptp(found.waveforms.displacement), rel=1e-3)


LEAK = 1e-9  # A/V^3
LEAKY = effects.Stiffening(cubic_stiffness=1.0)


@pytest.fixture
def leaky(monkeypatch):
    """An effect of a user's own instead of stiffening: the leak of the bench."""
    monkeypatch.setattr(
        effects.Stiffening, "act", lambda self, specimen: specimen.draw(LEAK * specimen.power(specimen.v, 3))
    )


@pytest.mark.parametrize("stops", [{"thresholds": [], "weights": []}, STOPS], ids=["plain", "hysteresis"])
@pytest.mark.usefixtures("leaky")
def test_a_smooth_term_without_charge_leaves_the_extraction_straight(stops):
    hysteresis = Hysteresis(**stops) if stops["weights"] else None
    system = System(Transducer(**BENCH, hysteresis=hysteresis, effects=(LEAKY,)), shunts.SECE(efficiency=0.9))
    found = simulate(system, DRIVE, transient=LENGTH, samples=300)
    bench = Bench(0.0, stops, LEAK)
    x, v = bench.run(found.waveforms.time)
    assert distance(found.waveforms.displacement, x) < 1e-9
    assert distance(found.waveforms.voltage, v) < 1e-8
    assert found.energy["harvested"] == pytest.approx(0.9 * bench.taken, rel=1e-8)
    assert found.energy["closure"] < 1e-10
    without = Bench(0.0, stops)
    assert distance(without.run(found.waveforms.time)[1], v) > 1e-3  # it is felt


@pytest.mark.usefixtures("leaky")
def test_smooth_terms_that_do_not_go_straight_are_refused():
    present = (LEAKY, effects.VoltageDependentCapacitance(beta=1e-3))
    system = System(Transducer(**BENCH, hysteresis=Hysteresis(**STOPS), effects=present), shunts.SECE())
    with pytest.raises(
        ParameterError, match=r"transducer\.effects: found a smooth term of .*, allowed are those of v_t"
    ):
        simulate(system, DRIVE, transient=0.1)


@pytest.mark.parametrize("stops", [None, STOPS], ids=["plain", "hysteresis"])
def test_a_bent_charge_between_shorted_leads(stops):
    """A coupling that goes with x^2 moves charge alone there: without hysteresis the structure is linear."""
    hysteresis = Hysteresis(**stops) if stops else None
    present = (effects.NonlinearCoupling(quadratic_coupling=1.0), effects.VoltageDependentCapacitance(beta=1e-2))
    found = simulate(System(Transducer(**BENCH, hysteresis=hysteresis, effects=present), shunts.Short()), DRIVE)
    omega = 2 * np.pi * DRIVE.frequency
    linear = abs(BENCH["stiffness"] - BENCH["mass"] * omega**2 + 1j * omega * BENCH["damping"])
    assert found.converged
    assert found.message == ""
    assert found.periods_evaluated < 12
    assert np.abs(found.waveforms.voltage).max() < 1e-11
    assert found.energy["closure"] < 1e-10
    if stops is None:
        assert found.displacement_amplitude == pytest.approx(DRIVE.amplitude / linear, rel=1e-11)
