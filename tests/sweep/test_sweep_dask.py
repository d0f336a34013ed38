"""A sweep on a Dask cluster: a scheduler and two workers as processes of their own, on loopback."""

import json
import os
import pickle
import re
import signal
import subprocess
import sys

import numpy as np
import pytest
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
from piezoharvest.parameters import ParameterError
from piezoharvest.sweep import cluster, sweep

LONG = BENCH + NOISE + RESISTOR + sweep_table(parameter("shunts.0.resistance", 1e3, 1e7, "log", 384))


class Cluster:
    """A scheduler and the workers that have joined it."""

    def __init__(self, folder):
        self.folder, self.file, self.processes = folder, folder / "scheduler.json", {}
        self.start("scheduler", "scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", self.file)
        wait_for(self.file.exists, self.processes["scheduler"])
        self.address = json.loads(self.file.read_text())["address"]

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
        assert busy(client, "first")
        assert busy(client, "second")
        dask.kill("first")
        status, text, err = finish(process)
    found = json.loads(text)
    assert (status, found["designs"], found["rows"], found["converged"]) == (0, 384, 384, 384)
    assert err.startswith("384 designs in ")
    assert sorted(os.listdir(tmp_path)) == ["out.parquet", "study.toml"]
    sweep(study_of(tmp_path, LONG), tmp_path / "alone.parquet")
    assert out.read_bytes() == (tmp_path / "alone.parquet").read_bytes()


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
    assert err.endswith("; the same command resumes\n")
    assert err.count("\n") == 1
    assert len(parts(out)) >= 1


def test_another_version_on_the_workers_is_refused(dask, tmp_path, monkeypatch):
    dask.join("old")
    monkeypatch.setattr(cluster, "__version__", "99.0")
    study = study_of(tmp_path, LONG)
    with pytest.raises(
        ParameterError, match=f"--scheduler: found piezoharvest {re.escape(__version__)} on a worker, allowed are"
    ):
        sweep(study, tmp_path / "out.parquet", scheduler=dask.address)
    assert os.listdir(tmp_path) == ["study.toml"]


def test_a_worker_looks_at_the_version_before_the_study():
    version, answers = cluster._evaluate("99.0", b"not to be read", np.empty((1, 1)))
    assert (version != "99.0", answers) == (True, None)
    with pytest.raises(pickle.UnpicklingError):
        cluster._evaluate(version, b"not to be read", np.empty((1, 1)))
