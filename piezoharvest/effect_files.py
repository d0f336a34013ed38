"""Effects in files of their own: Python files whose classes are found like those of the library."""

from __future__ import annotations

import dataclasses
import importlib.util
import sys
import traceback
from pathlib import Path

from piezoharvest.description.effects import Effect, registered
from piezoharvest.input import InputError, check_readable

MOST_BYTES = 1 << 20  # of an effect file: a class is a few kilobytes
_PREFIX = "piezoharvest_effects_"  # of the names of modules that effect files become


def load_effects(path: str | Path) -> list[str]:
    """Run a Python file that defines effects, once; return the names of these.

    Raises
    ------
    InputError
        It cannot be read or run, defines no effect, or one whose name another effect has.
    """
    path = Path(path)
    try:
        check_readable(path, MOST_BYTES)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    if path.suffix != ".py":
        raise InputError(f"{path}: found the ending {path.suffix!r}, an effect file ends with .py")
    module_name = f"{_PREFIX}{path.resolve().as_posix().replace('/', '_').replace('.', '_')}"
    before = registered()
    if module_name not in sys.modules:
        _run(path, module_name)
    own = {cls.__name__: cls for cls in vars(sys.modules[module_name]).values() if _is_of(cls, module_name)}
    lacking = next(((name, what) for name, cls in own.items() if (what := _lacking(cls))), None)
    if lacking is not None:
        raise InputError(f"{path}: class {lacking[0]}: {lacking[1]}")
    names = [name for name, cls in registered().items() if cls.__module__ == module_name]
    taken = [name for name in names if name in before and before[name].__module__ != module_name]
    if taken:
        raise InputError(f"{path}: found an effect named {taken[0]!r}, but another effect has this name")
    if not names:
        raise InputError(f"{path}: found no effect, an effect file defines a subclass of piezoharvest's Effect")
    return names


def place_of(error: BaseException) -> str:
    """File, line and function of an effect file in which an error has come up, "" where it has in none of them."""
    for frame, line in reversed(list(traceback.walk_tb(error.__traceback__))):
        if str(frame.f_globals.get("__name__", "")).startswith(_PREFIX):
            return f"{frame.f_code.co_filename}: line {line}, in {frame.f_code.co_qualname}"
    return ""


def _is_of(cls: object, module_name: str) -> bool:
    """True for a class of an effect that a module defines itself, and from which it derives no other."""
    if not isinstance(cls, type) or not issubclass(cls, Effect):
        return False
    return cls.__module__ == module_name and not cls.__subclasses__()


def _lacking(cls: type[Effect]) -> str:
    """What the class of an effect lacks, in words: what is found later, in the midst of a diagnosis, is none."""
    for attribute in ("name", "source"):
        if not isinstance(getattr(cls, attribute, None), str | property):
            return f"found no {attribute}, an effect needs one ({attribute}: ClassVar[str] = ...)"
    if not any(field.metadata.get("null") is not None for field in dataclasses.fields(cls)):
        needed = "needs a field with the value at which it is absent (quantity(..., null=0.0), in a dataclass)"
        return f"found no null value, an effect {needed}"
    return ""


def _run(path: Path, module_name: str) -> None:
    """Run a file as a module."""
    spec = importlib.util.spec_from_file_location(module_name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module  # where dataclasses look for the names of annotations
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:  # whatever the file does wrong, an exit of its own included
        del sys.modules[module_name]
        raise InputError(f"{path}: the file cannot be run ({type(error).__name__}: {error})") from None
