"""Pages of the reference, made from the code: every key of a study and a campaign, every shunt, every effect."""

from __future__ import annotations

import dataclasses
import inspect
import re
import textwrap
from collections.abc import Iterable, Mapping
from typing import Any

from made_from_code.keys import Key, first_sentence, keys_of
from piezoharvest.bench.effects import registered as bench_effects
from piezoharvest.bench.settings import Bench, RecordOptions
from piezoharvest.description import effects, excitation, modes_file, shunts
from piezoharvest.description.catalogue import parts as bought
from piezoharvest.description.figures import DATA_SHEETS, Modal
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.parameters import Component
from piezoharvest.description.tolerance import Tolerance
from piezoharvest.description.transducer import Electrode, Mode, Transducer
from piezoharvest.records.bench_limits import BenchLimits
from piezoharvest.records.reading.channels import COLUMNS, UNITS, ChannelSource
from piezoharvest.records.reading.entries import ENTRIES, RESPONSE_COLUMNS
from piezoharvest.study import DesignOptions, SweepOptions, SweepParameter, allowed_values
from piezoharvest.study.building import component_in

_SECTION = re.compile(r"\n\n(?:Parameters|Attributes|Returns|Raises|Notes|Examples)\n-+\n")
_HEAD = "| key | unit | default | allowed | |\n|---|---|---|---|---|\n"
FAMILIES = {
    "linear": "Linear", "harvesting": "Harvesting", "double_switch": "Harvesting with two switched converters",
    "damping": "Damping",
    "self_powered": "Self-powered",
}  # fmt: skip
KINDS = {
    "electrical": "Electrical", "mechanical": "Mechanical", "circuit": "In the connected circuit",
    "sensing": "Sensors and nominal values",
}  # fmt: skip
TABLES = {
    "shunt": "a table as for [shunts](../shunts/index.md)", "channels": "a table for each [channel](#channelsname)",
    "excitation": "a table as for an [excitation](study.md#excitation)",
}  # fmt: skip


def pages() -> dict[str, str]:
    """Markdown of all pages by their place in the site."""
    found = {
        "reference/study.md": _study(), "reference/bench.md": _bench(), "reference/campaign.md": _campaign(),
        "shunts/index.md": _index("Shunts", shunts.registered(), FAMILIES),
        "effects/index.md": _index("Effects", effects.registered(), KINDS),
    }  # fmt: skip
    found |= {f"shunts/{kind}.md": _shunt(kind, cls) for kind, cls in shunts.registered().items()}
    return found | {f"effects/{name}.md": _effect(name, cls) for name, cls in effects.registered().items()}


def plain(text: str) -> str:
    """Text with what Markdown would take for markup or HTML escaped, but in code between backticks."""
    parts = text.split("`")
    for n in range(0, len(parts), 2):
        parts[n] = re.sub(r"([*_|])", r"\\\1", parts[n].replace("&", "&amp;").replace("<", "&lt;"))
    return "`".join(parts)


def body(cls: type) -> str:
    """Docstring of a class up to its first numpydoc section."""
    return _SECTION.split("\n\n" + inspect.cleandoc(cls.__doc__ or ""))[0].strip()


def table(cls: type[Component], more: Iterable[tuple[str, str, str, str, str]] = ()) -> str:
    """Markdown table of a component's keys, with further rows before them."""
    rows = [*more, *(_row(key) for key in keys_of(cls))]
    return _HEAD + "".join(f"| {' | '.join(row)} |\n" for row in rows) if rows else "It has no keys.\n"


def _row(key: Key) -> tuple[str, str, str, str, str]:
    return f"`{key.name}`", plain(key.unit), _default(key), _allowed(key), plain(key.doc)


def _default(key: Key) -> str:
    if key.required:
        return "required"
    value = key.field.default
    if value is dataclasses.MISSING or value is None or value == () or value == "":
        return ""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, tuple):
        return "`[" + ", ".join(f'"{each}"' if isinstance(each, str) else f"{each:g}" for each in value) + "]`"
    return f'`"{value}"`' if isinstance(value, str) else f"`{value:g}`"


