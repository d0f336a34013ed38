"""Circuits from admittances: networks where they are passive, else those of a digital controller."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np

from piezoharvest.description.parameters import ParameterError, named_kind
from piezoharvest.description.shunts.damping.digital import Digital
from piezoharvest.description.shunts.linear.network import Network
from piezoharvest.exchange.synthesis import MOST_COPIED, NotRealisableError, Ratio, check_passive, network_elements
from piezoharvest.linear.circuits import admittance

_AGREES = 1e-6  # relative, of the admittances: far below the tolerance of any part
_POINTS = 200  # frequencies at which they are compared


def shunt_from(system: Any, *, sample_time: float | None = None, **keys: Any) -> Network | Digital:
    """Shunt with a given admittance: a network, or with a sample time a digital one; the inverse of `linearize_shunt`.

    Parameters
    ----------
    system : control.TransferFunction or StateSpace, or one of scipy.signal
        Admittance from the electrode voltage (V) to the load current (A), one input and one output. In discrete time
        it is the filter of a controller, by the bilinear transform of `Digital`.
    sample_time : float, optional
        s, of a controller.
    **keys
        Further fields of `Digital`: delay, resolution, saturation.

    Returns
    -------
    Network or Digital
        A network harvests in none of its resistors until one of its elements is marked as a load.

    Raises
    ------
    ParameterError
        The admittance is not passive and no sample time is given, or it is not allowed in a digital shunt.

    Examples
    --------
    >>> import control
    >>> shunt_from(control.tf([1.0], [2.0, 100.0])).netlist
    (Element(name='L1', kind='L', nodes=(1, 2), value=2.0, load=False), \
Element(name='R1', kind='R', nodes=(2, 0), value=100.0, load=False))
    """
    numerator, denominator, step = _polynomials(system)
    if step:
        if sample_time is not None and sample_time != step:
            raise ParameterError("sample_time", f"found {sample_time} s, but the system has a sample time of {step} s")
        numerator, denominator = (_continuous(c, len(denominator) - 1, step) for c in (numerator, denominator))
        sample_time = step
    if sample_time is not None:
        coefficients = (tuple(map(float, np.trim_zeros(c, "f"))) for c in (numerator, denominator))
        return Digital(**dict(zip(("numerator", "denominator"), coefficients, strict=True)), sample_time=sample_time,
                       **keys)  # fmt: skip
    if keys:
        raise ParameterError(min(keys), "found a key of a digital shunt, which needs a sample_time too")
    return _network(numerator, denominator)


def _network(numerator: np.ndarray, denominator: np.ndarray) -> Network:
    """Network with an admittance: the first that has it of those without copies of parts and with them."""
    ratio = Ratio(numerator, denominator).cleaned().reduced()
    poles = len(ratio.below) - 1
    instead = "a digital shunt can have it nevertheless, give its sample_time"
    if len(ratio.above) > len(ratio.below):
        instead = "a digital shunt cannot have it either, with more zeros than poles"
    reason = (
        "rounding hides its parts" if poles <= MOST_COPIED else f"it has {poles} poles, but no series or parallel parts"
    )
    with np.errstate(all="ignore"):
        try:
            check_passive(ratio)
        except NotRealisableError as error:
            raise ParameterError("system", f"no network has this admittance: {error}; {instead}") from None
        for copies in (False, True) if poles <= MOST_COPIED else (False,):
            with suppress(NotRealisableError, ParameterError, np.linalg.LinAlgError):
                network = Network(netlist=network_elements(ratio, copies=copies))
                if _distance(network, ratio) <= _AGREES:
                    return network
    raise ParameterError("system", f"no network is found with this admittance: {reason}; {instead}")


def _distance(network: Network, ratio: Ratio) -> float:
    """Largest relative difference of a network's admittance, beyond its poles and zeros too."""
    corners = ratio.corners()
    omega = np.geomspace(0.1 * corners.min(), 10 * corners.max(), _POINTS)
    wanted = np.polyval(ratio.above, 1j * omega) / np.polyval(ratio.below, 1j * omega)
    return float(np.max(np.abs(admittance(network, omega / (2 * np.pi)) / wanted - 1)))


def _polynomials(system: Any) -> tuple[np.ndarray, np.ndarray, float]:
    """Numerator, denominator and sample time (0 in continuous time); raises `ParameterError`."""
    if hasattr(system, "ninputs") and hasattr(system, "noutputs"):  # of python-control
        if (system.ninputs, system.noutputs) != (1, 1):
            found = f"found {system.noutputs} outputs and {system.ninputs} inputs"
            raise ParameterError(
                "system", f"{found}, must be one of each: take one by its names, system[output, input]"
            )
        from control import ss2tf

        if hasattr(system, "A"):
            system = ss2tf(system)
        parts = (system.num[0][0], system.den[0][0]) if hasattr(system, "num") else None
    else:
        if hasattr(system, "to_tf"):  # of scipy.signal
            system = system.to_tf()
        parts = (system.num, system.den) if hasattr(system, "num") else None
    coefficients = [np.atleast_1d(np.squeeze(np.asarray(part))) for part in parts or ()]
    if parts is None or any(c.ndim != 1 or c.dtype.kind not in "fi" for c in coefficients):
        found = f"found {named_kind(system)}, must be a TransferFunction or StateSpace with one input and output"
        raise ParameterError("system", f"{found}, of finite real numbers")
    if bad := [x for c in coefficients for x in c if not np.isfinite(x)]:
        raise ParameterError("system", f"found {bad[0]} among its coefficients, must be finite real numbers")
    numerator, denominator = (np.trim_zeros(c.astype(float), "f") for c in coefficients)
    if not len(numerator) or not len(denominator):
        raise ParameterError("system", "found an admittance of zero, which is that of open electrodes (Open)")
    step = system.dt
    if step is True:
        raise ParameterError("system", "found discrete time without a sample time, must have one in s")
    return numerator, denominator, float(step or 0.0)


def _continuous(coefficients: np.ndarray, order: int, step: float) -> np.ndarray:
    """Coefficients in s of p(z) (1 - s T/2)^order with z = (1 + s T/2)/(1 - s T/2)."""
    ahead, behind = np.array([step / 2, 1.0]), np.array([-step / 2, 1.0])
    total = np.zeros(order + 1)
    for power, coefficient in enumerate(coefficients[::-1]):
        term = np.array([1.0])
        for factor in [ahead] * power + [behind] * (order - power):
            term = np.polymul(term, factor)
        total += coefficient * term
    return total
