"""Matrix times vector on flat memory, in vector registers: the innermost operation of the engine.

A matrix stands in memory column by column, its columns padded with zeros to a whole number of registers. A result
element then stays in its register while the columns are added up: no sum across a register, no store until the end. Up
to three registers of the result are computed side by side, so that a number of the vector is broadcast once for all of
them and their sums are independent. For the 8 x 8 of a usual model this is several times as fast as compiled loops,
whose length the compiler does not know.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic as _intrinsic

LANES = 4  # numbers in a register. Longer registers are no faster on most machines, and pad matrices with more zeros
LINE = 8  # numbers in a cache line
COLUMNS = 4  # columns that are added up side by side
BLOCKS = 3  # registers of the result that are computed side by side, at most
GROUP = 4  # vectors that one matrix is multiplied with side by side

intrinsic: Any = _intrinsic  # callers omit the context argument, which type checkers do not know

_DOUBLE = ir.DoubleType()
_VECTOR = ir.VectorType(_DOUBLE, LANES)
_INDEX = ir.IntType(64)
_FUSED = ("contract",)  # a product and a sum may be rounded once


def padded(length: int) -> int:
    """The length rounded up to whole registers."""
    return -(-length // LANES) * LANES


def whole_lines(length: int) -> int:
    """The length rounded up to whole cache lines."""
    return -(-length // LINE) * LINE


def lined_up(length: int) -> np.ndarray:
    """Zeros aligned to a cache line: a register across two lines takes twice as long to load."""
    room = np.zeros(length + LINE)
    begin = -(room.ctypes.data // room.itemsize) % LINE
    return room[begin : begin + length]


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


class _Sizes(_Memory):
    """As `_Memory`, but loads absolute values."""

    def load(self, offset):
        return self._size(super().load(offset))

    def spread(self, offset):
        return self._size(super().spread(offset))

    def _size(self, numbers):
        bits = ir.VectorType(_INDEX, LANES)
        without_sign = self.builder.and_(self.builder.bitcast(numbers, bits), ir.Constant(bits, [2**63 - 1] * LANES))
        return self.builder.bitcast(without_sign, _VECTOR)


def _of_both(builder, relation, first, second):
    """Elementwise larger (">") or smaller ("<") numbers of two vectors."""
    return builder.select(builder.fcmp_ordered(relation, first, second), first, second)


def spread(builder, number):
    """A number in every lane of a vector."""
    undefined = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(undefined, number, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, undefined, ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES))


def _columns_summed(builder, matrix, at, stride, columns, vector, x, starts):
    """Registers of `starts` + matrix times vector, the matrix from `at`, some columns at a time."""
    zero, at_once = (ir.Constant(_INDEX, k) for k in (0, COLUMNS))
    sums = [[cgutils.alloca_once(builder, _VECTOR) for _ in range(COLUMNS)] for _ in starts]
    for start, totals in zip(starts, sums, strict=True):
        for k, total in enumerate(totals):
            builder.store(ir.Constant(_VECTOR, [0.0] * LANES) if k else start, total)
    with cgutils.for_range_slice(builder, zero, columns, at_once, _INDEX) as (j, _):
        for k in range(COLUMNS):
            column = builder.add(j, ir.Constant(_INDEX, k))
            place, factor = builder.add(at, builder.mul(column, stride)), vector.spread(builder.add(x, column))
            for block, totals in enumerate(sums):
                factors = matrix.load(builder.add(place, ir.Constant(_INDEX, block * LANES)))
                term = builder.fmul(factors, factor, flags=_FUSED)
                builder.store(builder.fadd(builder.load(totals[k]), term, flags=_FUSED), totals[k])
    return [_sum(builder, [builder.load(total) for total in totals]) for totals in sums]


def _sum(builder, terms):
    """Sum of four vectors, by pairs."""
    first, second, third, fourth = terms
    return builder.fadd(builder.fadd(first, second), builder.fadd(third, fourth))


@contextmanager
def _while_left(builder, done, rows, length):
    """Loop while at least `length` rows are left; yields the number done."""
    test, body, end = (builder.append_basic_block(name) for name in ("test", "body", "end"))
    builder.branch(test)
    builder.position_at_end(test)
    i = builder.load(done)
    after = builder.add(i, length)
    builder.cbranch(builder.icmp_signed("<=", after, rows), body, end)
    builder.position_at_end(body)
    yield i
    builder.store(after, done)
    builder.branch(test)
    builder.position_at_end(end)


def _product(builder, matrix, at, stride, rows, columns, vector, x, start, finish):
    """Matrix times vector, a few registers at a time, added to register `start(i)` and passed to `finish`."""
    done = cgutils.alloca_once_value(builder, ir.Constant(_INDEX, 0))
    for blocks in range(BLOCKS, 0, -1):
        length = ir.Constant(_INDEX, blocks * LANES)
        with _while_left(builder, done, rows, length) as i:
            places = [builder.add(i, ir.Constant(_INDEX, k * LANES)) for k in range(blocks)]
            starts = [start(place) for place in places]
            found = _columns_summed(builder, matrix, builder.add(at, i), stride, columns, vector, x, starts)
            for place, value in zip(places, found, strict=True):
                finish(place, value)


def _blocks(builder, rows):
    return cgutils.for_range_slice(builder, ir.Constant(_INDEX, 0), rows, ir.Constant(_INDEX, LANES), _INDEX)


@intrinsic
def pointer(typing_context: Any, array):
    """Pointer to an array's numbers; indexed like the array, without checks of bounds or negative indices."""
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
def accumulate(typing_context: Any, v, x, factor, y, rows):
    """V[y:] = V[y:] + factor V[x:], for a padded number of rows."""
    signature = types.void(v, types.intp, types.float64, types.intp, types.intp)

    def generate(context, builder, signature, arguments):
        v, x, factor, y, rows = arguments
        vector, factors = _Memory(builder, v), spread(builder, factor)
        with _blocks(builder, rows) as (i, _):
            here = builder.add(y, i)
            term = builder.fmul(vector.load(builder.add(x, i)), factors, flags=_FUSED)
            vector.store(builder.fadd(vector.load(here), term, flags=_FUSED), here)
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def add_products(typing_context: Any, v, x, y, factor, z, rows):
    """V[z:] = V[z:] + factor V[x:] V[y:], number by number, for a padded number of rows."""
    signature = types.void(v, types.intp, types.intp, types.float64, types.intp, types.intp)

    def generate(context, builder, signature, arguments):
        v, x, y, factor, z, rows = arguments
        vector, factors = _Memory(builder, v), spread(builder, factor)
        with _blocks(builder, rows) as (i, _):
            here = builder.add(z, i)
            product = builder.fmul(vector.load(builder.add(x, i)), vector.load(builder.add(y, i)), flags=_FUSED)
            term = builder.fmul(product, factors, flags=_FUSED)
            vector.store(builder.fadd(vector.load(here), term, flags=_FUSED), here)
        return context.get_dummy_value()

    return signature, generate