def _allowed(key: Key) -> str:
    """Allowed values in words; what any number is goes without saying."""
    if component_in(key.hint) is effects.Effect:
        return "a table for each [effect](../effects/index.md)"
    if key.hint is Any and key.name in TABLES:
        return TABLES[key.name]
    words = allowed_values(key.field, key.hint).replace("a finite number", "a number").replace("'", '"')
    words = re.sub(rf" {re.escape(key.unit)}(?!\w)", "", words) if key.unit else words  # it has a column of its own
    return plain("" if words in ("a number", "a string") else words)


def _linked(title: str, cls: type[Component], level: int = 2, **options) -> str:
    """A section with its heading, the docstring and the table of keys."""
    return f"{'#' * level} {title}\n\n{plain(body(cls))}\n\n{table(cls, **options)}\n"


def _study() -> str:
    own = [
        ("`catalogue`", "", "", "a name that `piezoharvest catalogue` lists", "entry whose keys are the defaults"),
        (f"`{modes_file.KEY}`", "", "", "a file", f"modes of the host instead of {', '.join(modes_file.GIVEN[:4])}"),
        (
            f"`{modes_file.PLACES}`",
            "",
            "",
            "a table",
            "positions of force and sensor in a universal file, and couplings",
        ),
    ]
    parts = [
        '# Keys of a study\n\nA value with a unit may also be text with any compatible unit: `"52 nF"`. `title` is a'
        " text for reports. The other tables of a study are `[[shunts]]`, see [shunts](../shunts/index.md),"
        " `[transducer.effects.NAME]`, see [effects](../effects/index.md), and [`[bench]`](bench.md)."
        " [A schema](../how-to/editor.md) makes all this available in an editor.\n",
        _linked("[transducer]", Transducer, more=own),
        _linked("[transducer.hysteresis]", Hysteresis),
        _linked("[[transducer.modes]]", Mode),
        _linked("[[transducer.electrodes]]", Electrode),
        "## [transducer.modal] and [transducer.datasheet]\n\nValues from a modal test or a data sheet may replace"
        " the keys of `[transducer]`, or complement those that are known better. The kind of data sheet is recognised"
        " by its keys; `material`, a name that `piezoharvest catalogue` lists, gives the constants of the material.\n",
        _linked("[transducer.modal]", Modal, 3),
    ]
    parts += [
        _linked(f"[transducer.datasheet] with {_told_by(cls)}", cls, 3) for cls in dict.fromkeys(DATA_SHEETS.values())
    ]
    parts.append(
        '## [excitation]\n\n`kind` is one of these. The `frequency` of a sine may be `"free"` for a design, which'
        " then finds it in its band.\n"
    )
    parts += [_linked(f'kind = "{kind}"', cls, 3) for kind, cls in excitation.registered().items()]
    parts += [
        _linked("[design]", DesignOptions), _linked("[design.tolerance]", Tolerance),
        _linked("[sweep]", SweepOptions), _linked("[[sweep.parameters]]", SweepParameter),
    ]  # fmt: skip
    return "\n".join(parts)


def _told_by(cls: type) -> str:
    return " or ".join(f"`{key}`" for key, kind in DATA_SHEETS.items() if kind is cls)


def _bench() -> str:
    parts = ["# Keys of the virtual bench\n", _linked("[bench]", Bench)]
    for key in keys_of(Bench):
        device = component_in(key.hint)
        if device is not None and device is not RecordOptions:
            parts.append(f"## [bench.{key.name}]\n\n{plain(body(device))}\n\n{table(device)}\n")
    parts.append(_linked("[[bench.records]]", RecordOptions))
    parts.append(
        "## [bench.effects.NAME]\n\nFaults of the set-up. They are not written into the campaign, whereas"
        " `[transducer.effects]` is.\n"
    )
    for name, cls in bench_effects().items():
        parts.append(f"### [bench.effects.{name}]\n\nSee [{name}](../effects/{name}.md).\n\n{table(cls)}\n")
    return "\n".join(parts)


