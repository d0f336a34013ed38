"""A system in the engine and, as its netlist, in ngspice."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from piezoharvest.description.excitation import Excitation
from piezoharvest.description.system import System
from piezoharvest.engine.simulation import simulate
from piezoharvest.spice.export import export_spice
from piezoharvest.spice.simulators.ngspice import run_netlist

# The netlist begins where the engine says that the steady state is: were it elsewhere, so many periods would show it.
PERIODS = 20
# Of a store that feeds a supply, which has no steady state, and of a clock, which a netlist begins: both are at rest.
STORE_PERIODS = 100
# Differences below this share of the largest value of their kind are rounding: 0 W against 1e-20 W.
NOTHING = 1e-9


class Figure(NamedTuple):
    """One figure of both."""

    name: str
    unit: str
    engine: float
    ngspice: float
    size: float

    @property
    def difference(self) -> float:
        """Of ngspice from the engine, relative."""
        if abs(self.ngspice - self.engine) <= NOTHING * self.size:
            return 0.0
        return self.ngspice / self.engine - 1 if self.engine else float("inf")


def compare(
    system: System,
    excitation: Excitation,
    diodes: str | None = None,
    timeout: float = 600.0,
    progress: Callable[[str], None] = lambda text: None,
) -> tuple[list[Figure], bool]:
    """Simulate a system here and in ngspice.

    Parameters
    ----------
    system : System
    excitation : Excitation
    diodes : str, optional
        As of `export_spice`.
    timeout : float
        Longest time that is waited for ngspice, s.
    progress : callable, optional
        Called as by `run_netlist`.

    Returns
    -------
    list of Figure
    bool
        The engine's result can be trusted.

    Raises
    ------
    ParameterError
        The system cannot be exported, or not simulated.
    NgspiceError
        There is no ngspice, or it did not run to the end.
    """
    period, transient = excitation.period, None
    window: dict[str, Any] = {}
    from_rest = system.shunt.sampled or any(
        getattr(system.shunt, name, None) is not None for name in ("storage", "start_voltage")
    )
    if period is not None and from_rest:
        transient, window = STORE_PERIODS * period, {"periods": STORE_PERIODS, "measured_periods": STORE_PERIODS}
    elif period is not None and diodes is None:
        window = {"periods": PERIODS}
    response = simulate(system, excitation, transient=transient, samples=64, attenuation=False)
    netlist = export_spice(system.transducer, system.shunt, excitation, **window, diodes=diodes)
    found = run_netlist(netlist, timeout, progress=progress)
    figures = (
        ("harvested_power", "W", response.harvested_power, response.mechanical_power),
        ("mechanical_power", "W", response.mechanical_power, response.mechanical_power),
        ("efficiency", "", response.efficiency, 1.0),
        ("displacement_pp", "m", 2 * response.displacement_amplitude, response.displacement_amplitude),
        ("voltage_pp", "V", 2 * response.voltage_amplitude, response.voltage_amplitude),
        ("dc_voltage", "V", response.dc_voltage, response.voltage_amplitude),
    )
    compared = [Figure(name, unit, value, found[name], size) for name, unit, value, size in figures]
    return compared, response.converged
