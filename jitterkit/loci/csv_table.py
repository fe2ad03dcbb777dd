"""Tables of numbers in CSV, line by line, so that a complaint can name the line and the column.

Reach for :func:`csv_rows`; the units of its columns are in :mod:`jitterkit.loci.csv_units`, and those that
comments name in :mod:`jitterkit.loci.csv_comments`.
"""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode, reading_code

CsvRow = tuple[int, list[str]]
"""Number of the line in the file, and its cells."""

_COMMENT = ("#", "%")
"""First letters of a line that is a comment; MATLAB writes the second."""

_EXCEL = re.compile(r"sep=.\s*")
"""A line by which spreadsheets are told the separator."""

_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


CsvLine = tuple[int, str]
"""Number of the line in the file, and its text."""


def _lines(path: Path) -> list[CsvLine]:
    """Return the lines of a text in UTF-8, else in UTF-16 with its mark, else in the code page of Windows."""
    content = path.read_bytes()
    if content.startswith(_UTF16):
        text = content.decode("utf-16")
    else:
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError:
            if b"\0" in content:  # no text at all
                raise
            text = content.decode("cp1252")
    return list(enumerate(io.StringIO(text, newline=None), 1))


def comment_lines(path: Path) -> list[CsvLine]:
    """Return the comments of a file that can be read."""
    return [(n, line) for n, line in _lines(path) if line.startswith(_COMMENT)]


def csv_rows(path: Path, remedy: str) -> list[CsvRow]:
    """Read the lines of a table; empty ones and those that begin with ``#`` or ``%`` are skipped.

    Cells are separated by what separates those of the first line: a comma, else a semicolon, a tab or spaces.
    A comment whose cells are the names of columns, straight above a line of as many numbers, is a header, as
    ``numpy.savetxt`` writes it.  Decimal commas become points where they cannot separate thousands.

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
        return _with_points(_split(_lines(path)))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        problem = f"{path}: cannot be read ({error}); {remedy}."
        raise ConfigurationError(reading_code(error), problem) from None


def _split(lines: list[CsvLine]) -> list[CsvRow]:
    rows: list[CsvRow] = []
    separator, comment = "", (0, "")
    for n, line in lines:
        if not line.strip() or _EXCEL.fullmatch(line):
            continue
        if line.startswith(_COMMENT):
            comment = (n, line.strip("".join(_COMMENT) + " \n"))
            continue
        if comment[1] and _heads(comment[1], line):
            separator = _separator(comment[1])
            rows.append((comment[0], _cells(comment[1], separator)))
        separator, comment = separator or _separator(line), (0, "")
        rows.append((n, _cells(line, separator)))
    if rows and rows[0][1][-1] == "":  # every line ends with a separator
        return [(n, cells[:-1] if cells[-1] == "" else cells) for n, cells in rows]
    return rows


def _separator(header: str) -> str:
    """Return what separates the cells of a header, units in brackets apart."""
    bare = re.sub(r"\[.*?\]|\(.*?\)", "", header).strip()
    return next((mark for mark in ",;\t " if mark in bare), ",")


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":  # any number of spaces, but those before and within the brackets of a unit
        return re.split(r"\s+(?![\[(]|[^\[(]*[\])])", line.strip())
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]


def _heads(comment: str, line: str) -> bool:
    """Return whether a comment is the header of the numbers below it."""
    separator = _separator(comment)
    names, below = _cells(comment, separator), _cells(line, separator)
    if len(names) != len(below) or not all(_NAME.fullmatch(heading(cell)[0]) for cell in names):
        return False
    return len(names) > 1 and all(np.isfinite(number(cell.replace(",", "."))) for cell in below[1:])


def _with_points(rows: list[CsvRow]) -> list[CsvRow]:
    """Return rows whose numbers have decimal points, if their commas can be nothing else.

    They are left where a number has a point too, and where each comma has three digits behind it.
    """
    commas = {cell for _, cells in rows for cell in cells if "," in cell and _WITH_MARKS.fullmatch(cell)}
    if not commas or all(map(_THOUSANDS.fullmatch, commas)):
        return rows
    if any("." in cell and _WITH_MARKS.fullmatch(cell) for _, cells in rows for cell in cells):
        return rows
    return [(n, [cell.replace(",", ".") if cell in commas else cell for cell in cells]) for n, cells in rows]


_WITH_MARKS = re.compile(r"[-+\u2212]?[\d.,]*\d[\d.,]*([ed][-+]?\d+)?", re.IGNORECASE)
_THOUSANDS = re.compile(r"[-+\u2212]?[1-9]\d{0,2}(,\d{3})+")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([ed][-+]?\d+)?", re.IGNORECASE)
_NAME = re.compile(r"(t|time|f|freq|frequency|w?[xy]|xy|[ap]sd_?[xy]|[xy]_[ap]sd|amplitude|angle|minor)")
"""Names of columns of the tables of motion."""

_BARE = re.compile(rf"{_NAME.pattern}(?:\s*[/,]\s*|_(?![ap]sd$))(\S.*)", re.IGNORECASE)
"""A name and a unit without brackets: ``x/mas``, ``x_mas``, and ``x, mas`` in quotes."""


def number(cell: str) -> float:
    """Return the number in a cell, NaN of none; Fortran's ``1D-3`` is one, Python's ``1_0`` is not."""
    try:
        return float("" if "_" in cell else cell)
    except ValueError:
        text = cell.replace("\u2212", "-").lower()
        return float(text.replace("d", "e")) if _NUMBER.fullmatch(text) else np.nan


def heading(cell: str) -> tuple[str, str]:
    """Take a cell of a header apart: the name in lower case, and the unit behind it; empty without one.

    >>> heading("X [mas]"), heading("t (s)"), heading("xy"), heading("x/mas"), heading("t_ms")
    (('x', 'mas'), ('t', 's'), ('xy', ''), ('x', 'mas'), ('t', 'ms'))
    """
    found = re.fullmatch(r"([^\[(]+?)\s*[\[(](.*)[\])]", cell.strip()) or _BARE.fullmatch(cell.strip())
    name, unit = found.groups() if found else (cell, "")
    return name.strip().lower(), unit.strip()


def row_numbers(row: CsvRow, header: Sequence[str], missing: Sequence[str] = ()) -> list[float]:
    """Return the numbers of a line, one for each column of the header.

    Parameters
    ----------
    row : CsvRow
    header : sequence of str
    missing : sequence of str
        Cells, in lower case, that are NaN behind the first column.

    Raises
    ------
    ConfigurationError
        If there are more or fewer, or one is not finite.
    """
    line, cells = row
    if len(cells) != len(header):
        problem = f"line {line} has {len(cells)} columns; give {','.join(header)}."
        raise ConfigurationError(ErrorCode.MALFORMED, problem)
    values: list[float] = []
    for name, cell in zip(header, cells, strict=True):
        value = number(cell)
        if not np.isfinite(value) and not (values and cell.lower() in missing):
            written = re.search(r"nan|inf|^[-+]?\d*\.?\d*e\d+$", cell.lower())
            code = ErrorCode.OUT_OF_RANGE if written else ErrorCode.MALFORMED
            remedy = " with a decimal point" if "," in cell else ""
            problem = f"line {line}, column {name} is {cell[:80]!r}"
            raise ConfigurationError(code, f"{problem}; give a finite number{remedy}.")
        values.append(value)
    return values
