"""What holds for all tests."""

import gc
import os

# Tests run in as many processes as there are cores: threads of the linear algebra would only wait for each other.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

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
