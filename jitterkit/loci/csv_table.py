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

    Cells are separated by what separates those of the first line: a comma, else a semicolon, a tab or spaces.

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
    header = re.sub(r"\[.*?\]|\(.*?\)", "", lines[0][1]).strip() if lines else ""
    separator = next((mark for mark in ",;\t " if mark in header), ",")
    if separator == " ":  # any number of spaces, but those before and within the brackets of a unit
        return [(n, re.split(r"\s+(?![\[(]|[^\[(]*[\])])", line.strip())) for n, line in lines]
    return [
        (n, [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]) for n, line in lines
    ]


def heading(cell: str) -> tuple[str, str]:
    """Take a cell of a header apart: the name in lower case, and the unit behind it; empty without one.

    >>> heading("X [mas]"), heading("t (s)"), heading("xy")
    (('x', 'mas'), ('t', 's'), ('xy', ''))
    """
    found = re.fullmatch(r"([^\[(]+?)\s*[\[(](.*)[\])]", cell.strip())
    name, unit = found.groups() if found else (cell, "")
    return name.strip().lower(), unit.strip()


_TIMES = (
    r"(milli|micro|nano)-?sec\w*|[mµμun]s(ecs?)?|minutes?|hours?|days?|ticks?|(?<=in )m?jd|m?jd(?=\W*$)"
    r"|(?<=in )(weeks|months|years)(?!\W*\d)"
)
_FREQUENCIES = (
    r"[km]Hz|rad\w*\s*(/|per)\s*s\w*|angular freq\w*|omega|ω|normali[sz]ed freq\w*|rpm|cpm"
    r"|(cycles?|rad\w*)\s*(/|per)\s*(?!s(ec\w*)?\b)\w+"
)
_RADIANS = r"((milli|micro|nano)[- ]?)?rad(ian)?s?|[mµμun]rads?"
_ANGLES = (
    r"mas|[uµμ]as|(milli|micro)[- ]?arc\w*|arc-?min\w*|amin|deg(rees?)?|pix(els?)?|px|[uµμm]m|microns?"
    r"|(lambda|λ)/D|counts?|volts?|dB|log(10)?|ln|arbitrary"
)
_KINDS = (
    r"asd|lsd|amplitude spectr\w+|spectral amplitudes?|(amplitude|linear) spectral|magnitudes?|rms"
    r"|peak[- ]to[- ](peak|valley)|p-?p|cumulative|running sum|normali[sz]ed|integrated (power|psd|spectr\w+)"
    r"|per bin|scaling\W+spectrum"
)
_RATES = (
    r"(?<!sampling )(?<!sample )(?<!frame )(?<!data )rates?|velocit\w+|accelerations?|increments?"
    r"|(arc-?sec\w*|as)\s*(/|per)\s*s(ec\w*)?"
)
_SYMBOLS = r"√|\bsqrt|\b(rt|root) ?\(?Hz|\bHz\W{1,3}(0?\.5|1/2)|°|[\"″]\s*/\s*s\b"
_ELSEWHERE = re.compile(
    r"rates?\W*[\d.]+ ?[kM]?Hz\b|log([- ]spaced| ?files?| ?book| of \d)|deg(rees?)?( of freedom| ?C\b)"
    r"|magnitude [\d.]|counts?\s*[:=] ?\d|(days?|hours?|minutes?) \d|rad[- ]hard",
    re.IGNORECASE,
)
"""Words that begin as a unit and are none of a column: a sampling rate, a log file, degrees of freedom."""

_BEFORE = re.compile(r"((?<!\w)(arc-?sec|mas|as)\w* per |number of )$", re.IGNORECASE)
_TOTAL = re.compile(r"rms( of [^,;]*?)?\W*\d", re.IGNORECASE)
"""What stands before a pixel of a plate scale, or counts; and an rms of all, by its value."""

_MEASURED = re.compile(r"(?<![\w.])(?P<value>\d+\.?\d*(e[-+]?\d+)?|\.\d+)[ -]?$", re.IGNORECASE)
_MULTIPLE = re.compile(r"(\bin|[/*^]|\b(units?|steps|ticks|multiples) of)\s*$", re.IGNORECASE)
"""A number before a unit, and what makes of both the unit of a column."""

_SAME = 0.05
"""Relative difference below which such a number is one of a column."""

_IN_PROSE = {
    first: re.compile(
        rf"((?<![\w/])|(?<=\b[tfxy]/))((?P<first>{units})|(?P<rad>{_RADIANS})|(?P<rate>{_RATES})|(?P<kind>{_KINDS})|{_ANGLES})"
        rf"2?(?![^\W²])|{_SYMBOLS}",
        re.IGNORECASE,
    )
    for first, units in (("t", _TIMES), ("f", _FREQUENCIES))
}
"""Units of the first column (a time or a frequency) and of the others, and kinds of amplitude, that are not
those of columns without a unit."""


