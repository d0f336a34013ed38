"""Work on many items on the workers of a Dask cluster."""

from __future__ import annotations

import asyncio
import logging
import pickle
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

from piezoharvest import __version__
from piezoharvest.description.parameters import ParameterError
from piezoharvest.workers.stream import Done, Item, Work, stream

if TYPE_CHECKING:
    from distributed import Client

_KEY = "--scheduler"
_TIMEOUT = 8.0  # s, to wait for a scheduler to answer, or to start listening
_ITEMS_PER_THREAD = 4  # in progress for each thread of the cluster
_MIN_ITEMS = 64  # in progress at least, so that a cluster that scales with its load does


def on_cluster(work: Work, items: Iterable[Item], address: str, notify: Callable[[str], object]) -> Done:
    """Do the work on items on a running Dask cluster, which reassigns those of a lost worker.

    Raises
    ------
    ParameterError
        Dask is not installed, there is no scheduler at the address, or its workers do not have this version of the
        package.
    OSError
        The cluster was lost.
    """
    try:
        from distributed import KilledWorker
    except ImportError:
        message = "a cluster needs the package distributed, which is not installed: pip install 'piezoharvest[cluster]'"
        raise ParameterError(_KEY, message) from None

    with _connected(address) as client:
        threads = sum(client.nthreads().values())  # pyright: ignore[reportAttributeAccessIssue]
        if not threads:
            notify(f"waiting for workers to join {address}")
        executor = client.get_executor(pure=False)
        job = partial(_worked, __version__, pickle.dumps(work))
        try:
            for item, (version, result) in stream(executor, job, items, max(_MIN_ITEMS, _ITEMS_PER_THREAD * threads)):
                if version != __version__:
                    raise _refused(f"piezoharvest {version} on a worker")
                yield item, result
        except (ImportError, AttributeError) as error:  # a package that is missing or too old to have this module
            raise _refused(f"a worker that cannot load this package ({error})") from None
        except (CancelledError, KilledWorker, OSError) as error:
            lost = f"the cluster at {address} was lost ({type(error).__name__})"
            raise OSError(f"{lost}; the same command goes on from here") from None
        finally:
            executor.shutdown(wait=False)


def _worked(version: str, work: bytes, of: Any) -> tuple[str, Any]:
    """Run on a worker: its version of the package, and the result if that is the version of the sender."""
    return __version__, pickle.loads(work)(of) if version == __version__ else None


def _refused(found: str) -> ParameterError:
    return ParameterError(_KEY, f"found {found}, but every worker needs piezoharvest {__version__}, as here")


@contextmanager
def _connected(address: str) -> Iterator[Client]:
    """Client of the scheduler at the address."""
    from distributed import Client

    log = logging.getLogger("distributed.client")
    level = log.level
    log.setLevel(logging.CRITICAL + 1)  # its messages on a lost scheduler are replaced by one sentence
    try:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of an outdated way to connect
                resolved = _answering(address)
            client = Client(resolved, timeout=_TIMEOUT, set_as_default=False)
        except Exception:  # a wrong address may raise anything, in Dask and below it
            found = f"no Dask scheduler answers at {address!r}"
            needed = "give the address of a running one, such as tcp://127.0.0.1:8786"
            raise ParameterError(_KEY, f"{found}, {needed}") from None
        with client:
            yield client
    finally:
        log.setLevel(level)


def _answering(address: str) -> str:
    """Complete address of a scheduler that has answered.

    `Client` itself waits for minutes for a scheduler that accepts a connection and is silent, as it is while it ends.
    It is therefore asked in a thread first that is not waited for.
    """
    from distributed.comm.addressing import resolve_address
    from distributed.security import Security

    resolved = resolve_address(address)
    arguments = Security().get_connection_args("client")
    if resolved.startswith("tls") and not arguments.get("ssl_context"):
        raise ValueError("no certificates in the configuration of Dask")
    kind: Future[str] = Future()

    def ask() -> None:
        try:
            kind.set_result(asyncio.run(_kind(resolved, arguments)))
        except Exception as error:
            kind.set_exception(error)

    threading.Thread(target=ask, daemon=True).start()
    if kind.result(_TIMEOUT) != "Scheduler":
        raise ValueError("a worker, say")
    return resolved


async def _kind(address: str, arguments: dict) -> str:
    """Kind of the server at the address, as it identifies itself."""
    from distributed.comm.core import connect

    comm = await connect(address, timeout=_TIMEOUT, **arguments)
    try:
        await comm.write({"op": "identity", "reply": True})
        return (await comm.read())["type"]
    finally:
        comm.abort()
