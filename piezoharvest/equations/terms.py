"""Terms of effects in the transducer's equations: collected by their `act`, placed into the rows of a view.

An effect acts on `Terms` as it acts on the specimen of a predicted record. Rows have one column for each name here;
`rows.Placing` maps them to the columns of the engine or of the linear view.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.description.circuit import Product, Row, State, Switch
from piezoharvest.description.effects.base import Effect
from piezoharvest.description.effects.nameless.curves import CODES, CURVES, PARITIES, SLOPES_AT_REST
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.transducer import Transducer
from piezoharvest.equations.laws import strain_charge
from piezoharvest.equations.pieces import Pieces, broken_line

MAX_COLUMNS = 128  # columns at most
UNITS = np.eye(MAX_COLUMNS)
PRODUCT, TIMED, PIECEWISE = 0, 1, -1
CURVE = -2  # and below: of codes of curves
Rows = Mapping[str, Row]


def state_names(transducer: Transducer, charged: Sequence[int] = ()) -> list[str]:
    """Names of the transducer's own states: x1, u1, ... in m and m/s, q in C, and q1, ... of further electrodes."""
    moving = [f"{s}{n}" for n in range(1, len(transducer.all_modes) + 1) for s in "xu"]
    return [*moving, "q", *(f"q{number}" for number in charged if number)]


class StopElement(NamedTuple):
    """Stop operator that an effect adds: its name, its input over the states, and the limit of both."""

    name: str
    row: Row
    threshold: float


class SmoothElement(NamedTuple):
    """Element that an effect adds: a function of its first input, or a product of its inputs.

    Attributes
    ----------
    name : str
    first, second : Row
    power : int
        From 2 on the power; `PRODUCT` of both inputs; `TIMED`, time as fraction of the record times the single input;
        `PIECEWISE` has `pieces`; from `CURVE` downwards those of curves, by their codes.
    pieces : Pieces or None
    """

    name: str
    first: Row
    second: Row
    power: int
    pieces: Pieces | None = None

    def at_start(self, first: Any, second: Any, design: int = 0) -> Any:
        """Output for these inputs at time zero, in one design of a batch."""
        if self.power == TIMED:
            return 0.0 * first
        if self.pieces is not None:
            return self.pieces.value(first, design)
        if self.power <= CURVE:
            return tuple(CURVES.values())[CURVE - self.power](first)
        return first * second if self.power == PRODUCT else first**self.power

    @property
    def parity(self) -> int:
        """-1 if the output changes sign with the inputs, 1 if it does not, 0 of neither."""
        if self.pieces is not None:
            return self.pieces.parity
        if self.power <= CURVE:
            return PARITIES[CURVE - self.power]
        return -1 if self.power % 2 else 1


