"""The results table: one row a frame, units on the columns, whole on disk.

:func:`make_table` binds rows, :func:`write_table` writes ``results.ecsv`` and :func:`read_table` reads
it back to the last digit.  Any astropy can read the file without jitterkit.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from astropy.table import MaskedColumn, QTable
from astropy.units import Unit

from jitterkit.frames.whole import replacing
from jitterkit.report.columns import COLUMNS, Column, aberration_columns
from jitterkit.report.flags import flag_meanings
from jitterkit.report.row import Row
from jitterkit.report.words import printable

__all__ = ["aberration_names", "make_table", "read_table", "write_table"]


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
    table = QTable(meta=_plain({**(meta or {}), "flags": flag_meanings()}))
    for column in _layout(aberration_names(list(values))):
        cells: Any = np.array(values.pop(column.name), dtype=column.kind)
        table.add_column(cells << Unit(column.unit) if column.unit else cells, name=column.name, copy=False)
        table[column.name].info.description = column.description
    return table


def _plain(value: Any) -> Any:
    """Metadata as YAML knows it, whatever the caller had."""
    if isinstance(value, Mapping):
        return {key if isinstance(key, int) else printable(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value if value is None or isinstance(value, bool | int | float) else printable(value)


def _layout(aberrations: Iterable[str]) -> list[Column]:
    """All columns in order: the aberrations follow the jitter."""
    place = next(n for n, column in enumerate(COLUMNS) if column.name == "background")
    extra = [column for name in aberrations for column in aberration_columns(name)]
    return [*COLUMNS[:place], *extra, *COLUMNS[place:]]


def aberration_names(columns: Iterable[str]) -> list[str]:
    """Which of a table's (or a row's) columns are aberrations, in natural order.

    >>> aberration_names(["flux", "noll10", "noll10_err", "noll4", "noll4_err"])
    ['noll4', 'noll10']
    """
    known = {column.name for column in COLUMNS}
    names = [name for name in columns if name not in known]
    return sorted((name for name in names if f"{name}_err" in names), key=_natural)


def _natural(name: str) -> tuple[str, int, str]:
    stem = name.rstrip("0123456789")
    return stem, int(name[len(stem) :] or -1), name


def write_table(path: str | Path, table: QTable, *, overwrite: bool = False) -> None:
    """Write a table as ECSV, whole or not at all.

    Raises
    ------
    FrameError
        If the file exists and may not be overwritten, or cannot be written.
    """
    with (
        replacing(Path(path), overwrite) as temporary,
        temporary.open("w", encoding="utf-8", newline="\n") as file,
    ):
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
    """A row whose first cell does not pass for a comment: a file may be called ``#1.fits``.

    >>> _quoted("#1.fits 0 ok"), _quoted("1.fits 0 ok")
    ('"#1.fits" 0 ok', '1.fits 0 ok')
    """
    first, space, rest = line.partition(" ")
    return f'"{first}"{space}{rest}' if line.startswith("#") else line


def read_table(path: str | Path) -> QTable:
    """Read a table that :func:`write_table` wrote."""
    table = QTable.read(Path(path), format="ascii.ecsv")
    for name in table.colnames:
        if isinstance(table[name], MaskedColumn):  # astropy takes an empty text for a missing one
            table[name] = table[name].filled("")
    return table
