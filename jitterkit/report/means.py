"""Means of independent measurements: of all, of the first N, and over stretches of time; and their times.

Reach for :func:`stretch_means` to draw a run with more frames than a picture can hold;
:func:`stretch_index` alone says which frame lies in which stretch.

A :class:`Clock` says when the frames of a run were taken, as far as their headers tell them apart.
Reach for :meth:`Clock.of`, which has a place in time for every row of a results table, failed ones too,
and for :func:`separation_series`, which hands the separations to :mod:`jitterkit.series`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
from astropy.table import QTable

from jitterkit.errors import ConfigurationError
from jitterkit.frames.times import epoch_seconds
from jitterkit.series import Series

COMBINED = ("mean", "error", "typical_error", "scatter", "chi2_dof", "error_by_scatter")


def weighted_mean(values: np.ndarray, errors: np.ndarray) -> dict[str, Any]:
    """Combine independent measurements of one number.

    Parameters
    ----------
    values, errors : (n,) arrays
        In one unit; those that are not finite, or have no positive error, are left out.

    Returns
    -------
    combined : dict
        ``n`` used; ``mean`` and its ``error`` from the errors alone; ``typical_error``, their median;
        ``scatter``, the sample's standard deviation; ``chi2_dof`` of the values about the mean; and
        ``error_by_scatter``, the mean's error if all errors were off by one factor.  NaN where there
        are too few.  Equal errors give the plain mean and ``error = errors[0]/sqrt(n)``.
    """
    values, errors = np.asarray(values, float), np.asarray(errors, float)
    used = np.isfinite(values) & np.isfinite(errors) & (errors > 0)
    values, errors = values[used], errors[used]
    n = len(values)
    if n == 0:
        return {"n": 0} | dict.fromkeys(COMBINED, math.nan)
    weights = (errors.min() / errors) ** 2
    mean = values[0] + np.average(values - values[0], weights=weights)  # differences keep the last digits
    error = errors.min() / np.sqrt(weights.sum())
    alone = n == 1
    chi2_dof = math.nan if alone else np.sum(((values - mean) / errors) ** 2) / (n - 1)
    scatter = math.nan if alone else np.std(values, ddof=1)
    numbers = (mean, error, np.median(errors), scatter, chi2_dof, error * np.sqrt(chi2_dof))
    return {"n": n} | {name: float(value) for name, value in zip(COMBINED, numbers, strict=True)}


def running_mean(values: np.ndarray, errors: np.ndarray) -> dict[str, np.ndarray]:
    """Combine the first measurement, the first two, and so on.

    Parameters
    ----------
    values, errors : (n,) arrays
        Finite; errors positive.

    Returns
    -------
    combined : dict of (n,) arrays
        ``mean``, ``error``, ``chi2_dof`` and ``error_by_scatter``, as :func:`weighted_mean` has them of so
        many; the last two NaN of one.
    """
    values, errors = np.asarray(values, float), np.asarray(errors, float)
    level = float(np.average(values, weights=errors**-2))  # differences keep the last digits
    weight, first, second = (np.cumsum(errors**-2 * (values - level) ** k) for k in range(3))
    count = np.arange(len(values))
    with np.errstate(invalid="ignore", divide="ignore"):
        chi2_dof = np.maximum(second - first**2 / weight, 0) / count
    error = weight**-0.5
    mean = level + first / weight
    return {"mean": mean, "error": error, "chi2_dof": chi2_dof, "error_by_scatter": error * np.sqrt(chi2_dof)}


def corrected(separation, va_factor, orbit_change) -> np.ndarray:
    """Correct separations for velocity aberration and orbital motion.

    Parameters
    ----------
    separation, va_factor, orbit_change : float or (n,) arrays
        arcsec, ratio, arcsec; NaN where it is not known.

    Returns
    -------
    corrected : array
        ``separation va_factor - orbit_change``.  Without what no separation has; NaN for one that lacks
        what others have, and for all if none has either.
    """
    aberrated, moving = np.isfinite(va_factor).any(), np.isfinite(orbit_change).any()
    if not (aberrated or moving):
        return np.full_like(separation, math.nan, dtype=float)
    factor, change = va_factor if aberrated else 1.0, orbit_change if moving else 0.0
    return np.asarray(separation, float) * factor - change


_SURE = 3.0
"""Sigmas by which the scatter must exceed the errors before the errors are widened by it: 1 run in 700."""


@dataclass(frozen=True, eq=False)
class Means:
    """Weighted means of measurements over stretches of time, and how far to trust them.

    Attributes
    ----------
    at, values, errors : (m,) array
        Weighted mean time and value of each stretch that holds a measurement; the errors are those of the
        measurements' own, times ``widened``.
    counts : (m,) int array
    widened : float
        Root of chi²/dof of all measurements about their stretch's mean where that is more than chance
        allows, else 1: errors that are too small make means that are too good.
    """

    at: np.ndarray
    values: np.ndarray
    errors: np.ndarray
    counts: np.ndarray
    widened: float


def stretch_index(at: np.ndarray, count: int) -> np.ndarray:
    """Return which of ``count`` equal stretches each time lies in, (n,) int, from 0."""
    span = float(np.ptp(at))
    if not span:
        return np.zeros(len(at), int)
    return np.minimum((count * ((at - at.min()) / span)).astype(int), count - 1)


def stretch_means(at: np.ndarray, values: np.ndarray, errors: np.ndarray, count: int) -> Means:
    """Average measurements over equal stretches of time.

    Parameters
    ----------
    at, values, errors : (n,) arrays
        Finite; errors positive, one sigma.
    count : int
        Stretches from the first measurement to the last.

    Returns
    -------
    means : Means

    Notes
    -----
    *Fails when* a measurement's error is unrelated to its scatter: a few wild measurements then pull the
    means of their stretches, and widen the errors of all.
    """
    index, level, weights = stretch_index(at, count), values[0], errors**-2
    n = np.bincount(index)
    weight, moment, total = (np.bincount(index, weights * x) for x in (1.0, at, values - level))
    there = n > 0
    mean = np.divide(total, weight, out=np.zeros_like(total), where=there)
    dof = len(at) - int(there.sum())
    chi2_dof = float(np.sum(((values - level - mean[index]) / errors) ** 2) / dof) if dof else 1.0
    widened = math.sqrt(chi2_dof) if dof and chi2_dof > 1 + _SURE * math.sqrt(2 / dof) else 1.0
    errors = weight[there] ** -0.5 * widened
    return Means(moment[there] / weight[there], mean[there] + level, errors, n[there], widened)


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
