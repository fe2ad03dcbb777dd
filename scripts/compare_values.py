"""Read the outputs of two versions of jitterkit as plain columns, and keep them as small reference files.

:func:`read_output` is the way in: it gives a :class:`Values`, whatever file the command wrote.
:func:`write_values` and :func:`read_values` keep one in a CSV file, rounded by :func:`rounded`.
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
"""Columns of whole numbers that are compared as they are: a flag has no error."""

SHARE_OF_ERROR = 1e-6
"""Part of its standard error to which a value is kept in a reference file."""

SIGNIFICANT = 7
"""Digits of a value without an error, so that it is kept to a relative 5e-7 or better."""


@dataclass(frozen=True)
class Values:
    """A table without units.

    Attributes
    ----------
    keys : tuple of str
        Columns that name a row; their cells are text.
    columns : dict of str to array
        Each of float64 or of text, all of one length.
    """

    keys: tuple[str, ...]
    columns: dict[str, np.ndarray]

    def rows(self) -> list[tuple[str, ...]]:
        """Return the key of each row; without keys, its number."""
        if not self.keys:
            length = len(next(iter(self.columns.values()), ()))
            return [(str(number),) for number in range(length)]
        return list(zip(*(self.columns[key].tolist() for key in self.keys), strict=True))


def read_output(path: Path, keys: tuple[str, ...]) -> Values:
    """Read what a command wrote.

    Parameters
    ----------
    path : Path
        An ECSV table or a JSON file.
    keys : tuple of str
        Columns that name a row; :data:`NUMBERS` takes the numbers of a JSON file, or of a table's metadata.
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
    """
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
    """Return all numbers of nested records as a table of name, value and error (NaN: unknown).

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
        else [rounded(*pair) for pair in zip(column, _or_nan(errors[name], column), strict=True)]
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


def rounded(value: float, error: float) -> str:
    """Write a number to a millionth of its error; without one, to seven digits or as a whole number.

    >>> rounded(9.1231404695718, 0.00058557), rounded(0.000585576779, np.nan), rounded(16368.0, np.nan)
    ('9.1231404696', '0.0005855768', '16368')
    """
    if float(value).is_integer() and abs(value) < 1e15:
        return str(int(value))
    digits = SIGNIFICANT
    if value and np.isfinite(value) and np.isfinite(error) and error > 0:
        digits = 1 + math.ceil(math.log10(abs(value) / (SHARE_OF_ERROR * error)))
    return f"{value:.{min(max(digits, 1), 17)}g}"


def read_values(path: Path, keys: tuple[str, ...]) -> Values:
    """Read a table that :func:`write_values` wrote; a column is of numbers if all of its cells are."""
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
