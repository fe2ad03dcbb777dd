"""One executor for every command that goes over frames: reads ahead, works in threads, yields results.

Reach for :func:`execute`.  Frames are read and calibrated one after the other while threads process those
before; no more than two batches are held at a time, however many there are.  What is finished is handed out
after some seconds, so that whoever keeps it loses little when the process is killed.

What becomes of a frame depends on the frame and the reference frames of its batch alone, to the last digit:
not on who else is working, nor on what was done before.

:func:`jitterkit.batch.cluster.execute_on_cluster` does the same at the workers of a cluster.
"""

from __future__ import annotations

import logging
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol, Self, TypeVar

from jitterkit.batch.diagnose import status_from_exception
from jitterkit.batch.memory import MemoryLimiter
from jitterkit.batch.plan import Batch, FrameReader
from jitterkit.errors import JitterkitError, out_of_memory
from jitterkit.frames import Frame, Metadata, RawFrame
from jitterkit.refit import FitResult, Status

log = logging.getLogger(__name__)

T = TypeVar("T")

_AHEAD = 3
"""Frames read ahead for each thread."""

_ALONE = 5.0
"""Seconds that the first frame of a process has for itself: others beside it would trace and compile the same
programs again, 2 s of a processor for ten frames of TOLIMAN."""

_begun = threading.Event()
"""Whether a frame has had them."""

_KEEP = 5.0
"""Seconds after which finished frames are handed out though their batch is not done."""


class FrameTask(Protocol):
    """Process a frame: :class:`~jitterkit.batch.processor.FrameProcessor`, for one.

    What a method raises becomes a status of the frame; only a lack of memory is tried again.
    """

    @property
    def plate_scale(self) -> float | None:
        """Return the instrument's plate scale [arcsec]; None where there is no instrument."""
        ...

    def for_batch(self, batch: Batch, hdu: int | None) -> Self:
        """Return the task with what the reference frames of a batch show."""
        ...

    def calibrate(self, raw: RawFrame) -> Any:
        """Turn a frame into electrons where it is read: in many small steps threads hold each other up.

        Frames as large as a camera, of which few may be held, are returned as they are.
        """
        ...

    def complete(self, calibrated: Any) -> Any:
        """Process what :meth:`calibrate` returned."""
        ...


@dataclass(frozen=True)
class Outcome:
    """Hold the outcome of one frame.

    Attributes
    ----------
    path, index
        File and index of the frame in it.
    result : Any
        What the task returned; a FitResult with a status if the frame cannot be read, or raised an error.
    metadata : Metadata or None
        None for a frame that cannot be read.
    digest : str
        Of its pixels; empty if they cannot be read.
    """

    path: Path
    index: int
    result: Any
    metadata: Metadata | None = None
    digest: str = ""


Finish = Callable[[Batch, Sequence[Outcome]], T]
"""Makes what is kept of frames: of a batch, or of a part of one, and of what became of its items in order."""


def cores() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def execute(
    batches: Iterable[Batch],
    task: FrameTask,
    finish: Finish[T],
    *,
    hdu: int | None = None,
    threads: int | None = None,
) -> Generator[T, None, None]:
    """Process the frames of batches in order.

    Parameters
    ----------
    batches : iterable of Batch
        Asked for one by one.
    task : FrameTask
    finish : callable
        Called with each batch and its outcomes; with parts of a batch that takes more than some seconds.
    hdu : int, optional
        To read in every FITS file.
    threads : int, optional
        How many frames are processed at a time; by default as many as there are processors.

    Yields
    ------
    finished : Any
        What ``finish`` returns.
    """
    threads = threads or cores()
    running: deque[_Running] = deque()
    limiter, ahead = MemoryLimiter(threads), threading.Semaphore(threads * (1 + _AHEAD))
    with FrameReader(hdu) as reader, ThreadPoolExecutor(threads, "fit") as pool:
        try:
            for batch in batches:
                while len(running) > 1:  # for a frame that takes long no more are held than these
                    yield from _hand_out(running, finish, _KEEP)
                ready = _for_batch(task, batch, hdu, running)
                running.append(one := _Running(batch))
                for path, index, raw in reader.read(batch.items):
                    attempt = partial(_attempt, ready, *_read(ready, path, index, raw))
                    alone = not _begun.is_set() and not isinstance(raw, JitterkitError)
                    del raw  # a camera's whole frame need not wait with the stars that were cut out of it
                    ahead.acquire()
                    one.futures.append(pool.submit(limiter.run, attempt))
                    one.futures[-1].add_done_callback(lambda _: ahead.release())
                    if alone:
                        _begun.set()
                        wait(one.futures, _ALONE)
                    yield from _hand_out(running, finish)
            while running:
                yield from _hand_out(running, finish, _KEEP)
        finally:
            pool.shutdown(cancel_futures=True)


