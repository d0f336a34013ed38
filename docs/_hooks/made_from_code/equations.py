"""Equations for the page of each shunt: its own, evaluated on symbols instead of numbers, in each configuration."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Iterator, Mapping
from importlib.util import find_spec
from types import SimpleNamespace
from typing import Any

from piezoharvest.description import shunts
from piezoharvest.description.circuit import Port
from piezoharvest.description.shunts import Shunt
from piezoharvest.report.units import symbol

_MOST = 8  # configurations on a page
_STATES = {"current": "i_L", "dc": "v_dc", "voltage": "v_C"}
_HEAD = """
## Equations

v is the electrode voltage and i the load current, out of the transducer, C its clamped capacitance; ' is a time
derivative, and {states}. The shunt has these equations in its configurations{some}:

```text
{lines}
```
"""


def equations(examples: Mapping[str, Shunt]) -> Iterator[tuple[str, str]]:
    """Kind and section in Markdown of each shunt that can be evaluated on symbols; none where SymPy is missing."""
    if find_spec("sympy") is None:
        return
    for kind, cls in shunts.registered().items():
        if kind in examples and cls.__module__.startswith("piezoharvest."):
            found = _evaluated(examples[kind])
            if found is not None:
                yield kind, _section(*found)


def _evaluated(shunt: Shunt) -> tuple[list[str], dict[str, list[str]], bool] | None:
    """States, and equations by configuration, as text; whether some were left out. None if symbols do not do."""
    import sympy

    for name in ("sqrt", "exp", "cos", "sin"):  # as methods, by which NumPy's functions take objects
        setattr(sympy.Expr, name, getattr(sympy, name))
    try:
        model, port = _symbolic(shunt), _port()
        states = [state.name for state in model.states(port.capacitance)]
        z = SimpleNamespace(**{name: sympy.Symbol(_STATES.get(name, name)) for name in states})
        dz = SimpleNamespace(**{name: sympy.Symbol(f"{_STATES.get(name, name)}'") for name in states})
        vars(z).update({name: first * second for name, (first, second) in model.factors(port, z).items()})
        names = [name for name in model.configurations() if not name.endswith("-")]  # which mirror those with a +
        rows = {name: [_text(row) for row in model.equations(name, port, z, dz)] for name in names[:_MOST]}
    except (TypeError, AttributeError, ValueError):
        return None
    return [_STATES.get(name, name) for name in states], rows, len(names) > _MOST


def _symbolic(shunt: Shunt) -> Shunt:
    """The shunt with a symbol for each quantity that the example gives."""
    import sympy

    given: dict[str, Any] = {}
    for field in dataclasses.fields(shunt):
        value = getattr(shunt, field.name)
        if "unit" in field.metadata and isinstance(value, float) and value != field.default:
            given[field.name] = sympy.Symbol(symbol(field.name).replace(" ", "_"), positive=True)
    model = copy.copy(shunt)
    model.__dict__.update(given)
    return model


def _port() -> Port:
    from sympy import Integer, Symbol

    v, dv, i, strain = (Symbol(name) for name in ("v", "v'", "i", "i_T"))
    return Port(v=v, dv=dv, i=i, one=Integer(1), capacitance=Symbol("C", positive=True), strain_current=strain)  # pyright: ignore[reportArgumentType]


def _text(row: Any) -> str:
    """An equation as one writes it."""
    import sympy

    def short(number: Any) -> Any:
        return sympy.Integer(int(number)) if float(number).is_integer() else number.n(4)

    row = sympy.expand(sympy.sympify(row)).replace(lambda part: part.is_Float, short)
    return f"{sympy.sstr(row).replace('**', '^').replace('*', ' ')} = 0"


def _section(states: list[str], rows: Mapping[str, list[str]], cut: bool) -> str:
    width = max(map(len, rows))
    lines = [f"{name if n == 0 else '':<{width}}  {row}" for name, each in rows.items() for n, row in enumerate(each)]
    more = ", without those that mirror one of them with reversed polarity" if any("+" in name for name in rows) else ""
    strain = "i_T the strain current sum T_i x_i', " if any("i_T" in line for line in lines) else ""
    said = strain + (f"the states are {', '.join(states)}" if states else "there are no states of its own")
    return _HEAD.format(states=said, some=f"{more} (the first {_MOST})" if cut else more, lines="\n".join(lines))
