"""Netlists of resistors, inductors and capacitors: reading, checks, and the topology for their equations.

Sources: Bryant, Proc. IEE C 106(9), 174-188, 1959 (normal tree); Kuo & Rohrer, Proc. IEEE 55(9), 1201-1219, 1967
(hybrid equations of RLC networks).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.description.parameters import ParameterError, check_range

VALUE_KEYS = {"R": "resistance", "L": "inductance", "C": "capacitance"}
UNITS = {"R": "ohm", "L": "H", "C": "F"}
_SUFFIXES = {
    "": 1.0, "f": 1e-15, "p": 1e-12, "n": 1e-9, "u": 1e-6, "µ": 1e-6, "m": 1e-3, "k": 1e3, "meg": 1e6, "g": 1e9,
    "t": 1e12,
}  # fmt: skip
_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)(meg|[fpnuµmkgt]?)(?:ohms?|[fhΩ])?", re.IGNORECASE)
_FLAGS = {"true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}


@dataclass(frozen=True)
class Element:
    """A linear two-terminal element of a network.

    Attributes
    ----------
    name : str
        Unique within its network.
    kind : str
        "R", "L" or "C".
    nodes : tuple of int
        Positive and negative node; the port is at nodes 1 and 0.
    value : float
        Resistance in ohm, inductance in H or capacitance in F.
    load : bool
        True if the power in this resistor counts as harvested.
    """

    name: str
    kind: str
    nodes: tuple[int, int]
    value: float
    load: bool = False

    @property
    def table(self) -> dict[str, Any]:
        """The element as a table of a study file."""
        return {**vars(self), "nodes": list(self.nodes)}


def spice_number(text: str) -> float | None:
    """Read a number with an SPICE suffix, in either case: f p n u m k meg g t (m is 1e-3 and F alone is 1e-15).

    Returns
    -------
    float or None
        None if the text is not such a number. A unit after the suffix ("10uF", "4.7kohm", "2H") is ignored.
    """
    match = _NUMBER.fullmatch(text.strip())
    return float(match[1]) * _SUFFIXES[match[2].lower()] if match else None


def read_netlist(netlist: Any) -> tuple[Element, ...]:
    """Elements of a netlist, checked one by one and as a circuit.

    Parameters
    ----------
    netlist : str or sequence of str, mapping or Element
        Either lines in the style of SPICE, "R1 1 2 100k load=true", as one text or as a list (comments begin with
        * or ;), or tables with name, kind (also called element or type; else the first letter of the name tells it),
        nodes, value (also called resistance, inductance or capacitance) and load.

    Raises
    ------
    ParameterError
        An element or the circuit is not allowed; the key gives the index of the entry (a line or a table).
    """
    if isinstance(netlist, str):
        netlist = netlist.splitlines()
    if not isinstance(netlist, Sequence):
        raise ParameterError("netlist", f"found {netlist!r}, must be a text, or a list of lines or tables")
    keyed: list[tuple[str, Element]] = []
    for index, entry in enumerate(netlist):
        key = f"netlist.{index}"
        if isinstance(entry, Element):
            table: Mapping[str, Any] = vars(entry)
        elif isinstance(entry, Mapping):
            table = entry
        elif isinstance(entry, str):
            words = re.sub(r"\s*=\s*", "=", entry.partition(";")[0]).split()
            if not words or words[0].startswith("*"):
                continue
            table = _table(words, key)
        else:
            raise ParameterError(key, f"found {entry!r}, must be a line such as 'R1 1 2 100k' or a table")
        keyed.append((key, _element(table, key, len(keyed) + 1)))
    _check_circuit(keyed)
    return tuple(element for _, element in keyed)


def _table(words: list[str], key: str) -> dict[str, Any]:
    """Convert the words of a line in the style of SPICE to a table."""
    if len(words) < 4:
        raise ParameterError(key, f"found {' '.join(words)!r}, must be a line such as 'R1 1 2 100k load=true'")
    table: dict[str, Any] = {"name": words[0], "kind": words[0][0], "nodes": words[1:3], "value": words[3]}
    for word in words[4:]:
        name, sign, flag = word.lower().partition("=")
        if name != "load" or (sign and flag not in _FLAGS):
            raise ParameterError(key, f"found {word!r}, allowed after the value is load=true or load=false")
        table["load"] = _FLAGS[flag] if sign else True
    return table


def _element(table: Mapping[str, Any], key: str, number: int) -> Element:
    """Check one table; `number` names an element that has no name."""
    known = ("name", "kind", "element", "type", "nodes", "value", *VALUE_KEYS.values(), "load")
    for name in table:
        if name not in known:
            raise ParameterError(f"{key}.{name}", f"unknown key, known keys are {', '.join(known)}")
    kind = _kind(table, key)
    name = table.get("name", f"{kind}{number}")
    if not isinstance(name, str) or not re.fullmatch(r"[\w-]+", name, re.ASCII):
        raise ParameterError(f"{key}.name", f"found {name!r}, must be a name of letters, digits, _ and -")
    load = table.get("load", False)
    if not isinstance(load, bool):
        raise ParameterError(f"{key}.load", f"found {load!r}, must be true or false")
    if load and kind != "R":
        raise ParameterError(
            f"{key}.load", f"found true for {name} of kind {kind}, but only a resistor may be the load"
        )
    return Element(name, kind, _nodes(table, key), _value(table, kind, key), load)


def _kind(table: Mapping[str, Any], key: str) -> str:
    """Kind of an element, from its own key, else from the key of its value, else from its name."""
    for source in ("kind", "element", "type"):
        if source in table:
            kind = table[source]
            break
    else:
        source = "kind"
        from_value = [kind for kind, name in VALUE_KEYS.items() if name in table]
        kind = from_value[0] if from_value else str(table.get("name", ""))[:1]
    letters = {**{k.lower(): k for k in VALUE_KEYS}, "resistor": "R", "inductor": "L", "capacitor": "C"}
    found = letters.get(kind.lower()) if isinstance(kind, str) else None
    if found is None:
        raise ParameterError(f"{key}.{source}", f"found {kind!r}, must be R, L or C")
    return found


def _nodes(table: Mapping[str, Any], key: str) -> tuple[int, int]:
    nodes = table.get("nodes")
    allowed = "two different node numbers (whole, 0 or more) such as [1, 2]"
    if isinstance(nodes, str) or not isinstance(nodes, Sequence) or len(nodes) != 2:
        raise ParameterError(f"{key}.nodes", f"found {nodes!r}, allowed are {allowed}")
    whole = [str(node).isdecimal() and isinstance(node, int | str) for node in nodes]
    if not all(whole) or int(nodes[0]) == int(nodes[1]):
        raise ParameterError(f"{key}.nodes", f"found {list(nodes)}, allowed are {allowed}")
    return int(nodes[0]), int(nodes[1])


def _value(table: Mapping[str, Any], kind: str, key: str) -> float:
    """Value of an element in SI units."""
    given = [name for name in ("value", *VALUE_KEYS.values()) if name in table]
    allowed = f"a finite number greater than 0 {UNITS[kind]}"
    if len(given) != 1 or given[0] not in ("value", VALUE_KEYS[kind]):
        found = f"{' and '.join(given) or 'no value'} for kind {kind}"
        where = f"{key}.{given[-1] if given else 'value'}"
        raise ParameterError(where, f"found {found}, give either value or {VALUE_KEYS[kind]}")
    value = table[given[0]]
    number = spice_number(value) if isinstance(value, str) else value
    if isinstance(number, bool) or not isinstance(number, int | float | np.integer | np.floating):
        suffixes = "" if not isinstance(value, str) else ", with or without a suffix f p n u m k meg g t"
        raise ParameterError(f"{key}.{given[0]}", f"found {value!r}, must be {allowed}{suffixes}")
    if not (math.isfinite(number) and number > 0):
        raise ParameterError(f"{key}.{given[0]}", f"found {value}, must be {allowed}")
    check_range(f"{key}.{given[0]}", float(number), inverted=True)
    return float(number)


class _Parts:
    """Connected parts of a circuit (union-find)."""

    def __init__(self) -> None:
        self._parent: dict[int, int] = {}

    def of(self, node: int) -> int:
        while (parent := self._parent.get(node, node)) != node:
            node = parent
        return node

    def join(self, nodes: tuple[int, int]) -> bool:
        """Join the parts of two nodes; False if they were one already."""
        first, second = self.of(nodes[0]), self.of(nodes[1])
        self._parent[first] = second
        return first != second


def _check_circuit(keyed: list[tuple[str, Element]]) -> None:
    """Raise `ParameterError` for an unconnected port, a floating part or a duplicate name."""
    used = {node for _, element in keyed for node in element.nodes}
    for node in (1, 0):
        if node not in used:
            raise ParameterError("netlist", f"no element is connected to node {node}, but the port is at nodes 1 and 0")
    names: set[str] = set()
    parts = _Parts()
    parts.join((1, 0))
    for key, element in keyed:
        # SPICE ignores case, and the network may be exported.
        if element.name.lower() in names:
            raise ParameterError(f"{key}.name", f"found {element.name} a second time, each name may be used once")
        names.add(element.name.lower())
        parts.join(element.nodes)
    for key, element in keyed:
        if parts.of(element.nodes[0]) != parts.of(0):
            raise ParameterError(f"{key}.nodes", f"{element.name} is not connected to node 1 or 0, even through others")


class NormalTree(NamedTuple):
    """Topology of a network whose port is a branch of imposed voltage.

    Attributes
    ----------
    tree : tuple of Element
        Tree branches except the port, which precedes them: as many capacitors as possible, then resistors, then
        as few inductors as possible.
    links : tuple of Element
        All other elements.
    cut : (1 + len(tree), len(links)) array of -1, 0, 1
        F with i_tree = -F i_links and v_links = F^T v_tree; the port is row 0.
    """

    tree: tuple[Element, ...]
    links: tuple[Element, ...]
    cut: np.ndarray


def normal_tree(elements: Iterable[Element]) -> NormalTree:
    """Find a normal tree of a connected network and its fundamental cutsets."""
    ordered = sorted(elements, key=lambda element: "VCRLI".index(element.kind))
    parts = _Parts()
    parts.join((1, 0))
    chosen = [parts.join(element.nodes) for element in ordered]
    tree = tuple(e for e, inside in zip(ordered, chosen, strict=True) if inside)
    links = tuple(e for e, inside in zip(ordered, chosen, strict=True) if not inside)
    nodes = sorted({node for e in ordered for node in e.nodes if node} | {1})
    incidence = np.zeros((len(nodes), 1 + len(ordered)))
    for column, (plus, minus) in enumerate([(1, 0), *(e.nodes for e in (*tree, *links))]):
        for node, sign in ((plus, 1.0), (minus, -1.0)):
            if node:
                incidence[nodes.index(node), column] += sign
    cut = np.linalg.solve(incidence[:, : 1 + len(tree)], incidence[:, 1 + len(tree) :])
    return NormalTree(tree, links, np.round(cut))
