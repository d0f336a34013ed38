"""Studies for the tests of the design, built without files."""

from pathlib import Path

import numpy as np
import pytest

from piezoharvest.description.excitation import SineForce
from piezoharvest.description.transducer import Transducer
from piezoharvest.design import Bound, design
from piezoharvest.study import DesignOptions, Study

STIFFNESS, MASS, CAPACITANCE = 986.96, 0.01, 40e-9


@pytest.fixture
def host():
    """Transducer resonant at 50 Hz, by its K^2 = k_e^2 and Q_m."""

    def make(k2: float, quality: float = np.inf, **more) -> Transducer:
        return Transducer(
            mass=MASS, stiffness=STIFFNESS, capacitance=CAPACITANCE, damping=np.sqrt(STIFFNESS * MASS) / quality,
            coupling=np.sqrt(k2 * STIFFNESS * CAPACITANCE), **more,
        )  # fmt: skip

    return make


@pytest.fixture
def run(monkeypatch):
    """Design with a transducer, a sine force at a frequency unless another excitation is given, and options.

    Over a band without the bound, which takes longer than all else: `test_design_bound` is about it.
    """

    def call(transducer, frequency=50.0, *, excitation=None, shunts=(), amplitude=0.02, progress=None, **options):
        study = Study(
            title="", path=Path("study.toml"), transducer=transducer, shunts=tuple(shunts),
            excitation=excitation or SineForce(amplitude=amplitude, frequency=frequency),
            design=DesignOptions(**options) if options else None,
        )  # fmt: skip
        if study.design is not None and study.design.band is not None:
            monkeypatch.setattr("piezoharvest.design.search.bound_of", lambda view: Bound())
        return design(study, progress)

    return call
