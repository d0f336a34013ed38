"""Studies that no tuning was made for: random plants by seed, under one frequency, over a band, under noise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from piezoharvest.description.excitation import Excitation, RandomForce, SineForce
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.transducer import Transducer
from piezoharvest.study import DesignOptions, Study

COUPLINGS = {"weak": (0.003, 0.03), "strong": (0.1, 0.5)}  # K^2
_QUALITIES = (15.0, 150.0)  # mechanical
_FREQUENCIES, _CAPACITANCES = (20.0, 400.0), (5e-9, 500e-9)  # Hz and F
_MASSES = (1e-3, 1.0)  # kg
_VOLTAGE = 10.0  # V with open electrodes at resonance, about
_BEYOND = 0.04  # of the resonances: how far a band goes beyond both

LINEAR = ("resistor", "series_rl", "parallel_rl", "series_rlc", "parallel_rlc")
SWITCHED = ("rectifier", "parallel_sshi", "series_sshi", "sece")
HYSTERETIC = ("resistor", "series_rl", "parallel_sshi")


class Case(NamedTuple):
    """A study by its seed.

    Attributes
    ----------
    seed : int
    coupling : str
        "weak" or "strong".
    excitation : str
        "sine", "band" or "noise".
    objective : str
    hysteresis : bool
    kinds : tuple of str
        Candidates.
    """

    seed: int
    coupling: str
    excitation: str
    objective: str
    hysteresis: bool = False
    kinds: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The case in words."""
        more = " with hysteresis" if self.hysteresis else ""
        return f"{self.objective}, {self.excitation}, {self.coupling} coupling{more}, seed {self.seed}"

    def study(self) -> Study:
        """The study of the case."""
        rng = np.random.default_rng((31, self.seed))
        plant = _plant(rng, COUPLINGS[self.coupling])
        force = _force(plant)
        if self.hysteresis:
            plant = replace(plant, hysteresis=_hysteresis(rng, plant))
        excitation, band = _excitation(rng, plant, self.excitation, force)
        options = DesignOptions(objective=self.objective, band=band, candidates=self.kinds)  # pyright: ignore[reportArgumentType]
        return Study(title=self.name, path=Path("study.toml"), transducer=plant, shunts=(), excitation=excitation,
                     design=options)  # fmt: skip


def _plant(rng: np.random.Generator, couplings: tuple[float, float]) -> Transducer:
    mass, capacitance, frequency, quality, squared = (
        float(np.exp(rng.uniform(*np.log(r)))) for r in (_MASSES, _CAPACITANCES, _FREQUENCIES, _QUALITIES, couplings)
    )
    stiffness = mass * (2 * np.pi * frequency) ** 2
    return Transducer(
        mass=mass, stiffness=stiffness, capacitance=capacitance, damping=float(np.sqrt(stiffness * mass) / quality),
        coupling=float(np.sqrt(squared * stiffness * capacitance)),
    )  # fmt: skip


def _resonances(plant: Transducer) -> tuple[float, float]:
    short = np.sqrt(plant.stiffness / plant.mass)
    squared = plant.coupling**2 / (plant.stiffness * plant.capacitance)
    return float(short / (2 * np.pi)), float(short * np.sqrt(1 + squared) / (2 * np.pi))


def _force(plant: Transducer) -> float:
    """Amplitude of the force that gives some volts with open electrodes at resonance."""
    omega = 2 * np.pi * _resonances(plant)[1]
    return _VOLTAGE * plant.capacitance / plant.coupling * plant.damping * omega


def _hysteresis(rng: np.random.Generator, plant: Transducer) -> Hysteresis:
    """Stops that slip within the charge of the drive, with a tenth to a third of the capacitance's 1/C."""
    charge = _VOLTAGE * plant.capacitance
    thresholds = charge * np.array([0.05, 0.15]) * rng.uniform(0.7, 1.4)
    weights = np.array([0.1, 0.3]) * rng.uniform(0.5, 1.0) / plant.capacitance
    return Hysteresis(thresholds=tuple(map(float, thresholds)), weights=tuple(map(float, weights)))


def _excitation(
    rng: np.random.Generator, plant: Transducer, kind: str, force: float
) -> tuple[Excitation, tuple[float, float] | None]:
    short, opened = _resonances(plant)
    low, high = short * (1 - _BEYOND), opened * (1 + _BEYOND)
    frequency = float(rng.uniform(low, high))
    if kind == "noise":
        psd = force**2 / (high - low)
        return RandomForce(psd=psd, band=(0.3 * low, 2 * high), duration=200 / short, seed=1), None
    return SineForce(amplitude=force, frequency=frequency), (low, high) if kind == "band" else None


def cases() -> list[Case]:
    """All studies of the report."""
    found = []
    for seed in (101, 102):
        for coupling in COUPLINGS:
            for excitation in ("sine", "band", "noise"):
                switched = () if excitation == "noise" else SWITCHED
                found.append(Case(seed, coupling, excitation, "harvest", kinds=LINEAR + switched))
                found.append(Case(seed, coupling, excitation, "damping", kinds=LINEAR))
        found.append(Case(seed, "strong", "sine", "harvest", hysteresis=True, kinds=HYSTERETIC))
    return found
