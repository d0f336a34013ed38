"""Effects whose strength has no derivative: what the voltage shows of them, and in which interval nothing changes."""

import numpy as np
import pytest

from piezoharvest.diagnose.scanning.extrema import extrema_of, thresholds_between
from piezoharvest.diagnose.scanning.scan import Scan, spread

SAMPLES = 40  # of half a period


def switched(amplitudes, threshold, left, noise=0.0, seed=0):
    """Voltage of electrodes that an ideal switch inverts at extrema of at least a threshold, of which `left` is left.

    Between extrema it follows the motion, whose half periods have these amplitudes.
    """
    voltage, level, sizes, direction = [], 0.0, [], 1.0
    for amplitude in amplitudes:
        moved = amplitude * (1.0 - np.cos(np.pi * np.arange(SAMPLES) / SAMPLES))
        voltage.append(level + direction * moved)
        level += direction * 2.0 * amplitude
        sizes.append((abs(level), abs(level) >= threshold))
        level = -left * level if abs(level) >= threshold else level
        direction = -direction
    found = np.concatenate(voltage)
    return found + noise * np.random.default_rng(seed).normal(size=len(found)), sizes


@pytest.mark.parametrize("left", [0.8, 0.3, 0.0], ids=["inverted", "lossy", "discharged"])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_extrema_that_a_switch_missed(left, noise):
    voltage, sizes = switched(np.linspace(0.5, 3.0, 24), 3.0, left, noise)
    seen = extrema_of(voltage)
    told = dict(zip([round(size, 9) for size, _ in sizes], [acted for _, acted in sizes], strict=True))
    assert len(seen) >= 20
    for size, acted in seen:
        nearest = min(told, key=lambda each: abs(each - size))
        assert size == pytest.approx(nearest, abs=5.0 * noise + 0.01)
        assert acted == told[nearest]
    missed = [size for size, acted in sizes if not acted]
    acted_on = [size for size, acted in sizes if acted]
    threshold, *_ = thresholds_between(seen)
    assert max(missed) - 5.0 * noise < threshold < min(acted_on) + 5.0 * noise


def test_no_threshold_where_every_extremum_was_acted_on():
    assert thresholds_between(extrema_of(switched(np.linspace(0.5, 3.0, 24), 0.0, 0.7)[0])) == []
    assert extrema_of(np.zeros(100)) == []


def test_no_threshold_where_size_does_not_tell():
    """A switch that misses the largest ones misses them for another reason."""
    assert thresholds_between([(1.0, True), (2.0, True), (3.0, False)]) == []


def test_no_threshold_where_small_extrema_are_acted_on_or_not_alike():
    """Half of them are on the wrong side of any, as by chance."""
    small = [(1.0 + 0.01 * k, k % 2 == 1) for k in range(20)]
    assert thresholds_between([*small, (5.0, True), (6.0, True)]) == []


def test_spread_of_an_interval_is_that_of_a_uniform_distribution():
    draws = np.random.default_rng(1).uniform(2.0, 3.0, 200_000)
    assert spread(2.0, 3.0) == pytest.approx(draws.std(), rel=0.01)
    assert spread(2.0, np.inf) is None


class Steps(Scan):
    """A scan of a cost that is constant in pieces, as where an event appears at each of some values."""

    def __init__(self, value, edges, lowest):
        self.value, self.edges, self.lowest = value, np.array(edges), lowest

    def cost_at(self, value):
        return 100.0 * abs(int(np.sum(self.edges < value)) - self.lowest)


@pytest.mark.parametrize("value", [1.05, 1.3, 1.499])
def test_interval_ends_where_the_next_event_appears(value):
    low, high = Steps(value, [0.4, 1.0, 1.5, 1.6, 4.0], 2).interval()
    assert (low, high) == pytest.approx((1.0, 1.5), abs=1e-3)


def test_interval_without_an_end():
    assert Steps(1.0, [0.5], 1).interval()[1] == np.inf
    assert Steps(1.0, [1.5], 0).interval()[0] == 0.0


def test_best_value_is_found_across_other_pieces_and_kept_where_none_is_better():
    edges = [0.4, 1.0, 1.5, 1.6, 4.0]
    assert 1.0 < Steps(2.0, edges, 2).best() < 1.5
    assert Steps(1.2, edges, 2).best() == 1.2
    assert 1.5 < Steps(1.2, edges, 3).best() < 1.6  # narrower than the grid: the next piece beside the present one
