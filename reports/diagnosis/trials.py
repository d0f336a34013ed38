"""One trial: a random specimen with random effects on the virtual bench, measured, and diagnosed from its files."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from piezoharvest.bench import measure, write_campaign
from piezoharvest.bench.measuring import BenchCampaign
from piezoharvest.description.effects import Effect, registered
from piezoharvest.description.transducer import Transducer
from piezoharvest.diagnose import Diagnosis, diagnose
from piezoharvest.predict.parameters import value_at
from piezoharvest.records import load_campaign
from piezoharvest.records.campaign import Campaign
from piezoharvest.records.reading.channels import COLUMNS
from piezoharvest.study import Study, load_study
from reports.diagnosis.foreign import faulty
from reports.identification.specimens import specimen

STUDY = Path(__file__).parents[2] / "designs" / "paper_campaign" / "study.toml"
IDEAL = Path(__file__).parent / "ideal.toml"
OFF = 0.15  # largest relative error of a nominal value
CHANNELS = ("displacement", "voltage", "current")
NOISE = {"displacement": 1.5e-8, "voltage": 1.5e-3, "current": 3.5e-8}  # of the bench's sensors
GAIN = 0.5  # of the buffer before the converter
SAMPLES = 60_000  # that are fitted
LOADS = (51.43e3, 97.78e3, 143.8e3)

Draw = Callable[[np.random.Generator, float], dict[str, Any]]


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice((-1.0, 1.0)))


def _time(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


# Parameters of each effect at a size in units of ten sigma; sizes are rough, what was reached is measured.
DRAWS: dict[str, Draw] = {
    "leakage": lambda rng, s: {"resistance": 9e7 / s},
    "dielectric_relaxation": lambda rng, s: {"capacitance": 4e-9 * s, "time_constant": _time(rng, 0.1, 3.0)},
    "voltage_dependent_capacitance": lambda rng, s: {"beta": _sign(rng) * 3.9e-5 * s},
    "creep": lambda rng, s: {"compliance_ratio": 8e-4 * s, "time_constant": _time(rng, 0.1, 3.0)},
    "stiffening": lambda rng, s: {"cubic_stiffness": _sign(rng) * 2e16 * s},
    "contact_compliance": lambda rng, s: {
        "coefficient": 5e-10 * s,
        "tension": str(rng.choice(("open", "closed"))),
    },
    "friction": lambda rng, s: {"stiffness": 3.7e5 * s, "threshold": _time(rng, 1e-7, 6e-7)},
    "nonlinear_coupling": lambda rng, s: {"quadratic_coupling": _sign(rng) * 1.7e3 * s},
    "coupling_drift": lambda rng, s: {"relative_drift": _sign(rng) * 3.8e-4 * s},
    "bias_current": lambda rng, s: {"current": _sign(rng) * 6.3e-10 * s},
    "displacement_lag": lambda rng, s: {"time_constant": 4e-5 * s},
    "channel_skew": lambda rng, s: {"delay": 4.5e-5 * s},
    "load_error": lambda rng, s: {"relative_error": _sign(rng) * 1.5e-4 * s, **_label(rng)},
    "mains_hum": lambda rng, s: _hum(rng, s),
    "clipping": lambda rng, s: {"limit": 10.0 * s, "channel": str(rng.choice(CHANNELS))},
}


def _label(rng: np.random.Generator) -> dict[str, float]:
    label = rng.choice((None, *LOADS))
    return {} if label is None else {"resistance": float(label)}


def _hum(rng: np.random.Generator, size: float) -> dict[str, Any]:
    channel = str(rng.choice(CHANNELS))
    frequency = float(rng.choice((50.0, 60.0)) + rng.uniform(-0.05, 0.05))
    amplitude = 10.0 * size * NOISE[channel] / np.sqrt(SAMPLES / 2)
    return {"amplitude": float(amplitude), "frequency": frequency, "channel": channel}


@dataclass(frozen=True)
class Trial:
    """What is to be tried.

    Attributes
    ----------
    kind : "healthy", "single", "pair", "withheld", "foreign", "ideal" or "weak"
        Withheld: the effect is not in the library. Foreign: a fault that is not in the vocabulary. Ideal: a campaign of
        steps without a rise and a multisine, with one effect or none. Weak: for the power curve.
    names : tuple of str
        Effects on the bench, or the fault.
    sigma : float
        Size aimed at.
    seed : int
        Of the specimen, the effects' parameters and the noise.
    """

    kind: str
    names: tuple[str, ...]
    sigma: float
    seed: int

    @property
    def key(self) -> str:
        """Unique name."""
        return f"{self.kind} {'+'.join(self.names)} {self.sigma:g} {self.seed}"


@cache
def _study(path: Path) -> Study:
    return load_study(path)


def effects_of(trial: Trial) -> dict[str, dict[str, Any]]:
    """Tables of the effects on the bench; of clipping the size stands where its limit will."""
    if trial.kind == "foreign":
        return {}
    return {
        name: DRAWS[name](np.random.default_rng([trial.seed, n, 11]), trial.sigma / 10.0)
        for n, name in enumerate(trial.names)
    }


def bench_of(trial: Trial) -> tuple[BenchCampaign, Transducer, dict[str, dict[str, Any]]]:
    """Measure a trial: what the bench has, the specimen, and the effects' parameters."""
    study = _study(IDEAL if trial.kind == "ideal" else STUDY)
    truth = specimen(study.transducer, trial.seed, OFF)
    tables = effects_of(trial)
    # Some specimens come to 12 V, where a converter of 10 V would really clip: a second effect that nobody put there.
    bench = {**study.bench, "seed": trial.seed, "nominal_error": 0.0, "buffer": {"gain": GAIN}}
    if "clipping" in tables:
        rest = {name: table for name, table in tables.items() if name != "clipping"}
        free = measure(replace(study, transducer=truth, bench={**bench, "effects": rest}))
        tables["clipping"]["limit"] = _limit(free, **tables["clipping"])
    measured = measure(replace(study, transducer=truth, bench={**bench, "effects": tables}))
    if trial.kind == "foreign":
        measured = faulty(measured, trial.names[0], trial.sigma, NOISE)
    return replace(measured, nominal=study.transducer), truth, tables


