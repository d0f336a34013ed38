"""Fits leave no threads to the linear algebra, and give them back; records have those that the process may use."""

from threading import Barrier, get_ident

import numpy as np
import pytest
from diagnose.swept import campaign
from threadpoolctl import threadpool_info, threadpool_limits

from piezoharvest import threads as threads_module
from piezoharvest.identify import identification
from piezoharvest.identify.fitting.evaluation import map_records
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


@pytest.mark.parametrize(("told", "cores", "used"), [
    (None, 3, 3), ("", 2, 2), ("1", 2, 1), ("2", 8, 2), ("4,1", 3, 3), ("4,1", 8, 4), ("0", 2, 2), ("all", 2, 2),
])  # fmt: skip
def test_records_have_as_many_threads_as_the_process_may_use(told, cores, used, monkeypatch):
    """In processes that are told to use one, threads for records had taken a fifth to a half of the time."""
    monkeypatch.setattr(threads_module, "cores", lambda: cores)
    if told is None:
        monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    else:
        monkeypatch.setenv("OMP_NUM_THREADS", told)
    together = Barrier(used, timeout=10.0)  # fails unless so many are within it at a time

    def here(n):
        together.wait()
        return n, get_ident()

    numbers, idents = zip(*map_records(here, range(2 * used)), strict=True)
    assert numbers == tuple(range(2 * used))
    assert len(set(idents)) == used
    assert (get_ident() in idents) == (used == 1)


def test_threads_change_no_digit_of_a_fit(monkeypatch):
    monkeypatch.setattr(threads_module, "cores", lambda: 2)
    measured, found = campaign("white", 3, duration=0.25), []
    for told in ("1", "2"):
        monkeypatch.setenv("OMP_NUM_THREADS", told)
        found.append([(each.value, each.std) for each in identification.identify(measured).estimates])
    assert found[0] == found[1]
