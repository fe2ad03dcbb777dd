"""Frames worked through as they are read: the engine of a run.

Reach for :func:`process_batches`.  Frames are read and calibrated one after the other while threads fit
those before; no more than a few are held at a time, however many there are.  Frames of a batch that one
telescope took are fitted about one :class:`~jitterkit.optics.Anchor`, which makes them ten times cheaper and
moves no number by more than a thousandth of its error.

What a batch gives depends on its frames alone, to the last digit: not on who else is working, nor on what was
done before.
"""

from __future__ import annotations

import os
import threading
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

import numpy as np

from jitterkit.batch.frame import GridKey, Processed, Processor
from jitterkit.batch.ledger_worst import Rank, wanted
from jitterkit.batch.plan import Batch
from jitterkit.errors import FrameError
from jitterkit.frames import Frame, FrameFile, RawFrame, open_frames
from jitterkit.optics import Anchor, AnchoredOptics, OpticalSystem, Optics
from jitterkit.refit import FitResult, Status
from jitterkit.report.pictures import FrameReport, render_frame
from jitterkit.report.row import Row, make_row

__all__ = ["Done", "cores", "process_batches"]

Item = tuple[Path, int]
"""File and place of the frame in it."""

_BRIGHTER = 2.0
"""Times the light of the frame first looked at, that another may have."""

_KEPT = 8
"""Anchors, of 20 MB each at 128 x 128 pixels, kept for batches to come."""

_AHEAD = 4
"""Frames read ahead for each thread."""

_MENDED = (Status.POOR_FIT, Status.NOT_CONVERGED, Status.NO_PAIR, Status.FAILED)
"""What an anchor far from the truth may do to a frame, which is then fitted anew without."""


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


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
    threads = threads or cores()
    waiting: deque[tuple[Batch, list[Future]]] = deque()
    room = threading.Semaphore(threads * _AHEAD)
    survey = _Survey(processor, hdu)
    with ThreadPoolExecutor(threads, "fit") as pool:
        try:
            for batch in batches:
                near = replace(processor, anchored=survey.of(batch.lead))
                tasks: list[Future] = []
                waiting.append((batch, tasks))
                for path, index, raw in _read(batch.items, hdu):
                    frame = raw if isinstance(raw, FrameError) else processor.prepare(raw)
                    room.acquire()
                    tasks.append(pool.submit(_fit, path, index, raw, frame, near, processor))
                    tasks[-1].add_done_callback(lambda _: room.release())
                    if len(waiting) > 1 and all(task.done() for task in waiting[0][1]):
                        yield _collected(*waiting.popleft(), ranks())
            while waiting:
                yield _collected(*waiting.popleft(), ranks())
        finally:
            pool.shutdown(cancel_futures=True)


def _collected(batch: Batch, tasks: list[Future], ranks: Iterable[Rank]) -> Done:
    """What became of a batch, with pictures of those frames that the report of the run may want."""
    results: list[tuple[Processed, Row]] = [task.result() for task in tasks]
    drawable = {place: row for place, (done, row) in enumerate(results) if done.frame is not None}
    pictures = {}
    for place in wanted(ranks, batch.number, drawable):
        done, row = results[place]
        assert done.frame is not None
        pictures[place] = render_frame(done.frame, done.result, row)
    return Done(batch, [row for _, row in results], pictures)


def _read(items: Iterable[Item], hdu: int | None) -> Iterator[tuple[Path, int, RawFrame | FrameError]]:
    """Frames, or what is wrong with their files; a file is opened once."""
    for path, group in groupby(items, key=lambda item: item[0]):
        places = [index for _, index in group]
        try:
            file = open_frames(path, hdu=hdu)
        except FrameError as error:
            yield from ((path, index, error) for index in places)
            continue
        with file:
            for index in places:
                yield path, index, _frame(file, index)


def _frame(file: FrameFile, index: int) -> RawFrame | FrameError:
    try:
        return file[index]
    except FrameError as error:
        return error
    except IndexError:
        return FrameError(file.path, f"has {len(file)} frames, fewer than before", "see who writes to it")


def _fit(
    path: Path,
    index: int,
    raw: RawFrame | FrameError,
    frame: Frame | Processed | FrameError,
    near: Processor,
    alone: Processor,
) -> tuple[Processed, Row]:
    """What becomes of a frame that has been read."""
    if isinstance(frame, FrameError):
        done = Processed(None, FitResult(Status.UNREADABLE, str(frame)))
    elif isinstance(frame, Processed):
        done = frame
    else:
        done = near.fit(frame)
        if near.anchored and done.result.status in _MENDED:
            done = alone.fit(frame)
    source = done.frame or (None if isinstance(raw, FrameError) else raw)
    row = make_row(
        done.result,
        path,
        index,
        metadata=None if source is None else source.metadata,
        flags=() if done.frame is None else done.frame.flags,
        pixel=done.pixel,
        pa=done.pa,
        aberrations=alone.instrument.aberrations,
    )
    return done, row


class _Survey:
    """The optics of frames to come, as a few of them show them.

    An anchor's state is rounded to a whole nm, so that leads between which little has changed share one.
    """

    def __init__(self, processor: Processor, hdu: int | None) -> None:
        self._processor, self._hdu = processor, hdu
        self._anchors: OrderedDict[tuple, Anchor] = OrderedDict()
        self._last: tuple[tuple[Item, ...], dict[GridKey, Optics]] = ((), {})

    def of(self, lead: tuple[Item, ...]) -> dict[GridKey, Optics]:
        """Optics by the grids of the frames of a lead; none of a grid on which no frame is sound."""
        if lead != self._last[0]:
            self._last = lead, self._surveyed(lead)
        return self._last[1]

    def _surveyed(self, lead: tuple[Item, ...]) -> dict[GridKey, Optics]:
        found: dict[GridKey, Optics] = {}
        for _, _, raw in _read(lead, self._hdu):
            frame = None if isinstance(raw, FrameError) else self._processor.prepare(raw)
            if not isinstance(frame, Frame) or (key := self._processor.grid(frame)) in found:
                continue
            shown = self._processor.wavefront(frame)
            system = None if shown is None else self._processor.optics(frame)
            if shown is None or not isinstance(system, OpticalSystem) or not len(shown.aberrations):
                continue
            anchor = self._anchor(key, system, np.round(np.asarray(shown.aberrations)))
            found[key] = AnchoredOptics(system, anchor, _BRIGHTER * float(shown.scene.flux))
        return found

    def _anchor(self, grid: GridKey, system: OpticalSystem, state: np.ndarray) -> Anchor:
        key = (grid, *state)
        anchor = self._anchors.pop(key, None) or Anchor.at(system, state)
        self._anchors[key] = anchor
        if len(self._anchors) > _KEPT:
            self._anchors.popitem(last=False)
        return anchor
