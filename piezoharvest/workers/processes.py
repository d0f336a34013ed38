"""Work on many items in processes of this machine."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import Connection

from piezoharvest.workers.stream import Done, Item, Work, stream

# Each process has one core to itself; several threads in it would only compete.
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_ITEMS_PER_PROCESS = 2  # so that none waits for the next one


def start_early(*modules: str) -> None:
    """Let a server import modules of the worker processes, which are forked from it, while input is read."""
    if _method() == "forkserver":
        from multiprocessing import forkserver

        multiprocessing.set_forkserver_preload(list(modules))
        with _single_threaded():
            forkserver.ensure_running()


def in_processes(work: Work, items: Iterable[Item], workers: int) -> Done:
    """Do the work on items in a number of processes, each on one core.

    Raises
    ------
    OSError
        A process died.
    """
    context = multiprocessing.get_context(_method())
    worker_end, parent_end = context.Pipe(duplex=False)
    with _single_threaded():
        pool = ProcessPoolExecutor(workers, context, begin_worker, (worker_end,))
        try:
            yield from stream(pool, work, items, _ITEMS_PER_PROCESS * workers)
        except BrokenExecutor:
            raise OSError("a worker process died (too little memory?); the same command goes on from here") from None
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            parent_end.close()


def _method() -> str:
    return "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"


def begin_worker(worker_end: Connection) -> None:
    """Start a worker process: it ignores interrupts, and ends when its parent closes the pipe or is killed.

    Parameters
    ----------
    worker_end : Connection
        The receiving end of a pipe whose other end only the parent holds.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(worker_end,), daemon=True).start()


def _end_with(worker_end: Connection) -> None:
    try:
        worker_end.recv()
    except (EOFError, OSError):
        os._exit(1)


@contextmanager
def _single_threaded() -> Iterator[None]:
    """Environment for processes started within the block: one thread each; variables set by the user are kept."""
    own = [name for name in _ONE_THREAD if name not in os.environ]
    os.environ.update(dict.fromkeys(own, "1"))
    try:
        yield
    finally:
        for name in own:
            os.environ.pop(name, None)
