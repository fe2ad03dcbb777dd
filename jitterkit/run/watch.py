"""A run that goes on while the camera does: frames are processed as they arrive.

Reach for :func:`watch_directory`.  Frames go through the same executor as those of
:func:`~jitterkit.run.process.process_files` and into the same store.  Which of them are done together, and
about whose optics, depends on when they came: so numbers agree with those of a run of the same files within
a few hundredths of their errors, not to the last digit.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path

from jitterkit.batch import FrameProcessor
from jitterkit.batch.configuration import settings
from jitterkit.batch.directory_watcher import DirectoryWatcher
from jitterkit.batch.executor import execute
from jitterkit.batch.plan import PLAN, Batch, Item
from jitterkit.batch.store import Store
from jitterkit.errors import ErrorCode, FrameError, printable
from jitterkit.frames.files import require_directory
from jitterkit.refit import Status
from jitterkit.report.row import Row
from jitterkit.run.process import Run, keep, prepare_run, write_outputs
from jitterkit.run.rows import Record, duplicate_marker, recorder

log = logging.getLogger(__name__)

_UNREADABLE = Status.UNREADABLE.name.lower()
"""In a row."""


@dataclass(frozen=True)
class WatchSettings:
    """Hold how often to scan, and how many frames to take at a time."""

    poll: float = 1.0
    """Seconds between two looks.  A look at 60,000 files, all but a few of them known, takes 0.05 s."""
    batch: int = 32
    """Frames of a batch: a second's work, for which the end of a watch has to wait."""
    sharing: int = 512
    """Frames after which to look at reference frames again."""
    pause: int = 2
    """Scans without a frame after which the work in progress is finished and reported."""


WATCH = WatchSettings()


def watch_directory(
    directory: str | Path,
    output: str | Path,
    processor: FrameProcessor,
    *,
    hdu: int | None = None,
    idle: float | None = None,
    poll: float = WATCH.poll,
    overwrite: bool = False,
    resume: bool = False,
    threads: int | None = None,
    stop: Callable[[], bool] = lambda: False,
    watch: Callable[[Row], None] | None = None,
    before: Callable[[Row], None] | None = None,
    command: str = "",
    sleep: Callable[[float], None] = time.sleep,
) -> Run:
    """Process the frames of a directory as they arrive, then write table, summary and report.

    Parameters
    ----------
    directory : str or Path
        Frames that are in it already count too; those in directories below it do not.
    output : str or Path
        Made if need be.
    processor : FrameProcessor
    hdu : int, optional
        HDU to read in every FITS file; a file without it is unfinished.
    idle : float, optional
        Seconds of waiting for nothing after which to end; never by default.
    poll : float
        Seconds between two looks.
    overwrite, resume, threads, command
        As for :func:`~jitterkit.run.process.process_files`.
    stop : callable, optional
        Asked before each look and each batch whether to end.
    watch : callable, optional
        Called with each row as it is done.
    before : callable, optional
        Called first, with each row of an earlier session; by default ``watch``.
    sleep : callable, optional
        Called with the seconds to wait.

    Returns
    -------
    run : Run
        Rows in the order in which frames came.  Files that are unfinished at the end follow them, with
        the reader's message; they are processed when the run is resumed, if they are complete then.  Files
        not yet read when the run is stopped, the rest of a file of many frames too, are listed in a warning,
        and processed when the run is resumed.

    Raises
    ------
    ConfigurationError
        As for :func:`~jitterkit.run.process.process_files`.
    FrameError
        If the directory does not exist, or no frame came.

    Notes
    -----
    A frame counts once.  What was read first stays: a file that is rewritten under its name is not processed
    again, in this session or in one that resumes it, and is warned of.  A frame that cannot be read, though
    its file was whole before, is no row yet: it is tried again when the file changes, and at the end.
    """
    directory, output = Path(directory), Path(output)
    require_directory(directory)
    configuration = settings(processor, [directory], hdu=hdu)
    with prepare_run(output, configuration, command, overwrite=overwrite, resume=resume) as store:
        mark, watch = duplicate_marker(), watch or (lambda row: None)
        watcher = DirectoryWatcher(directory, hdu, _report_earlier_rows(store, mark, before or watch))
        work = partial(execute, task=processor, hdu=hdu, threads=threads)
        watched = _Watch(store, processor, work, lambda row: watch(mark(row)), watcher.retry)
        for burst in _bursts(watcher, stop, idle, partial(sleep, poll), poll):
            watched.work_through(burst)
        if left := watcher.pending():
            log.warning("Not processed in %s: %s; --resume processes them.", printable(directory), left)
        unfinished = watched.try_last(watcher.unfinished())
        if not store.done() and not unfinished:
            problem = "has shown no frame"
            raise FrameError(ErrorCode.NO_IMAGE, directory, problem, "see where the camera writes")
        return write_outputs(store, output, processor, unfinished)


