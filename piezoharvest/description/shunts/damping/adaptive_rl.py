"""Resonant shunt that tunes itself: its inductance follows the relative phase of coil current and motion."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar, Literal

import numpy as np

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.parameters import ParameterError, check_choice, described, quantity
from piezoharvest.description.shunts.base import Leads, LinearShunt, Shunt
from piezoharvest.description.shunts.linear.parallel_rl import ParallelRL
from piezoharvest.description.shunts.linear.series_rl import SeriesRL

RANGE = 2.0  # largest inductance over that of the beginning, and that over the smallest, where none are given


# A design's rate of adaptation, by the strain current with a shunt as a share of that with open electrodes, and its
# mean; in periods.
ASSUMED_SHARE, ASSUMED_PERIODS, AVERAGED_PERIODS = 0.2, 200.0, 3.0


@dataclass(frozen=True, kw_only=True)
class AdaptiveRL(Shunt):
    """Synthetic inductance that adapts itself to a drifting resonance, in series or parallel with a resistance.

    At the electrical resonance, omega^2 L C = 1, the coil's current i and the strain current sum T_i x_i' are in
    quadrature: the mean p of their product is zero, and its sign tells whether L is too large or too small. With g =
    L_0/L, where L_0 is the `inductance` at the start, and the voltage u across the coil, the circuit solves

        L_0 i' = g u
        averaging_time p' = i sum T_i x_i' - p
        g' = adaptation_rate p

    while L is within its limits. At a limit, L stays there until p changes sign. The multiplier is that of the source,
    its filter is of first order. As p is proportional to the square of the amplitude, so is the speed of adaptation.

    Power drawn by the synthetic coil is counted as negative power of a source. The resistance is the load.

    Raises
    ------
    ParameterError
        The inductance is not within its limits.
    """

    kind: ClassVar[str] = "adaptive_rl"
    source: ClassVar[str] = (
        "relative phase adaptation: Niederberger, Fleming, Moheimani & Morari, Smart Mater. Struct. 13, 1025-1035, 2004"
    )
    mirrors: ClassVar[bool] = False  # g keeps its sign
    unrecorded: ClassVar[str] = "whose inductance no record shows, allowed are circuits without a controller"
    multiplied: ClassVar[tuple[str, ...]] = ("beyond", "phase")

    inductance: float = quantity("H", "inductance at the start of a transient", above=0)
    resistance: float = quantity("ohm", "resistance in series or in parallel with the coil", above=0)
    adaptation_rate: float = quantity(
        "1/(A^2 s)", "adaptation gain: rate of L_0/L per A^2 of the product of coil current and strain current", above=0
    )
    averaging_time: float = quantity("s", "time constant of the filter behind the multiplier", above=0)
    min_inductance: float | None = quantity(
        "H", "smallest inductance; default: half of the initial one", default=None, above=0
    )
    max_inductance: float | None = quantity(
        "H", "largest inductance; default: twice the initial one", default=None, above=0
    )
    topology: Literal["series", "parallel"] = described(
        "whether the resistance is in series or in parallel", default="series"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_choice("topology", self.topology, ("series", "parallel"))
        least, most = (np.real(self.inductance / share) for share in reversed(self.span))
        if np.any(np.real(self.inductance) < least) or np.any(np.real(self.inductance) > most):
            limits = f"min_inductance ({np.max(least):g} H) to max_inductance ({np.min(most):g} H)"
            raise ParameterError("inductance", f"found {np.max(self.inductance):g} H, must be within {limits}")

    @classmethod
    def assumed_if_named(cls, leads: Leads, values: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
        capacitance, omega = leads.capacitance, 2 * np.pi * leads.frequency
        strain = ASSUMED_SHARE * omega * capacitance * leads.open_voltage  # current, A
        own = {
            "inductance": 1 / (omega**2 * capacitance), "resistance": 0.2 / (omega * capacitance),
            "adaptation_rate": leads.frequency / (ASSUMED_PERIODS * strain**2),
            "averaging_time": AVERAGED_PERIODS / leads.frequency,
        }  # fmt: skip
        return own, f"adaptation over some {ASSUMED_PERIODS:g} periods, mean over {AVERAGED_PERIODS:g}"

    @property
    def span(self) -> tuple[Any, Any]:
        """Smallest and largest g = L_0/L."""
        smallest = 1 / RANGE if self.max_inductance is None else self.inductance / self.max_inductance
        return smallest, RANGE if self.min_inductance is None else self.inductance / self.min_inductance

    @property
    def tuned(self) -> tuple[str, ...]:
        """The resistance: what the coil is at the beginning does not count where it has adapted itself."""
        return ("resistance",)

    def settled(self, capacitance: float, omega: float) -> LinearShunt:
        smallest, largest = (self.inductance / share for share in reversed(self.span))
        parts = {
            "inductance": np.clip(1.0 / (omega**2 * capacitance), smallest, largest),
            "resistance": self.resistance,
        }
        kind = SeriesRL if self.topology == "series" else ParallelRL
        return kind(**parts, electrode=self.electrode, others=self.others)

    def states(self, capacitance: float) -> tuple[State, ...]:
        # Sizes at which the relative rate of adaptation would be that of the filter.
        size = 1.0 / (self.adaptation_rate * self.averaging_time)
        energy = self.inductance * size
        return (
            State("current", self.inductance, stores=False),
            State("mean", energy / size**2, odd=False, stores=False),
            State("excess", energy, odd=False, stores=False),
        )

    def configurations(self) -> tuple[str, ...]:
        """Adapting, or at a limit of the inductance."""
        return ("adapting", "shortest", "longest")

    def factors(self, port: Port, z: SimpleNamespace) -> Mapping[str, tuple[Row, Row]]:
        assert port.strain_current is not None
        return {"beyond": (z.excess, self._across(port, z)), "phase": (z.current, port.strain_current)}

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        beside = port.v / self.resistance if self.topology == "parallel" else 0.0
        adapts = self.adaptation_rate * z.mean
        if configuration != "adapting":
            # From beyond the limit, where only a search tries states, it comes back to that.
            limit = self.span[configuration == "shortest"] - 1.0
            adapts = (limit * port.one - z.excess) / self.averaging_time
        return [
            port.i - z.current - beside,
            self.inductance * dz.current - self._across(port, z) - z.beyond,
            self.averaging_time * dz.mean - z.phase + z.mean,
            dz.excess - adapts,
        ]

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        if configuration != "adapting":
            back = -z.mean if configuration == "shortest" else z.mean
            return [Guard(back, "adapting", event="")]
        smallest, largest = self.span
        return [
            Guard(z.excess - (largest - 1.0) * port.one, "shortest", event=""),
            Guard((smallest - 1.0) * port.one - z.excess, "longest", event=""),
        ]

    def figures(self, states: Mapping[str, float]) -> Mapping[str, float]:
        return {"adapted_inductance": float(self.inductance) / (1.0 + states["excess"])}

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        across = self._across(port, z)
        load = port.v - across if self.topology == "series" else port.v
        harvested = Product(1.0 / self.resistance, load, load)
        return {"harvested": [harvested], "source": [Product(-1.0, across, z.current)]}

    def _across(self, port: Port, z: SimpleNamespace) -> Row:
        """Voltage across the coil, V."""
        return port.v - self.resistance * z.current if self.topology == "series" else port.v
