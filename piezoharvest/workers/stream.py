"""Work on many items by an executor, a bounded number of them at a time."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from typing import Any, NamedTuple


class Item(NamedTuple):
    """A piece of work: its number and what it is done on."""

    number: int
    of: Any


Work = Callable[[Any], Any]
Done = Generator[tuple[Item, Any], None, None]


def stream(executor: Executor, work: Work, items: Iterable[Item], most: int) -> Done:
    """Do the work on items; each is returned once with its result, in order of completion.

    Parameters
    ----------
    executor : Executor
        Local processes, or those of a cluster.
    work : callable
        From what an item is of to its result.
    items : iterable of Item
        Taken as there is room for them.
    most : int
        Number of items in progress or waiting at a time.
    """
    under_way: dict[Future, Item] = {}
    for item in items:
        under_way[executor.submit(work, item.of)] = item
        if len(under_way) >= most:
            yield from _done(under_way)
    while under_way:
        yield from _done(under_way)


def _done(under_way: dict[Future, Item]) -> Done:
    for future in wait(under_way, return_when=FIRST_COMPLETED).done:
        yield under_way.pop(future), future.result()
