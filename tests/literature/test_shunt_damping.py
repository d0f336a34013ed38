"""Closed forms of shunt damping for an undamped host, against the model's own frequency responses and poles.

K^2 = k_e^2 = T^2/(k C); frequencies relative to the short-circuit resonance, x relative to its static value F/k.
"""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import minimize, minimize_scalar

from piezoharvest import linear
from piezoharvest.description.shunts import NegativeCapacitance, Open, Resistor, SeriesRL, Short
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer

COUPLINGS = [0.05, 0.2, 0.5]  # K
W_SC = 2 * np.pi * 50.0
CAPACITANCE = 40e-9


def host(k):
    """Undamped host of coupling K = k, resonant at 50 Hz."""
    mass = 0.01
    stiffness = mass * W_SC**2
    return Transducer(
        mass=mass,
        damping=0.0,
        stiffness=stiffness,
        capacitance=CAPACITANCE,
        coupling=k * np.sqrt(stiffness * CAPACITANCE),
    )


def magnitude(transducer, shunt, g):
    """|x/x_static| at the relative frequencies g = w/w_sc."""
    response = linear.frequency_response(System(transducer, shunt), g * W_SC / (2 * np.pi))
    return np.abs(response.displacement) * transducer.stiffness


def grid(k, count):
    """Relative frequencies around the resonance, wide enough for any of the shunts."""
    return np.linspace(max(1 - 2 * k, 0.3), 1 + 3 * k, count)


def peak(transducer, shunt, k, count=4001):
    """Largest |x/x_static| around the resonance, by a local search from the best of a grid."""
    g = grid(k, count)
    coarse = magnitude(transducer, shunt, g)
    n = int(np.clip(np.argmax(coarse), 1, count - 2))
    fine = minimize_scalar(
        lambda at: -magnitude(transducer, shunt, at),
        bounds=(g[n - 1], g[n + 1]),
        method="bounded",
        options={"xatol": 1e-12},
    )
    return -fine.fun


def peaks(transducer, shunt, k, count=40001):
    """Heights of all local maxima around the resonance."""
    values = magnitude(transducer, shunt, grid(k, count))
    inner = values[1:-1]
    return inner[(inner > values[:-2]) & (inner >= values[2:])]


@pytest.mark.parametrize("k", COUPLINGS)
def test_loss_factor_of_a_resistor(k):
    """k^2/(2 sqrt(1 - k^2)) at R C w = sqrt(1 - k^2), k^2 = K^2/(1 + K^2) (Hagood & von Flotow 1991)."""
    transducer = host(k)
    k2 = linear.coupling_factor(transducer).material[0]
    assert k2 == pytest.approx(k**2 / (1 + k**2), rel=1e-9)
    w = 0.3 * W_SC

    def loss_factor(ratio):
        load = ratio / (CAPACITANCE * w)
        impedance = linear.TwoPort.of(transducer, [w / (2 * np.pi)]).mechanical_impedance(load)[0]
        stiffness = 1j * w * impedance + transducer.mass * w**2
        return stiffness.imag / stiffness.real

    best = minimize_scalar(
        lambda ratio: -loss_factor(ratio), bounds=(0.2, 2), method="bounded", options={"xatol": 1e-9}
    )
    assert best.x == pytest.approx(np.sqrt(1 - k2), rel=1e-5)
    assert loss_factor(np.sqrt(1 - k2)) == pytest.approx(k2 / (2 * np.sqrt(1 - k2)), rel=1e-9)


@pytest.mark.parametrize("k", COUPLINGS)
def test_smallest_peak_with_a_resistor(k):
    """R = 1/(C w_F), w_F^2 = (w_sc^2 + w_oc^2)/2, peak 2/K^2; no other resistance does better."""
    transducer = host(k)
    g_f = np.sqrt(1 + k**2 / 2)
    best = 1 / (CAPACITANCE * g_f * W_SC)
    assert magnitude(transducer, Resistor(resistance=best), g_f) == pytest.approx(2 / k**2, rel=1e-8)
    assert peak(transducer, Resistor(resistance=best), k) == pytest.approx(2 / k**2, rel=1e-6)
    for factor in (0.9, 0.99, 1.01, 1.1):
        assert peak(transducer, Resistor(resistance=factor * best), k) > 2 / k**2
    # The fixed point: open and shorted electrodes meet there too.
    for shunt in (Open(), Short(), Resistor(resistance=10 * best)):
        assert magnitude(transducer, shunt, g_f) == pytest.approx(2 / k**2, rel=1e-8)


def series_rl(delta, r):
    """Series RL with w_e = 1/sqrt(L C) = delta w_sc and R C w_sc = r."""
    return SeriesRL(inductance=1 / (CAPACITANCE * (delta * W_SC) ** 2), resistance=r / (CAPACITANCE * W_SC))


