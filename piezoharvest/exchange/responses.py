"""Frequency responses: two-ports, responses and records as `control.FRD`, and back."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.description.parameters import ParameterError, named_kind
from piezoharvest.linear.response import FrequencyResponse
from piezoharvest.linear.twoport import TwoPort
from piezoharvest.records.record import FrequencyRecord

if TYPE_CHECKING:
    from control import FRD

_OF_A_DRIVE = ("displacement", "velocity", "voltage", "current")  # outputs of a `FrequencyResponse`
_OF_A_PLANT = (("force", "current"), ("velocity", "voltage"))  # inputs and outputs of a `TwoPort`, as of `linearize`


def to_frd(response: TwoPort | FrequencyResponse | FrequencyRecord) -> FRD:
    """Frequency response as a `control.FRD` with named signals.

    Parameters
    ----------
    response : TwoPort, FrequencyResponse or FrequencyRecord
        A two-port gets the signals that `linearize` has: inputs `force` (N) and `current` (load current, A), outputs
        `velocity` (m/s) and `voltage` (V). A response gets the input `force` or `base_acceleration` and the outputs
        `displacement`, `velocity`, `voltage` and `current`; a record its own input and output.

    Raises
    ------
    ParameterError
        It is of several designs at once, or something else.
    """
    if isinstance(response, TwoPort):
        frequencies, data, (inputs, outputs) = response.frequencies, response.responses, _OF_A_PLANT
    elif isinstance(response, FrequencyResponse):
        data = np.stack([getattr(response, name) for name in _OF_A_DRIVE], axis=-1)[..., None]
        frequencies, outputs = response.frequencies, _OF_A_DRIVE
        inputs = ("base_acceleration" if response.base else "force",)
    elif isinstance(response, FrequencyRecord):
        frequencies, data = response.frequency, response.response[:, None, None]
        inputs, outputs = (response.input,), (response.output,)
    else:
        allowed = "must be a TwoPort, a FrequencyResponse or a FrequencyRecord"
        raise ParameterError("response", f"found {named_kind(response)}, {allowed}")
    if data.ndim != 3:
        raise ParameterError("response", f"found responses of shape {data.shape[:-2]}, must be those of one design")
    from control import FRD

    return FRD(np.moveaxis(data, 0, -1), 2 * np.pi * frequencies, inputs=list(inputs), outputs=list(outputs))


def two_port_from(response: Any) -> TwoPort:
    """Two-port from a frequency response with two inputs and two outputs.

    Parameters
    ----------
    response : control.FRD or skrf.Network
        A FRD has the inputs `force` and `current` (load current, A) and the outputs `velocity` or `displacement`, and
        `voltage`, as `to_frd` and `control.frequency_response(linearize(transducer), omega)` give it; others beside
        them are left out. A network of scikit-rf has the mechanical port first, in N s/m.

    Raises
    ------
    ParameterError
        A signal is missing, or the network has not two ports.
    """
    if hasattr(response, "z0"):  # of scikit-rf, which is not needed for the others
        if response.number_of_ports != 2:
            raise ParameterError("response", f"found {counted(response.number_of_ports, 'port')}, must be two")
        return TwoPort(np.array(response.f, float), np.array(response.z))
    data, omega = _data(response)
    named = {"input": list(response.input_labels), "output": list(response.output_labels)}
    motion = "velocity" if "velocity" in named["output"] else "displacement"
    for kind, wanted in (("input", ("force", "current")), ("output", (motion, "voltage"))):
        for name in wanted:
            if name not in named[kind]:
                raise ParameterError(kind, f"found {', '.join(named[kind])}, but {name} is needed")
    rows = [named["output"].index(name) for name in (motion, "voltage")]
    columns = [named["input"].index(name) for name in ("force", "current")]
    chosen = data[np.ix_(range(len(data)), rows, columns)]
    if motion == "displacement":
        chosen[:, 0] *= 1j * omega[:, None]
    return TwoPort.from_responses(omega / (2 * np.pi), chosen)


def response_record(response: Any, **keys: Any) -> dict[str, Any]:
    """Record of a measured frequency response or impedance, for `Campaign.from_arrays`.

    Parameters
    ----------
    response : control.FRD or skrf.Network
        Of one input and one output, in SI units; of a network the impedance of its port is taken.
    **keys
        Keys of [[records]]: `kind = "impedance"` (voltage over the current into the leads), or `output`, `input` and
        the load of a `kind = "frf"`, which is the default of a FRD. Signals of a FRD that have the name of a channel
        are its input and output.

    Returns
    -------
    dict

    Raises
    ------
    ParameterError
        It has several inputs, outputs or ports.

    Examples
    --------
    >>> import control
    >>> measured = control.FRD([1e-4, 5e-4 - 1e-4j], [250.0, 310.0], inputs="force", outputs="displacement")
    >>> record = response_record(measured, load_resistance=1e5)
    >>> record["kind"], record["input"], record["output"]
    ('frf', 'force', 'displacement')
    """
    if hasattr(response, "z0"):
        frequencies, data, named = np.array(response.f, float), np.array(response.z), {"kind": "impedance"}
    else:
        data, omega = _data(response)
        frequencies, named = omega / (2 * np.pi), {"kind": "frf"}
        labels = {"input": list(response.input_labels), "output": list(response.output_labels)}
        if keys.get("kind", "frf") == "frf":  # without names of their own, signals are u[0] and y[0]
            named |= {key: names[0] for key, names in labels.items() if names[0].isidentifier()}
    if data.shape[1:] != (1, 1):
        found = f"found {data.shape[1]} outputs and {data.shape[2]} inputs"
        raise ParameterError(
            "response", f"{found}, must be one of each: take one by its names, response[output, input]"
        )
    record = {**named, **keys}
    column = "impedance" if record["kind"] == "impedance" else "response"  # the default names of either kind
    return {**record, "data": {"frequency_Hz": frequencies, column: data[:, 0, 0]}}


def _data(response: Any) -> tuple[np.ndarray, np.ndarray]:
    """Values (f, outputs, inputs) and angular frequencies of a FRD, those above zero; raises `ParameterError`."""
    if not hasattr(response, "frdata"):
        found = f"found {named_kind(response)}, must be a control.FRD or a skrf.Network"
        raise ParameterError("response", f"{found}: control.frequency_response(system, omega) makes one")
    omega = np.asarray(response.omega, float)
    above = omega > 0  # open electrodes keep their charge: no static response
    return np.moveaxis(np.asarray(response.frdata, complex), -1, 0)[above], omega[above]
