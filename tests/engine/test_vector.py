"""Innermost operations on flat memory against NumPy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezoharvest.engine.compilation.compiled import entry
from piezoharvest.engine.memory import vector as vc
from piezoharvest.engine.memory.algebra import radius, solve_conserving

MULTIPLY, GROW, POLYNOMIAL, COPY, DOT, TOP, INSIDE, ADD, COMBINE, SIZE, MULTIPLY_ALL, GROW_ALL, ADD_ALL = range(13)
EDGE = 7.25  # what stands around a result and must stay


@entry
def operate(task, matrix, at, rows, columns, factor, order, vectors, x, y):
    """One operation of `vector` on flat arrays."""
    m, v = vc.pointer(matrix), vc.pointer(vectors)
    if task == MULTIPLY:
        vc.multiply(m, at, rows, columns, v, x, y)
    elif task == GROW:
        vc.grow(m, at, rows, columns, v, x, y)
    elif task == POLYNOMIAL:
        vc.polynomial(v, x, rows, order, factor, y)
    elif task == COPY:
        vc.copy(v, x, y, rows)
    elif task == TOP:
        vc.multiply_top(m, at, rows, order, columns, v, x, y)
    elif task == ADD:
        vc.add_product(m, at, rows, order, columns, v, x, y)
    elif task == COMBINE:
        vc.combine(v, x, rows, (1.0, factor, factor * factor, -2.0), y)
    elif task == MULTIPLY_ALL:
        vc.multiply_all(m, at, rows, order, columns, v, x, 2 * vc.GROUP, y)
    elif task == GROW_ALL:
        vc.grow_all(m, at, rows, columns, v, x, 2 * vc.GROUP, y)
    elif task == ADD_ALL:
        vc.add_all(m, at, rows, order, columns, v, x, 2 * vc.GROUP, y)
    elif task == SIZE:
        return vc.total_size(v, x, rows)
    elif task == INSIDE:
        lower = y + 2 * order
        return 1.0 if vc.inside(m, at, rows, order, columns, v, x, y, lower, lower + order) else 0.0
    else:
        return vc.dot(m, at, v, x, rows)
    return 0.0


@entry
def solve(numbers, integers, matrix, right, n, order, work, out):
    solve_conserving(vc.pointer(numbers), vc.pointer(integers), matrix, right, n, order, work, out)


@entry
def spectral_radius(numbers, matrix, n, work):
    return radius(vc.pointer(numbers), matrix, n, work)


class Memory:
    """A padded matrix, column by column, and three vectors, with gaps between them."""

    def __init__(self, seed, rows, columns, gap):
        rng = np.random.default_rng(seed)
        self.rows, self.columns = vc.padded(rows), -(-columns // vc.COLUMNS) * vc.COLUMNS
        self.a = np.zeros((self.rows, self.columns))
        self.a[:rows, :columns] = rng.normal(size=(rows, columns)) * 10.0 ** rng.uniform(-3, 3, (rows, columns))
        self.at, length = gap, max(self.rows, self.columns)
        self.matrix = np.concatenate([np.full(gap, EDGE), self.a.T.ravel(), np.full(gap, EDGE)])
        self.x, self.y, self.z = (gap + k * (length + gap) for k in range(3))
        self.vectors = np.full(self.z + length + gap, EDGE)
        self.length = length
        for begin in (self.x, self.y, self.z):
            self.vectors[begin : begin + length] = rng.normal(size=length)
        self.before = self.vectors.copy()

    def run(self, task, factor=1.0, order=0):
        sizes = self.rows, self.columns
        return operate(task, self.matrix, self.at, *sizes, factor, order, self.vectors, self.x, self.y)

    def vector(self, place, memory=None, count=None):
        return (self.before if memory is None else memory)[place : place + (count or self.rows)]

    def check(self, wanted):
        """The vectors named hold these values, to the rounding of a sum in any order, and nothing else has changed."""
        size = np.abs(self.a) @ np.abs(self.vector(self.x, count=self.columns)) + np.abs(self.before).max()
        for place, value in wanted.items():
            assert np.all(np.abs(self.vector(place, self.vectors) - value) <= 1e-14 * size)
            self.vectors[place : place + self.rows] = self.before[place : place + self.rows]
        assert np.array_equal(self.vectors, self.before)


sizes = {
    "seed": st.integers(0, 10**6), "rows": st.integers(1, 40), "columns": st.integers(1, 40), "gap": st.integers(0, 9),
}  # fmt: skip


@settings(max_examples=100, deadline=None)
@given(**sizes)
def test_multiply(seed, rows, columns, gap):
    memory = Memory(seed, rows, columns, gap)
    memory.run(MULTIPLY)
    memory.check({memory.y: memory.a @ memory.vector(memory.x, count=memory.columns)})


@settings(max_examples=100, deadline=None)
@given(**sizes)
def test_grow(seed, rows, columns, gap):
    memory = Memory(seed, rows, columns, gap)
    memory.run(GROW)
    product = memory.a @ memory.vector(memory.x, count=memory.columns)
    memory.check({memory.y: memory.vector(memory.x) + product})


@settings(max_examples=100, deadline=None)
@given(factor=st.floats(-10, 10), order=st.integers(0, 9), **sizes)
def test_polynomial(seed, rows, columns, gap, factor, order):
    memory = Memory(seed, rows, columns, gap)
    terms = np.random.default_rng(seed).normal(size=(order + 1, memory.rows))
    memory.vectors = np.concatenate([memory.vectors, terms.ravel()])
    memory.before, memory.x = memory.vectors.copy(), len(memory.vectors) - terms.size
    memory.run(POLYNOMIAL, factor, order)
    size = np.abs(terms).T @ np.abs(factor) ** np.arange(order + 1)
    found = memory.vector(memory.y, memory.vectors).copy()
    assert np.all(np.abs(found - terms.T @ factor ** np.arange(order + 1)) <= 1e-14 * size)
    memory.vectors[memory.y : memory.y + memory.rows] = memory.vector(memory.y)
    assert np.array_equal(memory.vectors, memory.before)


@settings(max_examples=100, deadline=None)
@given(factor=st.floats(-10, 10), **sizes)
def test_combine(seed, rows, columns, gap, factor):
    memory = Memory(seed, rows, columns, gap)
    terms = np.random.default_rng(seed).normal(size=(4, memory.rows))
    memory.vectors = np.concatenate([memory.vectors, terms.ravel()])
    memory.before, memory.x = memory.vectors.copy(), len(memory.vectors) - terms.size
    memory.run(COMBINE, factor)
    factors = np.array([1.0, factor, factor**2, -2.0])
    found = memory.vector(memory.y, memory.vectors).copy()
    assert np.all(np.abs(found - terms.T @ factors) <= 1e-14 * np.abs(terms).T @ np.abs(factors))
    memory.vectors[memory.y : memory.y + memory.rows] = memory.vector(memory.y)
    assert np.array_equal(memory.vectors, memory.before)


@settings(max_examples=100, deadline=None)
@given(share=st.floats(0, 1), **sizes)
def test_add_product(seed, rows, columns, gap, share):
    memory = Memory(seed, rows, columns, gap)
    top = vc.padded(int(share * memory.rows))
    memory.run(ADD, order=top)
    wanted = memory.vector(memory.y).copy()
    wanted[:top] += memory.a[:top] @ memory.vector(memory.x, count=memory.columns)
    memory.check({memory.y: wanted})


@settings(max_examples=100, deadline=None)
@given(task=st.sampled_from([MULTIPLY_ALL, GROW_ALL, ADD_ALL]), side=st.integers(1, 40), seed=sizes["seed"])
def test_products_with_vectors_one_after_the_other(task, side, seed):
    memory, count = Memory(seed, side, side, 3), 2 * vc.GROUP
    x, y = np.random.default_rng(seed).normal(size=(2, count, memory.rows))
    memory.vectors = np.concatenate([memory.vectors, x.ravel(), y.ravel(), [EDGE]])
    memory.y = len(memory.vectors) - 1 - y.size
    memory.x, before = memory.y - x.size, memory.vectors.copy()
    memory.run(task, order=memory.rows)
    wanted = {MULTIPLY_ALL: 0.0, GROW_ALL: x, ADD_ALL: y}[task] + x @ memory.a.T
    size = np.abs(x) @ np.abs(memory.a.T) + np.abs(x) + np.abs(y)
    found = memory.vectors[memory.y : memory.y + y.size].reshape(y.shape)
    assert np.all(np.abs(found - wanted) <= 1e-14 * size)
    memory.vectors[memory.y : memory.y + y.size] = y.ravel()
    assert np.array_equal(memory.vectors, before)


@settings(max_examples=50, deadline=None)
@given(**sizes)
def test_total_size(seed, rows, columns, gap):
    memory = Memory(seed, rows, columns, gap)
    wanted = np.abs(memory.vector(memory.x)).sum()
    assert abs(memory.run(SIZE) - wanted) <= 1e-14 * wanted


@settings(max_examples=50, deadline=None)
@given(**sizes)
def test_copy_is_exact(seed, rows, columns, gap):
    memory = Memory(seed, rows, columns, gap)
    memory.run(COPY)
    assert np.array_equal(memory.vector(memory.y, memory.vectors), memory.vector(memory.x))
    memory.check({memory.y: memory.vector(memory.x)})


@settings(max_examples=100, deadline=None)
@given(share=st.floats(0, 1), **sizes)
def test_multiply_top(seed, rows, columns, gap, share):
    memory = Memory(seed, rows, columns, gap)
    top = vc.padded(max(int(share * rows), 1))
    memory.run(TOP, order=top)
    product = memory.a @ memory.vector(memory.x, count=memory.columns)
    memory.check({memory.y: np.append(product[:top], memory.vector(memory.y)[top:])})


@settings(max_examples=200, deadline=None)
@given(crossed=st.booleans(), **sizes)
def test_inside(seed, rows, columns, gap, crossed):
    """Both vectors keep a distance from the limits, or one number does not."""
    memory, rng = Memory(seed, rows, columns, gap), np.random.default_rng(seed)
    count = vc.LANES * rng.integers(1, memory.rows // vc.LANES + 1)
    bends = memory.vector(memory.x, count=memory.columns)
    margin = (np.abs(memory.a) @ np.abs(bends))[:count]
    memory.a, memory.matrix = np.abs(memory.a), np.abs(memory.matrix)
    first, second = rng.uniform(-1, 1, (2, count))
    lower, upper = np.minimum(first, second) - 1.001 * margin - 1e-9, np.maximum(first, second) + 1.001 * margin + 1e-9
    lower[rng.random(count) < 0.3], upper[rng.random(count) < 0.3] = -np.inf, np.inf
    if crossed:
        k, which, above = rng.integers(count), rng.integers(2), rng.integers(2)
        value = (first, second)[which][k]
        if above:
            upper[k] = value + 0.999 * margin[k]
        else:
            lower[k] = value - 0.999 * margin[k]
    pairs = np.stack([first.reshape(-1, vc.LANES), second.reshape(-1, vc.LANES)], axis=1).ravel()
    memory.vectors, memory.y = np.concatenate([memory.vectors, pairs, lower, upper]), len(memory.vectors)
    before = memory.vectors.copy()
    assert memory.run(INSIDE, order=count) == (0.0 if crossed else 1.0)
    assert np.array_equal(memory.vectors, before)


@settings(max_examples=50, deadline=None)
@given(**sizes)
def test_dot(seed, rows, columns, gap):
    memory = Memory(seed, rows, columns, gap)
    x, column = memory.vector(memory.x), memory.matrix[memory.at : memory.at + memory.rows]
    found = memory.run(DOT)
    assert abs(found - column @ x) <= 1e-14 * (np.abs(column) @ np.abs(x) + 1e-300)
    assert np.array_equal(memory.vectors, memory.before)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 14), free=st.integers(0, 3))
def test_solve_conserving(seed, n, free):
    """I - M, of which `free` left vectors are null: the solution solves what can be, and leaves the rest alone."""
    rng, free = np.random.default_rng(seed), min(free, n)
    left, _ = np.linalg.qr(rng.normal(size=(n, n)))
    right, _ = np.linalg.qr(rng.normal(size=(n, n)))
    size = np.concatenate([10.0 ** rng.uniform(-3, 0, n - free), np.zeros(free)])
    matrix, conserved = (left * size) @ right.T, left[:, n - free :]
    wanted = matrix @ rng.normal(size=n)
    # What is conserved must not be orthogonal to what may move, or no solution has c'x = 0.
    if free and np.linalg.svd(conserved.T @ right[:, n - free :])[1].min() < 0.05:
        return
    numbers, integers = np.zeros(5 * n * n + 3 * n), np.zeros(2 * n, np.int64)
    numbers[: n * n], numbers[n * n : n * n + n] = matrix.ravel(), wanted
    work = n * n + 2 * n
    solve(numbers, integers, 0, n * n, n, 0, work, n * n + n)
    found = numbers[n * n + n : n * n + 2 * n]
    assert np.abs(matrix @ found - wanted).max() <= 1e-9 * max(np.abs(wanted).max(), 1e-3)
    assert np.abs(conserved.T @ found).max(initial=0.0) <= 1e-8 * max(np.abs(found).max(), 1.0)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 14), exponent=st.floats(-100, 100))
def test_radius(seed, n, exponent):
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(n, n)) * 10.0**exponent
    numbers = np.concatenate([matrix.ravel(), np.zeros(2 * (n + 3) ** 2)])
    wanted = np.abs(np.linalg.eigvals(matrix)).max()
    assert spectral_radius(numbers, 0, n, n * n) == pytest.approx(wanted, rel=2e-6)
    assert np.array_equal(numbers[: n * n], matrix.ravel())


@pytest.mark.parametrize(
    ("matrix", "wanted"),
    [
        (np.zeros((4, 4)), 0.0),
        (np.eye(5), 1.0),
        (np.diag([0.5, -1.0, 0.25]), 1.0),
        (np.array([[0.0, 1.0], [-1.0, 0.0]]), 1.0),
        (np.array([[1.0, 1e3], [0.0, 1.0]]), 1.0),
        (np.triu(np.ones((6, 6)), 1), 0.0),
    ],
    ids=["zero", "identity", "sign", "rotation", "Jordan block", "nilpotent"],
)
def test_radius_of_special_matrices(matrix, wanted):
    n = len(matrix)
    numbers = np.concatenate([matrix.ravel(), np.zeros(2 * (n + 3) ** 2)])
    assert spectral_radius(numbers, 0, n, n * n) == pytest.approx(wanted, abs=2e-6)


def test_radius_without_bound():
    numbers = np.concatenate([[np.inf], np.zeros(32)])
    assert spectral_radius(numbers, 0, 1, 1) == np.inf


@given(length=st.integers(1, 1000))
def test_memory_begins_at_a_cache_line(length):
    memory = vc.lined_up(length)
    assert len(memory) == length
    assert memory.ctypes.data % (8 * vc.LINE) == 0
    assert not memory.any()
    assert length <= vc.whole_lines(length) < length + vc.LINE
    assert vc.whole_lines(length) % vc.LINE == 0