@dataclass
class _Running:
    """A batch that is under way: its futures, as far as it has been read, and how many were handed out."""

    batch: Batch
    futures: list[Future[Outcome]] = field(default_factory=list)
    handed: int = 0
    since: float = field(default_factory=time.monotonic)

    def finished(self) -> tuple[Batch, list[Outcome]] | None:
        """Return the rest of the batch once it is finished, or a part that is due; else None."""
        end, size = self.handed, len(self.batch.items)
        while end < len(self.futures) and self.futures[end].done():
            end += 1
        is_due = end > self.handed and time.monotonic() - self.since > _KEEP
        if not (end == size or is_due):
            return None
        outcomes = [future.result() for future in self.futures[self.handed : end]]
        self.futures[self.handed : end] = [_HANDED] * len(outcomes)  # images need not wait for the rest
        part = self.batch.part(self.handed, end)
        self.handed, self.since = end, time.monotonic()
        return part, outcomes


_HANDED: Future[Any] = Future()
_HANDED.set_result(None)


def _hand_out(running: deque[_Running], finish: Finish[T], seconds: float = 0.0) -> Iterator[T]:
    """Yield what is finished of the first batches; wait for some seconds until all of the first is."""
    if seconds:
        wait(running[0].futures, seconds)
    while running and (finished := running[0].finished()) is not None:
        if running[0].handed == len(running[0].batch.items):
            running.popleft()
        yield finish(*finished)


def _for_batch(task: FrameTask, batch: Batch, hdu: int | None, running: Iterable[_Running]) -> FrameTask:
    """Prepare for a batch; if memory runs out, again when nothing else runs, and then without references."""
    for busy in ([future for one in running for future in one.futures], []):
        try:
            return task.for_batch(batch, hdu)
        except Exception as error:
            if not out_of_memory(error):
                raise
        wait(busy)
    return task.for_batch(replace(batch, references=()), hdu)


def _read(
    task: FrameTask, path: Path, index: int, raw: RawFrame | JitterkitError
) -> tuple[Outcome, RawFrame | None, Any]:
    """Calibrate a frame where it is read; whatever fails is tried again, and reported, in a thread.

    Returns the outcome so far, the frame as it was read if it is still to be calibrated, or else calibrated.
    """
    if isinstance(raw, JitterkitError):
        return Outcome(path, index, FitResult.from_error(Status.UNREADABLE, raw)), None, None
    try:
        digest, calibrated = raw.digest, task.calibrate(raw)
        return Outcome(path, index, None, raw.metadata, digest), None, calibrated
    except Exception:
        return Outcome(path, index, None, raw.metadata), raw, None


def _attempt(task: FrameTask, known: Outcome, raw: RawFrame | None, calibrated: Any, alone: bool) -> Outcome:
    """Process a frame; whatever it raises is a status, a lack of memory only if nothing else runs."""
    if known.result is not None:
        return known
    digest = known.digest
    try:
        if raw is not None:
            digest = raw.digest
            calibrated = task.calibrate(raw)
        result = task.complete(calibrated)
    except Exception as error:
        if out_of_memory(error) and not alone:
            raise
        log.debug("%s [%d]", known.path, known.index, exc_info=True)
        frame = calibrated if isinstance(calibrated, Frame) else None
        result = status_from_exception(error, frame, task.plate_scale)
    return Outcome(known.path, known.index, result, known.metadata, digest)
