"""Docstrings of components for `help()`: their fields with units, defaults and bounds, from the fields' metadata."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Callable, Iterator

_SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}$", re.MULTILINE)


class WithFields:
    """Docstring of a dataclass, with a section on its fields: a descriptor, as a class has fields only once it is made.

    Parameters
    ----------
    text : str
        Docstring as it is written, kept where it has such a section itself.
    allowed : callable
        Allowed values of a field that is a quantity, in words.
    """

    def __init__(self, text: str, allowed: Callable[[dataclasses.Field], str]):
        self.text, self._allowed = text, allowed

    def __get__(self, instance: object, owner: type) -> str:
        text = inspect.cleandoc(self.text)
        sections = list(_SECTION.finditer(text))
        if any(section[1] in ("Parameters", "Attributes") for section in sections):
            return text
        fields = getattr(owner, "__dataclass_fields__", {}).values()
        lines = [line for field in fields if field.init and field.metadata for line in self._lines(field)]
        if not lines:
            return text
        end = sections[0].start() if sections else len(text)
        parts = text[:end].strip(), "\n".join(["Parameters", "----------", *lines]), text[end:].strip()
        return "\n\n".join(part for part in parts if part)

    def _lines(self, field: dataclasses.Field) -> Iterator[str]:
        """Lines of a field: name, type and unit; description, bounds and default."""
        kind = field.type.__name__ if isinstance(field.type, type) else str(field.type).removesuffix(" | None")
        unit = field.metadata.get("unit")
        yield f"{field.name} : {kind}{f' ({unit})' if unit else ''}{'' if _required(field) else ', optional'}"
        said = field.metadata["doc"]
        if unit is not None and (bounds := self._allowed(field).removeprefix("a finite number").strip()):
            said += f"; {bounds}"
        if field.default not in (dataclasses.MISSING, None, "", ()):
            said += f"; default {field.default}"
        yield f"    {said[:1].upper()}{said[1:]}."


def _required(field: dataclasses.Field) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
