"""What a run has done so far, kept so that nothing is lost or done twice.

Reach for :meth:`Ledger.create` to begin a run and :meth:`Ledger.resume` to go on with one.  The rows of a
batch, its pictures and the fact that it was done enter ``ledger.sqlite`` together or not at all; once
:meth:`Ledger.add` returns they survive a kill and the loss of power.  Table, summary and report are made
from the ledger, in the order of the plan, whoever did which batch and when.

In the ``sqlite3`` shell, when no run has it open, the tables ``frames`` and ``run`` are for reading.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, Self

from jitterkit.batch.ledger_file import LedgerFile
from jitterkit.batch.ledger_match import refuse_difference
from jitterkit.batch.ledger_results import refuse_results, remove_results
from jitterkit.batch.ledger_stamps import Counted, counted, recounted
from jitterkit.batch.ledger_trouble import told
from jitterkit.batch.ledger_worst import Rank, rank, worst
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.report.pictures import FrameReport, Gallery
from jitterkit.report.row import Row
from jitterkit.report.words import printable

__all__ = ["LEDGER", "Ledger"]

LEDGER = "ledger.sqlite"
"""Its name in the directory of a run."""

_SHOWN = ("file", "frame", "status", "locus", "separation", "separation_err", "chi2_dof")
"""Columns of a row that stand in the table ``frames`` besides, for people."""

_AT_ONCE = 64
"""Files counted between two writes: a flush of the disk costs as much as opening a file or more."""


class Ledger:
    """The ledger of a run; a context manager that keeps every other process out while it is open.

    Threads may share it.

    Attributes
    ----------
    path : Path
        ``ledger.sqlite`` in the run's directory.
    configuration : dict
        What the run was begun with.
    notes : dict
        What else was noted when it was begun.

    Notes
    -----
    Rows come back exactly: floats to the last bit, NaN, infinities, integers of any size, and any text,
    undecodable file names among it.  A batch is one compressed JSON.  Of rows of 80 columns, 48 a batch,
    60,000 take 75 MB, enter at 11,000/s with a flush of the disk for each batch, and are read in 1.7 s.

    *Fails when* the file system lies about locks or about flushing, or when the process itself opens and
    closes the file by other means: POSIX then drops its lock.
    """

    def __init__(self, path: Path) -> None:
        self.path, self._file = path, LedgerFile(path)
        with self._closed_on_error():
            self.configuration: dict[str, Any] = self._noted("configuration", {})
            self.notes: dict[str, Any] = self._noted("notes", {})

    @classmethod
    def create(
        cls,
        directory: str | Path,
        configuration: Mapping[str, Any],
        notes: Mapping[str, Any] | None = None,
        *,
        overwrite: bool = False,
    ) -> Self:
        """Begin a run.

        Parameters
        ----------
        directory : str or Path
            Exists.
        configuration : mapping
            All that the rows depend on, as JSON knows it, the list of files, the size of a batch and the
            ``versions`` of programs among it: whoever resumes must come with the same.
        notes : mapping, optional
            What is only kept: the command line, the date.
        overwrite : bool
            Whether a run that is in the directory may be forgotten; its table, summary and report, which
            would be taken for those of the new one, are removed then.

        Raises
        ------
        ConfigurationError
            If there is a run and it may not be forgotten, another process is writing to it, or the
            directory cannot be written.
        """
        ledger = cls(Path(directory) / LEDGER)
        with ledger._closed_on_error():
            if ledger._begun and not overwrite:
                raise ConfigurationError(
                    ErrorCode.EXISTS,
                    f"{printable(ledger.path)} holds a run already; give --resume to go on with it, "
                    "--overwrite to begin again, or another directory.",
                )
            if overwrite:
                remove_results(ledger.path.parent)  # first: whatever kills it now, none outlive their run
            ledger._begin(configuration, notes or {})
        return ledger

    @classmethod
    def resume(
        cls,
        directory: str | Path,
        configuration: Mapping[str, Any],
        notes: Mapping[str, Any] | None = None,
    ) -> Self:
        """Go on with a run, or begin it if it was interrupted before it began.

        Parameters
        ----------
        directory, configuration, notes
            As for :meth:`create`; the notes of a run that had begun stay as they were.

        Raises
        ------
        ConfigurationError
            If the configuration is not that of the run, there is none but results of one, the ledger is
            damaged, another process is writing to it, or the directory cannot be written.
        """
        if not (Path(directory) / LEDGER).exists():
            refuse_results(Path(directory))  # before there is an empty ledger beside them
        ledger = cls(Path(directory) / LEDGER)
        with ledger._closed_on_error():
            if ledger._begun:
                refuse_difference(ledger.path.parent, ledger.configuration, _as_json(configuration))
            else:
                refuse_results(ledger.path.parent)
                ledger._begin(configuration, notes or {})
        return ledger

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let the file go; harmless when done twice."""
        self._file.close()

    def add(
        self,
        batch: int,
        rows: Sequence[Row],
        pictures: Mapping[int, FrameReport] | None = None,
    ) -> None:
        """Enter a batch that is done.

        Parameters
        ----------
        batch : int
            Its number in the plan.
        rows : sequence of dict
            In order: text, integers, floats, booleans.
        pictures : mapping from int to FrameReport, optional
            By place in the batch, those that :func:`~jitterkit.batch.ledger_worst.wanted` named.  Only
            the worst of the run are kept, some tens.

        Raises
        ------
        ConfigurationError
            If the disk is full or fails; nothing is entered then.
        ValueError
            If the batch has been entered before.
        """
        packed = _pack(rows)
        shown = [
            (batch, place, *(_readable(row.get(name)) for name in _SHOWN)) for place, row in enumerate(rows)
        ]
        with self._file.transaction() as execute:
            if execute("SELECT 1 FROM batches WHERE batch = ?", (batch,)).fetchone():
                raise ValueError(f"Batch {batch} has been entered in {self.path} before.")
            execute("INSERT INTO batches VALUES (?, ?)", (batch, packed))
            for values in shown:
                execute("INSERT INTO frames VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)", values)
            for place, report in (pictures or {}).items():
                usable, order, *_ = rank(rows[place], batch, place)
                values = (batch, place, usable, -order, report.name, report.alt, report.picture)
                execute("INSERT INTO pictures VALUES (?, ?, ?, ?, ?, ?, ?)", values)
            if pictures:
                self._prune(execute)

    def _prune(self, execute: Callable) -> None:
        ranks = self.ranks()
        for _, _, batch, place in set(ranks) - set(worst(ranks)):
            execute("DELETE FROM pictures WHERE batch = ? AND place = ?", (batch, place))

    def done(self) -> frozenset[int]:
        """Numbers of the batches that have been entered."""
        return frozenset(batch for (batch,) in self._file.read("SELECT batch FROM batches"))

    def rows(self) -> Iterator[Row]:
        """All rows in the order of the plan, one batch in memory at a time."""
        for batch in sorted(self.done()):
            yield from self._rows_of(batch)

    def _rows_of(self, batch: int) -> list[Row]:
        with told(self.path):
            return _unpack(self._file.read("SELECT rows FROM batches WHERE batch = ?", (batch,))[0][0])

    def ranks(self) -> list[Rank]:
        """Ranks of the pictures there are, for :func:`~jitterkit.batch.ledger_worst.wanted`."""
        ranks = self._file.read("SELECT usable, misfit, batch, place FROM pictures")
        return [(bool(usable), -misfit, batch, place) for usable, misfit, batch, place in ranks]

    def pictures(self) -> list[FrameReport]:
        """The frames for the report, as :meth:`~jitterkit.report.pictures.Gallery.chosen` orders them."""
        gallery = Gallery()
        for batch, place, name, picture, alt in self._file.read(
            "SELECT batch, place, name, picture, alt FROM pictures ORDER BY batch, place"
        ):
            gallery.add(FrameReport(name, self._rows_of(batch)[place], picture, alt))
        return gallery.chosen()

    def check_files(self, files: Sequence[Path], count: Callable[[Path], int], size: int) -> None:
        """Look whether files are still those that were counted, before a run goes on.

        Parameters
        ----------
        files, count
            As for :meth:`frame_counts`.
        size : int
            Frames in a batch.

        Raises
        ------
        ConfigurationError
            As from :func:`~jitterkit.batch.ledger_stamps.recounted`; what has changed without harm is
            counted anew.
        """
        changed = recounted(files, self._counted(), count, size, self.done())
        with self._file.transaction() as execute:
            self._keep_counts(execute, changed)

    def frame_counts(
        self,
        files: Sequence[Path],
        count: Callable[[Path], int],
        over: Callable[[Callable[[Path], Counted], Iterable[Path]], Iterable[Counted]] = map,
    ) -> Iterator[int]:
        """Number of frames in each file, each counted once in the life of a run.

        Parameters
        ----------
        files : sequence of Path
            The same, in the same order, whenever the run is resumed.
        count : callable
            Counts the frames of a file, :func:`~jitterkit.batch.plan.count_frames`.
        over : callable
            Maps a function lazily over files: ``map``, or a pool's.

        Yields
        ------
        frames : int
            A number is kept before it is yielded, with the size and time of the file.  So the plan of a run
            stays as it was, even if a file has since vanished, and no batch comes to mean other frames.
        """
        known = self._counted()
        yield from (one.frames for one in known)
        place, fresh = len(known), iter(over(partial(counted, count=count), files[len(known) :]))
        while chunk := dict(enumerate(islice(fresh, _AT_ONCE), place)):
            with self._file.transaction() as execute:
                self._keep_counts(execute, chunk)
            yield from (one.frames for one in chunk.values())
            place += len(chunk)

    def _counted(self) -> list[Counted]:
        found = self._file.read("SELECT frames, size, time FROM files ORDER BY position")
        return [Counted(frames, None if size is None else (size, time)) for frames, size, time in found]

    def _keep_counts(self, execute: Callable, files: Mapping[int, Counted]) -> None:
        for position, one in files.items():
            values = (position, one.frames, *(one.stamp or (None, None)))
            execute("INSERT OR REPLACE INTO files VALUES (?, ?, ?, ?)", values)

    @property
    def _begun(self) -> bool:
        return bool(self._file.read("SELECT 1 FROM run WHERE name = 'configuration'"))

    def _begin(self, configuration: Mapping[str, Any], notes: Mapping[str, Any]) -> None:
        self.configuration, self.notes = _as_json(configuration), _as_json(notes)
        with self._file.transaction() as execute:
            for table in ("run", "files", "batches", "frames", "pictures"):
                execute(f"DELETE FROM {table}")
            self._note(execute, "configuration", self.configuration)
            self._note(execute, "notes", self.notes)

    def _note(self, execute: Callable, name: str, value: Any) -> None:
        execute("INSERT OR REPLACE INTO run VALUES (?, ?)", (name, json.dumps(value, indent=1)))

    def _noted(self, name: str, otherwise: Any) -> Any:
        found = self._file.read("SELECT value FROM run WHERE name = ?", (name,))
        with told(self.path):
            return json.loads(found[0][0]) if found else otherwise

    @contextmanager
    def _closed_on_error(self) -> Iterator[None]:
        try:
            yield
        except BaseException:
            self.close()
            raise


def _as_json(value: Mapping[str, Any]) -> dict[str, Any]:
    return json.loads(json.dumps(value))


def _pack(rows: Sequence[Row]) -> bytes:
    # surrogatepass: the undecodable bytes of a file name.  Level 6 saves a sixth and takes twice as long.
    return zlib.compress(json.dumps(rows, ensure_ascii=False).encode("utf-8", "surrogatepass"), 1)


def _unpack(packed: bytes) -> list[Row]:
    return json.loads(zlib.decompress(packed).decode("utf-8", "surrogatepass"))


def _readable(value: Any) -> Any:
    """As SQLite can hold it, near enough for the eye."""
    if isinstance(value, str):
        return value.encode("utf-8", "backslashreplace").decode()
    return None if isinstance(value, int) and value.bit_length() > 63 else value
