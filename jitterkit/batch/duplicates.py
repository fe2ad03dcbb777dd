"""Rows of a run without those of duplicates.

Reach for :func:`duplicate_marker`.  Every frame is fitted where it is read, whoever has its pixels too, so
that a row depends on its batch alone; which rows are duplicates is decided where rows come together.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from jitterkit.frames.duplicates import Duplicates
from jitterkit.refit import FitResult
from jitterkit.report.row import Row, make_row

__all__ = ["duplicate_marker"]

_KEPT = ("file", "path", "time", "exposure", "seconds", "digest")
"""Columns that a duplicate keeps: none with a number that could be counted twice."""


def duplicate_marker() -> Callable[[Row], Row]:
    """Make a function that marks duplicates among rows.

    Returns
    -------
    mark : callable
        To be called with the rows of a run one after the other.  Returns the row; for a fitted frame whose
        pixels an earlier fitted frame had, one with the status ``duplicate`` and no numbers of a fit.
    """
    return partial(_marked, Duplicates())


def _marked(known: Duplicates, row: Row) -> Row:
    if row["status"] != "ok":  # it counts nowhere, and its own status says more
        return row
    original = known.original(row["digest"], f"{row['path']} [{row['frame']}]")
    if not original:
        return row
    blank = make_row(FitResult.duplicate_of(original), row["path"], row["frame"])
    return blank | {name: row[name] for name in _KEPT}
