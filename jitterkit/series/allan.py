"""How the scatter of means falls with the time they take: the Allan deviation, and plain block means.

Reach for :func:`allan_deviation`, whose differences of neighbours are blind to a constant and nearly to slow
changes, and for :func:`block_scatter` to see whether means of n frames scatter by error/sqrt(n).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.series.laws import degrees_of_freedom
from jitterkit.series.series import Series

_ONE_SIGMA = 0.6827
_FULL = 0.5
"""Share of the fullest block's measurements that a block must hold to be a mean of that length."""

_FEWEST = 5
"""Blocks of which a scatter is known to a third."""


@dataclass(frozen=True, eq=False)
class AllanDeviation:
    """The Allan deviation of a series at some averaging lengths.

    Attributes
    ----------
    lengths : (m,) int array
        In steps of the cadence.
    times : (m,) array
        The same in the unit of the times.
    deviation, low, high : (m,) array
        In the unit of the values, and its confidence interval (68.27 % unless asked otherwise).
    expected : (m,) array
        What the stated errors alone would give; NaN where none were stated.
    count : (m,) int array
        Differences of means, overlapping.
    dof : (m,) array
        Independent differences that they are worth under ``noise``.
    noise : str
        The law under which the interval holds.
    """

    lengths: np.ndarray
    times: np.ndarray
    deviation: np.ndarray
    low: np.ndarray
    high: np.ndarray
    expected: np.ndarray
    count: np.ndarray
    dof: np.ndarray
    noise: str


@dataclass(frozen=True, eq=False)
class BlockScatter:
    """The scatter of means of consecutive measurements.

    Attributes
    ----------
    lengths : (m,) int array
        In steps of the cadence.
    times : (m,) array
    scatter, error : (m,) array
        Standard deviation of the weighted means of blocks, in the unit of the values, and its error where
        the means are independent.
    expected : (m,) array
        ``error/sqrt(n)`` of the stated errors; NaN where none were stated.
    count : (m,) int array
        Blocks.
    """

    lengths: np.ndarray
    times: np.ndarray
    scatter: np.ndarray
    error: np.ndarray
    expected: np.ndarray
    count: np.ndarray


def allan_deviation(
    series: Series, *, per_octave: int = 4, noise: str = "white", confidence: float = _ONE_SIGMA
) -> AllanDeviation:
    """Measure the overlapping Allan deviation of a series.

    Parameters
    ----------
    series : Series
    per_octave : int
        Averaging lengths in a factor of two; from 1 to a third of the series.
    noise : {"white", "flicker", "walk"}
        Under which the overlapping differences are counted for the confidence interval.
    confidence : float

    Returns
    -------
    deviation : AllanDeviation
        It falls as 1/sqrt(length) for white noise, is flat for flicker, and ``D length/sqrt(2)`` for a drift
        of D a step.

    Raises
    ------
    ConfigurationError
        If the noise is unknown.

    Notes
    -----
    A mean over a block weighs its measurements by their errors.  A block with less than half the
    measurements of the fullest of its length is not used.  Each squared difference then counts by the
    inverse of the variance that the errors give it, so that a thin block, or one of poor measurements, spoils
    nothing.  Equal errors and no gaps: the textbook's estimate.

    *Assumes* for the interval a chi-squared law of so many
    :func:`~jitterkit.series.laws.degrees_of_freedom`: flicker has a fifth, a walk two fifths fewer than white
    noise.  *Fails when* the series is mostly gaps: what stands on two sides of a gap longer than the length
    is not compared.
    """
    weights, means = series.gridded()
    sums = [np.concatenate([[0], np.cumsum(x)]) for x in (weights, weights * means, weights > 0)]
    rows = []
    for length in _lengths(len(weights) // 3, per_octave):
        square, variance, count = _mean_square(sums, length)
        if count:
            rows.append((length, square, variance, count, degrees_of_freedom(count, length, noise)))
    lengths, squares, variances, counts, dof = (np.array(column) for column in zip(*rows, strict=True))
    tails = (1 + confidence) / 2, (1 - confidence) / 2
    low, high = (np.sqrt(squares * dof / chi2.ppf(tail, dof)) for tail in tails)
    return AllanDeviation(
        lengths=lengths,
        times=lengths * series.cadence,
        deviation=np.sqrt(squares),
        low=low,
        high=high,
        expected=np.sqrt(variances) if series.stated else np.full(len(rows), np.nan),
        count=counts,
        dof=dof,
        noise=noise,
    )


def _mean_square(sums: list[np.ndarray], length: int) -> tuple[float, float, int]:
    """Return half the mean squared difference of neighbours, the part by errors, and their number."""
    weight, total, filled = (x[length:] - x[:-length] for x in sums)
    full = (filled >= _FULL * filled.max()) & (weight > 0)
    mean = np.divide(total, weight, out=np.zeros_like(total), where=full)
    variance = np.divide(1.0, weight, out=np.full_like(weight, np.inf), where=full)
    use = full[length:] & full[:-length]
    share = np.where(use, 1 / (variance[length:] + variance[:-length]), 0.0)
    count, scale = int(use.sum()), share.sum()
    if not count:
        return np.nan, np.nan, 0
    square = float(share @ (mean[length:] - mean[:-length]) ** 2) / scale
    return square / 2, float(count / scale) / 2, count


def _lengths(longest: int, per_octave: int) -> np.ndarray:
    steps = np.arange(per_octave * np.log2(max(longest, 1)) + 1)
    return np.unique(np.rint(2 ** (steps / per_octave)).astype(int))


def block_scatter(series: Series, *, per_octave: int = 2) -> BlockScatter:
    """Measure the standard deviation of block means against the blocks' length.

    Parameters
    ----------
    series : Series
    per_octave : int
        Lengths in a factor of two, as long as there are five blocks.

    Returns
    -------
    scatter : BlockScatter

    Raises
    ------
    ConfigurationError
        If fewer than five steps of the cadence have measurements.

    Notes
    -----
    Where blocks differ (gaps, unequal errors), each squared deviation from the weighted mean counts by the
    block's weight, and ``expected`` is its expectation: their ratio squared is chi² over its degrees of
    freedom.  A slow trend stays in it, as it stays in a mean.
    """
    weights, means = series.gridded()
    rows = []
    for length in _lengths(max(len(weights) // _FEWEST, 1), per_octave):
        starts = np.arange(0, len(weights), length)
        weight, total = (np.add.reduceat(x, starts) for x in (weights, weights * means))
        there = weight > 0
        weight, mean = weight[there], total[there] / weight[there]
        if (blocks := len(weight)) >= _FEWEST:
            variance = blocks / weight.sum()
            chi = float(weight @ (mean - np.average(mean, weights=weight)) ** 2)
            rows.append((length, variance * chi / (blocks - 1), variance, blocks))
    if not rows:
        steps = f"{int(series.good.sum())} measurements in {np.count_nonzero(weights)} steps of the cadence"
        problem = f"{steps} have no scatter of blocks; give measurements in {_FEWEST} steps or more."
        raise ConfigurationError(ErrorCode.TOO_FEW, problem)
    lengths, square, variance, count = (np.array(column) for column in zip(*rows, strict=True))
    scatter = np.sqrt(square)
    expected = np.sqrt(variance) if series.stated else np.full(len(rows), np.nan)
    error = scatter / np.sqrt(2 * (count - 1))
    return BlockScatter(lengths, lengths * series.cadence, scatter, error, expected, count)
