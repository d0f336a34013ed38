"""A coil that adapts itself, as netlist elements: the law of the controller by controlled sources."""

from __future__ import annotations

from piezoharvest.spice.deck import Deck, number
from piezoharvest.spice.device import coupled_velocity
from piezoharvest.spice.operating_point import NetlistCircuit, OperatingPoint

HELD = 1e4  # over what drives it beyond, with which the inductance is held at its limits


def write_adaptive_rl(deck: Deck, shunt, point: OperatingPoint) -> NetlistCircuit:
    """Write an adaptive RL shunt."""
    deck.comment(
        "I(Vcoil) is the current of the coil, V(excess) is L_0/L - 1, and V(mean) the filtered product of this current "
        "and that of the strain, times rate and time constant of the adaptation."
    )
    end = "r" if shunt.topology == "series" else "0"
    across = "(V(p)-V(r))" if shunt.topology == "series" else "V(p)"
    deck.add(f"Bdrive drive_coil 0 V=(1+V(excess))*{across}")
    deck.add("Vcoil drive_coil model 0")
    deck.add("Lcoil model 0", shunt.inductance, point.condition("current"))
    deck.add(f"Fcoil p {end} Vcoil 1")
    deck.add(f"Rload {'p' if end == '0' else 'r'} 0", shunt.resistance)
    time = deck.parameter("averaging_time", shunt.averaging_time)
    rate = deck.parameter("adaptation_rate", shunt.adaptation_rate)
    deck.add(f"Cmean mean 0 {time} IC={number(shunt.adaptation_rate * shunt.averaging_time * point.initial('mean'))}")
    deck.add("Rmean mean 0 1")
    deck.add(f"Bphase 0 mean I={rate}*{time}*I(Vcoil)*({coupled_velocity(deck, point)})")
    smallest, largest = (number(value - 1.0) for value in shunt.span)
    beyond = f"(max(0, V(excess)-({largest}))+min(0, V(excess)-({smallest})))*{number(HELD)}"
    deck.add(f"Badapt 0 excess I=V(mean)/{time}-{beyond}")
    deck.add(f"Cexcess excess 0 1 {point.condition('excess')}")
    node, still = ("p" if end == "0" else "r"), 2 * shunt.inductance / shunt.resistance
    slowest = max(still, shunt.averaging_time)
    return NetlistCircuit(f"V({node})*V({node})/{{resistance_load}}", slowest=slowest)
