"""Identification of the partial results of a sweep."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from typing import Any

import numpy as np

from piezoharvest import __version__
from piezoharvest.study import Study


def fingerprint(study: Study) -> str:
    """Hash of all that the results of a sweep depend on: the components, [sweep], records read, the version."""
    content = [__version__, study.transducer, study.excitation, study.shunts, study.sweep]
    return hashlib.sha256(json.dumps(_plain(content), sort_keys=True).encode()).hexdigest()


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        fields = {field.name: _plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
        return [type(value).__qualname__, fields]
    if isinstance(value, np.ndarray):
        return [str(value.dtype), value.shape, hashlib.sha256(value.tobytes()).hexdigest()]
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    return value if value is None or isinstance(value, bool | int | float | str) else repr(value)
