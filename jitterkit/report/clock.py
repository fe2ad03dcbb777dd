"""When the frames of a run were taken, as far as their headers tell them apart.

Reach for :meth:`Clock.of`, which has a place in time for every row of a results table, failed ones too, and
for :func:`separation_series`, which hands the separations to :mod:`jitterkit.series`.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from astropy.table import QTable

from jitterkit.errors import ConfigurationError
from jitterkit.frames.times import epoch_seconds
from jitterkit.series import Series

_APART = 0.9
"""Share of the frames that must have a time of their own: the planes of a cube often share their file's."""

_PARTS, _LEAST = 100, 10
"""A time axis of so many parts is readable if frames stand in so many of them.  Two short nights a year
apart, or a single header with a wrong year, leave two; a night of which a third is lost leaves 67."""


@dataclass(frozen=True, eq=False)
class Clock:
    """A place for every frame of a run on one axis.

    Attributes
    ----------
    at : (n,) array
        Seconds since the first fitted frame, or the frame's number from 1; in the table's order.
    unit : {"s", "frame"}
    start : str
        Time of the first fitted frame, ISO 8601; empty where frames are only counted.
    """

    at: np.ndarray
    unit: str
    start: str

    @classmethod
    def of(cls, table: QTable) -> Clock:
        """Find the places of a table's frames.

        Returns
        -------
        clock : Clock
            By time if every fitted frame has one, nine in ten of these differ, and they do not stand in a
            few heaps on their axis; else by number.

        Notes
        -----
        A frame that failed without a time (a file that could not be read) is put between its neighbours.
        """
        times = np.array([epoch_seconds(text) for text in np.asarray(table["time"]).tolist()])
        used = np.asarray(table["status"]) == "ok"
        if not _order_frames(times[used]):
            return cls(np.arange(len(table)) + 1.0, "frame", "")
        first = float(times[used].min())
        known = np.flatnonzero(np.isfinite(times))
        times = np.interp(np.arange(len(table)), known, times[known])
        start = datetime.fromtimestamp(first, UTC).replace(tzinfo=None)
        return cls(times - first, "s", start.isoformat(sep=" ", timespec="seconds"))


def _order_frames(times: np.ndarray) -> bool:
    """Return whether times order frames, and can be read off an axis."""
    if len(times) < 2 or not np.isfinite(times).all() or len(np.unique(times)) < _APART * len(times):
        return False
    parts = np.unique((_PARTS * (times - times.min()) / (1.001 * np.ptp(times))).astype(int))
    return len(parts) >= min(_LEAST, len(times) // 2 + 1)


def fitted(table: QTable) -> np.ndarray:
    """Return which frames of a table have a separation that counts, (n,) bool."""
    values, errors = (table[name].to_value("arcsec") for name in ("separation", "separation_err"))
    return (np.asarray(table["status"]) == "ok") & np.isfinite(values) & np.isfinite(errors) & (errors > 0)


def separation_series(table: QTable, clock: Clock) -> Series | None:
    """The separations of a run that count, in arcsec, the others missing; None where they are no series."""
    values, errors = (table[name].to_value("arcsec") for name in ("separation", "separation_err"))
    good = fitted(table)
    if not good.any() or np.ptp(np.percentile(values[good], (25, 75))) == 0:
        return None  # half of them the same number: copies of one frame
    try:
        return Series.of(np.where(good, values, np.nan), errors, clock.at)
    except ConfigurationError:
        return None
