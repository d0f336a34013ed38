"""Formulas closest to a table: the minimum over each family, knees at and between inputs, bounds, and what is rounding.

The tables are made here, from the normal equations of a function with noise.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares

from piezoharvest.description.effects import DiodeDropError
from piezoharvest.description.effects.nameless.circuit_places import Diode, SwitchLoop
from piezoharvest.description.effects.nameless.forms import (
    DeadZone,
    Hertz,
    Knee,
    Line,
    Monomial,
    Polynomial,
    Power,
    TwoKnees,
)
from piezoharvest.description.effects.nameless.places import Damper, Load, OverTime, Spring
from piezoharvest.description.effects.nameless.shapes import Bump, Coulomb, Shape, Shockley, StepChange, Stribeck
from piezoharvest.description.parameters import altered
from piezoharvest.description.transducer import Transducer
from piezoharvest.diagnose.discovery.forms.closest import closest
from piezoharvest.diagnose.discovery.forms.distance import CurveDistance, Distance, drop_path
from piezoharvest.diagnose.discovery.forms.families import families
from piezoharvest.diagnose.discovery.forms.family import Family, column
from piezoharvest.diagnose.discovery.forms.projection import Members
from piezoharvest.diagnose.discovery.tables.knots import pieces_of, table_for

DIODE, CAMPAIGN = Diode(reach=1.0), OverTime(parameter="stiffness", of="campaign_time")
SAMPLES = 4000.0
# Place, true form over inputs up to one, and its values that are free.
TRUE = {
    "knee": (Spring(), Knee(factor=1.0, knee=0.43), ("factor", "knee")),
    "knee on one side": (Load(), Knee(factor=-2.0, knee=-0.3, sides=-1), ("factor", "knee")),
    "two knees": (
        Spring(),
        TwoKnees(factor=1.0, second=0.5, upper=0.6, lower=-0.35),
        ("factor", "second", "upper", "lower"),
    ),
    "dead zone": (Load(), DeadZone(factor=-1.0, zone=0.37), ("factor", "zone")),
    "power": (Damper(), Power(factor=2.0, exponent=1.7, scale=1.0), ("factor", "exponent")),
    "power below one": (Load(), Power(factor=1.0, exponent=0.4, scale=1.0), ("factor", "exponent")),
    "contact": (Spring(), Hertz(factor=1.0, scale=1.0, odd=False), ("factor",)),
    "monomial": (Spring(), Monomial(factor=-1.0, scale=1.0, exponent=3), ("factor",)),
    "polynomial": (Spring(), Polynomial(factor=1.0, second=-0.4, scale=1.0), ("factor", "second")),
    "exponential": (Load(), Shape(factor=1.0, scale=-0.3, curve="exponential", bent=False), ("factor", "scale")),
    "hyperbolic sine": (Spring(), Shape(factor=0.1, scale=0.4, curve="sinh", bent=True), ("factor", "scale")),
    "hyperbolic tangent": (Spring(), Shape(factor=1.0, scale=0.2, curve="tanh", bent=True), ("factor", "scale")),
    "diode": (DIODE, Shockley(factor=1.0, scale=1e-4, resistance=3.0), ("factor", "scale", "resistance")),
    "step": (CAMPAIGN, StepChange(factor=1.0, at=0.52, width=0.05), ("factor", "at", "width")),
    "bump": (CAMPAIGN, Bump(factor=-1.0, at=0.55, width=0.2), ("factor", "at", "width")),
    "dry friction": (Damper(), Coulomb(factor=1.0, width=0.01), ("factor",)),
    "friction of Stribeck": (
        Damper(),
        Stribeck(factor=1.0, excess=0.8, speed=0.2, width=0.01),
        ("factor", "excess", "speed"),
    ),
}


def table_of(place, form, size=1.0, noise=0.02, seed=0):
    """The table of a form in a place, over inputs up to a size."""
    random, t = np.random.default_rng(seed), np.linspace(0.0, 1.0, 1500)
    x = np.sin(2 * np.pi * 7.3 * t) * (0.3 + 0.7 * t) + 0.1 * random.standard_normal(len(t))
    x *= size / x.max()
    x = size * t if place is CAMPAIGN else np.abs(x) if place is DIODE else x
    table = table_for(place, x)
    values = form.values(x)
    std = noise * np.std(values)
    beside = [x / size] * place.bent + [np.ones(len(x))] * (not place.in_circuit)
    free = np.linalg.qr(np.column_stack([*beside, np.zeros(len(x))]))[0][:, : len(beside)]
    pieces, noisy = pieces_of(table, x), values + std * random.standard_normal(len(x))
    pieces, noisy = pieces - free @ (free.T @ pieces), noisy - free @ (free.T @ noisy)
    return SimpleNamespace(
        form=table,
        visited=x,
        law=SimpleNamespace(bent=place.bent),
        place=place,
        normal=(pieces.T @ pieces / std**2, pieces.T @ noisy / std**2),
        samples=SAMPLES,
        found=SimpleNamespace(model=SimpleNamespace(transducer=SimpleNamespace(effects=()), parameters=())),
    )


def residual(distance, form):
    return distance.found - distance.whitened @ np.real(form.values(distance.x))


def like(form, table):
    """The closest formula of the kind of a form, and no other kind."""
    fixed = ("curve", "exponents", "odd", "side", "sides", "bent", *["exponent"] * isinstance(form, Hertz | Monomial))
    distance = Distance(table)
    some = [
        part
        for each in families(table, distance)
        for part in (each if isinstance(each, tuple) else (each,))
        if type(part.form) is type(form)
        and all(getattr(part.form, name, None) == getattr(form, name, None) for name in fixed)
    ]
    found = (closest(distance, each) for each in some)
    return min((each for each in found if each is not None), key=lambda each: each.criterion)


def criterion_from_true_values(table, form, free):
    """Information criterion of the least squares that begin at the true values, by another program."""
    distance, true = Distance(table), np.array([getattr(form, name) for name in free])

    def loss(z):
        return residual(distance, altered(form, **dict(zip(free, z * true, strict=True))))

    done = least_squares(loss, np.ones(len(free)), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    return 2.0 * done.cost + len(free) * np.log(SAMPLES)


@pytest.mark.parametrize("noise", [1e-3, 0.3])
@pytest.mark.parametrize("name", TRUE)
def test_the_closest_of_a_family_is_as_close_as_least_squares_from_the_true_values(name, noise):
    place, form, free = TRUE[name]
    table = table_of(place, form, noise=noise)
    found = like(form, table)
    assert found.criterion <= criterion_from_true_values(table, form, free) + 1e-3
    left = residual(Distance(table), found.form)
    assert found.criterion == pytest.approx(left @ left + len(free) * np.log(SAMPLES), rel=1e-6)


@pytest.mark.parametrize("size", [1e-9, 1e3])
@pytest.mark.parametrize("name", ["knee", "two knees", "power", "exponential", "friction of Stribeck"])
def test_the_unit_of_the_input_changes_nothing(name, size):
    place, form, _ = TRUE[name]
    lengths = ("knee", "upper", "lower", "scale", "width", "speed")
    scaled = altered(form, **{key: size * getattr(form, key) for key in lengths if hasattr(form, key)})
    one, other = like(form, table_of(place, form)), like(form, table_of(place, scaled, size))
    assert other.criterion == pytest.approx(one.criterion, abs=1e-3)
    for key in lengths:
        if hasattr(form, key):
            assert getattr(other.form, key) == pytest.approx(size * getattr(one.form, key), rel=1e-4)


@pytest.mark.parametrize("noise", [1e-3, 0.3])
@pytest.mark.parametrize("sides", [1, 2])
@pytest.mark.parametrize("share", [0.02, 0.9, 0.99])
def test_a_knee_at_the_edge_of_what_was_visited_is_the_best_of_all(share, sides, noise):
    form = Knee(factor=1.0, knee=share, sides=sides)
    table = table_of(Spring(), form, noise=noise)
    distance = Distance(table)
    found = like(form, table)
    best = np.inf
    for knee in np.linspace(*((0.0, 1.0) if sides == 2 else (-1.0, 1.0)), 4001):
        unit = distance.found - residual(distance, Knee(factor=1.0, knee=float(knee), sides=sides))
        if unit @ unit > 0.0:
            best = min(best, distance.found @ distance.found - (unit @ distance.found) ** 2 / (unit @ unit))
    assert found.criterion <= best + 2 * np.log(SAMPLES) + 1e-6 * (1.0 + best)


@pytest.mark.parametrize("seed", range(4))
def test_the_resistance_of_a_diode_is_not_below_zero(seed):
    true = Shockley(factor=1.0, scale=1e-3, resistance=0.0)
    table = table_of(DIODE, true, noise=0.1, seed=seed)
    distance, found = Distance(table), like(true, table)

    def loss(z):
        return residual(distance, Shockley(factor=z[0], scale=1e-3 * np.exp(z[1]), resistance=z[2]))

    done = least_squares(loss, [1.0, 0.0, 0.01], bounds=([-np.inf, -np.inf, 0.0], np.inf), xtol=1e-14, ftol=1e-14)
    assert found.form.resistance >= 0.0
    assert found.criterion <= 2.0 * done.cost + 3 * np.log(SAMPLES) + 1e-3


def test_a_knee_below_all_inputs_is_a_straight_line_but_for_rounding():
    table = table_of(Spring(), Knee(factor=1.0, knee=0.3))
    family = Family(Knee(factor=0.0, knee=0.0, sides=1), lambda c, u: {"factor": c[0], "knee": u[0]}, column([0.0]))
    distance = Distance(table)
    found = Members.at(distance, family, column([0.3, 0.9, -2.0, 2.0]))
    assert np.isfinite(found.cost).tolist() == [True, True, False, False]


def test_a_family_without_a_member_within_its_bounds_has_no_closest():
    table = table_of(Load(), Power(factor=1.0, exponent=2.5, scale=1.0))
    distance = Distance(table)
    overflowing = Family(
        Shape(factor=0.0, scale=1.0, curve="sinh", bent=False),
        lambda c, u: {"factor": c[0], "scale": np.exp(u[0])},
        column([-20.0]),
    )
    outside = Family(
        Power(factor=0.0, exponent=1.0, scale=1.0), lambda c, u: {"factor": c[0], "exponent": 0.0 * u[0]}, column([1.0])
    )
    assert closest(distance, overflowing) is None
    assert closest(distance, outside) is None


def curve_of(place, form, size):
    """A fit of a formula, as far as a distance from its curve knows it."""
    x = size * np.linspace(-1.0, 1.0, 501)
    law = SimpleNamespace(bent=place.bent, form=form)
    found = SimpleNamespace(model=SimpleNamespace(parameters=()))
    return SimpleNamespace(form=form, visited=x, law=law, place=place, samples=SAMPLES, found=found)


def nearest(law):
    """The members of all families that are nearest to the curve of a formula, of each family one."""
    distance, found = CurveDistance(law), []
    for some in families(law, distance):
        found += [closest(distance, each) for each in (some if isinstance(some, tuple) else (some,))]
    return distance, sorted((each for each in found if each is not None), key=lambda each: each.criterion)


@pytest.mark.parametrize("form", [
    Polynomial(factor=1.0, second=0.3, scale=1.0, exponents=(3, 5)),
    Shape(factor=0.1, scale=0.4, curve="sinh", bent=True), Shape(factor=1.0, scale=0.3, curve="tanh", bent=True),
], ids=["polynomial", "sinh", "tanh"])  # fmt: skip
def test_a_formula_is_nearest_to_its_own_curve(form):
    law = curve_of(Spring(), form, 1.0)
    _, (first, *_) = nearest(law)
    assert type(first.form) is type(form) and getattr(first.form, "curve", "") == getattr(form, "curve", "")
    line = np.polynomial.Polynomial.fit(law.visited, first.form.values(law.visited) - form.values(law.visited), 1)
    left = first.form.values(law.visited) - form.values(law.visited) - line(law.visited)
    assert np.abs(left).max() < 1e-6 * np.abs(form.values(law.visited)).max()


def test_of_what_is_not_a_polynomial_the_curve_beside_one_is_found():
    """Sinh is its series of two terms up to inputs of twice its scale within a hundredth."""
    true = Shape(factor=1.0, scale=1.0, curve="sinh", bent=True)
    law = curve_of(Spring(), Polynomial(factor=1.0 / 6.0, second=1.0 / 120.0, scale=1.0, exponents=(3, 5)), 2.0)
    distance, found = nearest(law)
    sinh = next(each.form for each in found if getattr(each.form, "curve", "") == "sinh")
    assert sinh.scale == pytest.approx(true.scale, rel=0.1)
    assert sinh.factor / sinh.scale**3 == pytest.approx(1.0, rel=0.1)  # the cubic term
    straight = Shape(factor=1.0, scale=1.0, curve="sinh", bent=False)  # with the straight line beside it
    assert distance.line(straight) == pytest.approx(distance.line(true) + 1.0, rel=1e-6)


@pytest.mark.parametrize("curve", ["tanh", "langevin"])
def test_a_curve_is_no_sharper_than_its_table_tells(curve):
    """A jump at zero is the limit of a scale of zero, where a fit would have no slope to any other."""
    step = Shape(factor=1.0, scale=1e-9, curve=curve, bent=False)
    table = table_of(Load(), step)
    x = Distance(table).x
    assert like(step, table).form.scale >= 0.99 * np.abs(x[x != 0.0]).min()


@pytest.mark.parametrize(("place", "free"), [(DIODE, True), (SwitchLoop(reach=1.0), False)], ids=["diode", "loop"])
def test_a_drop_of_diodes_that_is_free_is_a_constant_of_theirs_alone(place, free):
    """A loop that loses a constant voltage is no bridge with another drop: the constant is all of its law."""
    transducer = Transducer(
        mass=1.0, damping=1.0, stiffness=1.0, coupling=1.0, capacitance=1.0, effects=(DiodeDropError(diode_drop=0.6),)
    )
    table = table_of(place, Line(factor=1.0))
    table.found.model.transducer = transducer
    assert drop_path(transducer, place) == (("effects", 0, "diode_drop") if free else ())
    assert Distance(table).with_constant == free


def test_far_from_zero_a_curve_may_be_as_sharp_as_it_is():
    """A parameter that settles within seconds, in records that were made after a minute."""
    settling = Shape(factor=-1e4, scale=-0.08, curve="exponential", bent=False)
    place = OverTime(parameter="stiffness", of="campaign_time")
    x = np.linspace(0.8, 1.0, 1500)
    form = table_for(place, x)
    pieces, free = pieces_of(form, x), np.ones((len(x), 1)) / np.sqrt(len(x))
    values = settling.values(x) + 1e-5 * np.random.default_rng(0).standard_normal(len(x))
    pieces, values = pieces - free @ (free.T @ pieces), values - free @ (free.T @ values)
    table = table_of(CAMPAIGN, settling)
    table.form, table.visited, table.place = form, x, place
    table.normal = pieces.T @ pieces / 1e-10, pieces.T @ values / 1e-10
    assert like(settling, table).form.scale == pytest.approx(-0.08, rel=0.05)


@pytest.mark.parametrize("name", ["knee", "curve", "power"])
def test_a_formula_leaves_something_of_the_parameter_that_it_is_beside(name):
    """A knee close to zero, before the first corner of a table: a closer one has a slope that takes the stiffness."""
    table = table_of(Spring(), Knee(factor=1.0, knee=0.05))
    kind = {
        "knee": Knee(factor=1.0, knee=0.05),
        "curve": Shape(factor=1.0, scale=0.1, curve="tanh", bent=True),
        "power": Power(factor=1.0, exponent=1.5, scale=1.0),
    }[name]
    assert name == "power" or Distance(table).line(like(kind, table).form) > 20.0
    model = table.found.model
    model.transducer, model.parameters = SimpleNamespace(stiffness=2.0), (SimpleNamespace(path=("stiffness",)),)
    assert Distance(table).line(like(kind, table).form) < 2.0
