"""What can happen to a ledger's file, in sentences: locked, full, failing, read-only, damaged.

Reach for :func:`told`, which goes around whatever reads or writes.
"""

from __future__ import annotations

import json
import sqlite3
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.report.words import printable

__all__ = ["damaged", "is_locked", "told", "unwritable"]

_TROUBLES = (sqlite3.Error, zlib.error, UnicodeDecodeError, json.JSONDecodeError)
"""What a disk or a file can do; whatever has no sentence of its own below is damage."""

_LOCKED = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
_BROKEN = (sqlite3.SQLITE_IOERR, sqlite3.SQLITE_PROTOCOL, sqlite3.SQLITE_NOLFS)
_CLOSED = (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_PERM, sqlite3.SQLITE_AUTH)


@contextmanager
def told(path: Path) -> Iterator[None]:
    """Turn what the disk or the file does not allow into a sentence with its remedy.

    Raises
    ------
    ConfigurationError
    """
    try:
        yield
    except _TROUBLES as error:
        if (told_as := _sentence(path, error)) is error:
            raise
        raise told_as from error


def _sentence(path: Path, error: Exception) -> Exception:
    """The error as the user is told it, or itself if it is ours to mend."""
    code, file, directory = _code(error), printable(path), printable(path.parent)
    if code in _LOCKED:
        return ConfigurationError(
            ErrorCode.LOCKED,
            f"Another run is writing to {directory} (if there is none, its disk cannot lock files); wait "
            "for it, or give another directory.",
        )
    if code == sqlite3.SQLITE_FULL:
        return ConfigurationError(
            ErrorCode.NOT_WRITABLE,
            f"{file} cannot grow ({error}); make room and resume the run: what it did is kept.",
        )
    if code in _BROKEN:
        return ConfigurationError(
            ErrorCode.NOT_WRITABLE,
            f"{file} cannot be read or written ({error}); look at its disk (space, quota, connection) and "
            "resume the run: what it did is kept.",
        )
    if code in _CLOSED:
        return unwritable(path, error)
    return error if isinstance(error, sqlite3.ProgrammingError) else damaged(path, error)


def unwritable(path: Path, problem: object) -> ConfigurationError:
    """A file that may only be read, or not even that."""
    return ConfigurationError(
        ErrorCode.NOT_WRITABLE,
        f"{printable(path)} cannot be written ({problem}); give a directory that can, or look at its "
        "permissions.",
    )


def damaged(path: Path, problem: object) -> ConfigurationError:
    """A file whose content makes no sense."""
    what = " ".join(printable(problem).replace(r"\n", " ").split())
    return ConfigurationError(
        ErrorCode.DAMAGED,
        f"{printable(path)} is damaged or no ledger ({what}); delete it and begin again, or give another "
        "directory.",
    )


def is_locked(error: BaseException | None) -> bool:
    """Whether a trouble is no more than another process that has the file open."""
    return _code(error) in _LOCKED


def _code(error: BaseException | None) -> int:
    """SQLite's code, without the detail in its upper bytes; 0 if it has none."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF
