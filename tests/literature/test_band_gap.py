"""Arrays of resonant shunts: a chain of cells with an inductor at each has the band gap of the infinite chain.

Neighbouring masses m are joined by springs k with a patch each, shunted by an inductor in resonance with it at w_t. A
cell's stiffness is k (1 + a w^2/(w^2 - w_t^2)), a = T^2/(k C), so that m w^2 = 2 k(w) (1 - cos K) for the phase K from
mass to mass (Bloch). Between w_t/sqrt(1 + a), where k(w) vanishes, and w_t nothing travels: the gap of Sugino,
Leadenham, Ruzzene & Erturk, Smart Mater. Struct. 26, 055029, 2017. In a chain of discrete masses the lower branch ends
where K = pi. With fixed ends N cells have K = p pi/N, p = 1 ... N - 1, without any other approximation.
"""

import numpy as np
import pytest

from piezoharvest import simulate
from piezoharvest.description.excitation import SineForce
from piezoharvest.description.shunts import ParallelRL
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Electrode, Mode, Transducer
from piezoharvest.linear import frequency_response, poles

MASS, STIFFNESS, COUPLING, CAPACITANCE = 0.01, 4e4, 3e-3, 1e-9
ALPHA = COUPLING**2 / (STIFFNESS * CAPACITANCE)
RATE = np.sqrt(STIFFNESS / MASS)
TUNED = 0.8 * RATE  # rad/s
INDUCTANCE = 1 / (TUNED**2 * CAPACITANCE)


def chain(cells, lag=0.0, resistance=1e15):
    """Chain with fixed ends by its modes, driven at the first mass and read at the last; an inductor at each patch.

    Springs have the damping `lag` (s) times their stiffness.
    """
    places = np.arange(1, cells)
    phases = np.pi * places / cells
    shapes = np.sqrt(2 / cells) * np.sin(phases[:, None] * places)  # of unit norm over the masses
    stretches = np.diff(np.pad(shapes, ((0, 0), (1, 1))))  # of the springs, by mode
    frequencies = 2 * RATE * np.sin(phases / 2)
    first, last = shapes[:, 0], shapes[:, -1]
    modes = [
        {
            "mass": MASS / first[n] ** 2, "damping": lag * MASS * (frequencies[n] / first[n]) ** 2,
            "stiffness": MASS * (frequencies[n] / first[n]) ** 2, "coupling": COUPLING * stretches[n, 0] / first[n],
            "sensor_participation": last[n] / first[n],
        }
        for n in range(cells - 1)
    ]  # fmt: skip
    further = tuple(
        Electrode(capacitance=CAPACITANCE, coupling=tuple(stretches[:, k] * (COUPLING / first)))
        for k in range(1, cells)
    )
    transducer = Transducer(
        **modes[0], capacitance=CAPACITANCE, modes=tuple(Mode(**m) for m in modes[1:]), electrodes=further
    )
    parts = {"inductance": INDUCTANCE, "resistance": resistance}
    others = tuple(ParallelRL(**parts, electrode=k) for k in range(1, cells))
    return System(transducer, ParallelRL(**parts, others=others))


def branches(phase):
    """Both frequencies (rad/s) of the infinite chain at a phase from mass to mass."""
    own = 2 * (1 - np.cos(phase)) * RATE**2  # with shorted patches
    middle, product = 0.5 * (TUNED**2 + own * (1 + ALPHA)), own * TUNED**2
    root = np.sqrt(middle**2 - product)
    return np.sqrt(middle - root), np.sqrt(middle + root)


@pytest.mark.parametrize("cells", [8, 16])
def test_edges_are_those_of_the_infinite_chain(cells):
    found = np.imag(poles(chain(cells)))
    found = np.sort(found[found > 1e-3 * TUNED])
    below, above = (np.sort(branch) for branch in branches(np.pi * np.arange(1, cells) / cells))
    # One mode of the patches stretches no spring: it stays at w_t, the upper edge.
    assert found == pytest.approx(np.sort([*below, *above, TUNED]), rel=1e-7)
    lower = branches(np.pi)[0]
    assert found[found < 0.999 * TUNED].max() == pytest.approx(lower, rel=0.02)
    assert lower < TUNED / np.sqrt(1 + ALPHA)
    inside = (found > 1.02 * lower) & (found < 0.999 * TUNED)
    assert not np.any(inside)


def test_nothing_comes_through_the_gap():
    cells, lag, resistance = 8, 1e-5, 1e3 * TUNED * INDUCTANCE
    system = chain(cells, lag, resistance)

    def transmitted(frequency):
        """Displacement of the last mass by a unit force on the first: 1/(k(w) U(1 - m w^2/(2 k(w)))), by Chebyshev."""
        s = 2j * np.pi * frequency
        drawn = 1 / (s * INDUCTANCE) + 1 / resistance
        spring = STIFFNESS * (1 + lag * s) + COUPLING**2 / (CAPACITANCE + drawn / s)
        angle = np.arccos(1 + MASS * s**2 / (2 * spring))
        return np.sin(angle) / (spring * np.sin(cells * angle))

    lower = branches(np.pi)[0]
    frequencies = np.append(np.linspace(0.3, 1.0, 50) * lower, 0.5 * (lower + TUNED)) / (2 * np.pi)
    found = frequency_response(system, frequencies).displacement
    assert found == pytest.approx(transmitted(frequencies), rel=1e-8)
    *passed, stopped = np.abs(found)
    assert stopped < 0.01 * np.median(passed)
    response = simulate(system, SineForce(amplitude=1.0, frequency=frequencies[-1]), attenuation=False)
    assert response.converged
    assert response.displacement_amplitude == pytest.approx(stopped, rel=1e-6)