def _campaign() -> str:
    channels = "".join(f"| `{name}` | {UNITS[name]} | `{column}` |\n" for name, column in COLUMNS.items())
    parts = [
        "# Keys of a campaign\n\n`title` is a text for reports. `[transducer]` has the nominal values, with the keys of"
        ' [a study](study.md#transducer); `quasi_static = true`, or `mass = "unknown"` or `damping = "unknown"`, is'
        " for a specimen that follows its drive without delay. An earlier specimen file may be used instead:"
        ' `transducer = "specimen.toml"`.\n',
        _linked("[channels.NAME]", ChannelSource),
        f"| channel | SI unit | default column |\n|---|---|---|\n{channels}",
        "## [[records]]\n\nThe `kind` of a record is one of these; without it, it contains signals over time.\n",
    ]
    for kind, cls in ENTRIES.items():
        more = [("`kind`", "", '`"time"`', '"time"', "kind of the record")] if kind == "time" else []
        parts.append(f'### kind = "{kind}"\n\n{plain(body(cls))}\n\n{table(cls, more)}\n')
        if kind in RESPONSE_COLUMNS:
            columns = ", ".join(f"`{name}` (`{column}`)" for name, column in RESPONSE_COLUMNS[kind].items())
            parts.append(f"Its channels are, with their default columns, {columns}.\n")
    parts.append(_linked("[experiment]", BenchLimits))
    parts.append(
        "## [[specimens]]\n\nSeveral specimens of one kind in one campaign: each has a `name`, its"
        " `[[specimens.records]]`, and, where they differ, keys of `transducer` and `channels`. See"
        " [several specimens](../how-to/specimens.md).\n"
    )
    return "\n".join(parts)


def _family(cls: type, families: Mapping[str, str]) -> str:
    """Heading under which a component stands: that of the folder of its file."""
    return next((words for folder, words in families.items() if f".{folder}." in f"{cls.__module__}."), "Others")


def _index(title: str, known: Mapping[str, type], families: Mapping[str, str]) -> str:
    parts = [f"# {title}\n"]
    for words in (*families.values(), "Others"):
        some = {name: cls for name, cls in known.items() if _family(cls, families) == words}
        rows = "".join(f"| [{name}]({name}.md) | {plain(first_sentence(cls))} |\n" for name, cls in some.items())
        if rows:
            parts.append(f"## {words}\n\n| name | what it is |\n|---|---|\n{rows}")
    return "\n".join(parts)


def _shunt(kind: str, cls: type) -> str:
    fields = {key.name for key in keys_of(cls)}
    named = []
    for key, sort in bought.sorts_of(fields).items():
        gives = ", ".join(name for name in sort.keys if name in fields)
        named.append((f"`{key}`", "", "", ", ".join(bought.parts(key)), f"{sort.doc} whose {gives} are taken"))
        if sort.option:
            option, unit, usual, doc = sort.option
            named.append((f"`{option}`", unit, "" if usual is None else f"`{usual:g}`", "a number greater than 0", doc))
    inner = [(key.name, component_in(key.hint)) for key in keys_of(cls)]
    tables = [_linked(f"[shunts.{name}]", part) for name, part in inner if part not in (None, shunts.Shunt)]
    return "\n".join([
        f"# {kind}\n\n{plain(body(cls))}\n",
        f'In a study: `[[shunts]]` with `kind = "{kind}"`. In Python: `piezoharvest.{cls.__name__}`.\n',
        table(cls, named), *tables, f"Source: {plain(cls.source)}\n", _code(cls),
    ])  # fmt: skip


def _effect(name: str, cls: type) -> str:
    parts = [f"# {name}\n\n{plain(body(cls))}\n"]
    if cls.looks:
        parts.append(f"What it looks like: {plain(cls.looks)}.\n")
    if cls.told_by:
        parts.append(f"What tells it from others: {plain(cls.told_by)}.\n")
    source = f"Source: {plain(cls.source)}\n\n{_code(cls)}"
    parts.append(f"In a study: `[transducer.effects.{name}]`.\n\n{table(cls)}\n{source}")
    return "\n".join(parts)


def _code(cls: type) -> str:
    """The class itself, folded in."""
    block = f"```python\n{inspect.getsource(cls).rstrip()}\n```\n"
    return f'??? note "In the code"\n\n{textwrap.indent(block, "    ")}'
