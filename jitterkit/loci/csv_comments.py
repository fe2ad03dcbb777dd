"""Comments of a table of motion that name a unit: refused where the columns they may be about have none.

Reach for :func:`refuse_unit_in_comment`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.csv_table import comment_lines, csv_rows, heading, number

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
    comments = [
        (n, found)
        for n, line in comment_lines(path)
        for found in pattern.finditer(line)
        if not (_is_stated(found, names, units) or _is_of_something_else(found, names))
    ]
    if comments and any(_number_before(found) is not None for _, found in comments):
        levels = _levels(path, header)
        comments = [(n, found) for n, found in comments if not _is_measured(found, levels)]
    if not comments:
        return
    line, found = comments[0]
    said = f"the comment in line {line} says {found[0]!r}"
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
    measured = _MEASURED.search(before)
    logarithm = found[0].lower().startswith(("log", "ln"))
    if measured is None or found["kind"] or logarithm or _MULTIPLE.search(before[: measured.start()]):
        return None
    return float(measured["value"])


def _is_measured(found: re.Match, levels: np.ndarray) -> bool:
    """Return whether a unit belongs to a number of its own, and not one of the table.

    "Latency 2 ms" says nothing of the columns, "step 2 ms" does if that of the table is 2.
    """
    value = _number_before(found)
    return value is not None and not np.any(np.abs(levels - value) <= _SAME * value)


def _levels(path: Path, header: Sequence[str]) -> np.ndarray:
    """Return what a comment may say of the columns of a table: their steps, ends, extents and scatter."""
    rows = [cells for _, cells in csv_rows(path, "") if len(cells) == len(header)]
    numbers = [[number(cell) for cell in cells] for cells in rows]
    table = np.array([row for row in numbers if np.all(np.isfinite(row))]).reshape(-1, len(header))
    if len(table) < 2:
        return np.array([])
    first = np.array([np.median(np.diff(table[:, 0])), np.ptp(table[:, 0]), table[0, 0], table[-1, 0]])
    rates = np.concatenate([1 / first[first > 0], 2 * first[-1:]])  # the sampling frequency of a spectrum
    rms = np.sqrt(np.sum(np.var(table[:, 1:], axis=0)))
    others = [np.abs(table[:, 1:]).max(axis=0), np.ptp(table[:, 1:], axis=0), np.std(table[:, 1:], axis=0)]
    return np.concatenate([first, rates, *others, [rms]])
