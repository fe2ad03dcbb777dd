"""Frames worked through as they are read: the engine of a run.

Reach for :func:`process_batches`.  Frames are read and calibrated one after the other while threads fit
those before; no more than two batches are held at a time, however many there are.  Frames of a batch that one
telescope took are fitted about one :class:`~jitterkit.optics.Anchor`, and registered to one of them
(:class:`~jitterkit.locate.ReferenceFrame`) instead of searched for their pair; what is left out of their
optics stays below what a single fit leaves out, 0.1 sigma of the whole image.

What a batch gives depends on its frames and its lead alone, to the last digit: not on who else is working,
nor on what was done before.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TypeVar

from jitterkit.batch.frame import Processed, Processor
from jitterkit.batch.ledger_worst import Rank, rank, wanted
from jitterkit.batch.plan import Batch
from jitterkit.batch.room import Room
from jitterkit.batch.survey import Survey, read_items
from jitterkit.errors import JitterkitError, out_of_memory
from jitterkit.frames import Frame, RawFrame
from jitterkit.refit import FitResult, Status
from jitterkit.report.pictures import FrameReport, render_frame
from jitterkit.report.row import Row, make_row

__all__ = ["Done", "cores", "in_threads", "process_batches"]

T = TypeVar("T")
U = TypeVar("U")

_AHEAD = 3
"""Frames read ahead for each thread."""

_MENDED = (Status.POOR_FIT, Status.NOT_CONVERGED, Status.NO_PAIR, Status.FAILED)
"""What may come of what is known of others; such a frame is fitted anew without."""

_SURE = (Status.POOR_FIT, Status.NO_PAIR)
"""Of these, what does not, where pair and wavefront are in no doubt: the locus does not fit."""


@dataclass(frozen=True)
class Done:
    """A batch that is done.

    Attributes
    ----------
    batch : Batch
    rows : list of dict
        One for each of its frames, in order; one that could not be read, or not be used, has one too.
    pictures : dict from int to FrameReport
        Of the frames that were worth one, by their place in the batch.
    """

    batch: Batch
    rows: list[Row]
    pictures: dict[int, FrameReport]


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def process_batches(
    batches: Iterable[Batch],
    processor: Processor,
    *,
    hdu: int | None = None,
    threads: int | None = None,
    ranks: Callable[[], Iterable[Rank]] = tuple,
) -> Iterator[Done]:
    """Process batches in order; a batch comes out when all of it is done.

    Parameters
    ----------
    batches : iterable of Batch
        Asked for one by one.
    processor : Processor
    hdu : int, optional
        To read in every FITS file.
    threads : int, optional
        How many fit at a time; by default as many as there are processors.
    ranks : callable, optional
        Ranks of the pictures that there are: what is better than these is not drawn.

    Yields
    ------
    done : Done
    """
    survey = Survey(processor, hdu)

    def begin(batch: Batch) -> _Prepare[_Fit]:
        return partial(_prepare, replace(processor, known=survey.of(batch)), processor)

    drawing: deque[_Drawing] = deque()
    with ThreadPoolExecutor(1, "draw") as painter:  # while frames go on being read
        try:
            for batch, results in in_threads(batches, begin, _call, hdu=hdu, threads=threads):
                known = chain(ranks(), *(one.ranks() for one in drawing))
                drawing.append(_Drawing.begin(painter, batch, results, known))
                del results  # their images need not wait for the next batch
                while len(drawing) > 1 or (drawing and drawing[0].over):
                    yield drawing.popleft().done()
            while drawing:
                yield drawing.popleft().done()
        finally:
            painter.shutdown(cancel_futures=True)


_Prepare = Callable[[Path, int, RawFrame | JitterkitError], U]
"""Takes path, place and frame (or what is wrong with the file), and does what is best done while reading."""


def in_threads(
    batches: Iterable[Batch],
    begin: Callable[[Batch], _Prepare[U]],
    work: Callable[[U, bool], T],
    *,
    hdu: int | None = None,
    threads: int | None = None,
) -> Iterator[tuple[Batch, list[T]]]:
    """Read the frames of batches one after the other, and let threads do what there is to do.

    Parameters
    ----------
    batches : iterable of Batch
    begin : callable
        Called with each batch before its frames are read; returns a function that prepares a frame, here.
    work : callable
        Called in a thread with a frame as it was prepared, and whether it is alone (:meth:`Room.do`).
    hdu, threads
        As for :func:`process_batches`.

    Yields
    ------
    batch : Batch
    results : list
        Of its frames, in order.
    """
    threads = threads or cores()
    waiting: deque[tuple[Batch, list[Future[T]]]] = deque()
    room, ahead = Room(threads), threading.Semaphore(threads * (1 + _AHEAD))
    with ThreadPoolExecutor(threads, "fit") as pool:
        try:
            for batch in batches:
                while len(waiting) > 1:  # for a frame that takes long no more are held than these
                    yield _results(*waiting.popleft())
                prepare = _begun(begin, batch, waiting)
                tasks: list[Future[T]] = []
                waiting.append((batch, tasks))
                for entry in read_items(batch.items, hdu):
                    one = prepare(*entry)
                    ahead.acquire()
                    tasks.append(pool.submit(room.do, partial(work, one)))
                    tasks[-1].add_done_callback(lambda _: ahead.release())
                    if len(waiting) > 1 and all(task.done() for task in waiting[0][1]):
                        yield _results(*waiting.popleft())
            while waiting:
                yield _results(*waiting.popleft())
        finally:
            pool.shutdown(cancel_futures=True)


def _begun(
    begin: Callable[[Batch], _Prepare[U]],
    batch: Batch,
    waiting: Iterable[tuple[Batch, list[Future[T]]]],
) -> _Prepare[U]:
    """Begin a batch; if memory runs out, once more when nothing else is under way."""
    try:
        return begin(batch)
    except Exception as error:
        if not out_of_memory(error):
            raise
        wait([task for _, tasks in waiting for task in tasks])
        return begin(batch)


def _results(batch: Batch, tasks: list[Future[T]]) -> tuple[Batch, list[T]]:
    return batch, [task.result() for task in tasks]


@dataclass(frozen=True)
class _Drawing:
    """A batch that is done but for its pictures."""

    batch: Batch
    rows: list[Row]
    pictures: dict[int, Future[FrameReport]]

    @classmethod
    def begin(
        cls,
        painter: ThreadPoolExecutor,
        batch: Batch,
        results: list[tuple[Processed, Row]],
        ranks: Iterable[Rank],
    ) -> _Drawing:
        """Draw those of its frames of which the report of the run may want a picture."""
        drawable = {place: row for place, (done, row) in enumerate(results) if done.frame is not None}
        pictures = {
            place: painter.submit(_picture, *results[place])
            for place in wanted(ranks, batch.number, drawable)
        }
        return cls(batch, [row for _, row in results], pictures)

    def ranks(self) -> list[Rank]:
        """Those of its pictures."""
        return [rank(self.rows[place], self.batch.number, place) for place in self.pictures]

    @property
    def over(self) -> bool:
        """Whether they are all drawn."""
        return all(picture.done() for picture in self.pictures.values())

    def done(self) -> Done:
        """The batch, when they are."""
        pictures = {place: picture.result() for place, picture in self.pictures.items()}
        return Done(self.batch, self.rows, pictures)


def _picture(done: Processed, row: Row) -> FrameReport:
    assert done.frame is not None
    return render_frame(done.frame, done.result, row)


_Fit = Callable[[bool], tuple[Processed, Row]]


def _call(fit: _Fit, last: bool) -> tuple[Processed, Row]:
    return fit(last)


def _prepare(
    near: Processor, alone: Processor, path: Path, index: int, raw: RawFrame | JitterkitError
) -> _Fit:
    """Calibrate a frame here; fit it there."""
    ready: Frame | FitResult | RawFrame
    if isinstance(raw, JitterkitError):
        metadata, digest, ready = None, "", FitResult.from_error(Status.UNREADABLE, raw)
    else:
        metadata, digest, ready = raw.metadata, raw.digest, _calibrated(alone, raw)
    del raw  # a camera's whole frame need not wait with the stars that were cut out of it

    def fit(last: bool) -> tuple[Processed, Row]:
        try:
            done = _fit(near, alone, ready)
        except Exception as error:  # memory ran out
            if not last:
                raise
            frame = ready if isinstance(ready, Frame) else None
            message = f"{Status.FAILED.value}: {error}"
            done = Processed(frame, FitResult.from_error(Status.FAILED, error, message))
        row = make_row(
            done.result,
            path,
            index,
            metadata=metadata if done.frame is None else done.frame.metadata,
            flags=() if done.frame is None else done.frame.flags,
            pixel=done.pixel,
            pa=done.pa,
            aberrations=alone.instrument.aberrations,
            digest=digest,
        )
        return done, row

    return fit


def _calibrated(processor: Processor, raw: RawFrame) -> Frame | FitResult | RawFrame:
    """A frame in electrons, or why not; as it is where there is no memory at the moment."""
    try:
        return processor.prepare(raw)
    except Exception:
        return raw


def _fit(near: Processor, alone: Processor, ready: Frame | FitResult | RawFrame) -> Processed:
    """Fit a frame about what is known; without, if that may be why it cannot be fitted."""
    frame = alone.prepare(ready) if isinstance(ready, RawFrame) else ready
    if isinstance(frame, FitResult):
        return Processed(None, frame)
    done = near.fit(frame)
    if not near.known or done.result.status not in _MENDED:
        return done
    return done if done.result.status in _SURE and near.repeats(frame) else alone.fit(frame)
