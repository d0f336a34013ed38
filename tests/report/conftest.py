"""What holds for the tests of reports."""

import pytest

from piezoharvest.design.bound import bounds


@pytest.fixture(autouse=True, scope="session")
def coarse_bound():
    """Bounds on the first mesh alone: the pages show what it gives, how close it is has tests of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bounds, "_MESHES", {kind: meshes[:1] for kind, meshes in bounds._MESHES.items()})
        yield
