"""Netlists of ngspice and LTspice: lines, parameters, models and subcircuits to a flat list of parts.

What is read is what the two programs have in common of passive and switched circuits; the rest is refused by element
and line, since a circuit of which a part is left out is another circuit.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import NamedTuple

from piezoharvest.counting import counted
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.spice_language.expressions import value_of

KINDS = "RLCKDSVIX"
# Commands of an analysis, which are none of the circuit; ".lib" and ".include" name files with models, which are missed
# where one is used.
_IGNORED = (
    "tran", "ac", "dc", "op", "tf", "noise", "four", "meas", "measure", "save", "probe", "plot", "print", "options",
    "option", "ic", "nodeset", "temp", "end", "backanno", "title", "lib", "include", "inc", "width", "step",
)  # fmt: skip
# Properties of LTspice's parts that do not change the circuit.
_LABELS = {"ic", "mfg", "type", "pn", "irms", "ipk", "vpk", "iave", "tol", "pwr", "temp", "tc", "tc1", "tc2", "m"}
MOST_LINES, MOST_PARTS, DEPTH = 2000, 60, 8


class Part(NamedTuple):
    """An element between nodes, of which the model is resolved.

    Attributes
    ----------
    name, kind : str
    nodes : tuple of str
        Two; of a switch also those of its control; none of a coupling.
    value : float
        SI; 0 of a diode and a switch.
    line : int
        Where it stands, from 1.
    of : tuple of str
        Inductors that a coupling couples.
    model : mapping of str to float
        Parameters of a diode or a switch.
    """

    name: str
    kind: str
    nodes: tuple[str, ...]
    value: float
    line: int
    of: tuple[str, ...] = ()
    model: Mapping[str, float] = {}


class _Model(NamedTuple):
    kind: str
    values: dict[str, str]
    line: int


@dataclass
class _Body:
    """Lines of a circuit or subcircuit, with its models and subcircuits."""

    pins: tuple[str, ...] = ()
    defaults: dict[str, str] = field(default_factory=dict)
    elements: list[tuple[int, list[str]]] = field(default_factory=list)
    parameters: list[tuple[int, str, str]] = field(default_factory=list)
    models: dict[str, _Model] = field(default_factory=dict)
    inner: dict[str, _Body] = field(default_factory=dict)


def refusal(line: int, what: str) -> ParameterError:
    """Error about a line of a netlist."""
    return ParameterError("netlist", f"line {line}: {what}")


def read_parts(text: str, subcircuit: str | None = None) -> tuple[list[Part], tuple[str, ...]]:
    """Parts of a netlist, its subcircuits replaced by what they hold, and the pins of the one that was asked for.

    Raises
    ------
    ParameterError
        A line is not understood, or is no part of a piecewise linear circuit; the message has the line.
    """
    top = _body(text)
    if subcircuit is None:
        return _few(_parts(top, [top], {}, "", {}, 0)), ()
    found = {name.lower(): body for name, body in top.inner.items()}.get(subcircuit.lower())
    if found is None:
        known = ", ".join(top.inner) or "none"
        raise ParameterError("subcircuit", f"found {subcircuit!r}, the netlist has {known}")
    outer = _parameters(top, {})
    try:
        own = {key: value_of(text, outer) for key, text in found.defaults.items()}
    except ValueError as error:
        raise ParameterError("subcircuit", f"{subcircuit}: {error}") from None
    return _few(_parts(found, [top, found], {**outer, **own}, "", {}, 0)), found.pins


def _few(parts: Iterator[Part]) -> list[Part]:
    """Parts, counted as they come: subcircuits of subcircuits soon make millions."""
    found = list(islice(parts, MOST_PARTS + 1))
    if len(found) > MOST_PARTS:
        raise ParameterError("netlist", f"found more than {MOST_PARTS} elements, the largest number allowed")
    return found


def _logical_lines(text: str) -> Iterator[tuple[int, str]]:
    """Lines without comments, continued ones joined, with their numbers."""
    pending: tuple[int, str] | None = None
    lines = text.splitlines()
    if len(lines) > MOST_LINES:
        raise ParameterError("netlist", f"found {len(lines)} lines, allowed are up to {MOST_LINES}")
    inside = False
    for n, raw in enumerate(lines, 1):
        line = re.split(r";|\s\$\s", raw, maxsplit=1)[0].strip().replace("§", "").replace("\u00a7", "")
        inside = (inside or line.lower().startswith(".control")) and not line.lower().startswith(".endc")
        if not line or line.startswith("*") or inside or line.lower().startswith(".endc"):
            continue
        if line.startswith("+") and pending is not None:
            pending = pending[0], f"{pending[1]} {line[1:].strip()}"
            continue
        if pending is not None:
            yield pending
        pending = n, line
    if pending is not None:
        yield pending


def _words(line: str) -> list[str]:
    """Words, expressions in braces or quotes whole, "a = b" and "F(a b)" without blanks around their signs."""
    line = re.sub(r"\s*=\s*", "=", line)
    return re.findall(r"(?:[^\s{'(),]|\{[^}]*\}|'[^']*')+", line)


def _body(text: str) -> _Body:
    """Circuit of a netlist with its subcircuits."""
    stack, names = [_Body()], []
    for n, line in _logical_lines(text):
        words = _words(line)
        if not words:
            raise refusal(n, f"found {line!r}, which is neither an element nor a command")
        head = words[0].lower()
        if head == ".subckt":
            if len(words) < 3:
                raise refusal(n, f"found {line!r}, must read .subckt NAME PIN PIN ...")
            bare = [word for word in words[2:] if "=" not in word and word.lower() != "params:"]
            given = dict(word.lower().split("=", 1) for word in words[2:] if "=" in word)
            stack.append(_Body(tuple(pin.lower() for pin in bare), given))
            names.append(words[1].lower())
        elif head == ".ends":
            if len(stack) == 1:
                raise refusal(n, "found .ends, but no .subckt before it")
            done = stack.pop()
            stack[-1].inner[names.pop()] = done
        elif head.startswith("."):
            _command(stack[-1], n, words)
        else:
            _element_line(stack[-1], n, line, words, first=n == 1)
    if len(stack) > 1:
        raise ParameterError("netlist", f"the subcircuit {names[-1]} has no .ends")
    return stack[0]


def _element_line(body: _Body, n: int, line: str, words: list[str], first: bool) -> None:
    """Keep an element; the first line of a netlist is its title, unless it could be either."""
    if first:
        if words[0][0].upper() in KINDS and len(words) >= 4:
            raise refusal(1, f"found {line!r}: the first line is a title, begin with one such as '* my circuit'")
        return
    body.elements.append((n, words))


def _command(body: _Body, n: int, words: list[str]) -> None:
    """Keep a .param or .model line; pass over analyses."""
    head = words[0].lower()[1:]
    if head in ("param", "params"):
        for word in words[1:]:
            name, sign, value = word.partition("=")
            if not sign or not value:
                raise refusal(n, f"found {word!r}, must read NAME=VALUE, as in .param NAME=VALUE")
            body.parameters.append((n, name.lower(), value))
    elif head == "model":
        if len(words) < 3:
            raise refusal(n, f"found {' '.join(words)!r}, must read .model NAME D(...) or .model NAME SW(...)")
        values = {key.lower(): value for key, _, value in (word.partition("=") for word in words[3:])}
        body.models[words[1].lower()] = _Model(words[2].lower(), values, n)
    elif head not in _IGNORED:
        raise refusal(n, f"found .{head}, allowed are .param, .model, .subckt and commands of an analysis")


def _parameters(body: _Body, outer: Mapping[str, float]) -> dict[str, float]:
    """Values of the parameters of a body, those about it included; they may stand in any order."""
    known, waiting = dict(outer), list(body.parameters)
    while waiting:
        failed: list[tuple[int, str, str]] = []
        for n, name, text in waiting:
            try:
                known[name] = value_of(text if text[:1] in "{'" else f"{{{text}}}", known)
            except ValueError as error:
                failed.append((n, name, f"{text}\0{error}"))
        if len(failed) == len(waiting):
            raise refusal(failed[0][0], f"{failed[0][1]}: {failed[0][2].partition(chr(0))[2]}")
        waiting = [(n, name, text.partition("\0")[0]) for n, name, text in failed]
    return known


def _parts(
    body: _Body, scopes: Sequence[_Body], outer: Mapping[str, float], prefix: str, nodes: Mapping[str, str], depth: int
) -> Iterator[Part]:
    """Parts of a body within its scopes, names and inner nodes with a prefix."""
    known = _parameters(body, outer)
    for n, words in body.elements:
        kind = words[0][0].upper()
        name = prefix + words[0]
        if kind not in KINDS:
            raise refusal(n, f"{name}: found an element of kind {kind}, allowed are {', '.join(KINDS)}")
        try:
            if kind == "X":
                yield from _instance(words, n, scopes, known, prefix, nodes, depth)
            else:
                yield from _part(words, n, scopes, known, prefix, nodes)
        except ValueError as error:
            if isinstance(error, ParameterError):
                raise
            raise refusal(n, f"{name}: {error}") from None


def _node(word: str, prefix: str, nodes: Mapping[str, str]) -> str:
    """Node of the flat circuit."""
    word = word.lower()
    return "0" if word in ("0", "gnd") else nodes.get(word, prefix + word)


def _instance(words, n, scopes, known, prefix, nodes, depth) -> Iterator[Part]:
    """Parts of a subcircuit where it is used."""
    bare = [word for word in words[1:] if "=" not in word and word.lower() != "params:"]
    given = dict(word.lower().split("=", 1) for word in words[1:] if "=" in word)
    called = bare[-1].lower() if bare else ""
    body = next((scope.inner[called] for scope in reversed(scopes) if called in scope.inner), None)
    if body is None:
        raise ValueError(f"found subcircuit {called!r}, which the netlist does not have")
    if depth == DEPTH:
        raise ValueError(f"subcircuits nested more than {DEPTH} deep")
    if len(bare) - 1 != len(body.pins):
        raise ValueError(f"found {counted(len(bare) - 1, 'node')}, {called} has {counted(len(body.pins), 'pin')}")
    inner = {key: value_of(text, known) for key, text in {**body.defaults, **given}.items()}
    own = f"{prefix}{words[0]}."
    joined = {pin: _node(word, prefix, nodes) for pin, word in zip(body.pins, bare[:-1], strict=True)}
    yield from _parts(body, [*scopes, body], {**known, **inner}, own, joined, depth + 1)


def _part(words, n, scopes, known, prefix, nodes) -> Iterator[Part]:
    """One element, with the resistance that LTspice may give it in series."""
    kind, name = words[0][0].upper(), prefix + words[0]
    options = {key.lower(): value for key, sign, value in (word.partition("=") for word in words[1:]) if sign}
    bare = [word for word in words[1:] if "=" not in word]
    count = {"K": 0, "S": 4}.get(kind, 2)
    ends = tuple(_node(word, prefix, nodes) for word in bare[:count])
    rest = bare[count:]
    if kind == "K":
        if len(bare) < 3:
            raise ValueError("found too few words, must read as K1 L1 L2 0.99")
        yield Part(name, kind, (), value_of(bare[-1], known), n, tuple((prefix + word).lower() for word in bare[:-1]))
        return
    if len(ends) < count or not rest:
        raise ValueError(f"found {' '.join(words)!r}, which has too few words")
    if kind in "DS":
        yield Part(name, kind, ends, 0.0, n, (), _resolved(rest[0], kind, scopes, known))
        return
    if kind in "VI":
        yield Part(name, kind, ends, _constant(rest, known), n)
        return
    if len(rest) > 1:
        raise ValueError(f"found {' '.join(rest)!r}, only one value may stand here")
    series = value_of(options.pop("rser"), known) if "rser" in options else 0.0
    strange = sorted(options.keys() - _LABELS)
    if strange:
        raise ValueError(f"found {strange[0]}, allowed are Rser and IC")
    if series:
        yield Part(f"{name}_rser", "R", (f"{name.lower()}_inner", ends[1]), series, n)
        ends = (ends[0], f"{name.lower()}_inner")
    yield Part(name, kind, ends, value_of(rest[0], known), n)


def _constant(rest: list[str], known: Mapping[str, float]) -> float:
    """Value of a source, which has to be constant."""
    words = [word for word in rest if word.lower() != "dc"]
    if len(words) > 1 and words[1].lower() == "ac":
        words = words[:1]
    if len(words) != 1 or words[0].lower() in ("ac", "sin", "sine", "pulse", "pwl", "exp", "sffm", "am"):
        raise ValueError(f"found {' '.join(rest)!r}, must be a constant: the excitation comes from the study")
    return value_of(words[0], known)


# What a model must have to be piecewise linear, with defaults of LTspice, and the word for it.
_MODELS = {
    "D": ("d", {"ron": 1.0, "roff": 1e12, "vfwd": 0.0}, "LTspice's piecewise linear diode D(Ron=1 Roff=1g Vfwd=0.4)"),
    "S": ("sw", {"ron": 1.0, "roff": 1e12, "vt": 0.0, "vh": 0.0}, "SW(Ron=1 Roff=1g Vt=2 Vh=0.5)"),
}


def _resolved(called: str, kind: str, scopes: Sequence[_Body], known: Mapping[str, float]) -> dict[str, float]:
    """Parameters of the model of a diode or a switch."""
    model = next((scope.models[called.lower()] for scope in reversed(scopes) if called.lower() in scope.models), None)
    wanted, defaults, example = _MODELS[kind]
    if model is None:
        raise ValueError(f"found model {called!r}, which the netlist does not have: give one such as {example}")
    if model.kind != wanted:
        found = f"found model {called} of kind {model.kind!r} (line {model.line})"
        raise ValueError(f"{found}, must be one such as {example}")
    values = dict(defaults)
    for key, text in model.values.items():
        if key in ("epsilon", "revepsilon") and value_of(text, known) == 0:
            continue
        if key not in defaults:
            if key in _LABELS:
                continue
            found = f"found the parameter {key.upper()} in the model {called} (line {model.line})"
            raise ValueError(f"{found}, which is not piecewise linear; must be one such as {example}")
        values[key] = value_of(text, known)
    if kind == "D" and not model.values.keys() & {"ron", "roff", "vfwd"}:
        found = f"found model {called} (line {model.line}), whose law is exponential"
        line = "piezoharvest.exponential_diode(Is, N, Rs, peak_current) gives the line for a current"
        raise ValueError(f"{found}, must be one such as {example}; {line}")
    for key in ("ron", "roff"):
        if not values[key] > 0:
            raise ValueError(f"found {key}={values[key]:g} in the model {called}, must be greater than 0")
    if values["roff"] <= values["ron"]:
        least = f"must be greater than Ron={values['ron']:g}"
        raise ValueError(f"found Roff={values['roff']:g} in the model {called}, {least}")
    if values.get("vh", 0.0) < 0:
        raise ValueError(
            f"found vh={values['vh']:g} in the model {called}, must be at least 0: a negative one gives a smooth "
            "transition"
        )
    return values
