"""The netlist as a whole: devices, shunt, what is measured and how it is run."""

from __future__ import annotations

import math

from piezoharvest.excitation import Excitation
from piezoharvest.parameters import ParameterError
from piezoharvest.shunts.base import Shunt
from piezoharvest.spice.circuits import write_shunt
from piezoharvest.spice.deck import Deck, number
from piezoharvest.spice.device import displacement, mechanical_power, write_drive, write_mechanics, write_transducer
from piezoharvest.spice.scene import Circuit, Scene, make_scene
from piezoharvest.transducer import Transducer

# Default run: this many of the longest time constant, at most so many periods; steps in the shortest pulse.
SETTLING = 10.0
MOST_PERIODS = 500
STEPS_IN_PULSE = 20


def export_spice(
    transducer: Transducer,
    shunt: Shunt,
    excitation: Excitation,
    *,
    title: str = "",
    periods: int | None = None,
    measured_periods: int = 4,
    steps_per_period: int = 1000,
    dc_start: float = 0.0,
) -> str:
    """Write a system as a netlist for transient analysis, from rest.

    Parameters
    ----------
    transducer : Transducer
    shunt : Shunt
    excitation : Excitation
    title : str
        First line of the netlist.
    periods : int, optional
        Periods to simulate. By default as many as the slowest time constant needs to settle, at most 500. Without
        effect on an excitation that is not periodic, which runs through once.
    measured_periods : int
        Periods at the end over which the .meas commands average.
    steps_per_period : int
        Time steps in a period at least; switched shunts take more, 20 in the shortest pulse.
    dc_start : float
        Voltage of the smoothing capacitor at the beginning, V: near the final one, it shortens the run.

    Returns
    -------
    str
        Netlist in the language that ngspice and LTspice share. Its .meas commands are harvested_power and
        mechanical_power (W, mean), displacement_pp (m) and voltage_pp (V, peak to peak: twice what the amplitudes of
        a `Response` are) and dc_voltage (V, mean).

    Raises
    ------
    ParameterError
        A shunt or an effect is of a kind that is not known here, or a count of periods or steps is not positive.
    """
    for key, value in (("measured_periods", measured_periods), ("steps_per_period", steps_per_period)):
        if value < 1:
            raise ParameterError(key, f"found {value}, allowed is a whole number of at least 1")
    if periods is not None and periods < measured_periods:
        raise ParameterError("periods", f"found {periods}, allowed is at least measured_periods ({measured_periods})")
    scene = make_scene(transducer, excitation, dc_start)
    deck = Deck(title or f"piezoharvest: {shunt.kind}")
    _write_introduction(deck)
    write_drive(deck, scene)
    write_mechanics(deck, scene)
    write_transducer(deck, scene)
    circuit = write_shunt(deck, shunt, scene)
    _write_readings(deck, scene, circuit)
    _write_analysis(deck, scene, circuit, periods, measured_periods, steps_per_period)
    return deck.text()


def _write_introduction(deck: Deck) -> None:
    deck.comment("Written by piezoharvest, for ngspice (ngspice -b FILE) and LTspice (open FILE, run).")
    deck.comment("Results of the .meas commands: ngspice prints them; in LTspice, View > SPICE Output Log.")
    deck.comment(
        "All in SI units, a volt or an ampere of the netlist standing for one of them. Signs: force and displacement "
        "are positive in the same direction; m x'' + b x' + k x = F + T v_t, q = C v_t + T x, v_p = v_t + v_h; the "
        "electrode voltage V(p) times the current that leaves node p into the shunt is power given to the shunt."
    )


def _write_readings(deck: Deck, scene: Scene, circuit: Circuit) -> None:
    deck.section("readings: V(x) displacement in m, V(harvested) and V(mechanical) power in W, V(vdc) dc voltage")
    deck.add("Bx x 0 V=" + displacement(scene))
    deck.add("Bharvested harvested 0 V=" + circuit.harvested)
    deck.add("Bmechanical mechanical 0 V=" + mechanical_power(scene))
    deck.add("Bvdc vdc 0 V=" + circuit.dc)


def _write_analysis(deck: Deck, scene: Scene, circuit: Circuit, periods: int | None, measured: int, steps: int) -> None:
    """Simulation command, tolerances and measurements."""
    deck.section("analysis")
    period, length = scene.excitation.period, scene.excitation.length
    cycle = 2 * math.pi / scene.omega
    if period is None and length is not None:
        begin, end = 0.0, length
    else:
        period = period or cycle
        settled = SETTLING * max(circuit.slowest, *_decay_times(scene.transducer))
        wanted = measured + math.ceil(min(settled / period, 1e9))
        if periods is None:
            periods = max(measured, min(wanted, MOST_PERIODS))
        begin, end = (periods - measured) * period, periods * period
        deck.comment(f"{periods} periods of {number(period)} s from rest, of which the last {measured} are measured.")
        if periods < wanted:
            deck.comment(
                f"This may be short: transients last about {wanted} periods. Lengthen .tran and move the window of "
                ".meas, or start the smoothing capacitor (IC of Csmoothing) near its final voltage."
            )
    step = min(cycle / steps, circuit.fastest / STEPS_IN_PULSE)
    deck.comment(
        "The fourth number of .tran is the largest time step: halve it to see how far the results are converged."
    )
    deck.add(".tran", step, end, 0, step, "uic")
    deck.comment("Gear integration damps what trapezoidal integration lets ring after a switch has opened.")
    small = f"abstol={number(1e-9 * scene.current)} vntol={number(1e-7 * min(1.0, scene.voltage))}"
    deck.add(f".options method=gear reltol=1e-5 trtol=1 {small} chgtol={number(1e-9 * scene.current / scene.omega)}")
    deck.add(".save V(drive) V(x) V(p) V(vdc) V(harvested) V(mechanical) I(Vport)")
    window = f"from={number(begin)} to={number(end)}"
    deck.add(".meas tran harvested_power AVG V(harvested)", window)
    deck.add(".meas tran mechanical_power AVG V(mechanical)", window)
    deck.add(".meas tran displacement_pp PP V(x)", window)
    deck.add(".meas tran voltage_pp PP V(p)", window)
    deck.add(".meas tran dc_voltage AVG V(vdc)", window)


def _decay_times(transducer: Transducer) -> list[float]:
    """Time constants of the modes' free decay, s."""
    return [2 * mode.mass / mode.damping if mode.damping else math.inf for mode in transducer.all_modes]
