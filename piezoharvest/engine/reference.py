"""Records of arrays handed to compiled code by pointer.

Numba passes a named tuple by value: every array in it is seven arguments of every call, which costs more than the
arithmetic and minutes of compilation. A `structref` holds the same arrays (no copy) behind one pointer.
"""

from __future__ import annotations

from numba import types
from numba.experimental import structref


def reference(values: type) -> tuple[type, type]:
    """Make the compiled counterpart of a NamedTuple class: its constructor `<name>Ref`, and the type `<name>Type`.

    Both must be bound to these names in the module that calls this, for the cache on disk to find them again.
    """

    def preprocess_fields(self, fields):
        return tuple((name, types.unliteral(field)) for name, field in fields)

    names = [values.__name__ + suffix for suffix in ("Ref", "Type")]
    place = {"__module__": values.__module__}
    ref_type = type(names[1], (types.StructRef,), {**place, "preprocess_fields": preprocess_fields})
    structref.register(ref_type)
    ref = type(names[0], (structref.StructRefProxy,), place)
    structref.define_boxing(ref_type, ref)
    structref.define_constructor(ref, ref_type, list(values._fields))
    return ref, ref_type
