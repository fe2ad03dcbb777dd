"""Where results go, looked at before any work is done and without loading anything.

Reach for :func:`check_directory`, which only looks; :func:`make_directory` looks and makes.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path

from jitterkit.errors import ConfigurationError, ErrorCode

RUN = "results.ecsv", "summary.json", "report.html", "configuration.json", "stars.ecsv", "further_stars.ecsv"
"""What a run leaves behind: its settings and versions before the stars of frames that show more than two, and
those that all frames of a pair show together."""

TABLE, SUMMARY, REPORT, CONFIGURATION, STARS, FURTHER_STARS = RUN

ENDS = (".png", ".kernel.fits", ".deblurred.fits")
"""Of the names of an estimate's picture, kernel and deblurred image."""


TABLES = (".ecsv", ".csv", ".fits", ".parquet", ".json")
"""Endings of the names of tables, each of which gives another format."""


def check_directory(directory: Path, patterns: Iterable[str], overwrite: bool) -> None:
    """Refuse a directory that cannot be written, or that holds what would be replaced.

    Parameters
    ----------
    directory : Path
        May be yet to be made.
    patterns : iterable of str
        Of the files' names.
    overwrite : bool
        Whether they may be replaced.

    Raises
    ------
    ConfigurationError
    """
    present = [path for pattern in patterns for path in sorted(directory.glob(pattern))]
    if present and not overwrite:
        problem = f"{present[0]} exists; give --overwrite to replace it, or another directory."
        raise ConfigurationError(ErrorCode.EXISTS, problem)
    nearest = next(path for path in (directory, *directory.absolute().parents) if path.exists())
    if not nearest.is_dir():
        raise _unwritable(directory, f"{nearest} is no directory")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise _unwritable(directory, f"{nearest} is read-only")


def make_directory(directory: Path, patterns: Iterable[str], overwrite: bool) -> None:
    """Make a directory, parents and all, once :func:`check_directory` has nothing against it.

    Raises
    ------
    ConfigurationError
        If it does, or the directory cannot be written all the same.
    """
    check_directory(directory, patterns, overwrite)
    try:
        directory.mkdir(parents=True, exist_ok=True)
        probe = directory / ".jitterkit-probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise _unwritable(directory, error.strerror or str(error)) from None


def check_file(path: Path, overwrite: bool, ending: str = "") -> None:
    """Refuse a file that exists and may not be replaced, or whose directory does not; or another ending.

    Raises
    ------
    ConfigurationError
    """
    if not path.name.lower().endswith(ending):
        raise ConfigurationError(ErrorCode.WRONG_SUFFIX, f"{path} does not end in {ending}; name it so.")
    if not path.parent.is_dir():
        code = ErrorCode.NOT_WRITABLE if path.parent.exists() else ErrorCode.NOT_FOUND
        problem = f"{path.parent} is not a directory; make it, or write {path.name} elsewhere."
        raise ConfigurationError(code, problem)
    if path.exists() and not overwrite:
        problem = f"{path} exists; give --overwrite to replace it, or another name."
        raise ConfigurationError(ErrorCode.EXISTS, problem)


def check_table(path: Path, overwrite: bool) -> None:
    """Refuse a table that cannot be written under its name.

    Raises
    ------
    ConfigurationError
        As from :func:`check_file` and :func:`table_ending`.
    """
    table_ending(path)
    check_file(path, overwrite)


def table_ending(path: Path) -> str:
    """Return the ending of a table's name, which gives its format: one of :data:`TABLES`.

    Raises
    ------
    ConfigurationError
        If the ending is another one, or its format needs a package that is not installed.
    """
    ending = path.suffix.lower()
    if ending not in TABLES:
        problem = f"{path} is no name of a table; it must end in {', '.join(TABLES)}."
        raise ConfigurationError(ErrorCode.WRONG_SUFFIX, problem)
    if ending == ".parquet" and find_spec("pyarrow") is None:
        remedy = 'run: pip install "jitterkit[parquet]", or choose another ending'
        problem = f"{path} needs pyarrow, which is not installed; {remedy}."
        raise ConfigurationError(ErrorCode.MISSING_PACKAGE, problem)
    return ending


def _unwritable(directory: Path, problem: str) -> ConfigurationError:
    message = f"{directory} cannot be written ({problem}); give a directory that can."
    return ConfigurationError(ErrorCode.NOT_WRITABLE, message)
