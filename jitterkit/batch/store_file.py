"""The SQLite file of a store, open to one process at a time, and what can happen to it, in sentences.

Reach for :class:`StoreFile`: it reads, and writes all of a block or nothing; :class:`FileCounts` keeps
there how many frames each file of a run has.  Its lock is SQLite's own and ends with the process that
holds it, however that ends.
"""

from __future__ import annotations

import json
import os
import sqlite3
import threading
import time
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

from jitterkit.batch.resume import Counted, counted, recounted
from jitterkit.errors import ConfigurationError, ErrorCode, printable

_APPLICATION = 0x4A544B4C
"""Marks the file as ours in its header: JTKL."""

_FORMAT = 4
"""Of the tables below; to be raised when they change."""

_TABLES = """
    CREATE TABLE run (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
    CREATE TABLE files (position INTEGER PRIMARY KEY, frames INTEGER NOT NULL, size INTEGER, time INTEGER);
    CREATE TABLE batches (
        batch INTEGER, start INTEGER, count INTEGER, rows BLOB NOT NULL, PRIMARY KEY (batch, start)
    );
    CREATE TABLE frames (
        batch INTEGER, place INTEGER, file TEXT, frame INTEGER, status TEXT, locus TEXT,
        separation REAL, separation_err REAL, chi2_dof REAL, PRIMARY KEY (batch, place)
    ) WITHOUT ROWID;
    CREATE TABLE pictures (
        batch INTEGER, place INTEGER, usable INTEGER, misfit REAL, data BLOB, PRIMARY KEY (batch, place)
    );
    CREATE TABLE stacks (name TEXT PRIMARY KEY, data BLOB NOT NULL) WITHOUT ROWID;
"""

_WAITS = (0.05, 0.1, 0.2, 0.4)
"""Seconds between attempts to get the lock: a process that is just ending may hold it, or one that
looks and is about to be refused."""

_ERRORS = (sqlite3.Error, zlib.error, UnicodeDecodeError, json.JSONDecodeError)
"""What a disk or a file can do; whatever has no sentence of its own below is damage."""

_LOCKED = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
_BROKEN = (sqlite3.SQLITE_IOERR, sqlite3.SQLITE_PROTOCOL, sqlite3.SQLITE_NOLFS)
_CLOSED = (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_PERM, sqlite3.SQLITE_AUTH)


class StoreFile:
    """A store's tables, made if need be; what is committed survives the loss of power.

    Parameters
    ----------
    path : Path

    Raises
    ------
    ConfigurationError
        Here and from every method: if another process has it open, it cannot be written, is damaged, is no
        ledger or one of another format, or the disk is full or fails.

    Notes
    -----
    A write-ahead log costs one flush of the disk a transaction.  As the lock is exclusive and taken first,
    the log needs no memory shared between processes, so that a network file system will do if it can lock.
    """

    def __init__(self, path: Path) -> None:
        if os.path.exists(path) and not os.access(path, os.W_OK):  # SQLite would open it for reading
            raise unwritable(path, "it is read-only")
        self.path, self._lock, waits = path, threading.RLock(), iter(_WAITS)
        while True:
            try:
                with translate_errors(path):
                    self.connection = _open(path)
                return
            except ConfigurationError as error:
                wait = next(waits, None)
                if wait is None or _code(error.__cause__) not in _LOCKED:
                    raise
                time.sleep(wait)

    def read(self, query: str, values: Sequence[Any] = ()) -> list[tuple]:
        """Return all that a query finds."""
        with self._lock, translate_errors(self.path):
            return self.connection.execute(query, values).fetchall()

    @contextmanager
    def transaction(self) -> Iterator[Callable[..., sqlite3.Cursor]]:
        """Do all that the block executes, or nothing; other threads wait."""
        with self._lock, translate_errors(self.path):
            self.connection.execute("BEGIN IMMEDIATE")
            try:
                yield self.connection.execute
                self.connection.execute("COMMIT")
            except BaseException:
                if self.connection.in_transaction:  # SQLite may have taken it back already
                    self.connection.execute("ROLLBACK")
                raise

    def close(self) -> None:
        """Let the file go; harmless when done twice."""
        with self._lock, translate_errors(self.path):
            self.connection.close()


def _open(path: Path) -> sqlite3.Connection:
    # any thread may use it: the store lets in one after the other
    connection = sqlite3.connect(path, timeout=0, isolation_level=None, check_same_thread=False)
    try:
        connection.execute("PRAGMA locking_mode = EXCLUSIVE")  # before anything else looks at the file
        _recognise(path, connection)
        # macOS flushes the drive only if asked
        for setting in ("journal_mode = WAL", "synchronous = FULL", "fullfsync = ON", "secure_delete = OFF"):
            connection.execute(f"PRAGMA {setting}")
        connection.execute("BEGIN EXCLUSIVE")
        if _is_empty(connection):
            for statement in _TABLES.split(";"):
                connection.execute(statement)
            connection.execute(f"PRAGMA application_id = {_APPLICATION}")
            connection.execute(f"PRAGMA user_version = {_FORMAT}")
        connection.execute("COMMIT")
    except BaseException:
        connection.close()
        raise
    return connection


