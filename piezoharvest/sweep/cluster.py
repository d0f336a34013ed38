"""Chunks over the workers of a Dask cluster."""

from __future__ import annotations

import logging
import pickle
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from piezoharvest import __version__
from piezoharvest.parameters import ParameterError
from piezoharvest.study import Study
from piezoharvest.sweep.evaluate import Answers, evaluate
from piezoharvest.sweep.stream import Chunk, Done, stream

if TYPE_CHECKING:
    from distributed import Client

_KEY = "--scheduler"
_PATIENCE = 10.0  # s, for a scheduler to answer
_AHEAD = 4  # chunks for each thread of the cluster
_LEAST = 64  # chunks under way, so that a cluster that grows with its work does


def on_cluster(study: Study, chunks: Iterable[Chunk], address: str, tell: Callable[[str], object]) -> Done:
    """Evaluate chunks of a sweep on a running Dask cluster, which takes up again what a lost worker had.

    Raises
    ------
    ParameterError
        There is no scheduler at the address, or its workers have not this version of the package.
    OSError
        The cluster was lost.
    """
    from distributed import KilledWorker

    with _connected(address) as client:
        threads = sum(client.nthreads().values())  # pyright: ignore[reportAttributeAccessIssue]
        if not threads:
            tell(f"waiting for workers to join {address}")
        executor = client.get_executor(pure=False)
        job = partial(_evaluate, __version__, pickle.dumps(study))
        try:
            for chunk, (version, answers) in stream(executor, job, chunks, max(_LEAST, _AHEAD * threads)):
                if answers is None:
                    raise _refused(f"piezoharvest {version} on a worker")
                yield chunk, answers
        except (ImportError, AttributeError) as error:  # a package that is not there or too old to know this module
            raise _refused(f"a worker that cannot load this package ({error})") from None
        except (CancelledError, KilledWorker, OSError) as error:
            lost = f"the cluster at {address} was lost ({type(error).__name__})"
            raise OSError(f"{lost}; the same command resumes") from None
        finally:
            executor.shutdown(wait=False)


def _evaluate(version: str, study: bytes, values: np.ndarray) -> tuple[str, Answers | None]:
    """On a worker: its version of the package, and the answers if it is the same as where the sweep runs."""
    return __version__, evaluate(pickle.loads(study), values) if version == __version__ else None


def _refused(found: str) -> ParameterError:
    return ParameterError(_KEY, f"found {found}, allowed are workers with piezoharvest {__version__} as here")


@contextmanager
def _connected(address: str) -> Iterator[Client]:
    """Client of the scheduler at the address."""
    from distributed import Client
    from distributed.comm.addressing import resolve_address
    from distributed.security import Security

    log = logging.getLogger("distributed.client")
    level = log.level
    log.setLevel(logging.CRITICAL + 1)  # what it tells of a lost scheduler is told here, in one sentence
    try:
        try:
            resolved = resolve_address(address)
            if resolved.startswith("tls") and not Security().get_connection_args("client").get("ssl_context"):
                raise ValueError("no certificates in the configuration of Dask")
            client = Client(resolved, timeout=_PATIENCE, set_as_default=False)
        except (OSError, ValueError):
            found = f"found no scheduler that answers at {address!r}"
            allowed = "allowed is the address of a running one, such as tcp://127.0.0.1:8786"
            raise ParameterError(_KEY, f"{found}, {allowed}") from None
        with client:
            yield client
    finally:
        log.setLevel(level)
