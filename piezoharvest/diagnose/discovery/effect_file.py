"""A law that was found as an effect file: a class that studies, designs and diagnoses take like any other effect."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from piezoharvest.description.effects.nameless.forms import Form
from piezoharvest.diagnose.discovery.law_fits import TABLES
from piezoharvest.diagnose.discovery.result import Discovery
from piezoharvest.output import write_text

TEMPLATE = '''"""{doc}"""

from dataclasses import dataclass
from typing import ClassVar

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.effects.nameless.forms import {form}
from piezoharvest.description.effects.nameless.places import {place}
from piezoharvest.description.parameters import altered, quantity

PLACE = {place_text}
FORM = {form_text}


@dataclass(frozen=True, kw_only=True)
class {title}(Effect):
    """{doc}"""

    name: ClassVar[str] = "{name}"
    source: ClassVar[str] = "{source}"
    looks: ClassVar[str] = "{looks}"
    told_by: ClassVar[str] = "records over a wider range of the {of}"
    of_specimen: ClassVar[bool] = {of_specimen}

{fields}

    def act(self, specimen):
        PLACE.add(specimen, altered(FORM, {given}))

    @classmethod
    def starts(cls, scales):
        yield cls({strength}=0.0)
'''


def effect_text(law: Discovery, campaign: str) -> str:
    """The text of an effect file for a law; `campaign` names the data that it was found in."""
    form, place = _plain(law.law.form), law.law.place
    words = [*place.name.replace(".", "_").split("_"), *law.form.split("_")]
    table = isinstance(form, TABLES)
    if table:
        share = 'share: float = quantity("", "share of the law that was found", default=1.0, null=0.0)'
        fields, given, strength = [share], f"kinks=tuple(self.share * kink for kink in {form.kinks!r})", "share"
    else:
        fields = [_field(form, field) for field in dataclasses.fields(form) if "unit" in field.metadata]
        names = [field.name for field in dataclasses.fields(form) if "unit" in field.metadata]
        given, strength = ", ".join(f"{name}=self.{name}" for name in names), "factor"
    module = "shapes" if type(form).__module__.endswith("shapes") else "forms"
    text = TEMPLATE.format(
        doc=f"What is added at {place.name}, a function of the {place.input.replace('_', ' ')}: {law.formula}.",
        form=type(form).__name__, place=type(place).__name__, place_text=repr(place), form_text=repr(form),
        title="".join(word.capitalize() for word in words), name="_".join(words).lower(),
        source=f"found by piezoharvest diagnose in {campaign}", of=place.input.replace("_", " "),
        looks=f"what is left goes with the {place.input.replace('_', ' ')}", of_specimen=law.law.of_specimen,
        fields="\n".join(f"    {each}" for each in fields), given=given, strength=strength,
    )  # fmt: skip
    return text.replace("nameless.forms import", f"nameless.{module} import")


def save_effect(law: Discovery, campaign: str, path: str | Path) -> None:
    """Write a law as an effect file.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    write_text(effect_text(law, campaign), path)


def _plain(form: Form) -> Form:
    """The form with plain numbers, whose text is Python."""
    values = {
        field.name: tuple(map(float, value)) if isinstance(value, tuple) else value.item()
        if isinstance(value, np.generic) else value
        for field in dataclasses.fields(form)
        for value in [getattr(form, field.name)]
    }  # fmt: skip
    return dataclasses.replace(form, **values)


def _field(form: Form, field: dataclasses.Field) -> str:
    """A field of the effect's class for a quantity of the form, with the value that was found."""
    meta = field.metadata
    bounds = "".join(f", {key}={meta[key]!r}" for key in ("above", "at_least", "below", "at_most", "null")
                     if meta[key] is not None)  # fmt: skip
    return f'{field.name}: float = quantity("", "{meta["doc"]}", default={getattr(form, field.name)!r}{bounds})'
