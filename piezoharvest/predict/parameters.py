"""Parameters of a transducer and its effects as a vector: scaling, reading and replacing of values."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from piezoharvest.description import shunts
from piezoharvest.description.effects.circuit_value import CircuitValue
from piezoharvest.description.transducer import INERT, Transducer

# Small enough to be accepted by components (parameters.COMPLEX_STEP) after multiplications.
STEP = 1e-165
Path = tuple[str | int, ...]


@dataclass(frozen=True)
class Parameter:
    """One number of a transducer.

    Attributes
    ----------
    path : tuple
        Place in the transducer: ("stiffness",), ("modes", 0, "mass"), ("effects", 1, "resistance").
    unit : str
    scaling : "log", "linear" or "reciprocal"
        The variable is the logarithm, the value, or 1/value for a component that is absent at infinity.
    lower, upper : float
        Bounds of the variable.
    sign : float
        Sign of a value whose logarithm is varied: 1 or -1.
    title : str
        Name in results, if it is not the path.
    deviation : float
        Prior standard deviation about zero of a variable without a nominal value: of an effect, of a damping of zero.
    """

    path: Path
    unit: str
    scaling: str
    lower: float
    upper: float
    sign: float = 1.0
    title: str = ""
    deviation: float = np.inf

    @property
    def name(self) -> str:
        """Name in results: "stiffness", "modes.0.mass", "hysteresis.weights.1", "leakage.resistance"."""
        return self.title or ".".join(str(part) for part in self.path)

    def inner(self, value: float) -> float:
        """Variable from a value."""
        if self.scaling == "log":
            return np.log(self.sign * value)
        return float(value) if self.scaling == "linear" else 1.0 / value

    def derivative(self, value: float) -> float:
        """Derivative of the value by the variable."""
        if self.scaling == "log":
            return value
        return -(value**2) if self.scaling == "reciprocal" else 1.0

    def outer(self, inner: Any) -> Any:
        """Value from the variable, a number, real or with a complex step, or an array of these."""
        if self.scaling == "linear":
            return inner
        if self.scaling == "log":
            return self.sign * np.exp(inner)
        return 1.0 / inner if inner != 0 else np.inf

    def slope(self, inner: float) -> float:
        """Magnitude of the value's derivative with respect to the variable; that of 1/value for reciprocal scaling."""
        return float(np.exp(inner)) if self.scaling == "log" else 1.0


def parameter_of(component: Any, field: dataclasses.Field, path: Path) -> Parameter:
    """Parameter for a field with unit and bounds."""
    meta = field.metadata
    lower = max((-np.inf if meta[key] is None else meta[key]) for key in ("above", "at_least"))
    upper = min((np.inf if meta[key] is None else meta[key]) for key in ("below", "at_most"))
    if meta["null"] == np.inf:
        return Parameter(path, meta["unit"], "reciprocal", 0.0, np.inf)
    if lower >= 0 and meta["null"] is None:
        return Parameter(path, meta["unit"], "log", -np.inf, np.inf)
    return Parameter(path, meta["unit"], "linear", lower, upper)


def _fields(component: Any, names: Sequence[str], path: Path) -> list[Parameter]:
    fields = {f.name: f for f in dataclasses.fields(component)}
    return [parameter_of(component, fields[name], (*path, name)) for name in names]


def _begun_at_zero(parameters: Sequence[Parameter], mode: Any) -> list[Parameter]:
    """Parameters of a mode; a damping of zero, which has no logarithm, is varied itself, as far as to the critical."""
    if mode.damping != 0.0:
        return list(parameters)
    critical = 2.0 * float(np.sqrt(mode.stiffness * mode.mass))
    itself = {"scaling": "linear", "lower": 0.0, "deviation": critical}
    return [replace(each, **itself) if each.path[-1] == "damping" else each for each in parameters]


def parameters_of(transducer: Transducer, drive_kinds: set[str]) -> list[Parameter]:
    """Parameters of a transducer without its effects, as far as they matter under the drives of a campaign."""
    mechanical = [*(() if transducer.quasi_static else INERT), "stiffness", "coupling"]
    found = _begun_at_zero(_fields(transducer, [*mechanical, "capacitance"], ()), transducer)
    for n, mode in enumerate(transducer.modes):
        found += _begun_at_zero(_fields(mode, mechanical, ("modes", n)), mode)
    if transducer.hysteresis is not None:
        for j in range(len(transducer.hysteresis.weights)):
            found.append(Parameter(("hysteresis", "weights", j), "V/C", "linear", 0.0, np.inf))
        for j in range(len(transducer.hysteresis.weights)):
            found.append(Parameter(("hysteresis", "thresholds", j), "C", "log", -np.inf, np.inf))
    for n, effect in enumerate(transducer.effects):
        if isinstance(effect, CircuitValue):
            found.append(_circuit_parameter(effect, n))
    return found


def is_of_circuit(parameter: Parameter) -> bool:
    """True for a value of a circuit, which the campaign frees by `fit` in a record's shunt."""
    return bool(parameter.title)


def _circuit_parameter(value: CircuitValue, n: int) -> Parameter:
    """Parameter for a fitted value of a circuit: bounds and unit are those of the circuit's own field."""
    cls = shunts.registered()[value.kind]
    field = next(f for f in dataclasses.fields(cls) if f.name == value.key)
    found = parameter_of(cls, field, ("effects", n, "value"))
    if value.label == 0.0 and found.scaling == "log":  # a drop of zero has no logarithm
        found = replace(found, scaling="linear", lower=0.0)
    return replace(found, title=value.title)


def value_at(transducer: Transducer, path: Path) -> Any:
    """Value at a path."""
    value: Any = transducer
    for part in path:
        value = value[part] if isinstance(part, int) else getattr(value, part)
    return value


def put(component: Any, path: Path, value: Any) -> Any:
    """Copy of a component with another value at a path, unchecked: it may have a complex step of any size."""
    if not path:
        return value
    first, rest = path[0], path[1:]
    if isinstance(first, int):
        return (*component[:first], put(component[first], rest, value), *component[first + 1 :])
    new = copy.copy(component)
    new.__dict__.pop("_all_modes", None)
    object.__setattr__(new, first, put(getattr(component, first), rest, value))
    return new


def stepped(transducer: Transducer, parameter: Parameter, inner: float) -> Transducer:
    """Transducer with a complex step of the variable."""
    return put(transducer, parameter.path, parameter.outer(inner + 1j * STEP))


def stepped_in_each(transducer: Transducer, parameters: Sequence[Parameter]) -> Transducer:
    """As many transducers as parameters, each with a complex step of one: values of parameters are columns of these."""
    several = transducer
    for k, parameter in enumerate(parameters):
        value = value_at(transducer, parameter.path)
        column = np.full((len(parameters), 1), value, complex)
        column[k] = parameter.outer(parameter.inner(value) + 1j * STEP)
        several = put(several, parameter.path, column)
    return several
