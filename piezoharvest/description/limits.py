"""Size limits of a study, with reasons: checked before anything is computed, so that memory is never exhausted.

The number of events, which a study does not show, is counted during the simulation (`engine.work_limit`).
"""

from __future__ import annotations

import numpy as np

from piezoharvest.description.excitation import Excitation, Multisine, Samples, Tones
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.linear.network import Network
from piezoharvest.description.transducer import Transducer

# Of a random signal: with all derived arrays, some 16 numbers for each sample, 1.3 GB.
MOST_SAMPLES = 10_000_000
# Of a recorded one, a day at a kilohertz: some 7 numbers for each sample, 6 GB.
MOST_RECORDED = 100_000_000
# Each of these adds states. The engine's tables for one mode grow with their square, to 0.2 GB for 250 states, and the
# time to compute them with their cube, to seconds.
MOST_TONES = 100
MOST_MODES = 50
MOST_ELEMENTS = 100
# A shunt at each adds states as a mode does.
MOST_ELECTRODES = 50
# The combinations of sticking and slipping stops are numbered: 2^50 of them in 9 configurations are below 2^63.
MOST_STOPS = 50
# Of the drive in a transient, a day at 50 Hz: two minutes of a stiff bridge that charges a supply.
MOST_PERIODS = 5_000_000
# Of the first resonance, in a transient: the rounding error of time is then 1e-5 of a period.
MOST_OSCILLATIONS = 10**11


def check_size(transducer: Transducer, excitation: Excitation, shunt: Shunt | None = None) -> None:
    """Check that a simulation will fit into memory.

    Raises
    ------
    ParameterError
        Something is too large; the message says how much is allowed, and what to change.
    """
    if transducer.hysteresis:
        found = len(transducer.hysteresis.thresholds)
        _check("transducer.hysteresis.thresholds", found, MOST_STOPS, "thresholds", "merge neighbours")
    _check(
        "transducer.modes", len(transducer.modes), MOST_MODES, "modes", "keep those nearest to the excitation frequency"
    )
    _check(
        "transducer.electrodes",
        len(transducer.electrodes),
        MOST_ELECTRODES,
        "electrodes",
        "leave out those with open electrodes",
    )
    if isinstance(excitation, Multisine):
        found = len(excitation.frequencies)
        _check("excitation.frequencies", found, MOST_TONES, "tones", "use kind = 'record' with their sum")
    else:
        most = MOST_RECORDED if isinstance(excitation, Samples) else MOST_SAMPLES
        _check("excitation", excitation.samples, most, "samples", "a shorter duration or a lower rate or band")
    if isinstance(shunt, Network):
        _check("netlist", len(shunt.elements), MOST_ELEMENTS, "elements", "merge elements in series or parallel")


def check_length(transducer: Transducer, excitation: Excitation, length: float) -> None:
    """Check that a transient of this length (s) can be computed in reasonable time.

    Raises
    ------
    ParameterError
        It has too many periods of its highest tone, or of the resonance.
    """
    advice = "a shorter run or a lower frequency"
    if not excitation.samples:  # these have a limited number
        signal = excitation.signal()
        if isinstance(signal, Tones):
            found = length * float(np.max(signal.frequencies))
            _check("excitation", found, MOST_PERIODS, f"periods in {length:g} s", advice)
    found = length * transducer.short_circuit_frequency
    _check("transducer.stiffness", found, MOST_OSCILLATIONS, f"periods of the resonance in {length:g} s", advice)


def _check(key: str, found: float, most: int, what: str, advice: str) -> None:
    if not found <= most:
        raise ParameterError(key, f"found {found:.7g} {what}, allowed are up to {most} ({advice})")
