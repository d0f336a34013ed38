"""Physical quantities as dataclass fields, with unit, bounds and null value as metadata."""

from __future__ import annotations

import copy
import dataclasses
import operator
from collections.abc import Collection, Hashable
from dataclasses import MISSING, dataclass
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from piezoharvest.field_help import WithFields
from piezoharvest.near_names import did_you_mean

C = TypeVar("C", bound="Component")

# Null value of a quantity that replaces another one, that of a label, and is absent where it equals it.
AS_LABELLED = "label"


class ParameterError(ValueError):
    """A value that is not physical or not allowed by the interface.

    Attributes
    ----------
    key : str
        The field (or dotted path of fields) of the value.
    """

    def __init__(self, key: str, message: str):
        super().__init__(f"{key}: {message}")
        self.key = key
        self.message = message

    def within(self, prefix: str) -> ParameterError:
        """The same error with `prefix` put before its key path."""
        return ParameterError(f"{prefix}.{self.key}", self.message)


def quantity(
    unit: str,
    doc: str,
    *,
    default: Any = MISSING,
    above: float | None = None,
    at_least: float | None = None,
    below: float | None = None,
    at_most: float | None = None,
    null: float | str | None = None,
    other_law_at_zero: bool = False,
) -> Any:
    """Declare a dataclass field that holds a quantity in SI units.

    Parameters
    ----------
    unit : str
        SI unit, in a form that pint reads; "" for a pure number.
    doc : str
        Description of the quantity.
    default : optional
        Default value; the field is required without it.
    above, at_least, below, at_most : float, optional
        Open and closed bounds.
    null : float or `AS_LABELLED`, optional
        Value at which the described effect is absent.
    other_law_at_zero : bool
        At zero the equations have another form, so that there is no derivative there.
    """
    bounds = {"above": above, "at_least": at_least, "below": below, "at_most": at_most}
    metadata = {"unit": unit, "doc": doc, "null": null, "other_law_at_zero": other_law_at_zero, **bounds}
    return dataclasses.field(default=default, metadata=metadata)


def described(doc: str, *, default: Any = MISSING, default_factory: Any = MISSING) -> Any:
    """Declare a dataclass field that is no quantity: a choice, a text, a table, a list of these.

    Parameters
    ----------
    doc : str
        Description of the key, for the reference of all keys.
    default, default_factory : optional
        As of `dataclasses.field`; the field is required without them.
    """
    if default_factory is not MISSING:
        return dataclasses.field(default_factory=default_factory, metadata={"doc": doc})
    return dataclasses.field(default=default, metadata={"doc": doc})


_COMPARISONS = {
    "above": ("greater than", operator.gt),
    "at_least": ("at least", operator.ge),
    "below": ("less than", operator.lt),
    "at_most": ("at most", operator.le),
}


# Allowed sizes of quantities, the smallest of those that must not be zero: products and quotients of five of them do
# not overflow, and these limits are far beyond any realistic value.
SMALLEST, LARGEST = 1e-60, 1e60

# Size of a complex step: the imaginary part of f(x + i e) is e f'(x), exact to rounding (Squire & Trapp, SIAM Review
# 40(1), 110-112, 1998). Components accept no other complex numbers.
COMPLEX_STEP = 1e-150


def allowed(field: dataclasses.Field) -> str:
    """Allowed values of a quantity field, in words."""
    unit = f" {field.metadata['unit']}" if field.metadata.get("unit") else ""
    bounds = [
        f"{words} {field.metadata[key]:g}{unit}"
        for key, (words, _) in _COMPARISONS.items()
        if field.metadata.get(key) is not None
    ]
    return "a finite number" + (" " + " and ".join(bounds) if bounds else "")


def check_quantity(field: dataclasses.Field, value: Any) -> None:
    """Raise `ParameterError` unless `value` (a number, or a tuple or array of them) is finite and within the bounds.

    Raises
    ------
    ParameterError
        The value is not a number, not finite or outside the bounds.
    """
    if (value is None and field.default is None) or _is_fine(value, *_limits(field)):
        return
    if (united := _with_unit(value)) is not None:
        unit = field.metadata.get("unit", "")
        told = f"in Python numbers are in SI units; of a pint quantity take m_as({unit!r})"
        raise ParameterError(field.name, f"found {united} with its unit, must be {allowed(field)}: {told}")
    numbers = np.asarray(value)
    try:
        if numbers.dtype.kind not in "fiuc" or np.any(np.abs(np.imag(numbers)) > COMPLEX_STEP):
            raise ValueError
        numbers = np.real(numbers)
        fine = np.isfinite(numbers.astype(float))
    except (TypeError, ValueError):
        text = (
            "; in Python numbers are in SI units, text with a unit is for TOML files" if isinstance(value, str) else ""
        )
        raise ParameterError(field.name, f"found {value!r:.60}, must be {allowed(field)}{text}") from None
    for key, (_, compare) in _COMPARISONS.items():
        if field.metadata.get(key) is not None:
            fine &= compare(numbers, field.metadata[key])
    if not np.all(fine):
        found = value if numbers.ndim == 0 else numbers[~fine].flat[0]
        raise ParameterError(field.name, f"found {found}, must be {allowed(field)}")
    check_range(field.name, numbers, inverted=field.metadata.get("above") == 0)


