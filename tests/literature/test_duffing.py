"""Springs that bend, against Jacobi's elliptic functions: the motions that Duffing's equation has in closed form."""

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from piezoharvest.description.effects import Stiffening
from piezoharvest.description.excitation import StepForce
from piezoharvest.description.shunts import Short
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.engine import simulate

MASS, STIFFNESS, START = 0.01, 1e3, 1e-3


def cosine(u, m):
    """Jacobi's cn for a negative parameter, too (DLMF 22.17.8: cn(u|-m) = cd(u sqrt(1 + m) | m/(1 + m)))."""
    if m >= 0:
        return ellipj(u, m)[1]
    _, cn, dn, _ = ellipj(u * np.sqrt(1 - m), m / (m - 1))
    return cn / dn


@pytest.mark.parametrize("share", [0.3, 3.0, -0.3])
def test_free_motion(share):
    """Released from rest at x0, x = x0 cn(t sqrt((k + k3 x0^2)/m) | k3 x0^2/(2 (k + k3 x0^2))) (Nayfeh & Mook 1979)."""
    cubic = share * STIFFNESS / START**2
    force = STIFFNESS * START + cubic * START**3
    stack = Transducer(
        mass=MASS, damping=0.0, stiffness=STIFFNESS, coupling=1e-3, capacitance=4e-8,
        effects=(Stiffening(cubic_stiffness=cubic),),
    )  # fmt: skip
    rate, modulus = np.sqrt(STIFFNESS * (1 + share) / MASS), 0.5 * share / (1 + share)
    period = 4 * ellipk(modulus) / rate
    released = StepForce(amplitude=-force, duration=10 * period, offset=force)
    found = simulate(System(stack, Short()), released, transient=10 * period)
    wanted = cosine(rate * found.waveforms.time, modulus)
    assert found.converged, found.message
    assert found.displacement_amplitude == pytest.approx(START, rel=1e-9)
    assert np.abs(found.waveforms.displacement / START - wanted).max() < 1e-8
    assert found.energy["stiffening"] + found.energy["stored"] == pytest.approx(0.0, abs=1e-9 * force * START)
