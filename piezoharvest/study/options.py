"""The tables [design] and [sweep] of a study."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Literal

from piezoharvest.description import shunts
from piezoharvest.description.parameters import Component, ParameterError, described, quantity
from piezoharvest.description.tolerance import Tolerance
from piezoharvest.study.words import unknown

FREE = "free"  # in place of the excitation's frequency: the design finds it

SYNTHESISED = "synthesised"  # candidate that is not a kind of shunt: a network that the design makes

MAX_DESIGNS = 2**30  # of a sweep: the length of a Sobol sequence


@dataclass(frozen=True, kw_only=True)
class DesignOptions(Component):
    """Goal and free choices of a design: the table [design]."""

    objective: Literal["harvest", "damping", "trade_off"] = described(
        "objective: power, damping, or the front between the two", default="harvest"
    )
    band: tuple[float, float] | None = quantity("Hz", "lower and upper limit of the band", default=None, above=0)
    candidates: tuple[str, ...] | None = described(
        'kinds of shunts to compare, and "synthesised" for a network made by the design; default: all that fit the '
        "objective",
        default=None,
    )
    phase_lag: Literal["free", "fixed"] | None = described(
        "lag of switches, tuned or as given; default: free for harvest, else fixed", default=None
    )
    hold: tuple[str, ...] = described("keys of the shunts that are not tuned", default=())
    tune: tuple[Literal["on_time_error", "inductance", "smoothing_capacitance"], ...] = described(
        "further keys of switched shunts that are tuned", default=()
    )
    order: int | None = quantity(
        "", "largest number of coils and capacitors in the synthesised network", default=None, at_least=1, at_most=8
    )
    coil_quality: float | None = quantity(
        "",
        "quality of the synthesised network's coils at the centre of the band; default: no losses",
        default=None,
        above=0,
    )
    parts: Literal["E3", "E6", "E12", "E24", "E48", "E96", "E192"] | None = described(
        "series of preferred values (IEC 60063); default: any value", default=None
    )
    parts_tolerance: float | None = quantity(
        "", "relative tolerance of the parts; default: that of their series", default=None, at_least=0, below=1
    )
    tolerance: Tolerance | None = None
    worst_case: bool = described(
        "whether candidates are tuned for and ranked by the worst case within the tolerance", default=False
    )
    max_voltage: float | None = quantity("V", "largest electrode voltage", default=None, above=0)
    max_inductance: float | None = quantity("H", "largest inductance", default=None, above=0)
    max_displacement: float | None = quantity("m", "largest displacement amplitude", default=None, above=0)
    min_power: float | None = quantity("W", "least harvested power", default=None, at_least=0)
    min_attenuation_db: float | None = quantity(
        "dB", "least attenuation relative to the short circuit", default=None, at_least=-1000, at_most=1000
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.band is not None and not self.band[0] < self.band[1]:
            raise ParameterError("band", f"found {list(self.band)}, must be [lower, upper] with lower < upper (Hz)")
        if self.parts_tolerance is not None and self.parts is None:
            found = f"found {self.parts_tolerance:g} without parts"
            raise ParameterError("parts_tolerance", f"{found}, but needs parts = a series (E3 to E192)")
        if self.worst_case and self.tolerance is None:
            raise ParameterError("worst_case", "found true without a tolerance, it needs a table [design.tolerance]")
        if self.candidates is not None and not self.candidates:
            raise ParameterError("candidates", "found an empty list, at least one kind of shunt is needed")
        for n, kind in enumerate(self.candidates or ()):
            if kind not in (known := (*shunts.registered(), SYNTHESISED)):
                raise unknown(f"candidates.{n}", kind, known)
        keys = {f.name for cls in shunts.registered().values() for f in dataclasses.fields(cls) if f.init}
        for n, key in enumerate(self.hold):
            if key not in keys:
                raise unknown(f"hold.{n}", key, keys)


@dataclass(frozen=True, kw_only=True)
class SweepParameter(Component):
    """A parameter of a sweep: the value at a dotted path, between `from` and `to`."""

    path: str = described('path of a value, such as "shunts.0.load_resistance"')
    from_: float = quantity("", "first value of the parameter")
    to: float = quantity("", "last value of the parameter")
    scale: Literal["linear", "log"] = described("spacing of the values", default="linear")
    count: int | None = quantity("", "number of values in a grid", default=None, at_least=1)

    def __post_init__(self) -> None:
        super().__post_init__()
        for key, value in (("from", self.from_), ("to", self.to)):
            if self.scale == "log" and value <= 0:
                raise ParameterError(key, f"found {value:g} with scale = 'log', must be a number greater than 0")
        if self.from_ == self.to:
            raise ParameterError(
                "to", f"found {self.to:g}, which is the value of from as well, but the two must differ"
            )


@dataclass(frozen=True, kw_only=True)
class SweepOptions(Component):
    """Parameters of a sweep, its sampling method and its outputs: the table [sweep]."""

    parameters: tuple[SweepParameter, ...] = described("parameters that are varied")
    method: Literal["grid", "random", "sobol"] = described(
        "how values are chosen: grid needs `count`, the others `samples`", default="grid"
    )
    samples: int | None = quantity("", "number of designs", default=None, at_least=1, at_most=MAX_DESIGNS)
    seed: int = quantity("", "seed of the random numbers", default=1, at_least=0)
    outputs: tuple[str, ...] | None = described(
        "output columns of the table; default: those that simulate prints", default=None
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.parameters:
            raise ParameterError("parameters", "found an empty list, at least one table [[sweep.parameters]] is needed")
        counts = {f"parameters.{n}.count": parameter.count for n, parameter in enumerate(self.parameters)}
        for key, count in (counts if self.method == "grid" else {"samples": self.samples}).items():
            if count is None:
                raise ParameterError(key, f"missing key, method = {self.method!r} needs a whole number here")
        if self.designs > MAX_DESIGNS:
            raise ParameterError("parameters", f"found {self.designs} designs, allowed are up to {MAX_DESIGNS}")
        if self.outputs == ():
            raise ParameterError("outputs", "found an empty list, at least one output is needed")
        names = {"parameters.{}.path": [p.path for p in self.parameters], "outputs.{}": self.outputs or ()}
        for key, given in names.items():
            for n, name in enumerate(given):
                if name in given[:n]:
                    raise ParameterError(key.format(n), f"found {name!r} a second time, each may be named once")

    @property
    def designs(self) -> int:
        """Number of designs."""
        if self.method == "grid":
            return math.prod(parameter.count or 1 for parameter in self.parameters)
        return self.samples or 0
