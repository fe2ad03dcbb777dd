"""The SQLite file under a ledger, open to one process at a time.

Reach for :class:`LedgerFile`: it reads, and writes all of a block or nothing.  Its lock is SQLite's own and
ends with the process that holds it, however that ends.
"""

from __future__ import annotations

import os
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from jitterkit.batch.ledger_trouble import damaged, is_locked, told, unwritable
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.report.words import printable

__all__ = ["LedgerFile"]

_APPLICATION = 0x4A544B4C
"""Marks the file as ours in its header: JTKL."""

_FORMAT = 2
"""Of the tables below; to be raised when they change."""

_TABLES = """
    CREATE TABLE run (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
    CREATE TABLE files (position INTEGER PRIMARY KEY, frames INTEGER NOT NULL, size INTEGER, time INTEGER);
    CREATE TABLE batches (batch INTEGER PRIMARY KEY, rows BLOB NOT NULL);
    CREATE TABLE frames (
        batch INTEGER, place INTEGER, file TEXT, frame INTEGER, status TEXT, locus TEXT,
        separation REAL, separation_err REAL, chi2_dof REAL, PRIMARY KEY (batch, place)
    ) WITHOUT ROWID;
    CREATE TABLE pictures (
        batch INTEGER, place INTEGER, usable INTEGER, misfit REAL, name TEXT, alt TEXT, picture BLOB,
        PRIMARY KEY (batch, place)
    );
"""

_WAITS = (0.05, 0.1, 0.2, 0.4)
"""Seconds between attempts to get the lock: a process that is just ending may hold it, or one that
looks and is about to be refused."""


class LedgerFile:
    """A ledger's tables, made if need be; what is committed survives the loss of power.

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
        self.path, self._lock = path, threading.RLock()
        self.connection = _open_patiently(path)

    def read(self, query: str, values: Sequence[Any] = ()) -> list[tuple]:
        """All that a query finds."""
        with self._lock, told(self.path):
            return self.connection.execute(query, values).fetchall()

    @contextmanager
    def transaction(self) -> Iterator[Callable[..., sqlite3.Cursor]]:
        """All that the block executes, or nothing; other threads wait."""
        with self._lock, told(self.path):
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
        with self._lock, told(self.path):
            self.connection.close()


def _open_patiently(path: Path) -> sqlite3.Connection:
    waits = iter(_WAITS)
    while True:
        try:
            with told(path):
                return _open(path)
        except ConfigurationError as error:
            wait = next(waits, None)
            if wait is None or not is_locked(error.__cause__):
                raise
            time.sleep(wait)


def _open(path: Path) -> sqlite3.Connection:
    # any thread may use it: the ledger lets in one after the other
    connection = sqlite3.connect(path, timeout=0, isolation_level=None, check_same_thread=False)
    try:
        connection.execute("PRAGMA locking_mode = EXCLUSIVE")  # before anything else looks at the file
        _recognise(path, connection)
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = FULL")
        connection.execute("PRAGMA fullfsync = ON")  # macOS flushes the drive only if asked
        connection.execute("PRAGMA secure_delete = OFF")
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
        raise ConfigurationError(
            ErrorCode.UNKNOWN_FORMAT,
            f"{printable(path)} is a database but no ledger; give another directory.",
        )
    if (found := _pragma(connection, "user_version")) != _FORMAT:
        raise ConfigurationError(
            ErrorCode.UNSUPPORTED,
            f"{printable(path)} was written by another version of jitterkit (ledger format {found}, not "
            f"{_FORMAT}); finish the run with that version, delete it, or give another directory.",
        )
    if (found := _pragma(connection, "quick_check")) != "ok":
        raise damaged(path, found)


def _is_empty(connection: sqlite3.Connection) -> bool:
    return not connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]


def _pragma(connection: sqlite3.Connection, name: str) -> Any:
    return connection.execute(f"PRAGMA {name}").fetchone()[0]
