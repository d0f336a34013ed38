"""What holds for all tests."""

import gc
import os

# Tests run in as many processes as there are cores: threads of the linear algebra would only wait for each other.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

# Newer versions of hypothesis do this by themselves where CI is set, the lowest one that is tested does not.
if os.environ.get("CI"):
    settings.register_profile("repeatable", derandomize=True)
    settings.load_profile("repeatable")


gc.disable()  # while ten thousand tests are collected, of which nothing is garbage


def pytest_collection_finish():
    """Search for garbage from here on, but not among what is there: tests that do so by themselves take a tenth."""
    gc.collect()
    gc.freeze()
    gc.enable()


@pytest.fixture(autouse=True, scope="module")
def looked_through_once():
    """After each file: throw its garbage away, and look through what it leaves no more, in later searches for garbage.

    What the process has loaded by then grows to millions of objects, through which every search would go again.
    """
    yield
    gc.collect()
    gc.freeze()