@pytest.mark.parametrize("k", COUPLINGS)
def test_series_rl_transfer_function_rule(k):
    """Delta = sqrt(1 + K^2) levels the two fixed points; r = sqrt(2) K/(1 + K^2) brings g = delta to their height."""
    transducer, delta = host(k), np.sqrt(1 + k**2)
    # Fixed points: where the response does not depend on r, that is, |x| at r -> 0 and at r -> inf (open) meet.
    fixed = np.sqrt(1 + k**2 + k * np.sqrt((1 + k**2) / 2) * np.array([-1.0, 1.0]))
    heights = [magnitude(transducer, series_rl(delta, r), fixed) for r in (1e-9, 0.3, 3.0, 1e9)]
    assert np.ptp(heights, axis=0) == pytest.approx(0, abs=1e-6 * heights[0][0])
    assert heights[1][0] == pytest.approx(heights[1][1], rel=1e-8)
    rule = series_rl(delta, np.sqrt(2) * k / (1 + k**2))
    assert magnitude(transducer, rule, delta) == pytest.approx(heights[1][0], rel=1e-8)


@pytest.mark.parametrize("k", COUPLINGS)
def test_series_rl_pole_placement(k):
    """Delta = 1 + K^2, r = 2 sqrt(K^2/(1 + K^2)^3): both pole pairs coincide, damping ratio K/2."""
    system = System(host(k), series_rl(1 + k**2, 2 * np.sqrt(k**2 / (1 + k**2) ** 3)))
    poles = linear.poles(system)
    pairs = poles[poles.imag > 0]
    # A double pole moves by the square root of a rounding error.
    assert len(pairs) == 2 and abs(pairs[0] - pairs[1]) < 1e-6 * abs(pairs[0])
    mean = np.mean(pairs)
    assert -mean.real / abs(mean) == pytest.approx(k / 2, rel=1e-9)


@pytest.mark.parametrize("k", COUPLINGS)
def test_series_rl_near_h_infinity_rule(k):
    """Yamada 2010: L = 1/(C w_oc^2), R = sqrt(3 a^2/(2 - a^2))/(C w_oc): two nearly equal peaks, near the optimum."""
    transducer = host(k)
    w_oc, a2 = W_SC * np.sqrt(1 + k**2), 1 - 1 / (1 + k**2)
    rule = SeriesRL(
        inductance=1 / (CAPACITANCE * w_oc**2), resistance=np.sqrt(3 * a2 / (2 - a2)) / (CAPACITANCE * w_oc)
    )
    found = peaks(transducer, rule, k)
    assert len(found) == 2 and found[0] == pytest.approx(found[1], rel=0.02)

    def worst(log):
        shunt = SeriesRL(inductance=rule.inductance * np.exp(log[0]), resistance=rule.resistance * np.exp(log[1]))
        return np.max(magnitude(transducer, shunt, grid(k, 4001)))

    best = minimize(worst, [0.0, 0.0], method="Nelder-Mead", options={"xatol": 1e-5, "fatol": 1e-6, "maxfev": 200})
    assert best.fun <= worst([0.0, 0.0]) <= 1.01 * best.fun
    # At the optimum the peaks are equal, and every rule of the literature is above it.
    exact = SeriesRL(inductance=rule.inductance * np.exp(best.x[0]), resistance=rule.resistance * np.exp(best.x[1]))
    left, right = peaks(transducer, exact, k)
    assert left == pytest.approx(right, rel=1e-3)
    for other in (
        series_rl(np.sqrt(1 + k**2), np.sqrt(2) * k / (1 + k**2)),
        series_rl(1 + k**2, 2 * np.sqrt(k**2 / (1 + k**2) ** 3)),
    ):
        assert peak(transducer, other, k) > best.fun * (1 - 1e-6)


@pytest.mark.parametrize("k", COUPLINGS)
@pytest.mark.parametrize("share", [0.3, 0.8])
def test_parallel_negative_capacitance_raises_the_coupling(k, share):
    """K^2 -> K^2 C/(C - C_n): the resonance with C_n alone, and the smallest peak with its resistance, move with it."""
    transducer = host(k)
    raised = k**2 / (1 - share)
    alone = NegativeCapacitance(capacitance=share * CAPACITANCE, resistance=1e15)
    poles = linear.poles(System(transducer, alone))
    resonance = np.max(poles.imag)
    assert (resonance / W_SC) ** 2 == pytest.approx(1 + raised, rel=1e-9)
    g_f = np.sqrt(1 + raised / 2)
    resistance = 1 / ((1 - share) * CAPACITANCE * g_f * W_SC)
    damped = NegativeCapacitance(capacitance=share * CAPACITANCE, resistance=resistance)
    assert peak(transducer, damped, np.sqrt(raised)) == pytest.approx(2 / raised, rel=1e-6)


@pytest.mark.parametrize("k", COUPLINGS)
@pytest.mark.parametrize("topology", ["parallel", "series"])
def test_stability_limits_of_negative_capacitance(k, topology):
    """Parallel: stable for C_n < C. Series: stable for C_n > C + T^2/k = C (1 + K^2)."""
    transducer = dataclasses.replace(host(k), damping=0.01)
    limit = CAPACITANCE * (1 if topology == "parallel" else 1 + k**2)
    inside = 1 if topology == "parallel" else -1
    for offset in (1e-2, 1e-4):
        for side in (inside, -inside):
            shunt = NegativeCapacitance(capacitance=limit * (1 - side * offset), resistance=1e5, topology=topology)
            growth = np.max(linear.poles(System(transducer, shunt)).real)
            assert (growth <= 0) == (side == inside)
