"""Evaluation of chunks by an executor, a bounded number of them at a time."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from typing import Any, NamedTuple

import numpy as np


class Chunk(NamedTuple):
    """A chunk of a plan: its index and its (n, p) values."""

    number: int
    values: np.ndarray


Done = Generator[tuple[Chunk, Any], None, None]


def stream(executor: Executor, evaluate: Callable[[np.ndarray], Any], chunks: Iterable[Chunk], most: int) -> Done:
    """Evaluate chunks; each is returned once with its answers, in order of completion.

    Parameters
    ----------
    executor : Executor
        Local processes, or those of a cluster.
    evaluate : callable
        From the values of a chunk to its answers.
    Consumed as chunks are completed.
        Taken as there is room for them.
    most : int
        Number of chunks in progress or waiting at a time.
    """
    under_way: dict[Future, Chunk] = {}
    for chunk in chunks:
        under_way[executor.submit(evaluate, chunk.values)] = chunk
        if len(under_way) >= most:
            yield from _done(under_way)
    while under_way:
        yield from _done(under_way)


def _done(under_way: dict[Future, Chunk]) -> Done:
    for future in wait(under_way, return_when=FIRST_COMPLETED).done:
        yield under_way.pop(future), future.result()
