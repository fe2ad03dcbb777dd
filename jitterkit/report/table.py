"""The results table: one row a frame, units on the columns, whole on disk.

:func:`make_table` binds rows, :func:`star_table` lists the stars of frames that show more than a pair,
:func:`write_table` writes any table in the format of its file's ending, and
:func:`read_table` reads ECSV back to the last digit.  Any astropy can read the file without jitterkit.
"""

from __future__ import annotations

import json
import warnings
from array import array
from collections.abc import Callable, Iterable, Mapping
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from astropy.table import MaskedColumn, QTable
from astropy.utils.exceptions import AstropyUserWarning

from jitterkit.errors import printable
from jitterkit.frames.writer import replacing
from jitterkit.report.columns import COLUMNS, Column, aberration_columns, bind, bind_rows, measured, named
from jitterkit.report.flags import flag_meanings
from jitterkit.report.outputs import table_ending
from jitterkit.report.row import Row

_KINDS: dict[type, Any] = {float: lambda: array("d"), int: lambda: array("q"), str: list}
"""What holds a column while rows come in: a number in 8 bytes, not in the 32 that a list of them takes."""

_CHUNK = 5000
"""Rows that are written at once: astropy makes a text of every cell first, 160 MB of 60,000 rows."""


def make_table(rows: Iterable[Row], meta: Mapping[str, Any] | None = None) -> QTable:
    """Bind rows into a table.

    Parameters
    ----------
    rows : iterable of dict
        From :func:`~jitterkit.report.row.make_row`; consumed one by one.  A key that is no column
        is an aberration in nm, and may be missing from other rows.  None (a ledger's null) stands
        for what is not known.
    meta : mapping, optional
        What to keep with the table (versions, instrument, command line), nested as you like.

    Returns
    -------
    table : QTable
        Columns with units and descriptions; ``meta["flags"]`` explains the flags.  Without rows it
        has the columns all the same.
    """
    values: dict[str, Any] = {column.name: _KINDS[column.kind]() for column in COLUMNS}
    blanks = {column.name: column.blank for column in COLUMNS}
    for count, row in enumerate(rows):
        for name in row.keys() - values.keys():
            values[name] = array("d", [np.nan]) * count
        for name, held in values.items():
            value = row.get(name)
            held.append(blanks.get(name, np.nan) if value is None else value)
    columns = _layout(aberration_names(list(values)))
    described = _plain({**(meta or {}), "flags": flag_meanings()})
    return bind(((column, values.pop(column.name)) for column in columns), described)