def _total(builder, rows, term):
    """Sum of all numbers of `term(i)`, the register from row i on, for a padded number of rows."""
    total = cgutils.alloca_once_value(builder, ir.Constant(_VECTOR, [0.0] * LANES))
    with _blocks(builder, rows) as (i, _):
        builder.store(builder.fadd(builder.load(total), term(i), flags=_FUSED), total)
    return _sum_of_lanes(builder, builder.load(total))


def _sum_of_lanes(builder, half):
    """Sum of the numbers of a register."""
    lanes = LANES
    while lanes > 1:
        lanes //= 2
        order = [k % lanes + lanes for k in range(lanes)] + [0] * (LANES - lanes)
        mask = ir.Constant(ir.VectorType(ir.IntType(32), LANES), order)
        half = builder.fadd(half, builder.shuffle_vector(half, ir.Constant(_VECTOR, ir.Undefined), mask))
    return builder.extract_element(half, ir.Constant(ir.IntType(32), 0))


@intrinsic
def dot(typing_context: Any, m, at, v, x, rows):
    """Sum of M[at:] times V[x:], for a padded number of rows."""
    signature = types.float64(m, types.intp, v, types.intp, types.intp)

    def generate(context, builder, signature, arguments):
        m, at, v, x, rows = arguments
        row, vector = _Memory(builder, m), _Memory(builder, v)

        def term(i):
            return builder.fmul(row.load(builder.add(at, i)), vector.load(builder.add(x, i)), flags=_FUSED)

        return _total(builder, rows, term)

    return signature, generate


