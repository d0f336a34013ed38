"""Effects as netlist elements: their terms in the transducer's equations, written as sources."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from piezoharvest.description.circuit import Row
from piezoharvest.description.parameters import ParameterError
from piezoharvest.equations.pieces import Pieces
from piezoharvest.equations.terms import CURVE, PRODUCT, TIMED, SmoothElement
from piezoharvest.spice.deck import Deck, number, total
from piezoharvest.spice.operating_point import OperatingPoint
from piezoharvest.spice.stop import write_stop

ROUNDED = 1e-2  # of the largest corner: range over which one is rounded off, which moves the curve by a part in 1e4
# Curves in the order of their codes. Large arguments that an iteration tries must not overflow.
CURVES = (
    "(exp(min({x},100))-1)", "(0.5*(exp(min({x},100))-exp(min(-{x},100))))", "tanh({x})",
    "({x}/sqrt({x}*{x}+1e-4)*(1/tanh(sqrt({x}*{x}+1e-4))-1/sqrt({x}*{x}+1e-4)))", "(sgn({x})*log(1+abs({x})))",
    "({x}/sqrt({x}*{x}+1))", "exp(-{x}*{x})",
)  # fmt: skip


def write_effects(deck: Deck, point: OperatingPoint) -> None:
    """Write the effects: forces at nodes `push1`, ..., charge on node `t`, current from node `p`, and their states."""
    terms = point.terms
    names = ", ".join(effect.name for effect in point.transducer.effects if effect.name not in terms.unfelt)
    if names:
        deck.section("effects")
        deck.comment(f"{names}: V(push1), ... forces on the modes in N, V(charge) what is on the electrodes beside.")
    for name in terms.unfelt:
        deck.comment(f"{name} is not in this netlist: it is what sensors make of the motion, or goes on over a record.")
    values = _Values(point)
    for state, equation in zip(terms.states, terms.equations, strict=True):
        _write_state(deck, point, values, state.name, equation)
    for stop in terms.stops:
        write_stop(deck, point, stop, total(values.rate(stop.row)))
    for n, push in enumerate(terms.pushes, 1):
        if push.any():
            deck.add(f"Bpush{n} push{n} 0 V=" + total(values.of(push)))
            deck.add(f"Gpush{n} 0 u{n} push{n} 0 1")
    if terms.charges.any():
        _write_charge(deck, point, values)
    if terms.drawn.any():
        deck.add("Bdrawn p 0 I=" + total(values.of(terms.drawn)))


def _write_state(deck: Deck, point: OperatingPoint, values: _Values, name: str, equation: Row) -> None:
    """Node of a state divided by its scale: a capacitor that integrates its rate."""
    row, column = equation.copy(), point.terms.columns[name + "'"]
    share, row[column] = row[column], 0.0
    size = values.sizes[name]
    rate = total((-factor / (share * size * point.omega), what) for factor, what in values.of(row))
    deck.add(f"C{name} {name} 0", 1 / point.omega, f"IC={number(point.initial(name) / size)}")
    deck.add(f"B{name} 0 {name} I={rate}")


def _write_charge(deck: Deck, point: OperatingPoint, values: _Values) -> None:
    """Current into node `t` as the rate of a charge: current of a capacitor at a voltage proportional to the charge."""
    size = point.voltage * point.transducer.capacitance
    charge = total((factor / size, what) for factor, what in values.of(point.terms.charges))
    deck.add("Bcharge charge 0 V=" + charge)
    deck.add("Ccharge charge sense", size, f"IC={number(values.at_start(point.terms.charges) / size)}")
    deck.add("Vsense sense 0 0")
    deck.add("Bsense t 0 I=I(Vsense)")


def _piecewise(pieces: Pieces, x: str) -> str:
    """Expression of a function that is a polynomial in each piece: the first one, and what is added at each corner.

    Corners are rounded off, as the steps of a circuit simulator need it.
    """
    width = ROUNDED * float(np.max(np.abs(pieces.corners), initial=0.0))
    coefficients = np.real(pieces.coefficients).reshape(-1, 3)
    first = coefficients[0]
    terms = [f"{number(first[0])}", f"{number(first[1])}*{x}"] + [f"{number(first[2])}*{x}*{x}"] * bool(first[2])
    for corner, before, after in zip(pieces.corners, coefficients, coefficients[1:], strict=False):
        beyond = f"({x}-({number(corner)}))"
        root = f"sqrt({beyond}*{beyond}+{number(width**2)})" if width else f"abs({beyond})"
        excess = f"(0.5*({beyond}+{root}))"
        slope = after[1] - before[1] + 2.0 * corner * (after[2] - before[2])
        terms += [f"{number(slope)}*{excess}"] * bool(slope)
        terms += [f"{number(after[2] - before[2])}*{excess}*{excess}"] * bool(after[2] - before[2])
    return "(" + "+".join(f"({term})" for term in terms) + ")"


class _Values:
    """Rows of `equations.terms.Terms` as expressions of the netlist.

    Attributes
    ----------
    sizes : dict of str to float
        Value of an added state per volt of its node.
    """

    def __init__(self, point: OperatingPoint) -> None:
        self.point, terms, modes = point, point.terms, point.transducer.all_modes
        energy = point.transducer.capacitance * point.voltage**2
        self.sizes = {state.name: (energy / state.storage) ** 0.5 for state in terms.states}
        self._known: dict[str, tuple[float, str]] = {
            "one": (1.0, "1"), "drive": (1.0, "V(drive)"), "v_t": (1.0, "V(t)"),
            "v_h": (1.0 if point.transducer.hysteresis else 0.0, "V(h,t)"),
        }  # fmt: skip
        for n, mode in enumerate(modes, 1):
            self._known |= {f"x{n}": (1 / mode.stiffness, f"V(f{n})"), f"u{n}": (1.0, f"V(u{n})")}
        if point.resistance is not None:
            self._known["i"] = 1.0 / point.resistance, "V(p)"
        self._known |= {name: (size, f"V({name})") for name, size in self.sizes.items()}
        self._known |= {stop.name: (stop.threshold, f"V({stop.name})") for stop in terms.stops}
        for element in terms.elements:
            self._known[element.name] = 1.0, self._output(element)

    def of(self, row: Row) -> list[tuple[float, str]]:
        """Coefficients and expressions of the terms of a row."""
        return self._sum(row, self._known)

    def rate(self, row: Row) -> list[tuple[float, str]]:
        """Coefficients and expressions of the rate of a row of displacements and the charge."""
        modes = range(1, len(self.point.transducer.all_modes) + 1)
        return self._sum(row, {"q": (1.0, "I(Vport)"), **{f"x{n}": (1.0, f"V(u{n})") for n in modes}})

    def at_start(self, row: Row) -> float:
        """Value of a row in the initial state."""
        rest = self.point.begins
        for element in self.point.terms.elements:
            first, second = (self._numeric(part, rest) for part in (element.first, element.second))
            rest = {**rest, element.name: element.at_start(first, second)}
        return self._numeric(row, rest)

    def _numeric(self, row: Row, values: Mapping[str, float]) -> float:
        return sum(float(factor[0]) * values.get(name, 0.0) for name, factor in self.point.terms.used(row).items())

    def _output(self, element: SmoothElement) -> str:
        first, second = (f"({total(self.of(row))})" for row in (element.first, element.second))
        if element.power == PRODUCT:
            return f"{first}*{second}"
        if element.power == TIMED:
            return f"(time*{number(1 / self.point.length)})*{first}"
        if element.pieces is not None:
            return _piecewise(element.pieces, first)
        if element.power <= CURVE:
            return CURVES[CURVE - element.power].format(x=first)
        return "*".join([first] * element.power)

    def _sum(self, row: Row, known: Mapping[str, tuple[float, str]]) -> list[tuple[float, str]]:
        used = self.point.terms.used(row)
        others = ", ".join(sorted(used.keys() - known.keys()))
        if others:
            found = f"found terms of {others}, which cannot be exported to SPICE"
            raise ParameterError("transducer.effects", f"{found}, allowed are {', '.join(known)}")
        return [(float(factor[0]) * known[name][0], known[name][1]) for name, factor in used.items()]
