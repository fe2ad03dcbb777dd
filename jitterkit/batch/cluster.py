"""Frames processed by the workers of dask.distributed, here or on other machines.

Reach for :func:`connected`, which gives the client of a cluster that is there or of workers started here, and
hand that to :func:`execute_on_cluster`, which takes the position of
:func:`~jitterkit.batch.executor.execute`.  Only paths travel to the workers and only what is kept of frames
comes back: what one process gives, to the last digit.

A process that dies takes nothing with it: what it was doing is done again frame by frame, each alone.  A
frame that kills even then has an outcome that says so.

It needs the extra ``cluster``.  A script that calls it keeps its own doings under
``if __name__ == "__main__":``, since workers are spawned and import it.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import replace
from itertools import chain, groupby, islice
from typing import Any, Generic, TypeVar
from uuid import uuid4

from jitterkit.batch.executor import Finish, FrameTask, Outcome
from jitterkit.batch.plan import Batch
from jitterkit.batch.worker import Part, WorkerSetup, distributed, work
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.refit import FitResult, Status

T = TypeVar("T")

_CONFIGURED = {
    "distributed.worker.multiprocessing-method": "spawn",  # JAX has threads, which a fork would lose
    "distributed.scheduler.allowed-failures": 0,  # a second try is a smaller one
    "distributed.scheduler.no-workers-timeout": "120s",
    # a worker that died is to be replaced, however often: one that happens to be between two lives some
    # seconds after an earlier death would be given up
    "distributed.deploy.lost-worker-timeout": "52 weeks",
    # with what dask sets here, malloc asks the system for every large array again: a fourth of the rate
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None,
}

_REACHED, _JOINED = 10, 60
"""Seconds to wait for a scheduler, and for the first of its workers."""

_BATCHES_PER_THREAD = 4
"""Batches, at most, that a worker is given at a time: to find out about their optics costs 2 s."""

_PIECE = 16
"""Frames that are tried together after a worker died of what it was given."""

_MOST_DEATHS = 8
"""Parts that killed their workers, with none done, after which it is no frame's fault."""

_KILLED = FitResult(
    Status.FAILED,
    f"{Status.FAILED.value}: it killed the process that fitted it, and again when it was alone there.",
    code=ErrorCode.WORKER_LOST,
)


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
        problem = "Workers need dask.distributed, which is not installed"
        remedy = 'run: pip install "jitterkit[cluster]"'
        raise ConfigurationError(ErrorCode.MISSING_PACKAGE, f"{problem}; {remedy}")
    import dask

    with dask.config.set(_CONFIGURED), _quiet():
        if scheduler is None:
            cluster = distributed.LocalCluster(
                n_workers=workers or 1,
                threads_per_worker=1,
                memory_limit=None,  # by dask's, a share of the machine's, a worker is suspended for good
                dashboard_address="127.0.0.1:0",  # any port: another run may have the usual one
                silence_logs=logging.CRITICAL,
            )
            with cluster, distributed.Client(cluster) as client:
                yield client
        else:
            with _client(scheduler) as client:
                yield client


