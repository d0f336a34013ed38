"""What holds for tests that load effects from files."""

import sys

import pytest

from piezoharvest.description.effects import Effect


@pytest.fixture(autouse=True)
def without_loaded_effects():
    """Take the effects of a test's files out of the library, in which all tests that follow in the process search.

    Caches may still refer to their classes; one without a name of its own is in no library.
    """
    yield
    for module in [name for name in sys.modules if name.startswith("piezoharvest_effects_")]:
        for cls in list(vars(sys.modules.pop(module)).values()):
            if isinstance(cls, type) and issubclass(cls, Effect) and cls.__module__ == module and "name" in vars(cls):
                del cls.name
