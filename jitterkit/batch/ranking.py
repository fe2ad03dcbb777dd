"""Which frames of a run are the worst, so that a report shows their pictures: reach for :func:`wanted`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

Row = dict[str, Any]
"""Column name to text, integer or float."""

Rank = tuple[bool, float, int, int]
"""Whether a frame was fitted, minus its misfit, its batch and its position there: the worst sorts first."""

TOP = 24
"""Frames of each kind, fitted or not, of which data for a picture are kept."""


def rank(row: Row, batch: int, index: int) -> Rank:
    """Rank a frame among those of its kind; one without a fit comes behind those with a bad one."""
    misfit = row["chi2_dof"]
    return row["status"] == "ok", -misfit if math.isfinite(misfit) else math.inf, batch, index


def top(ranks: Iterable[Rank]) -> list[Rank]:
    """Return the worst of each kind, fitted or not: a report shows as many of both together.

    Ties go to the frame that comes first in the plan.  The worst of several runs of frames are the worst of
    the worst of each, so one may ask early and often.
    """
    ordered = sorted(ranks)
    fitted = [one for one in ordered if one[0]]
    return [one for one in ordered if not one[0]][:TOP] + fitted[:TOP]


def wanted(ranks: Iterable[Rank], batch: int, rows: Mapping[int, Row], start: int = 0) -> list[int]:
    """Return of which frames of a batch to keep data for a picture.

    Parameters
    ----------
    ranks : iterable of Rank
        Of those kept, from :meth:`Store.ranks`; older ones will do, and only keep one or two more.
    batch : int
    rows : mapping from int to dict
        By position behind ``start``, the rows of frames that can be drawn at all.
    start : int
        Position in the batch of the first of them.

    Returns
    -------
    indices : list of int
        Positions behind ``start``.
    """
    new = [rank(row, batch, start + index) for index, row in rows.items()]
    return sorted(index - start for _, _, number, index in set(top([*ranks, *new])) & set(new))
