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
import os
import pickle
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import chain, groupby, islice
from pathlib import Path
from typing import Any
from uuid import uuid4

import jax
import jax.numpy as jnp

from jitterkit.batch.configuration import versions
from jitterkit.batch.frame import Processor
from jitterkit.batch.ledger_worst import Rank, rank
from jitterkit.batch.plan import Batch
from jitterkit.batch.stream import Done, process_batches
from jitterkit.errors import ConfigurationError
from jitterkit.refit import FitResult, Status
from jitterkit.report.pictures import FrameReport
from jitterkit.report.row import Row, make_row

__all__ = ["connected", "process_on_cluster"]


def _distributed() -> Any:
    try:
        import distributed
    except ImportError:  # told when a cluster is asked for
        return None
    return distributed


distributed = _distributed()

_CONFIGURED = {
    "distributed.worker.multiprocessing-method": "spawn",  # JAX has threads, which a fork would lose
    "distributed.scheduler.allowed-failures": 0,  # a second try is a smaller one
    "distributed.scheduler.no-workers-timeout": "120s",
    # with what dask sets here, malloc asks the system for every large array anew: a fourth of the rate
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None,
}

_ENVIRONMENT = {"NPROC": "1", "XLA_PYTHON_CLIENT_PREALLOCATE": "false"}
"""Of a worker that has set nothing else: otherwise XLA starts as many threads as there are processors in
every process, and takes three quarters of a GPU.  No digit depends on it."""

_SHARED = (
    "jax_enable_x64",
    "jax_platforms",
    "jax_compilation_cache_dir",
    "jax_persistent_cache_min_compile_time_secs",
)
"""What JAX is told at the workers as it was told here."""

_REACHED, _JOINED = 10, 60
"""Seconds to wait for a scheduler, and for the first of its workers."""

_TOGETHER = 4
"""Batches, at most, that a worker does at a time: half a minute of work, which is lost with it."""

_HOPELESS = 8
"""Parts that killed their workers, with none done, after which it is no frame's fault."""

_KILLED = FitResult(
    Status.FAILED,
    f"{Status.FAILED.value}: it killed the process that fitted it, and again when it was alone there.",
)

Part = tuple[Batch, ...]
"""Batches with one lead, done one after the other by one who looks at the lead once."""


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
            'Workers need dask.distributed, which is not installed; run: pip install "jitterkit[cluster]"'
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
        n_workers=workers, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL
    )