def _client(scheduler: str) -> Any:
    """Connect to a scheduler that has workers."""
    try:
        client = distributed.Client(scheduler, timeout=_REACHED)
    except (OSError, ValueError) as error:
        problem = f"No scheduler answers at {scheduler} ({error}); start one with 'dask scheduler'"
        raise ConfigurationError(ErrorCode.UNREACHABLE, f"{problem}, or see the address.") from None
    try:
        client.wait_for_workers(1, timeout=_JOINED)
    except TimeoutError:
        client.close()
        problem = f"The scheduler at {scheduler} has no workers"
        remedy = f"start some with 'dask worker {scheduler} --nthreads 1'"
        raise ConfigurationError(ErrorCode.UNREACHABLE, f"{problem}; {remedy}.") from None
    return client


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence dask's long messages; a sentence is logged here instead."""
    loggers = [logging.getLogger(name) for name in ("distributed", "distributed.client", "tornado")]
    levels = [logger.level for logger in loggers]
    try:
        for logger in loggers:
            logger.setLevel(logging.CRITICAL)
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def execute_on_cluster(
    batches: Iterable[Batch], task: FrameTask, finish: Finish[T], *, client: Any, hdu: int | None = None
) -> Iterator[T]:
    """Process the frames of batches at the workers of a cluster.

    Parameters
    ----------
    batches : iterable of Batch
        Asked for as workers become free.
    task : FrameTask
        Sent to each worker once.
    finish : callable
        Sent with every part of a batch, as it is then.
    client : distributed.Client
        Of :func:`connected`.
    hdu : int, optional
        As for :func:`~jitterkit.batch.executor.execute`.

    Yields
    ------
    finished : Any
        What ``finish`` returns of parts of batches, in any order.

    Raises
    ------
    ConfigurationError
        If a worker does not see the files, has no jitterkit or other versions than this process, or if
        workers die whatever they do.

    Notes
    -----
    A worker keeps what the latest reference frames show, which costs 2 s to find out.
    """
    batches, threads = iter(batches), _threads_of(client)
    ahead = list(islice(batches, _BATCHES_PER_THREAD * threads))
    if not ahead:
        return
    parts = _parts(chain(ahead, batches), max(1, len(ahead) // threads))
    name = f"jitterkit-{uuid4().hex}"
    try:
        try:
            client.register_plugin(WorkerSetup(task, hdu, ahead[0].items[0][0]), name=name)
        except ImportError as error:
            problem = f"A worker lacks {error.name}; install there what is installed here."
            raise ConfigurationError(ErrorCode.MISSING_PACKAGE, problem) from None
        yield from _Scheduler(client, name, finish).run(parts)
    finally:
        if client.status == "running":
            client.unregister_worker_plugin(name)


def _threads_of(client: Any) -> int:
    """Return the threads of all workers that there are at this moment; one if there is none."""
    return max(1, sum(client.nthreads().values()))


def _parts(batches: Iterable[Batch], most: int) -> Iterator[Part]:
    for _, group in groupby(batches, key=lambda batch: batch.references):
        while part := tuple(islice(group, most)):
            yield part


class _Scheduler(Generic[T]):
    """Hands parts of batches to workers, and sees to those that end with their worker."""

    def __init__(self, client: Any, name: str, finish: Finish[T]) -> None:
        self._client, self._name, self._finish = client, name, finish
        self._done = self._killed = 0

    def run(self, parts: Iterator[Part]) -> Iterator[T]:
        """Yield what is made of all parts; of those that killed in pieces, then frame by frame."""
        killed: list[Batch] = []
        yield from self._each(parts, killed)
        again, killed = killed, []
        pieces = (one.part(at, at + _PIECE) for one in again for at in range(0, len(one.items), _PIECE))
        yield from self._each(((piece,) for piece in pieces), killed)
        for piece in killed:
            yield from self._frame_by_frame(piece)

    def _each(self, parts: Iterator[Part], killed: list[Batch]) -> Iterator[T]:
        """Keep every thread at work, with no part waiting at a worker, which might be blamed for its end."""
        going = distributed.as_completed()
        sent: dict[Any, Part] = {}

        def send(part: Part, **where: Any) -> None:
            future = self._client.submit(work, self._name, part, self._finish, pure=False, **where)
            sent[future] = part
            going.add(future)

        def send_more() -> None:
            for part in islice(parts, max(0, _threads_of(self._client) - len(sent))):
                send(part)

        send_more()
        for future in going:
            part, done = sent.pop(future), self._result(future)
            if done is None:
                killed += part
            elif done[1]:  # the worker knows the reference frames
                send(done[1], workers=[done[2]], allow_other_workers=True)
            send_more()
            yield from () if done is None else done[0]

    def _result(self, future: Any) -> tuple[list[T], Part, str] | None:
        """Return what came of a part, as :func:`work` does; None if it killed its worker."""
        try:
            finished = future.result()
        except distributed.KilledWorker:
            self._killed += 1
            if self._killed >= _MOST_DEATHS and not self._done:
                problem = f"Workers died {self._killed} times and none has finished anything"
                remedy = "see that there is memory for them (1 GB each), or start fewer"
                raise ConfigurationError(ErrorCode.WORKER_LOST, f"{problem}; {remedy}.") from None
            return None
        except (distributed.scheduler.NoValidWorkerError, distributed.scheduler.NoWorkerError):
            problem = "No worker is left; see why they end, and continue with --resume."
            raise ConfigurationError(ErrorCode.WORKER_LOST, problem) from None
        except CancelledError:
            problem = "The scheduler is gone; see why it ended, and continue with --resume."
            raise ConfigurationError(ErrorCode.WORKER_LOST, problem) from None
        self._done += 1
        return finished

    def _alone(self, batch: Batch) -> list[T] | None:
        done = self._result(self._client.submit(work, self._name, (batch,), self._finish, pure=False))
        return None if done is None else done[0]

    def _frame_by_frame(self, part: Batch) -> Iterator[T]:
        """Try each frame of a part that killed alone, with nothing else at any worker."""
        if self._alone(replace(part, items=())) is None:  # some of its reference frames kill too
            each = {item: Batch(part.number, (item,)) for item in part.references}
            sound = (item for item, frame in each.items() if self._alone(frame) is not None)
            part = replace(part, references=tuple(sound))
        for index, item in enumerate(part.items):
            frame = part.part(index, index + 1)
            done = self._alone(frame)
            yield from [self._finish(frame, [Outcome(*item, _KILLED)])] if done is None else done
