"""A sweep on a Dask cluster: a scheduler and two workers as processes of their own, on loopback."""

import json
import os
import pickle
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest
from selection import with_slow
from sweep_studies import (
    BENCH,
    NOISE,
    RESISTOR,
    finish,
    parameter,
    parts,
    start,
    study_of,
    sweep_table,
    wait_for,
    write,
)

from piezoharvest import __version__
from piezoharvest.description.parameters import ParameterError
from piezoharvest.sweep import sweep
from piezoharvest.workers import cluster

# A chunk takes long beside a question to the scheduler, so that a worker is met at work.
NOISY = NOISE.replace("duration = 0.15", "duration = 6.0")
LONG = BENCH + NOISY + RESISTOR + sweep_table(parameter("shunts.0.resistance", 1e3, 1e7, "log", 384))


class Cluster:
    """A scheduler and the workers that have joined it."""

    def __init__(self, folder):
        self.folder, self.file, self.processes = folder, folder / "scheduler.json", {}
        self.start("scheduler", "scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", self.file)
        wait_for(self._is_written, self.processes["scheduler"])
        self.address = json.loads(self.file.read_text())["address"]

    def _is_written(self):
        """Whether the scheduler's file is there and ends: it is not written at once."""
        return self.file.exists() and self.file.read_text().rstrip().endswith("}")

    def start(self, name, *arguments):
        command = [sys.executable, "-m", "dask", *map(str, arguments), "--no-dashboard"]
        with (self.folder / f"{name}.log").open("w") as log:
            self.processes[name] = subprocess.Popen(command, cwd=self.folder, stdout=log, stderr=log)

    def join(self, name):
        alone = ("--nthreads", "1", "--no-nanny", "--local-directory", self.folder)
        self.start(name, "worker", self.address, "--name", name, *alone)

    def kill(self, name):
        self.processes[name].send_signal(signal.SIGKILL)
        self.processes[name].wait()

    def log(self, name):
        return (self.folder / f"{name}.log").read_text()

    def close(self):
        for process in self.processes.values():
            process.kill()
            process.wait()


@pytest.fixture
def dask(tmp_path_factory):
    made = Cluster(tmp_path_factory.mktemp("cluster"))
    yield made
    made.close()


def busy(client, name):
    """Whether a worker of this name has chunks to do."""
    named = {worker["name"]: address for address, worker in client.scheduler_info()["workers"].items()}
    return len(client.processing().get(named.get(name), ())) > 0


def test_a_worker_that_is_killed_loses_nothing(dask, tmp_path):
    from distributed import Client

    out = tmp_path / "out.parquet"
    write(tmp_path, LONG)
    dask.join("first")
    dask.join("second")
    with Client(dask.address, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=60)
        process = start(tmp_path, "study.toml", "--out", "out.parquet", "--scheduler", dask.address, "--json")
        wait_for(lambda: len(parts(out)) >= 2, process)
        # At any one moment a worker may be between two chunks; the sweep must not end before both have one.
        wait_for(lambda: busy(client, "first") and busy(client, "second"), process)
        dask.kill("first")
        status, text, err = finish(process)
    found = json.loads(text)
    assert (status, found["designs"], found["rows"], found["converged"]) == (0, 384, 384, 384)
    assert err.startswith("384 designs in ")
    assert sorted(os.listdir(tmp_path)) == ["out.parquet", "study.toml"]
    sweep(study_of(tmp_path, LONG), tmp_path / "alone.parquet")
    assert out.read_bytes() == (tmp_path / "alone.parquet").read_bytes()


@pytest.mark.slow
def test_workers_may_come_late_and_the_scheduler_may_go(dask, tmp_path):
    write(tmp_path, LONG)
    out = tmp_path / "out.parquet"
    process = start(tmp_path, "study.toml", "--out", "out.parquet", "--scheduler", dask.address)
    assert process.stderr.readline() == f"waiting for workers to join {dask.address}\n"
    dask.join("late")
    wait_for(lambda: len(parts(out)) >= 1, process)
    dask.kill("scheduler")
    status, text, err = finish(process)
    assert (status, text) == (1, "")
    assert err.startswith(f"piezoharvest: error: the cluster at {dask.address} was lost (")
    assert err.endswith("; the same command resumes the sweep\n")
    assert err.count("\n") == 1
    assert len(parts(out)) >= 1


# The command line, which waits for a scheduler no longer than is needed to see that it is left.
WAIT = 0.5  # s
HASTY = f"""\
import sys
from piezoharvest.cli import main
from piezoharvest.workers import cluster
cluster._TIMEOUT = {WAIT}
sys.exit(main(sys.argv[1:]))
"""


