"""Studies that nobody would choose: any kind and effect, values over twelve decades, on spots where things meet."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np

from piezoharvest.description import effects, shunts
from piezoharvest.description.parameters import Component, ParameterError
from piezoharvest.description.shunts import Battery
from piezoharvest.study import Study, study_from

DECADES = 6.0  # to either side of what suits the study
# Kinds that are no random choice of values: a net list, and lists of parts that belong together.
GIVEN: dict[str, dict[str, Any]] = {
    "network": {"netlist": "L1 1 2 150\nC1 2 0 30n\nR1 2 0 100k load"},
    "spice": {"netlist": "* a diode\nD1 p a dd\nR1 a 0 100k\n.model dd D(Ron=10 Roff=1g Vfwd=0.1)", "load": ["R1"]},
}


class Draw:
    """Random values about what suits a study, some of them on spots: zero, a bound, exactly what is typical.

    Parameters
    ----------
    seed : int
    width : float
        Decades to either side, at most `DECADES`.
    """

    def __init__(self, seed: int):
        self.rng = np.random.default_rng((47, seed))
        self.width = DECADES * self.rng.uniform() ** 2  # half of the studies within a decade and a half
        self.sizes: dict[str, float] = {}

    def about(self, typical: float) -> float:
        """A positive number about a typical one."""
        return float(typical * 10 ** self.rng.uniform(-self.width, self.width))

    def chance(self, share: float) -> bool:
        """True with a probability."""
        return bool(self.rng.uniform() < share)

    def study(self) -> dict[str, Any]:
        """Tables of a study."""
        transducer = self._transducer()
        kind = str(self.rng.choice(sorted(shunts.registered())))
        shunt = {"kind": kind, **GIVEN.get(kind, self._shunt(shunts.registered()[kind]))}
        known = effects.registered()
        for name in self.rng.choice(sorted(known), size=self.rng.choice([0, 0, 1, 1, 2, 3]), replace=False):
            table = self._fields(known[str(name)], required_only=0.3)
            transducer.setdefault("effects", {})[str(name)] = table
        return {"title": kind, "transducer": transducer, "excitation": self._excitation(), "shunts": [shunt]}

    def _shunt(self, cls: type[Component]) -> dict[str, Any]:
        """Keys of a circuit, of which those that stand for each other are not given at once."""
        found, names = self._fields(cls, required_only=0.5), {field.name for field in dataclasses.fields(cls)}
        if cls is not Battery and {"dc_voltage", "load_resistance"} <= names:
            sides = [("dc_voltage",), ("smoothing_capacitance", "load_resistance")]
            chosen = sides[int(self.rng.integers(2))]
            found = {key: value for key, value in found.items() if key not in {*sides[0], *sides[1]} - set(chosen)}
            scale = {"dc_voltage": "V", "smoothing_capacitance": "F", "load_resistance": "ohm"}
            found |= {key: self.about(self.sizes[scale[key]]) for key in chosen if key not in found}
        if {"inductance", "flip_time"} <= names:
            found = {key: value for key, value in found.items() if key not in ("inductance", "flip_time")}
            which = "inductance" if self.chance(0.7) else "flip_time"
            found[which] = self.about(0.01 * self.sizes["H"]) if which == "inductance" else self.about(self.sizes["s"])
        return found

    def _transducer(self) -> dict[str, Any]:
        mass, capacitance, frequency = self.about(1e-2), self.about(1e-8), self.about(100.0)
        squared, omega = self.about(0.03), 2 * math.pi * frequency
        stiffness = mass * omega**2
        quality = math.inf if self.chance(0.05) else self.about(30.0)
        coupling = math.sqrt(squared * stiffness * capacitance)
        self.force = self.about(0.1)
        displacement = self.force / stiffness * min(quality, 30.0)
        voltage = coupling * displacement / capacitance
        self.sizes = {
            "Hz": frequency, "s": 1 / omega, "ohm": 1 / (omega * capacitance), "F": capacitance, "V": voltage,
            "H": 1 / (omega**2 * capacitance), "A": omega * capacitance * voltage, "C": capacitance * voltage,
            "m": displacement, "N": self.force, "kg": mass, "N/m": stiffness, "S": omega * capacitance, "rad": 0.3,
            "N/V": coupling, "N s/m": stiffness / omega / 30.0, "1/V^2": 0.1 / voltage**2, "": 1.0,
            "V/C": 1 / capacitance, "N/m^3": 0.1 * stiffness / displacement**2, "m/s^2": self.force / mass,
            "1/(A^2 s)": 0.02 * omega / (omega * capacitance * voltage) ** 2,
            "C/m^2": 0.1 * coupling / displacement, "m/N^(2/3)": 0.1 * displacement / self.force ** (2 / 3), "W": 1e-4,
        }  # fmt: skip
        self.resonances = (frequency, frequency * math.sqrt(1 + squared))
        found: dict[str, Any] = {
            "mass": mass, "damping": 0.0 if math.isinf(quality) else math.sqrt(stiffness * mass) / quality,
            "stiffness": stiffness, "coupling": coupling * float(self.rng.choice([-1, 1])), "capacitance": capacitance,
        }  # fmt: skip
        if self.chance(0.3):
            count = int(self.rng.integers(1, 4))
            found["hysteresis"] = {
                "thresholds": sorted(self.about(0.3 * capacitance * voltage) for _ in range(count)),
                "weights": [self.about(0.2 / capacitance) for _ in range(count)],
            }
        if self.chance(0.2):
            mode = {"mass": self.about(mass), "stiffness": self.about(9 * stiffness), "coupling": self.about(coupling)}
            found["modes"] = [{**mode, "damping": self.about(found["damping"] or 1e-3 * stiffness / omega)}]
        return found

    def _excitation(self) -> dict[str, Any]:
        base = self.chance(0.3)
        kind = "base" if base else "force"
        amplitude = self.sizes["m/s^2"] if base else self.force
        spot = self.rng.choice(["resonance", "open", "near", "far"])
        frequency = {
            "resonance": self.resonances[0], "open": self.resonances[1],
            "near": float(self.rng.uniform(*self.resonances)), "far": self.about(self.resonances[0]),
        }[str(spot)]  # fmt: skip
        if self.chance(0.1) and not base:
            return {"kind": "step_force", "amplitude": amplitude, "duration": 20 / frequency}
        if self.chance(0.1):
            tones = [frequency, frequency * float(self.rng.choice([1.5, 2.0, 3.0]))]
            return {"kind": "multisine", "amplitudes": [amplitude, 0.5 * amplitude], "frequencies": tones,
                    "phases": [0.0, 1.0], "duration": 20 / frequency}  # fmt: skip
        offset = amplitude * float(self.rng.choice([0.0, 0.0, 0.0, 1.0, -3.0]))
        return {"kind": f"sine_{kind}", "amplitude": amplitude, "frequency": frequency, "offset": offset}

    def _fields(self, cls: type[Component], required_only: float) -> dict[str, Any]:
        """Values of a component's fields; one with a default is left out with a probability."""
        hints, found = get_type_hints(cls), {}
        for field in dataclasses.fields(cls):
            needed = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
            if not field.init or (not needed and self.chance(required_only)):
                continue
            value = self._value(field, hints[field.name])
            if value is not None:
                found[field.name.removesuffix("_")] = value
        return found

    def _value(self, field: dataclasses.Field, hint: Any) -> Any:
        """A value of a field's type and unit, or None where neither tells what fits."""
        parts = [part for part in get_args(hint) if part is not type(None)]
        if get_origin(hint) is Literal:
            return self.rng.choice(get_args(hint)).item()
        literal = next((part for part in parts if get_origin(part) is Literal), None)
        if literal is not None:
            return str(self.rng.choice(get_args(literal)))
        if field.name == "quality":
            return 0.5 + self.about(6.0)
        if "unit" not in field.metadata or field.metadata["unit"] not in self.sizes:
            return None
        if get_origin(hint) is tuple or any(get_origin(part) is tuple for part in parts):
            return [self._number(field) for _ in range(int(self.rng.integers(1, 4)))]
        if hint is int or int in parts:
            return int(self.rng.integers(0, 5))
        return self._number(field)

    def _number(self, field: dataclasses.Field) -> float:
        """A number of a field: within its bounds, on one of them, zero, or about what suits the study."""
        bounds = [field.metadata[key] for key in ("above", "at_least", "below", "at_most")]
        low, high = (next((b for b in pair if b is not None), None) for pair in (bounds[:2], bounds[2:]))
        if self.chance(0.1) and bounds[1] is not None:
            return float(bounds[1])
        if self.chance(0.05) and bounds[3] is not None:
            return float(bounds[3])
        if low is not None and high is not None:
            return float(self.rng.uniform(low, high)) or 0.5 * (low + high)
        sign = 1.0 if low is not None else float(self.rng.choice([-1.0, 0.0, 1.0]))
        return sign * self.about(self.sizes[field.metadata["unit"]])


def study_of(seed: int) -> Study:
    """The study of a seed.

    Most of what is drawn for a circuit with many keys does not go together. Of every other seed it is refused as it is,
    the others lose the keys that refusals name, so that more is simulated.

    Raises
    ------
    ParameterError
        Its values do not go together, as a user would be told.
    """
    table = Draw(seed).study()
    while seed % 2:
        try:
            return study_from(table, Path("study.toml"))
        except ParameterError as error:
            if not _without(table, error.key.split(".")):
                raise
    return study_from(table, Path("study.toml"))


def _without(table: Any, key: list[str]) -> bool:
    """Remove a key of a circuit from the tables of a study; False if there is none of this name."""
    if key[:2] != ["shunts", "0"] or len(key) != 3:
        return False
    return key[2] != "kind" and table["shunts"][0].pop(key[2], None) is not None
