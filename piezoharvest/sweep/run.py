"""The sweep procedure: plan, evaluate chunk by chunk, store, assemble."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from time import perf_counter

from piezoharvest.description.parameters import check_kind
from piezoharvest.output import check_file
from piezoharvest.study import Study, StudyError
from piezoharvest.sweep.checks import check
from piezoharvest.sweep.evaluate import evaluate
from piezoharvest.sweep.fingerprint import fingerprint
from piezoharvest.sweep.plan import Plan
from piezoharvest.sweep.store import SUFFIXES, Store
from piezoharvest.sweep.summary import Summary, SweepResult
from piezoharvest.sweep.table import schema, tabulate, units
from piezoharvest.workers.run import done
from piezoharvest.workers.stream import Item

Progress = Callable[[int, int], object]
Tell = Callable[[str], object]


def sweep(
    study: Study,
    out: str | Path,
    *,
    workers: int = 1,
    scheduler: str | None = None,
    progress: Progress | None = None,
    notify: Tell | None = None,
) -> SweepResult:
    """Simulate a study at many values of its parameters and write one table.

    Parameters
    ----------
    study : Study
        With the table [sweep]; every shunt is swept.
    out : str or Path
        .parquet or .csv, with a row for each design and shunt: columns design, the parameters by their paths, shunt,
        kind, converged, the outputs. An output without an answer is null.
    workers : int
        Number of processes; one is this process itself. More import the calling script anew, as `multiprocessing` does.
    scheduler : str, optional
        Address of a running Dask cluster that does the work instead.
    progress : callable, optional
        Called with the number of designs done and the number of all designs.
    notify : callable, optional
        Called with remarks during the run, in sentences.

    Returns
    -------
    SweepResult

    Raises
    ------
    StudyError
        The study has no [sweep], no shunts, or parameters that cannot be swept.
    OutputError
        The file cannot be written, or another process is running this sweep.
    ParameterError
        There is no such scheduler.
    OSError
        The disk is full; a worker process died; the cluster was lost.

    Notes
    -----
    Chunks are kept in the folder FILE.partial. A sweep that was killed resumes from them and ends with the same bytes
    as one that was not interrupted, on any number of workers.
    """
    begun = perf_counter()
    progress, notify = progress or _ignore, notify or _ignore
    check_kind("study", study, Study, 'load_study("study.toml") reads one')
    out = check_file(out, SUFFIXES)
    plan = _plan(study)
    summary = Summary(study)
    form, kinds = schema(study), [shunt.kind for shunt in study.shunts]
    store = Store(out, form, fingerprint(study))
    with store.opened() as (found, foreign):
        if other := store.replaced():
            notify(other)
        if foreign:
            notify(f"{store.folder} held partial results of another study or version: starting afresh")
        resumed = count = sum(len(plan.range(number)) for number in found)
        if resumed:
            notify(f"resuming from {store.folder}: {resumed} of {plan.designs} designs are done")
        progress(count, plan.designs)
        chunks = (Item(n, plan.points(plan.range(n))) for n in range(plan.chunks) if n not in found)
        with closing(done(partial(evaluate, study), chunks, workers, scheduler, notify)) as results:
            for chunk, answers in results:
                designs = plan.range(chunk.number)
                store.put(chunk.number, tabulate(form, kinds, designs, chunk.of, answers))
                count += len(designs)
                progress(count, plan.designs)
        store.finish(plan.chunks, summary.look)
    return SweepResult(
        title=study.title, out=out, designs=plan.designs, resumed=resumed, rows=summary.rows,
        converged=summary.converged, incomplete=summary.incomplete, seconds=perf_counter() - begun, units=units(study),
        best=summary.best,
    )  # fmt: skip


def _ignore(*what: object) -> None:
    pass


def _plan(study: Study) -> Plan:
    """Plan of a study, checked."""
    if study.sweep is None:
        raise StudyError(study.path, "sweep", "missing table [sweep]")
    if not study.shunts:
        raise StudyError(study.path, "shunts", "missing tables [[shunts]], at least one is needed")
    plan = Plan(study.sweep)
    check(study, plan)
    return plan
