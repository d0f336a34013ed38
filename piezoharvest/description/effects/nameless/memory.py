"""Memories that a law at a place may have: its function is then of what a memory makes of the input, or follows late.

Each says which sign its factor has at a port that takes energy and gives none, and accounts for that energy. A port is
told by how power follows from a law f of its input: `RATE` f x' (a force over a displacement), `CHARGE` x f' (a charge
over a voltage), `DIRECT` x f (a current over a voltage or the reverse, a force over a velocity).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from piezoharvest.description.circuit import Product, Row
from piezoharvest.description.parameters import Component, ParameterError, quantity
from piezoharvest.description.protocol import EnergyRows, EquationBuilder

RATE, CHARGE, DIRECT = "rate", "charge", "direct"
Function = Callable[[EquationBuilder, Row], Row]
_SLOWNESS = 12.0**0.5  # of a Pade approximation with two poles: its natural angular frequency times the delay
_STORAGE = {"displacement": "stiffness", "voltage": "capacitance", "velocity": "mass"}


@dataclass(frozen=True, kw_only=True)
class Memory(Component):
    """A memory: a row of what it makes of its input, its passive signs, and its energy.

    Subclasses define `kind`, `row`, and where they are of ports `signs` (port to the sign of a passive factor) with
    `stores` and `losses` of a law `factor` times the row, as an effect has them. Of other functions of the row elements
    account for the energy; memories of which such functions are searched for define `made_of` and `dissipated`, too.
    """

    kind: ClassVar[str]
    signs: ClassVar[Mapping[str, int]] = {}
    alone: ClassVar[bool] = False  # True: no function follows, as its strength is its own

    def sign_at(self, port: str) -> int:
        """Sign of a passive factor at a port; 0 where there is none, or where any is allowed."""
        return self.signs.get(port, 0)

    def row(self, specimen: EquationBuilder, x: Row, of: str) -> Row:
        """What the memory makes of the row of an input, which is named `of`."""
        raise NotImplementedError

    def law(self, specimen: EquationBuilder, x: Row, of: str, function: Function) -> Row:
        """The law with a function: of what the memory makes of the input."""
        return function(specimen, self.row(specimen, x, of))

    def made(self, terms: EnergyRows, x: Row) -> Row:
        """The row of what it makes of its input once it is in the equations, where a place needs that for its power."""
        raise NotImplementedError

    def stores(self, port: str, factor: Any, terms: EnergyRows, x: Row) -> Sequence[Product]:
        """Energy in J at a port."""
        return ()

    def losses(self, port: str, factor: Any, terms: EnergyRows, x: Row, dx: Row) -> Sequence[Product]:
        """Power in W that is lost at a port; `x` and `dx` are rows of its input and of the rate of that."""
        return ()

    def made_of(self, x: np.ndarray, step: float) -> np.ndarray:
        """What the memory makes of samples (n,) of an input that are `step` seconds apart, from rest at the first."""
        raise NotImplementedError

    def dissipated(self, port: str, z: np.ndarray, values: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        """What functions of the row z, with these values and slopes (n, functions), lose at a port.

        Up to a factor that is not negative and does not depend on the function; nowhere negative of a passive one.
        """
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class Play(Memory):
    """The stop operator of the input, by which it is ahead of one with play: of a backlash r it is at most r.

    A voltage is no state, of which equations have stops, but a charge is: where that of a capacitor C is w = C v +
    f stop(v; r), its voltage is w/C + g stop(w; (C + f) r), with g = 1/(C + f) - 1/C (inverse of a Prandtl-Ishlinskii
    operator: Kuhnen, Eur. J. Control 9(4), 407-418, 2003).

    With `follows` it is the play operator: what follows the input with play, which a sensor may show. A force of that
    would give energy.

    Source: Visintin, Differential Models of Hysteresis, 1994, chapter III.
    """

    kind: ClassVar[str] = "play"
    signs: ClassVar[Mapping[str, int]] = {RATE: 1, CHARGE: -1}

    threshold: float = quantity("", "half the play, in the input's unit", above=0)
    follows: bool = False

    def row(self, specimen: EquationBuilder, x: Row, of: str) -> Row:
        ahead = specimen.stop(x, self.threshold)
        return x - ahead if self.follows else ahead

    def charge(self, specimen: EquationBuilder, factor: Any) -> Row:
        """Charge of a capacitor beside C v that is `factor` (F) times the stop of its voltage."""
        stiff: Any = specimen.transducer.capacitance + factor
        if not np.all(np.real(stiff) > 0.0):
            found = f"found {np.asarray(np.real(factor), float).min():g} F with a play of the capacitor"
            raise ParameterError("factor", f"{found}, must be above minus its capacitance")
        return factor / stiff * specimen.stop(specimen.q - specimen.strain_charge, stiff * self.threshold)

    def stores(self, port: str, factor: Any, terms: EnergyRows, x: Row) -> Sequence[Product]:
        s, _ = terms.own("stop")
        if port == RATE:
            return [Product(0.5 * factor, s, s)]
        # Of w^2/(2 C) + g s^2/2 what C v^2/2 has not, with v = w/C + g s.
        share = terms.transducer.capacitance * _softer(factor, terms)
        return [Product(0.5 * _softer(factor, terms) * (1.0 + share), s, s), Product(-share, x, s)]

    def losses(self, port: str, factor: Any, terms: EnergyRows, x: Row, dx: Row) -> Sequence[Product]:
        s, ds = terms.own("stop")
        if port == RATE:
            return [Product(factor, s, dx - ds)]
        return [Product(_softer(factor, terms), s, terms.capacitor_current - ds)]

    def made_of(self, x: np.ndarray, step: float) -> np.ndarray:
        found, at = np.empty(len(x)), x[0]
        for n, value in enumerate(x.tolist()):
            at = min(max(at, value - self.threshold), value + self.threshold)
            found[n] = at if self.follows else value - at
        return found

    def dissipated(self, port: str, z: np.ndarray, values: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        """Power is lost at the ends of the play only."""
        at_end = np.abs(z) >= np.abs(z).max()
        return np.where(at_end, z, 0.0)[:, None] * values


def _softer(factor: Any, terms: EnergyRows) -> Any:
    """Voltage per charge that a capacitor with play has more of within the play than beyond it, 1/F."""
    capacitance = terms.transducer.capacitance
    return 1.0 / (capacitance + factor) - 1.0 / capacitance


@dataclass(frozen=True, kw_only=True)
class Relaxation(Memory):
    """A first-order lag y of the input, tau y' + y = x; where `behind`, by how much it is behind: y - x.

    A force that is a function of x - y is that of a spring in series with a damper (Maxwell), stretched by it, whose
    rate y' = (x - y)/tau is linear.

    Source: Fluegge, Viscoelasticity, 1975, chapter 1.
    """

    signs: ClassVar[Mapping[str, int]] = {RATE: -1, CHARGE: 1, DIRECT: 1}

    time_constant: float = quantity("s", "time constant", above=0)
    behind: bool = False

    @property
    def kind(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """`lag` of what a sensor shows, `relaxation` of a port."""
        return "lag" if self.behind else "relaxation"

    def sign_at(self, port: str) -> int:
        """Where power is x f, that by which the lag is behind has the other sign: x (x - y) = (x - y)^2 + y t y'."""
        return -1 if self.behind and port == DIRECT else super().sign_at(port)

    def row(self, specimen: EquationBuilder, x: Row, of: str) -> Row:
        y, dy = specimen.state("lag", _storage(specimen, of))
        specimen.equation(self.time_constant * dy + y - x)
        return y - x if self.behind else y

    def made(self, terms: EnergyRows, x: Row) -> Row:
        y, _ = terms.own("lag")
        return y - x if self.behind else y

    def stores(self, port: str, factor: Any, terms: EnergyRows, x: Row) -> Sequence[Product]:
        y, _ = terms.own("lag")
        if port == RATE and self.behind:
            return [Product(-0.5 * factor, y - x, y - x)]
        if port == RATE:
            return [Product(factor, x, y), Product(-0.5 * factor, y, y)]
        return [Product(0.5 * factor * (1.0 if port == CHARGE else self.time_constant), y, y)]

    def losses(self, port: str, factor: Any, terms: EnergyRows, x: Row, dx: Row) -> Sequence[Product]:
        y, dy = terms.own("lag")
        if port == DIRECT:
            return [Product(factor, y, y)]
        return [Product((-1.0 if port == RATE else 1.0) * factor * self.time_constant, dy, dy)]

    def made_of(self, x: np.ndarray, step: float) -> np.ndarray:
        from scipy.signal import lfilter  # pyright: ignore[reportMissingTypeStubs, reportUnknownVariableType]

        decay = np.exp(-step / self.time_constant)
        y: Any = lfilter([1.0 - decay], [1.0, -decay], x, zi=[decay * x[0]])[0]
        return y - x if self.behind else y

    def dissipated(self, port: str, z: np.ndarray, values: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        if port == CHARGE:
            return slopes
        return (-z if port == RATE else z)[:, None] * values


@dataclass(frozen=True, kw_only=True)
class LaggingFunction(Memory):
    """A first-order lag y of the function itself, tau y' + y = f(x): a polarisation that relaxes towards f(v).

    Of a function that rises, a charge takes energy: with x = g(f), what it stores is the integral of g over y, and
    (x - g(y)) (f - y)/tau is lost, of which both factors have one sign; a force does where it falls.

    Source: Giri & Bai, Block-oriented Nonlinear System Identification, 2010 (Hammerstein systems; functions of a lag
    are Wiener systems).
    """

    kind: ClassVar[str] = "lagging_function"
    signs: ClassVar[Mapping[str, int]] = {RATE: -1, CHARGE: 1}

    time_constant: float = quantity("s", "time constant", above=0)

    def law(self, specimen: EquationBuilder, x: Row, of: str, function: Function) -> Row:
        y, dy = specimen.state("lag", 1.0 / _storage(specimen, of))
        specimen.equation(self.time_constant * dy + y - function(specimen, x))
        return y

    def losses(self, port: str, factor: Any, terms: EnergyRows, x: Row, dx: Row) -> Sequence[Product]:
        """All that it takes: what it stores is that of an element, of which no quadratic form tells."""
        y, dy = terms.own("lag")
        return [Product(1.0, y, dx) if port == RATE else Product(1.0, x, dy if port == CHARGE else y)]

    def made_of(self, x: np.ndarray, step: float) -> np.ndarray:
        return x

    def dissipated(self, port: str, z: np.ndarray, values: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        return -slopes if port == RATE else slopes


@dataclass(frozen=True, kw_only=True)
class Resonance(Memory):
    """A second-order lag y of the input, y''/w^2 + 2 d y'/w + y = x; where `behind`, by how much it is behind: y - x.

    Source: Den Hartog, Mechanical Vibrations, 1956, chapter 2. A current that follows a voltage like this would give
    energy above the resonance, so that there is none.
    """

    kind: ClassVar[str] = "resonance"
    signs: ClassVar[Mapping[str, int]] = {RATE: -1, CHARGE: 1}

    frequency: float = quantity("Hz", "natural frequency", above=0)
    damping_ratio: float = quantity("", "damping ratio d", above=0)
    behind: bool = False

    def row(self, specimen: EquationBuilder, x: Row, of: str) -> Row:
        w, storage = self._w, _storage(specimen, of)
        (y, dy), (z, dz) = specimen.state("resonance", storage), specimen.state("rate", storage)
        specimen.equation(dy - w * z)
        specimen.equation(dz + 2.0 * self.damping_ratio * w * z + w * (y - x))
        return y - x if self.behind else y

    @property
    def _w(self) -> Any:
        return 2.0 * np.pi * self.frequency

    def stores(self, port: str, factor: Any, terms: EnergyRows, x: Row) -> Sequence[Product]:
        (y, _), (z, _) = terms.own("resonance"), terms.own("rate")
        if port == RATE:
            return [Product(factor, x, y), Product(-0.5 * factor, y, y), Product(-0.5 * factor, z, z)]
        return [Product(0.5 * factor, y, y), Product(0.5 * factor, z, z)]

    def losses(self, port: str, factor: Any, terms: EnergyRows, x: Row, dx: Row) -> Sequence[Product]:
        z, _ = terms.own("rate")
        return [Product((-2.0 if port == RATE else 2.0) * factor * self.damping_ratio * self._w, z, z)]


@dataclass(frozen=True, kw_only=True)
class Delay(Memory):
    """A sensor's reading is that of a while ago; no equation has it, as nothing but the reading is late.

    Source: Doebelin, Measurement Systems, 2003, section 3.3.
    """

    kind: ClassVar[str] = "delay"
    alone: ClassVar[bool] = True

    delay: float = quantity("s", "delay", at_least=0, null=0.0)

    def row(self, specimen: EquationBuilder, x: Row, of: str) -> Row:
        return 0.0 * x


@dataclass(frozen=True, kw_only=True)
class LateBy(Memory):
    """By how much an input of a while ago is ahead of it: x(t - d) - x(t), with a Pade approximation.

    With `whole` it is that input itself, which a sensor may show of another channel.

    Of e^(-s d) it has two poles and two zeros, (1 - a + a^2/3)/(1 + a + a^2/3) with a = s d/2: the amplitude is exact,
    and the phase off by (w d)^5/720 rad, a thousandth at w d = 0.9.

    Source: Baker & Graves-Morris, Pade Approximants, 1996, section 1.2.
    """

    kind: ClassVar[str] = "delay"

    delay: float = quantity("s", "delay", above=0)
    whole: bool = False

    def row(self, specimen: EquationBuilder, x: Row, of: str) -> Row:
        # A lag y of second order, y'' d^2/12 + y' d/2 + y = x, of which -d y' is what is sought; z = y' d/sqrt(12).
        w, storage = _SLOWNESS / self.delay, _storage(specimen, of)
        (y, dy), (z, dz) = specimen.state("late", storage), specimen.state("rate", storage)
        specimen.equation(dy - w * z)
        specimen.equation(dz + 0.5 * _SLOWNESS * w * z + w * (y - x))
        return x - _SLOWNESS * z if self.whole else -_SLOWNESS * z

    def made(self, terms: EnergyRows, x: Row) -> Row:
        ahead = -_SLOWNESS * terms.own("rate")[0]
        return x + ahead if self.whole else ahead

    def made_of(self, x: np.ndarray, step: float) -> np.ndarray:
        at = np.arange(len(x)) * step
        ago = np.interp(at - self.delay, at, x)
        return ago if self.whole else ago - x


def _storage(specimen: EquationBuilder, of: str) -> Any:
    """Energy of half a square of an input, for the scale of a state that follows it."""
    device, kind = specimen.transducer, _STORAGE.get(of)
    if kind == "capacitance":
        return device.capacitance
    return 1.0 if kind is None else device.stiffness if kind == "stiffness" else device.mass
