"""Study files: TOML tables, checked by pydantic models that are generated from the components' dataclasses."""

from __future__ import annotations

import dataclasses
import difflib
import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, dataclass
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, Strict, ValidationError, create_model

from piezoharvest.description import catalogue, effects, excitation, shunts
from piezoharvest.description.catalogue.parts import with_parts
from piezoharvest.description.effects import Effect
from piezoharvest.description.effects.nameless.kinds import PARTS, in_a_path, kinds_of
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.excitation import Excitation
from piezoharvest.description.figures import Modal, data_sheet
from piezoharvest.description.limits import check_size
from piezoharvest.description.modes_file import KEY, with_modes
from piezoharvest.description.parameters import Component, ParameterError, allowed, described, quantity
from piezoharvest.description.shunts import Shunt
from piezoharvest.description.system import System
from piezoharvest.description.tolerance import Tolerance
from piezoharvest.description.transducer import Transducer
from piezoharvest.input import InputError, check_readable
from piezoharvest.readers.conversion import with_unit

_T = TypeVar("_T")
_C = TypeVar("_C", bound=Component)
_WORDS: dict[Any, str] = {str: "a string", bool: "true or false", list: "a list of tables", dict: "a table"}
_NEEDED = {
    "transducer": "table [transducer]",
    "excitation": "table [excitation]",
    "shunts": "tables [[shunts]], at least one is needed",
}
FREE = "free"  # in place of the excitation's frequency: the design finds it
SYNTHESISED = "synthesised"  # candidate that is not a kind of shunt: a network that the design makes
_TABLES = ("title", *_NEEDED, "design", "sweep", "bench")
_SPECIMEN_TABLES = (
    "title", "transducer", "standard_errors", "covariance", "not_identifiable", "measurement", "source", "parameters",
)  # fmt: skip
MAX_DESIGNS = 2**30  # of a sweep: the length of a Sobol sequence
MAX_TOML_BYTES = 1 << 22  # bytes: tomllib takes about a second for 2 MB; a study of a thousand lines has 40 kB
# tomllib takes time in proportion to the square of a key's parts: 16 s for 20,000 of them; our tables need few.
_MAX_KEY_PARTS = 100
_LONG_KEY = re.compile(rf"""(?<![\w"'-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{_MAX_KEY_PARTS}}}""")


class StudyError(ValueError):
    """An error in a study file, in one sentence: file, key path, what was found, what is allowed.

    Attributes
    ----------
    path, key, message : str
        The three parts; the key is a dotted path as in "shunts.0.load_resistance", empty for the whole file.
    """

    def __init__(self, path: str | Path, key: str, message: str):
        text = ": ".join(_shortened(part) for part in (str(path), key, message) if part)
        super().__init__("".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text))
        self.path, self.key, self.message = str(path), key, message


