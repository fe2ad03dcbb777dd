"""A series as differences of halves, of halves of halves, ...: its Haar wavelet coefficients.

Under white noise, gaps and unequal errors or not, they are independent; under flicker and random walks
nearly so, and each noise gives them known variances.  That makes them the right thing to fit noise to, where
the points of an overlapping Allan deviation are anything but independent.  Reach for
:func:`haar_coefficients`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jitterkit.series.laws import difference_variance
from jitterkit.series.series import Series


@dataclass(frozen=True, eq=False)
class Haar:
    """Differences of the weighted means of neighbouring blocks of 1, 2, 4, ... steps.

    Attributes
    ----------
    values : (k,) array
        Later less earlier; k is one less than the measurements.
    octave : (k,) int array
        The blocks are of ``2**octave`` steps, or what there is of them.
    trend : (k, degree) array
        The same of the powers of time, counted from the middle of the series in halves of its length.
    white : (k,) array
        Variance by the errors.
    flicker, walk : (k,) array
        Variances of noises with an Allan variance of one at one step.
    """

    values: np.ndarray
    octave: np.ndarray
    trend: np.ndarray
    white: np.ndarray
    flicker: np.ndarray
    walk: np.ndarray


def haar_coefficients(series: Series, degree: int = 1) -> Haar:
    """Take a series apart, in time proportional to its length.

    Parameters
    ----------
    series : Series
    degree : int
        Of the powers of time that are taken apart with it.

    Notes
    -----
    Blocks are weighed by the errors.  For flicker and walks a block with gaps stands as a whole one with the
    same mean time and the same spread in time.
    """
    weights, means = series.gridded()
    size = 1 << (len(weights) - 1).bit_length()
    weight = np.zeros(size)
    weight[: len(weights)] = weights
    step = np.arange(size, dtype=float)
    time = 2 * step / (len(weights) - 1) - 1
    columns = np.stack([np.zeros(size), step, *(time**k for k in range(1, degree + 1))], axis=1)
    columns[: len(means), 0] = means
    spread = np.full(size, 1 / 12)
    rows: list[tuple[np.ndarray, ...]] = []
    for octave in range(size.bit_length() - 1):
        first, second = weight[0::2], weight[1::2]
        both = (first > 0) & (second > 0)
        change = columns[1::2] - columns[0::2]
        lengths = (np.sqrt(12 * part[both]) for part in (spread[0::2], spread[1::2]))
        white = 1 / first[both] + 1 / second[both]
        rows.append((change[both], np.full(len(white), octave), white, *lengths))
        weight = first + second
        share = np.divide(second, weight, out=np.zeros_like(weight), where=weight > 0)
        spread = spread[0::2] * (1 - share) + spread[1::2] * share + share * (1 - share) * change[:, 1] ** 2
        columns = columns[0::2] + share[:, None] * change
    change, octaves, white, first, second = (np.concatenate(column) for column in zip(*rows, strict=True))
    red = (difference_variance(first, second, change[:, 1], noise) for noise in ("flicker", "walk"))
    return Haar(change[:, 0], octaves, change[:, 2:], white, *red)
