"""Time stamps with few digits are even times; jitter, gaps and lost samples are not, however they are printed."""

from __future__ import annotations

from decimal import ROUND_DOWN, Decimal

import numpy as np
import pytest

from piezoharvest.records.reading.time_stamps import even_times


def printed(times, form):
    """Times as they are read back from print."""
    return np.array([float(form.format(float(t))) for t in times])


def even(count, rate, start=0.0):
    return start + np.arange(count) / rate


class TestRounded:
    @pytest.mark.parametrize(
        ("rate", "count", "form"),
        [(64.0, 4096, "{:.5g}"), (128.0, 3000, "{:.5g}"), (300.0, 2000, "{:.3f}"), (44100.0, 5000, "{:.6f}"),
         (48000.0, 20000, "{:.6f}"), (2048.0, 8192, "{:.5g}"), (51.2, 700, "{:.3f}"), (1e6 / 7.3, 1000, "{:.3e}"),
         (4000.0, 12000, "{:.4f}"), (1 / 2.7, 40, "{:.0f}"), (97.3, 5000, "{:.5g}")],
    )  # fmt: skip
    @pytest.mark.parametrize("start", [0.0, -1.0, 0.25])
    def test_the_rate_comes_back(self, rate, count, form, start):
        times = even(count, rate, start)
        stamps = printed(times, form)
        assert np.abs(stamps - times).max() > 1e-3 / rate
        found = even_times(stamps)
        steps = np.diff(found.times)
        assert np.ptp(steps) < 1e-9 / rate
        # What is known of the last sample is a part of what its digits leave open.
        assert np.abs(found.times - times).max() < 0.5 * found.unit
        assert found.times[-1] - found.times[0] == pytest.approx((count - 1) / rate, abs=0.3 * found.unit)

    @pytest.mark.parametrize(("rate", "form"), [(64.0, "{:.5g}"), (300.0, "{:.3f}"), (4000.0, "{:.4g}")])
    def test_a_round_rate_is_exact(self, rate, form):
        found = even_times(printed(even(4000, rate), form))
        assert (len(found.times) - 1) / (found.times[-1] - found.times[0]) == pytest.approx(rate, rel=1e-12)

    @pytest.mark.parametrize(("rate", "digits"), [(64.0, 5), (300.0, 5), (44100.0, 6)])
    def test_digits_that_were_cut_off(self, rate, digits):
        times = even(4000, rate)
        cut = [
            Decimal(t).quantize(Decimal(1).scaleb(Decimal(t).adjusted() + 1 - digits), ROUND_DOWN) for t in times[1:]
        ]
        found = even_times(np.array([0.0, *map(float, cut)]))
        assert np.mean(np.diff(found.times)) == pytest.approx(1 / rate, rel=1e-9)

    def test_seconds_since_1970(self):
        found = even_times(printed(1.7e9 + even(4000, 300.0), "{:.3f}"))
        assert np.mean(np.diff(found.times)) == pytest.approx(1 / 300.0, rel=1e-6)

    def test_single_precision(self):
        times = even(20000, 1e4, 100.0)
        found = even_times(times.astype(np.float32).astype(float))
        assert np.abs(found.times - times).max() < 1e-6

    def test_other_units(self):
        """Milliseconds with two decimals."""
        found = even_times(printed(1e3 * even(3000, 44100.0), "{:.3f}"))
        assert np.mean(np.diff(found.times)) == pytest.approx(1e3 / 44100.0, rel=1e-7)

    @pytest.mark.parametrize(("rate", "form", "coarse"), [(300.0, "{:.3f}", False), (20000.0, "{:.4f}", True)])
    def test_stamps_that_cannot_show_a_lost_sample(self, rate, form, coarse):
        assert even_times(printed(even(5000, rate), form)).coarse is coarse

    def test_coarse_stamps_by_a_known_step(self):
        """One in a thousand steps is another one: a lost sample as well as 999 Hz, unless the rate is known."""
        stamps = printed(even(5000, 999.0), "{:.3f}")
        assert even_times(stamps) is None
        np.testing.assert_allclose(np.diff(even_times(stamps, 1 / 999.0).times), 1 / 999.0, rtol=1e-9)
        assert even_times(stamps, 1 / 998.0) is None


class TestAsTheyAre:
    @pytest.mark.parametrize("form", ["{:.3f}", "{!r}", "{:.9g}"])
    def test_even_stamps(self, form):
        assert even_times(printed(even(2000, 1000.0), form)) is None

    @pytest.mark.parametrize("form", ["{!r}", "{:.9g}", "{:.6f}", "{:.5f}"])
    @pytest.mark.parametrize("share", [0.03, 0.2])
    def test_jitter(self, form, share):
        times = even(2000, 1000.0) + share * 1e-3 * np.random.default_rng(1).uniform(-1, 1, 2000)
        assert even_times(printed(np.sort(times), form)) is None

    @pytest.mark.parametrize("form", ["{!r}", "{:.5g}", "{:.3f}", "{:.4f}"])
    @pytest.mark.parametrize("rate", [64.0, 100.0, 250.0])
    @pytest.mark.parametrize("lost", [3, 500, 1997])
    def test_a_lost_sample(self, form, rate, lost):
        assert even_times(printed(np.delete(even(2000, rate), lost), form)) is None

    @pytest.mark.parametrize("form", ["{!r}", "{:.5g}", "{:.3f}"])
    def test_a_repeated_sample(self, form):
        times = even(2000, 250.0)
        assert even_times(printed(np.insert(times, 700, times[700]), form)) is None

    def test_a_drifting_clock(self):
        times = even(4000, 64.0)
        assert even_times(printed(times + 1e-5 * times**2, "{:.5g}")) is None

    @pytest.mark.parametrize("size", [1e-320, 1e-300, 1e300, 1.7e308])
    def test_beyond_all_clocks(self, size):
        assert even_times(np.array([0.0, 0.3, 0.4, 0.7, 1.0]) * size) is None
        assert even_times(np.array([size, 0.3, 0.41, 0.7, 1.0])) is None

    @pytest.mark.parametrize("stamps", [[], [1.0], [0.0, 1.0, 2.0], [0.0, np.nan, 2.0, 3.0, 4.0], [3.0, 2.0, 1.0, 0.5]])
    def test_nothing_to_tell(self, stamps):
        assert even_times(np.array(stamps)) is None