def _client(scheduler: str) -> Any:
    """Connect to a scheduler that has workers."""
    try:
        client = distributed.Client(scheduler, timeout=_REACHED)
    except (OSError, ValueError) as error:
        raise ConfigurationError(
            f"No scheduler answers at {scheduler} ({error}); start one with 'dask scheduler', or see the "
            "address."
        ) from None
    try:
        client.wait_for_workers(1, timeout=_JOINED)
    except TimeoutError:
        client.close()
        raise ConfigurationError(
            f"The scheduler at {scheduler} has no workers; start some with "
            f"'dask worker {scheduler} --nthreads 1'."
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
    batches, width = iter(batches), _threads(client)
    ahead = list(islice(batches, _TOGETHER * width))
    if not ahead:
        return
    parts = _parts(chain(ahead, batches), max(1, len(ahead) // width))
    name = f"jitterkit-{uuid4().hex}"
    try:
        _equip(client, _Equipment(processor, hdu, ahead[0].items[0][0]), name)
        yield from _Dispatch(client, name, ranks).all(parts)
    finally:
        if client.status == "running":
            client.unregister_worker_plugin(name)


def _parts(batches: Iterable[Batch], most: int) -> Iterator[Part]:
    for _, group in groupby(batches, key=lambda batch: batch.lead):
        while part := tuple(islice(group, most)):
            yield part


def _threads(client: Any) -> int:
    """Threads of all workers that there are at this moment; one if there is none."""
    return max(1, sum(client.nthreads().values()))


def _equip(client: Any, equipment: _Equipment, name: str) -> None:
    try:
        client.register_plugin(equipment, name=name)
    except ImportError as error:
        raise ConfigurationError(
            f"A worker lacks {error.name}; install there what is installed here."
        ) from None


class _Equipment(distributed.WorkerPlugin if distributed else object):  # type: ignore[misc]
    """What a worker needs to fit frames as this process would.

    Whatever worker joins later, or takes the place of one that died, gets it too.
    """

    def __init__(self, processor: Processor, hdu: int | None, witness: Path) -> None:
        self.pickled = pickle.dumps(replace(processor, anchored={}, _systems={}))
        self.hdu = hdu
        self.witness = witness if witness.exists() else None
        self.directory = os.getcwd()
        self.computed = _computed_with()
        self.told = {name: getattr(jax.config, name) for name in _SHARED}

    def setup(self, worker: Any) -> None:
        for name, value in _ENVIRONMENT.items():
            os.environ.setdefault(name, value)
        for name, value in self.told.items():
            jax.config.update(name, value)
        self.home = os.getcwd()
        if os.path.isdir(self.directory):
            os.chdir(self.directory)  # for paths that are relative
        self._look(worker.address)
        self.processor = pickle.loads(self.pickled)

    def teardown(self, worker: Any) -> None:
        os.chdir(self.home)

    def _look(self, address: str) -> None:
        """Refuse a worker that would give other rows."""
        if self.witness is not None and not self.witness.exists():
            raise ConfigurationError(
                f"The worker {address} does not see {self.witness}: files must be readable there under the "
                "same path; mount the file system there, or give a path that is the same everywhere."
            )
        here = _computed_with()
        for name in self.computed:
            if here.get(name) != self.computed[name]:
                raise ConfigurationError(
                    f"The worker {address} computes with {name} {here.get(name)}, this process with "
                    f"{self.computed[name]}, which changes the last digits; make them the same."
                )


def _computed_with() -> dict[str, str]:
    """What the last digits depend on."""
    (device,) = jnp.zeros(()).devices()
    return {**versions(), "device": device.platform}


def _fit(name: str, part: Part, ranks: tuple[Rank, ...]) -> list[Done]:
    """What a worker does: some batches, and no picture that would be worse than those drawn before."""
    equipment: Any = distributed.get_worker().plugins[name]
    known, finished = list(ranks), []
    for done in process_batches(part, equipment.processor, hdu=equipment.hdu, threads=1, ranks=known.copy):
        known += [rank(done.rows[place], done.batch.number, place) for place in done.pictures]
        finished.append(done)
    return finished


class _Dispatch:
    """Hands parts to workers and sees to what becomes of them."""

    def __init__(self, client: Any, name: str, ranks: Callable[[], Iterable[Rank]]) -> None:
        self._client, self._name, self._ranks = client, name, ranks
        self._done = self._killed = 0

    def all(self, parts: Iterable[Part]) -> Iterator[Done]:
        """Parts; then, of those that killed, the batches; then, of those, the frames."""
        killed: list[Batch] = []
        yield from self._each(parts, killed)
        again, killed = killed, []
        yield from self._each(((batch,) for batch in again), killed)
        for batch in killed:
            yield self._frame_by_frame(batch)

    def _each(self, parts: Iterable[Part], killed: list[Batch]) -> Iterator[Done]:
        """Keep every thread at work, with no part waiting at a worker, which might be blamed for its end."""
        parts, going = iter(parts), distributed.as_completed()
        sent: dict[Any, Part] = {}

        def send() -> None:
            for _ in range(len(sent), _threads(self._client)):
                if (part := next(parts, None)) is None:
                    return
                future = self._submit(part)
                sent[future] = part
                going.add(future)

        send()
        for future in going:
            part, finished = sent.pop(future), self._result(future)
            send()
            if finished is None:
                killed += part
            else:
                yield from finished

    def _submit(self, part: Part) -> Any:
        return self._client.submit(_fit, self._name, part, tuple(self._ranks()), pure=False)

    def _result(self, future: Any) -> list[Done] | None:
        """What came of a part; None if it killed its worker."""
        try:
            finished = future.result()
        except distributed.KilledWorker:
            self._killed += 1
            if self._killed >= _HOPELESS and not self._done:
                raise ConfigurationError(
                    f"Workers died {self._killed} times and none has finished anything; see that there is "
                    "memory for them (1 GB each), or start fewer."
                ) from None
            return None
        except distributed.scheduler.NoValidWorkerError:
            raise ConfigurationError(
                "No worker is left; see why they end, and go on with --resume."
            ) from None
        self._done += 1
        return finished

    def _alone(self, batch: Batch) -> Done | None:
        finished = self._result(self._submit((batch,)))
        return None if finished is None else finished[0]

    def _frame_by_frame(self, batch: Batch) -> Done:
        """A batch that killed: each frame is tried alone, with nothing else at any worker."""
        rows: list[Row] = []
        pictures: dict[int, FrameReport] = {}
        lead = self._sound(batch)
        for place, item in enumerate(batch.items):
            done = self._alone(Batch(batch.number, (item,), lead))
            rows.append(make_row(_KILLED, *item) if done is None else done.rows[0])
            if done is not None and done.pictures:
                pictures[place] = done.pictures[0]
        return Done(batch, rows, pictures)

    def _sound(self, batch: Batch) -> tuple[tuple[Path, int], ...]:
        """The lead, without those that kill whoever looks at them."""
        if self._alone(replace(batch, items=())) is not None:
            return batch.lead
        return tuple(item for item in batch.lead if self._alone(Batch(batch.number, (item,))) is not None)
