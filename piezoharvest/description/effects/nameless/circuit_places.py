"""Places in the circuits behind the electrodes: a voltage over the current of a part, or a current of the dc load."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, TypeGuard, TypeVar

import numpy as np

from piezoharvest.description.circuit import Product
from piezoharvest.description.effects.nameless.forms import Form, Line, numbers_of
from piezoharvest.description.effects.nameless.memory import DIRECT, Memory, Relaxation
from piezoharvest.description.effects.nameless.numbers import Numbers
from piezoharvest.description.effects.nameless.places import Place
from piezoharvest.description.effects.nameless.shapes import Curve
from piezoharvest.description.parameters import ParameterError, quantity
from piezoharvest.description.protocol import EnergyRows, EquationBuilder
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.bridge import Bridge
from piezoharvest.description.shunts.curves.load_curve import LoadCurve
from piezoharvest.description.shunts.curves.loop_sections import LoopSections
from piezoharvest.description.shunts.curves.voltage_curve import VoltageCurve
from piezoharvest.description.shunts.real_coil import WoundSwitch
from piezoharvest.description.shunts.self_powered.breaker import ElectronicBreaker

# Of a broken line in the place of a smooth curve, whose corners are the denser the more it bends.
PIECES = 18
# Of the largest current: below it no corner is, as no record resolves what happens there. Points above it at which a
# curve's bend is looked at.
LEAST_CORNER, STEPS = 1e-6, 240
# Of the largest second derivative, added to all: where a curve has come to its end, that is zero, and its root would
# have no derivative to the curve's scale. Over a thousand scales it is three per cent of the corners.
LEAST_BEND = 1e-9

# A diode without a resistance has another law, and no derivative to one: it gets what drops a millivolt at the largest
# current, less than the noise of most records behind a bridge.
LEAST_DROP = 1e-3
S = TypeVar("S", bound=Shunt)


@dataclass(frozen=True)
class CircuitPlace(Place):
    """A part of the circuits: a law is a further voltage (V) across it, over the size of its current (A).

    Of the load behind a bridge it is a current over a voltage. The circuit accounts for its energy.
    """

    unit: ClassVar[str] = "V"
    bent: ClassVar[bool] = False  # a straight line is a resistance, for which there is no parameter
    port: ClassVar[str] = DIRECT
    in_circuit: ClassVar[bool] = True

    reach: float = quantity("A", "largest current, up to which a smooth law is a broken line", above=0)

    def check(self, form: Form, memory: Memory | None) -> None:
        if memory is not None:
            raise ParameterError("memory", f"found {memory.kind} of the {self.name}, whose law has none")

    def add(self, specimen: EquationBuilder, form: Form) -> None:
        """Add nothing to the specimen."""

    def stores(self, terms: EnergyRows, form: Form, memory: Memory | None) -> Sequence[Product]:
        return ()

    def losses(self, terms: EnergyRows, form: Form, memory: Memory | None) -> Sequence[Product]:
        return ()

    def points(self, form: Form, least: float = 0.0) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """Corners and values of a broken line from zero on; no piece rises less than `least`, which is added to all."""
        corners = _corners(form, self.reach)
        numbers: Any = Numbers()
        values = form.values(corners) if isinstance(form, Curve) else form.row(numbers, corners)
        steps = np.diff(corners, axis=-1)
        slopes = np.diff(values, axis=-1) / steps + least
        slopes = np.where(np.real(slopes) >= least, slopes, least) if least > 0 else slopes
        values = np.cumsum(np.concatenate([0.0 * slopes[..., :1], slopes * steps], axis=-1), axis=-1)
        return tuple(numbers_of(corners)), tuple(numbers_of(values))


@dataclass(frozen=True)
class Diode(CircuitPlace):
    """Every diode of a bridge: voltage beside its drop and resistance, over its forward current."""

    name: ClassVar[str] = "diode"
    input: ClassVar[str] = "diode_current"

    def connect(self, shunt: Shunt, form: Form, memory: Memory | None) -> Shunt:
        if not has_diodes(shunt):
            return shunt
        found = VoltageCurve.stepped(*self.points(form, LEAST_DROP / self.reach))
        return _with(shunt, diode_curve=found if shunt.diode_curve is None else shunt.diode_curve.plus(found))


@dataclass(frozen=True)
class SwitchLoop(CircuitPlace):
    """The loop that a switch closes with its coil: voltage beside its resistance, over the size of its current.

    With a relaxation it is over the current itself: that of a resistance beside a capacitance, or where the memory is
    how far the current is behind, beside an inductance.
    """

    name: ClassVar[str] = "switch_loop"
    input: ClassVar[str] = "loop_current"

    def check(self, form: Form, memory: Memory | None) -> None:
        if memory is None:
            return
        if not isinstance(memory, Relaxation):
            super().check(form, memory)
        if not isinstance(form, Line):
            found = f"found {form.word} with a {memory.kind} of the {self.name}"
            raise ParameterError("form", f"{found}, must be linear: what is in line there are parts of a circuit")

    def connect(self, shunt: Shunt, form: Form, memory: Memory | None) -> Shunt:
        if not has_loop(shunt):
            return shunt
        if isinstance(memory, Relaxation):
            resistance = memory.sign_at(self.port) * form.proportional
            beside = "inductance" if memory.behind else "capacitance"
            more = LoopSections.stepped(resistance, memory.time_constant, beside)
            return _with(shunt, loop_sections=more if shunt.loop_sections is None else shunt.loop_sections.plus(more))
        found = VoltageCurve.stepped(*self.points(form))
        return _with(shunt, switch_curve=found if shunt.switch_curve is None else shunt.switch_curve.plus(found))


@dataclass(frozen=True)
class DcLoad(CircuitPlace):
    """The load behind a bridge: current (A) beside that through its resistance, over its voltage."""

    name: ClassVar[str] = "load"
    input: ClassVar[str] = "dc_voltage"
    unit: ClassVar[str] = "A"

    reach: float = quantity("V", "largest voltage, up to which a smooth law is a broken line", above=0)

    def connect(self, shunt: Shunt, form: Form, memory: Memory | None) -> Shunt:
        if not has_dc_load(shunt):
            return shunt
        found = LoadCurve.stepped(*self.points(form))
        return _with(shunt, load_curve=found if shunt.load_curve is None else shunt.load_curve.plus(found))


def has_dc_load(shunt: Shunt | None) -> TypeGuard[Bridge]:
    """True for a circuit whose load behind a bridge may have a curve."""
    return isinstance(shunt, Bridge) and shunt.load_resistance is not None and shunt.storage is None


def has_diodes(shunt: Shunt | None) -> TypeGuard[Bridge]:
    """True for a circuit whose diodes may have a curve."""
    return isinstance(shunt, Bridge) and shunt.storage is None and not isinstance(shunt, ElectronicBreaker)


def has_loop(shunt: Shunt | None) -> TypeGuard[WoundSwitch]:
    """True for a circuit whose closed switch may have a curve."""
    return isinstance(shunt, WoundSwitch) and shunt.core_resistance is None and shunt.self_resonance is None


def _with(shunt: S, **values: VoltageCurve | LoadCurve | LoopSections) -> S:
    """A circuit with curves or sections, whose numbers may have complex steps and are not checked."""
    found = copy.copy(shunt)
    found.__dict__.update(values)
    return found


def _corners(form: Form, reach: float) -> np.ndarray:
    """Inputs between which a form is straight, from 0 on, with one more beyond the last; a batch where they are."""
    turns = form.turns
    corners: list[Any] = numbers_of(_where_it_bends(form, reach)) if turns is None else [0.0, *turns]
    parts = [np.atleast_1d(each) for each in (*corners, corners[-1] + reach)]
    batch = np.broadcast_shapes(*(part.shape for part in parts))
    return np.concatenate([np.broadcast_to(part, batch) for part in parts], axis=-1)


def _where_it_bends(form: Form, reach: float) -> np.ndarray:
    """Inputs of corners with which a smooth curve is off by as much in each piece, from 0 to the largest one.

    A chord is off by f'' h^2/8 at most, so that corners are as dense as the root of the second derivative (de Boor, A
    Practical Guide to Splines, 2001, chapter III). They move with complex steps of the curve's values.
    """
    grid = reach * np.concatenate([[0.0], np.geomspace(LEAST_CORNER, 1.0, STEPS)])
    second: Any = np.gradient(np.gradient(form.values(grid), grid, axis=-1), grid, axis=-1)
    bend: np.ndarray = np.where(np.real(second) < 0.0, -1.0, 1.0) * second
    most = np.take_along_axis(bend, np.argmax(np.real(bend), axis=-1, keepdims=True), axis=-1)
    dense: np.ndarray = np.sqrt(bend + LEAST_BEND * most)
    parts = 0.5 * (dense[..., 1:] + dense[..., :-1]) * np.diff(grid)
    total = np.concatenate([0.0 * parts[..., :1], np.cumsum(parts, axis=-1)], axis=-1)
    wanted = total[..., -1:] * np.linspace(0.0, 1.0, PIECES + 1)[1:-1]
    nominal, aims = (np.asarray(np.real(each).reshape(-1, each.shape[-1])[0], float) for each in (total, wanted))
    if not nominal[-1] > 0.0:
        return np.linspace(0.0, reach, PIECES + 1)
    k = np.searchsorted(nominal, aims, side="right") - 1
    inner = grid[k] + (wanted - total[..., k]) / parts[..., k] * np.diff(grid)[k]
    ends = np.zeros((*inner.shape[:-1], 1))
    return np.concatenate([ends, inner, ends + reach], axis=-1)