class Terms:
    """Terms of all effects of a transducer, except those at their null value.

    Parameters
    ----------
    transducer : Transducer
    drive : "force" or "base_acceleration"
    linearised : bool
        For small motions about rest, in which powers and products have no influence.
    record : float, optional
        Length of the run in s, for effects that change during a record; without it no time passes.
    size : (float, float), optional
        Amplitude and frequency of the drive, for effects that depend on these.
    absent : bool
        Effects at their null value act, too: they have states, though no influence.
    loaded : bool
        False behind open electrodes, which have no load that could conduct.

    Attributes
    ----------
    one, time, elapsed, drive, drive_rate, x, u, q, v_t, v, i, strain_charge : Row
        As in `predict.record_model.RecordModel`.
    states : list of State
        States of effects.
    stops : list of StopElement
    elements : list of SmoothElement
        Elements that act on the specimen.
    pushes : list of Row
        Additional force on each mode, N.
    charges, drawn : Row
        Charge beside C v_t and sum T_i x_i (C), current that leaves the node beside the load (A).
    equations : list of Row
    stored : list of Product
        Energy beside that of the lumped model, J.
    losses : list of (str, Product)
        Power that effects dissipate, W, with their names; energy stored by a smooth element is included.
    unfelt : tuple of str
        Effects without influence here: they act on sensor readings, or change during a record.

    Raises
    ------
    ParameterError
        An effect takes a power that is no whole number, or time by itself.
    """

    reads = False
    further: Mapping[str, Row] = MappingProxyType({})

    def __init__(
        self, transducer: Transducer, drive: str = "force", *, linearised: bool = False, record: float | None = None,
        size: Any = None, absent: bool = False, loaded: bool = True,
    ) -> None:  # fmt: skip
        self.transducer, self.drive_name, self.size = transducer, drive, size
        self._linearised, self._passes, self._absent, self._loaded = linearised, record is not None, absent, loaded
        self.columns: dict[str, int] = {}
        self.states: list[State] = []
        self.stops: list[StopElement] = []
        self.elements: list[SmoothElement] = []
        self.equations: list[Row] = []
        self._effect, self._prefix, self._felt = "", "", 0
        self.nothing = np.zeros(MAX_COLUMNS)
        own = state_names(transducer)
        rows = {name: self._column(name) for name in ("one", "drive", "v_h", "v_t", "i", *own)}
        self.one, self.drive, self.v_t, self.i, self.q = (rows[name] for name in ("one", "drive", "v_t", "i", "q"))
        self.v, self.x, self.u = rows["v_t"] + rows["v_h"], rows["x1"], rows["u1"]
        moved = [rows[f"x{n}"] for n in range(1, len(transducer.all_modes) + 1)]
        self.strain_charge = strain_charge(transducer.all_modes, moved, self.nothing)
        self.time, self.drive_rate = self._column("time"), self.nothing
        self.elapsed = (record or 0.0) * self.time
        self.pushes, self.charges, self.drawn = [self.nothing] * len(transducer.all_modes), self.nothing, self.nothing
        self.stored: list[Product] = []
        self.losses: list[tuple[str, Product]] = []
        self.unfelt = tuple(effect.name for n, effect in enumerate(transducer.effects, 1) if not self._take(effect, n))
        self.elements = self._that_act()

    def _take(self, effect: Effect, n: int) -> bool:
        """Let an effect act; return True if it acts on the specimen."""
        word = re.sub(r"\W", "_", effect.name)  # blanks and points are for no node of a netlist
        self._effect, self._prefix, self._felt = effect.name, f"effect{n}_{word}_", 0
        if effect.absent and not self._absent:
            return True
        effect.act(self)
        if not effect.absent:  # at its null value its energy may be one over zero, and is that of nothing
            self.stored += effect.stores(self)
            self.losses += [(effect.name, product) for product in effect.losses(self)]
        return self._felt > 0 or effect.changes_circuit

    # Methods used by effects.

    def state(self, name: str, storage: complex) -> tuple[Row, Row]:
        """Add a state whose energy is about storage z^2/2: rows of it and of its rate; an equation has to follow."""
        self.states.append(State(self._prefix + name, np.abs(storage)))
        return self._column(self._prefix + name), self._column(self._prefix + name + "'")

    def equation(self, residual: Row) -> None:
        """Add an equation: a row that is zero."""
        self.equations.append(self._checked(residual))

    def stop(self, row: Row, threshold: float) -> Row:
        """Stop operator of a state, started from zero; its rows are `own("stop")`."""
        self.stops.append(StopElement(self._prefix + "stop", self._checked(row), threshold))
        self._column(self._prefix + "stop'")
        return self._column(self._prefix + "stop")

    def own(self, name: str) -> tuple[Row, Row]:
        """Rows of a state or stop of the effect that acts, and of its rate."""
        z, dz = (UNITS[self.columns[self._prefix + name + rate]] for rate in ("", "'"))
        return z, dz

    @property
    def capacitor_current(self) -> Row:
        """Rate of q - sum T_i x_i, A."""
        moving = [UNITS[self.columns[f"u{n}"]] for n in range(1, len(self.transducer.all_modes) + 1)]
        rate = UNITS[self.columns["q'"]] if "q'" in self.columns else self._column("q'")
        return rate - strain_charge(self.transducer.all_modes, moving, self.nothing)

    def product(self, first: Row, second: Row) -> Row:
        """Product of two rows; the first of them may have time in it."""
        share = first[..., self.columns["time"], None]
        if not np.any(share):
            return self._element(first, second, PRODUCT)
        timed = share * self._element(second, second, TIMED) if self._passes else self.nothing
        rest = first - share * self.time
        return timed + self._element(rest, second, PRODUCT) if np.any(rest) else timed

    def power(self, row: Row, exponent: float, *, positive: bool = False) -> Row:
        """Power of a row; with `positive` that of its positive part."""
        whole = not positive and float(exponent).is_integer() and exponent >= 2
        return self._element(row, row, int(exponent)) if whole else self._unknown

    def hinges(self, row: Row, corners: Sequence[tuple[float, Any, Any]], order: int = 1) -> Row:
        """Sum of c max(s (x - k), 0)^order / order of a row x over corners (s, k, c), one element.

        At their null value each has an element of its own, of which the derivative is a multiple. Of time by itself it
        is unknown, but where no time passes.
        """
        if np.any(row[..., self.columns["time"]]):
            return self._unknown if self._passes else self.nothing
        if self._linearised:
            return broken_line(corners, order).slope_at_rest * row
        if any(np.any(np.real(kink)) for _, _, kink in corners):
            return self._element(row, row, PIECEWISE, broken_line(corners, order))
        alone = ((kink, broken_line([(side, knot, 1.0)], order)) for side, knot, kink in corners)
        return sum((kink * self._element(row, row, PIECEWISE, each) for kink, each in alone), self.nothing)

    def curve(self, name: str, row: Row) -> Row:
        """Curve of a row, by its name; of time by itself it is unknown, but where no time passes."""
        if np.any(row[..., self.columns["time"]]):
            return self._unknown if self._passes else self.nothing
        if self._linearised:
            return SLOPES_AT_REST[CODES[name]] * row
        return self._element(row, row, CURVE - CODES[name])

    def charge(self, row: Row) -> None:
        """Add a charge on the electrodes beside C v_t and sum T_i x_i, C."""
        self.charges = self.charges + self._checked(row)
        smooth = self._smooth(row, "'")
        if np.any(smooth):
            self.losses.append((self._effect, Product(1.0, self.v_t, smooth)))

    def draw(self, row: Row) -> None:
        """Add a current that leaves the node beside the load, A."""
        self.drawn = self.drawn + self._checked(row)
        smooth = self._smooth(row)
        if np.any(smooth):
            self.losses.append((self._effect, Product(1.0, self.v, smooth)))

    def push(self, row: Row, mode: int = 0) -> None:
        """Add a force on a mode, N."""
        self.pushes[mode] = self.pushes[mode] + self._checked(row)
        smooth = self._smooth(row)
        if np.any(smooth):
            self.losses.append((self._effect, Product(-1.0, smooth, UNITS[self.columns[f"u{mode + 1}"]])))

    def conduct(self, row: Row) -> None:
        """Add a current that leaves the node through the load, A; behind open electrodes there is none."""
        if self._loaded:
            self.draw(row)

    def read(self, row: Row, channel: str = "displacement") -> None:
        """Ignore what a sensor reads besides, which does not act on the specimen."""

    def lag(self, time_constant: complex) -> None:
        """Ignore a sensor's lag, which does not act on the specimen."""

    # Internal methods.

    def _column(self, name: str) -> Row:
        if len(self.columns) == MAX_COLUMNS:
            raise ParameterError("transducer", f"found more than {MAX_COLUMNS} equations, use fewer modes or effects")
        self.columns[name] = len(self.columns)
        return UNITS[self.columns[name]]

    @property
    def _unknown(self) -> Row:
        """Placeholder for a row that is not available: zero for small motions, else NaN."""
        return np.zeros(MAX_COLUMNS) if self._linearised else np.full(MAX_COLUMNS, np.nan)

    def _element(self, first: Row, second: Row, power: int, pieces: Pieces | None = None) -> Row:
        """Column of an element's output; that of its rate stands behind it."""
        if self._linearised:
            return self.nothing
        if np.any(np.isnan(first)) or np.any(np.isnan(second)):
            raise self._unavailable()
        for known in self.elements if pieces is None else ():
            if known.power == power and np.array_equal(known.first, first) and np.array_equal(known.second, second):
                return UNITS[self.columns[known.name]]
        name = f"smooth{len(self.elements) + 1}"
        column = self._column(name)
        self._column(name + "'")
        self.elements.append(SmoothElement(name, first, second, power, pieces))
        return column

    def _that_act(self) -> list[SmoothElement]:
        """Elements whose output has an influence, directly or through another one."""
        rows, found = [*self.pushes, self.charges, self.drawn, *self.equations], []
        for element in reversed(self.elements):
            if any(np.any(row[..., self.columns[element.name]]) for row in rows):
                rows += [element.first, element.second]
                found.insert(0, element)
        return found

    def _smooth(self, row: Row, rate: str = "") -> Row:
        """Part of a row from smooth elements, or its rate."""
        parts = ((e, row[..., self.columns[e.name], None]) for e in self.elements)
        return sum((share * UNITS[self.columns[e.name + rate]] for e, share in parts), self.nothing)

    def _checked(self, row: Row) -> Row:
        self._felt += bool(np.any(row))
        if np.any(np.isnan(row)) or np.any(row[..., self.columns["time"]]):
            raise self._unavailable()
        return row

    def _unavailable(self) -> ParameterError:
        """Error for a row that the engine does not have."""
        found = "found time by itself, or a power that is not a whole number"
        allowed = "allowed are sums, products and whole powers of what moves, and time as a factor of these"
        return ParameterError(f"transducer.effects.{self._effect}", f"{found}, {allowed}")

    def check(self, shunt: Shunt, switch: Switch | None) -> None:
        """Raise an error if the switch extracts charge instantly and the path of smooth elements is then not linear.

        Without charges of elements v, q and i are linear along the path; with them v_t is.

        Raises
        ------
        ParameterError
        """
        charged = np.any(self._smooth(self.charges))
        names = (*(e.name for e in self.elements), *(("v_h", "q", "i") if charged else ()))
        other = [self.columns[name] for name in names]
        bent = any(np.any(row[..., other]) for e in self.elements for row in (e.first, e.second))
        if bent and switch is not None and np.all(np.asarray(switch.on_time) == 0):
            of, allowed = ("q, v, i or another one", "v_t, x and u") if charged else ("another one", "v, q, i, x and u")
            found = f"found a smooth term of {of} beside {shunt.kind}, which draws charge instantly"
            raise ParameterError("transducer.effects", f"{found}, allowed are those of {allowed}")

    def over(self, row: Row, states: Rows, *, stops: bool = False) -> Row:
        """Combination of states and smooth elements as a row, from the rows of these or of their rates.

        With `stops` of these, too, as a charge may be, but no input of another stop.
        """
        used, own = self.used(row), (*self.states, *self.elements, *(self.stops if stops else ()))
        others = used.keys() - {*state_names(self.transducer), *(each.name for each in own)}
        if others:
            found = f"found a charge, or the input of a stop, of {', '.join(sorted(others))}"
            raise ParameterError("transducer.effects", f"{found}, allowed are states")
        return sum((factor * states[name] for name, factor in used.items()), 0.0 * states["q"])

    def used(self, row: Row) -> dict[str, np.ndarray]:
        """Nonzero coefficients of a row, by name, with a trailing axis for the columns of a view."""
        which = np.flatnonzero(row if row.ndim == 1 else row.any(axis=0))
        if not which.size:
            return {}
        names = list(self.columns)
        return {names[k]: row[..., k : k + 1] for k in which}
