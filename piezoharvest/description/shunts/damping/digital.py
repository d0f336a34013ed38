"""Synthetic impedance: a controller that samples the electrode voltage and imposes a current."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from piezoharvest.description.circuit import Assignment, Port, Product, Row, State, Switch
from piezoharvest.description.parameters import ParameterError, quantity
from piezoharvest.description.shunts.base import Shunt

MOST_COEFFICIENTS = 17  # of a polynomial: order 16, two for each of eight modes
MOST_DELAYS = 32  # sample times: each is a number more that the controller remembers
WHOLE = 1e-9  # of a sample time: a delay this near to whole ones is a whole number of them, but for rounding


@dataclass(frozen=True, kw_only=True)
class Digital(Shunt):
    """Digital (synthetic) impedance: a sampled voltage, a digital filter and a current source.

    The admittance is numerator(s)/denominator(s), with coefficients in descending powers of s. Every `sample_time` the
    voltage is read, rounded to `resolution` and filtered (bilinear transform without prewarping, s = 2/T (z - 1)/(z +
    1)). The resulting current, limited to `saturation`, is applied after `delay` and held for one sample time. Power
    drawn by the current source is counted as negative power of a source. The clock starts in the middle of the longer
    of two intervals: from a sample to the next change of the current, or from there to the next sample.

    Raises
    ------
    ParameterError
        The admittance is improper, its order is too high, it has a pole where the filter has none, or the delay is too
        long.
    """

    kind: ClassVar[str] = "digital"
    source: ClassVar[str] = (
        "Fleming, Behrens & Moheimani, Electronics Letters 36(18), 1525-1526, 2000; delays: Raze, Dietrich & Kerschen, "
        "J. Intell. Mater. Syst. Struct. 33(16), 2022"
    )
    mirrors: ClassVar[bool] = False  # its clock does not
    sampled: ClassVar[bool] = True
    unrecorded: ClassVar[str] = "whose clock no record shows, allowed are circuits without a controller"

    numerator: tuple[float, ...] = quantity("", "numerator of the admittance in S, highest power of s (1/s) first")
    denominator: tuple[float, ...] = quantity("", "denominator of the admittance, highest power of s (1/s) first")
    sample_time: float = quantity("s", "time between two samples", above=0)
    delay: float = quantity("s", "time from a sample to the current that results from it", default=0.0, at_least=0)
    resolution: float = quantity(
        "V", "quantisation step of the converter that reads the voltage", default=0.0, at_least=0
    )
    saturation: float | None = quantity("A", "largest current; default: no limit", default=None, above=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("numerator", "denominator"):
            found = getattr(self, name)
            if not 1 <= len(found) <= MOST_COEFFICIENTS:
                raise ParameterError(name, f"found {len(found)} coefficients, allowed are 1 to {MOST_COEFFICIENTS}")
            if np.any(np.real(found[0]) == 0):
                raise ParameterError(name, "found 0 for the highest power of s, must be a number other than 0")
        if len(self.numerator) > len(self.denominator):
            found = f"found order {len(self.numerator) - 1} over {len(self.denominator) - 1}"
            raise ParameterError("numerator", f"{found}, must have no higher order than the denominator")
        if np.any(np.real(self._polynomial(self.denominator)[0]) == 0):
            raise ParameterError("denominator", "found a zero at 2/sample_time, where no filter has one")
        if np.any(np.real(self.delay) > MOST_DELAYS * np.real(self.sample_time)):
            raise ParameterError("delay", f"found {self.delay} s, must be at most {MOST_DELAYS} sample times")

    @property
    def tuned(self) -> tuple[str, ...]:
        """Coefficients above zero, but for the first of the denominator, to which they are relative."""
        above = [f"numerator.{k}" for k, value in enumerate(self.numerator) if value > 0]
        return (*above, *(f"denominator.{k}" for k, value in enumerate(self.denominator) if k and value > 0))

    def _polynomial(self, coefficients: tuple[float, ...]) -> list[Any]:
        """Coefficients in z, highest power first, of p(2/T (z - 1)/(z + 1)) (z + 1)^n."""
        order = len(self.denominator) - 1
        found: list[Any] = [0.0] * (order + 1)
        for power, coefficient in enumerate(reversed(coefficients)):
            scaled = coefficient * (2.0 / self.sample_time) ** power
            for k, factor in enumerate(np.polymul(np.poly([1.0] * power), np.poly([-1.0] * (order - power)))):
                found[k] = found[k] + scaled * factor
        return found

    def filter(self) -> tuple[list[Any], list[Any]]:
        """Numerator (S) and denominator of the filter in z, highest power first; the latter begins with 1."""
        above, below = self._polynomial(self.numerator), self._polynomial(self.denominator)
        return [value / below[0] for value in above], [value / below[0] for value in below]

    def lateness(self) -> tuple[int, float]:
        """Delay as a number of whole sample times, and what remains as a share of one."""
        samples = float(np.real(np.asarray(self.delay / self.sample_time)).flat[0])
        whole = int(np.floor(samples + WHOLE))
        rest = samples - whole
        return whole, 0.0 if rest < WHOLE else rest

    def states(self, capacitance: float) -> tuple[State, ...]:
        voltage, current = capacitance, self.sample_time**2 / capacitance  # with these 1/2 z^2 are alike
        order = len(self.denominator) - 1
        of_voltage = ["reading", *(f"memory_{k}" for k in range(order + 1))]
        of_current = ["command", *(f"earlier_{k}" for k in range(1, self.lateness()[0] + 1)), "held"]
        return (
            *(State(name, voltage, stores=False) for name in of_voltage),
            *(State(name, current, stores=False) for name in of_current),
        )

    def configurations(self) -> tuple[str, ...]:
        """The clock's two halves: while the last command waits, and while it drives; the longer one first."""
        rest = self.lateness()[1]
        if not rest:
            return ("even", "odd")
        return ("driving", "waiting") if rest <= 0.5 else ("waiting", "driving")

    def opened(self, configuration: str) -> str:
        first, second = self.configurations()
        return second if configuration == first else first

    def stage(self, configuration: str, capacitance: float) -> float:
        rest = self.lateness()[1]
        return {"waiting": rest, "driving": 1.0 - rest}.get(configuration, 1.0)

    def switch(self, capacitance: float, period: float | None) -> Switch:
        if period is not None and np.any(np.real(self.sample_time) >= 0.5 * np.real(period)):
            most = f"must be less than half a period of the drive, {0.5 * np.min(np.real(period)):.4g} s"
            raise ParameterError("sample_time", f"found {np.max(np.real(self.sample_time)):g} s, {most}")
        return Switch(0.0, self.sample_time, 0.0, clocked=True)

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        return [port.i - z.held, *(getattr(dz, state.name) for state in self.states(port.capacitance))]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        return {"source": [Product(-1.0, port.v, port.i)]}

    def assignments(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Assignment]:
        drives = [Assignment("held", getattr(z, f"earlier_{self.lateness()[0]}", z.command))]
        if configuration == "waiting":
            return drives
        above, below = self.filter()
        memory = [getattr(z, f"memory_{k}") for k in range(len(above))]
        fed_back = sum((c * row for c, row in zip(below[1:], memory[1:], strict=True)), 0.0 * port.one)
        command = sum((c * row for c, row in zip(above, memory, strict=True)), 0.0 * port.one)
        limit = np.inf if self.saturation is None else self.saturation
        line = ["command", *(f"earlier_{k}" for k in range(1, self.lateness()[0] + 1))]
        # Direct form II, one assignment after the other, each with what the earlier ones have set.
        return [
            *(Assignment(into, getattr(z, of)) for of, into in reversed(list(pairwise(line)))),
            *(Assignment(f"memory_{k}", memory[k - 1]) for k in range(len(memory) - 1, 0, -1)),
            Assignment("reading", port.v, self.resolution),
            Assignment("memory_0", z.reading - fed_back),
            Assignment("command", command, limit=limit),
            *(drives if configuration != "driving" else ()),
        ]
