"""Complete netlist: devices, shunt, measurements and analysis."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.description.catalogue.parts import parts
from piezoharvest.description.diode import exponential_curve
from piezoharvest.description.excitation import Excitation, Tones
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.bridge import Bridge
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.engine.lowering.lower import settled
from piezoharvest.equations.rows import connected
from piezoharvest.spice.circuits import write_shunt
from piezoharvest.spice.deck import Deck, number
from piezoharvest.spice.device import displacement, mechanical_power, write_drive, write_transducer
from piezoharvest.spice.operating_point import NetlistCircuit, OperatingPoint, estimate_operating_point
from piezoharvest.spice.steady_start import steady_start

# Default length in longest time constants, its bounds in periods; steps in the shortest pulse.
SETTLING = 10.0
# The same from the steady state of the broken line of the same diodes: a twentieth of what that is wrong by is left.
NEAR_SETTLING = 3.0
MIN_PERIODS, MAX_PERIODS = 10, 500
STEPS_IN_PULSE = 20
# Periods that run before the measurement where the run begins in the steady state.
STEADY_PERIODS = 2
# Steps in a period of the strongest tone, relative to those of the highest of several tones.
STEP_RATIO = 5
DIODE_MODEL = re.compile(r"d\s*\(\s*(?:[a-z]\w*\s*=\s*[-+]?[\d.]+(?:e[-+]?\d+)?[a-z]*\s*)+\)", re.IGNORECASE)
# numdgt above 7 lets LTspice keep waveforms in double precision.
_OWN_OPTIONS = {None: " plotwinsize=0", "ngspice": "", "ltspice": " plotwinsize=0 numdgt=15"}
MEASUREMENTS = {
    "harvested_power": "AVG V(harvested)",
    "mechanical_power": "AVG V(mechanical)",
    "displacement_pp": "PP V(x)",
    "voltage_pp": "PP V(p)",
    "dc_voltage": "AVG V(vdc)",
}

FROM_REST = "from rest"  # in the comment on the analysis of a netlist that does not start in the steady state


class Accuracy(NamedTuple):
    """Tolerances of the time steps.

    Attributes
    ----------
    relative : float
        reltol, or its multiple.
    current : float
        abstol, as a share of the size of the current.
    overestimate : float
        trtol: by how much the error of a step is taken to be overestimated.
    """

    relative: float
    current: float
    overestimate: float


# A winding that rings so many times in a period is followed in small steps until its current is below abstol. What it
# has is lost anyway, and the time of ten minutes comes down to half a one for another 1e-4 of the power.
MANY_RINGS = 2000
RINGING = Accuracy(10.0, 2e-5, 7.0)


def export_spice(
    transducer: Transducer,
    shunt: Shunt,
    excitation: Excitation,
    *,
    title: str = "",
    periods: int | None = None,
    measured_periods: int = 4,
    steps_per_period: int = 1000,
    start: Literal["steady", "rest"] = "steady",
    dc_start: float = 0.0,
    diodes: str | None = None,
    dialect: Literal["ngspice", "ltspice"] | None = None,
    tolerance: float = 1e-5,
) -> str:
    """Write a system as a netlist for transient analysis.

    Parameters
    ----------
    transducer : Transducer
    shunt : Shunt
    excitation : Excitation
    title : str
        First line of the netlist.
    periods : int, optional
        Periods to simulate. By default six in the steady state; from rest as many as the slowest time constant needs to
        settle, at most 500. Ignored for a non-periodic excitation, which runs once.
    measured_periods : int
        Periods at the end over which the .meas commands average.
    steps_per_period : int
        Time steps in a period at least; switched shunts take more, 20 in the shortest pulse.
    start : str
        "steady": in the engine's periodic steady state, where there is one that a motion from rest comes to. "rest":
        from rest; so do a non-periodic excitation, a store that feeds a supply and a clock begin.
    dc_start : float
        Initial voltage of the smoothing capacitor from rest, V: a value near the final one shortens the run. Zero: that
        of the shunt.
    diodes : str, optional
        SPICE model of the bridge's diodes, as "D(Is=2.5n N=1.75 Rs=0.57)", or a name of the catalogue, as "BAT54"; by
        default they are ideal with a drop. The run is then as long as one from rest, since such diodes have another
        steady state; a third of that where the shunt has the diodes of that name.
    dialect : str, optional
        For one of the programs alone, with its own options; by default for both.
    tolerance : float
        Relative tolerance of the time steps (reltol); ten times that where a winding rings thousands of times in a
        period.

    Returns
    -------
    str
        Netlist in the subset of the language common to ngspice and LTspice. Its .meas commands are harvested_power and
        mechanical_power (W, mean), efficiency (their ratio), displacement_pp (m) and voltage_pp (V, peak to peak: twice
        what the amplitudes of a `Response` are) and dc_voltage (V, mean).

    Raises
    ------
    ParameterError
        The shunt is of an unsupported kind, an effect has terms that a netlist cannot express or acts on a shunt with
        which it cannot be simulated, or a number of periods or steps is not positive.
    """
    if transducer.hysteresis:  # an operator without weight would be a capacitor without end
        transducer = replace(transducer, hysteresis=transducer.hysteresis.acting)
    system = System(transducer, shunt)
    # What hysteresis and effects hold at the transducer's own electrodes is not known of a start elsewhere.
    known = not (shunt.electrode and (transducer.hysteresis or transducer.effects))
    supplies = any(getattr(shunt, name, None) is not None for name in ("storage", "start_voltage"))
    begin = (
        steady_start(system, excitation) if start == "steady" and known and not supplies and not shunt.sampled else None
    )
    shunt = settled(connected(system), excitation).shunt
    dc_start = dc_start or getattr(shunt, "initial_dc_voltage", None) or 0.0
    point = estimate_operating_point(System(transducer, shunt), excitation, dc_start, begin)
    point = point._replace(diodes=_diode_model(diodes, shunt))
    point.terms.check(shunt, shunt.switch(point.capacitance, excitation.period))
    deck = Deck(title or f"piezoharvest: {shunt.kind}")
    _write_introduction(deck, dialect)
    deck.section("values")
    deck.comment("Initial conditions (IC=) are those of these values.")
    deck.parameters_here()
    write_drive(deck, point)
    write_transducer(deck, point)
    circuit = write_shunt(deck, shunt, point)
    _write_readings(deck, point, circuit)
    deck.section("analysis")
    settling = NEAR_SETTLING if begin is not None and _same_law(diodes, shunt) else SETTLING
    window = _write_window(deck, point, circuit, periods, measured_periods, settling)
    rings = 2 * math.pi * (getattr(shunt, "self_resonance", None) or 0.0) > MANY_RINGS * point.omega
    accuracy = RINGING if rings else Accuracy(1.0, 1e-9, 1.0)
    step = _largest_step(point, circuit, steps_per_period)
    _write_analysis(deck, point, window, step, accuracy._replace(relative=tolerance * accuracy.relative), dialect)
    return deck.text()


def _diode_model(model: str | None, shunt: Shunt) -> str | None:
    """Check the model of real diodes."""
    if model is None:
        return None
    if not isinstance(shunt, Bridge):
        raise ParameterError("diodes", f"found a model of diodes, but {shunt.kind} has no bridge")
    if model in parts("diode"):
        names = {"IS": "saturation_current", "N": "emission", "RS": "series_resistance"}
        return "D(" + " ".join(f"{key}={number(parts('diode')[model][name])}" for key, name in names.items()) + ")"
    if not DIODE_MODEL.fullmatch(model.strip()):
        known = "a diode of the catalogue or a model such as 'D(Is=2.5n N=1.75 Rs=0.57)'"
        raise ParameterError("diodes", f"found {model!r}, must be {known}")
    return " ".join(model.split())


def _same_law(diodes: str | None, shunt: Shunt) -> bool:
    """Whether the diodes of a shunt are the broken line of a part of the catalogue, and stand for that part."""
    curve = shunt.diode_curve if isinstance(shunt, Bridge) else None
    if curve is None or diodes is None or diodes not in parts("diode"):
        return False
    part = parts("diode")[diodes]
    law = exponential_curve(*(part[key] for key in ("saturation_current", "emission", "series_resistance")))
    return np.allclose(curve.voltages, law.voltages) if len(curve.voltages) == len(law.voltages) else False


def _write_introduction(deck: Deck, dialect: str | None) -> None:
    programs = {None: "ngspice (ngspice -b FILE) and LTspice (open FILE, run)", "ngspice": "ngspice (ngspice -b FILE)",
                "ltspice": "LTspice (open FILE, run)"}  # fmt: skip
    deck.comment(f"Written by piezoharvest, for {programs[dialect]}.")
    if dialect != "ltspice":
        deck.comment("ngspice prints the results of the .meas commands.")
    if dialect != "ngspice":
        deck.comment("In LTspice results of the .meas commands are in View > SPICE Output Log.")
        deck.comment(
            "LTspice gives every inductor 1 milliohm in series and, unless this is turned off (Control Panel > Hacks), "
            "some damping in parallel; plotwinsize=0 keeps it from compressing waveforms before it measures."
        )
    deck.comment(
        "All in SI units, a volt or an ampere of the netlist standing for one of them. Signs: force and displacement "
        "are positive in the same direction; m x'' + b x' + k x = F + T v_t, q = C v_t + T x, v_p = v_t + v_h; the "
        "electrode voltage V(p) times the current that leaves node p into the shunt is power given to the shunt."
    )


def _write_readings(deck: Deck, point: OperatingPoint, circuit: NetlistCircuit) -> None:
    deck.section("readings: V(x) displacement in m, V(harvested) and V(mechanical) power in W, V(vdc) dc voltage")
    deck.add("Bx x 0 V=" + displacement(point))
    deck.add("Bharvested harvested 0 V=" + circuit.harvested)
    deck.add("Bmechanical mechanical 0 V=" + mechanical_power(point))
    deck.add("Bvdc vdc 0 V=" + circuit.dc)
    if point.excitation.base:  # the name in a file of waveforms tells it from a force
        deck.add("Bbase base 0 V=V(drive)")


def _write_efficiency(deck: Deck, point: OperatingPoint, window: tuple[float, float], step: float) -> None:
    """Node `efficiency`: ratio of the energies since the measurement began, from one step into it on."""
    begin, end = window
    size, length = point.current * point.voltage, end - begin
    deck.comment("V(harvested_mean) and V(mechanical_mean) come to the mean powers at the end, over their size.")
    for name in ("harvested", "mechanical"):
        deck.add(f"C{name} {name}_mean 0 {number(length)} IC=0")
        on = f"max(0, min(1, (time-{number(begin)})*{number(1 / step)}))" if begin else "1"
        deck.add(f"B{name}_rate 0 {name}_mean I=V({name})*{number(1 / size)}*{on}")
    deck.add("Befficiency efficiency 0 V=V(harvested_mean)/(abs(V(mechanical_mean))+1e-12)")


def _write_window(
    deck: Deck, point: OperatingPoint, circuit: NetlistCircuit, periods: int | None, measured: int, settling: float
) -> tuple[float, float]:
    """Write the length of the run; return beginning and end of the measurement, s.

    By default it is so many times the slowest time constant, `settling`.
    """
    period, length = point.excitation.period, point.excitation.length
    if period is None:
        if length is None:
            raise ParameterError("excitation", "it has neither a period nor a length, one of them is needed")
        deck.comment("The excitation is not periodic: one run through it, measured from beginning to end.")
        return 0.0, length
    slowest = max(circuit.slowest, *_decay_times(point.transducer))
    wanted = measured + math.ceil(max(MIN_PERIODS, min(settling * slowest / period, 1e9)))
    if point.start is not None and point.diodes is None:
        wanted = measured + STEADY_PERIODS
    if periods is None:
        periods = max(measured + 1, min(wanted, MAX_PERIODS))
    for key, value, least in (("measured_periods", measured, 1), ("periods", periods, measured)):
        if value < least:
            raise ParameterError(key, f"found {value}, must be a whole number of at least {least}")
    start = point.start
    begins = FROM_REST if start is None else f"from a steady state, {number(start.time)} s after phase zero"
    deck.comment(
        f"{counted(periods, 'period')} of {number(period)} s {begins}, of which the last {measured} are measured."
    )
    if periods < wanted:
        deck.comment(
            f"This may be short: transients may last about {wanted} periods. Lengthen .tran and move the window of "
            ".meas, or start the smoothing capacitor (IC of Csmoothing) near its final voltage."
        )
    return (periods - measured) * period, periods * period


def _largest_step(point: OperatingPoint, circuit: NetlistCircuit, steps: int) -> float:
    """Largest time step, s: a fraction of the period, of that of the highest tone and of the shortest pulse."""
    if steps < 1:
        raise ParameterError("steps_per_period", f"found {steps}, must be a whole number of at least 1")
    share = [2 * math.pi / point.omega / steps, circuit.fastest / STEPS_IN_PULSE]
    if isinstance(point.signal, Tones):
        share.append(STEP_RATIO / (steps * float(max(point.signal.frequencies))))
    return min(share)


def _write_analysis(
    deck: Deck, point: OperatingPoint, window: tuple[float, float], step: float, accuracy: Accuracy, dialect: str | None
) -> None:
    """Simulation command, options and measurements."""
    _write_efficiency(deck, point, window, step)
    begin, end = (number(time) for time in window)
    deck.comment(
        "The fourth number of .tran is the largest time step: halve it to see how far the results are converged."
    )
    deck.add(".tran", step, end, 0, step, "uic")
    deck.comment("Gear integration damps what trapezoidal integration lets ring after a switch has opened.")
    charge, voltage = 1e-9 * point.current / point.omega, 1e-7 * min(1.0, point.voltage)
    deck.add(
        f".options method=gear reltol={number(accuracy.relative)} trtol={number(accuracy.overestimate)} "
        f"abstol={number(accuracy.current * point.current)} "
        f"vntol={number(voltage)} chgtol={number(charge)}" + _OWN_OPTIONS[dialect]
    )
    driven = "base" if point.excitation.base else "drive"
    deck.add(f".save V({driven}) V(x) V(p) V(vdc) V(harvested) V(mechanical) V(efficiency) I(Vload)")
    for name, what in MEASUREMENTS.items():
        deck.add(f".meas tran {name} {what} from={begin} to={end}")
    deck.add(f".meas tran efficiency FIND V(efficiency) AT={number(window[1] - 1e-3 * step)}")


def _decay_times(transducer: Transducer) -> list[float]:
    """Time constants of the modes' free decay and of the effects, s."""
    modes = [2 * mode.mass / mode.damping if mode.damping else math.inf for mode in transducer.all_modes]
    return modes + [getattr(effect, "time_constant", 0.0) for effect in transducer.effects]
