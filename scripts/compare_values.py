"""Read the outputs of two versions of jitterkit as plain columns, and keep them as small reference files.

:func:`read_output` returns the :class:`Values` of any file that a command wrote.  :func:`write_values` writes
them to a CSV file, rounded by :func:`rounded`, and :func:`read_values` reads that file.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from astropy.table import Table

NUMBERS = ("name",)
"""Keys of a table of single numbers: those of a JSON file, or of the metadata of an ECSV table."""

UNCOMPARED = frozenset({"digest", "path", "seconds", "iterations", "passes", "moved"})
"""Columns and numbers that may differ between two equally good versions."""

AS_TEXT = frozenset({"flags", "counted"})
"""Columns of whole numbers that are compared as text, because a flag has no error."""

SHARE_OF_ERROR = 1e-6
"""Precision of a value in a reference file, as a fraction of its standard error."""

DIGITS_OF_ERRORS, DIGITS = 7, 10
"""Significant digits of an error, and of a value without error.  A value from the moments of the blur, such
as ``jitter_major``, is compared in errors of those moments and needs more digits than an error."""


@dataclass(frozen=True)
class Values:
    """A table without units.

    Attributes
    ----------
    keys : tuple of str
        Columns that identify a row; their cells are text.
    columns : dict of str to array
        Arrays of float64 or of text, all of the same length.
    """

    keys: tuple[str, ...]
    columns: dict[str, np.ndarray]

    def rows(self) -> list[tuple[str, ...]]:
        """Return the key of each row, or its number if the table has no keys."""
        if not self.keys:
            length = len(next(iter(self.columns.values()), ()))
            return [(str(number),) for number in range(length)]
        return list(zip(*(self.columns[key].tolist() for key in self.keys), strict=True))


def read_output(path: Path, keys: tuple[str, ...]) -> Values:
    """Read an output of a command.

    Parameters
    ----------
    path : Path
        An ECSV table or a JSON file.
    keys : tuple of str
        Columns that identify a row.  :data:`NUMBERS` reads the numbers of a JSON file or a table's metadata.
    """
    if keys == NUMBERS:
        is_json = path.suffix == ".json"
        tree = json.loads(path.read_text()) if is_json else dict(Table.read(path, format="ascii.ecsv").meta)
        return numbers(tree)
    return from_table(Table.read(path, format="ascii.ecsv"), keys)


def from_table(table: Table, keys: tuple[str, ...]) -> Values:
    """Return the columns of a table that are compared.

    The candidates of a frame become ``evidences`` (``mvn:-8194.281 ellipse:-8262.506``); a message is kept
    only where the status is not ``ok``.

    Raises
    ------
    ValueError
        If a column that identifies the rows is missing.
    """
    missing = [key for key in keys if key not in table.colnames]
    if missing:
        raise ValueError(f"The table has no column {missing[0]!r}; it has {', '.join(table.colnames)}.")
    columns = {name: _plain(table[name], name, keys) for name in table.colnames if name not in UNCOMPARED}
    if "candidates" in columns:
        columns["evidences"] = np.array([evidences(text) for text in columns.pop("candidates")], dtype=str)
    if {"message", "status"} <= columns.keys():
        columns["message"] = np.where(columns["status"] == "ok", "", columns["message"])
    return Values(keys, columns)


def _plain(column: Any, name: str, keys: tuple[str, ...]) -> np.ndarray:
    filled = column.filled("") if getattr(column, "mask", None) is not None else column
    cells = np.asarray(getattr(filled, "value", filled))
    if name in keys or name in AS_TEXT or cells.dtype.kind not in "iuf":
        return np.array([f"{cell:g}" if isinstance(cell, float) else str(cell) for cell in cells.tolist()])
    return cells.astype(float)


def evidences(candidates: str) -> str:
    """Return the evidence of each candidate locus, the best first.

    >>> evidences('[{"locus": "mvn", "weight": 1.0, "evidence": -8194.281}]')
    'mvn:-8194.281'
    """
    tried = json.loads(candidates) if candidates else []
    return " ".join(f"{candidate['locus']}:{candidate.get('evidence')}" for candidate in tried)


def numbers(tree: dict[str, Any]) -> Values:
    """Return all numbers of nested records as a table of name, value and error (NaN if unknown).

    >>> numbers({"separation": {"mean": 9.1, "error": 0.2}}).columns["name"].tolist()
    ['separation.mean', 'separation.error']
    """
    rows = list(_leaves(tree))
    names, values, errors = zip(*rows, strict=True) if rows else ((), (), ())
    columns = {
        "name": np.array(names, dtype=str),
        "value": np.array(values, dtype=float),
        "error": np.array(errors, dtype=float),
    }
    return Values(NUMBERS, columns)


def _leaves(tree: Any, name: str = "", error: float = math.nan) -> Iterator[tuple[str, float, float]]:
    if isinstance(tree, dict):
        beside = tree.get("error")
        for key, item in tree.items():
            if key not in UNCOMPARED:
                known = beside if key in ("mean", "rate") and isinstance(beside, float) else math.nan
                yield from _leaves(item, f"{name}.{key}" if name else str(key), known)
    elif isinstance(tree, list | tuple):
        for number, item in enumerate(tree):
            yield from _leaves(item, f"{name}[{number}]")
    elif isinstance(tree, int | float) and not isinstance(tree, bool):
        yield name, float(tree), error


def write_values(path: Path, values: Values) -> None:
    """Write a table as CSV, with no more digits than a comparison needs."""
    errors = {name: error_column(name, values.columns) for name in values.columns}
    cells = [
        [str(cell) for cell in column]
        if column.dtype.kind == "U"
        else [
            rounded(value, error, DIGITS_OF_ERRORS if name == "error" or name.endswith("_err") else DIGITS)
            for value, error in zip(column, _or_nan(errors[name], column), strict=True)
        ]
        for name, column in values.columns.items()
    ]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(values.columns)
        writer.writerows(zip(*cells, strict=True))


def _or_nan(error: np.ndarray | None, column: np.ndarray) -> np.ndarray:
    return np.full(len(column), np.nan) if error is None else error


def error_column(name: str, columns: dict[str, np.ndarray]) -> np.ndarray | None:
    """Return the standard errors of a column, or None where the table has none."""
    beside = {"value": "error", "bias": "error", **dict.fromkeys(_ERRED_BY_SEPARATION, "separation_err")}
    return columns.get(beside.get(name, f"{name}_err"))


_ERRED_BY_SEPARATION = ("separation_crlb", "separation_spread")


def rounded(value: float, error: float, digits: int) -> str:
    """Return a number as text to a millionth of its error; without error, to ``digits`` digits.

    >>> rounded(9.1231404695718, 0.00058557, 7), rounded(0.000585576779, np.nan, 7), rounded(16368.0, 1, 7)
    ('9.1231404696', '0.0005855768', '16368')
    """
    if float(value).is_integer() and abs(value) < 1e15:
        return str(int(value))
    if value and np.isfinite(value) and np.isfinite(error) and error > 0:
        first = math.floor(math.log10(abs(value)))
        digits = math.ceil(first + 1 - math.log10(SHARE_OF_ERROR * error))
    return f"{value:.{min(max(digits, 1), 17)}g}"


def read_values(path: Path, keys: tuple[str, ...]) -> Values:
    """Read a table that :func:`write_values` wrote; a column is numeric if all of its cells are numbers."""
    with path.open(newline="", encoding="utf-8") as file:
        names, *rows = csv.reader(file)
    cells = zip(*rows, strict=True) if rows else [()] * len(names)
    columns = {
        name: _typed(column, as_text=name in keys or name in AS_TEXT)
        for name, column in zip(names, cells, strict=True)
    }
    return Values(keys, columns)


def _typed(cells: tuple[str, ...], as_text: bool) -> np.ndarray:
    if not as_text:
        try:
            return np.array([float(cell) for cell in cells])
        except ValueError:
            pass
    return np.array(cells, dtype=str)