def refuse_unit_in_comment(path: Path, header: Sequence[str]) -> None:
    """Raise ConfigurationError where a comment names a unit of columns that have none.

    A kind of amplitude is no unit: one that a comment names is refused of lines whatever their unit.
    """
    if not header:
        return
    names, units = zip(*map(heading, header), strict=True)
    pattern = _IN_PROSE["t" if names[0] in ("t", "time") else "f"]
    with path.open(encoding="utf-8-sig") as handle:
        comments = [
            (n, found)
            for n, line in enumerate(handle, 1)
            if line[0] == "#"
            for found in pattern.finditer(line)
            if not (_is_stated(found, names, units) or _is_of_something_else(found, names))
        ]
    if comments and any(_number_before(found) is not None for _, found in comments):
        levels = _levels(path, header)
        comments = [(n, found) for n, found in comments if not _is_measured(found, levels)]
    if not comments:
        return
    number, found = comments[0]
    said = f"the comment in line {number} says {found[0]!r}"
    if found["kind"] and "amplitude" in names:
        problem = (
            f"{said}, and amplitudes of lines are from zero to peak; convert them, and leave the word out"
        )
        raise ConfigurationError(ErrorCode.CONFLICT, f"{problem}.")
    first = f"{header[0]} [ms]" if names[0] in ("t", "time") else f"{header[0]} [kHz]"
    example = first if found["first"] or len(header) == 1 else f"{header[1]} [mas{'/s' * (names[1] == 'wx')}]"
    remedy = f"write one behind each name, as in {example}, or leave the word out"
    raise ConfigurationError(ErrorCode.CONFLICT, f"{said}, and the columns have no unit; {remedy}.")


def _is_stated(found: re.Match, names: Sequence[str], units: Sequence[str]) -> bool:
    """Return whether the header says the unit that a word of a comment may be about."""
    if found["first"]:
        return bool(units[0])
    if found["kind"] and "amplitude" in names:
        return False
    if found["rate"] and "wx" in names:
        return True
    of_angle = units[names.index("angle")] if found["rad"] and "angle" in names else True
    return bool(len(units) > 1 and units[1] and of_angle)


def _is_of_something_else(found: re.Match, names: Sequence[str]) -> bool:
    """Return whether a word of a comment is in a phrase that says nothing of a column."""
    line, start = found.string, found.start()
    if _ELSEWHERE.match(line, start) or _BEFORE.search(line[:start]):
        return True
    if found[0].lower() == "rms" and "amplitude" not in names:  # a trace is none
        total = _TOTAL.match(line, start) or re.search(r"[\d.]+ ?arc-?sec\w* $", line[:start])
        return names[0] in ("t", "time") or bool(total)
    of_angle = "angle" in names and re.search(r"\bangles?\b|\bfrom \+?x\b", line, re.IGNORECASE)
    in_degrees = re.fullmatch("deg(rees?)?", found[0].lower()) is not None
    return bool(of_angle and in_degrees and "amplitude" not in line.lower())


def _number_before(found: re.Match) -> float | None:
    """Return the number that a unit in a comment belongs to, "10" of "10 ms"; None where it has none."""
    before = found.string[: found.start()]
    number = _MEASURED.search(before)
    logarithm = found[0].lower().startswith(("log", "ln"))
    if number is None or found["kind"] or logarithm or _MULTIPLE.search(before[: number.start()]):
        return None
    return float(number["value"])


def _is_measured(found: re.Match, levels: np.ndarray) -> bool:
    """Return whether a unit belongs to a number of its own, and not one of the table.

    "Latency 2 ms" says nothing of the columns, "step 2 ms" does if that of the table is 2.
    """
    number = _number_before(found)
    return number is not None and not np.any(np.abs(levels - number) <= _SAME * number)


def _levels(path: Path, header: Sequence[str]) -> np.ndarray:
    """Return what a comment may say of the columns of a table: their steps, ends, extents and scatter."""
    rows = [cells for _, cells in csv_rows(path, "") if len(cells) == len(header)]
    numbers = [[float(cell) if _NUMBER.fullmatch(cell) else np.nan for cell in cells] for cells in rows]
    table = np.array([row for row in numbers if np.all(np.isfinite(row))]).reshape(-1, len(header))
    if len(table) < 2:
        return np.array([])
    first = np.array([np.median(np.diff(table[:, 0])), np.ptp(table[:, 0]), table[0, 0], table[-1, 0]])
    rates = np.concatenate([1 / first[first > 0], 2 * first[-1:]])  # the sampling frequency of a spectrum
    rms = np.sqrt(np.sum(np.var(table[:, 1:], axis=0)))
    others = [np.abs(table[:, 1:]).max(axis=0), np.ptp(table[:, 1:], axis=0), np.std(table[:, 1:], axis=0)]
    return np.concatenate([first, rates, *others, [rms]])


_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?", re.IGNORECASE)


def assumed_units(header: Sequence[str], units: Sequence[str]) -> list[str]:
    """Return a sentence on the units that columns without one were taken to have; none if all have one.

    >>> assumed_units(["t", "x [mas]"], ["s", "arcsec"])
    ['The header gives no unit for t: read as s.']
    """
    taken = [
        (name, unit) for (name, stated), unit in zip(map(heading, header), units, strict=True) if not stated
    ]
    if not taken:
        return []
    names, read = (", ".join(words) for words in zip(*taken, strict=True))
    return [f"The header gives no unit for {names}: read as {read}."]


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
