"""What sensors read of a channel that comes to the end of its range, or late."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from piezoharvest.description.effects import ChannelSkew, Clipping
from piezoharvest.predict.parameters import parameter_of
from piezoharvest.predict.sensors import Course, sensed

LIMIT, NOISE = 2.0, 0.1


def read(values, limit=LIMIT, noise=NOISE, slopes=None):
    """Readings and their derivatives, of a channel called voltage."""
    effect = Clipping(limit=limit, channel="voltage")
    field = next(f for f in effect.__dataclass_fields__.values() if f.name == "limit")
    parameter = parameter_of(effect, field, ("effects", 0, "limit"))
    return sensed([effect], [parameter], {"voltage": noise}, Course(1e-3), values[:, None].copy(), slopes)


@pytest.mark.parametrize("value", [-2.05, -1.9, 0.0, 1.8, 1.95, 2.0, 2.1, 3.0])
def test_a_reading_is_the_mean_of_clipped_noise(value):
    drawn = value + NOISE * np.random.default_rng(1).standard_normal(1_000_000)
    found, _ = read(np.array([value]))
    assert found[0, 0] == pytest.approx(np.clip(drawn, -LIMIT, LIMIT).mean(), abs=5 * NOISE / 1e3)


def test_without_noise_it_is_clipped():
    values = np.array([-3.0, -2.0, -1.999, 0.5, 1.999, 2.0, 3.0])
    found, _ = read(values, noise=0.0)
    assert found[:, 0] == pytest.approx(np.clip(values, -LIMIT, LIMIT), rel=1e-11)


def test_far_from_the_limit_nothing_changes():
    values = np.linspace(-1.1, 1.1, 100)
    slopes = np.random.default_rng(2).normal(size=(100, 1, 1))
    found, derivatives = read(values, slopes=slopes.copy())
    assert np.array_equal(found[:, 0], values)
    assert np.array_equal(derivatives, slopes)


def test_derivatives():
    values, h = np.linspace(-2.3, 2.3, 93), 1e-6
    # In the column of the limit first a derivative to something else, which moves the values one to one.
    _, to_values = sensed(
        [Clipping(limit=LIMIT, channel="voltage")], [], {"voltage": NOISE}, Course(1e-3),
        values[:, None].copy(), np.ones((93, 1, 1)),
    )  # fmt: skip
    moved = [read(values + step)[0][:, 0] for step in (h, -h)]
    assert to_values[:, 0, 0] == pytest.approx((moved[0] - moved[1]) / (2 * h), abs=1e-8)
    _, to_limit = read(values, slopes=np.zeros((93, 1, 1)))
    ends = [read(values, limit=1.0 / (1.0 / LIMIT + step))[0][:, 0] for step in (h, -h)]
    assert to_limit[:, 0, 0] == pytest.approx((ends[0] - ends[1]) / (2 * h), abs=1e-7)


def test_derivatives_to_a_delay_are_those_of_the_channels_that_it_delays():
    time, h = 1e-3 * np.arange(200), 1e-7
    values = np.column_stack([np.sin(2 * np.pi * f * time + f) for f in (7.0, 11.0)])
    (field,) = fields(ChannelSkew)
    delayed = parameter_of(ChannelSkew(delay=0.0), field, ("effects", 0, "delay"))
    both = [replace(delayed, path=("mass",)), delayed]

    def late(delay, slopes=None):
        channels = {"displacement": 0.0, "voltage": 0.0}
        return sensed([ChannelSkew(delay=delay)], both, channels, Course(1e-3), values.copy(), slopes)

    for delay in (0.0, 3e-4):
        # First comes something that moves all values in proportion to time: its derivative is delayed with them.
        slopes = np.repeat(time[:, None, None], 2, axis=1) * [1.0, 0.0]
        found = late(delay, slopes.copy())[1]
        wanted = (late(delay + h)[0] - late(max(delay - h, 0.0))[0]) / (h + min(delay, h))
        inside = slice(2, -2)
        assert not np.any(wanted[:, 0])
        assert not np.any(found[:, 0, 1])
        assert found[inside, 1, 1] == pytest.approx(wanted[inside, 1], abs=1e-2 if delay == 0.0 else 1e-4)
        assert np.array_equal(found[:, 0, 0], time)
        # Where they end a filter is not the spline through them.
        middle = slice(20, -20)
        assert found[middle, 1, 0] == pytest.approx((time - delay)[middle], abs=1e-12)
