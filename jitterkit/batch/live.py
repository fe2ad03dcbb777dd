"""A run that goes on while the camera does: frames are processed as they arrive.

Reach for :func:`watch_directory`.  Frames go through the same engine as those of
:func:`~jitterkit.batch.run.process_files` and into the same ledger.  Which of them are done together, and
about whose optics, depends on when they came: so numbers agree with those of a run of the same files within
a few hundredths of their errors, not to the last digit.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import islice
from pathlib import Path

from jitterkit.batch.arrivals import Arrivals
from jitterkit.batch.configuration import settings
from jitterkit.batch.duplicates import duplicate_marker
from jitterkit.batch.frame import Processor
from jitterkit.batch.ledger import Ledger
from jitterkit.batch.plan import Batch
from jitterkit.batch.run import Run, conclude
from jitterkit.batch.stream import Done, process_batches
from jitterkit.batch.survey import Item
from jitterkit.errors import ConfigurationError, ErrorCode, FrameError
from jitterkit.refit import Status
from jitterkit.report.outputs import RUN, make_directory
from jitterkit.report.row import Row
from jitterkit.report.words import printable

__all__ = ["POLL", "watch_directory"]

log = logging.getLogger(__name__)

_UNREADABLE = Status.UNREADABLE.name.lower()
"""In a row."""

POLL = 1.0
"""Seconds between two looks.  A look at 60,000 files, all but a few of them known, takes 0.05 s."""

_AT_ONCE = 32
"""Frames of a batch: a second's work, for which the end of a watch has to wait."""

_LEAD, _FEWEST, _LASTING = 4, 8, 512
"""Frames that show the optics to others; frames that must have come in a row for it to be worth the two
seconds it takes; frames after which to look again."""

_PAUSE = 2
"""Looks without a frame after which what is under way is brought to its end and told."""


