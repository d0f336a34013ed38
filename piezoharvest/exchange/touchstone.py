"""Touchstone files, and two-ports as networks of scikit-rf.

Format: IBIS Open Forum, "Touchstone File Format Specification", version 2.0 (2009), of which version 1.0 is written.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from piezoharvest.description.parameters import ParameterError
from piezoharvest.linear.assembly import require_positive
from piezoharvest.linear.twoport import TwoPort
from piezoharvest.output import check_file, write_text

if TYPE_CHECKING:
    from skrf import Network


def write_touchstone(path: str | Path, frequencies: Any, impedance: Any, *, reference: float = 50.0) -> None:
    """Write an impedance as scattering parameters.

    Parameters
    ----------
    path : str or Path
        Ends in .s1p, or in .s2p for a two-port; complete or not written at all.
    frequencies : (f,) array
        Hz, increasing.
    impedance : (f,) or (f, 2, 2) complex array
        ohm: of leads, or the impedance matrix of a two-port (`TwoPort.z`, whose first port is in N s/m).
    reference : float
        Resistance that the parameters refer to, ohm.

    Raises
    ------
    ParameterError
        A shape or number is not allowed.
    OutputError
        The file cannot be written, or has another ending.
    """
    require_positive("frequencies", frequencies, "Hz")
    require_positive("reference", reference, "ohm")
    frequencies, impedance = np.atleast_1d(np.asarray(frequencies, float)), np.asarray(impedance, complex)
    ports = 2 if impedance.ndim == 3 else 1
    if impedance.shape not in ((len(frequencies),), (len(frequencies), 2, 2)):
        allowed = f"must be {(len(frequencies),)} or {(len(frequencies), 2, 2)}, as there are so many frequencies"
        raise ParameterError("impedance", f"found the shape {impedance.shape}, {allowed}")
    if np.any(np.diff(frequencies) <= 0) or not np.all(np.isfinite(impedance)):
        raise ParameterError("impedance", "found a frequency that does not increase, or a value that is not finite")
    path = check_file(path, (f".s{ports}p",))
    z = impedance.reshape(len(frequencies), ports, ports)
    eye = reference * np.eye(ports)
    s = np.linalg.solve(z + eye, z - eye)  # (z + R)^-1 (z - R): the two commute
    # Version 1.0 has the parameters of two ports, and of no others, by columns: S11, S21, S12, S22.
    numbers = s.swapaxes(1, 2).reshape(len(frequencies), -1)
    rows = np.column_stack((frequencies, numbers.view(float)))
    lines = ["! frequency in Hz, real and imaginary part of each parameter", f"# HZ S RI R {float(reference)!r}"]
    write_text("\n".join([*lines, *(" ".join(repr(float(value)) for value in row) for row in rows), ""]), path)


def to_network(two_port: TwoPort, *, reference: Any = 50.0) -> Network:
    """Two-port as a `skrf.Network` (scikit-rf, the extra `rf`); `two_port_from` is the way back.

    Parameters
    ----------
    two_port : TwoPort
    reference : float or sequence of two
        Reference impedance of the ports: mechanical (N s/m), electrical (ohm).

    Raises
    ------
    ParameterError
        scikit-rf is not installed, or a reference is not above zero.
    """
    require_positive("reference", reference, "ohm")
    try:
        from skrf import Network
    except ModuleNotFoundError:
        message = "making networks needs scikit-rf, which is not installed: pip install 'piezoharvest[rf]'"
        raise ParameterError("two_port", message) from None
    return Network(f=two_port.frequencies, f_unit="Hz", z=two_port.z, z0=np.asarray(reference, float))