def _with_unit(value: Any) -> str | None:
    """A quantity of pint (or of another library of units) as text, also as one of several; else None."""
    if isinstance(value, list | tuple):
        return next((found for each in value if (found := _with_unit(each)) is not None), None)
    return f"{value!s:.60}" if hasattr(value, "units") or hasattr(value, "unit") else None


def _limits(field: dataclasses.Field) -> tuple[float, float]:
    """Least and largest number that passes `check_quantity`."""
    above, at_least, below, at_most = (field.metadata.get(key) for key in _COMPARISONS)
    least, most = SMALLEST if above == 0 else -LARGEST, LARGEST
    if above is not None:
        least = max(least, float(np.nextafter(above, np.inf)))
    if below is not None:
        most = min(most, float(np.nextafter(below, -np.inf)))
    return max(least, -LARGEST if at_least is None else at_least), min(most, LARGEST if at_most is None else at_most)


def _is_fine(value: Any, least: float, most: float) -> bool:
    """True if a number or a tuple of them passes `check_quantity`, in little time: most components have these."""
    if isinstance(value, float):
        return least <= value <= most
    return isinstance(value, tuple) and all(isinstance(each, float) and least <= each <= most for each in value)


# Classes are not kept by it: those of a user's file, or of a page of the documentation, come and go.
_CHECKED: WeakKeyDictionary[type, tuple[tuple[dataclasses.Field, float, float], ...]] = WeakKeyDictionary()


def _checked(cls: type) -> tuple[tuple[dataclasses.Field, float, float], ...]:
    """Quantities of a class of components with their limits: many components are made in a fit."""
    if cls not in _CHECKED:
        some = [field for field in dataclasses.fields(cls) if "unit" in field.metadata]
        _CHECKED[cls] = tuple((field, *_limits(field)) for field in some)
    return _CHECKED[cls]


def check_choice(key: str, value: Any, allowed_: Collection[Any]) -> None:
    """Raise `ParameterError` unless a value is one of those that are allowed.

    Raises
    ------
    ParameterError
    """
    if not isinstance(value, Hashable) or value not in allowed_:
        hint = did_you_mean(value, map(str, allowed_))
        raise ParameterError(key, f"found {value!r:.60}{hint}, allowed are {', '.join(map(str, allowed_))}")


def check_kind(key: str, value: Any, wanted: type, advice: str = "") -> None:
    """Raise `ParameterError` unless an argument of a function is an object of the wanted class.

    Parameters
    ----------
    key : str
        The argument.
    value : object
    wanted : type
    advice : str
        How such an object is made, or what takes the one that was given.

    Raises
    ------
    ParameterError
    """
    if not isinstance(value, wanted):
        told = f": {advice}" if advice else ""
        raise ParameterError(key, f"found {named_kind(value)}, must be {_with_article(wanted.__name__)}{told}")


def named_kind(value: Any) -> str:
    """A value of a wrong type as a message names it: itself if it is short, else its class with an article."""
    if isinstance(value, str | int | float | None):
        return f"{value!r:.60}"
    return _with_article(type(value).__name__)


def _with_article(name: str) -> str:
    return f"{'an' if name[0].lower() in 'aeio' else 'a'} {name}"


def check_range(key: str, numbers: Any, *, inverted: bool) -> None:
    """Raise `ParameterError` if a number is so large, or so small though `inverted`, that it leads to overflow.

    Raises
    ------
    ParameterError
        The size of a number is beyond `LARGEST`, or below `SMALLEST`.
    """
    size = np.abs(numbers)
    least = SMALLEST if inverted else 0.0
    beyond = (size > LARGEST) | (size < least)
    if np.any(beyond):
        found = np.ravel(numbers)[np.ravel(beyond)][0]
        raise ParameterError(key, f"found {found:g}, must have a magnitude from {least:g} to {LARGEST:g}")


@dataclass(frozen=True, kw_only=True)
class Component:
    """Base class of everything with physical quantities: an immutable dataclass that checks itself.

    Fields are SI numbers. A field may also hold an array of shape (designs, 1): the component then represents a batch
    of designs, and the matrices made from it have the batch as their leading axis.

    Raises
    ------
    ParameterError
        A value is not finite or outside its bounds.
    """

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if cls.__dict__.get("__doc__"):
            cls.__doc__ = WithFields(cls.__dict__["__doc__"], allowed)  # pyright: ignore[reportAttributeAccessIssue]

    def __post_init__(self) -> None:
        for field, least, most in _checked(type(self)):
            value = getattr(self, field.name)
            if not _is_fine(value, least, most):
                check_quantity(field, value)


def altered(component: C, **values: Any) -> C:
    """Copy of a component with other values, checked unless one of them has a complex step, whose size may be any."""
    if not any(np.iscomplexobj(value) for value in values.values()):
        return dataclasses.replace(component, **values)
    new = copy.copy(component)
    new.__dict__.update(values)
    return new


def subclasses_by(attribute: str, base: type) -> dict[str, type]:
    """Registered components: every subclass of `base` that has a name in the class attribute `attribute`.

    A class whose name is that of the object (a property) is none of the library.
    """
    found: dict[str, type] = {}
    for cls in base.__subclasses__():
        if attribute in cls.__dict__ and not isinstance(cls.__dict__[attribute], property):
            found[cls.__dict__[attribute]] = cls
        found.update(subclasses_by(attribute, cls))
    return found
