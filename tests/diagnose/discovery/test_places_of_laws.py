"""Where laws act, and from where their search begins."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from piezoharvest import Open, Resistor, SineForce, System, Transducer, simulate
from piezoharvest.description.effects.nameless.circuit_places import Diode
from piezoharvest.description.effects.nameless.forms import Corners, Line, Power
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import Relaxation, Resonance
from piezoharvest.description.effects.nameless.places import Load, Spring
from piezoharvest.description.effects.nameless.shapes import Shape
from piezoharvest.description.shunts.curves.voltage_curve import VoltageCurve
from piezoharvest.diagnose.discovery.law_fits import ScoredLaw, law_parameters
from piezoharvest.diagnose.discovery.memories.scores import memories_at
from piezoharvest.diagnose.discovery.search import promising
from piezoharvest.diagnose.discovery.tables.smoothness import Smoothness

DEVICE = Transducer(mass=0.01, damping=0.1, stiffness=1000.0, coupling=1e-3, capacitance=4e-8)
CONDUCTION = Law(place=Load(), form=Corners(knots=(0.0, -0.0), kinks=(1e-6, -1e-6)))


@pytest.mark.parametrize(("shunt", "acts"), [(Open(), False), (Resistor(resistance=1e5), True)])
def test_open_electrodes_have_no_load_that_conducts(shunt, acts):
    drive = SineForce(amplitude=0.1, frequency=45.0)
    plain, conducting = (
        simulate(System(device, shunt), drive, transient=0.2).waveforms.voltage
        for device in (DEVICE, replace(DEVICE, effects=(CONDUCTION,)))
    )
    assert np.array_equal(plain, conducting) != acts


def test_resonances_beside_that_of_the_specimen_are_tried():
    """A small mass on a wire resonates narrowly: starts that are half a decade apart ended elsewhere."""
    scales = SimpleNamespace(sample_time=1e-4, longest=2.0, times=(1e-3,))
    laws = memories_at(Spring(), {"displacement": np.linspace(-1e-3, 1e-3, 50)}, scales, DEVICE)
    own = np.sqrt(DEVICE.stiffness / DEVICE.mass) / (2 * np.pi)
    near = [
        law.memory.frequency for law in laws if isinstance(law.memory, Resonance) and law.memory.damping_ratio < 0.2
    ]
    assert min(near) < 0.6 * own < 1.6 * own < max(near)
    assert max(np.diff(np.log(sorted(near)))) < np.log(1.5)


def test_of_a_large_misfit_each_sort_of_law_at_each_place_is_fitted():
    def scored(gain, memory=None):
        law = Law(place=Spring(), form=Line(factor=0.0), memory=memory)
        return ScoredLaw(law, np.zeros(3), Smoothness(np.inf, gain))

    memories = [Relaxation(time_constant=1e-3), Resonance(frequency=9.0, damping_ratio=0.2)]
    many = [*(scored(100.0 - k) for k in range(5)), *(scored(90.0 - k, memories[k % 2]) for k in range(5))]
    play = next(law for law in laws_with_play())
    last = ScoredLaw(play, np.zeros(3), Smoothness(np.inf, 1.0))
    assert last not in promising([*many, last], 1.0)
    assert last in promising([*many, last], 1e4)


def laws_with_play():
    scales = SimpleNamespace(sample_time=1e-4, longest=2.0, times=(1e-3,))
    laws = memories_at(Spring(), {"displacement": np.linspace(-1e-3, 1e-3, 50)}, scales, DEVICE)
    return [law for law in laws if law.memory.kind == "play"]


@pytest.mark.parametrize(
    "form",
    [
        Shape(factor=0.07, scale=1e-8, curve="log", bent=False, knots=(0.0,)),
        Shape(factor=0.07, scale=1e-6, curve="log", bent=False, knots=(0.0,)),
        Shape(factor=1.0, scale=1e-4, curve="tanh", bent=False, knots=(0.0,)),
        Power(factor=1.0, exponent=0.4, scale=1e-3),
        Power(factor=1.0, exponent=2.5, scale=1e-3),
    ],
)
def test_corners_of_a_diode_are_where_its_curve_bends(form):
    curve, x = VoltageCurve.stepped(*Diode(reach=1e-3).points(form)), np.linspace(0.0, 1e-3, 20001)
    line = np.interp(x, np.array(curve.currents), np.array(curve.voltages))
    np.testing.assert_allclose(line, form.values(x), rtol=0, atol=0.006 * form.values(x).max())


def test_a_scale_is_varied_by_its_logarithm_with_its_sign():
    form = Shape(factor=1.0, scale=-2e-3, curve="exponential", bent=True, knots=(0.0, 1e-3))
    scale = next(p for p in law_parameters(Law(place=Spring(), form=form), 0) if p.path[-1] == "scale")
    assert scale.outer(scale.inner(-2e-3)) == pytest.approx(-2e-3)
