"""Study files: TOML tables to a transducer, an excitation and shunts."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.description import excitation
from piezoharvest.description.excitation import Excitation
from piezoharvest.description.limits import check_size
from piezoharvest.description.modes_file import check_base
from piezoharvest.description.parameters import Component, ParameterError
from piezoharvest.description.paths import quantity_at
from piezoharvest.description.shunts import Shunt
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.notebook import Shown
from piezoharvest.study.building import build, build_excitation, build_list, build_shunt, in_si, unit_of
from piezoharvest.study.options import FREE, SYNTHESISED, DesignOptions, SweepOptions
from piezoharvest.study.toml_file import StudyError, check_kind_of_file, read_toml
from piezoharvest.study.transducers import transducer_of
from piezoharvest.study.words import typed, unknown

_NEEDED = {
    "transducer": "table [transducer]",
    "excitation": "table [excitation]",
    "shunts": "tables [[shunts]], at least one is needed",
}

_TABLES = ("title", *_NEEDED, "design", "sweep", "bench")


@dataclass(frozen=True, kw_only=True, repr=False)
class Study(Shown):
    """One transducer, one excitation and the shunts to compare.

    Attributes
    ----------
    shunts : tuple of Shunt
        Empty only with a table [design], which adds its own candidates.
    path : Path
        The file; of a study made in Python a name for reports and messages.
    bench : mapping
        The table [bench] as in the file; empty if there is none.
    free_frequency : bool
        True if the design finds the frequency of the excitation, a sine, in the band of [design]; what the excitation
        has is then of no account. In a file: frequency = "free".
    specimen : Path or None
        The specimen file that the transducer was read from.

    Raises
    ------
    ParameterError
        A free frequency has nothing to be searched in, or for.
    """

    title: str = ""
    transducer: Transducer
    excitation: Excitation
    shunts: tuple[Shunt, ...] = ()
    path: Path = Path("study")
    design: DesignOptions | None = None
    sweep: SweepOptions | None = None
    bench: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    free_frequency: bool = False
    specimen: Path | None = None

    def __post_init__(self) -> None:
        if self.free_frequency:
            _check_free_frequency(self.excitation, self.design)

    @property
    def heading(self) -> str:
        """Its title or file, the transducer, the kind of excitation, how many shunts, and what else is to be done."""
        name = self.transducer.name or "transducer"
        more = [table for table in ("design", "sweep") if getattr(self, table) is not None]
        parts = (self.title or str(self.path), name, self.excitation.kind, counted(len(self.shunts), "shunt"), *more)
        return ", ".join(parts)

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The transducer, the excitation and the shunts, one a row, with their values."""
        found = [{"part": "transducer", "kind": "", "values": self.transducer.heading}]
        numbers = ((f"shunts.{n}", shunt) for n, shunt in enumerate(self.shunts))
        for part, component in (("excitation", self.excitation), *numbers):
            found.append({"part": part, "kind": component.kind, "values": _values(component)})
        return found

    @property
    def systems(self) -> tuple[System, ...]:
        """The transducer with each of the shunts."""
        return tuple(System(self.transducer, shunt) for shunt in self.shunts)


def _values(component: Component) -> str:
    """The numbers of a component that are not its defaults, with units, in a line; how many where there are several."""
    found = []
    for field in dataclasses.fields(component):
        value = getattr(component, field.name)
        if "unit" not in field.metadata or value is None or (np.size(value) == 1 and value == field.default):
            continue
        number = f"{float(value):.4g}" if np.size(value) == 1 else counted(np.size(value), "value")
        found.append(f"{field.name} {number} {unit_of(type(component), field)}".rstrip())
    return ", ".join(found)


def _check_free_frequency(driven: Excitation, design: DesignOptions | None) -> None:
    """Raise `ParameterError` if a free frequency has nothing to be sought in, or for."""
    given = f"excitation.frequency = {FREE!r}"
    if not hasattr(driven, "frequency"):
        raise ParameterError("excitation.kind", f"found {driven.kind!r}, must be a sine where the frequency is free")
    if design is None:
        raise ParameterError("excitation.frequency", f"found {FREE!r} without a table [design], whose band is searched")
    if design.band is None:
        raise ParameterError("design.band", f"missing key, {given} needs [lower, upper] (Hz) to be searched")
    if design.objective != "harvest":
        why = "vibration is least where nothing resonates"
        raise ParameterError(
            "design.objective", f"found {design.objective!r}, must be 'harvest' with {given}, as {why}"
        )
    if SYNTHESISED in (design.candidates or ()):
        why = "at its own best frequency an RL circuit draws all the power that a passive network can"
        raise ParameterError(
            "design.candidates", f"found {SYNTHESISED!r}, allowed with {given} are kinds of shunts, as {why}"
        )


def load_study(path: str | Path) -> Study:
    """Read and check a study file.

    Raises
    ------
    StudyError
        The file cannot be read, or something in it is missing, unknown, of the wrong type or not physical.
    """
    path = Path(path)
    try:
        return study_from(read_toml(path), path)
    except ParameterError as error:
        raise StudyError(path, error.key, error.message) from None


def load_driven_study(path: str | Path) -> Study:
    """Read and check a study file whose excitation has a frequency, or needs none.

    Raises
    ------
    StudyError
        As of `load_study`; or the frequency is free.
    """
    study = load_study(path)
    if study.free_frequency:
        found = f"found {FREE!r}, for which only the command design finds a value"
        raise StudyError(path, "excitation.frequency", f"{found}, must be a finite number greater than 0 Hz")
    return study