def watch_directory(
    directory: str | Path,
    output: str | Path,
    processor: Processor,
    *,
    hdu: int | None = None,
    idle: float | None = None,
    poll: float = POLL,
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
    processor : Processor
    hdu : int, optional
        HDU to read in every FITS file; a file without it is unfinished.
    idle : float, optional
        Seconds of waiting for nothing after which to end; never by default.
    poll : float
        Seconds between two looks.
    overwrite, resume, threads, command
        As for :func:`~jitterkit.batch.run.process_files`.
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
        Rows in the order in which frames came.  Files that are unfinished at the end stand behind them, with
        what the reader says; they are done when the run is resumed, if they are whole then.  What there was
        and has not been looked at when the run is stopped, the rest of a file of many frames too, is told by
        a warning, and done when the run is resumed.

    Raises
    ------
    ConfigurationError
        As for :func:`~jitterkit.batch.run.process_files`.
    FrameError
        If the directory does not exist, or no frame came.

    Notes
    -----
    A frame counts once.  What was read first stays: a file that is written anew under its name is not done
    anew, in this session or in one that resumes it.  A frame that cannot be read, though its file was whole
    before, is no row yet: it is tried again when the file changes, and at the end.
    """
    directory, output = Path(directory), Path(output)
    if not directory.is_dir():
        code = ErrorCode.NOT_READABLE if directory.exists() else ErrorCode.NOT_FOUND
        raise FrameError(code, directory, "is not a directory", "give the one into which the camera writes")
    if overwrite and resume:
        raise ConfigurationError(
            ErrorCode.CONFLICT, "--resume goes on with a run, --overwrite begins anew; give one of the two."
        )
    make_directory(output, RUN, overwrite or resume)
    begin = Ledger.resume if resume else partial(Ledger.create, overwrite=overwrite)
    with begin(output, settings(processor, [directory], hdu=hdu), {"command": command}) as ledger:
        work = partial(process_batches, processor=processor, hdu=hdu, threads=threads, ranks=ledger.ranks)
        mark, watch = duplicate_marker(), watch or (lambda row: None)
        arrivals = Arrivals(directory, hdu, _told_before(ledger, mark, before or watch))
        watched = _Watch(ledger, work, lambda row: watch(mark(row)), arrivals.again)
        for burst in _bursts(arrivals, stop, idle, partial(sleep, poll), poll):
            watched.work_through(burst)
        if left := arrivals.left():
            log.warning("Not looked at in %s: %s; --resume does them.", printable(directory), left)
        unfinished = watched.try_last(arrivals.unfinished())
        if not ledger.done() and not unfinished:
            raise FrameError(
                ErrorCode.NO_IMAGE, directory, "has shown no frame", "see where the camera writes"
            )
        return conclude(ledger, output, processor, unfinished)


def _told_before(
    ledger: Ledger, mark: Callable[[Row], Row], tell: Callable[[Row], None]
) -> frozenset[tuple[str, int]]:
    """Tell the rows of an earlier session; returns the names of their files and their places."""
    told = set()
    for row in ledger.rows():
        tell(mark(row))
        # the directory may have been named otherwise
        told.add((row["file"], row["frame"]))
    return frozenset(told)


Burst = Iterator[tuple[Item, ...]]
"""Frames that come one after the other without a pause."""


def _bursts(
    arrivals: Arrivals, stop: Callable[[], bool], idle: float | None, sleep: Callable[[], None], poll: float
) -> Iterator[Burst]:
    """Bursts of chunks of frames, until it is time to end."""
    waited = 0.0

    def over() -> bool:
        # a file is whole at the second look
        return stop() or (idle is not None and waited >= max(idle, 2 * poll))

    def burst() -> Burst:
        nonlocal waited
        barren = 0
        while barren <= _PAUSE and not over():
            look = arrivals.look()
            found = False
            while not stop() and (chunk := tuple(islice(look, _AT_ONCE))):
                found, waited = True, 0.0
                yield chunk
            barren = 0 if found else barren + 1
            waited = 0.0 if arrivals.stirred else waited
            if not over():
                sleep()
                waited += poll

    while not over():
        yield burst()


class _Watch:
    """What is done with frames: batches are made of them, and what becomes of those is kept and told."""

    def __init__(
        self,
        ledger: Ledger,
        work: Callable[..., Iterator[Done]],
        watch: Callable[[Row], None],
        again: Callable[[Path, int], None],
    ) -> None:
        self._ledger, self._work, self._watch, self._again = ledger, work, watch, again
        self._number = max(ledger.done(), default=-1) + 1

    def work_through(self, burst: Burst) -> None:
        """Process a burst."""
        for done in self._work(self._batches(burst)):
            self._keep(done)

    def _batches(self, burst: Burst) -> Iterator[Batch]:
        """Batches of a burst; its latest frames show the optics to those that follow."""
        lead: tuple[Item, ...] = ()
        came = since = 0
        for chunk in burst:
            came += len(chunk)
            if came >= _FEWEST and (not lead or since >= _LASTING):
                lead, since = chunk[:_LEAD], 0
            since += len(chunk)
            yield Batch(self._number, chunk, lead)
            self._number += 1

    def _keep(self, done: Done) -> None:
        """Keep and tell what has become of a batch, but for frames that could not be read."""
        read = [place for place, row in enumerate(done.rows) if row["status"] != _UNREADABLE]
        for place in set(range(len(done.rows))).difference(read):
            self._again(*done.batch.items[place])
        rows = [done.rows[place] for place in read]
        pictures = {new: done.pictures[old] for new, old in enumerate(read) if old in done.pictures}
        if rows:
            self._ledger.add(done.batch.number, rows, pictures)
        for row in rows:
            self._watch(row)

    def try_last(self, items: Iterable[Item]) -> list[Row]:
        """Try frames of files that were never whole; returns a row for the first unreadable one of each."""
        unreadable: dict[Path, Row] = {}
        for path, index in items:
            if path in unreadable:
                continue
            (done,) = self._work([Batch(self._number, ((path, index),))])
            if done.rows[0]["status"] == _UNREADABLE:
                unreadable[path] = done.rows[0]
                self._watch(done.rows[0])
            else:
                self._keep(done)
                self._number += 1
        return list(unreadable.values())