@intrinsic
def total_size(typing_context: Any, v, x, rows):
    """Sum of the absolute values of V[x:], for a padded number of rows."""
    signature = types.float64(v, types.intp, types.intp)

    def generate(context, builder, signature, arguments):
        v, x, rows = arguments
        vector = _Sizes(builder, v)
        return _total(builder, rows, lambda i: vector.load(builder.add(x, i)))

    return signature, generate


def _summed_form(builder, matrix, at, rows, columns, vector, x):
    """Sum of all terms of a quadratic form of V[x:], the form as the matrix of `multiply`."""
    nothing = ir.Constant(_VECTOR, [0.0] * LANES)
    total = cgutils.alloca_once_value(builder, nothing)

    def add(i, found):
        term = builder.fmul(found, vector.load(builder.add(x, i)), flags=_FUSED)
        builder.store(builder.fadd(builder.load(total), term, flags=_FUSED), total)

    _product(builder, matrix, at, rows, rows, columns, vector, x, lambda i: nothing, add)
    return _sum_of_lanes(builder, builder.load(total))


@intrinsic
def form(typing_context: Any, m, at, rows, columns, v, x):
    """Value of a quadratic form of V[x:], the form as the matrix of `multiply`."""
    signature = types.float64(m, types.intp, types.intp, types.intp, v, types.intp)

    def generate(context, builder, signature, arguments):
        m, at, rows, columns, v, x = arguments
        return _summed_form(builder, _Memory(builder, m), at, rows, columns, _Memory(builder, v), x)

    return signature, generate


@intrinsic
def form_size(typing_context: Any, m, at, rows, columns, v, x):
    """Sum of the absolute values of all terms of a quadratic form, as in `form`."""
    signature = types.float64(m, types.intp, types.intp, types.intp, v, types.intp)

    def generate(context, builder, signature, arguments):
        m, at, rows, columns, v, x = arguments
        return _summed_form(builder, _Sizes(builder, m), at, rows, columns, _Sizes(builder, v), x)

    return signature, generate


@intrinsic
def multiply(typing_context: Any, m, at, rows, columns, v, x, y):
    """V[y:] = M V[x:], the matrix at `at` in m with padded rows; their number is a multiple of COLUMNS. y is not x."""
    signature = types.void(m, types.intp, types.intp, types.intp, v, types.intp, types.intp)

    def generate(context, builder, signature, arguments):
        m, at, rows, columns, v, x, y = arguments
        matrix = _Memory(builder, m)
        vector = _Memory(builder, v)
        nothing = ir.Constant(_VECTOR, [0.0] * LANES)
        _product(
            builder, matrix, at, rows, rows, columns, vector, x,
            lambda i: nothing,
            lambda i, found: vector.store(found, builder.add(y, i)),
        )  # fmt: skip
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
        _product(
            builder, matrix, at, rows, rows, columns, vector, x,
            lambda i: vector.load(builder.add(x, i)),
            lambda i, found: vector.store(found, builder.add(y, i)),
        )  # fmt: skip
        return context.get_dummy_value()

    return signature, generate