def _report_earlier_rows(
    store: Store, mark: Callable[[Row], Row], callback: Callable[[Row], None]
) -> dict[tuple[str, int], str]:
    """Report the rows of an earlier session; return their digests by name of file and index."""
    reported = {}
    for row in store.rows():
        callback(mark(row))
        # the directory may have been named otherwise
        reported[row["file"], row["frame"]] = row["digest"]
    return reported


Burst = Iterator[tuple[Item, ...]]
"""Frames that come one after the other without a pause."""


def _bursts(
    watcher: DirectoryWatcher,
    stop: Callable[[], bool],
    idle: float | None,
    sleep: Callable[[], None],
    poll: float,
) -> Iterator[Burst]:
    """Yield bursts of chunks of frames, until it is time to end."""
    waited = 0.0

    def over() -> bool:
        # a file is whole at the second look
        return stop() or (idle is not None and waited >= max(idle, 2 * poll))

    def burst() -> Burst:
        nonlocal waited
        barren = 0
        while barren <= WATCH.pause and not over():
            scan = watcher.scan()
            found = False
            while not stop() and (chunk := tuple(islice(scan, WATCH.batch))):
                found, waited = True, 0.0
                yield chunk
            barren = 0 if found else barren + 1
            waited = 0.0 if watcher.changed else waited
            if not over():
                sleep()
                waited += poll

    while not over():
        yield burst()


class _Watch:
    """Process frames in batches, and store and report their results."""

    def __init__(
        self,
        store: Store,
        processor: FrameProcessor,
        work: Callable[..., Iterator[Record]],
        watch: Callable[[Row], None],
        retry: Callable[[Path, int], None],
    ) -> None:
        self._store, self._watch, self._retry = store, watch, retry
        self._ranks = store.ranks()
        self._work = partial(work, finish=recorder(processor, self._ranks))
        self._number = max(store.done(), default=-1) + 1

    def work_through(self, burst: Burst) -> None:
        """Process a burst."""
        for record in self._work(self._batches(burst)):
            self._keep(record)

    def _batches(self, burst: Burst) -> Iterator[Batch]:
        """Yield the batches of a burst; its latest frames are reference frames of those that follow."""
        references: tuple[Item, ...] = ()
        came = since = 0
        for chunk in burst:
            came += len(chunk)
            if came >= PLAN.fewest and (not references or since >= WATCH.sharing):
                references, since = chunk[: PLAN.references], 0
            since += len(chunk)
            yield Batch(self._number, chunk, references)
            self._number += 1

    def _keep(self, record: Record) -> None:
        """Store and report the results of frames, except those that could not be read."""
        read = [index for index, row in enumerate(record.rows) if row["status"] != _UNREADABLE]
        for index in set(range(len(record.rows))).difference(read):
            self._retry(*record.batch.items[index])
        rows = [record.rows[index] for index in read]
        pictures = {new: record.pictures[old] for new, old in enumerate(read) if old in record.pictures}
        if rows:
            keep(self._store, replace(record, rows=rows, pictures=pictures), self._ranks)
        for row in rows:
            self._watch(row)

    def try_last(self, items: Iterable[Item]) -> list[Row]:
        """Try frames of files that were never whole; returns a row for the first unreadable one of each."""
        unreadable: dict[Path, Row] = {}
        for path, index in items:
            if path in unreadable:
                continue
            (record,) = self._work([Batch(self._number, ((path, index),))])
            if record.rows[0]["status"] == _UNREADABLE:
                unreadable[path] = record.rows[0]
                self._watch(record.rows[0])
            else:
                self._keep(record)
                self._number += 1
        return list(unreadable.values())
