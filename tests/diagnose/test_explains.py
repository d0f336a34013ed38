"""A law has to explain the error that a user sees, and what the model that was judged first had left."""

import pytest

from piezoharvest.diagnose.diagnosis import _explains
from piezoharvest.diagnose.summary import _share
from piezoharvest.identify.result import Quality

NOISE = {"displacement": 1e-7, "voltage": 1e-3}


def quality(displacement, voltage, noise=NOISE):
    """Residuals in units of the noise."""
    return Quality({"displacement": 1e-7 * displacement, "voltage": 1e-3 * voltage}, noise)


@pytest.mark.parametrize(
    ("before", "after", "enough"),
    [
        (quality(10.0, 1.0), quality(1.0, 1.0), True),
        (quality(10.0, 1.0), quality(3.0, 1.0), True),  # 8 of 99
        (quality(10.0, 1.0), quality(4.0, 1.0), False),  # 15 of 99
        (quality(7.39, 1.0), quality(7.41, 1.0), False),  # as a stack's law: 91 % of what whitened residuals had
        # Where something was missing the noise was estimated from it: that of the better model counts.
        (quality(10.0, 1.0, {"displacement": 1e-6, "voltage": 1e-3}), quality(1.0, 1.0), True),
    ],
)
def test_what_the_first_model_had_left_has_to_be_gone(before, after, enough):
    assert _explains(before, after, 1e5) is enough


def test_what_noise_may_leave_is_no_error():
    """Known effects had explained all but a few per cent: of 750 samples noise leaves 5 %, of a million 0.1 %."""
    before, after = quality(1.04, 1.03), quality(1.02, 1.02)
    assert _explains(before, after, 1500.0)
    assert not _explains(before, after, 2e6)


@pytest.mark.parametrize(("gain", "text"), [(1.0, "100 %"), (0.99998, "99.998 %"), (0.97, "97 %"), (0.031, "3 %")])
def test_a_part_is_not_said_to_be_all(gain, text):
    assert _share(gain) == text
