"""Resonances of the two-port in a report, with further electrodes that are open."""

import numpy as np
import pytest

from piezoharvest import Electrode, Mode, SineForce, Study, Transducer
from piezoharvest.report.tables import two_port

PATCHES = Transducer(
    mass=0.01, damping=0.05, stiffness=986.96, coupling=1e-3, capacitance=40e-9,
    modes=(Mode(mass=0.02, damping=0.2, stiffness=9e3, coupling=3e-3),),
    electrodes=(Electrode(capacitance=30e-9, coupling=(2e-3, -4e-3)),),
)  # fmt: skip


def undamped(elastances):
    """Resonances (2,) in Hz where the patches have so many V/C: zero for a short, 1/C for an open one."""
    mass, stiffness = np.array([0.01, 0.02]), np.diag([986.96, 9e3])
    for elastance, coupling in zip(elastances, ([1e-3, 3e-3], [2e-3, -4e-3]), strict=True):
        stiffness += elastance * np.outer(coupling, coupling)
    return np.sort(np.sqrt(np.linalg.eigvals(stiffness / mass[:, None]))) / (2 * np.pi)


@pytest.mark.parametrize(
    ("name", "elastances"),
    [
        ("short-circuit resonance", (0.0, 0.0)),
        ("f_sc of electrodes 0", (0.0, 1 / 30e-9)),
        ("open-circuit resonance f_oc", (1 / 40e-9, 1 / 30e-9)),
    ],
)
def test_each_resonance_says_which_electrodes_are_shorted(name, elastances):
    """The short-circuit resonance was that with all but one pair of electrodes open."""
    _, rows = two_port(Study(transducer=PATCHES, excitation=SineForce(amplitude=0.02, frequency=50.0)), None)
    (values,) = [values for label, values, _ in rows if label == name]
    assert [float(value.split()[0]) for value in values] == pytest.approx(undamped(elastances), rel=1e-4)
