"""A trial's campaign: specimen, drives and law drawn from its seed, the law of the size aimed at, noise, and files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.output import write_table, write_text
from reports.discovery.equations import Drive, Law, Reading, Specimen, read, true_channels
from reports.discovery.laws import SHARP, Drawn, draw

OFF = 0.05  # largest relative error of a nominal value
PARAMETERS = ("mass", "damping", "stiffness", "coupling", "capacitance")
COLUMNS = {"force": "force_N", "displacement": "displacement_m", "voltage": "voltage_V", "current": "current_A"}
CHANNELS = ("displacement", "voltage", "current")  # with noise; the drive is exact
ROLES = ("fit", "fit", "validate", "unseen")  # the last is no part of the campaign: by it all are judged
FILES = tuple(f"r{n}.csv" for n in range(len(ROLES)))
FITTED = tuple(file for file, role in zip(FILES, ROLES, strict=True) if role == "fit")
UNSEEN = FILES[ROLES.index("unseen")]
STEP = 1e-5  # relative, of a parameter, for derivatives of the channels
REACHED = 0.05  # relative error of a size
MOST = 300.0  # times the first strength, a thousandth of what there is: more is another device
NAMED = 40.0  # sigma of the named effect of a pair
PRECISE, QUIETER = 1e4, 20.0  # sigma from which on sensors have so much less noise: laws stay small beside the device
UNVISITED = 1.5  # of the largest input: where a knee begins that no record comes to


class Kind(NamedTuple):
    """A kind of specimen: nominal values, noise of its sensors, samples a second, seconds, and how it is integrated."""

    nominal: Specimen
    noise: Mapping[str, float]
    rate: float
    duration: float
    stiff: bool


KINDS = {
    "stack": Kind(
        Specimen(0.0158, 1250.0, 3.125e8, 7.822, 3.2e-6),
        {"displacement": 1.2e-8, "voltage": 1.5e-3, "current": 2e-8}, 500.0, 1.5, stiff=True,
    ),
    "beam": Kind(
        Specimen(0.010, 0.0628, 986.96, 1e-3, 40e-9),
        {"displacement": 1e-7, "voltage": 3e-3, "current": 3e-8}, 2000.0, 0.6, stiff=False,
    ),
}  # fmt: skip
# Where a law acts, and what it is a function of.
Site = tuple[str, str]
READINGS: tuple[Site, ...] = (
    ("reading.displacement", "displacement"), ("reading.voltage", "voltage"), ("reading.current", "current"),
    ("reading.displacement", "force"), ("reading.voltage", "displacement"), ("reading.displacement", "time"),
    ("parameter.stiffness", "time"), ("parameter.damping", "time"),
)  # fmt: skip
SITES: dict[str, tuple[Site, ...]] = {
    "spring": (("spring", "displacement"),),
    "damper": (("damper", "velocity"),),
    "electrodes": (("electrodes", "voltage"),),
    "load": (("load", "voltage"),),
    "charge": (("capacitor", "voltage"), ("coupling", "displacement")),
    "reading": READINGS,
}
BENT = ("spring", "damper", "capacitor", "coupling")  # a straight line there is a parameter of the model
OWN = {"spring": "stiffness", "damper": "damping", "capacitor": "capacitance", "coupling": "coupling"}
PORTS = ("damper", "electrodes", "load")  # where a law must not give energy
MOVING = ("damper", "coupling", "parameter.damping", "parameter.stiffness")  # shown by a structure in resonance only
NAMES = ("leakage", "bias_current", "stiffening", "load_error")  # of the effect in a pair
IMPOSSIBLE = ("aliasing", "unvisited", "bursts", "two inputs")


@dataclass(frozen=True)
class Trial:
    """What is to be tried.

    Attributes
    ----------
    kind : "law", "healthy", "pair" or "impossible"
    law, place : str
        Keys of `LAWS` and `SITES`; what is impossible replaces the law.
    sigma : float
        Size aimed at: the change of the fitted samples that no parameter takes, in standard deviations of the noise.
    seed : int
    """

    kind: str
    law: str = ""
    place: str = ""
    sigma: float = 0.0
    seed: int = 0

    @property
    def key(self) -> str:
        """Unique name."""
        return " ".join(map(str, asdict(self).values()))


def named(trial: Trial) -> str:
    """The named effect of a pair; stiffening is a law of the spring itself."""
    names = [name for name in NAMES if (name, trial.place) != ("stiffening", "spring")]
    return names[trial.seed % len(names)]


@dataclass(frozen=True, eq=False)
class Made:
    """A campaign with its truth: `drawn` in units of `size` of the input and of `strength`."""

    trial: Trial
    kind: Kind
    specimen: Specimen
    records: tuple[tuple[Drive, float], ...]
    site: Site | None = None
    drawn: Drawn | None = None
    size: float = 1.0
    strength: float = 0.0

    def law(self, x: np.ndarray) -> np.ndarray:
        """The law in SI units."""
        assert self.drawn is not None
        return self.strength * self.drawn.of(np.asarray(x) / self.size)


def _site(trial: Trial, rng: np.random.Generator) -> Site:
    sites = SITES[trial.place]
    if trial.law == "backlash":  # has a memory: of what a sensor is moved by
        sites = READINGS[:5]
    if trial.law in SHARP:  # a corner of the charge over x would be a jump of the force
        sites = tuple(site for site in sites if site[0] != "coupling")
    return sites[int(rng.integers(len(sites)))]


def _kind(site: Site | None, rng: np.random.Generator) -> str:
    moving = site is not None and site[0] in MOVING
    return "beam" if moving or rng.random() < 0.5 else "stack"


def _records(kind: str, rng: np.random.Generator) -> tuple[tuple[Drive, float], ...]:
    about = lambda *values: tuple(float(v * rng.uniform(0.9, 1.1)) for v in values)  # noqa: E731
    if kind == "stack":
        loads = about(97.8e3, 51.4e3)
        return (
            (Drive(about(450.0), about(4.0), 550.0), loads[0]),
            (Drive(about(300.0, 130.0), about(3.0, 7.3), 500.0), loads[1]),
            (Drive(about(350.0), about(5.0), 450.0), loads[0]),
            (Drive(about(250.0, 150.0), about(2.5, 6.1), 500.0), loads[1]),
        )
    near = lambda *values: tuple(float(v + rng.uniform(-0.5, 0.5)) for v in values)  # noqa: E731
    loads = about(1e5, 4e4)
    return (
        (Drive(about(0.02, 0.01), near(48.0, 53.0)), loads[0]),
        (Drive(about(0.03), near(50.6)), loads[1]),
        (Drive(about(0.02, 0.008), near(50.0, 46.0)), loads[0]),
        (Drive(about(0.018, 0.012), near(49.0, 51.5)), loads[1]),
    )


def _specimen(nominal: Specimen, rng: np.random.Generator) -> Specimen:
    return replace(nominal, **{name: getattr(nominal, name) * rng.uniform(1 - OFF, 1 + OFF) for name in PARAMETERS})


def channels(on: Specimen, made: Made) -> list[dict[str, np.ndarray]]:
    """Channels of all records as ideal sensors show them."""
    kind = made.kind
    return [
        read(on, true_channels(on, drive, load, kind.duration, kind.rate, stiff=kind.stiff))
        for drive, load in made.records
    ]


def _white(runs: Sequence[Mapping[str, np.ndarray]], noise: Mapping[str, float]) -> np.ndarray:
    """Samples in units of the noise."""
    return np.concatenate([run[name] / noise[name] for run in runs for name in CHANNELS])


class UnreachableError(ArithmeticError):
    """No strength that leaves the device what it is has the size aimed at."""


class Sizes:
    """Sizes of changes in sigma: what is left of them beside the parameters and the zeros of the displacement."""

    def __init__(self, made: Made) -> None:
        made = replace(made, records=made.records[: ROLES.count("fit")])
        self.made, noise = made, made.kind.noise
        self.runs = channels(made.specimen, made)
        self.healthy = _white(self.runs, noise)
        columns = []
        for name in PARAMETERS:
            moved = replace(made.specimen, **{name: getattr(made.specimen, name) * (1 + STEP)})
            columns.append(_white(channels(moved, made), noise) - self.healthy)
        for n in range(ROLES.count("fit")):
            zero = [{name: np.full(len(run[name]), float(name == "displacement" and k == n)) for name in CHANNELS}
                    for k, run in enumerate(self.runs)]  # fmt: skip
            columns.append(_white(zero, dict.fromkeys(CHANNELS, 1.0)))
        columns = [column / np.linalg.norm(column) for column in columns]
        self.basis, _ = np.linalg.qr(np.column_stack(columns))

    def of(self, on: Specimen) -> float:
        """Size of what distinguishes a specimen from the healthy one."""
        change = _white(channels(on, self.made), self.made.kind.noise) - self.healthy
        return float(np.linalg.norm(change - self.basis @ (self.basis.T @ change)))

    def strength(self, family: Callable[[float], Specimen], first: float, sigma: float) -> float:
        """Strength at which a family has a size, by the secant; about in proportion to it."""
        strength = first
        for _ in range(12):
            found = self.of(family(strength))
            if abs(found / sigma - 1.0) < REACHED:
                return strength
            strength *= float(np.clip(sigma / found, 1e-6, 30.0))
            if strength > MOST * first:
                break
        raise UnreachableError(f"no strength has the size {sigma:g}")


def with_law(on: Specimen, site: Site, law: Law, size: float, slack: float = 0.0) -> Specimen:
    """A specimen with a law (SI units) at a site."""
    place, of = site
    if place.startswith("reading."):
        made = Reading(place.removeprefix("reading."), of, law, slack)
        return replace(on, readings=(*on.readings, made))
    return replace(on, laws={**on.laws, place: law}, sizes={**on.sizes, place: size})


def make(trial: Trial) -> Made:
    """Everything of a trial but its noise."""
    rng = np.random.default_rng([trial.seed, 31])
    site = _site(trial, rng) if trial.kind in ("law", "pair") else None
    name = _kind(site, rng) if trial.law != "aliasing" else "beam"
    kind = KINDS[name]
    if trial.sigma >= PRECISE:
        kind = kind._replace(noise={channel: sigma / QUIETER for channel, sigma in kind.noise.items()})
    made = Made(trial, kind, _specimen(kind.nominal, rng), _records(name, rng))
    if trial.kind == "healthy":
        return made
    sizes = Sizes(made)
    if trial.kind == "impossible":
        return _aliased(made) if trial.law == "aliasing" else replace(made, specimen=_impossible(made, sizes, rng))
    assert site is not None
    if trial.kind == "pair":
        made = replace(made, specimen=_named(named(trial), made.specimen, sizes))
    return _with_law(made, site, sizes)


def drawn_of(trial: Trial) -> Drawn:
    """The law of a trial, drawn from its seed."""
    passive = _site(trial, np.random.default_rng([trial.seed, 31]))[0] in PORTS
    return draw(trial.law, np.random.default_rng([trial.seed, 33]), passive=passive)


def input_of(site: Site, runs: Sequence[Mapping[str, np.ndarray]]) -> np.ndarray:
    """Inputs of a law in records."""
    name = "displacement_rate" if site[1] == "velocity" else site[1]
    return np.concatenate([run[name] for run in runs])


def _with_law(made: Made, site: Site, sizes: Sizes) -> Made:
    """The law drawn, and as strong as the trial wants it beside what else is there."""
    size = float(np.abs(input_of(site, sizes.runs)).max())
    drawn = drawn_of(made.trial)
    slack = (drawn.slack or 0.0) * size

    def family(strength: float, on: Specimen) -> Specimen:
        return with_law(on, site, lambda x: strength * drawn.of(x / size), size, slack)

    healthy = sizes.made.specimen
    strength = sizes.strength(lambda s: family(s, healthy), _first(site, healthy, sizes, size), made.trial.sigma)
    return replace(made, specimen=family(strength, made.specimen), site=site, drawn=drawn, size=size, strength=strength)


def _first(site: Site, on: Specimen, sizes: Sizes, size: float) -> float:
    """A strength to begin with: a thousandth of what there is at the site."""
    place = site[0]
    if place.startswith("reading."):
        return 1e-3 * max(float(np.abs(run[place.removeprefix("reading.")]).max()) for run in sizes.runs)
    load = min(load for _, load in sizes.made.records)
    return 1e-3 * {
        "spring": on.stiffness * size, "damper": on.damping * size, "electrodes": size / load, "load": size / load,
        "capacitor": on.capacitance * size, "coupling": on.coupling * size,
    }.get(place, 1.0)  # fmt: skip


def _named(name: str, on: Specimen, sizes: Sizes) -> Specimen:
    """A specimen with a named effect, written anew."""
    largest = {of: max(float(np.abs(run[of]).max()) for run in sizes.runs) for of in ("displacement", "current")}
    families: dict[str, Callable[[float], Specimen]] = {
        "leakage": lambda s: replace(on, laws={"leaving": lambda v: s * v}),
        "bias_current": lambda s: replace(on, laws={"leaving": lambda v: -s + 0.0 * v}),
        "stiffening": lambda s: replace(on, laws={"spring": lambda x: s * x**3}),
        "load_error": lambda s: replace(on, load_error=s),
    }
    first = {
        "leakage": 1e-9, "bias_current": 1e-3 * largest["current"],
        "stiffening": 1e-3 * on.stiffness / largest["displacement"] ** 2, "load_error": 1e-3,
    }  # fmt: skip
    return families[name](sizes.strength(families[name], first[name], NAMED))


def _impossible(made: Made, sizes: Sizes, rng: np.random.Generator) -> Specimen:
    """A specimen with what no law of one input is, or what the records do not show."""
    on, sigma = made.specimen, made.trial.sigma
    if made.trial.law == "unvisited":
        knee = UNVISITED * float(np.abs(input_of(("load", "voltage"), channels(on, made))).max())
        return with_law(on, ("load", "voltage"), lambda v: 1e-4 * np.sign(v) * np.maximum(np.abs(v) - knee, 0.0), knee)
    x, u, v = (np.abs(input_of(("", name), sizes.runs)).max() for name in ("displacement", "velocity", "voltage"))
    if made.trial.law == "bursts":  # at other times in each record
        family = lambda s: replace(on, readings=(Bursts("voltage", s, rng.bit_generator.seed_seq),))  # noqa: E731
        return family(sizes.strength(family, 1e-3 * v, sigma))
    family = lambda s: replace(on, product=lambda x, u: s * x * x * u)  # noqa: E731
    return family(sizes.strength(family, 1e-3 * on.stiffness / (x * u), sigma))


@dataclass(frozen=True)
class Bursts:
    """A disturbance of a reading that comes and goes by itself, thirty times in a record."""

    channel: str
    size: float
    seed: Any

    def added(self, true: Mapping[str, np.ndarray]) -> np.ndarray:
        """What it adds, by chance, but the same for the same record."""
        begun = int(1e6 * abs(true["force_rate"][0])) % 2**31
        levels = np.random.default_rng([*self.seed.entropy, begun]).standard_normal(30)
        return self.size * np.repeat(levels, -(-len(true["force"]) // 30))[: len(true["force"])]


def _aliased(made: Made) -> Made:
    """A drive above half the sample rate, which the load cell shows as one below."""
    above = 0.03 * made.kind.rate - made.kind.rate
    return replace(made, records=tuple(
        (Drive((*drive.amplitudes, 0.3 * drive.amplitudes[0]), (*drive.frequencies, -above), drive.offset), load)
        for drive, load in made.records
    ))  # fmt: skip


def noise_of(made: Made, n: int) -> dict[str, np.ndarray]:
    """The noise that the sensors add to the n-th record."""
    rng, count = np.random.default_rng([made.trial.seed, 32, n]), round(made.kind.rate * made.kind.duration)
    return {name: made.kind.noise[name] * rng.standard_normal(count) for name in CHANNELS}


def write(made: Made, folder: Path) -> tuple[Path, Path]:
    """Write the files of a campaign, noise added; its nominal values are off.

    Returns
    -------
    Path
        The campaign.
    Path
        The same with the record that is no part of it.
    """
    kind = made.kind
    text = ["[transducer]", *(f"{name} = {getattr(kind.nominal, name)!r}" for name in PARAMETERS)]
    for n, ((_, load), shown) in enumerate(zip(made.records, channels(made.specimen, made), strict=True)):
        noise = noise_of(made, n)
        noisy = {name: shown[name] + noise[name] if name in noise else shown[name] for name in COLUMNS}
        times = np.arange(len(shown["force"])) / kind.rate
        write_table({"time_s": times, **{COLUMNS[name]: noisy[name] for name in COLUMNS}}, folder / FILES[n])
        if ROLES[n] == "unseen":
            write_text("\n".join(text) + "\n", folder / "campaign.toml")
        role = "fit" if ROLES[n] == "fit" else "validate"
        text += ["[[records]]", f'file = "{FILES[n]}"', f'role = "{role}"', f"load_resistance = {load!r}"]
    write_text("\n".join(text) + "\n", folder / "all.toml")
    return folder / "campaign.toml", folder / "all.toml"


def truth(made: Made) -> dict[str, Any]:
    """What is kept of it beside a result."""
    if made.drawn is None or made.site is None:
        return {}
    return {
        "site": list(made.site), "text": made.drawn.text, "form": made.drawn.form, "exponent": made.drawn.exponent,
        "size": made.size, "strength": made.strength, "slack": (made.drawn.slack or 0.0) * made.size,
        "stiff": made.kind.stiff,
    }  # fmt: skip
