"""Frames worked through by the processes of dask.distributed, here or on other machines.

Reach for :func:`connected`, which gives the client of a cluster that is there or of workers started here, and
hand that to :func:`process_on_cluster`, which takes the place of
:func:`~jitterkit.batch.stream.process_batches`.  Only paths travel to the workers and only rows and pictures
come back.  Rows are what one process gives, to the last digit.

A process that dies takes nothing with it: what it was doing is done again in ever smaller parts, and at last
frame by frame, each alone.  A frame that kills even then has a row that says so.

It needs the extra ``cluster``.  A script that calls it keeps its own doings under
``if __name__ == "__main__":``, since workers are spawned and import it.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import chain, groupby, islice
from typing import Any
from uuid import uuid4

from jitterkit.batch.dispatch import Dispatch, threads_of
from jitterkit.batch.equipment import Equipment, Part, distributed
from jitterkit.batch.frame import Processor
from jitterkit.batch.ledger_worst import Rank
from jitterkit.batch.plan import Batch
from jitterkit.batch.stream import Done
from jitterkit.errors import ConfigurationError, ErrorCode

__all__ = ["connected", "process_on_cluster"]

_CONFIGURED = {
    "distributed.worker.multiprocessing-method": "spawn",  # JAX has threads, which a fork would lose
    "distributed.scheduler.allowed-failures": 0,  # a second try is a smaller one
    "distributed.scheduler.no-workers-timeout": "120s",
    # a worker that died is to be replaced, however often: one that happens to be between two lives some
    # seconds after an earlier death would be given up
    "distributed.deploy.lost-worker-timeout": "52 weeks",
    # with what dask sets here, malloc asks the system for every large array anew: a fourth of the rate
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None,
}

_REACHED, _JOINED = 10, 60
"""Seconds to wait for a scheduler, and for the first of its workers."""

_TOGETHER = 4
"""Batches, at most, that a worker does at a time: half a minute of work, which is lost with it."""


@contextmanager
def connected(workers: int | None = None, scheduler: str | None = None) -> Iterator[Any]:
    """Connect to a cluster.

    Parameters
    ----------
    workers : int, optional
        Processes to start on this machine, each with one thread; they end with the block.
    scheduler : str, optional
        Address of a scheduler, ``tcp://host:8786``, whose workers are used; in place of ``workers``.

    Yields
    ------
    client : distributed.Client

    Raises
    ------
    ConfigurationError
        If dask.distributed is not installed, the scheduler is not to be reached, or has no workers.

    Notes
    -----
    Whoever can reach a scheduler can run programs at its workers: those started here listen to this
    machine only.  Workers that are started otherwise should have
    ``DASK_DISTRIBUTED__NANNY__PRE_SPAWN_ENVIRON__MALLOC_TRIM_THRESHOLD_=None`` in their environment: what
    dask sets there makes them four times slower.
    """
    if distributed is None:
        raise ConfigurationError(
            ErrorCode.MISSING_PACKAGE,
            'Workers need dask.distributed, which is not installed; run: pip install "jitterkit[cluster]"',
        )
    import dask

    with dask.config.set(_CONFIGURED), _quiet():
        if scheduler is None:
            with _local(workers or 1) as cluster, distributed.Client(cluster) as client:
                yield client
        else:
            with _client(scheduler) as client:
                yield client


def _local(workers: int) -> Any:
    return distributed.LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        memory_limit=None,  # by dask's, a share of the machine's, a worker is suspended and never wakes
        dashboard_address="127.0.0.1:0",  # any port: another run may have the usual one
        silence_logs=logging.CRITICAL,
    )


def _client(scheduler: str) -> Any:
    """Connect to a scheduler that has workers."""
    try:
        client = distributed.Client(scheduler, timeout=_REACHED)
    except (OSError, ValueError) as error:
        raise ConfigurationError(
            ErrorCode.UNREACHABLE,
            f"No scheduler answers at {scheduler} ({error}); start one with 'dask scheduler', or see the "
            "address.",
        ) from None
    try:
        client.wait_for_workers(1, timeout=_JOINED)
    except TimeoutError:
        client.close()
        raise ConfigurationError(
            ErrorCode.UNREACHABLE,
            f"The scheduler at {scheduler} has no workers; start some with "
            f"'dask worker {scheduler} --nthreads 1'.",
        ) from None
    return client


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence dask, which tells at length of what is told here in a sentence."""
    loggers = [logging.getLogger(name) for name in ("distributed", "distributed.client", "tornado")]
    levels = [logger.level for logger in loggers]
    try:
        for logger in loggers:
            logger.setLevel(logging.CRITICAL)
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def process_on_cluster(
    batches: Iterable[Batch],
    processor: Processor,
    client: Any,
    *,
    hdu: int | None = None,
    ranks: Callable[[], Iterable[Rank]] = tuple,
) -> Iterator[Done]:
    """Process batches at the workers of a cluster.

    Parameters
    ----------
    batches : iterable of Batch
        Asked for as workers become free.
    processor : Processor
        Sent to each worker once.
    client : distributed.Client
        Of :func:`connected`.
    hdu, ranks
        As for :func:`~jitterkit.batch.stream.process_batches`.

    Yields
    ------
    done : Done
        In any order.

    Raises
    ------
    ConfigurationError
        If a worker does not see the files, has no jitterkit or other versions than this process, or if
        workers die whatever they do.

    Notes
    -----
    Some batches with one lead go to a worker together, where there are enough for all: to find out about the
    optics costs 2 s.  In a worker of several threads as many of these run at a time.
    """
    batches, width = iter(batches), threads_of(client)
    ahead = list(islice(batches, _TOGETHER * width))
    if not ahead:
        return
    parts = _parts(chain(ahead, batches), max(1, len(ahead) // width))
    name = f"jitterkit-{uuid4().hex}"
    try:
        _equip(client, Equipment(processor, hdu, ahead[0].items[0][0]), name)
        yield from Dispatch(client, name, ranks).all(parts)
    finally:
        if client.status == "running":
            client.unregister_worker_plugin(name)


def _parts(batches: Iterable[Batch], most: int) -> Iterator[Part]:
    for _, group in groupby(batches, key=lambda batch: batch.lead):
        while part := tuple(islice(group, most)):
            yield part


def _equip(client: Any, equipment: Equipment, name: str) -> None:
    try:
        client.register_plugin(equipment, name=name)
    except ImportError as error:
        raise ConfigurationError(
            ErrorCode.MISSING_PACKAGE, f"A worker lacks {error.name}; install there what is installed here."
        ) from None