def _limit(measured: BenchCampaign, limit: float, channel: str) -> float:
    """Limit that changes the fitted samples of a channel by so many sigma."""
    fitted = [record for record in measured.records if record.setup.role == "fit"]
    values = np.abs(np.concatenate([record.columns[COLUMNS[channel]] for record in fitted]))
    low, high = 0.5 * float(values.max()), float(values.max())
    for _ in range(50):
        middle = 0.5 * (low + high)
        lost = np.linalg.norm(np.maximum(values - middle, 0.0)) / NOISE[channel]
        low, high = (middle, high) if lost > limit else (low, middle)
    return low


# Of a held-out trial; an error is no answer.
KEPT = ("key", "kind", "names", "sigma", "seed", "diagnosed", "cpu", "reached", "right", "error")
Bench = Callable[[Trial], tuple[BenchCampaign, Transducer, dict[str, dict[str, Any]]]]
# Pairs of names for one law: withholding one of them withholds neither.
TWINS = {"voltage_reversion": "dielectric_relaxation", "probe_loading": "leakage"}


def library_of(trial: Trial) -> list[type[Effect]]:
    """Effects that the diagnosis of a trial looks for."""
    withheld = {*trial.names, *(TWINS.get(name) for name in trial.names)} if trial.kind == "withheld" else set()
    return [cls for name, cls in registered().items() if name not in withheld]


def read_back(measured: BenchCampaign) -> Campaign:
    """Campaign as it is read from the files that the bench has written."""
    with tempfile.TemporaryDirectory() as folder:
        return load_campaign(write_campaign(measured, Path(folder) / "campaign"))


def run(trial: Trial, bench: Bench = bench_of) -> dict[str, Any]:
    """Measure, write, read and diagnose a trial; what came out beside what stood on the bench."""
    measured, truth, tables = bench(trial)
    campaign = read_back(measured)
    cpu, wall = time.process_time(), time.perf_counter()
    found = diagnose(campaign, library=library_of(trial))
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    return {
        "key": trial.key, **asdict(trial), "diagnosed": datetime.now(UTC).isoformat(timespec="minutes"),
        "truth": tables, "cpu": cpu, "wall": wall, "verdict": found.verdict,
        "found": [named.effect.name for named in found.effects], "alternatives": [list(a) for a in found.alternatives],
        "values": [{k: list(v) for k, v in named.values.items()} for named in found.effects],
        "reached": reached(found, trial.names), "right": right(trial, found.verdict, found),
        "deviations": _deviations(found, truth),
        "left": [[place.where, place.record, place.channel, place.p_value] for place in found.left[:3]],
    }  # fmt: skip


def attempt(trial: Trial, bench: Bench = bench_of) -> dict[str, Any]:
    """Run a trial; what goes wrong is a result too."""
    try:
        with threadpool_limits(1):  # processes share the machine
            return run(trial, bench)
    except Exception as error:
        base = {"key": trial.key, **asdict(trial)}
        return {**base, "verdict": "failed", "right": False, "found": [], "error": f"{type(error).__name__}: {error}"}


def kept(result: dict[str, Any]) -> dict[str, Any]:
    """What is kept of a held-out trial: whether it is answered right, not the answer."""
    return {key: result[key] for key in KEPT if key in result}


def held_out(trial: Trial) -> dict[str, Any]:
    """Run a held-out trial with all thresholds as they are."""
    return kept(attempt(trial))


def right(trial: Trial, verdict: str, found: Diagnosis) -> bool:
    """Whether exactly the effects that are there were named, or are among what is said to be alike."""
    names = {named.effect.name for named in found.effects}
    if trial.kind == "withheld":
        return verdict in ("unexplained", "ambiguous")
    if trial.kind == "foreign":
        return verdict == "unexplained"
    if not trial.names:
        return verdict == "adequate"
    if verdict == "ambiguous":
        return any(set(names_) == set(trial.names) for names_ in (names, *found.alternatives))
    return verdict == "effect" and names == set(trial.names)


def reached(found: Diagnosis, names: Sequence[str]) -> float | None:
    """Size of the effects in sigma: the root of what their full fit, or else their score, takes off -2 ln L.

    A sigma of one effect that was fitted is what its strength scatters by, with what rounded sensors add.
    """
    mine = [made for made in found.search.fits if sorted(made.names.split(" + ")) == sorted(names)]
    gains = [-made.change / (made.variance_inflation if len(names) == 1 else 1.0) for made in mine]
    if len(names) == 1 and not gains:
        gains = [candidate.score for candidate in found.search.first if candidate.name == names[0]]
    return float(np.sqrt(max(0.0, *gains))) if gains else None


def _deviations(found: Diagnosis, truth: Transducer) -> Mapping[str, float]:
    """Differences of what was determined from the truth, in its standard errors."""
    return {
        e.parameter.name: (e.value - float(value_at(truth, e.parameter.path))) / e.std
        for e in found.estimates
        if e.identifiable and e.std
    }
