"""Tables of numbers in CSV, line by line, so that a complaint can name the line and the column."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode, reading_code

__all__ = ["CsvRow", "csv_rows", "row_numbers"]

CsvRow = tuple[int, list[str]]
"""Number of the line in the file, and its cells."""


def csv_rows(path: Path, remedy: str) -> list[CsvRow]:
    """Read the lines of a table; empty ones and those that begin with ``#`` are skipped.

    Parameters
    ----------
    path : Path
    remedy : str
        What to give instead of a file that cannot be read.

    Raises
    ------
    ConfigurationError
        If the file does not exist, cannot be opened, or is not text.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as handle:
            lines = [(n, line) for n, line in enumerate(handle, 1) if line.strip() and line[0] != "#"]
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(
            reading_code(error), f"{path}: cannot be read ({error}); {remedy}."
        ) from None
    return [(n, [cell.strip() for cell in next(csv.reader([line]))]) for n, line in lines]


def row_numbers(row: CsvRow, header: Sequence[str]) -> list[float]:
    """The numbers of a line, one for each column of the header.

    Raises
    ------
    ConfigurationError
        If there are more or fewer, or one is not finite.
    """
    number, cells = row
    if len(cells) != len(header):
        raise ConfigurationError(
            ErrorCode.MALFORMED, f"line {number} has {len(cells)} columns; give {','.join(header)}."
        )
    values = []
    for name, cell in zip(header, cells, strict=True):
        code = ErrorCode.OUT_OF_RANGE
        try:
            value = float(cell)
        except ValueError:
            value, code = np.nan, ErrorCode.MALFORMED
        if not np.isfinite(value):
            raise ConfigurationError(code, f"line {number}, column {name} is {cell!r}; give a finite number.")
        values.append(value)
    return values
