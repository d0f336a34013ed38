"""Campaigns that nobody would choose: any circuit, excitation and kind of record, measured by the bench's solver."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from piezoharvest.bench import measure
from piezoharvest.bench.effects import registered
from piezoharvest.bench.measuring import BenchRecord
from piezoharvest.bench.sensors import COLUMNS
from piezoharvest.bench.solver import CIRCUITS, SolverError
from piezoharvest.description import effects, shunts
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.paths import component_table
from piezoharvest.study import StudyError, study_from
from reports.reliability.studies import GIVEN, Draw

Tables = dict[str, Any]
Columns = dict[str, np.ndarray]
TRIES = 40  # of a study that the bench takes: of random values of circuits and effects most do not go together
MOST_SAMPLES = 600  # of a record, so that a campaign is a matter of seconds
ALL_CHANNELS = ["displacement", "voltage", "current", "velocity", "acceleration", "dc_voltage", "dc_current", "gate"]
BESIDE = ("frf", "impedance")  # kinds of records that the bench has not


class CampaignDraw(Draw):
    """Random campaigns; `healthy` ones have no effect, nominal values that are about right, and no odd records."""

    def __init__(self, seed: int, healthy: bool):
        super().__init__(seed)
        self.healthy = healthy
        self.width = 0.3 if healthy else 2.0 * self.rng.uniform() ** 3

    def campaign(self) -> tuple[Tables, dict[str, Columns], Tables]:
        """Tables of the campaign file, the columns of each data file, and the tables of the true transducer."""
        for _ in range(TRIES):
            tables = self._measured()
            try:
                measured = measure(study_from(tables, Path("study.toml")))
            except (ParameterError, StudyError, SolverError, OverflowError):
                continue
            return self._campaign_of(tables, measured.records)
        raise SolverError(f"none of {TRIES} random studies can be measured")

    def _measured(self) -> Tables:
        """Study whose records are measured."""
        transducer = self._transducer()
        self.sizes["Hz"] = self.resonances[0]
        names = sorted(name for name in CIRCUITS if name in shunts.registered())
        favourite = str(self.rng.choice(names)) if self.chance(0.6) else "resistor"
        known = effects.registered()
        chosen = () if self.healthy else self.rng.choice(sorted(registered()), self.rng.choice([0, 1, 1, 2]), False)
        found = {str(name): self._fields(known[str(name)], required_only=0.3) for name in chosen}
        records = [self._record(favourite) for _ in range(int(self.rng.integers(2 if self.healthy else 1, 5)))]
        rate = max(record.pop("rate") for record in records)
        for record in records:
            record["duration"] = min(record["duration"], MOST_SAMPLES / rate)
        # Sensors and noise are added to the true values later; what loads the specimen here should not.
        bench = {
            "sample_rate": rate, "seed": 1, "records": records, "effects": found, "channels": ALL_CHANNELS,
            "buffer": {"input_resistance": 1e9 * self.sizes["ohm"]},
            "current_sense": {"resistance": 1e-6 * self.sizes["ohm"]},
        }  # fmt: skip
        drive = {"kind": "sine_force", "amplitude": self.force, "frequency": self.resonances[0]}
        return {"transducer": transducer, "excitation": drive, "shunts": [{"kind": "open"}], "bench": bench}

    def _record(self, favourite: str) -> Tables:
        excitation = self._any_excitation()
        kind = favourite if self.chance(0.7) else str(self.rng.choice(["resistor", "open", "short", "series_rl"]))
        shunt = {"kind": kind, **GIVEN.get(kind, self._shunt(shunts.registered()[kind]))}
        frequency = excitation.get("frequency") or max(excitation.get("frequencies", [self.resonances[0]]))
        periods, of_each = self.rng.uniform(2, 40), 10 ** self.rng.uniform(1.0, 2.0)
        if self.healthy:
            periods, of_each = self.rng.uniform(15, 40), self.rng.uniform(25, 60)
        return {
            "excitation": excitation, "shunt": shunt, "duration": periods / frequency, "rate": of_each * frequency,
            "role": "fit",
        }  # fmt: skip

    def _any_excitation(self) -> Tables:
        frequency = float(self.rng.uniform(0.8, 1.2)) * self.resonances[0]
        if not self.healthy and self.chance(0.4):
            frequency *= 10 ** self.rng.uniform(-3, 1)
        length = self.rng.uniform(10, 30) / frequency
        kind = str(self.rng.choice(["sine", "sine", "step", "multisine", "random"]))
        base = self.chance(0.3) and kind in ("sine", "random")
        amplitude = self.sizes["m/s^2"] if base else self.force
        if not self.healthy:
            amplitude *= 10 ** self.rng.uniform(-1, 1)
        if kind == "sine":
            offset = amplitude * float(self.rng.choice([0.0, 0.0, 1.0]))
            return {"kind": "sine_base" if base else "sine_force", "amplitude": amplitude, "frequency": frequency,
                    "offset": offset}  # fmt: skip
        if kind == "step":
            return {"kind": "step_force", "amplitude": amplitude, "duration": length,
                    "rise_time": float(self.rng.choice([0.0, 0.1])) / frequency}  # fmt: skip
        if kind == "multisine":
            return {"kind": "multisine", "amplitudes": [amplitude, 0.5 * amplitude],
                    "frequencies": [frequency, frequency * float(self.rng.choice([1.5, 2.0, 3.0]))],
                    "phases": [0.0, 1.0], "duration": 20 / frequency}  # fmt: skip
        band = [0.5 * frequency, 2.0 * frequency]
        return {"kind": "random_base" if base else "random_force", "psd": amplitude**2 / (band[1] - band[0]),
                "band": band, "duration": length, "seed": int(self.rng.integers(1000))}  # fmt: skip

    def _campaign_of(
        self, tables: Tables, records: tuple[BenchRecord, ...]
    ) -> tuple[Tables, dict[str, Columns], Tables]:
        truth = tables["transducer"]
        spread = float(self.rng.choice([0.0, 0.05] if self.healthy else [0.0, 0.1, 0.3, 0.6]))
        nominal = self._nominal(truth, spread)
        noise = 10 ** self.rng.uniform(-4, -2) if self.healthy else 10 ** self.rng.uniform(-6, -0.5)
        files: dict[str, Columns] = {}
        entries = []
        peaks: dict[str, float] = {}
        for record in records:
            for name, values in record.columns.items():
                if name != COLUMNS["time"]:
                    peaks[name] = max(peaks.get(name, 0.0), float(np.abs(values).max()))
        for record in records:
            columns = self._sensed(record, noise, peaks)
            files[f"{record.name}.csv"] = columns
            label = record.label
            shunt = {"kind": label.kind, **component_table(label)}
            load = {"load_resistance": shunt["resistance"]} if label.kind == "resistor" else {"shunt": shunt}
            drive = "base_acceleration" if record.setup.excitation.base else "force"
            entries.append({"file": f"{record.name}.csv", "drive": drive, **load})
            if self.chance(0.3) and record.setup.excitation.period and not self.healthy:
                self._as_periodic(entries[-1], record.setup.excitation.period, columns)
        if len(entries) > 1 and self.chance(0.7):
            entries[-1]["role"] = "validate"
        campaign: Tables = {"title": "torture", "transducer": nominal, "records": entries}
        for kind in BESIDE:
            if not self.healthy and self.chance(0.15):
                entry, columns = self._of_frequency(kind, truth, noise)
                campaign["records"].append(entry)
                files[entry["file"]] = columns
        return campaign, files, truth

    def _nominal(self, truth: Tables, spread: float) -> Tables:
        """What the file says of the specimen: the truth but for errors; a film may say that its inertia is unknown."""
        names = ("mass", "damping", "stiffness", "coupling", "capacitance")
        found = {name: truth[name] * math.exp(spread * self.rng.standard_normal()) for name in names}
        for name in ("hysteresis", "modes"):
            if name in truth and (self.healthy or self.chance(0.8)):
                found[name] = truth[name]
        if not self.healthy and self.chance(0.1):
            found |= {"mass": "unknown", "damping": "unknown"}
        return found

    def _sensed(self, record: BenchRecord, noise: float, peaks: dict[str, float]) -> Columns:
        """Samples of sensors that suit what is measured: their noise is a share of the largest value."""
        time = record.columns[COLUMNS["time"]]
        found: Columns = {COLUMNS["time"]: time}
        for name, column in COLUMNS.items():
            if column not in record.columns or name == "time":
                continue
            true = np.asarray(record.waves.sensed(name))
            if name == "gate":
                found[column] = record.columns[column]
                continue
            largest = peaks[column] = max(float(np.abs(true).max()), 1e-9 * peaks.get(column, 0.0))
            found[column] = true + noise * largest * self.rng.standard_normal(len(true))
        drives = {COLUMNS["force"], COLUMNS["base_acceleration"]}
        for column in list(found):
            if column != COLUMNS["time"] and column not in drives and self.chance(0.1 if self.healthy else 0.3):
                del found[column]
        if len(found) < 3 and COLUMNS["voltage"] in record.columns:
            true = np.asarray(record.waves.sensed("voltage"))
            found[COLUMNS["voltage"]] = true + noise * np.abs(true).max() * self.rng.standard_normal(len(true))
        return found

    def _as_periodic(self, entry: Tables, period: float, columns: Columns) -> None:
        """Keep the last periods, as of a record in steady state."""
        time = columns[COLUMNS["time"]]
        count = round(self.rng.integers(1, 6) * period / (time[1] - time[0]))
        if 8 < count < len(time):
            for name in columns:
                columns[name] = columns[name][-count:]
            entry |= {"kind": "periodic"}
            if self.chance(0.5):
                entry |= {"frequency": 1.0 / period}

    def _of_frequency(self, kind: str, truth: Tables, noise: float) -> tuple[Tables, Columns]:
        """A frequency response or an impedance of the first mode, in closed form."""
        frequency = self.resonances[0] * np.linspace(0.5, 1.6, int(self.rng.choice([3, 30, 300])))
        rate = 2j * np.pi * frequency
        coupling, capacitance = truth["coupling"], truth["capacitance"]
        inertia = truth["mass"] * rate**2 + rate * truth["damping"] + truth["stiffness"]
        if kind == "impedance":
            response = 1.0 / (rate * (capacitance + coupling**2 / inertia))
            entry = {"file": "leads.csv", "kind": kind}
        else:
            resistance = self.about(self.sizes["ohm"])
            ratio = -rate * coupling / (1.0 / resistance + rate * capacitance)  # voltage over displacement
            response = 1.0 / (inertia - coupling * ratio)
            output = str(self.rng.choice(["displacement", "voltage", "velocity"]))
            response = response * {"displacement": 1.0, "voltage": ratio, "velocity": rate}[output]
            entry = {"file": "frf.csv", "kind": kind, "output": output, "load_resistance": resistance}
        size = noise * np.abs(response).mean()
        noisy = response + size * (self.rng.standard_normal(len(rate)) + 1j * self.rng.standard_normal(len(rate)))
        names = ("real", "imaginary") if kind == "frf" else ("resistance_ohm", "reactance_ohm")
        return entry, {"frequency_Hz": frequency, names[0]: noisy.real, names[1]: noisy.imag}
