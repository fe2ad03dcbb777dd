"""Means over stretches of time: what is drawn of a run with more frames than a picture can hold.

Reach for :func:`stretch_means`; :func:`stretch_index` alone says which frame lies in which stretch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

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
    """Which of ``count`` equal stretches each time lies in, (n,) int, from 0."""
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
    return Means(
        at=moment[there] / weight[there],
        values=mean[there] + level,
        errors=weight[there] ** -0.5 * widened,
        counts=n[there],
        widened=widened,
    )
