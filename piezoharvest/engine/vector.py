"""Matrix times vector on flat memory, in vector registers: the innermost operation of the engine.

A matrix stands in memory column by column, its columns padded with zeros to a whole number of registers. A result
element then stays in its register while the columns are added up: no sum across a register, no store until the end.
For the 8 x 8 of a usual model this is twice as fast as what the compiler makes of loops, whose length it does not know.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic as _intrinsic

LANES = 8  # numbers in a register; where the machine's are shorter, the compiler takes two
COLUMNS = 4  # columns that are added up side by side

intrinsic: Any = _intrinsic  # its callers leave the context out, which type checkers do not know

_DOUBLE = ir.DoubleType()
_VECTOR = ir.VectorType(_DOUBLE, LANES)
_INDEX = ir.IntType(64)
_FUSED = ("contract",)  # a product and a sum may be rounded once


def padded(length: int) -> int:
    """The length rounded up to whole registers."""
    return -(-length // LANES) * LANES


class _Memory:
    """Loads and stores of vectors behind a pointer."""

    def __init__(self, builder, data):
        self.builder, self.data = builder, data

    def _at(self, offset):
        return self.builder.gep(self.data, [offset])

    def _vector_at(self, offset):
        return self.builder.bitcast(self._at(offset), _VECTOR.as_pointer())

    def load(self, offset):
        loaded = self.builder.load(self._vector_at(offset))
        loaded.align = 8
        return loaded

    def store(self, value, offset):
        self.builder.store(value, self._vector_at(offset)).align = 8

    def spread(self, offset):
        """One number in every lane."""
        return spread(self.builder, self.builder.load(self._at(offset)))


def spread(builder, number):
    """A number in every lane of a vector."""
    undefined = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(undefined, number, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, undefined, ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES))


def _columns_summed(builder, matrix, at, rows, columns, i, vector, x, start):
    """Elements i... of matrix times vector, some columns at a time so that their sums do not wait for each other."""
    zero, at_once = (ir.Constant(_INDEX, k) for k in (0, COLUMNS))
    sums = [cgutils.alloca_once(builder, _VECTOR) for _ in range(COLUMNS)]
    for total in sums:
        builder.store(ir.Constant(_VECTOR, [0.0] * LANES), total)
    builder.store(start, sums[0])
    with cgutils.for_range_slice(builder, zero, columns, at_once, _INDEX) as (j, _):
        for k, total in enumerate(sums):
            column = builder.add(j, ir.Constant(_INDEX, k))
            factors = matrix.load(builder.add(builder.add(at, i), builder.mul(column, rows)))
            term = builder.fmul(factors, vector.spread(builder.add(x, column)), flags=_FUSED)
            builder.store(builder.fadd(builder.load(total), term, flags=_FUSED), total)
    first, second, third, fourth = (builder.load(total) for total in sums)
    return builder.fadd(builder.fadd(first, second), builder.fadd(third, fourth))


def _blocks(builder, rows):
    return cgutils.for_range_slice(builder, ir.Constant(_INDEX, 0), rows, ir.Constant(_INDEX, LANES), _INDEX)


@intrinsic
def pointer(typing_context: Any, array):
    """Where an array's numbers stand in memory; indexed like the array, without looks at its length or sign."""
    signature = types.CPointer(array.dtype)(array)

    def generate(context, builder, signature, arguments):
        return cgutils.create_struct_proxy(signature.args[0])(context, builder, arguments[0]).data

    return signature, generate


@intrinsic
def copy(typing_context: Any, v, x, y, rows):
    """V[y:] = V[x:], for a padded number of rows."""
    signature = types.void(v, types.intp, types.intp, types.intp)

    def generate(context, builder, signature, arguments):
        v, x, y, rows = arguments
        vector = _Memory(builder, v)
        with _blocks(builder, rows) as (i, _):
            vector.store(vector.load(builder.add(x, i)), builder.add(y, i))
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def dot(typing_context: Any, m, at, v, x, rows):
    """Sum of M[at:] times V[x:], for a padded number of rows."""
    signature = types.float64(m, types.intp, v, types.intp, types.intp)

    def generate(context, builder, signature, arguments):
        m, at, v, x, rows = arguments
        row, vector = _Memory(builder, m), _Memory(builder, v)
        total = cgutils.alloca_once(builder, _VECTOR)
        builder.store(ir.Constant(_VECTOR, [0.0] * LANES), total)
        with _blocks(builder, rows) as (i, _):
            term = builder.fmul(row.load(builder.add(at, i)), vector.load(builder.add(x, i)), flags=_FUSED)
            builder.store(builder.fadd(builder.load(total), term, flags=_FUSED), total)
        half, lanes = builder.load(total), LANES
        while lanes > 1:
            lanes //= 2
            order = [k % lanes + lanes for k in range(lanes)] + [0] * (LANES - lanes)
            mask = ir.Constant(ir.VectorType(ir.IntType(32), LANES), order)
            half = builder.fadd(half, builder.shuffle_vector(half, ir.Constant(_VECTOR, ir.Undefined), mask))
        return builder.extract_element(half, ir.Constant(ir.IntType(32), 0))

    return signature, generate


@intrinsic
def multiply(typing_context: Any, m, at, rows, columns, v, x, y):
    """V[y:] = M V[x:], the matrix at `at` in m with padded rows; their number is a multiple of COLUMNS. y is not x."""
    signature = types.void(m, types.intp, types.intp, types.intp, v, types.intp, types.intp)

    def generate(context, builder, signature, arguments):
        m, at, rows, columns, v, x, y = arguments
        matrix = _Memory(builder, m)
        vector = _Memory(builder, v)
        with _blocks(builder, rows) as (i, _):
            zero = ir.Constant(_VECTOR, [0.0] * LANES)
            vector.store(_columns_summed(builder, matrix, at, rows, columns, i, vector, x, zero), builder.add(y, i))
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def grow(typing_context: Any, m, at, rows, columns, v, x, y):
    """V[y:] = V[x:] + M V[x:]; as in `multiply`."""
    signature = types.void(m, types.intp, types.intp, types.intp, v, types.intp, types.intp)

    def generate(context, builder, signature, arguments):
        m, at, rows, columns, v, x, y = arguments
        matrix = _Memory(builder, m)
        vector = _Memory(builder, v)
        with _blocks(builder, rows) as (i, _):
            start = vector.load(builder.add(x, i))
            vector.store(_columns_summed(builder, matrix, at, rows, columns, i, vector, x, start), builder.add(y, i))
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def add_term(typing_context: Any, m, at, rows, columns, factor, v, x, y, z):
    """V[y:] = factor M V[x:], and V[z:] grows by that: a term of a Taylor series."""
    signature = types.void(
        m, types.intp, types.intp, types.intp, types.float64, v, types.intp, types.intp, types.intp
    )  # fmt: skip

    def generate(context, builder, signature, arguments):
        m, at, rows, columns, factor, v, x, y, z = arguments
        matrix = _Memory(builder, m)
        vector = _Memory(builder, v)
        factors = spread(builder, factor)
        with _blocks(builder, rows) as (i, _):
            zero = ir.Constant(_VECTOR, [0.0] * LANES)
            sums = _columns_summed(builder, matrix, at, rows, columns, i, vector, x, zero)
            term = builder.fmul(sums, factors)
            vector.store(term, builder.add(y, i))
            here = builder.add(z, i)
            vector.store(builder.fadd(vector.load(here), term), here)
        return context.get_dummy_value()

    return signature, generate
