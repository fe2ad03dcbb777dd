"""Tables of numbers in CSV, line by line, so that a complaint can name the line and the column."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from astropy.units import Unit

from jitterkit.errors import ConfigurationError, ErrorCode, reading_code

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
        problem = f"{path}: cannot be read ({error}); {remedy}."
        raise ConfigurationError(reading_code(error), problem) from None
    return [(n, [cell.strip() for cell in next(csv.reader([line]))]) for n, line in lines]


def heading(cell: str) -> tuple[str, str]:
    """Take a cell of a header apart: the name in lower case, and the unit behind it; empty without one.

    >>> heading("X [mas]"), heading("t (s)"), heading("xy")
    (('x', 'mas'), ('t', 's'), ('xy', ''))
    """
    found = re.fullmatch(r"([^\[(]+?)\s*[\[(](.*)[\])]", cell.strip())
    name, unit = found.groups() if found else (cell, "")
    return name.strip().lower(), unit.strip()


_IN_PROSE = re.compile(
    r"(?<![\w/])((?P<time>ms|milliseconds?|[uµ]s|minutes?|hours?|kHz)"
    r"|mas|milli-?arcsec\w*|[uµ]as|deg(rees?)?|[mµu]?rad(ians?)?|pix(els?)?|√|sqrt|rt ?Hz|dB|log(10)?"
    r"|(?P<kind>(?i:asd|amplitude spectral|rms|peak[- ]to[- ]peak|p-?p|cumulative)))(?!\w)"
)
"""Units, of time and others, and kinds of amplitude, that are not those of columns without a unit."""


def refuse_unit_in_comment(path: Path, header: Sequence[str]) -> None:
    """Raise ConfigurationError where a comment names a unit of columns that have none.

    A kind of amplitude is no unit: one that a comment names is refused of lines whatever their unit.
    """
    names, units = zip(*map(heading, header), strict=True) if header else ((), ())
    with path.open(encoding="utf-8-sig") as handle:
        comments = [
            (n, found)
            for n, line in enumerate(handle, 1)
            if line[0] == "#"
            for found in _IN_PROSE.finditer(line)
            if not any(units[:1] if found["time"] else units[1:]) or (found["kind"] and "amplitude" in names)
        ]
    if not comments:
        return
    number, found = comments[0]
    said = f"the comment in line {number} says {found[0]!r}"
    if found["kind"] and "amplitude" in names:
        problem = (
            f"{said}, and amplitudes of lines are from zero to peak; convert them, and leave the word out"
        )
        raise ConfigurationError(ErrorCode.CONFLICT, f"{problem}.")
    example = f"{header[0]} [ms]" if found["time"] else f"{header[1]} [mas]"
    remedy = f"write one behind each name, as in {example}, or leave the word out"
    raise ConfigurationError(ErrorCode.CONFLICT, f"{said}, and the columns have no unit; {remedy}.")


def refuse_half_stated(names: Sequence[str], units: Sequence[str]) -> None:
    """Raise ConfigurationError where some columns of one quantity have a unit and others none."""
    if any(units) and not all(units):
        problem = f"of the columns {', '.join(names)} only some have a unit"
        raise ConfigurationError(ErrorCode.CONFLICT, f"{problem}; write it behind each of them.")


def unit_factor(column: str, unit: str, *wanted: str) -> tuple[float, str]:
    """Find what a unit is, and the factor to it.

    Parameters
    ----------
    column : str
        Name, for a complaint.
    unit : str
        As written; ``²`` and ``√Hz`` too.
    *wanted : str
        Units of different dimensions.

    Returns
    -------
    factor : float
    wanted : str
        The one of its dimension.

    Raises
    ------
    ConfigurationError
        If it is no unit, or has none of the dimensions.
    """
    text = re.sub(r"(√|(?<!sq)rt ?)\(?Hz\)?", "sqrt(Hz)", unit.replace("²", "2"))
    for one in wanted:
        try:
            return float(Unit(text).to(one)), one
        except (ValueError, TypeError):  # a wrong dimension is a TypeError too
            continue
    problem = f"The unit {unit!r} of the column {column} is not one of {', '.join(wanted)}"
    raise ConfigurationError(ErrorCode.UNKNOWN_UNIT, f"{problem}; give one that can be converted to it.")


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
    number, cells = row
    if len(cells) != len(header):
        problem = f"line {number} has {len(cells)} columns; give {','.join(header)}."
        raise ConfigurationError(ErrorCode.MALFORMED, problem)
    values: list[float] = []
    for name, cell in zip(header, cells, strict=True):
        code = ErrorCode.OUT_OF_RANGE
        try:
            value = float(cell)
        except ValueError:
            value, code = np.nan, ErrorCode.MALFORMED
        if not np.isfinite(value) and not (values and cell.lower() in missing):
            raise ConfigurationError(code, f"line {number}, column {name} is {cell!r}; give a finite number.")
        values.append(value)
    return values
