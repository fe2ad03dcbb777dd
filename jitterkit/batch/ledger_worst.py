"""Which frames of a run are worth a picture, whatever the order in which they come.

Reach for :func:`wanted`.  It asks what :class:`~jitterkit.report.pictures.Gallery` asks, but ties go to
the frame that comes first in the plan: so the choice does not depend on which batch was done first, nor on
what was asked in between, and a run that was interrupted shows the same frames as one that was not.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from jitterkit.report.pictures import MOST_PICTURES
from jitterkit.report.row import Row

__all__ = ["Rank", "rank", "wanted", "worst"]

Rank = tuple[bool, float, int, int]
"""Whether the frame was fitted, minus its misfit, its batch and its place there: the worst sorts first."""


def rank(row: Row, batch: int, place: int) -> Rank:
    """Rank a frame among those of its kind; one without a fit comes behind those with a bad one."""
    misfit = row["chi2_dof"]
    return row["status"] == "ok", -misfit if math.isfinite(misfit) else math.inf, batch, place


def worst(ranks: Iterable[Rank], most: int = MOST_PICTURES) -> list[Rank]:
    """Take the first of each kind, fitted or not: a report shows as many of both together.

    Notes
    -----
    The worst of several runs of frames are the worst of the worst of each: one may ask early and often.
    """
    ordered = sorted(ranks)
    fitted = [one for one in ordered if one[0]]
    return [one for one in ordered if not one[0]][:most] + fitted[:most]


def wanted(
    ranks: Iterable[Rank], batch: int, rows: Mapping[int, Row], most: int = MOST_PICTURES
) -> list[int]:
    """Say which frames of a batch to draw.

    Parameters
    ----------
    ranks : iterable of Rank
        Of the pictures there are, from :meth:`~jitterkit.batch.ledger.Ledger.ranks`; older ones will do, and
        only cost a picture or two more.
    batch : int
    rows : mapping from int to dict
        By place in the batch, the rows of frames that can be drawn at all.

    Returns
    -------
    places : list of int
    """
    new = [rank(row, batch, place) for place, row in rows.items()]
    return sorted(place for _, _, number, place in worst([*ranks, *new], most) if number == batch)
