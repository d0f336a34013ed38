"""Work on many items: in this process, in others, or on a cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from piezoharvest.workers.cluster import on_cluster
from piezoharvest.workers.processes import in_processes
from piezoharvest.workers.stream import Done, Item, Work


def done(
    work: Work, items: Iterable[Item], workers: int, scheduler: str | None, notify: Callable[[str], object]
) -> Done:
    """Items with their results, in order of completion.

    Parameters
    ----------
    work : callable
        From what an item is of to its result; to be pickled where it is done elsewhere.
    items : iterable of Item
    workers : int
        Number of processes; one is this process itself.
    scheduler : str or None
        Address of a running Dask cluster that does the work instead.
    notify : callable
        Called with remarks, in sentences.

    Raises
    ------
    ParameterError
        There is no such scheduler, or its workers do not have this version of the package.
    OSError
        A worker process died, or the cluster was lost.
    """
    if scheduler is not None:
        yield from on_cluster(work, items, scheduler, notify)
    elif workers > 1:
        yield from in_processes(work, items, workers)
    else:
        yield from ((item, work(item.of)) for item in items)
