"""The results table: one row a frame, units on the columns, whole on disk.

:func:`make_table` binds rows, :func:`write_table` writes ``results.ecsv`` and :func:`read_table` reads
it back to the last digit.  Any astropy can read the file without jitterkit.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
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
    values: dict[str, list[Any]] = {column.name: [] for column in COLUMNS}
    blanks = {column.name: column.blank for column in COLUMNS}
    for count, row in enumerate(rows):
        for name in row.keys() - values.keys():
            values[name] = [np.nan] * count
        for name, held in values.items():
            value = row.get(name)
            held.append(blanks.get(name, np.nan) if value is None else value)
    table = QTable(meta=_plain({**(meta or {}), "flags": flag_meanings()}))
    for column in _layout(aberration_names(values)):
        table[column.name] = np.array(values[column.name], dtype=column.kind)
        if column.unit:
            table[column.name] = table[column.name] << Unit(column.unit)
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
    with replacing(Path(path), overwrite) as temporary:
        table.write(temporary, format="ascii.ecsv")


def read_table(path: str | Path) -> QTable:
    """Read a table that :func:`write_table` wrote."""
    table = QTable.read(Path(path), format="ascii.ecsv")
    for name in table.colnames:
        if isinstance(table[name], MaskedColumn):  # astropy takes an empty text for a missing one
            table[name] = table[name].filled("")
    return table