def _products(builder, matrix, at, stride, rows, columns, vector, x, count, y, start):
    """Matrix times vectors that stand one after the other, GROUP of them side by side, added to `start(offset)`.

    A register of the matrix is loaded once for all of the group: with many modes it is not in the nearest cache.
    """
    done = cgutils.alloca_once_value(builder, ir.Constant(_INDEX, 0))
    begin, group = (ir.Constant(_INDEX, number) for number in (0, GROUP))
    for blocks in (2, 1):
        length = ir.Constant(_INDEX, blocks * LANES)
        with (
            _while_left(builder, done, rows, length) as i,
            cgutils.for_range_slice(builder, begin, count, group, _INDEX) as (s, _),
        ):
            ahead = [builder.mul(builder.add(s, ir.Constant(_INDEX, g)), rows) for g in range(GROUP)]
            places = [builder.add(i, ir.Constant(_INDEX, k * LANES)) for k in range(blocks)]
            sums = [[cgutils.alloca_once(builder, _VECTOR) for _ in ahead] for _ in places]
            for place, totals in zip(places, sums, strict=True):
                for offset, total in zip(ahead, totals, strict=True):
                    builder.store(start(builder.add(offset, place)), total)
            with cgutils.for_range(builder, columns) as loop:
                column = builder.add(at, builder.mul(loop.index, stride))
                factors = [matrix.load(builder.add(column, place)) for place in places]
                for g, offset in enumerate(ahead):
                    number = vector.spread(builder.add(builder.add(x, offset), loop.index))
                    for factor, totals in zip(factors, sums, strict=True):
                        term = builder.fmul(factor, number, flags=_FUSED)
                        builder.store(builder.fadd(builder.load(totals[g]), term, flags=_FUSED), totals[g])
            for place, totals in zip(places, sums, strict=True):
                for offset, total in zip(ahead, totals, strict=True):
                    vector.store(builder.load(total), builder.add(builder.add(y, offset), place))


