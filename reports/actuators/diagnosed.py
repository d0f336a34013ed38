"""What `diagnose` makes of the stack, with a linear model and with operators, and of the mirror, with one mode."""

from __future__ import annotations

import tempfile
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from piezoharvest.diagnose import diagnose
from piezoharvest.diagnose.summary import sentence
from piezoharvest.output import write_table, write_text
from piezoharvest.records import load_campaign
from reports.actuators import mirror
from reports.actuators.data import LEVELS, STACK_RATE, Loops, minor_loops, sine

# From the data sheet of the P-885.91; the amplifier's gain is not in the file and only scales the coupling.
STACK_MODEL = """
[transducer]
mass = 0.0158
damping = 1250.0
stiffness = 2.5e7
capacitance = 3.1e-6
coupling = 9.5
"""
OPERATORS = """
[transducer.hysteresis]
thresholds = [1e-5, 3e-5, 1e-4]
weights = [1e5, 6e4, 4e4]
"""
_RECORDS = f"""
[channels]
voltage = {{ column = "v", unit = "V", gain = 33.0 }}
displacement = {{ column = "x", unit = "um" }}

[[records]]
file = "sine.csv"
role = "fit"
drive = "voltage"
sample_rate = {STACK_RATE}

[[records]]
file = "minor.csv"
role = "validate"
drive = "voltage"
sample_rate = {STACK_RATE}
"""
# One mode for the band below the first resonance; the gain at rest is the coupling over the stiffness.
MIRROR_MODEL = """
[transducer]
mass = 0.0313
damping = 7.0
stiffness = 1e6
capacitance = 1e-6
coupling = -9.0
"""
BAND = (20.0, 200.0)  # Hz
_MODELS = {"linear": STACK_MODEL, "three stop operators": STACK_MODEL + OPERATORS}


class Verdict(NamedTuple):
    """What was said of a model.

    Attributes
    ----------
    model, verdict, sentence : str
    effects : tuple of str
    before, after, noise : float or None
        Rms in um of the minor loops' residual without and with the effects, and of noise; None for responses.
    left : tuple of str
        Where the residual of what was fitted is not noise, the least likely first.
    """

    model: str
    verdict: str
    sentence: str
    effects: tuple[str, ...]
    before: float | None
    after: float | None
    noise: float | None
    left: tuple[str, ...]


@lru_cache
def of_stack() -> tuple[Verdict, ...]:
    """Of each model, fitted to the sine and judged on the minor loops."""
    with tempfile.TemporaryDirectory() as folder:
        write_table(_columns(sine()), Path(folder) / "sine.csv")
        write_table(_columns(minor_loops()), Path(folder) / "minor.csv")
        return tuple(_verdict(name, text + _RECORDS, Path(folder)) for name, text in _MODELS.items())


@lru_cache
def of_mirror() -> tuple[Verdict, ...]:
    """Of the first displacement's response to the first voltage: at one level, and at all three."""
    with tempfile.TemporaryDirectory() as folder:
        entries = []
        for level in LEVELS:
            measured = mirror.response(level)
            inside = (measured.frequency > BAND[0]) & (measured.frequency < BAND[1])
            value = measured.response[inside, 0, 0]
            columns = {"frequency_Hz": measured.frequency[inside], "real": np.real(value), "imaginary": np.imag(value)}
            write_table(columns, Path(folder) / f"{level}mV.csv")
            entries.append(
                f'[[records]]\nfile = "{level}mV.csv"\nkind = "frf"\ninput = "voltage"\noutput = "displacement"\n'
            )
        found = {f"one mode, {LEVELS[0]} mV": entries[:1], "one mode, all levels": entries}
        return tuple(_verdict(name, MIRROR_MODEL + "\n".join(some), Path(folder)) for name, some in found.items())


def _columns(loops: Loops) -> dict:
    return {"v": loops.voltage, "x": loops.displacement}


def _verdict(name: str, text: str, folder: Path) -> Verdict:
    write_text(text, folder / "campaign.toml")
    found = diagnose(load_campaign(folder / "campaign.toml"))
    quality = [found.validation_before.rms, found.validation_after.rms, found.validation_after.noise]
    rms = [1e6 * each["displacement"] if "displacement" in each else None for each in quality]
    left = tuple(dict.fromkeys(place.where for place in found.left))
    effects = tuple(named.effect.name for named in found.effects)
    return Verdict(name, found.verdict, sentence(found), effects, rms[0], rms[1], rms[2], left)
