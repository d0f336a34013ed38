"""The command `new`: studies and campaigns to begin with, commented; a campaign from the user's own files."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from importlib import resources
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING

import numpy as np
import tomli_w

from piezoharvest.cli.notes import note
from piezoharvest.counting import counted
from piezoharvest.output import OutputError, check_file, write_text
from piezoharvest.study import StudyError

if TYPE_CHECKING:
    from piezoharvest.records.recognition.files import FoundFile

_UNITS = {"mass": "kg", "damping": "N s/m", "stiffness": "N/m", "coupling": "N/V", "capacitance": "F, clamped"}
_DRIVES = ("force", "base_acceleration", "voltage", "displacement")  # the first that a file has is taken
_MECHANICAL = ("mass", "damping", "stiffness")
_REGRESSED = ("force", "displacement", "velocity", "acceleration", "voltage", "current")
# A hundred times beyond the transducers of the catalogue; masses up to those of structures that carry them.
_PLAUSIBLE = {
    "mass": (6e-8, 1e2), "damping": (1e-4, 1e5), "stiffness": (3.0, 3e11), "coupling": (8e-6, 5e3),
    "capacitance": (7e-12, 7e-4),
}  # fmt: skip
# In the place of [transducer], where the records alone do not tell it.
_MODAL = (
    "# or, instead of these five, what is read off a frequency response and a meter (?):",
    "# [transducer.modal]",
    "# short_circuit_frequency = 98.0 # Hz",
    "# open_circuit_frequency = 100.0 # Hz",
    "# quality = 40.0                 # of the resonance; or: damping_ratio = 0.0125",
    '# modal_mass = "250 g"',
    '# capacitance = "125 nF"',
    '# capacitance_is = "free"        # as measured far below the resonance; or "clamped"',
)
_OHM_SCATTER = 0.05  # rms deviation of v - R i, relative to v, up to which a load is a resistance
_LEAST_ROWS = 10  # of a file: fewer tell neither a sample rate nor a resonance


def new(kind: str, files: Sequence[Path], out: Path | None) -> int:
    """Write a template, "harvest" or "damping", that runs as it is; or a "campaign" from data files."""
    target = Path(f"{kind}.toml") if out is None else out
    check_file(target, (".toml",))
    if os.path.lexists(target):
        raise OutputError(f"{target}: the file exists and is not overwritten; name another one with --out FILE")
    text = resources.files("piezoharvest.cli").joinpath("templates", f"{kind}.toml").read_text("utf-8")
    if kind != "campaign":
        text = Template(text).substitute(file=target.name)
        write_text(_hosted(kind, text, files, target) if files else text, target)
        print(target)
        marked = "those marked (?)" if files else "its values"
        note(f"the file runs as it is (piezoharvest simulate {target}); replace {marked} with your own")
        return 0
    if not files:
        raise OutputError("no data files, at least one is needed: piezoharvest new campaign FILES")
    write_text(_campaign(text, files, target), target)
    print(target)
    _say_what_is_left(target)
    return 0


def _hosted(kind: str, text: str, files: Sequence[Path], target: Path) -> str:
    """Text of a study of the host structure in a universal file."""
    from piezoharvest.cli.host_study import with_host
    from piezoharvest.readers.uff import Uff

    if len(files) > 1 or files[0].suffix.lower() not in Uff.suffixes:
        allowed = "only a campaign takes data files, and a study one universal file (UFF) with the structure's modes"
        raise OutputError(f"found {files[-1]} for {kind}, {allowed} ({', '.join(Uff.suffixes)})")
    return with_host(text, files[0], target)


def _say_what_is_left(target: Path) -> None:
    """Note the first thing that stands in the way of a fit, or the warnings."""
    from piezoharvest.records import load_campaign

    try:
        for finding in load_campaign(target).warnings:
            note(f"warning: {finding.file}: {finding.message}")
    except StudyError as error:
        note(f"still to be completed: {error}")


def _campaign(template: str, files: Sequence[Path], target: Path) -> str:
    """Text of a campaign of these files; raises `StudyError`."""
    from piezoharvest.readers import ReadError
    from piezoharvest.records.recognition.files import look_into

    found = []
    for path in files:
        try:
            found.append(look_into(path))
        except ReadError as error:
            raise StudyError(path, error.column, error.message) from None
        if found[-1].count < _LEAST_ROWS:
            note(f"warning: {path}: found only {counted(found[-1].count, 'row')} of numbers; is the file cut off?")
    signals = [each for each in found if each.kind == "time"]
    same = all((each.columns, each.units) == (signals[0].columns, signals[0].units) for each in signals)
    shared = list(_channels(signals[0])) if signals and same else []
    records = [line for each in found for line in _record(each, target, same)]
    return Template(template).substitute(
        file=target.name, title=_quoted(target.stem), transducer="\n".join(_transducer(found)),
        channels="\n".join(shared or ["# given in each record below"]), records="\n".join(records),
    )  # fmt: skip


def _transducer(found: Sequence[FoundFile]) -> Iterator[str]:
    """Lines of nominal values, as far as regressions of the longest records tell them.

    Mass, damping and stiffness are those of a record or a response that has the resonance, if there is one.
    """
    rough: dict[str, float] = {}
    ordered = sorted(found, key=lambda one: -one.count)
    for each in ordered:
        rough = max(rough, _rough(each), key=len)
    resonant = (_rough(each, resonant=True) for each in sorted(ordered, key=lambda one: one.kind != "frf"))
    rough |= {name: value for name, value in next(filter(None, resonant), {}).items() if name in _MECHANICAL}
    for name, unit in _UNITS.items():
        if name in rough:
            low, high = _PLAUSIBLE[name]
            doubt = "" if low < rough[name] < high else ", implausible: are the units of the channels right?"
            yield f"{f'{name} = {rough[name]:.3g}':<33}# {unit}; rough value, from the records{doubt} (?)"
        else:
            yield f"{f'# {name} = ':<33}# {unit}; not known from the records (?)"
    if "coupling" not in rough:
        yield from _MODAL


def _rough(found: FoundFile, *, resonant: bool = False) -> dict[str, float]:
    """Nominal values from one file; if required, only from one that has the resonance."""
    from piezoharvest.records.recognition.rough_values import rough_values, rough_values_of_response

    if found.kind == "frf" and found.input == "force" and "response" in found.values:
        return rough_values_of_response(found.values["frequency"], found.values["response"], found.output)
    channels = {name: found.values[name] for name in _REGRESSED if name in found.values}
    if found.rate is None or len({len(values) for values in channels.values()}) != 1:
        return {}
    return rough_values(channels, found.rate, resonant=resonant)


def _channels(found: FoundFile) -> Iterator[str]:
    """Lines of [channels]: what was recognised, and what was not, as comments."""
    from piezoharvest.records.recognition.files import OTHER_UNIT

    for channel, column in found.columns.items():
        unit = found.units[channel]
        name = _quoted(column)
        if unit == OTHER_UNIT:
            yield f"# {channel} = {{ column = {name}, gain = 1.0 }}    # (?) in another unit: its gain is missing"
            continue
        said = f"{unit}, stated in the file" if unit else "no unit in the file: SI unit assumed (?)"
        if channel == "time" and found.rate is not None:
            said += f"; {found.rate:.6g} Hz"
        yield f"{channel} = {{ column = {name} }}    # {said}"
    if not set(_DRIVES) & set(found.columns):
        yield '# force = { column = "...", unit = "N", gain = 1.0 }    # (?) and displacement, voltage, current, ...'
    if found.left:
        yield f"# not recognised (?): {', '.join(map(_quoted, found.left))}"


def _record(found: FoundFile, target: Path, same: bool) -> Iterator[str]:
    """Lines of a table [[records]]."""
    name = Path(os.path.relpath(found.path, target.parent)).as_posix()
    yield ""
    yield "[[records]]"
    about = "lines" if found.kind != "time" else "samples"
    rate = f" at {found.rate:.6g} Hz" if found.rate is not None else ""
    yield f"file = {_quoted(name)}    # {found.count} {about}{rate}"
    if found.skip_rows:
        yield f"{f'skip_rows = {found.skip_rows}':<33}# lines above the longest table of the file"
    yield 'role = "fit"                     # "validate": kept out of the fit, to check it'
    yield from (f"# (?) {doubt}" for doubt in found.doubts)
    if found.kind != "time":
        yield from _spectrum(found)
        return
    drive = next((channel for channel in _DRIVES if channel in found.columns), "")
    sure = "the imposed channel" if drive == "force" else "the imposed channel (?)"
    line = f'drive = "{drive}"' if drive in found.values else f'# drive = "{drive or "force"}"'
    yield f"{line:<33}# {sure if drive in found.values else 'the imposed channel, not known yet (?)'}"
    if "time" not in found.values:
        yield "# sample_rate = 1000.0           # Hz (?) the file has no time column"
    yield from _load(found, drive)
    if not same:
        yield "[records.channels]"
        yield from _channels(found)


def _load(found: FoundFile, drive: str) -> Iterator[str]:
    """Line of the load: voltage over current, if they are in proportion."""
    voltage, current = (found.values.get(name) for name in ("voltage", "current"))
    if drive == "voltage":
        return
    if voltage is not None and current is not None and (power := float(current @ current)) > 0:
        ohm = float(voltage @ current) / power
        off = np.linalg.norm(voltage - ohm * current) / max(float(np.linalg.norm(voltage)), np.finfo(float).tiny)
        if ohm > 0 and off < _OHM_SCATTER:
            yield f"{f'load_resistance = {ohm:.4g}':<33}# ohm; voltage over current (?); prefer the nominal value"
            return
    yield '# load_resistance = 1e5          # ohm (?) or: shunt = { kind = "open" }, "short", "parallel_sshi", ...'


def _spectrum(found: FoundFile) -> Iterator[str]:
    """Keys of a frequency response or an impedance."""
    from piezoharvest.records.recognition.files import LEVEL

    yield f'kind = "{found.kind}"'
    if found.kind == "impedance":
        yield 'mechanical = "free"              # or "blocked"'
        return
    if found.output:
        yield f'output = "{found.output}"'
        yield f'input = "{found.input}"'
    else:
        yield '# output = "displacement"        # (?) or velocity, acceleration, voltage, current'
    yield '# load_resistance = 1e5          # ohm (?) or: shunt = { kind = "open" }, { kind = "short" }'
    if found.columns or "response" not in found.values:
        yield "[records.channels]"
    for part, column in found.columns.items():
        unit, source = found.units[part], f"column = {_quoted(column)}"
        if unit == LEVEL:
            yield f'{part} = {{ {source}, unit = "dB" }}    # (?) 0 dB taken for the SI unit; or: unit = "dB re um/N"'
        else:
            yield f"{part} = {{ {source} }}" + (f"    # {unit}, stated in the file" if unit else "")
    if "response" not in found.values:
        yield f"# further columns: {', '.join(map(_quoted, found.left)) or 'none'}"
        yield '# response (complex), or real and imaginary, or magnitude and phase: { column = "...", unit = "..." }'


def _quoted(value: str | int) -> str:
    """A string or a number as TOML writes it."""
    return tomli_w.dumps({"x": value}).removeprefix("x = ").strip()
