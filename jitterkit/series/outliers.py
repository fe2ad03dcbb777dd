"""Measurements that do not belong to their series: flagged, never dropped.

Reach for :func:`find_outliers`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.series.series import Series

_FEWEST = 15
"""Measurements from which the test holds: of 15 normal ones 8 % are flagged where 5 % are asked for, 1.6 %
where 1 %; of 100 and more 5 to 6 %, and 1.2 %."""

_LEAST_VARIANCE = 1e-24
"""Variance, in stated errors, that rounding leaves where there is none."""

_MAD = 1.4826
_KNEE, _BEND = 1.345, 4.685
"""Where Huber's and Tukey's weights turn, in sigmas, for an efficiency of 95 %."""

_ROUNDS, _CONVERGED = 30, 1e-4
"""Of a robust fit, which ends where it moves by less than that in sigmas."""


@dataclass(frozen=True, eq=False)
class Outliers:
    """Measurements of a series that do not belong.

    Attributes
    ----------
    flags : (n,) bool array
        In the series' order.
    pulls : (n,) array
        Residuals about the robust trend in sigmas of the others: of the stated errors times ``scale``; NaN
        where a measurement is missing.
    trend : (n,) array
        The robust trend.
    scale : float
        Scatter of the measurements that belong, over the stated errors; NaN where none are.
    limit : float
        Size of the pull beyond which a measurement of this series does not belong.
    expected : float
        False flags in a series of normal noise.
    """

    flags: np.ndarray
    pulls: np.ndarray
    trend: np.ndarray
    scale: float
    limit: float
    expected: float


def find_outliers(series: Series, *, degree: int = 1, expected: float = 0.01, most: float = 0.2) -> Outliers:
    """Flag the measurements that do not belong.

    Parameters
    ----------
    series : Series
    degree : int
        Of the trend, fitted robustly.
    expected : float
        False flags in a whole series of normal noise, whatever its length.
    most : float
        Share of the measurements that may be outliers.

    Returns
    -------
    outliers : Outliers

    Raises
    ------
    ConfigurationError
        If there are fewer than 15 measurements.

    Notes
    -----
    Rosner's generalised extreme studentised deviate: the farthest is taken away, and again, up to the share
    ``most``; the last one that was too far for its company is an outlier with all before it, so several do
    not hide each other.  Stated errors count by their ratios: were all too small by one factor, no
    measurement would be worse than another.

    *Fails when* the series wanders by more than an error about its trend.
    """
    y, e, t = series.present
    n = len(y)
    if n < _FEWEST:
        problem = f"{n} measurements do not show which is an outlier; give {_FEWEST} or more."
        raise ConfigurationError(ErrorCode.TOO_FEW, problem)
    trend = _robust_trend(y, e, t, degree)
    z = (y - trend) / e
    far = _far(z, max(1, int(most * n)), expected, degree)
    rest = np.delete(z, far)
    centre, scale = float(rest.mean()), float(rest.std(ddof=1))
    flags = np.zeros(n, bool)
    flags[far] = True
    return Outliers(
        flags=_in_place(series, flags, False),
        pulls=_in_place(series, (z - centre) / scale, np.nan),
        trend=_in_place(series, trend + centre * e, np.nan),
        scale=scale if series.stated else np.nan,
        limit=float(_limit(np.array([len(rest)]), expected, degree)[0]),
        expected=expected,
    )


def _in_place(series: Series, column: np.ndarray, empty) -> np.ndarray:
    """Return a column of the measurements that are there, with gaps where they are not."""
    full = np.full(len(series.values), empty)
    full[series.good] = column
    return full


def _limit(left: np.ndarray, expected: float, degree: int) -> np.ndarray:
    """Greatest deviate of so many residuals, exceeded with the probability given (Rosner 1983)."""
    free = left - 2 - degree
    t = student.isf(expected / (2 * left), free)
    return (left - 1) * t / np.sqrt((free + t**2) * left)


def _far(z: np.ndarray, most: int, expected: float, degree: int) -> np.ndarray:
    """Indices of those that are too far from the rest, by Rosner's test."""
    gone = _peel(z, most)
    left = len(z) - np.arange(most)
    core, taken = np.delete(z, gone), z[gone][::-1]
    total, squares = core.sum() + np.cumsum(taken)[::-1], core @ core + np.cumsum(taken**2)[::-1]
    centre = total / left
    scale = np.sqrt(np.maximum((squares - left * centre**2) / (left - 1), _LEAST_VARIANCE))
    beyond = np.flatnonzero(np.abs(z[gone] - centre) > scale * _limit(left, expected, degree))
    return gone[: beyond[-1] + 1] if len(beyond) else gone[:0]


def _peel(z: np.ndarray, most: int) -> np.ndarray:
    """Indices of the farthest from the mean of the rest, one by one."""
    order = np.argsort(z)
    values = z[order].tolist()
    low, high, total = 0, len(values) - 1, float(z.sum())
    gone = []
    for _ in range(most):
        centre = total / (high - low + 1)
        at = low if centre - values[low] > values[high] - centre else high
        low, high = (low + 1, high) if at == low else (low, high - 1)
        gone.append(order[at])
        total -= values[at]
    return np.array(gone)


def _robust_trend(y: np.ndarray, e: np.ndarray, t: np.ndarray, degree: int) -> np.ndarray:
    """A polynomial by Huber's weights, which find the place, then Tukey's, which forget the far ones."""
    x = (t - t.mean()) / max(float(np.ptp(t)), np.finfo(float).tiny)
    basis = np.polynomial.legendre.legvander(2 * x, degree) / e[:, None]
    target = (y - np.median(y)) / e
    fitted = basis @ np.linalg.lstsq(basis, target)[0]
    for weigh in (_huber, _tukey):
        for _ in range(_ROUNDS):
            residual = target - fitted
            scale = max(_MAD * float(np.median(np.abs(residual))), np.finfo(float).tiny)
            root = np.sqrt(weigh(residual / scale))
            before = fitted
            fitted = basis @ np.linalg.lstsq(basis * root[:, None], target * root)[0]
            if np.abs(fitted - before).max() < _CONVERGED * scale:
                break
    return np.median(y) + fitted * e


def _huber(z: np.ndarray) -> np.ndarray:
    return 1 / np.maximum(1, np.abs(z) / _KNEE)


def _tukey(z: np.ndarray) -> np.ndarray:
    return (1 - np.minimum(np.abs(z) / _BEND, 1.0) ** 2) ** 2