@intrinsic
def multiply_all(typing_context: Any, m, at, stride, rows, columns, v, x, count, y):
    """As `multiply_top` for vectors that stand one after the other from V[x:]; their number is a multiple of GROUP."""
    signature = types.void(m, *[types.intp] * 4, v, *[types.intp] * 3)

    def generate(context, builder, signature, arguments):
        m, at, stride, rows, columns, v, x, count, y = arguments
        matrix, vector, nothing = _Memory(builder, m), _Memory(builder, v), ir.Constant(_VECTOR, [0.0] * LANES)
        _products(builder, matrix, at, stride, rows, columns, vector, x, count, y, lambda offset: nothing)
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def grow_all(typing_context: Any, m, at, rows, columns, v, x, count, y):
    """As `grow` for vectors that stand one after the other from V[x:]; their number is a multiple of GROUP."""
    signature = types.void(m, *[types.intp] * 3, v, *[types.intp] * 3)

    def generate(context, builder, signature, arguments):
        m, at, rows, columns, v, x, count, y = arguments
        matrix, vector = _Memory(builder, m), _Memory(builder, v)

        def start(offset):
            return vector.load(builder.add(x, offset))

        _products(builder, matrix, at, rows, rows, columns, vector, x, count, y, start)
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def add_all(typing_context: Any, m, at, stride, rows, columns, v, x, count, y):
    """As `add_product` for vectors that stand one after the other from V[x:]; their number is a multiple of GROUP."""
    signature = types.void(m, *[types.intp] * 4, v, *[types.intp] * 3)

    def generate(context, builder, signature, arguments):
        m, at, stride, rows, columns, v, x, count, y = arguments
        matrix, vector = _Memory(builder, m), _Memory(builder, v)

        def start(offset):
            return vector.load(builder.add(y, offset))

        _products(builder, matrix, at, stride, rows, columns, vector, x, count, y, start)
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def polynomial(typing_context: Any, v, x, rows, order, factor, y):
    """V[y:] = sum of factor^k times the k-th of order + 1 vectors that stand one after the other from V[x:]."""
    signature = types.void(v, types.intp, types.intp, types.intp, types.float64, types.intp)

    def generate(context, builder, signature, arguments):
        v, x, rows, order, factor, y = arguments
        vector, factors = _Memory(builder, v), spread(builder, factor)
        total = cgutils.alloca_once(builder, _VECTOR)
        with _blocks(builder, rows) as (i, _):
            here = builder.add(x, i)
            builder.store(vector.load(builder.add(here, builder.mul(order, rows))), total)
            with cgutils.for_range(builder, order) as loop:
                k = builder.sub(builder.sub(order, ir.Constant(_INDEX, 1)), loop.index)
                product = builder.fmul(builder.load(total), factors, flags=_FUSED)
                term = vector.load(builder.add(here, builder.mul(k, rows)))
                builder.store(builder.fadd(product, term, flags=_FUSED), total)
            vector.store(builder.load(total), builder.add(y, i))
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def combine(typing_context: Any, v, x, rows, factors, y):
    """V[y:] = sum of four factors, a tuple, times vectors that stand one after the other from V[x:]."""
    signature = types.void(v, types.intp, types.intp, types.UniTuple(types.float64, 4), types.intp)

    def generate(context, builder, signature, arguments):
        v, x, rows, factors, y = arguments
        vector, spreads = _Memory(builder, v), [spread(builder, f) for f in cgutils.unpack_tuple(builder, factors)]
        with _blocks(builder, rows) as (i, _):
            here = builder.add(x, i)
            places = [builder.add(here, builder.mul(rows, ir.Constant(_INDEX, k))) for k in range(len(spreads))]
            terms = [builder.fmul(vector.load(p), f, flags=_FUSED) for p, f in zip(places, spreads, strict=True)]
            vector.store(_sum(builder, terms), builder.add(y, i))
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def add_product(typing_context: Any, m, at, stride, rows, columns, v, x, y):
    """V[y:] = V[y:] + the first rows of M V[x:], M having `stride` rows; otherwise as `multiply`."""
    signature = types.void(m, types.intp, types.intp, types.intp, types.intp, v, types.intp, types.intp)

    def generate(context, builder, signature, arguments):
        m, at, stride, rows, columns, v, x, y = arguments
        vector = _Memory(builder, v)
        _product(
            builder, _Memory(builder, m), at, stride, rows, columns, vector, x,
            lambda i: vector.load(builder.add(y, i)),
            lambda i, found: vector.store(found, builder.add(y, i)),
        )  # fmt: skip
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def multiply_top(typing_context: Any, m, at, stride, rows, columns, v, x, y):
    """V[y:] = the first rows of M V[x:], M having `stride` rows; otherwise as `multiply`."""
    signature = types.void(m, types.intp, types.intp, types.intp, types.intp, v, types.intp, types.intp)

    def generate(context, builder, signature, arguments):
        m, at, stride, rows, columns, v, x, y = arguments
        vector, nothing = _Memory(builder, v), ir.Constant(_VECTOR, [0.0] * LANES)
        _product(
            builder, _Memory(builder, m), at, stride, rows, columns, vector, x,
            lambda i: nothing,
            lambda i, found: vector.store(found, builder.add(y, i)),
        )  # fmt: skip
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def inside(typing_context: Any, m, at, stride, rows, columns, v, bends, pairs, lower, upper):
    """True if the first rows of two vectors are inside two limits by more than M |V[bends:]|; M as in `multiply_top`.

    Registers of the two vectors alternate from V[pairs:] on.
    """
    signature = types.boolean(m, *[types.intp] * 4, v, *[types.intp] * 4)

    def generate(context, builder, signature, arguments):
        m, at, stride, rows, columns, v, bends, pairs, lower, upper = arguments
        vector, mask = _Memory(builder, v), ir.VectorType(ir.IntType(1), LANES)
        all_of_them = cgutils.alloca_once_value(builder, ir.Constant(mask, [1] * LANES))
        nothing = ir.Constant(_VECTOR, [0.0] * LANES)

        def compare(i, margin):
            # The margin, which is known last, is compared once; if it is NaN, nothing is inside.
            place = builder.add(pairs, builder.add(i, i))
            first, second = (vector.load(builder.add(place, ir.Constant(_INDEX, k * LANES))) for k in range(2))
            above = builder.fsub(vector.load(builder.add(upper, i)), _of_both(builder, ">", first, second))
            below = builder.fsub(_of_both(builder, "<", first, second), vector.load(builder.add(lower, i)))
            test = builder.fcmp_ordered(">", _of_both(builder, "<", above, below), margin)
            builder.store(builder.and_(builder.load(all_of_them), test), all_of_them)

        sizes = _Sizes(builder, v)
        _product(builder, _Memory(builder, m), at, stride, rows, columns, sizes, bends, lambda i: nothing, compare)
        lanes = builder.bitcast(builder.load(all_of_them), ir.IntType(LANES))
        return builder.icmp_unsigned("==", lanes, ir.Constant(ir.IntType(LANES), 2**LANES - 1))

    return signature, generate