def _recognise(path: Path, connection: sqlite3.Connection) -> None:
    """Refuse a database that is not ours before anything in it is changed."""
    if _is_empty(connection):
        return
    if _pragma(connection, "application_id") != _APPLICATION:
        problem = f"{printable(path)} is a database but no ledger; give another directory."
        raise ConfigurationError(ErrorCode.UNKNOWN_FORMAT, problem)
    if (found := _pragma(connection, "user_version")) != _FORMAT:
        raise ConfigurationError(
            ErrorCode.UNSUPPORTED,
            f"{printable(path)} was written by another version of jitterkit (ledger format {found}, not "
            f"{_FORMAT}); finish the run with that version, delete it, or give another directory.",
        )
    if (found := _pragma(connection, "quick_check")) != "ok":
        raise _damaged(path, found)


def _is_empty(connection: sqlite3.Connection) -> bool:
    return not connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]


def _pragma(connection: sqlite3.Connection, name: str) -> Any:
    return connection.execute(f"PRAGMA {name}").fetchone()[0]


@contextmanager
def translate_errors(path: Path) -> Iterator[None]:
    """Turn what the disk or the file does not allow into a sentence with its remedy.

    Raises
    ------
    ConfigurationError
    """
    try:
        yield
    except _ERRORS as error:
        if isinstance(error, sqlite3.ProgrammingError):
            raise  # ours to mend
        code, file, kind = _code(error), printable(path), ErrorCode.NOT_WRITABLE
        if code in _LOCKED:
            problem = f"Another run is writing to {printable(path.parent)}"
            remedy = "(if there is none, its disk cannot lock files); wait for it, or give another directory"
            raise ConfigurationError(ErrorCode.LOCKED, f"{problem} {remedy}.") from error
        if code == sqlite3.SQLITE_FULL:
            problem = f"{file} cannot grow ({error}); free some space and resume the run"
            raise ConfigurationError(kind, f"{problem}: its results so far are kept.") from error
        if code in _BROKEN:
            problem = f"{file} cannot be read or written ({error})"
            remedy = "look at its disk (space, quota, connection) and resume the run: what it did is kept"
            raise ConfigurationError(kind, f"{problem}; {remedy}.") from error
        raise (unwritable if code in _CLOSED else _damaged)(path, error) from error


def unwritable(path: Path, problem: object) -> ConfigurationError:
    """Return the error of a file that may only be read, or not even that."""
    message = f"{printable(path)} cannot be written ({problem}); give a directory that can"
    return ConfigurationError(ErrorCode.NOT_WRITABLE, f"{message}, or look at its permissions.")


def _damaged(path: Path, problem: object) -> ConfigurationError:
    what = " ".join(printable(problem).replace(r"\n", " ").split())
    message = f"{printable(path)} is damaged or no ledger ({what}); delete it and begin again"
    return ConfigurationError(ErrorCode.DAMAGED, f"{message}, or give another directory.")


def _code(error: BaseException | None) -> int:
    """Return SQLite's code, without the detail in its upper bytes; 0 if it has none."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF


_AT_ONCE = 64
"""Files counted between two writes: a flush of the disk costs as much as opening a file or more."""


class FileCounts:
    """The numbers of frames in the files of a run, as its ledger keeps them."""

    def __init__(self, file: StoreFile) -> None:
        self._file = file

    def check(
        self, files: Sequence[Path], count: Callable[[Path], int], size: int, done: Collection[int]
    ) -> None:
        """Look whether files are still those that were counted, before a run goes on.

        Parameters
        ----------
        files, count
            As for :meth:`frames`.
        size : int
            Frames in a batch.
        done : collection of int
            Numbers of the batches of which anything has been entered.

        Raises
        ------
        ConfigurationError
            As from :func:`~jitterkit.batch.resume.recounted`; what has changed without harm is counted
            again.
        """
        changed = recounted(files, self._counted(), count, size, done)
        with self._file.transaction() as execute:
            self._keep(execute, changed)

    def frames(self, files: Sequence[Path], count: Callable[[Path], int]) -> Iterator[int]:
        """Yield the number of frames in each file, each counted once in the life of a run.

        Parameters
        ----------
        files : sequence of Path
            The same, in the same order, whenever the run is resumed.
        count : callable
            Counts the frames of a file, :func:`~jitterkit.batch.plan.count_frames`.

        Yields
        ------
        frames : int
            A number is kept before it is yielded, with the size and time of the file.  So the plan of a run
            stays as it was, even if a file has since vanished, and no batch comes to mean other frames.
        """
        known = self._counted()
        yield from (one.frames for one in known)
        index, fresh = len(known), (counted(path, count) for path in files[len(known) :])
        while chunk := dict(enumerate(islice(fresh, _AT_ONCE), index)):
            with self._file.transaction() as execute:
                self._keep(execute, chunk)
            yield from (one.frames for one in chunk.values())
            index += len(chunk)

    def _counted(self) -> list[Counted]:
        found = self._file.read("SELECT frames, size, time FROM files ORDER BY position")
        return [Counted(frames, None if size is None else (size, time)) for frames, size, time in found]

    def _keep(self, execute: Callable, files: Mapping[int, Counted]) -> None:
        for position, one in files.items():
            values = (position, one.frames, *(one.stamp or (None, None)))
            execute("INSERT OR REPLACE INTO files VALUES (?, ?, ?, ?)", values)