def _plain(value: Any) -> Any:
    """Metadata as YAML knows it, whatever the caller had."""
    if isinstance(value, Mapping):
        return {key if isinstance(key, int) else printable(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value if value is None or isinstance(value, bool | int | float) else printable(value)


def _layout(aberrations: Iterable[str]) -> list[Column]:
    """Return all columns in order: the aberrations follow the jitter."""
    index = next(n for n, column in enumerate(COLUMNS) if column.name == "background")
    extra = [column for name in aberrations for column in aberration_columns(name)]
    return [*COLUMNS[:index], *extra, *COLUMNS[index:]]


def aberration_names(columns: Iterable[str]) -> list[str]:
    """Return which of a table's (or a row's) columns are aberrations, in natural order.

    >>> aberration_names(["flux", "noll10", "noll10_err", "noll4", "noll4_err"])
    ['noll4', 'noll10']
    """
    known = {column.name for column in COLUMNS}
    names = [name for name in columns if name not in known]
    return sorted((name for name in names if f"{name}_err" in names), key=_natural)


def _natural(name: str) -> tuple[str, int, str]:
    stem = name.rstrip("0123456789")
    return stem, int(name[len(stem) :] or -1), name


_STARS = (
    *named("file", "frame"),
    Column("star", "from 1; A and B of a pair are 1 and 2", kind=int),
    *measured("x", "offset from the frame's centre", "arcsec"),
    *measured("y", "offset from the frame's centre", "arcsec"),
    *measured("flux", "electrons per frame, inside the frame or not", "electron"),
)


def star_table(results: QTable) -> QTable | None:
    """List the stars of all frames of a results table that show more than a pair.

    Parameters
    ----------
    results : QTable
        As :func:`make_table` binds it.

    Returns
    -------
    stars : QTable or None
        None if no frame does.  Columns ``file``, ``frame``, ``star`` (from 1; A and B of a pair are 1 and
        2), ``x``, ``y`` [arcsec] and ``flux`` [electron] with their errors.
    """
    rows = [
        (str(row["file"]), int(row["frame"]), number, *(np.nan if v is None else v for v in star))
        for row in results
        if row["stars"]
        for number, star in enumerate(json.loads(row["stars"]), 1)
    ]
    return bind_rows(_STARS, rows) if rows else None


def write_table(path: str | Path, table: QTable, *, overwrite: bool = False) -> None:
    """Write a table, whole or not at all, in the format of its file's ending.

    Parameters
    ----------
    path : str or Path
        ``.ecsv``, ``.fits`` and ``.parquet`` keep units, descriptions and metadata; FITS has the metadata in
        comments, as JSON, and text that is not ASCII with escapes.  ``.json`` has an object with ``meta``,
        ``units`` and ``rows``, in which NaN is null.  ``.csv`` is a line of names and one for each row.
    table : QTable
    overwrite : bool
        Whether a file of that name may be replaced.

    Raises
    ------
    ConfigurationError
        If the ending is another one, or its format needs a package that is not installed.
    FrameError
        If the file exists and may not be overwritten, or cannot be written.
    """
    path = Path(path)
    write = _WRITERS[table_ending(path)]
    with replacing(path, overwrite) as temporary:
        write(temporary, table)


def _write_ecsv(path: Path, table: QTable) -> None:
    with path.open("w", encoding="utf-8", newline="\n") as file:
        head = _ecsv(table[:0])
        file.writelines(head)
        for start in range(0, len(table), _CHUNK):
            file.writelines(map(_quoted, _ecsv(table[start : start + _CHUNK])[len(head) :]))


def _ecsv(table: QTable) -> list[str]:
    """Lines of a table, heading and all."""
    text = StringIO()
    table.write(text, format="ascii.ecsv")
    text.seek(0)
    return text.readlines()


def _quoted(line: str) -> str:
    """Return a row whose first cell does not pass for a comment: a file may be called ``#1.fits``.

    >>> _quoted("#1.fits 0 ok"), _quoted("1.fits 0 ok")
    ('"#1.fits" 0 ok', '1.fits 0 ok')
    """
    first, space, rest = line.partition(" ")
    return f'"{first}"{space}{rest}' if line.startswith("#") else line


def _write_csv(path: Path, table: QTable) -> None:
    bare = table.copy()
    for name in bare.colnames:
        bare[name].info.format = None  # all digits
    with path.open("w", encoding="utf-8", newline="\n") as file:
        bare.write(file, format="ascii.csv", strip_whitespace=False)


def _write_fits(path: Path, table: QTable) -> None:
    ascii_only = table.copy()
    for name in table.colnames:
        if table[name].dtype.kind == "U":
            escaped = np.char.encode(table[name], "ascii", "backslashreplace")
            ascii_only[name] = np.char.decode(escaped, "ascii")
        description = (table[name].info.description or "").encode("ascii", "backslashreplace")
        ascii_only[name].info.description = description.decode()
    plain = {str(key): value for key, value in _plain(table.meta).items()}
    ascii_only.meta = {"comments": [json.dumps({key: value}) for key, value in plain.items()]}
    with warnings.catch_warnings():  # of electron, which FITS does not know and astropy keeps in comments
        warnings.simplefilter("ignore", AstropyUserWarning)
        ascii_only.write(path, format="fits")


def _write_json(path: Path, table: QTable) -> None:
    columns = {name: getattr(table[name], "value", table[name]) for name in table.colnames}
    cells = zip(*map(_cells, columns.values()), strict=True)
    rows = [dict(zip(columns, row, strict=True)) for row in cells]
    units = {name: str(table[name].unit) for name in columns if getattr(table[name], "unit", None)}
    whole = {"meta": _plain(table.meta), "units": units, "rows": rows}
    path.write_text(json.dumps(whole, indent=1, ensure_ascii=False) + "\n", encoding="utf-8", newline="\n")


def _cells(values: np.ndarray) -> list:
    """Cells of a column as JSON knows them."""
    cells = np.asarray(values).tolist()
    return [None if isinstance(cell, float) and not np.isfinite(cell) else cell for cell in cells]


_WRITERS: dict[str, Callable[[Path, QTable], None]] = {
    ".ecsv": _write_ecsv,
    ".csv": _write_csv,
    ".fits": _write_fits,
    ".parquet": lambda path, table: table.write(path, format="parquet"),
    ".json": _write_json,
}


def read_table(path: str | Path) -> QTable:
    """Read a table that :func:`write_table` wrote."""
    table = QTable.read(Path(path), format="ascii.ecsv")
    for name in table.colnames:
        if isinstance(table[name], MaskedColumn):  # astropy takes an empty text for a missing one
            table[name] = table[name].filled("")
    return table
