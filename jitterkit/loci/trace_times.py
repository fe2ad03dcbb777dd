"""Times of a trace that are dates: reach for :func:`dates_to_seconds`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.csv_table import CsvRow, number

_CLOCK = re.compile(r"|utc?|gmt|tai|tt|gps|iso\W?(8601|t)?|date(time)?", re.IGNORECASE)
"""Units of a column of dates, which is in none."""


def dates_to_seconds(rows: Sequence[CsvRow], unit: str) -> tuple[list[CsvRow], bool]:
    """Replace dates in the first column by seconds since 1970.

    Parameters
    ----------
    rows : sequence of CsvRow
        Lines of numbers.
    unit : str
        That of the first column in the header.

    Returns
    -------
    rows : list of CsvRow
        As given, if the first of them begins with no ISO 8601 time.
    dated : bool
        Whether it does.

    Raises
    ------
    ConfigurationError
        If the column has a unit, or a later line has no such time.

    Notes
    -----
    A time without a zone is taken as UTC.  Microseconds count, nothing shorter.
    """
    if not rows or np.isfinite(number(rows[0][1][0])) or _seconds(rows[0][1][0]) is None:
        return list(rows), False
    if not _CLOCK.fullmatch(unit):
        problem = f"line {rows[0][0]} begins with the date {rows[0][1][0]!r}, and the header says {unit!r}"
        raise ConfigurationError(ErrorCode.CONFLICT, f"{problem}; leave the unit out.")
    replaced = []
    for line, (first, *others) in rows:
        seconds = _seconds(first)
        if seconds is None:
            problem = f"line {line} begins with {first!r}, and lines before it with dates"
            raise ConfigurationError(ErrorCode.MALFORMED, f"{problem}; give ISO 8601 times, or seconds.")
        replaced.append((line, [repr(seconds), *others]))
    return replaced, True


def _seconds(text: str) -> float | None:
    try:
        when = datetime.fromisoformat(text)
    except ValueError:
        return None
    return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()
