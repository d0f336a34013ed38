"""The points of a sweep: order, reproducibility, and that a range of them is a range of the whole."""

import itertools
import tracemalloc
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import qmc

from piezoharvest.study import SweepOptions, SweepParameter
from piezoharvest.sweep.plan import Plan


def plan(*parameters, **options):
    return Plan(SweepOptions(parameters=parameters, **options))


def unit(path, **keys):
    return SweepParameter(path=path, from_=0.0, to=1.0, **keys)


def whole(made):
    return made.points(range(made.designs))


class TestGrid:
    def test_is_the_product_with_the_last_parameter_fastest(self):
        made = plan(
            SweepParameter(path="a", from_=1.0, to=4.0, count=4),
            SweepParameter(path="b", from_=10.0, to=-10.0, count=3),
            SweepParameter(path="c", from_=1e4, to=1e7, scale="log", count=4),
        )
        axes = [1.0, 2.0, 3.0, 4.0], [10.0, 0.0, -10.0], [1e4, 1e5, 1e6, 1e7]
        assert made.designs == 48
        np.testing.assert_allclose(whole(made), list(itertools.product(*axes)), rtol=1e-15)

    def test_a_single_value_is_the_first(self):
        assert whole(plan(SweepParameter(path="a", from_=3.0, to=9.0, count=1))).tolist() == [[3.0]]

    @pytest.mark.parametrize("scale", ["linear", "log"])
    def test_ends_are_exact(self, scale):
        made = whole(plan(SweepParameter(path="a", from_=0.1, to=7.3e-4, scale=scale, count=7)))
        assert (made[0, 0], made[-1, 0]) == (0.1, 7.3e-4)

    def test_a_log_scale_meets_the_decades(self):
        made = whole(plan(SweepParameter(path="a", from_=1e-9, to=1e9, scale="log", count=19)))
        np.testing.assert_allclose(made[:, 0], [float(f"1e{n}") for n in range(-9, 10)], rtol=5e-16)


class TestRandom:
    def test_is_what_numpy_gives_for_the_seed(self):
        made = plan(unit("a"), unit("b"), method="random", samples=500, seed=7)
        assert np.array_equal(whole(made), np.random.default_rng(7).random((500, 2)))

    def test_another_seed_gives_others(self):
        one, other = (plan(unit("a"), method="random", samples=50, seed=seed) for seed in (1, 2))
        assert not np.any(whole(one) == whole(other))

    def test_log_scale_fills_the_decades_evenly(self):
        made = plan(SweepParameter(path="a", from_=1.0, to=1e4, scale="log"), method="random", samples=40_000)
        share = np.histogram(np.log10(whole(made)), bins=4, range=(0, 4))[0] / 40_000
        np.testing.assert_allclose(share, 0.25, atol=0.01)


class TestSobol:
    def test_is_what_scipy_gives_for_the_seed(self):
        made = plan(unit("a"), unit("b"), unit("c"), method="sobol", samples=512, seed=3)
        assert np.array_equal(whole(made), qmc.Sobol(3, rng=3).random(512))

    def test_says_nothing_of_other_numbers_than_powers_of_two(self):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            whole(plan(unit("a"), method="sobol", samples=100))


@settings(max_examples=60, deadline=None)
@given(
    method=st.sampled_from(["grid", "random", "sobol"]),
    ranges=st.lists(st.tuples(st.integers(0, 1199), st.integers(1, 400)), min_size=1, max_size=4),
    seed=st.integers(0, 2**40),
)
def test_any_range_is_a_part_of_the_whole(method, ranges, seed):
    """In whichever order they are asked for."""
    parameters = [
        SweepParameter(path="a", from_=-5.0, to=3.0, count=30),
        SweepParameter(path="b", from_=1e-3, to=50.0, scale="log", count=40),
    ]
    made = plan(*parameters, method=method, samples=1200, seed=seed)
    points = whole(plan(*parameters, method=method, samples=1200, seed=seed))
    for first, length in ranges:
        last = min(first + length, 1200)
        assert np.array_equal(made.points(range(first, last)), points[first:last])


@given(
    ends=st.lists(st.floats(-1e59, 1e59), min_size=2, max_size=2, unique=True),
    method=st.sampled_from(["grid", "random"]),
    scale=st.sampled_from(["linear", "log"]),
)
def test_values_stay_between_their_ends(ends, method, scale):
    if scale == "log":
        ends = [max(abs(end), 1e-300) * factor for end, factor in zip(ends, (1.0, 2.0), strict=True)]
        if ends[0] == ends[1]:
            return
    made = plan(SweepParameter(path="a", from_=ends[0], to=ends[1], scale=scale, count=9), method=method, samples=9)
    values = whole(made)
    assert np.all(np.isfinite(values))
    assert np.all((values >= min(ends)) & (values <= max(ends)))


@given(samples=st.integers(1, 300_000))
def test_chunks_hold_every_design_once(samples):
    made = plan(unit("a"), method="random", samples=samples)
    ranges = [made.range(n) for n in range(made.chunks)]
    assert ranges[0].start == 0
    assert ranges[-1].stop == samples
    assert all(one.stop == next_one.start for one, next_one in itertools.pairwise(ranges))
    assert all(0 < len(one) <= 1024 for one in ranges)


@pytest.mark.parametrize("method", ["grid", "random"])
def test_a_billion_designs_are_not_held(method):
    made = plan(unit("a", count=2**15), unit("b", count=2**15), method=method, samples=2**30)
    tracemalloc.start()
    points = made.points(range(2**30 - 1000, 2**30))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert points.shape == (1000, 2)
    assert peak < 1e6
