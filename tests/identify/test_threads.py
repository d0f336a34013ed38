"""Fits leave no threads to the linear algebra, and give them back."""

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from piezoharvest.identify import identification
from piezoharvest.identify.frequency import modal_fit
from piezoharvest.identify.hysteresis import loops
from piezoharvest.records.campaign import Campaign


def threads():
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


WAVE = np.sin(np.arange(100.0))
FITS = {
    "loop": (loops, "place_thresholds", lambda: loops.identify_loop(WAVE, WAVE, kind="stop")),
    "modes": (modal_fit, "_start", lambda: modal_fit.fit_modes(np.arange(1.0, 99.0), np.ones((98, 1, 1)), 1)),
    "number of modes": (
        modal_fit, "_start",
        lambda: modal_fit.select_modes(np.arange(1.0, 99.0), np.ones((98, 1, 1)), np.ones((98, 1, 1)), [1]),
    ),
    "records": (identification, "prepared", lambda: identification.identify(Campaign.__new__(Campaign))),
}  # fmt: skip


@pytest.mark.parametrize("case", FITS)
def test_linear_algebra_has_one_thread_within_a_fit(case, monkeypatch):
    module, inner, fit = FITS[case]
    seen = []

    def stopped(*arguments):
        seen.append(threads())
        raise InterruptedError

    monkeypatch.setattr(module, inner, stopped)
    with threadpool_limits(2):
        before = threads()  # some library may have been told to have one for good
        assert max(before) == 2
        with pytest.raises(InterruptedError):
            fit()
        assert seen == [{1}]
        assert threads() == before