def study_from(table: Mapping[str, Any], path: Path) -> Study:
    """Build a study from the tables of its file; files that it names are relative to `path`.

    Raises
    ------
    ParameterError
        Something is missing, unknown, of the wrong type or not physical; its key is the path of the key.
    """
    check_kind_of_file(table, "study")
    for key in table:
        if key not in _TABLES:
            raise unknown(key, key, _TABLES, "key")
    for key, wanted in _NEEDED.items():
        if key not in table and not (key == "shunts" and "design" in table):
            raise ParameterError(key, f"missing {wanted}")
    if table.get("shunts") == []:
        raise ParameterError("shunts", "found an empty list, at least one table [[shunts]] is needed")
    design = _build_design(table["design"], path.parent) if "design" in table else None
    driven, free = _with_frequency(table["excitation"], design)
    transducer, specimen = transducer_of(table["transducer"], path.parent)
    drive = build_excitation(driven, path.parent)
    if drive.base:
        try:
            check_base(table["transducer"], transducer.effective_mass, f"excitation.kind = {drive.kind!r}")
        except ParameterError as error:
            raise error.within("transducer") from None
    study = Study(
        title=typed(str, table.get("title", path.stem), "title"),
        transducer=transducer,
        excitation=drive,
        shunts=build_list(table["shunts"], "shunts", partial(build_shunt, transducer=transducer))
        if "shunts" in table
        else (),
        path=path,
        design=design,
        free_frequency=free,
        bench=typed(dict, table.get("bench", {}), "bench"),
        specimen=specimen,
    )
    if "sweep" in table:
        study = dataclasses.replace(study, sweep=build(SweepOptions, _ends_in_si(table["sweep"], study), "sweep"))
    if study.transducer.quasi_static:
        raise ParameterError(
            "transducer.quasi_static", "found true, which is allowed only in a campaign of measured records"
        )
    check_systems(study)
    return study


def check_systems(study: Study) -> None:
    """Raise `ParameterError` if anything is too large, does not fit the excitation or makes the transducer unstable."""
    from piezoharvest.linear import check_stability

    check_size(study.transducer, study.excitation)
    for n, shunt in enumerate(study.shunts):
        try:
            system = System(study.transducer, shunt)
            check_size(study.transducer, study.excitation, shunt)
            shunt.switch(system.electrode.capacitance, study.excitation.period)
            with np.errstate(all="ignore"):
                check_stability(system)
        except ParameterError as error:
            raise error.within(f"shunts.{n}") from None
        except np.linalg.LinAlgError:
            raise ParameterError(
                f"shunts.{n}", "its values are so large or so small that its equations overflow"
            ) from None


def _with_frequency(table: Any, design: DesignOptions | None) -> tuple[Any, bool]:
    """Table of a sine whose free frequency is replaced by the middle of the design's band; True if it was free."""
    if not isinstance(table, dict) or table.get("frequency") != FREE:
        return table, False
    cls = excitation.registered().get(str(table.get("kind")))
    if cls is None or "frequency" not in cls.__dataclass_fields__:
        return table, False  # building it says what is wrong
    middle = sum(design.band) / 2 if design and design.band else 1.0
    return {**table, "frequency": middle}, True


def _ends_in_si(table: Any, study: Study) -> Any:
    """Table [sweep] in which ends as text ("10 kohm") are numbers, in the unit of the value at their path."""
    if not isinstance(table, dict) or not isinstance(table.get("parameters"), list):
        return table  # building it says what is wrong
    return {**table, "parameters": [_end_in_si(each, n, study) for n, each in enumerate(table["parameters"])]}


def _end_in_si(parameter: Any, n: int, study: Study) -> Any:
    """Table of a swept parameter with its ends as numbers, where they are text with a unit."""
    texts = [key for key in ("from", "to") if isinstance(parameter, dict) and isinstance(parameter.get(key), str)]
    if not texts or not isinstance(parameter.get("path"), str):
        return parameter  # building it says what is wrong
    root, _, path = parameter["path"].partition(".")
    try:
        if root == "shunts":
            place, _, path = path.partition(".")
            part: Component = study.shunts[int(place)]
        else:
            part = {"transducer": study.transducer, "excitation": study.excitation}[root]
        field = quantity_at(part, path)[1]
    except (KeyError, IndexError, ValueError):
        parts = {"transducer": study.transducer, "excitation": study.excitation}
        parts |= {f"shunts.{k}": shunt for k, shunt in enumerate(study.shunts)}
        known = [f"{at}.{field.name}" for at, each in parts.items() for field in dataclasses.fields(each)
                 if "unit" in field.metadata]  # fmt: skip
        raise unknown(f"sweep.parameters.{n}.path", parameter["path"], known) from None
    converted = {key: in_si(parameter[key], unit_of(type(part), field), f"sweep.parameters.{n}.{key}") for key in texts}
    return {**parameter, **converted}


def _build_design(table: Any, folder: Path) -> DesignOptions:
    """Goal from its table; a specimen file that its tolerance names is relative to `folder`."""
    options = build(DesignOptions, table, "design")
    if options.tolerance is None or options.tolerance.from_ is None:
        return options
    tolerance = dataclasses.replace(options.tolerance, from_=str(folder / options.tolerance.from_))
    return dataclasses.replace(options, tolerance=tolerance)