@contextmanager
def listening(answer=None):
    """A port on which something takes connections, and answers nothing or always the same; gives the port."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        taken = []

        def serve():
            while True:
                try:
                    taken.append(server.accept()[0])
                    if answer:
                        taken[-1].sendall(answer)
                except OSError:  # the test has ended
                    return

        threading.Thread(target=serve, daemon=True).start()
        try:
            yield server.getsockname()[1]
        finally:
            server.shutdown(socket.SHUT_RDWR)
            for connection in taken:
                connection.close()


def refused(folder, address, **options):
    """The one sentence about an address, said in time."""
    begun = time.monotonic()
    status, out, err = finish(start(folder, "study.toml", "--out", "out.parquet", "--scheduler", address, **options))
    took = time.monotonic() - begun
    assert (status, out) == (2, "")
    assert err.count("\n") == 1
    assert os.listdir(folder) == ["study.toml"]
    return err, took


def no_scheduler(address):
    return (
        f"piezoharvest: error: --scheduler: no Dask scheduler answers at {address!r}, "
        "give the address of a running one, such as tcp://127.0.0.1:8786\n"
    )


@pytest.mark.parametrize(
    "answer",
    with_slow([None, b"HTTP/1.1 400 Bad Request\r\n\r\n", b"\0" * 64], slow=lambda answer: answer is not None),
    ids=["silent", "http", "zeros"],
)
def test_a_port_without_a_scheduler_is_left_in_time(tmp_path, answer):
    write(tmp_path, LONG)
    with listening(answer) as port:
        err, took = refused(tmp_path, f"tcp://127.0.0.1:{port}", program=("-c", HASTY))
    assert err == no_scheduler(f"tcp://127.0.0.1:{port}")
    assert took < WAIT + 20.0  # the start of Python and Dask, on a machine that is busy


@pytest.mark.parametrize(
    "address",
    [
        "tcp://127.0.0.1:1", "127.0.0.1:1", "tcp://no.such.host.invalid:8786", "tcp://[::1]:1", "tcp://127.0.0.1:99999999",
        "inproc://127.0.0.1/1/2", "inproc://", "ucx://127.0.0.1:1", "ws://127.0.0.1:1", "tls://127.0.0.1:1",
        "http://127.0.0.1:1", "tcp://127.0.0.1:port", "tcp://", "127.0.0.1", "garbage", ":", "", "tcp://\x01:1",
    ],
)  # fmt: skip
def test_an_address_that_is_none(run, monkeypatch, address):
    monkeypatch.setattr(cluster, "_TIMEOUT", WAIT)  # or most of these take it whole
    assert run(LONG, "--out", "out.parquet", "--scheduler", address) == (2, "", no_scheduler(address))
    assert os.listdir() == ["study.toml"]


@pytest.mark.parametrize(
    "address",
    with_slow(
        ["tcp://127.0.0.1:1", "inproc://127.0.0.1/1/2", "ucx://127.0.0.1:1"],
        slow=lambda address: not address.startswith("tcp"),
    ),
)
def test_nothing_else_is_said_of_it(tmp_path, address):
    """By no package that is asked: what a process of its own shows."""
    write(tmp_path, LONG)
    assert refused(tmp_path, address, program=("-c", HASTY))[0] == no_scheduler(address)


@pytest.mark.slow
def test_the_address_of_a_worker_is_none(dask, tmp_path):
    from distributed import Client

    write(tmp_path, LONG)
    dask.join("worker")
    with Client(dask.address, set_as_default=False) as client:
        client.wait_for_workers(1, timeout=60)
        (address,) = client.scheduler_info()["workers"]
    assert refused(tmp_path, address)[0] == no_scheduler(address)


def test_another_version_on_the_workers_is_refused(dask, tmp_path, monkeypatch):
    dask.join("old")
    monkeypatch.setattr(cluster, "__version__", "99.0")
    study = study_of(tmp_path, LONG)
    with pytest.raises(
        ParameterError,
        match=f"--scheduler: found piezoharvest {re.escape(__version__)} on a worker, but every worker needs",
    ):
        sweep(study, tmp_path / "out.parquet", scheduler=dask.address)
    assert os.listdir(tmp_path) == ["study.toml"]


def test_a_worker_looks_at_the_version_before_the_study():
    version, answers = cluster._worked("99.0", b"not to be read", np.empty((1, 1)))
    assert (version != "99.0", answers) == (True, None)
    with pytest.raises(pickle.UnpicklingError):
        cluster._worked(version, b"not to be read", np.empty((1, 1)))


def test_without_dask(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ParameterError, match=r"needs the package distributed, .*pip install 'piezoharvest\[cluster\]'"):
        next(iter(cluster.on_cluster(print, [], "tcp://127.0.0.1:1", print)))