@dataclass(frozen=True, kw_only=True)
class DesignOptions(Component):
    """Goal and free choices of a design: the table [design]."""

    objective: Literal["harvest", "damping", "trade_off"] = described(
        "what is wanted: power, little vibration, or the front between both", default="harvest"
    )
    band: tuple[float, float] | None = quantity("Hz", "lower and upper edge of the band", default=None, above=0)
    candidates: tuple[str, ...] | None = described(
        'kinds of shunts to compare, and "synthesised", a network that the design makes; default: for the objective',
        default=None,
    )
    phase_lag: Literal["free", "fixed"] | None = described(
        "lag of switches: tuned, or as given; default: free for harvest, else fixed", default=None
    )
    hold: tuple[str, ...] = described("keys of the shunts that keep their values", default=())
    tune: tuple[Literal["on_time_error", "inductance", "smoothing_capacitance"], ...] = described(
        "keys of switched shunts that are tuned besides", default=()
    )
    order: int | None = quantity(
        "", "coils and capacitors of the synthesised network, at most", default=None, at_least=1, at_most=8
    )
    coil_quality: float | None = quantity(
        "", "quality of the synthesised network's coils at the centre; None: without losses", default=None, above=0
    )
    parts: Literal["E3", "E6", "E12", "E24", "E48", "E96", "E192"] | None = described(
        "series of values that can be bought (IEC 60063); default: any value", default=None
    )
    parts_tolerance: float | None = quantity(
        "", "relative tolerance of the parts, instead of that of their series", default=None, at_least=0, below=1
    )
    tolerance: Tolerance | None = None
    worst_case: bool = described("tuned for, and ranked by, the worst case within the tolerance", default=False)
    max_voltage: float | None = quantity("V", "largest electrode voltage", default=None, above=0)
    max_inductance: float | None = quantity("H", "largest inductance", default=None, above=0)
    max_displacement: float | None = quantity("m", "largest displacement amplitude", default=None, above=0)
    min_power: float | None = quantity("W", "least harvested power", default=None, at_least=0)
    min_attenuation_db: float | None = quantity(
        "dB", "least attenuation against the short circuit", default=None, at_least=-1000, at_most=1000
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.band is not None and not self.band[0] < self.band[1]:
            raise ParameterError("band", f"found {list(self.band)}, must be [lower, upper] with lower < upper (Hz)")
        if self.parts_tolerance is not None and self.parts is None:
            found = f"found {self.parts_tolerance:g} without parts"
            raise ParameterError("parts_tolerance", f"{found}, must be a tolerance with parts = a series (E3 to E192)")
        if self.worst_case and self.tolerance is None:
            raise ParameterError("worst_case", "found true without a tolerance, it needs a table [design.tolerance]")
        if self.candidates is not None and not self.candidates:
            raise ParameterError("candidates", "found an empty list, at least one kind of shunt is needed")
        for n, kind in enumerate(self.candidates or ()):
            if kind not in (known := (*shunts.registered(), SYNTHESISED)):
                raise unknown(f"candidates.{n}", kind, known)
        keys = {f.name for cls in shunts.registered().values() for f in dataclasses.fields(cls) if f.init}
        for n, key in enumerate(self.hold):
            if key not in keys:
                raise unknown(f"hold.{n}", key, keys)


@dataclass(frozen=True, kw_only=True)
class SweepParameter(Component):
    """A parameter of a sweep: the value at a dotted path, between `from` and `to`."""

    path: str = described('path of a value, as in "shunts.0.load_resistance"')
    from_: float = quantity("", "first value")
    to: float = quantity("", "last value")
    scale: Literal["linear", "log"] = described("spacing of the values", default="linear")
    count: int | None = quantity("", "number of values in a grid", default=None, at_least=1)

    def __post_init__(self) -> None:
        super().__post_init__()
        for key, value in (("from", self.from_), ("to", self.to)):
            if self.scale == "log" and value <= 0:
                raise ParameterError(key, f"found {value:g} with scale = 'log', must be a number greater than 0")
        if self.from_ == self.to:
            raise ParameterError(
                "to", f"found {self.to:g}, which is the value of from as well, but the two must differ"
            )


@dataclass(frozen=True, kw_only=True)
class SweepOptions(Component):
    """Parameters of a sweep, its sampling method and its outputs: the table [sweep]."""

    parameters: tuple[SweepParameter, ...] = described("what is varied")
    method: Literal["grid", "random", "sobol"] = described(
        "how values are chosen; grid needs `count`, the others `samples`", default="grid"
    )
    samples: int | None = quantity("", "number of designs", default=None, at_least=1, at_most=MAX_DESIGNS)
    seed: int = quantity("", "seed of the random numbers", default=1, at_least=0)
    outputs: tuple[str, ...] | None = described("columns of the table; default: what simulate prints", default=None)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.parameters:
            raise ParameterError("parameters", "found an empty list, at least one table [[sweep.parameters]] is needed")
        counts = {f"parameters.{n}.count": parameter.count for n, parameter in enumerate(self.parameters)}
        for key, count in (counts if self.method == "grid" else {"samples": self.samples}).items():
            if count is None:
                raise ParameterError(key, f"missing key, method = {self.method!r} needs a whole number here")
        if self.designs > MAX_DESIGNS:
            raise ParameterError("parameters", f"found {self.designs} designs, allowed are up to {MAX_DESIGNS}")
        if self.outputs == ():
            raise ParameterError("outputs", "found an empty list, at least one output is needed")
        names = {"parameters.{}.path": [p.path for p in self.parameters], "outputs.{}": self.outputs or ()}
        for key, given in names.items():
            for n, name in enumerate(given):
                if name in given[:n]:
                    raise ParameterError(key.format(n), f"found {name!r} a second time, each may be named once")

    @property
    def designs(self) -> int:
        """Number of designs."""
        if self.method == "grid":
            return math.prod(parameter.count or 1 for parameter in self.parameters)
        return self.samples or 0


@dataclass(frozen=True, kw_only=True)
class Study:
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
    def systems(self) -> tuple[System, ...]:
        """The transducer with each of the shunts."""
        return tuple(System(self.transducer, shunt) for shunt in self.shunts)


def _check_free_frequency(driven: Excitation, design: DesignOptions | None) -> None:
    """Raise `ParameterError` if a free frequency has nothing to be sought in, or for."""
    given = f"excitation.frequency = {FREE!r}"
    if not hasattr(driven, "frequency"):
        raise ParameterError("excitation.kind", f"found {driven.kind!r}, allowed with a free frequency is a sine")
    if design is None:
        raise ParameterError(
            "excitation.frequency", f"found {FREE!r} without a table [design], in whose band it is sought"
        )
    if design.band is None:
        raise ParameterError("design.band", f"missing key, {given} needs [lower, upper] (Hz) to be sought in")
    if design.objective != "harvest":
        why = "vibration is least where nothing resonates"
        raise ParameterError(
            "design.objective", f"found {design.objective!r}, allowed with {given} is 'harvest', as {why}"
        )
    if SYNTHESISED in (design.candidates or ()):
        why = "at a frequency of its own an RL circuit draws all that a passive network can"
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
        found = f"found {FREE!r}, which only the command design finds a value for"
        raise StudyError(path, "excitation.frequency", f"{found}, must be a finite number greater than 0 Hz")
    return study


def read_toml(path: Path) -> dict[str, Any]:
    """Tables of a TOML file.

    Raises
    ------
    StudyError
        The file cannot be read, is too large, is not UTF-8 or not TOML.
    """
    try:
        check_readable(path, MAX_TOML_BYTES)
        text = path.read_bytes().decode("utf-8-sig")
        if _LONG_KEY.search(text):
            raise ValueError(f"a key of more than {_MAX_KEY_PARTS} parts")
        return tomllib.loads(text)
    except InputError as error:
        raise StudyError(path, "", str(error)) from None
    except OSError as error:
        raise StudyError(path, "", f"the file cannot be read ({error.strerror})") from None
    except UnicodeDecodeError as error:
        found = f"byte {error.object[error.start]:#04x} at offset {error.start}"
        raise StudyError(path, "", f"found {found}, but a TOML file must be text in UTF-8") from None
    except (ValueError, RecursionError) as error:  # ValueError: a syntax error, or a number of thousands of digits
        what = "tables nested too deep" if isinstance(error, RecursionError) else str(error)
        if what.startswith(("Cannot overwrite", "Cannot declare")):  # as where a study has a file and a table, too
            what = f"a key or table is given a second time, but only one of the two may be ({what})"
        raise StudyError(path, "", f"not a valid TOML file: {what}") from None


def study_from(table: Mapping[str, Any], path: Path) -> Study:
    """Build a study from the tables of its file; files that it names are relative to `path`.

    Raises
    ------
    ParameterError
        Something is missing, unknown, of the wrong type or not physical; its key is the path of the key.
    """
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
    transducer, specimen = _transducer(table["transducer"], path.parent)
    study = Study(
        title=_typed(str, table.get("title", path.stem), "title"),
        transducer=transducer,
        excitation=build_excitation(driven, path.parent),
        shunts=_build_list(table["shunts"], "shunts", build_shunt) if "shunts" in table else (),
        path=path,
        design=design,
        free_frequency=free,
        sweep=build(SweepOptions, table["sweep"], "sweep") if "sweep" in table else None,
        bench=_typed(dict, table.get("bench", {}), "bench"),
        specimen=specimen,
    )
    if study.transducer.quasi_static:
        raise ParameterError("transducer.quasi_static", "found true, which only a campaign of measured records may say")
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


def build_transducer(table: Any, where: str = "transducer") -> Transducer:
    """Transducer from its table; with `catalogue`, further keys override the entry's (tables key by key)."""
    table = dict(_typed(dict, table, where))
    if "catalogue" in table:
        name = table.pop("catalogue")
        if not isinstance(name, str) or name not in catalogue.names():
            raise unknown(f"{where}.catalogue", name, catalogue.names())
        table = catalogue.transducer_table(name, table)
    return build(Transducer, _with_figures(table, where), where)


def _with_figures(table: dict[str, Any], where: str) -> dict[str, Any]:
    """Table of a transducer, with the values that follow from its table `modal` or `datasheet`, if it has one.

    Keys of the table itself go before those that follow.
    """
    given = [key for key in ("modal", "datasheet") if key in table]
    if len(given) == 2:
        raise ParameterError(f"{where}.datasheet", "found beside a table modal, only one of the two may be given")
    if not given:
        return table
    place = f"{where}.{given[0]}"
    figures = _typed(dict, table.pop(given[0]), place)
    try:
        kind, figures = (Modal, figures) if given[0] == "modal" else data_sheet(figures)
        found = build(kind, figures, place).lumped()
    except ParameterError as error:
        if error.key.startswith(where):
            raise
        raise ParameterError(place if error.key == given[0] else f"{place}.{error.key}", error.message) from None
    follows = {key: list(value) if isinstance(value, tuple) else value for key, value in found._asdict().items()}
    return {**follows, **table}


def _transducer(value: Any, folder: Path) -> tuple[Transducer, Path | None]:
    """Transducer from its table, or from the specimen file (relative to `folder`) that stands in its place."""
    if isinstance(value, dict) and KEY in value:
        try:
            value = with_modes(value, folder)
        except ParameterError as error:
            raise error.within("transducer") from None
    if not isinstance(value, str):
        return build_transducer(value), None
    path = folder / value
    try:
        table = read_specimen(path)
        if "parameters" in table:
            raise ParameterError("parameters", "found only a list, a study needs what `identify --save` writes")
        if _typed(dict, table["transducer"], "transducer").get("quasi_static") is True:
            lacks = "found a quasi-static specimen, whose mass and damping no record tells"
            raise ParameterError("transducer.quasi_static", f"{lacks}: give both there and take quasi_static out")
        transducer = build_transducer(table["transducer"])
    except (ParameterError, StudyError) as error:
        inner = f"{error.key}: {error.message}" if error.key else error.message
        raise ParameterError("transducer", f"{value}: {inner}") from None
    return transducer, path


def read_specimen(path: Path) -> dict[str, Any]:
    """Tables of a specimen file, whose contents are not checked.

    Raises
    ------
    StudyError
        The file cannot be read, has a table that is unknown, or neither [transducer] nor [parameters].
    """
    table = read_toml(path)
    for key in table:
        if key not in _SPECIMEN_TABLES:
            wrong = unknown(key, key, _SPECIMEN_TABLES, "key")
            raise StudyError(path, wrong.key, wrong.message)
    if "transducer" not in table and "parameters" not in table:
        raise StudyError(path, "transducer", "missing table [transducer], which a specimen file needs")
    return table


def build_excitation(table: Any, folder: Path, where: str = "excitation") -> Excitation:
    """Excitation from its table, by kind; a file that it names is relative to `folder`."""
    cls, keys = _by_kind(table, excitation.registered(), where)
    if isinstance(keys.get("file"), str):
        keys["file"] = str(folder / keys["file"])
    return build(cls, keys, where)


def _with_frequency(table: Any, design: DesignOptions | None) -> tuple[Any, bool]:
    """Table of a sine whose free frequency is replaced by the middle of the design's band; True if it was free."""
    if not isinstance(table, dict) or table.get("frequency") != FREE:
        return table, False
    cls = excitation.registered().get(str(table.get("kind")))
    if cls is None or "frequency" not in cls.__dataclass_fields__:
        return table, False  # building it says what is wrong
    middle = sum(design.band) / 2 if design and design.band else 1.0
    return {**table, "frequency": middle}, True


def _build_design(table: Any, folder: Path) -> DesignOptions:
    """Goal from its table; a specimen file that its tolerance names is relative to `folder`."""
    options = build(DesignOptions, table, "design")
    if options.tolerance is None or options.tolerance.from_ is None:
        return options
    tolerance = dataclasses.replace(options.tolerance, from_=str(folder / options.tolerance.from_))
    return dataclasses.replace(options, tolerance=tolerance)


def build_shunt(table: Any, where: str = "shunt") -> Shunt:
    """Shunt from its table, by kind."""
    cls, keys = _by_kind(table, shunts.registered(), where)
    try:
        keys = with_parts(keys, [field.name for field in dataclasses.fields(cls)])
    except ParameterError as error:
        raise error.within(where) from None
    return build(cls, keys, where)


def build(cls: type[_C], table: Any, where: str) -> _C:
    """Build a component from a table, as tomllib gives it, whose keys are the fields of its dataclass.

    Raises
    ------
    ParameterError
        A key is missing, unknown, of the wrong type or out of bounds; its key begins with `where`, the table's path.
    """
    values = dict(_typed(dict, table, where))
    hints = get_type_hints(cls)
    for field in dataclasses.fields(cls):
        key, part = _key(field), _component_in(hints[field.name])
        if part is not None and field.name in values:
            values[field.name] = _build_part(part, hints[field.name], values[field.name], f"{where}.{field.name}")
        elif key in values and "unit" in field.metadata:
            values[key] = _in_si(values[key], unit_of(cls, field), f"{where}.{key}")
    try:
        checked = _model(cls).model_validate(values)
        return cls(**{name: _frozen(getattr(checked, name)) for name in checked.model_fields_set})
    except ValidationError as error:
        raise _validation_message(cls, error).within(where) from None
    except ParameterError as error:
        raise ParameterError(error.key.removesuffix("_"), error.message).within(where) from None
    except (ValueError, OSError) as error:
        raise ParameterError(where, f"values that {cls.__name__} does not accept ({error})") from None


def unit_of(cls: type[Component], field: dataclasses.Field) -> str:
    """SI unit of a field; of those that excitations share, a force's and an acceleration's, the one of this kind."""
    first, *other = field.metadata["unit"].split(" or ")
    return other[0] if other and issubclass(cls, Excitation) and (cls.base or cls.imposed) else first


def _in_si(value: Any, unit: str, where: str) -> Any:
    """The value of a quantity, or the list of them, in its SI unit, where it is text with a unit ("52 nF")."""
    if isinstance(value, list):
        return [_in_si(each, unit, f"{where}.{n}") for n, each in enumerate(value)]
    if not isinstance(value, str):
        return value
    try:
        converted = with_unit(value, unit)
        return value if converted is None else converted
    except ParameterError as error:
        raise ParameterError(where, error.message) from None


def _build_part(part: type[Component], hint: Any, value: Any, where: str) -> Any:
    """Component or tuple of components inside another one; effects stand in a table by name."""
    if issubclass(part, Effect):
        return tuple(build_effect(name, table, f"{where}.{name}") for name, table in _typed(dict, value, where).items())
    if issubclass(part, Shunt):
        return _build_list(value, where, build_shunt)
    if get_origin(hint) is tuple:
        return _build_list(value, where, lambda table, place: build(part, table, place))
    return build(part, value, where)


def build_effect(name: str, table: Any, where: str) -> Effect:
    """Effect from its table, by name; one that has a `place` is a law without a name.

    Raises
    ------
    ParameterError
        There is no such effect, or its table does not fit.
    """
    known = effects.registered()
    if name in known:
        return build(known[name], table, where)
    if not isinstance(table, dict) or "place" not in table:
        raise unknown(where, name, known, "effect")
    for key in table:
        if key not in PARTS:
            raise unknown(f"{where}.{key}", key, PARTS, "key")
    if "form" not in table:
        raise ParameterError(f"{where}.form", "missing key, a law has a place and a form")
    places = {key: f"{where}.{key}" for key in table}
    parts: dict[str, Any] = {
        key: build(*_by_kind(part, kinds_of(key), places[key]), places[key]) for key, part in table.items()
    }
    law = Law(**parts)
    if in_a_path(law.name) != name:
        raise ParameterError(where, f"found the law {in_a_path(law.name)!r} under this name, must be its own")
    return law


def _build_list(value: Any, where: str, make) -> tuple:
    """Components from a list of tables."""
    return tuple(make(table, f"{where}.{n}") for n, table in enumerate(_typed(list, value, where)))


def _by_kind(table: Any, known: Mapping[str, type[_C]], where: str) -> tuple[type[_C], dict[str, Any]]:
    """Class that the table's `kind` names, and the table's other keys."""
    keys = dict(_typed(dict, table, where))
    if "kind" not in keys:
        raise ParameterError(f"{where}.kind", f"missing key, allowed are {', '.join(sorted(known))}")
    kind = keys.pop("kind")
    if not isinstance(kind, str) or kind not in known:
        raise unknown(f"{where}.kind", kind, known)
    return known[kind], keys


def _component_in(hint: Any) -> type[Component] | None:
    """Component class within an annotation such as `Hysteresis | None` or `tuple[Mode, ...]`."""
    if get_origin(hint) is None:
        return hint if isinstance(hint, type) and issubclass(hint, Component) else None
    return next((part for part in map(_component_in, get_args(hint)) if part is not None), None)


@cache
def _model(cls: type[Component]) -> type[BaseModel]:
    """Pydantic model with the fields of a component's dataclass: no additional keys, no conversion to numbers."""
    hints = get_type_hints(cls)
    fields: dict[str, Any] = {
        field.name: (
            _strict(hints[field.name]),
            Field(... if MISSING is field.default is field.default_factory else None, alias=_key(field)),
        )
        for field in dataclasses.fields(cls)
        if field.init
    }
    return create_model(cls.__name__, __config__=ConfigDict(extra="forbid", protected_namespaces=()), **fields)


def _key(field: dataclasses.Field) -> str:
    """Key of a field in a file: its name, without the underscore appended to Python keywords (`from_`)."""
    return field.name.removesuffix("_")


def _strict(hint: Any) -> Any:
    """Annotation without conversions between types, except from int to float and from list to tuple.

    A field that takes several types is left to the component's own check.
    """
    hint = _without_none(hint)
    if hint in (float, int, str, bool):
        return Annotated[hint, Strict()]
    if get_origin(hint) is tuple:
        return tuple[tuple(part if part is Ellipsis else _strict(part) for part in get_args(hint))]  # pyright: ignore
    return hint if get_origin(hint) is Literal else Any


def _without_none(hint: Any) -> Any:
    """The annotation, or X for `X | None`."""
    parts = [part for part in get_args(hint) if part is not NoneType]
    return parts[0] if get_origin(hint) in (Union, UnionType) and len(parts) == 1 else hint


def _validation_message(cls: type[Component], error: ValidationError) -> ParameterError:
    """One pydantic error in words: an unknown key first, since it often explains a missing one."""
    order = {"extra_forbidden": 0, "missing": 2}
    first = min(error.errors(include_url=False), key=lambda detail: order.get(detail["type"], 1))
    name, *inner = map(str, first["loc"])
    fields = {_key(field): field for field in dataclasses.fields(cls) if field.init}
    if first["type"] == "extra_forbidden":
        return unknown(name, name, fields, "key")
    field = fields[name]
    hint = _without_none(get_type_hints(cls)[field.name])
    if first["type"] != "missing" and inner:
        name, hint = f"{name}.{inner[0]}", get_args(hint)[0]
    # An element is missing if a list is too short: the list is reported.
    found = "missing key" if first["type"] == "missing" and not inner else f"found {_shown_value(first['input'])}"
    return ParameterError(name, f"{found}, must be {allowed_values(field, hint)}")


def allowed_values(field: dataclasses.Field, hint: Any) -> str:
    """Allowed values of a field, in words."""
    if get_origin(hint) is Literal:
        return " or ".join(map(repr, get_args(hint)))
    if get_origin(hint) is tuple:
        parts = get_args(hint)
        count = "" if Ellipsis in parts else f" of {len(parts)}"
        if _component_in(parts[0]) is not None:
            return f"a list{count} of tables"
        return f"a list{count}, each {allowed_values(field, parts[0])}"
    if hint in (int, float):
        return allowed(field).replace("finite", "whole" if hint is int else "finite")
    if _component_in(hint) is not None:
        return "a table"
    return _WORDS.get(hint, "a string or a list")


def _typed(wanted: type[_T], value: Any, where: str) -> _T:
    if not isinstance(value, wanted):
        raise ParameterError(where, f"found {_shown_value(value)}, must be {_WORDS[wanted]}")
    return value


def _frozen(value: Any) -> Any:
    return tuple(map(_frozen, value)) if isinstance(value, list | tuple) else value


def unknown(key: str, name: Any, known: Iterable[str], what: str = "") -> ParameterError:
    """Error for an unknown name, with the most similar known one; `what` is named by a key ("key", "effect")."""
    names = {right.lower(): right for right in sorted(known)}
    near = difflib.get_close_matches(str(name)[:100].lower(), names, n=1)
    hint = f" (did you mean {names[near[0]]!r}?)" if near else ""
    found = f"unknown {what}{hint}, known {what}s" if what else f"found {_shown_value(name)}{hint}, allowed"
    return ParameterError(key, f"{found} are {', '.join(names.values())}")


def _shortened(text: str, most: int = 450) -> str:
    """A part of a message, which may be arbitrarily long in a file, shortened."""
    return text if len(text) <= most else f"{text[: most - 150]} ... {text[-145:]}"


def _shown_value(value: Any) -> str:
    """A value as shown in a message, shortened."""
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= 80 else f"{text[:60]}..."
