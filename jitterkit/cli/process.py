"""Fit frames one by one: ``jitterkit process``."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.frame_fit import FrameFit, Plan
from jitterkit.cli.progress import run_progress
from jitterkit.cli.run import Run, finalize
from jitterkit.cli.runtime import as_interrupt, log, refuse_if
from jitterkit.errors import ErrorCode


@dataclass(frozen=True, kw_only=True)
class Workers:
    """Choose the processes that share the work.

    Parameters
    ----------
    workers
        Number of processes on this machine, each with one thread; by default one process with as many threads
        as there are processors.
    scheduler : ADDRESS
        Scheduler of dask.distributed whose workers share the work: tcp://host:8786. Files must be readable
        there under the same paths.
    """

    workers: Annotated[int | None, typer.Option(min=1, max=1024)] = None
    scheduler: str | None = None

    def check(self) -> None:
        """Refuse workers beside those of a scheduler."""
        problem = "A scheduler has its own workers; give --workers or --scheduler."
        refuse_if(self.workers is not None and self.scheduler is not None, ErrorCode.CONFLICT, problem)

    @contextlib.contextmanager
    def executor(self) -> Iterator[Callable | None]:
        """Yield the function that processes batches on the workers; None if there are none."""
        if self.workers is None and self.scheduler is None:
            yield None
            return
        from jitterkit.batch.cluster import connected, execute_on_cluster

        with connected(self.workers, self.scheduler) as client:
            yield partial(execute_on_cluster, client=client)


def process(
    *,
    files: options.Files,
    output: options.OutputDirectory,
    hdu: options.Hdu = None,
    workers: Workers,
    plan: Plan,
    run: Run,
    fit: FrameFit,
) -> None:
    """Fit every frame: kernel estimate, then separation, optics and jitter together.

    Writes results.ecsv (a row per frame), summary.json, report.html, configuration.json and, during the run,
    ledger.sqlite. Exit status: 0 if every frame was fitted, 1 if some were not, 2 if the command cannot be
    carried out.
    """
    from jitterkit.frames import find_files

    workers.check()
    plan.check()
    paths = find_files(files)
    run.check(output)
    processor, planned = plan.apply(fit.processor(), paths, hdu, output if run.resume else None)
    from jitterkit.run import process_files

    settings = run.settings() | {"hdu": hdu, "plan": planned}
    try:
        with as_interrupt(), workers.executor() as executor, run_progress(len(paths)) as (watch, before):
            settings |= {"executor": executor, "watch": watch, "before": before}
            result = process_files(paths, output, processor, **settings)
    except KeyboardInterrupt:
        instead = " instead of --overwrite" * run.overwrite
        log(f"Results so far are kept in {output}: repeat the command with --resume{instead} to continue.")
        raise
    finalize(result, processor.instrument)
