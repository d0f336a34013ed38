"""A law that was found as an effect file: a class that studies, designs and diagnoses take like any other effect."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from piezoharvest.description.effects import Effect
from piezoharvest.description.parameters import Component
from piezoharvest.diagnose.discovery.law_fits import TABLES
from piezoharvest.diagnose.discovery.result import Discovery
from piezoharvest.output import write_text

C = TypeVar("C", bound=Component)

TEMPLATE = '''"""{doc}"""

from dataclasses import dataclass
from typing import ClassVar

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.effects.nameless.law import Law
{imports}
from piezoharvest.description.parameters import altered, quantity

PLACE = {place_text}
FORM = {form_text}
MEMORY = {memory_text}


@dataclass(frozen=True, kw_only=True)
class {title}(Effect):
    """{doc}"""

    name: ClassVar[str] = "{name}"
    source: ClassVar[str] = "{source}"
    looks: ClassVar[str] = "{looks}"
    told_by: ClassVar[str] = "records over a wider range of the {of}"
    of_specimen: ClassVar[bool] = {of_specimen}
    of_drive: ClassVar[bool] = {of_drive}

{fields}

    @property
    def law(self):
        return Law(place=PLACE, form={form_given}, memory={memory_given})

    def act(self, specimen):
        self.law.act(specimen)

    def stores(self, terms):
        return self.law.stores(terms)

    def losses(self, terms):
        return self.law.losses(terms)

    def late(self, channel):
        return self.law.late(channel)
{connect}
    @classmethod
    def starts(cls, scales):
        yield cls({strength}=0.0)
'''


CONNECT = """
    def connect(self, shunt):
        return self.law.connect(shunt)
"""


def effect_text(law: Discovery, campaign: str, beside: Sequence[Effect] = ()) -> str:
    """The text of an effect file for a law; `campaign` names the data that it was found in, `beside` is what else was.

    A curve of diodes without a constant drop, for one, is no law of diodes that have that of their label.
    """
    form, place, memory = _plain(law.law.form), law.law.place, law.law.memory and _plain(law.law.memory)
    words = [*place.name.replace(".", "_").split("_"), *(law.form if memory is None else memory.kind).split("_")]
    of, strength = place.input.replace("_", " "), "factor"
    if isinstance(form, TABLES):
        fields = ['share: float = quantity("", "share of the law that was found", default=1.0, null=0.0)']
        form_given, strength = f"altered(FORM, kinks=tuple(self.share * kink for kink in {form.kinks!r}))", "share"
    elif memory is not None and memory.alone:
        fields, form_given, strength = [], "FORM", _names(memory)[0]
    else:
        fields, form_given = _fields(form), _given("FORM", form)
    fields += [] if memory is None else _fields(memory)
    used = [form, place] + ([] if memory is None else [memory])
    return TEMPLATE.format(
        doc=f"What is added at {place.name}, a function of the {of}: {law.formula}.{_needed(beside)}",
        imports="\n".join(sorted(f"from {type(each).__module__} import {type(each).__name__}" for each in used)),
        place_text=repr(place), form_text=repr(form), memory_text=repr(memory),
        title="".join(word.capitalize() for word in words), name="_".join(words).lower(),
        source=f"found by piezoharvest diagnose in {campaign}", of=of, looks=f"what is left goes with the {of}",
        of_specimen=law.law.of_specimen, of_drive=law.law.of_drive, fields="\n".join(f"    {each}" for each in fields),
        connect=CONNECT if place.in_circuit else "", form_given=form_given,
        memory_given=repr(None) if memory is None else _given("MEMORY", memory), strength=strength,
    )  # fmt: skip


def _needed(beside: Sequence[Effect]) -> str:
    """Sentence on the effects that a study needs, too."""
    if not beside:
        return ""
    given = (f"{name} = {getattr(each, name):.6g}" for each in beside for name in _names(each))
    return f"\n\n    It was found beside {', '.join(each.name for each in beside)} ({', '.join(given)}).\n    "


def save_effect(law: Discovery, campaign: str, path: str | Path, beside: Sequence[Effect] = ()) -> None:
    """Write a law as an effect file, with a sentence on the effects that it was found beside.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    write_text(effect_text(law, campaign, beside), path)


def _names(component: Component) -> list[str]:
    """Names of the quantities of a form or memory."""
    return [field.name for field in dataclasses.fields(component) if "unit" in field.metadata]


def _given(name: str, component: Component) -> str:
    """A form or memory with the values of the effect."""
    return f"altered({name}, {', '.join(f'{each}=self.{each}' for each in _names(component))})"


def _fields(component: Component) -> list[str]:
    """Fields of the effect's class for the quantities of a form or memory."""
    fields = [field for field in dataclasses.fields(component) if "unit" in field.metadata]
    return [_field(component, field) for field in fields]


def _plain(component: C) -> C:
    """A form or memory with plain numbers, whose text is Python."""
    values = {
        field.name: tuple(map(_number, value)) if isinstance(value, tuple) else _number(value)
        for field in dataclasses.fields(component)
        for value in [getattr(component, field.name)]
    }
    return dataclasses.replace(component, **values)


def _number(value: object) -> object:
    return value.item() if isinstance(value, np.generic) else value


def _field(component: Component, field: dataclasses.Field) -> str:
    """A field of the effect's class for a quantity, with the value that was found."""
    meta = field.metadata
    bounds = "".join(f", {key}={meta[key]!r}" for key in ("above", "at_least", "below", "at_most", "null")
                     if meta[key] is not None)  # fmt: skip
    value = getattr(component, field.name)
    return f'{field.name}: float = quantity("{meta["unit"]}", "{meta["doc"]}", default={value!r}{bounds})'
